"""Reads runs: what was asked, what happened, and just the columns and stretch of data that are needed."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from bench.record.events import Event, Row
from bench.record.events.run import PhaseBegun
from bench.record.recording._decode import Arrivals, Role, StreamSource, read_arrivals, table_name
from bench.record.recording._events import Events, Line, read_events
from bench.record.recording._frames import Framed
from bench.record.recording._journal import RAW_FOLDER
from bench.record.recording._manifest import Manifest, checksum, read_manifest, seal_state
from bench.record.recording._raw import can_frames
from bench.record.recording._remote import fetch_file, local_run, remote_file
from bench.record.recording._tables import (
    SecondMeans,
    from_arrow,
    names_at,
    row_means,
    second_rows,
    seconds,
)
from bench.record.run_folder import MANIFEST_FILE, url_of
from bench.record.shown import Shown
from drivers.base.arrays import ARCHIVE_DAMAGE, Array, array_of, read_archive
from drivers.base.constants import earth_rate_north_dph, earth_rate_up_dph
from drivers.base.errors import ConfigurationError, RecordError

Table = dict[str, NDArray[Any]]
_E = TypeVar("_E", bound=Event)
_AT_ONCE_S = 3600
"""Seconds of a gyro's samples in memory at a time."""
_NO_RATE_DPH = 1e-9


@dataclass(frozen=True)
class Phase:
    """A phase of a run, bench time in s; the last one ends with the last event."""

    name: str
    start_s: float
    end_s: float


