"""One session as the panel follows it: live state, events, watchdog, alarms and who has seen them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from bench.control.live import acknowledge, read_acknowledged, read_now
from bench.control.watchdog import FOLDER as WATCHDOG_FOLDER
from bench.present.panel._advice import Banner, Situation, banner
from bench.present.panel._folders import RunsFolder
from bench.present.panel._tails import EventTail
from bench.present.sentences import event_of, sentence
from bench.record.events import Event
from bench.record.events.safe import SafeState
from drivers.base.clock import epoch_seconds, host_seconds
from drivers.base.errors import BenchError


@dataclass(frozen=True)
class AlarmRow:
    """An alarm as it is shown; `seen`: who acknowledged it and when, empty while nobody has."""

    key: str
    time_s: float | None
    kind: str
    text: str
    run: str
    seen: str


class Session:
    """Follows the session in `path`: `update` reads what has changed."""

    def __init__(self, folder: RunsFolder, path: Path) -> None:
        self.path = path
        self.name = str(path.relative_to(folder.root))
        self.now: dict[str, Any] | None = None
        self.problem = ""
        """Why the live state cannot be read; the one before stays."""
        self.run: Path | None = None
        self._followed = ""
        self._folder = folder
        self._events: EventTail | None = None
        self._watchdog: EventTail | None = None
        self._changed_at = host_seconds()
        self._seen: dict[str, tuple[str, str]] = {}
        self._parsed: tuple[list[Event], list[Event]] | None = None

    def update(self) -> bool:
        """Read what has come; return whether the live state is another one."""
        try:
            now, self.problem = read_now(self.path), ""
        except BenchError as error:
            self.problem = str(error)
            return False
        if now is None:
            self.problem = "it is gone"
            return False
        changed = now != self.now
        if self.now is None:
            self._changed_at = host_seconds() - _seconds_since(now["utc"])
        elif now["utc"] != self.now["utc"]:
            self._changed_at = host_seconds()
        self.now = now
        if changed:
            self._follow(str((now.get("run") or {}).get("folder") or ""))
        for tail in (self._events, self._watchdog):
            if tail is not None and tail.update():
                self._parsed = None
        self.read_seen()
        return changed

    def read_seen(self) -> None:
        """Read who has acknowledged what."""
        self._seen = read_acknowledged(self.path)

    @property
    def alive(self) -> bool:
        """Whether there is a process that would take a request."""
        return bool(self.now and self.now["alive"])

    @property
    def age_s(self) -> float:
        """For how long its live state has not changed, in host seconds."""
        return host_seconds() - self._changed_at

    @property
    def bench(self) -> str:
        """The name of its bench, empty in a session of an older version."""
        now = self.now or {}
        return str((now.get("run") or {}).get("bench") or (now.get("campaign") or {}).get("bench") or "")

    @property
    def emulated(self) -> bool:
        """Whether nothing real moves."""
        now = self.now or {}
        return bool((now.get("run") or now.get("campaign") or {}).get("emulated"))

    @property
    def lines(self) -> list[dict[str, Any]]:
        """The last lines of the run's events."""
        return list(self._events.lines) if self._events is not None else []

    @property
    def situation(self) -> Situation:
        """What is known of where it is."""
        if self._parsed is None:
            taken = self._watchdog.lines if self._watchdog is not None else ()
            self._parsed = [event_of(row) for row in self.lines], [event_of(row) for row in taken]
        events, watchdog = self._parsed
        silent_s = self.age_s if self.alive else 0.0
        return Situation(self.now, events, watchdog, silent_s, self.problem, self.emulated)

    def banner(self) -> Banner:
        """Return what an operator has to know."""
        return banner(self.situation)

    def read_back(self) -> dict[str, SafeState]:
        """Return what the devices read back when the bench was made safe, after the last telemetry."""
        if self.now is None or self.alive:
            return {}
        return {state.device: state for state in self.situation.safe if state.confirmed}

    def alarms(self) -> list[AlarmRow]:
        """Return alarms, newest first, the end among them if it was a bad one."""
        rows: dict[str, AlarmRow] = {}
        now = self.now or {}
        head = self.banner()
        if head.tone == "bad" and not self.alive and not self.problem:
            run_id = str((now.get("run") or {}).get("run_id", ""))
            key = f"{run_id}|{now.get('utc', '')}|end"
            rows[key] = self._alarm(key, now.get("time_s"), "end", f"{head.word}: {head.happened}", run_id)
        for row in reversed(now.get("alarms") or []):
            run_id = str(row.get("run") or (now.get("run") or {}).get("run_id", ""))
            key = f"{run_id}|{row['time_s']}|{row['kind']}|{row.get('device', '')}"
            rows[key] = self._alarm(key, row["time_s"], row["kind"], sentence(event_of(row)), run_id)
        return list(rows.values())

    def _alarm(self, key: str, time_s: float | None, kind: str, text: str, run_id: str) -> AlarmRow:
        by, utc = self._seen.get(key, ("", ""))
        return AlarmRow(key, time_s, kind, text, run_id, f"seen by {by}, {utc[11:16]} UTC" if by else "")

    def unseen(self) -> list[AlarmRow]:
        """Return the alarms that nobody has acknowledged."""
        return [row for row in self.alarms() if not row.seen]

    @property
    def needs_somebody(self) -> bool:
        """Whether it ended or goes on badly and nobody has said to have seen that."""
        return self.banner().tone == "bad" and not self.problem and (self.alive or bool(self.unseen()))

    def acknowledge(self, by: str) -> int:
        """Write down that `by` has seen all alarms there are; return how many were new."""
        keys = [row.key for row in self.unseen()]
        if keys:
            acknowledge(self.path, keys, by)
            self.read_seen()
        return len(keys)

    def title(self) -> str:
        """Return what it does: the campaign's title, or the procedure."""
        now = self.now or {}
        campaign, run = now.get("campaign") or {}, now.get("run") or {}
        return str(campaign.get("title") or run.get("procedure") or self.name)

    def _follow(self, folder: str) -> None:
        """Begin with another run's events when the session has gone on to it."""
        if folder == self._followed and self.run is not None:
            return
        self._followed = folder
        run = self._folder.within(folder) if folder else None
        if run != self.run:
            self.run, self._parsed = run, None
            self._events = EventTail(run / "events.jsonl") if run is not None else None
            self._watchdog = EventTail(run / WATCHDOG_FOLDER / "events.jsonl") if run is not None else None


def shown(line: Mapping[str, Any]) -> list[Any]:
    """Return a line of a log as the page takes it: time, kind, sentence."""
    time_s = line.get("time_s")
    return [
        time_s if isinstance(time_s, int | float) and abs(time_s) < 1e9 else None,
        str(line.get("kind", "")),
        sentence(event_of(line)),
    ]


def _seconds_since(utc: str) -> float:
    """Return how long ago a time stamp was; 0 for one that is not one."""
    try:
        then = datetime.fromisoformat(utc)
        then = then if then.tzinfo else then.replace(tzinfo=UTC)
        return max(0.0, epoch_seconds() - then.timestamp())
    except (ValueError, OverflowError):
        return 0.0
