"""The strip of all benches: what each one does and what nobody has acknowledged, on every page."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import quote

from bench.present.panel._folders import RunsFolder
from bench.present.panel._session import Session
from bench.present.panel._texts import ago
from drivers.base.clock import host_seconds

_EVERY_S = 1.0
_LOOK_EVERY_S = 2.0
_MOST = 24
"""Sessions that are looked at, the one written to last first."""
_ENDED_S, _ENDED_EVERY_S = 120.0, 10.0
"""A session without a process changes seldom: a watchdog ends its work, somebody acknowledges."""


class Benches:
    """Follows the newest sessions of a runs folder, once a second."""

    def __init__(self, folder: RunsFolder) -> None:
        self.sessions: list[Session] = []
        self.version = 0
        """Counts the readings."""
        self._folder = folder
        self._read_at: dict[str, float] = {}
        self._look_at = self._next_at = 0.0
        self._strip: tuple[int, list[dict[str, Any]]] = (-1, [])

    def update(self) -> None:
        """Read what is due."""
        now_s = host_seconds()
        if now_s < self._next_at:
            return
        self._next_at = now_s + _EVERY_S
        self.version += 1
        if now_s >= self._look_at:
            self._look_at = now_s + _LOOK_EVERY_S
            known = {session.path: session for session in self.sessions}
            paths = self._folder.sessions()[:_MOST]
            self.sessions = [known.get(path) or Session(self._folder, path) for path in paths]
        for session in self.sessions:
            every_s = _EVERY_S if session.alive or session.age_s < _ENDED_S else _ENDED_EVERY_S
            if now_s - self._read_at.get(session.name, -every_s) >= every_s - 0.01:
                self._read_at[session.name] = now_s
                session.update()

    def goes_on(self, run: Path) -> bool:
        """Return whether a living session is at that run."""
        return any(one.alive and one.run == run for one in self.sessions)

    def of_bench(self, session: Session) -> list[Session]:
        """Return the sessions of the same bench, that one first."""
        same = [one for one in self.sessions if one.path != session.path and _bench(one) == _bench(session)]
        return [session, *(same if session.bench else [])]

    def acknowledge(self, session: Session, by: str) -> int:
        """Write down that `by` has seen the alarms of a session and of earlier ones of its bench."""
        count = sum(one.acknowledge(by) for one in self.of_bench(session))
        for one in self.sessions:
            one.read_seen()
        self.version += 1
        return count

    def strip(self) -> list[dict[str, Any]]:
        """Return what a page shows of each bench: every session that goes on, else the newest one."""
        if self._strip[0] != self.version:
            self._strip = (self.version, self._made())
        return self._strip[1]

    def _made(self) -> list[dict[str, Any]]:
        groups: dict[tuple[str, bool], list[Session]] = {}
        for session in self.sessions:
            groups.setdefault(_bench(session), []).append(session)
        return [entry for _, group in sorted(groups.items()) for entry in self._entries(group)]

    def _entries(self, group: list[Session]) -> list[dict[str, Any]]:
        shown = [one for one in group if one.alive or one.problem] or group[:1]
        alarms = sum(len(one.unseen()) for one in group)
        entries = []
        for session in shown:
            head = session.banner()
            seen = head.tone == "bad" and not (session.alive or session.problem or session.unseen())
            entries.append(
                {
                    "name": session.bench or session.name,
                    "link": f"/?session={quote(session.name, safe='')}",
                    "session": session.name,
                    "word": head.word,
                    "tone": "plain" if seen else head.tone,
                    "what": session.title() + ("" if session.alive else f", {ago(session.age_s)} ago"),
                    "emulated": session.emulated,
                    "alarms": alarms if session is shown[0] else len(session.unseen()),
                }
            )
        return entries


def _bench(session: Session) -> tuple[str, bool]:
    return session.bench or session.name, session.emulated
