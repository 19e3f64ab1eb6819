"""The catalogue of runs: a table of what lies in run folders, in SQLite or PostgreSQL; the folders are the truth.

What a run is does not change once it is closed: a list asks the disk only whether runs came or went (the folder's
own time stamp says so) and whether those that were going on have ended. `rebuild` reads every folder again.

Where thousands came since, a list takes them in from the manifest that was written last on, and stops where
no other can be of a run that it shows: no run starts after its manifest was written.
"""

from __future__ import annotations

import calendar
import datetime
import json
import math
import os
import re
import socket
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from bench.record.catalogue._database import Database
from bench.record.run_folder import MANIFEST_FILE, url_of
from drivers.base.clock import epoch_seconds
from drivers.base.errors import ConfigurationError, RecordError
from drivers.base.files import MANIFEST_BYTES, parse_json, read_bounded

FOLDER = ".catalogue"
"""Beside the runs, in a folder of its own: SQLite's journal must not touch the time stamp of the runs' folder."""

_AT_ONCE = 2000
_SETTLED_S = 3.0
"""A folder changed later than this before it was read may change again within one tick of its time stamp."""
_CLOCKS_S = 86_400.0
"""So much later than its manifest was written a run may say that it started: clocks differ."""
_NO_STAMP_S = 946_684_800.0
"""2000-01-01 UTC. What was written before has lost its time stamp: archives write zeros."""
_PERIOD = re.compile(r"^(\d{4})(?:-(\d{2})(?:-(\d{2})(?:[T ](\d{2}):(\d{2})(?::(\d{2}))?)?)?)?$")
_TABLES = (
    """CREATE TABLE IF NOT EXISTS gyrobench_runs (
        root TEXT NOT NULL, name TEXT NOT NULL, run_id TEXT NOT NULL, procedure TEXT NOT NULL,
        bench TEXT NOT NULL, outcome TEXT NOT NULL, reason TEXT NOT NULL, started_s DOUBLE PRECISION NOT NULL,
        duration_s DOUBLE PRECISION, units TEXT NOT NULL, PRIMARY KEY (root, name))""",
    "CREATE INDEX IF NOT EXISTS ix_gyrobench_runs_procedure ON gyrobench_runs (procedure)",
    "CREATE INDEX IF NOT EXISTS ix_gyrobench_runs_outcome ON gyrobench_runs (root, outcome)",
    "CREATE INDEX IF NOT EXISTS ix_gyrobench_runs_started_s ON gyrobench_runs (started_s)",
    """CREATE TABLE IF NOT EXISTS gyrobench_run_units (
        unit TEXT NOT NULL, root TEXT NOT NULL, name TEXT NOT NULL, PRIMARY KEY (unit, root, name))""",
    "CREATE INDEX IF NOT EXISTS ix_gyrobench_run_units_run ON gyrobench_run_units (root, name)",
    """CREATE TABLE IF NOT EXISTS gyrobench_roots (
        root TEXT NOT NULL PRIMARY KEY, changed_ns BIGINT NOT NULL)""",
)
_LOCK = "SELECT pg_advisory_xact_lock(7031862)"
"""PostgreSQL: two benches that make the same tables at the same moment take turns."""
ReadProgress = Callable[[int, int], None]
"""Called with how many manifests have been read, and how many there are to read."""


@dataclass(frozen=True)
class CatalogueRow:
    """A run in a list; outcome "unreadable" with `reason` for a folder whose manifest cannot be read.

    `root`: host and folder that it lies in. `started_s`: seconds since 1970-01-01 UTC.
    """

    root: str
    name: str
    run_id: str
    procedure: str = ""
    bench: str = ""
    outcome: str = "unreadable"
    reason: str = ""
    started_s: float = 0.0
    duration_s: float | None = None
    units: tuple[str, ...] = ()


COLUMNS = tuple(field.name for field in fields(CatalogueRow))
"""Of the table of runs, too."""


