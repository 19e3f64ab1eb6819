"""A foreign log as a run folder: the log itself is its raw record, the tables are made from it by the mapping."""

from __future__ import annotations

import platform
import re
import shutil
import tempfile
from collections.abc import Callable
from collections.abc import Mapping as Columns
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.record.events import Event
from bench.record.events.run import AirDemand, AngleDemand, Measured, Note, Outcome, PhaseBegun, RateDemand
from bench.record.exchange._log import Log, read_log
from bench.record.exchange._mapping import LogEntry, Mapping, read_mapping
from bench.record.exchange._row_times import mean_step_s
from bench.record.recording import (
    DeviceEntry,
    EventLog,
    Imported,
    Manifest,
    StreamReport,
    read_manifest,
    seal,
    table_writer,
)
from bench.record.signing import bench_key
from drivers.base.arrays import Array
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError, RecordError

_CASE_SENSOR = 1
_AXES = 3
_MAPPING = "mapping.toml"
_LONGEST_NAME = 200
_MOST_LOST = 2**31 - 1


def import_log(log: Path, mapping_file: Path, runs: Path) -> Path:
    """Make a run folder below `runs` from a log and return it.

    Everything is checked before anything is written; the folder takes its name when it is complete.
    ConfigurationError for a mapping or log that cannot be used, RecordError for a folder that cannot be
    written.
    """
    mapping = read_mapping(mapping_file)
    entry = mapping.entry_for(log, mapping_file)
    _check_started(entry, mapping_file)
    data = read_log(log, mapping)
    started = entry.started_utc or _first_row_utc(data)
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", entry.run_id or log.stem).strip(".-") or "imported"
    target = runs / name
    if not log.name.isprintable() or log.name == _MAPPING or max(len(name), len(log.name)) > _LONGEST_NAME:
        raise ConfigurationError(
            "the log's name, or its run_id, cannot be that of a file in a run folder",
            where=repr(log.name)[:100],
            found=f"{max(len(name), len(log.name))} characters",
            expected=f"at most {_LONGEST_NAME} printable characters, and not {_MAPPING}",
            remedy="rename the log, or say run_id in the mapping's [[run]]",
        )
    beside = [mapping.recorder_file(part, log) for part in mapping.recorder]
    if len({file.name for file in beside} | {log.name, _MAPPING}) != len(beside) + 2:
        raise ConfigurationError(
            "files of one run cannot have the same name in a run folder",
            where=str(log),
            found=", ".join(str(file) for file in beside),
            expected=f"names that differ from one another, from the log's and from {_MAPPING}",
        )
    if target.exists():
        raise ConfigurationError(
            "there is a run of that name",
            where=str(target),
            expected="a name of its own: runs are never overwritten",
            remedy="say run_id in the mapping's [[run]], or another --out",
        )
    try:
        runs.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".importing-", dir=runs) as scratch:
            folder = Path(scratch) / name
            (folder / "raw").mkdir(parents=True)
            for file in (log, *beside):
                shutil.copyfile(file, folder / "raw" / file.name)
            shutil.copyfile(mapping_file, folder / "raw" / _MAPPING)
            _write_run(folder, log.name, mapping, entry, data, started)
            folder.rename(target)
    except OSError as error:
        raise RecordError(
            "the run folder cannot be written", where=str(target), found=error.strerror or str(error)
        ) from error
    return target


def decode_imported(folder: Path, out: Path) -> dict[str, StreamReport]:
    """Make the tables of an imported run anew from the log and mapping in its raw/, in `out`."""
    imported = read_manifest(folder).imported
    if imported is None:
        raise RecordError("this run was not imported", where=str(folder))
    mapping = read_mapping(folder / imported.mapping)
    log = folder / imported.log
    return _write_tables(out, mapping, mapping.entry_for(log, log), read_log(log, mapping))


