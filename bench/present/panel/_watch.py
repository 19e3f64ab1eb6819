"""What the panel knows of the session a page looks at: its live files read ten times a second, its curves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bench.control.instrument_station import column_words
from bench.present.panel._advice import MANUAL, NOT_HERE, nothing_yet
from bench.present.panel._benches import Benches
from bench.present.panel._folders import Entry, RunsFolder
from bench.present.panel._listing import listed
from bench.present.panel._noise import Noise
from bench.present.panel._series import MinMax, Row
from bench.present.panel._session import Session, shown
from bench.present.panel._tails import HistoryTail, PhaseTail, history_between
from bench.present.panel._texts import texts
from bench.present.panel._values import fresh, number_of, table_of
from drivers.base.clock import host_seconds

_BUCKETS = 480
_FINE = 800
"""Stretches of a window that somebody zoomed into."""
LEVELS = {"5 min": 300.0, "1 h": 3600.0, "run": 0.0}
"""Stretches that can be shown, in s; 0: the whole run."""
_LOOK_EVERY_S = 2.0
_LINES_SHOWN = 60
_FIRST_WIDTH_S = 1.0
_MISSED_S = 3.0
"""Time between two readings, s, from which something may have come between them."""
_MOST_S, _LARGEST = 3.2e7, 1e300


@dataclass(frozen=True)
class Column:
    """A curve: which plot it belongs to, its name and its unit."""

    key: str
    plot: str
    name: str
    unit: str


class Watch:
    """Follows one session: that of `name`, or of all, or those of `bench`, what needs somebody, else the newest.

    It stays with a session as long as its process lives, and with one that ended badly until somebody has said
    to have seen it or its bench has begun something else: no page goes from an alarm to another bench by itself.
    """

    def __init__(self, folder: RunsFolder, benches: Benches, name: str = "", bench: str = "") -> None:
        self.folder = folder
        self.benches = benches
        self.name = name
        self.bench = bench
        self.session: Session | None = None
        self.epoch = 0
        """Counts runs shown: a new one makes every page start over."""
        self.columns: tuple[Column, ...] = ()
        self.levels: dict[str, MinMax] = {}
        self._run: Path | None = None
        self._history: HistoryTail | None = None
        self._phases: PhaseTail | None = None
        self._noise: Noise | None = None
        self._look_at = self._updated_at = -math.inf
        self._newest_s = -math.inf
        self._entries: list[Entry] = []
        self._runs: list[dict[str, Any]] = []

    def update(self) -> None:
        """Read what has changed; costs a few small reads."""
        self.benches.update()
        if host_seconds() >= self._look_at:
            self._look_at = host_seconds() + _LOOK_EVERY_S
            self._choose()
            self._entries = self.folder.history()
            self._runs = [listed(entry, self.folder, self.benches) for entry in self._entries]
            if self._phases is not None:
                self._phases.update()
        if self.session is not None and self.session.update() and self.session.now is not None:
            self._follow(self.session.now)
            if host_seconds() - self._updated_at > _MISSED_S:
                self._catch_up(self.session.now)
            self._add(self.session.now)
        self._updated_at = host_seconds()
        if self._noise is not None and self.steerable:
            self._noise.update(self._newest_s)

    @property
    def now(self) -> dict[str, Any]:
        """The session's live state as read last, empty if there is none."""
        return (self.session.now if self.session is not None else None) or {}

    @property
    def prompts(self) -> list[dict[str, Any]]:
        """The open questions."""
        prompts: list[dict[str, Any]] = self.now.get("prompts") or [] if self.steerable else []
        return prompts

    @property
    def by_hand(self) -> bool:
        """Whether the run that goes on takes orders."""
        return self.steerable and (self.now.get("run") or {}).get("procedure") == MANUAL

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The parameters of the run, empty where its manifest cannot be read."""
        run = self.session.run if self.session is not None else None
        entry = self.folder.entry(run) if run is not None else None
        return {} if entry is None or entry.manifest is None else entry.manifest.parameters

    @property
    def steerable(self) -> bool:
        """Whether there is a process that would take a request."""
        return self.session is not None and self.session.alive

    def values(self) -> dict[str, str]:
        """Return every text of the page by its key."""
        if self.session is None:
            return texts(None, 0.0)
        return texts(self.session.now, self.session.age_s, self.session.read_back())

    def news(self) -> dict[str, Any]:
        """Return what changes seldom: benches, banner, log, alarms."""
        session = self.session
        if session is not None:
            head = session.banner()
        else:
            head = (
                NOT_HERE
                if self.name
                else nothing_yet(
                    str(self.folder.root), self.folder.root.is_dir(), bool(self.folder.queues), self.bench
                )
            )
        alarms = [asdict(row) for row in session.alarms()] if session is not None else []
        for earlier in self.benches.of_bench(session)[1:] if session is not None else ():
            alarms += [asdict(row) for row in earlier.unseen()]
        return {
            "banner": asdict(head),
            "benches": self.benches.strip(),
            "session": session.name if session is not None else "",
            "run": self._run_name(),
            "papers": self.folder.papers(session.path) if session is not None else [],
            "log": [shown(line) for line in (session.lines if session is not None else [])[-_LINES_SHOWN:]][
                ::-1
            ],
            "phases": self._phases.phases if self._phases is not None else [],
            "alarms": alarms,
            "gyros": sorted(self.now.get("gyros") or {}),
            "auxiliary": _auxiliary(self.now),
            "readings": [
                [f"{instrument}.{column}", f"{instrument}, {words}", unit]
                for instrument, row in (self.now.get("readings") or {}).items()
                for column in row
                for words, unit in (column_words(column),)
            ],
        }

    def _run_name(self) -> str:
        """Return the run's folder relative to the runs folder, empty without one."""
        run = self.session.run if self.session is not None else None
        return "" if run is None else str(run.relative_to(self.folder.root))

    def runs(self) -> list[dict[str, Any]]:
        """Return the newest runs as the page lists them."""
        return self._runs

    def noise(self) -> list[dict[str, Any]]:
        """Return the Allan deviations of the last hour, a gyro each."""
        return self._noise.curves if self._noise is not None else []

    def window(self, from_s: float, to_s: float) -> dict[str, Any]:
        """Return the curves of a stretch of the run that is shown, as fine as its history has them."""
        run, columns = self._run, self.columns
        if run is None or not 0.0 < to_s - from_s < 2.0 * _MOST_S:
            return {"epoch": self.epoch, "rows": []}
        fine = MinMax(len(columns), max((to_s - from_s) / _FINE, 0.05), 2 * _FINE, growing=False)
        for row in history_between(run, from_s, to_s):
            fine.add(row["time_s"], [number_of(value) for value in _of_history(row, *self._what(self.now))])
        return {"epoch": self.epoch, "rows": fine.rows()}

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
        """Take the session that was asked for, unless the one shown still lives or waits to be seen."""
        if self.name:
            path = self.folder.session(self.name)
        else:
            found = self.benches.foremost(self.bench)
            path = None if found is None else found.path
        shown = None if self.session is None else self.session.path
        if path in (None, shown) or self.steerable:
            return
        if shown is not None and self.benches.waits_to_be_seen(shown):
            return
        assert path is not None
        self.session = Session(self.folder, path)

    def _follow(self, now: Mapping[str, Any]) -> None:
        """Begin with another run's curves when the session has gone on to it."""
        assert self.session is not None
        folder = self.session.run
        gyros = tuple(sorted(now.get("gyros") or {}))
        columns = _columns(gyros, _auxiliary(now))
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
            self._phases = PhaseTail(folder) if folder is not None else None
            self._noise = Noise(folder) if folder is not None else None
            if self._phases is not None:
                self._phases.update()
            for row in self._history.update() if self._history is not None else ():
                self._take(row.get("time_s"), _of_history(row, *self._what(now)))

    def _catch_up(self, now: Mapping[str, Any]) -> None:
        """Take what came while nobody looked from the run's history, so that no straight line stands for it."""
        to_s = number_of(now.get("time_s"))
        if self._run is None or to_s is None or not math.isfinite(self._newest_s):
            return
        for row in history_between(self._run, self._newest_s, to_s):
            self._take(row["time_s"], _of_history(row, *self._what(now)))

    @staticmethod
    def _what(now: Mapping[str, Any]) -> tuple[tuple[str, ...], list[str]]:
        """Return the gyros and the numbers of auxiliary sensors of a run."""
        return tuple(sorted(now.get("gyros") or {})), [number for number, _ in _auxiliary(now)]

    def _add(self, now: Mapping[str, Any]) -> None:
        """Add the values of now; one that is old is none, so that a curve ends where nothing came."""
        chamber, table = fresh(now.get("chamber")), fresh(now.get("table"))
        values = [chamber.get("air_temp_c"), chamber.get("set_point_c"), table.get("rate_dps")]
        for name in sorted(now.get("gyros") or {}):
            gyro = fresh(now["gyros"][name])
            values += [gyro.get("latest_dps"), gyro.get("temp_c")]
        values += [(chamber.get("auxiliary_c") or {}).get(number) for number, _ in _auxiliary(now)]
        self._take(now.get("time_s"), values)

    def _take(self, time_s: object, values: list[Any]) -> None:
        """Add a row; now.json that says the same time again adds nothing."""
        time_s = number_of(time_s)
        if time_s is None or time_s <= self._newest_s or abs(time_s) > _MOST_S:
            return
        self._newest_s = time_s
        numbers = [number_of(value) for value in values]
        for level in self.levels.values():
            level.add(time_s, numbers)


