"""Logs from CSV and Parquet, and the compensation as one file."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from bench.analysis.common.state_file import read_compensation, write_state
from bench.analysis.heading._frames import earth_rotation_deg
from bench.analysis.heading._lagged import Evidence, LaggedModel
from bench.analysis.heading._log import PlatformLog, log_from_positions
from bench.analysis.heading._temperature import ReferenceTemperature
from bench.record.benchfile import bench_file_from
from bench.record.recording import platform_table_name, read_manifest
from drivers.base.arrays import Array
from drivers.base.constants import SIDEREAL_DAY_S
from drivers.base.errors import RecordError

KIND = "gyrobench heading compensation"
FORMAT = 1
COLUMNS = {
    "time_s": "time_s",
    "latitude_deg": "latitude_deg",
    "longitude_deg": "longitude_deg",
    "temp_c": "temp_c",
    "heading_deg": "heading_deg",
}
"""What a log needs -> the column that has it; `other_temp_c` may be added."""


@dataclass(frozen=True)
class Site:
    """Where the platform stood, geodetic, and how its clock and navigation are.

    `sidereal_zero_deg`: Earth rotation angle at time 0 of the log (`earth_rotation_deg`), None when the log's
    clock is its own. `damping`: ratio of the velocity damping, 0 without.
    """

    latitude_deg: float
    longitude_deg: float
    sidereal_zero_deg: float | None = None
    damping: float = 0.0


def site_of_run(folder: Path, damping: float = 0.0) -> Site:
    """Return where the platform of a run stood: latitude and longitude of its bench file, time by its start.

    An emulated lab's stars stand at its longitude when its time begins, whatever the date. RecordError for a
    folder that is no run of a platform INS.
    """
    manifest = read_manifest(folder)
    path = platform_table(folder)
    sections = bench_file_from(manifest.bench).platform
    section = next(each for each in sections if path.name == platform_table_name(each.name))
    started_s = datetime.fromisoformat(manifest.started_utc).timestamp()
    zero_deg = None if manifest.emulated is not None else earth_rotation_deg(started_s)
    return Site(manifest.latitude_deg, section.longitude_deg, zero_deg, damping)


def platform_table(folder: Path) -> Path:
    """Return the decoded table of a run's platform INS; RecordError if there is none, or more than one."""
    found = sorted(folder.glob(platform_table_name("*")))
    if len(found) != 1:
        raise RecordError(
            "a run folder with one platform INS is needed",
            where=str(folder),
            found=", ".join(path.name for path in found) or "no table of a platform INS",
            expected=f"one {platform_table_name('<name>')}",
            remedy="name the table itself instead of the run folder" if found else "",
        )
    return found[0]


def load_log(
    path: Path, site: Site, columns: Mapping[str, str] | None = None
) -> tuple[PlatformLog, Array | None]:
    """Return (log, other temperature or None) of a .csv (with a header line) or .parquet file or of a run folder.

    `columns` names columns that are not called as in `COLUMNS`; a `time_ns` column serves as time. Empty
    cells are missing values, and so is a position that the unit itself called not valid (a column `valid`; it
    was still aligning). Raises RecordError for a file or column that is not there, or text where a
    number belongs.
    """
    wanted = {**COLUMNS, **(columns or {})}
    if unknown := set(wanted) - {*COLUMNS, "other_temp_c"}:
        raise RecordError(
            "a log has no such quantity",
            found=", ".join(sorted(unknown)),
            expected=", ".join([*COLUMNS, "other_temp_c"]),
        )
    if not path.exists():
        raise RecordError(
            "there is no such log", where=str(path), expected="a .csv or .parquet file, or a run"
        )
    if path.is_dir():
        path = platform_table(path)
        wanted = {"other_temp_c": "cabinet_temp_c", **wanted}
    table = _parquet(path) if path.suffix == ".parquet" else _csv(path)
    if "time_ns" in table and wanted["time_s"] not in table:
        table = {**table, wanted["time_s"]: table["time_ns"] * 1e-9}
    turned = path.parent / "turntable.parquet"
    if wanted["heading_deg"] not in table and "time_ns" in table and turned.exists():
        table = {**table, wanted["heading_deg"]: _table_angle(turned, table["time_ns"])}
    if missing := [name for name in wanted.values() if name not in table]:
        raise RecordError(
            "the log lacks columns",
            where=str(path),
            found=", ".join(table),
            expected=", ".join(missing),
            remedy="name them, e.g. --column temp_c=platform_temperature",
        )
    values = {name: np.asarray(table[column], dtype=np.float64) for name, column in wanted.items()}
    other = values.pop("other_temp_c", None)
    if "valid" in table:
        values = _navigating(values, table["valid"] != 0.0)
        other = None if other is None else other[-len(values["time_s"]) :]
    log = log_from_positions(
        values["time_s"],
        values["latitude_deg"],
        values["longitude_deg"],
        values["temp_c"],
        values["heading_deg"],
        true_latitude_deg=site.latitude_deg,
        true_longitude_deg=site.longitude_deg,
        sidereal_zero_deg=site.sidereal_zero_deg,
        damping=site.damping,
    )
    return log, other