def _write_run(folder: Path, log: str, mapping: Mapping, entry: LogEntry, data: Log, started: str) -> None:
    duration_s = float(data.time_s[-1] - data.time_s[0])
    streams = _write_tables(folder, mapping, entry, data)
    events = EventLog(folder)
    events.event(0.0, Note(f"imported from {log}"))
    for time_s, event in sorted([*_phases(entry), *_demands(data)], key=lambda row: row[0]):
        events.event(time_s, event)
    events.event(duration_s, Outcome("completed", "imported", sealed=True))
    events.close()
    ended = datetime.fromisoformat(started) + timedelta(seconds=duration_s)
    axes = {"axes": "xyz"} if len(mapping.columns.gyros) == _AXES else {}
    elevation = data.columns.get("elevation")
    elevation_deg = entry.elevation_deg if elevation is None else float(np.nanmedian(elevation))
    azimuth = Measured("azimuth_error", entry.azimuth_error_deg, "deg", None, None, None)
    manifest = Manifest(
        run_id=folder.name,
        procedure=mapping.procedure or entry.profile or "imported",
        parameters={"condition": entry.condition, "power_on_s": entry.power_on_s or 0.0},
        mounting="axis_up" if abs(elevation_deg) > 45.0 else "axis_horizontal",
        outcome="completed",
        reason="imported",
        started_utc=started,
        ended_utc=ended.isoformat(timespec="milliseconds"),
        duration_s=duration_s,
        bench={
            "bench": {"name": mapping.bench, "latitude_deg": mapping.latitude_deg},
            "gyro": [
                {"name": name, "unit": mapping.unit_id, "axis": mapping.axis, "driver": "imported"} | axes
                for name in streams
            ],
        },
        devices={
            name: DeviceEntry(
                kind="imported",
                role="gyro",
                maker=mapping.maker,
                model=mapping.model,
                serial_number=mapping.unit_id,
                axis=mapping.axis,
                case_sensor=_CASE_SENSOR if mapping.columns.t_out else None,
            )
            for name in streams
        },
        units=dict.fromkeys(streams, mapping.unit_id),
        imported=Imported(log=f"raw/{log}", mapping=f"raw/{_MAPPING}", elevation_deg=elevation_deg),
        software={"python": platform.python_version(), "gyrobench": version("gyrobench")},
        stream={name: vars(report) for name, report in streams.items()},
        measurements=(dict(vars(azimuth)),),
    )
    seal(folder, manifest, bench_key())


def _write_tables(out: Path, mapping: Mapping, entry: LogEntry, data: Log) -> dict[str, StreamReport]:
    """Write gyro, turntable and chamber tables; bench time starts with the first row."""
    time_s = data.time_s - data.time_s[0]
    columns = data.columns
    streams = {}
    if "output" in columns:
        path = out / f"gyro_{mapping.gyro}.parquet"
        streams[mapping.gyro] = _write_gyro(path, mapping.gyro, time_s, data)
    grid_s = np.append(np.arange(0.0, time_s[-1]), time_s[-1])
    angle = _on(grid_s, time_s, columns["angle"]) if "angle" in columns else entry.table_angle_deg(grid_s)
    if angle is not None:
        _write_turntable(out / "turntable.parquet", grid_s, angle, time_s, columns)
    names = {"air": "air_temp_c", "set_point": "set_point_c", "t_out": f"aux_{_CASE_SENSOR}_temp_c"}
    chamber = {name: _on(grid_s, time_s, columns[key]) for key, name in names.items() if key in columns}
    if chamber:
        with table_writer(out / "chamber.parquet", "chamber, imported") as writer:
            writer.write({"time_ns": _ns(grid_s), **chamber})
    return streams


def _write_turntable(
    path: Path, grid_s: Array, angle_deg: Array, time_s: Array, columns: Columns[str, Array]
) -> None:
    """Write the table's angle, in the rows of its column where it has one, and its rate, else over seconds."""
    rate_dps = np.gradient(angle_deg, grid_s)
    if "angle" in columns and (known := np.isfinite(columns["angle"])).any():
        rows_s = time_s[known]
        angle_deg, rate_dps, grid_s = columns["angle"][known], np.interp(rows_s, grid_s, rate_dps), rows_s
    if "table_rate" in columns:
        rate_dps = _on(grid_s, time_s, columns["table_rate"])
    with table_writer(path, "turntable, imported") as writer:
        writer.write({"time_ns": _ns(grid_s), "angle_deg": np.mod(angle_deg, 360.0), "rate_dps": rate_dps})