def _auxiliary(now: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return number and name of the chamber's auxiliary sensors."""
    names = (now.get("run") or {}).get("auxiliary") or {}
    there = (now.get("chamber") or {}).get("auxiliary_c") or {}
    return [(number, str(names.get(number) or f"sensor {number}")) for number in sorted({*names, *there})]


def _columns(gyros: tuple[str, ...], auxiliary: list[tuple[str, str]]) -> tuple[Column, ...]:
    columns = [
        Column("air", "temperature", "air", "°C"),
        Column("set", "temperature", "set point", "°C"),
        Column("table", "table", "table rate", "°/s"),
    ]
    for name in gyros:
        columns.append(Column(f"{name}.rate", "gyro", name, "°/s"))
        columns.append(Column(f"{name}.temp", "temperature", f"{name} inside", "°C"))
    columns += [Column(f"aux.{number}", "temperature", name, "°C") for number, name in auxiliary]
    return tuple(columns)


def _of_history(row: Mapping[str, Any], gyros: tuple[str, ...], auxiliary: list[str]) -> list[Any]:
    values = [row.get("air_temp_c"), row.get("set_point_c"), row.get("rate_dps")]
    of_gyros = table_of(row.get("gyros"))
    for name in gyros:
        pair = of_gyros.get(name)
        values += list(pair[:2]) if isinstance(pair, list) and len(pair) >= 2 else [None, None]
    cases = table_of(row.get("auxiliary_c"))
    return values + [cases.get(number) for number in auxiliary]
