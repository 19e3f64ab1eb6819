"""A foreign log as a run folder: the log itself is its raw record, the tables are made from it by the mapping."""

from __future__ import annotations

import platform
import re
import shutil
import tempfile
from datetime import datetime, timedelta
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.record.events.run import Measured, Note, Outcome, PhaseBegun
from bench.record.exchange._log import Log, read_log
from bench.record.exchange._mapping import LogEntry, Mapping, read_mapping
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
from drivers.base.arrays import Array
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError, RecordError

_CASE_SENSOR = 1
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
    started = _started(entry, mapping_file)
    data = read_log(log, mapping.columns)
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
            shutil.copyfile(log, folder / "raw" / log.name)
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
    return _write_tables(out, mapping, mapping.entry_for(log, log), read_log(log, mapping.columns))


def _write_run(folder: Path, log: str, mapping: Mapping, entry: LogEntry, data: Log, started: str) -> None:
    duration_s = float(data.time_s[-1] - data.time_s[0])
    streams = _write_tables(folder, mapping, entry, data)
    events = EventLog(folder)
    events.event(0.0, Note(f"imported from {log}"))
    for phase in entry.phases:
        events.event(phase.start_s, PhaseBegun(phase.name))
    events.event(duration_s, Outcome("completed", "imported", sealed=True))
    events.close()
    ended = datetime.fromisoformat(started) + timedelta(seconds=duration_s)
    azimuth = Measured("azimuth_error", entry.azimuth_error_deg, "deg", None, None, None)
    manifest = Manifest(
        run_id=folder.name,
        procedure=mapping.procedure or entry.profile or "imported",
        parameters={"condition": entry.condition, "power_on_s": entry.power_on_s},
        mounting="axis_up" if abs(entry.elevation_deg) > 45.0 else "axis_horizontal",
        outcome="completed",
        reason="imported",
        started_utc=started,
        ended_utc=ended.isoformat(timespec="milliseconds"),
        duration_s=duration_s,
        bench={
            "bench": {"name": mapping.bench, "latitude_deg": mapping.latitude_deg},
            "gyro": [
                {"name": mapping.gyro, "unit": mapping.unit_id, "axis": mapping.axis, "driver": "imported"}
            ],
        },
        devices={
            mapping.gyro: DeviceEntry(
                kind="imported",
                role="gyro",
                maker=mapping.maker,
                model=mapping.model,
                serial_number=mapping.unit_id,
                axis=mapping.axis,
                case_sensor=_CASE_SENSOR if mapping.columns.t_out else None,
            )
        },
        units={mapping.gyro: mapping.unit_id},
        imported=Imported(log=f"raw/{log}", mapping=f"raw/{_MAPPING}"),
        software={"python": platform.python_version(), "gyrobench": version("gyrobench")},
        stream={name: vars(report) for name, report in streams.items()},
        measurements=(dict(vars(azimuth)),),
    )
    seal(folder, manifest)


def _write_tables(out: Path, mapping: Mapping, entry: LogEntry, data: Log) -> dict[str, StreamReport]:
    """Write gyro, turntable and chamber tables; bench time starts with the first row."""
    time_s = data.time_s - data.time_s[0]
    columns = data.columns
    report = _write_gyro(out / f"gyro_{mapping.gyro}.parquet", mapping.gyro, time_s, data)
    grid_s = np.append(np.arange(0.0, time_s[-1]), time_s[-1])
    if "angle" in columns or entry.angle_deg is not None:
        angle = np.full(len(grid_s), entry.angle_deg or 0.0)
        if "angle" in columns:
            angle = _on(grid_s, time_s, columns["angle"])
        rate = np.gradient(angle, grid_s)
        if "table_rate" in columns:
            rate = _on(grid_s, time_s, columns["table_rate"])
        with table_writer(out / "turntable.parquet", "turntable, imported") as writer:
            writer.write({"time_ns": _ns(grid_s), "angle_deg": np.mod(angle, 360.0), "rate_dps": rate})
    names = {"air": "air_temp_c", "set_point": "set_point_c", "t_out": f"aux_{_CASE_SENSOR}_temp_c"}
    chamber = {name: _on(grid_s, time_s, columns[key]) for key, name in names.items() if key in columns}
    if chamber:
        with table_writer(out / "chamber.parquet", "chamber, imported") as writer:
            writer.write({"time_ns": _ns(grid_s), **chamber})
    return {mapping.gyro: report}


def _write_gyro(path: Path, gyro: str, time_s: Array, data: Log) -> StreamReport:
    rate = data.columns["output"]
    valid = np.isfinite(rate)
    if "valid" in data.columns:
        valid &= np.nan_to_num(data.columns["valid"]) != 0.0
    step = np.diff(time_s)
    period_s = float(np.median(step))
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
                "valid": valid,
                "rate_dps": rate.astype(np.float32),
                "temp_c": data.columns.get("t_in", np.full(len(time_s), np.nan)).astype(np.float32),
            }
        )
    return StreamReport(
        frames=len(time_s),
        lost=int(lost.sum()),
        invalid=int((~valid).sum()),
        sample_rate_hz=1.0 / period_s,
        warnings=("imported: lost samples are gaps in the time column",),
    )


def _on(grid_s: Array, time_s: Array, values: Array) -> Array:
    """Return values on a grid, missing ones bridged; all NaN stays so."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(grid_s), np.nan)
    return np.asarray(np.interp(grid_s, time_s[known], values[known]))


def _ns(time_s: Array) -> NDArray[np.int64]:
    return np.rint(time_s * 1e9).astype(np.int64)


def _started(entry: LogEntry, where: Path) -> str:
    """Return when the recording began; now where the mapping does not say."""
    if not entry.started_utc:
        return utc_now()
    try:
        if not 1970 <= datetime.fromisoformat(entry.started_utc).year < 3000:
            raise ValueError("no year of a recording")
    except ValueError as error:
        raise ConfigurationError(
            "started_utc is no date and time", where=str(where), found=entry.started_utc, expected="ISO 8601"
        ) from error
    return entry.started_utc