def root_name(runs: Path) -> str:
    """Return the name under which a folder of runs is known: host and absolute path."""
    return f"{socket.gethostname()}:{runs.resolve()}"


class Catalogue:
    """A catalogue behind a URL, sqlite:///FILE or postgresql://...; use as a context manager."""

    def __init__(self, url: str) -> None:
        """Open, and make the tables where there are none. Raises ConfigurationError, RecordError."""
        self._database = Database(url)
        try:
            with self._database.transaction():
                for statement in (_LOCK, *_TABLES) if self._database.postgresql else _TABLES:
                    self._database.make(statement)
        except BaseException:
            self._database.close()
            raise

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
                remedy="check the folder, or keep the catalogue elsewhere with --catalogue sqlite:///FILE",
            ) from error
        return cls(f"sqlite:///{folder.absolute() / 'runs.sqlite'}")

    def update(self, runs: Path, progress: ReadProgress | None = None) -> int:
        """Take in what came, went or ended below `runs`; return how many manifests were read.

        What was read before an interruption stays.
        """
        return self._take_in(runs, progress, lambda written_s: False)[0]

    def update_for(
        self, runs: Path, progress: ReadProgress | None = None, *, limit: int, **wanted: str | None
    ) -> int:
        """Take in what `find` needs for the same wishes; return how many runs that may fit are left unread.

        They started before those that `find` returns. Where a run says that it started after its manifest was
        written, the time stamps are those of a copy, and every manifest is read.
        """
        since = wanted.get("since")
        since_s = -math.inf if since is None else period_s(since)[0]

        def enough(written_s: float) -> bool:
            if written_s + _CLOCKS_S < since_s:
                return True
            rows, _ = self.find(limit=limit, **wanted)
            return len(rows) == limit and rows[-1].started_s > written_s + _CLOCKS_S

        _, left_s = self._take_in(runs, progress, enough)
        return sum(written_s + _CLOCKS_S >= since_s for written_s in left_s)

    def _take_in(
        self, runs: Path, progress: ReadProgress | None, enough: Callable[[float], bool]
    ) -> tuple[int, list[float]]:
        """Return how many manifests were read, and when those were written that are left, s since 1970.

        `enough` is asked with the time at which the next one was written, and all others before it.
        """
        root = root_name(runs)
        changed_ns = _changed_ns(runs)
        with self._database.transaction():
            seen = self._database.rows("SELECT changed_ns FROM gyrobench_roots WHERE root = :root", root=root)
            unchanged = bool(seen) and seen[0][0] == changed_ns
            going_on = self._names(root, "outcome = 'running'")
            kept = going_on if unchanged else self._names(root)
        written_s = {} if unchanged else _written_s(runs)
        written_s |= {name: math.inf for name in going_on if unchanged or name in written_s}
        with self._database.transaction():
            self._delete(root, sorted(kept - written_s.keys()))
        new = sorted(
            (written_s.keys() - kept) | (going_on & written_s.keys()),
            key=lambda name: (written_s[name], name),
            reverse=True,
        )
        read, stamps_hold = 0, True
        while read < len(new):
            names = new[read : read + _AT_ONCE]
            rows = self._read(runs, root, names, going_on)
            read += len(names)
            stamps_hold = stamps_hold and all(
                row.started_s <= written_s[row.name] + _CLOCKS_S for row in rows
            )
            if progress is not None:
                progress(read, len(new))
            if stamps_hold and read < len(new) and enough(written_s[new[read]]):
                break
        if not unchanged:
            settled = read == len(new) and epoch_seconds() - changed_ns * 1e-9 > _SETTLED_S
            row = {"root": root, "changed_ns": changed_ns if settled else -1}
            with self._database.transaction():
                self._database.change("DELETE FROM gyrobench_roots WHERE root = :root", [row])
                self._insert("gyrobench_roots", [row])
        return read, [written_s[name] for name in new[read:]]

    def rebuild(self, runs: Path, progress: ReadProgress | None = None) -> int:
        """Forget what is known of the runs below `runs` and read them all again; return how many there are."""
        of_root = [{"root": root_name(runs)}]
        with self._database.transaction():
            for table in ("gyrobench_run_units", "gyrobench_runs", "gyrobench_roots"):
                self._database.change(f"DELETE FROM {table} WHERE root = :root", of_root)
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
        values: dict[str, object] = {"root": root, "procedure": procedure, "outcome": outcome, "unit": unit}
        values = {name: value for name, value in values.items() if value is not None}
        wanted = [f"{name} = :{name}" for name in values]
        if since is not None:
            values["since_s"] = period_s(since)[0]
            wanted.append("started_s >= :since_s")
        if until is not None:
            values["until_s"] = period_s(until)[1]
            wanted.append("started_s < :until_s")
        units = "" if unit is None else " JOIN gyrobench_run_units USING (root, name)"
        where = f"FROM gyrobench_runs{units}" + (f" WHERE {' AND '.join(wanted)}" if wanted else "")
        with self._database.transaction():
            found = self._database.rows(
                f"SELECT {', '.join(COLUMNS)} {where} ORDER BY started_s DESC, name DESC LIMIT :most",
                **values,
                most=limit,
            )
            count = len(found)
            if count == limit:
                count = int(self._database.rows(f"SELECT count(*) {where}", **values)[0][0])
        rows = [dict(zip(COLUMNS, row, strict=True)) for row in found]
        return [CatalogueRow(**{**row, "units": tuple(json.loads(row["units"]))}) for row in rows], count

    def close(self) -> None:
        """Let go of the database."""
        self._database.close()

    def __enter__(self) -> Catalogue:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _names(self, root: str, wanted: str = "TRUE") -> set[str]:
        found = self._database.rows(
            f"SELECT name FROM gyrobench_runs WHERE root = :root AND {wanted}", root=root
        )
        return {name for (name,) in found}

    def _read(self, runs: Path, root: str, names: Sequence[str], known: set[str]) -> list[CatalogueRow]:
        """Take in some runs; those `known` stand in the catalogue as they were."""
        place = str(runs)  # text: a `Path` for each run costs more than opening its manifest
        rows = [read_row(place, name, root) for name in names]
        runs_rows = [vars(row) | {"units": json.dumps(row.units, ensure_ascii=False)} for row in rows]
        units = [{"unit": unit, "root": root, "name": row.name} for row in rows for unit in row.units]
        with self._database.transaction():
            self._delete(root, [name for name in names if name in known])
            self._insert("gyrobench_runs", runs_rows)
            self._insert("gyrobench_run_units", units)
        return rows

    def _delete(self, root: str, names: Iterable[str]) -> None:
        rows = [{"root": root, "name": name} for name in names]
        for table in ("gyrobench_run_units", "gyrobench_runs"):
            self._database.change(f"DELETE FROM {table} WHERE root = :root AND name = :name", rows)

    def _insert(self, table: str, rows: Sequence[Mapping[str, object]]) -> None:
        """Insert rows; one that somebody else has inserted meanwhile stays."""
        if rows:
            names, values = ", ".join(rows[0]), ", ".join(f":{name}" for name in rows[0])
            self._database.change(
                f"INSERT INTO {table} ({names}) VALUES ({values}) ON CONFLICT DO NOTHING", rows
            )