@dataclass(frozen=True, repr=False)
class Run(Framed, Shown):
    """A run on disk or on object storage, read as asked for: the one way to what a run holds."""

    _folder: Path
    """On this machine: the run itself, or the cache of what was fetched."""
    manifest: Manifest
    _url: str = ""
    """Of a run on object storage."""

    @classmethod
    def open(cls, folder: Path | str) -> Run:
        """Open a run folder, or a run on object storage by its URL; RecordError if it is none.

        What is read of a run on object storage is fetched: small files now, of tables the stretches asked for.
        """
        here = local_run(folder)
        return cls(here, read_manifest(here), url_of(folder))

    def shown(self) -> dict[str, object]:
        """Return what was run on what, when, for how long and how it ended."""
        manifest = self.manifest
        return {
            "run": manifest.run_id,
            "procedure": manifest.procedure,
            "outcome": " ".join([manifest.outcome, *([f"({manifest.reason})"] if manifest.reason else [])]),
            "units": list(manifest.units.values()),
            "started": manifest.started_utc,
            "bench time, s": "not closed" if manifest.duration_s is None else manifest.duration_s,
            "tables": list(self.tables),
        }

    @property
    def place(self) -> Path | str:
        """The run's folder, or its URL."""
        return self._url or self._folder

    @property
    def complete(self) -> bool:
        """Whether the run was closed; one that was not can still be read as far as it was written."""
        return self.manifest.complete

    @property
    def seal(self) -> Literal["whole", "broken", "none"]:
        """Whether the manifest is the one that was sealed; "none": it was written without a seal."""
        return seal_state(self._folder, self.manifest)

    @property
    def checksum(self) -> str:
        """SHA-256 of the manifest, which holds those of its files; of an imported run that of its log."""
        log = self.manifest.files.get(self.manifest.imported.log) if self.manifest.imported else None
        return log.sha256 if log else checksum(self._folder / MANIFEST_FILE).sha256

    @cached_property
    def event_log(self) -> Events:
        """What happened, as it was read: rows, typed lines, and an incomplete last line."""
        return read_events(self._folder)

    @property
    def events(self) -> tuple[Row, ...]:
        """The event log, one dictionary a line."""
        return self.event_log.rows

    @property
    def lines(self) -> tuple[Line, ...]:
        """The event log as typed events, each with its bench time."""
        return self.event_log.lines

    def of(self, kind: type[_E]) -> list[tuple[float, _E]]:
        """Return the events of a class, each with its bench time in s; see `bench.record.events`."""
        return self.event_log.of(kind)

    def phases(self) -> tuple[Phase, ...]:
        """Return the phases in order; a phase that was entered twice is there twice."""
        marks = self.of(PhaseBegun)
        if not marks:
            return ()
        ends = [start for start, _ in marks[1:]] + [max(line.time_s for line in self.lines)]
        return tuple(Phase(mark.phase, start, end) for (start, mark), end in zip(marks, ends, strict=True))

    def phase_at(self, times_s: Array) -> NDArray[np.str_]:
        """Return the name of the phase at every time, (n,); `run` in a run without phases."""
        phases = self.phases() or (Phase("run", 0.0, 0.0),)
        return names_at([phase.start_s for phase in phases], [phase.name for phase in phases], times_s)

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the decoded tables, in order: `chamber`, `gyro_<name>`, `turntable` and others."""
        held = self.manifest.files if self._url else (path.name for path in self._folder.glob("*.parquet"))
        return tuple(sorted(name.removesuffix(".parquet") for name in held if name.endswith(".parquet")))

    @property
    def gyros(self) -> tuple[str, ...]:
        """Names of the gyros with a decoded table."""
        return self._named("gyro")

    @property
    def platforms(self) -> tuple[str, ...]:
        """Names of the platform INSs with a decoded table."""
        return self._named("platform")

    def _named(self, role: Role) -> tuple[str, ...]:
        prefix = f"{role}_"
        return tuple(name.removeprefix(prefix) for name in self.tables if name.startswith(prefix))

    def gyro(
        self,
        name: str,
        columns: Sequence[str] | None = None,
        start_s: float | None = None,
        end_s: float | None = None,
    ) -> Table:
        """Return columns of a gyro, shape (n,) each, for start_s <= time < end_s; see `read_table`."""
        return self._table(table_name("gyro", name), columns, start_s, end_s)

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

    def platform(self, name: str) -> Table:
        """Return all columns of a platform INS."""
        return self._table(table_name("platform", name), None, None, None)

    def readings(self, instrument: str) -> Table:
        """Return all columns of a supply, a logger or an instrument of another role: time_ns and its own."""
        return self._table(f"{self.manifest.device(instrument).role}_{instrument}.parquet", None, None, None)

    def second_means(self, gyro: str, start_s: int, end_s: int, *, from_start: bool = False) -> SecondMeans:
        """Return 1 s means of a gyro, (end_s - start_s,): row k is of start_s + k < time <= start_s + k + 1.

        `from_start`: a sample at start_s itself counts into the first second, one at end_s is left out.
        """
        rates, temps, lost, frames = [np.zeros(0)], [np.zeros(0)], 0, 0
        for low in range(start_s, end_s, _AT_ONCE_S):
            high = min(low + _AT_ONCE_S, end_s)
            columns = ("time_ns", "rate_dps", "temp_c", "valid", "lost_before")
            first_s = low if from_start and low == start_s else low + 1e-9
            last_s = high if from_start and high == end_s else high + 1e-9
            table = self.gyro(gyro, columns, first_s, last_s)
            row = np.maximum(second_rows(table, low), 0)
            rates.append(row_means(table["rate_dps"], row, high - low, table["valid"].astype(np.bool_)))
            temps.append(row_means(table["temp_c"], row, high - low))
            lost += int(table["lost_before"].sum())
            frames += len(row)
        return SecondMeans(np.concatenate(rates), np.concatenate(temps), lost / max(frames + lost, 1))

    def case_temp_c(self, gyro: str, times_s: Array) -> Array | None:
        """Return the temperature on a unit's case at times (n,); None for a unit without a sensor on it."""
        sensor = self.manifest.device(gyro).case_sensor
        if sensor is None:
            return None
        at_s, temp_c = self.sensor(sensor)
        return np.asarray(np.interp(times_s, at_s, temp_c))

    def sensor(self, number: int) -> tuple[Array, Array]:
        """Return times (s) and readings (degC) of an auxiliary sensor of chamber or logger, (n,) each.

        Readings that an open sensor did not give are left out. RecordError if there is no record of it.
        """
        table, column = "chamber", f"aux_{number}_temp_c"
        loggers = self.manifest.bench.get("logger")
        for section in loggers if isinstance(loggers, list) else ():
            if isinstance(section, dict) and str(number) in (section.get("sensors") or {}):
                table = f"logger_{section.get('name')}"
        read = self._table(f"{table}.parquet", ("time_ns", column), None, None)
        known = ~np.isnan(read[column])
        return seconds(read)[known], np.asarray(read[column][known], dtype=np.float64)

    def table_angle_deg(self, times_s: Array) -> Array:
        """Return the angle of the table at times (n,), turns counted."""
        start_s, end_s = math.floor(times_s[0]) - 2.0, math.ceil(times_s[-1]) + 2.0
        table = self.turntable(("time_ns", "angle_deg"), start_s, end_s)
        return np.asarray(np.interp(times_s, seconds(table), np.unwrap(table["angle_deg"], period=360.0)))

    @property
    def azimuth_error_deg(self) -> float:
        """How far the axis under test was found beside the table's zero; 0 where that was not measured."""
        return self.manifest.measured("azimuth_error") or 0.0

    def earth_rate_dph(self, times_s: Array) -> Array:
        """Return the Earth's rate along the axis, (n,); ConfigurationError if nothing says its azimuth."""
        elevation = math.radians(self.manifest.elevation_deg)
        up = math.sin(elevation) * earth_rate_up_dph(self.manifest.latitude_deg)
        north = math.cos(elevation) * earth_rate_north_dph(self.manifest.latitude_deg)
        if abs(north) < _NO_RATE_DPH:
            return np.full(len(times_s), up)
        if self.manifest.imported is not None and "turntable" not in self.tables:
            raise ConfigurationError(
                "nothing says which way the axis points: no column angle, and no angle_deg in [[run]]",
                where=str(self.place),
                remedy="say angle_deg in [[run]], or elevation_deg = 90 for an upright axis, and import again",
            )
        angle = self.table_angle_deg(times_s) + self.azimuth_error_deg
        return np.asarray(up + north * np.cos(np.radians(angle)))

    def truth(self, gyro: str) -> dict[str, NDArray[Any]]:
        """Return what is known of an emulated unit, arrays by name; empty on a real one."""
        return read_truth(self._folder / f"truth_{gyro}.npz")

    def true_means(self, gyro: str, name: str, start_s: int, end_s: int) -> Array | None:
        """Return 1 s means, (end_s - start_s,), of a drift known at whole seconds; None where it is not."""
        ticks = self.truth(gyro).get(name)
        if ticks is None or ticks.ndim != 1 or len(ticks) <= end_s:
            return None
        return np.asarray(0.5 * (ticks[start_s:end_s] + ticks[start_s + 1 : end_s + 1]))

    def has_arrivals(self, port: str) -> bool:
        """Return whether it is known when the bytes of a port came in."""
        name = f"{RAW_FOLDER}/{port}.idx"
        return name in self.manifest.files if self._url else (self._folder / name).exists()

    def arrivals(self, source: StreamSource) -> Arrivals:
        """Return when the frames of a stream arrived."""
        self._fetch_raw(source.name)
        return read_arrivals(self._folder, source)

    def can_frames(self, port: str) -> Iterator[tuple[NDArray[np.void], NDArray[np.float64]]]:
        """Yield the frames of a CAN port and their bench times in s, (n,); see `drivers.kit.slcan_codec`."""
        self._fetch_raw(port)
        return can_frames(self._folder, port)

    def file(self, name: str) -> Path:
        """Return a file of the run on this machine, fetched if need be; `name` relative to the run."""
        entry, path = self.manifest.files.get(name), self._folder / name
        if self._url and not (path.is_file() and entry is not None and checksum(path) == entry):
            fetch_file(self._url, name, path)
        return path

    def _fetch_raw(self, port: str) -> None:
        for suffix in (".bin", ".idx"):
            self.file(f"{RAW_FOLDER}/{port}{suffix}")

    def _table(
        self, name: str, columns: Sequence[str] | None, start_s: float | None, end_s: float | None
    ) -> Table:
        if not self._url or name not in self.manifest.files:
            return read_table(self._folder / name, columns, start_s, end_s)
        with remote_file(f"{self._url}/{name}") as file, pq.ParquetFile(file, pre_buffer=True) as table:
            return _stretch(table, f"{self._url}/{name}", columns, start_s, end_s)


