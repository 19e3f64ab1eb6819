"""Reads runs: what was asked, what happened, and just the columns and stretch of data that are needed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from bench.record.events import Event, Row
from bench.record.events.run import PhaseBegun
from bench.record.recording._arrow import from_arrow
from bench.record.recording._decode import gyro_table
from bench.record.recording._events import Events, Line, read_events
from bench.record.recording._manifest import Manifest, checksum, read_manifest
from bench.record.recording._remote import local_run, remote_file
from bench.record.run_folder import MANIFEST_FILE, url_of
from drivers.base.errors import RecordError

Table = dict[str, NDArray[Any]]
_E = TypeVar("_E", bound=Event)


@dataclass(frozen=True)
class Phase:
    """A phase of a run, bench time in s; the last one ends with the last event."""

    name: str
    start_s: float
    end_s: float


@dataclass(frozen=True)
class Run:
    """A run folder, read as asked for."""

    folder: Path
    manifest: Manifest
    url: str = ""
    """Where the tables are, if not in the folder."""

    @classmethod
    def open(cls, folder: Path | str) -> Run:
        """Open a run folder, or a run on object storage by its URL; RecordError if it is none.

        What is read of a run on object storage is fetched: small files now, of tables the stretches asked for.
        """
        here = local_run(folder)
        return cls(here, read_manifest(here), url_of(folder))

    @property
    def complete(self) -> bool:
        """Whether the run was closed; one that was not can still be read as far as it was written."""
        return self.manifest.complete

    @property
    def checksum(self) -> str:
        """SHA-256 of the run's manifest, which holds those of its files."""
        return checksum(self.folder / MANIFEST_FILE).sha256

    @cached_property
    def _event_log(self) -> Events:
        return read_events(self.folder)

    @property
    def events(self) -> tuple[Row, ...]:
        """The event log, one dictionary a line."""
        return self._event_log.rows

    @property
    def lines(self) -> tuple[Line, ...]:
        """The event log as typed events, each with its bench time."""
        return self._event_log.lines

    def of(self, kind: type[_E]) -> list[tuple[float, _E]]:
        """Return the events of a class, each with its bench time in s; see `bench.record.events`."""
        return self._event_log.of(kind)

    @property
    def torn_event(self) -> str:
        """An incomplete last line of the event log, empty if there is none."""
        return self._event_log.torn

    def phases(self) -> tuple[Phase, ...]:
        """Return the phases in order; a phase that was entered twice is there twice."""
        marks = self.of(PhaseBegun)
        if not marks:
            return ()
        ends = [start for start, _ in marks[1:]] + [max(line.time_s for line in self.lines)]
        return tuple(Phase(mark.phase, start, end) for (start, mark), end in zip(marks, ends, strict=True))

    @property
    def gyros(self) -> tuple[str, ...]:
        """Names of the gyros with a decoded table."""
        prefix, suffix = gyro_table("*").split("*")
        if self.url:
            names = [name for name in self.manifest.files if name.startswith(prefix)]
            return tuple(sorted(name.removeprefix(prefix).removesuffix(suffix) for name in names))
        return tuple(
            sorted(
                path.name.removeprefix(prefix).removesuffix(suffix)
                for path in self.folder.glob(gyro_table("*"))
            )
        )

    def gyro(
        self,
        name: str,
        columns: Sequence[str] | None = None,
        start_s: float | None = None,
        end_s: float | None = None,
    ) -> Table:
        """Return columns of a gyro, shape (n,) each, for start_s <= time < end_s; see `read_table`."""
        return self._table(gyro_table(name), columns, start_s, end_s)

    def turntable(
        self, columns: Sequence[str] | None = None, start_s: float | None = None, end_s: float | None = None
    ) -> Table:
        """Return the table's telemetry: time_ns, angle_deg, rate_dps."""
        return self._table("turntable.parquet", columns, start_s, end_s)

    def chamber(
        self, columns: Sequence[str] | None = None, start_s: float | None = None, end_s: float | None = None
    ) -> Table:
        """Return the chamber's telemetry: time_ns, air_temp_c, set_point_c, aux_<n>_temp_c."""
        return self._table("chamber.parquet", columns, start_s, end_s)

    def _table(
        self, name: str, columns: Sequence[str] | None, start_s: float | None, end_s: float | None
    ) -> Table:
        if not self.url or (self.folder / name).exists() or name not in self.manifest.files:
            return read_table(self.folder / name, columns, start_s, end_s)
        with remote_file(f"{self.url}/{name}") as file, pq.ParquetFile(file, pre_buffer=True) as table:
            return _stretch(table, f"{self.url}/{name}", columns, start_s, end_s)