def _written_s(runs: Path) -> dict[str, float]:
    """Return the folders below `runs` that hold a manifest, and when it was written, s since 1970.

    A name that no run can have is none. A time stamp that was lost is infinite.
    """
    with os.scandir(runs) as entries:
        folders = [
            entry.name
            for entry in entries
            if not entry.name.startswith(".") and entry.name.isprintable() and entry.is_dir()
        ]
    found: dict[str, float] = {}
    for name in folders:
        try:
            stamp_s = os.stat(f"{runs}/{name}/{MANIFEST_FILE}").st_mtime  # noqa: PTH116 - a `Path` costs more
        except OSError:
            continue
        found[name] = stamp_s if stamp_s >= _NO_STAMP_S else math.inf
    return found


def _changed_ns(runs: Path) -> int:
    try:
        return runs.stat().st_mtime_ns
    except OSError as error:
        raise RecordError(
            "there is no such folder of runs",
            where=str(runs),
            found=error.strerror or str(error),
            remedy="name the folder that `gyrobench run --runs` wrote to",
        ) from error


def find_runs(
    runs: Path,
    url: str | None = None,
    *,
    limit: int = 100,
    progress: ReadProgress | None = None,
    **wanted: str | None,
) -> tuple[list[CatalogueRow], int, int]:
    """Return the newest `limit` runs that fit `wanted` (see `Catalogue.find`), how many fit, how many more may.

    Those that may are older runs whose manifests have not been read yet.

    Those of `runs`, whose catalogue lies beside them; with the `url` of a shared catalogue those of every bench.
    """
    local = _local(runs)
    if url is None and not local.exists():
        return [], 0, 0
    wanted |= {"root": root_name(local) if url is None else None}
    with Catalogue.beside(local) if url is None else Catalogue(url) as catalogue:
        unread = catalogue.update_for(local, progress, limit=limit, **wanted) if local.exists() else 0
        return *catalogue.find(limit=limit, **wanted), unread


