"""What the panel knows of the session it shows: read from the live files, kept in bounded memory."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from bench.control.live import read_now
from bench.present.panel._advice import NOT_HERE, banner
from bench.present.panel._folders import NOW, Entry, RunsFolder
from bench.present.panel._series import MinMax, Row
from bench.present.panel._tails import EventTail, HistoryTail
from bench.present.panel._texts import texts
from bench.present.sentences import event_of, sentence
from drivers.base.clock import epoch_seconds, host_seconds
from drivers.base.errors import BenchError

_BUCKETS = 480
LEVELS = {"5 min": 300.0, "1 h": 3600.0, "run": 0.0}
"""Stretches that can be shown, in s; 0: the whole run."""
_LOOK_EVERY_S = 2.0
_LATELY_S = 60.0
_SESSIONS = 12
_LINES_SHOWN = 60
_FIRST_WIDTH_S = 1.0


@dataclass(frozen=True)
class Session:
    """A session that is at work: `name` is its folder's relative to the runs folder, `text` says what it does."""

    name: str
    text: str


@dataclass(frozen=True)
class Column:
    """A curve: which plot it belongs to, its name and its unit."""

    key: str
    plot: str
    name: str
    unit: str


class Watch:
    """Follows one session: that of `name` if one is given, else the one that runs or the last one that did.

    It stays with a session as long as its process lives; `others` are those at work beside it.
    """

    def __init__(self, folder: RunsFolder, name: str = "") -> None:
        self.folder = folder
        self.name = name
        self.others: list[Session] = []
        self.session: Path | None = None
        self.now: dict[str, Any] | None = None
        self.problem = ""
        self.epoch = 0
        """Counts runs shown: a new one makes every page start over."""
        self.columns: tuple[Column, ...] = ()
        self.levels: dict[str, MinMax] = {}
        self._run: Path | None = None
        self._events: EventTail | None = None
        self._history: HistoryTail | None = None
        self._changed_at = host_seconds()
        self._stamp = ""
        self._look_at = -math.inf
        self._newest_s = -math.inf
        self.entries: list[Entry] = []

    def update(self) -> None:
        """Read what has changed; costs a few small reads."""
        if host_seconds() >= self._look_at:
            self._look_at = host_seconds() + _LOOK_EVERY_S
            self._choose()
            self.entries = self.folder.history()
        if self.session is None:
            return
        self._read()
        if self._events is not None:
            self._events.update()

    @property
    def age_s(self) -> float:
        """For how long now.json has not changed, in host seconds since the panel looks."""
        return host_seconds() - self._changed_at

    @property
    def prompts(self) -> list[dict[str, Any]]:
        """The open questions."""
        now = self.now or {}
        prompts = now.get("prompts") if now.get("alive") else None
        return [p for p in prompts or [] if isinstance(p, dict) and isinstance(p.get("id"), int)]

    @property
    def steerable(self) -> bool:
        """Whether there is a process that would take a request."""
        return bool(self.now and self.now.get("alive"))

    def values(self) -> dict[str, str]:
        """Return every text of the page by its key."""
        return texts(self.now, self.age_s)

    def news(self) -> dict[str, Any]:
        """Return what changes seldom: banner, log, alarms."""
        lines = list(self._events.lines) if self._events is not None else []
        now = self.now or {}
        head = banner(self.now, [event_of(line) for line in lines], self.age_s if self.steerable else 0.0)
        if self.name and self.session is None:
            head = NOT_HERE
        return {
            "banner": asdict(head),
            "log": [_shown(line) for line in lines[-_LINES_SHOWN:]][::-1],
            "alarms": [_shown(line) for line in now.get("alarms") or ()][::-1],
            "gyros": sorted(now.get("gyros") or {}),
            "auxiliary": sorted((now.get("chamber") or {}).get("auxiliary_c") or {}),
            "problem": self.problem,
        }

    def snapshot(self) -> dict[str, Any]:
        """Return all curves, for a page that opens."""
        return {
            "epoch": self.epoch,
            "columns": [vars(column) for column in self.columns],
            "levels": {
                name: {"version": level.version, "span_s": LEVELS[name], "rows": level.rows()}
                for name, level in self.levels.items()
            },
            "capacity": _BUCKETS,
        }

    def tails(self) -> dict[str, list[Row]]:
        """Return of every level the rows that the last updates may have changed."""
        return {name: level.rows(len(level) - 2) for name, level in self.levels.items()}

    def versions(self) -> tuple[int, ...]:
        """Return what must not change for `tails` to be enough."""
        return (self.epoch, *(level.version for level in self.levels.values()))

    def _choose(self) -> None:
        """Take the session written to last, unless the one shown still lives or one was asked for by name."""
        folders = self.folder.sessions()
        if self.name:
            named = self.folder.session(self.name)
            folders = [named] if named is not None else []
        if folders and folders[0] != self.session and not (self.session is not None and self.steerable):
            self.session, self._stamp = folders[0], ""
        self.others = self._at_work()

    def _at_work(self) -> list[Session]:
        """Return the sessions beside the one shown whose process lives and has written lately."""
        lately_ns = (epoch_seconds() - _LATELY_S) * 1e9
        sessions = []
        for folder in self.folder.sessions()[:_SESSIONS]:
            with suppress(BenchError, OSError):
                if folder == self.session or (folder / NOW).stat().st_mtime_ns < lately_ns:
                    continue
                now = read_now(folder)
                if now is not None and now["alive"] and now.get("state") != "ended":
                    name = str(folder.relative_to(self.folder.root))
                    sessions.append(Session(name, _what(now, name)))
        return sorted(sessions, key=lambda session: session.name)

    def _read(self) -> None:
        assert self.session is not None
        try:
            now = read_now(self.session)
            self.problem = ""
        except BenchError as error:
            self.problem = str(error)
            return
        if now is None:
            self.session = self.now = None
            return
        if now["utc"] != self._stamp:
            if self._stamp:
                self._changed_at = host_seconds()
            else:
                self._changed_at = host_seconds() - _seconds_since(str(now["utc"]))
            self._stamp = str(now["utc"])
        elif now == self.now:
            return
        self.now = now
        self._follow(now)
        self._add(now)

    def _follow(self, now: Mapping[str, Any]) -> None:
        """Begin with another run's files when the session has gone on to it."""
        run = now.get("run") or {}
        folder = self.folder.within(run.get("folder", "")) if run.get("folder") else None
        gyros = tuple(sorted(now.get("gyros") or {}))
        columns = _columns(gyros)
        if folder != self._run or (self.columns != columns and gyros):
            self._run = folder
            self.epoch += 1
            self.columns = columns
            self.levels = {
                name: MinMax(
                    len(columns), span_s / _BUCKETS or _FIRST_WIDTH_S, _BUCKETS, growing=span_s == 0.0
                )
                for name, span_s in LEVELS.items()
            }
            self._newest_s = -math.inf
            self._history = HistoryTail(folder) if folder is not None else None
            self._events = EventTail(folder / "events.jsonl") if folder is not None else None
            for row in self._history.update() if self._history is not None else ():
                self._take(row.get("time_s"), _of_history(row, gyros))

    def _add(self, now: Mapping[str, Any]) -> None:
        gyros = tuple(sorted(now.get("gyros") or {}))
        chamber, table = now.get("chamber") or {}, now.get("table") or {}
        values = [chamber.get("air_temp_c"), chamber.get("set_point_c"), table.get("rate_dps")]
        for name in gyros:
            gyro = now["gyros"][name]
            values += [gyro.get("latest_dps"), gyro.get("temp_c")]
        self._take(now.get("time_s"), values)

    def _take(self, time_s: object, values: list[Any]) -> None:
        """Add a row; now.json that says the same time again adds nothing."""
        if not isinstance(time_s, int | float) or time_s <= self._newest_s:
            return
        self._newest_s = float(time_s)
        numbers = [float(v) if isinstance(v, int | float) else None for v in values]
        for level in self.levels.values():
            level.add(float(time_s), numbers)


