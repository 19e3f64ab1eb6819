"""The catalogue of runs: a table of what lies in run folders, in SQLite or PostgreSQL; the folders are the truth.

What a run is does not change once it is closed: a list asks the disk only whether runs came or went (the folder's
own time stamp says so) and whether those that were going on have ended. `rebuild` reads every folder again.
"""

from __future__ import annotations

import calendar
import datetime
import json
import os
import re
import socket
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import Connection, Engine

from bench.recording import MANIFEST_FILE
from drivers.clock import epoch_seconds
from drivers.errors import ConfigurationError, RecordError
from drivers.files import RECORD_BYTES, parse_json, read_bounded

FOLDER = ".catalogue"
"""Beside the runs, in a folder of its own: SQLite's journal must not touch the time stamp of the runs' folder."""

_AT_ONCE = 2000
_SETTLED_S = 3.0
"""A folder changed later than this before it was read may change again within one tick of its time stamp."""
_PERIOD = re.compile(r"^(\d{4})(?:-(\d{2})(?:-(\d{2})(?:[T ](\d{2}):(\d{2})(?::(\d{2}))?)?)?)?$")

_META = sa.MetaData()
_RUNS = sa.Table(
    "gyrobench_runs",
    _META,
    sa.Column("root", sa.Text, primary_key=True),
    sa.Column("name", sa.Text, primary_key=True),
    sa.Column("run_id", sa.Text, nullable=False),
    sa.Column("procedure", sa.Text, nullable=False, index=True),
    sa.Column("bench", sa.Text, nullable=False),
    sa.Column("outcome", sa.Text, nullable=False),
    sa.Column("reason", sa.Text, nullable=False),
    sa.Column("started_s", sa.Double, nullable=False, index=True),
    sa.Column("duration_s", sa.Double),
    sa.Column("units", sa.Text, nullable=False),
)
_UNITS = sa.Table(
    "gyrobench_run_units",
    _META,
    sa.Column("unit", sa.Text, primary_key=True),
    sa.Column("root", sa.Text, primary_key=True),
    sa.Column("name", sa.Text, primary_key=True),
)
_ROOTS = sa.Table(
    "gyrobench_roots",
    _META,
    sa.Column("root", sa.Text, primary_key=True),
    sa.Column("changed_ns", sa.BigInteger, nullable=False),
)


@dataclass(frozen=True)
class CatalogueRow:
    """A run in a list; outcome "unreadable" with `reason` for a folder whose manifest cannot be read.

    `root`: host and folder that it lies in. `started_s`: seconds since 1970-01-01 UTC.
    """

    root: str
    name: str
    run_id: str
    procedure: str
    bench: str
    outcome: str
    reason: str
    started_s: float
    duration_s: float | None
    units: tuple[str, ...]


