"""A run for other software: tables as CSV, Parquet or one MDF4 file, recorded CAN frames as BLF."""

from __future__ import annotations

import heapq
import json
import shutil
import tempfile
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from bench.record.exchange._table import load_asammdf
from bench.record.recording import Run, unit_of
from drivers.base.errors import ConfigurationError, RecordError

_AT_ONCE = 65_536


def export_run(folder: Path, kind: str, out: Path | None = None) -> Path:
    """Write a run in another format and return where.

    `kind`: csv, mdf4, blf or parquet. `out`: a folder for csv and parquet (a file a table and one of events), a
    file for mdf4 and blf; default the run's name in the working directory. It must not exist, and is there
    whole or not at all. ConfigurationError for a format or a run that has nothing for it, RecordError for a
    file that cannot be written.
    """
    if kind not in _FORMATS:
        raise ConfigurationError("no such export format", found=kind, expected=", ".join(_FORMATS))
    run, (suffix, write) = Run.open(folder), _FORMATS[kind]
    target = out or Path(f"{run.manifest.run_id}{suffix}")
    if target.exists():
        raise ConfigurationError(
            "there is a file or folder of that name", where=str(target), remedy="name another with --out"
        )
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".exporting-", dir=target.parent) as scratch:
            part = Path(scratch) / f"export{suffix}"
            write(run, part)
            part.rename(target)
    except OSError as error:
        raise RecordError("the export cannot be written", where=str(target), found=str(error)) from error
    return target


def _tables(run: Run) -> list[Path]:
    if not run.tables:
        raise ConfigurationError(
            "the run has no decoded tables to export",
            where=str(run.place),
            remedy="`gyrobench runs verify` says what its raw bytes give",
        )
    return [run.file(f"{name}.parquet") for name in run.tables]


def _events(run: Run) -> pa.Table:
    """Return the events as (time_s, kind, fields): fields differ by kind and stay JSON."""
    rows = run.events
    facts = [{key: value for key, value in row.items() if key not in ("time_s", "kind")} for row in rows]
    return pa.table(
        {
            "time_s": pa.array([float(row["time_s"]) for row in rows], pa.float64()),
            "kind": pa.array([_cell(row["kind"]) for row in rows], pa.string()),
            "fields": pa.array([json.dumps(fact, ensure_ascii=False) for fact in facts], pa.string()),
        }
    )


def _cell(kind: object) -> str:
    """Return text that a spreadsheet does not take for a formula; JSON begins with a brace anyway."""
    text = str(kind)
    return text if text[:1].isalnum() else f"'{text}"


def _csv(run: Run, part: Path) -> None:
    part.mkdir()
    for path in _tables(run):
        with (
            pq.ParquetFile(path) as file,
            pyarrow.csv.CSVWriter(part / f"{path.stem}.csv", file.schema_arrow) as out,
        ):
            for batch in file.iter_batches(_AT_ONCE):
                out.write_batch(batch)
    pyarrow.csv.write_csv(_events(run), part / "events.csv")


def _parquet(run: Run, part: Path) -> None:
    part.mkdir()
    for path in _tables(run):
        shutil.copyfile(path, part / path.name)
    pq.write_table(_events(run), part / "events.parquet")


def _mdf4(run: Run, part: Path) -> None:
    """One channel group a table, named after it, and one of phases; times are bench time in s."""
    asammdf = load_asammdf()
    with asammdf.MDF(version="4.10") as mdf:
        mdf.start_time = datetime.fromisoformat(run.manifest.started_utc)
        for path in _tables(run):
            table = pq.read_table(path, use_threads=False)
            columns: dict[str, Any] = {name: table[name].to_numpy() for name in table.column_names}
            time_s = columns.pop("time_ns").astype(np.float64) * 1e-9
            signals = [
                asammdf.Signal(
                    samples=values.astype(np.uint8) if values.dtype == np.bool_ else values,
                    timestamps=time_s,
                    name=f"{path.stem}.{name}",
                    unit="" if unit_of(name) == "1" else unit_of(name),
                )
                for name, values in columns.items()
            ]
            mdf.append(signals, acq_name=path.stem, common_timebase=True)
        phases = run.phases()
        if phases:
            names = list(dict.fromkeys(phase.name for phase in phases))
            conversion: dict[str, Any] = {}
            for number, name in enumerate(names):
                conversion |= {f"val_{number}": number, f"text_{number}": name.encode()}
            conversion["default"] = b""
            signal = asammdf.Signal(
                samples=np.array([names.index(phase.name) for phase in phases], np.uint8),
                timestamps=np.array([phase.start_s for phase in phases], np.float64),
                name="phase",
                conversion=conversion,
            )
            mdf.append([signal], acq_name="phases", common_timebase=True)
        facts = run.manifest.model_dump_json(exclude={"files", "bench"})
        mdf.attach(facts.encode("utf-8"), file_name="manifest.json", mime="application/json")
        mdf.save(part, overwrite=True)


def _blf(run: Run, part: Path) -> None:
    """Write the frames of every gyro on CAN, a channel each in the order of the bench file."""
    import can

    on_can = [section["name"] for section in run.manifest.bench.get("gyro", ()) if section.get("channel")]
    if not on_can:
        raise ConfigurationError(
            "the run has no gyro on CAN",
            where=str(run.place),
            found=", ".join(run.manifest.units),
            expected="a gyro with interface and channel in the bench file",
            remedy="export csv, parquet or mdf4",
        )
    started_s = datetime.fromisoformat(run.manifest.started_utc).timestamp()
    with can.BLFWriter(part) as writer:
        streams = [_messages(run, name, number, started_s) for number, name in enumerate(on_can)]
        for message in heapq.merge(*streams, key=lambda message: message.timestamp):
            writer.on_message_received(message)


def _messages(run: Run, port: str, channel: int, started_s: float) -> Iterator[Any]:
    from drivers.slcan import to_messages

    for frames, time_s in run.can_frames(port):
        for message in to_messages(frames, time_s + started_s):
            message.channel = channel
            yield message


_FORMATS = {
    "csv": ("-csv", _csv),
    "mdf4": (".mf4", _mdf4),
    "blf": (".blf", _blf),
    "parquet": ("-parquet", _parquet),
}
"""Format: how the default name of what is written ends, and who writes it."""
