"""The strip of all benches: what each one does and what nobody has acknowledged, on every page."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

from bench.present.panel._folders import QueueLink, RunsFolder
from bench.present.panel._session import Session
from bench.present.panel._texts import ago
from drivers.base.clock import host_seconds

_EVERY_S = 1.0
_LOOK_EVERY_S = 2.0
_MOST = 24
"""Sessions that are followed, the one written to last first."""
_FAR, _AT_ONCE = 2000, 40
"""Older ones that are looked at once, and how many at a time: a bench in danger stays until that was seen."""
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
        self._passed: set[Path] = set()
        """Older sessions that nobody needs to see."""
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
            paths = self._folder.sessions()
            newest = [known.get(path) or self._read(path) for path in paths[:_MOST]]
            self.sessions = [*newest, *self._older(paths[_MOST:_FAR], known, newest)]
        for session in self.sessions:
            every_s = _EVERY_S if session.alive or session.age_s < _ENDED_S else _ENDED_EVERY_S
            if now_s - self._read_at.get(session.name, -every_s) >= every_s - 0.01:
                self._read_at[session.name] = now_s
                session.update()

    def _read(self, path: Path) -> Session:
        session = Session(self._folder, path)
        session.update()
        return session

    def _older(
        self, paths: list[Path], known: dict[Path, Session], newest: list[Session]
    ) -> Iterator[Session]:
        """Yield the older sessions that still say something: unseen alarms, or the last word of their bench."""
        benches = {session.bench for session in newest}
        fresh = 0
        for path in paths:
            session = known.get(path)
            if session is None:
                if path in self._passed or fresh == _AT_ONCE:
                    continue
                fresh += 1
                session = self._read(path)
            alone = bool(session.bench) and session.bench not in benches and not session.emulated
            if session.needs_somebody or alone:
                benches.add(session.bench)
                yield session
            else:
                self._passed.add(path)

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

    def foremost(self, bench: str = "") -> Session | None:
        """Return the session that a page shows which asks for none, or for a bench: what needs somebody, else the
        newest.
        """
        there = [one for group in self.groups().values() for one in self._shown(group)]
        there = [one for one in there if not bench or one.bench == bench]
        there.sort(key=self.sessions.index)
        there.sort(key=lambda one: (not one.needs_somebody, not one.alive))
        return next(iter(there), None)

    def waits_to_be_seen(self, path: Path) -> bool:
        """Return whether that session is the newest of its bench and ended badly, unseen: pages stay with it."""
        there = [one for group in self.groups().values() for one in self._shown(group)]
        return any(one.path == path and one.needs_somebody for one in there)

    def link(self, session: Session) -> str:
        """Return the address of the page that follows a session's bench, from session to session.

        Of the session itself where its bench has no name, or another session of that name goes on.
        """
        others = [one for one in self.sessions if one.bench == session.bench and one.path != session.path]
        if session.bench and not any(one.alive or one.problem for one in others) and not session.problem:
            return f"/?bench={quote(session.bench, safe='')}"
        return f"/?session={quote(session.name, safe='')}"

    def strip(self) -> list[dict[str, Any]]:
        """Return what a page shows of each bench: every session that goes on, else the newest one."""
        if self._strip[0] != self.version:
            self._strip = (self.version, self._made())
        return self._strip[1]

    def groups(self) -> dict[tuple[str, bool], list[Session]]:
        """Return the sessions of each bench, newest first."""
        groups: dict[tuple[str, bool], list[Session]] = {}
        for session in self.sessions:
            groups.setdefault(_bench(session), []).append(session)
        return groups

    @staticmethod
    def _shown(group: list[Session]) -> list[Session]:
        """Return which of a bench's sessions say how it is: those that go on, else the newest."""
        return [one for one in group if one.alive or one.problem] or group[:1]

    def _made(self) -> list[dict[str, Any]]:
        entries = {bench: self._entries(group) for bench, group in self.groups().items()}
        names = {entry["name"] for shown in entries.values() for entry in shown}
        for name, queue in self._folder.queues.items():
            if name not in names:
                entries[name, queue.emulated] = [_idle(name, queue)]
        return [entry for _, shown in sorted(entries.items()) for entry in shown]

    def _entries(self, group: list[Session]) -> list[dict[str, Any]]:
        shown = self._shown(group)
        alarms = sum(len(one.unseen()) for one in group)
        entries = []
        for session in shown:
            head = session.banner()
            seen = head.tone == "bad" and not (session.alive or session.problem or session.unseen())
            entries.append(
                {
                    "name": session.bench or session.name,
                    "link": self.link(session),
                    "session": session.name,
                    "word": head.word,
                    "tone": "plain" if seen else head.tone,
                    "what": session.title() + ("" if session.alive else f", {ago(session.age_s)} ago"),
                    "queue": self._waits(session),
                    "emulated": session.emulated,
                    "alarms": alarms if session is shown[0] else len(session.unseen()),
                }
            )
        return entries

    def _waits(self, session: Session) -> str:
        queue = self._folder.queues.get(session.bench)
        return queue.waits if queue is not None and queue.emulated == session.emulated else ""


def _idle(name: str, queue: QueueLink) -> dict[str, Any]:
    """Return a bench without a session: nothing of it was live lately."""
    idle = {"session": "", "word": "Idle", "tone": "plain", "what": "nothing goes on", "alarms": 0}
    return idle | {"name": name, "link": queue.address, "queue": queue.waits, "emulated": queue.emulated}


def _bench(session: Session) -> tuple[str, bool]:
    return session.bench or session.name, session.emulated