def save_model(path: Path, model: LaggedModel) -> None:
    """Write the compensation to one file."""
    state = {
        "kind": KIND,
        "format": FORMAT,
        "form": model.form,
        "gain_dph_per_k": model.gain,
        "sigma_dph_per_k": model.sigma,
        "tau_s": model.tau_s,
        "reference": asdict(model.reference),
        "reference_heading_deg": model.reference_heading_deg,
        "latitude_deg": model.latitude_deg,
        "largest": model.largest,
        "swing": model.swing,
        "evidence": asdict(model.evidence),
        "headings": model.headings,
        "hours": model.hours,
    }
    write_state(path, state)


def load_model(path: Path) -> LaggedModel:
    """Read a compensation; RecordError if the file is not one."""
    state = read_compensation(path, KIND, FORMAT)
    return LaggedModel(
        form=state["form"],
        gain=state["gain_dph_per_k"],
        sigma=state["sigma_dph_per_k"],
        tau_s=state["tau_s"],
        reference=ReferenceTemperature(**state["reference"]),
        reference_heading_deg=state["reference_heading_deg"],
        latitude_deg=state["latitude_deg"],
        largest=state["largest"],
        swing=state["swing"],
        evidence=Evidence(**state["evidence"]),
        headings=state["headings"],
        hours=state["hours"],
    )


def _navigating(values: Mapping[str, Array], valid: NDArray[np.bool_]) -> dict[str, Array]:
    """Return the rows from a sidereal day before the first valid position on, positions valid or NaN.

    The day before, the last of the alignment, has the reference temperature; what was earlier was warm-up.
    """
    kept = {
        name: np.where(valid, column, np.nan) if name in ("latitude_deg", "longitude_deg") else column
        for name, column in values.items()
    }
    if valid.any():
        begin_s = values["time_s"][np.argmax(valid)] - SIDEREAL_DAY_S
        start = int(np.searchsorted(values["time_s"], begin_s))
        kept = {name: column[start:] for name, column in kept.items()}
    return kept


def _table_angle(path: Path, time_ns: Array) -> Array:
    """Return the table's angle at the last telemetry before each time, deg."""
    turntable = _parquet(path)
    at = np.searchsorted(turntable["time_ns"], time_ns, side="right") - 1
    angle: Array = turntable["angle_deg"][np.clip(at, 0, None)]
    return angle


def _parquet(path: Path) -> dict[str, Array]:
    with pq.ParquetFile(path) as file:
        table = file.read(use_threads=False)
    # Element by element: pyarrow's own conversion of a whole column would import pandas.
    return {
        name: np.array([np.nan if value is None else value for value in table[name].to_pylist()], np.float64)
        for name, kind in zip(table.column_names, table.schema.types, strict=True)
        if str(kind) in _NUMBERS
    }


_NUMBERS = (
    "bool",
    "double",
    "float",
    "halffloat",
    "int8",
    "int16",
    "int32",
    "int64",
    "uint8",
    "uint16",
    "uint32",
    "uint64",
)


def _csv(path: Path) -> dict[str, Array]:
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = list(csv.reader(file))
    if len(rows) < 2:
        raise RecordError("the log is empty", where=str(path), expected="a header line and rows of numbers")
    header = [name.strip() for name in rows[0]]
    columns: dict[str, Array] = {}
    for at, name in enumerate(header):
        try:
            cells = [row[at].strip() for row in rows[1:] if row]
            columns[name] = np.array([float(cell) if cell else np.nan for cell in cells], np.float64)
        except IndexError as error:
            raise RecordError(
                "a line of the log is too short",
                where=str(path),
                found=f"no {name!r} in some line",
                expected=f"{len(header)} cells a line",
            ) from error
        except ValueError:
            continue  # text, e.g. a date: not a quantity of ours unless asked for, and then it is missing
    return columns