def _what(now: Mapping[str, Any], name: str) -> str:
    """Return what a session does: the campaign's title, or the run by its name and procedure, and its units."""
    campaign, run = now.get("campaign") or {}, now.get("run") or {}
    units = ", ".join(str(unit) for unit in (run.get("units") or {}).values())
    what = str(campaign.get("title") or run.get("procedure") or name)
    if not campaign and what not in str(run.get("run_id") or what):
        what = f"{run['run_id']}, {what}"
    asking = ", waits for an answer" if now.get("prompts") else ""
    return f"{what} ({units or name}){asking}"


def _columns(gyros: tuple[str, ...]) -> tuple[Column, ...]:
    fixed = (
        Column("air", "temperature", "air", "°C"),
        Column("set", "temperature", "set point", "°C"),
        Column("table", "table", "table rate", "°/s"),
    )
    return fixed + tuple(
        column
        for name in gyros
        for column in (
            Column(f"{name}.rate", "gyro", name, "°/s"),
            Column(f"{name}.temp", "temperature", f"{name} inside", "°C"),
        )
    )


def _of_history(row: Mapping[str, Any], gyros: tuple[str, ...]) -> list[Any]:
    values = [row.get("air_temp_c"), row.get("set_point_c"), row.get("rate_dps")]
    for name in gyros:
        pair = (row.get("gyros") or {}).get(name)
        values += list(pair[:2]) if isinstance(pair, list) and len(pair) >= 2 else [None, None]
    return values


def _shown(line: Mapping[str, Any]) -> list[Any]:
    time_s = line.get("time_s")
    return [
        time_s if isinstance(time_s, int | float) else None,
        str(line.get("kind", "")),
        sentence(event_of(line)),
    ]


def _seconds_since(utc: str) -> float:
    """Return how long ago a time stamp was; 0 for one that is not one."""
    try:
        return max(0.0, epoch_seconds() - datetime.fromisoformat(utc).timestamp())
    except ValueError:
        return 0.0