def index_runs(
    runs: Path, url: str | None = None, *, rebuild: bool = False, progress: ReadProgress | None = None
) -> int:
    """Bring the catalogue up to date with the folders, or make it anew; return how many manifests were read."""
    local = _local(runs)
    with Catalogue.beside(local) if url is None else Catalogue(url) as catalogue:
        return (catalogue.rebuild if rebuild else catalogue.update)(local, progress)


def _local(runs: Path) -> Path:
    """Return where the manifests are on this machine."""
    if not url_of(runs):
        return runs
    from bench.record.recording import local_manifests

    return local_manifests(runs)


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
    length_s = {
        1: 86_400.0 * (365 + calendar.isleap(start.year)),
        2: 86_400.0 * calendar.monthrange(start.year, start.month)[1],
        3: 86_400.0,
        5: 60.0,
        6: 1.0,
    }[len(given)]
    return start.timestamp(), start.timestamp() + length_s


def read_row(runs: str, name: str, root: str) -> CatalogueRow:
    """Return run folder `name` below `runs` as a row of the catalogue; what cannot be read says why."""
    try:
        manifest = parse_json(read_bounded(f"{runs}/{name}/{MANIFEST_FILE}", MANIFEST_BYTES))
        started = datetime.datetime.fromisoformat(str(manifest["started_utc"]))
        started = started if started.tzinfo else started.replace(tzinfo=datetime.UTC)
        duration = manifest.get("duration_s")
        return CatalogueRow(
            root=root,
            name=name,
            run_id=_text(manifest["run_id"]),
            procedure=_text(manifest["procedure"]),
            bench=_text(manifest.get("bench", {}).get("bench", {}).get("name", "")),
            outcome=_text(manifest["outcome"]),
            reason=_text(manifest.get("reason", "")),
            started_s=started.timestamp(),
            duration_s=None if duration is None else float(duration),
            units=tuple(dict.fromkeys(_text(unit) for unit in manifest.get("units", {}).values())),
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        reason = f"{MANIFEST_FILE}: {type(error).__name__}: {error}"
        return CatalogueRow(root, name, name, reason=reason)


def _text(value: object) -> str:
    """Return text that every database takes: no half characters, no zero bytes."""
    return str(value).encode("utf-8", "replace").decode().replace("\0", "\N{REPLACEMENT CHARACTER}")