def read_truth(path: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of a truth file by name, empty without one.

    RecordError if it is damaged or unpacks to more than 256 MiB.
    """
    if not path.exists():
        return {}
    try:
        return {name.removesuffix(".npy"): array_of(data) for name, data in read_archive(path).items()}
    except ARCHIVE_DAMAGE as error:
        raise RecordError(
            "this is not a readable file of arrays",
            where=str(path),
            found=f"{type(error).__name__}: {error}",
            expected="a zip of .npy arrays of numbers",
            remedy="restore the file from a copy; nothing but comparisons needs it",
        ) from error


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
            found=", ".join(sorted(table.name for table in path.parent.glob("*.parquet")))
            or "no tables at all",
            expected="a decoded table",
            remedy="a run that was killed has raw bytes only; its tables can be made from them",
        )
    try:
        with pq.ParquetFile(path) as file:
            return _stretch(file, str(path), columns, start_s, end_s)
    except (pa.ArrowException, OSError, ValueError, TypeError) as error:
        raise RecordError(
            "the table cannot be read",
            where=str(path),
            found=str(error).splitlines()[0] if str(error) else type(error).__name__,
            expected="a table as runs have them: time_ns and columns of numbers",
            remedy="`gyrobench runs verify` says what differs; tables can be made from raw/ again",
        ) from error


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
            f"the table has no column {', '.join(unknown)}", where=where, found=", ".join(names)
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
    if not hasattr(os, "sysconf"):  # no POSIX: the allocation fails by itself
        return
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