class Catalogue:
    """A catalogue behind an SQLAlchemy URL; use as a context manager."""

    def __init__(self, url: str) -> None:
        """Open, and make the tables where there are none. Raises ConfigurationError, RecordError."""
        try:
            self._engine: Engine = sa.create_engine(url)
        except (sa.exc.ArgumentError, sa.exc.NoSuchModuleError, ImportError) as error:
            raise ConfigurationError(
                "the catalogue's URL cannot be used",
                found=f"{_without_password(url)}: {error}",
                expected="sqlite:///FILE or postgresql+psycopg://USER@HOST/DATABASE (extra 'postgres')",
            ) from error
        with self._told():
            _META.create_all(self._engine)

    @classmethod
    def beside(cls, runs: Path) -> Catalogue:
        """Open the SQLite catalogue of a folder of runs; RecordError if it cannot be written there."""
        folder = runs / FOLDER
        try:
            folder.mkdir(exist_ok=True)
        except OSError as error:
            raise RecordError(
                "there is no place for the catalogue of these runs",
                where=str(folder),
                found=error.strerror or str(error),
                expected="a folder of runs that can be written",
                remedy="check --runs, or keep the catalogue elsewhere with --catalogue sqlite:///FILE",
            ) from error
        return cls(f"sqlite:///{folder.absolute() / 'runs.sqlite'}")

    def update(self, runs: Path, progress: Callable[[int, int], None] | None = None) -> int:
        """Take in what came, went or ended below `runs`; return how many manifests were read.

        `progress` is called with (read, all of them).
        """
        root = root_name(runs)
        changed_ns = _changed_ns(runs)
        with self._told(), self._engine.begin() as connection:
            seen = connection.scalar(sa.select(_ROOTS.c.changed_ns).where(_ROOTS.c.root == root))
            going_on = self._names(connection, root, _RUNS.c.outcome == "running")
            if seen == changed_ns:
                gone, new = set[str](), going_on
            else:
                there = _run_names(runs)
                kept = self._names(connection, root)
                gone, new = kept - there, (there - kept) | (going_on & there)
            self._remove(connection, root, gone)
            self._read(connection, runs, root, sorted(new), progress)
            if seen != changed_ns:
                settled = epoch_seconds() - changed_ns * 1e-9 > _SETTLED_S
                self._remember(connection, root, changed_ns if settled else -1)
        return len(new)

    def rebuild(self, runs: Path, progress: Callable[[int, int], None] | None = None) -> int:
        """Forget what is known of the runs below `runs` and read them all again; return how many there are."""
        root = root_name(runs)
        with self._told(), self._engine.begin() as connection:
            for table in (_UNITS, _RUNS, _ROOTS):
                connection.execute(sa.delete(table).where(table.c.root == root))
        return self.update(runs, progress)

    def find(
        self,
        *,
        root: str | None = None,
        unit: str | None = None,
        procedure: str | None = None,
        outcome: str | None = None,
        since: str | None = None,
        until: str | None = None,
        limit: int = 100,
    ) -> tuple[list[CatalogueRow], int]:
        """Return the newest `limit` runs that fit, newest first, and how many fit.

        `since` and `until` are years, months, days or times in UTC ("2026", "2026-10", "2026-10-05",
        "2026-10-05T08:30"), both included whole. ConfigurationError for a period that is none.
        """
        wanted: list[sa.ColumnElement[bool]] = []
        if root is not None:
            wanted.append(_RUNS.c.root == root)
        if procedure is not None:
            wanted.append(_RUNS.c.procedure == procedure)
        if outcome is not None:
            wanted.append(_RUNS.c.outcome == outcome)
        if since is not None:
            wanted.append(_RUNS.c.started_s >= period_s(since)[0])
        if until is not None:
            wanted.append(_RUNS.c.started_s < period_s(until)[1])
        source: sa.FromClause = _RUNS
        if unit is not None:
            same = (_UNITS.c.root == _RUNS.c.root) & (_UNITS.c.name == _RUNS.c.name)
            source = _RUNS.join(_UNITS, same)
            wanted.append(_UNITS.c.unit == unit)
        newest = (
            sa.select(*_RUNS.c)
            .select_from(source)
            .where(*wanted)
            .order_by(_RUNS.c.started_s.desc(), _RUNS.c.name.desc())
            .limit(limit)
        )
        with self._told(), self._engine.connect() as connection:
            rows = [_row(row) for row in connection.execute(newest)]
            count = len(rows)
            if count == limit:
                counting = sa.select(sa.func.count()).select_from(source).where(*wanted)
                count = int(connection.scalar(counting) or 0)
        return rows, count

    def close(self) -> None:
        """Let go of the database."""
        self._engine.dispose()

    def __enter__(self) -> Catalogue:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _names(self, connection: Connection, root: str, *wanted: sa.ColumnElement[bool]) -> set[str]:
        found = connection.scalars(sa.select(_RUNS.c.name).where(_RUNS.c.root == root, *wanted))
        return set(found)

    def _remove(self, connection: Connection, root: str, names: Iterable[str]) -> None:
        for some in _portions(names):
            for table in (_UNITS, _RUNS):
                connection.execute(sa.delete(table).where(table.c.root == root, table.c.name.in_(some)))

    def _read(
        self,
        connection: Connection,
        runs: Path,
        root: str,
        names: Sequence[str],
        progress: Callable[[int, int], None] | None,
    ) -> None:
        done = 0
        for some in _portions(names):
            rows = [read_row(runs / name, root) for name in some]
            units = [
                {"unit": unit, "root": root, "name": row["name"]} for row, found in rows for unit in found
            ]
            self._remove(connection, root, some)
            self._insert(connection, _RUNS, [row for row, _ in rows])
            self._insert(connection, _UNITS, units)
            done += len(some)
            if progress is not None:
                progress(done, len(names))

    def _remember(self, connection: Connection, root: str, changed_ns: int) -> None:
        connection.execute(sa.delete(_ROOTS).where(_ROOTS.c.root == root))
        self._insert(connection, _ROOTS, [{"root": root, "changed_ns": changed_ns}])

    def _insert(self, connection: Connection, table: sa.Table, rows: Sequence[dict[str, Any]]) -> None:
        """Insert rows; one that somebody else has inserted meanwhile stays."""
        if not rows:
            return
        insert = postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert
        connection.execute(insert(table).on_conflict_do_nothing(), list(rows))

    @contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except sa.exc.SQLAlchemyError as error:
            raise RecordError(
                "the catalogue of runs cannot be used",
                where=_without_password(str(self._engine.url)),
                found=str(getattr(error, "orig", None) or error).splitlines()[0],
                remedy="run folders are not affected: `gyrobench runs index --rebuild` makes it anew from them",
            ) from error