def _phases(entry: LogEntry) -> list[tuple[float, Event]]:
    return [(phase.start_s, PhaseBegun(phase.name)) for phase in entry.phases]


def _demands(data: Log) -> list[tuple[float, Event]]:
    """Return what chamber and table were told, and when: a column's first value and changes, one each second."""
    kinds: dict[str, Callable[[float], Event]] = {
        "set_point": lambda value: AirDemand("chamber", value),
        "rate_demand": lambda value: RateDemand("turntable", "table", value),
        "angle_demand": lambda value: AngleDemand("turntable", "table", value),
    }
    demands = []
    since_s = data.time_s - data.time_s[0]
    _, seconds = np.unique(np.floor(since_s), return_index=True)
    for name, demand in kinds.items():
        values = data.columns.get(name, np.full(len(since_s), np.nan))
        told = seconds[np.isfinite(values[seconds])]
        told = told[np.diff(values[told], prepend=np.nan) != 0.0]
        demands += [(float(since_s[at]), demand(float(values[at]))) for at in told]
    return demands


def _write_gyro(path: Path, gyro: str, time_s: Array, data: Log) -> StreamReport:
    rate = data.columns["output"]
    step = np.diff(time_s)
    period_s = mean_step_s(time_s)
    lost = np.zeros(len(time_s), np.int32)
    lost[1:] = np.clip(np.rint(step / period_s) - 1.0, 0, _MOST_LOST)
    counter = np.arange(len(time_s), dtype=np.int64) + np.cumsum(lost, dtype=np.int64)
    with table_writer(path, f"gyro {gyro}, imported") as writer:
        writer.write(
            {
                "time_ns": _ns(time_s),
                "counter": counter,
                "lost_before": lost,
                "status": np.zeros(len(time_s), np.uint8),
                "valid": np.isfinite(rate),
                "rate_dps": rate.astype(np.float32),
                **{f"{name}{unit}": data.columns[name].astype(np.float32) for name, unit in _others(data)},
                "temp_c": data.columns.get("t_in", np.full(len(time_s), np.nan)).astype(np.float32),
            }
        )
    return StreamReport(
        frames=len(time_s),
        lost=int(lost.sum()),
        invalid=int(np.isnan(rate).sum()),
        sample_rate_hz=1.0 / period_s,
        warnings=("imported: lost samples are gaps in the time column",),
    )


def _others(data: Log) -> list[tuple[str, str]]:
    """Return the columns of an IMU's other axes, each with its unit as names in tables end."""
    return [(name, "_dps") for name in data.columns if name.startswith("rate_") and name != "rate_demand"] + [
        (name, "_mps2") for name in data.columns if name.startswith("accelerometer_")
    ]


def _on(grid_s: Array, time_s: Array, values: Array) -> Array:
    """Return values on a grid, missing ones bridged; all NaN stays so."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(grid_s), np.nan)
    return np.asarray(np.interp(grid_s, time_s[known], values[known]))


def _ns(time_s: Array) -> NDArray[np.int64]:
    return np.rint(time_s * 1e9).astype(np.int64)


def _check_started(entry: LogEntry, where: Path) -> None:
    """Raise ConfigurationError for a start that is no date and time."""
    if not entry.started_utc:
        return
    try:
        if not 1970 <= datetime.fromisoformat(entry.started_utc).year < 3000:
            raise ValueError("no year of a recording")
    except ValueError as error:
        raise ConfigurationError(
            "started_utc is no date and time", where=str(where), found=entry.started_utc, expected="ISO 8601"
        ) from error


def _first_row_utc(data: Log) -> str:
    """Return the date and time of the first row; now where the log has none."""
    if not data.since_1970:
        return utc_now()
    return datetime.fromtimestamp(float(data.time_s[0]), UTC).isoformat(timespec="milliseconds")