def read_table(
    path: Path,
    columns: Sequence[str] | None = None,
    start_s: float | None = None,
    end_s: float | None = None,
) -> Table:
    """Return columns (default all) of a decoded table for start_s <= time < end_s, bench time.

    Only the row groups that overlap the stretch and the columns asked for are read. RecordError names a table or
    column that is not there.
    """
    if not path.exists():
        raise RecordError(
            "there is no such table",
            where=str(path),
            found=", ".join(sorted(each.name for each in path.parent.glob("*.parquet")))
            or "no tables at all",
            expected="a decoded table",
            remedy="a run that was killed has raw bytes only; its tables can be made from them",
        )
    try:
        return _read(path, columns, start_s, end_s)
    except (pa.ArrowException, OSError, ValueError, TypeError) as error:
        raise RecordError(
            "the table cannot be read",
            where=str(path),
            found=str(error).splitlines()[0] if str(error) else type(error).__name__,
            expected="a table as runs have them: time_ns and columns of numbers",
            remedy="`gyrobench runs verify` says what differs; tables can be made from raw/ again",
        ) from error


def _read(path: Path, columns: Sequence[str] | None, start_s: float | None, end_s: float | None) -> Table:
    with pq.ParquetFile(path) as file:
        return _stretch(file, str(path), columns, start_s, end_s)


def _stretch(
    file: pq.ParquetFile,
    where: str,
    columns: Sequence[str] | None,
    start_s: float | None,
    end_s: float | None,
) -> Table:
    names = file.schema_arrow.names
    wanted = list(names if columns is None else columns)
    if unknown := [name for name in wanted if name not in names]:
        raise RecordError(
            f"the table has no column {', '.join(unknown)}",
            where=where,
            found=", ".join(names),
        )
    low = -(1 << 62) if start_s is None else round(start_s * 1e9)
    high = 1 << 62 if end_s is None else round(end_s * 1e9)
    groups, inside = _overlapping(file, low, high)
    check_room(where, sum(file.metadata.row_group(group).num_rows for group in groups), len(wanted) + 1)
    read = wanted if inside else ["time_ns", *wanted]
    table = file.read_row_groups(groups, columns=list(dict.fromkeys(read)), use_threads=False)
    data = {name: from_arrow(table[name]) for name in table.column_names}
    if inside:
        return {name: data[name] for name in wanted}
    keep = (data["time_ns"] >= low) & (data["time_ns"] < high)
    return {name: data[name] if keep.all() else data[name][keep] for name in wanted}


def check_room(where: str, rows: int, columns: int) -> None:
    """Refuse what would not fit in memory, RecordError: a kilobyte can say that it has 10**9 equal rows."""
    room = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if 2 * 8 * rows * columns > room:  # once in Arrow, once as numpy
        raise RecordError(
            "the table is larger than this machine's memory",
            where=where,
            found=f"{rows} rows of {columns} columns, memory of {room >> 20} MiB",
            remedy="read fewer columns or a shorter stretch",
        )


def _overlapping(file: pq.ParquetFile, low: int, high: int) -> tuple[list[int], bool]:
    """Return the row groups that may have rows with low <= time < high, and whether they have no others."""
    at = file.schema_arrow.names.index("time_ns")
    groups, inside = [], True
    for group in range(file.metadata.num_row_groups):
        statistics = file.metadata.row_group(group).column(at).statistics
        if statistics is None or (statistics.max >= low and statistics.min < high):
            groups.append(group)
            inside &= statistics is not None and low <= statistics.min and statistics.max < high
    return groups, inside


def seconds(table: Table) -> NDArray[np.float64]:
    """Return the time column of a table in s of bench time, shape (n,)."""
    return np.asarray(table["time_ns"] * 1e-9, dtype=np.float64)


def second_rows(table: Table, start_s: int) -> NDArray[np.int64]:
    """Return the row of each sample's second, shape (n,): row k holds start_s + k < time <= start_s + k + 1.

    In integers: 15_000_000_000 ns times 1e-9 is more than 15 s.
    """
    return np.asarray(-(-table["time_ns"] // 1_000_000_000) - start_s - 1, dtype=np.int64)