def root_name(runs: Path) -> str:
    """Return the name under which a folder of runs is known: host and absolute path."""
    return f"{socket.gethostname()}:{runs.resolve()}"


def period_s(text: str) -> tuple[float, float]:
    """Return start and end of a year, month, day, minute or second in UTC, s since 1970; ConfigurationError."""
    match = _PERIOD.match(text.strip().removesuffix("Z"))
    given = [int(part) for part in match.groups() if part is not None] if match else []
    try:
        start = datetime.datetime(*[*given, *[1, 1][len(given) - 1 :]], tzinfo=datetime.UTC)  # type: ignore[misc,arg-type]
    except (ValueError, TypeError, IndexError) as error:
        raise ConfigurationError(
            "no date", found=text, expected="such as 2026, 2026-10, 2026-10-05 or 2026-10-05T08:30 (UTC)"
        ) from error
    if len(given) == 1:
        days = 366 if calendar.isleap(start.year) else 365
    elif len(given) == 2:
        days = calendar.monthrange(start.year, start.month)[1]
    else:
        days = 1
    length_s = 86_400.0 * days if len(given) <= 3 else 60.0 if len(given) == 5 else 1.0
    return start.timestamp(), start.timestamp() + length_s


def read_row(folder: Path, root: str) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return a run folder as a row of the catalogue, and its units; what cannot be read says why."""
    row: dict[str, Any] = {
        "root": root,
        "name": folder.name,
        "run_id": folder.name,
        "procedure": "",
        "bench": "",
        "outcome": "unreadable",
        "reason": "",
        "started_s": 0.0,
        "duration_s": None,
        "units": "[]",
    }
    try:
        manifest = parse_json(read_bounded(folder / MANIFEST_FILE, RECORD_BYTES))
        units = tuple(dict.fromkeys(str(unit) for unit in manifest.get("units", {}).values()))
        started = datetime.datetime.fromisoformat(str(manifest["started_utc"]))
        started = started if started.tzinfo else started.replace(tzinfo=datetime.UTC)
        bench = manifest.get("bench", {}).get("bench", {})
        duration = manifest.get("duration_s")
        row |= {
            "run_id": str(manifest["run_id"]),
            "procedure": str(manifest["procedure"]),
            "bench": str(bench.get("name", "")),
            "reason": str(manifest.get("reason", "")),
            "started_s": started.timestamp(),
            "duration_s": None if duration is None else float(duration),
            "units": json.dumps(units, ensure_ascii=False),
            "outcome": str(manifest["outcome"]),
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        return row | {"reason": f"{MANIFEST_FILE}: {type(error).__name__}: {error}"}, ()
    return row, units


def _row(row: sa.Row[Any]) -> CatalogueRow:
    return CatalogueRow(**{**row._mapping, "units": tuple(json.loads(row.units))})  # noqa: SLF001  (its public name)


def _run_names(runs: Path) -> set[str]:
    """Return the folders below `runs` that hold a manifest."""
    with os.scandir(runs) as entries:
        folders = [entry.name for entry in entries if not entry.name.startswith(".") and entry.is_dir()]
    return {name for name in folders if os.access(f"{runs}/{name}/{MANIFEST_FILE}", os.F_OK)}


def _changed_ns(runs: Path) -> int:
    try:
        return runs.stat().st_mtime_ns
    except OSError as error:
        raise RecordError(
            "there is no such folder of runs",
            where=str(runs),
            found=error.strerror or str(error),
            remedy="see --runs",
        ) from error


def _portions(names: Iterable[str]) -> Iterator[list[str]]:
    """Yield the names in lists that a statement can take."""
    rest = iter(names)
    while some := list(islice(rest, _AT_ONCE)):
        yield some


def _without_password(url: str) -> str:
    return re.sub(r"(://[^:/@]*):[^@]*@", r"\1:***@", url)
