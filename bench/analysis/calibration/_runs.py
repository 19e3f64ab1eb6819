"""A recorded run of `system-calibration` as the estimator takes it: increments from first dwell to last."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.calibration._conventions import AXES, pack
from bench.analysis.calibration._navigation import Increments
from bench.analysis.calibration._schedule import Schedule, home_attitude, parse_moves
from bench.analysis.calibration._table import Table
from bench.analysis.calibration._turning import table_axes, table_type
from bench.analysis.calibration._whole import LONGEST_S, whole
from bench.analysis.common.statistics import on_grid
from bench.record.benchfile import Calibration, bench_file_from, calibrations_of
from bench.record.events.run import Scheme
from bench.record.recording import Run
from drivers.base.arrays import Array
from drivers.base.errors import RecordError

PROCEDURE = "system-calibration"


@dataclass(frozen=True, eq=False)
class CalibrationRun:
    """What a run holds. `truth` (24,), SI, of an emulated unit, else None; `mounting` as the operator was told.

    `turn_s`: how long each turn really took, settling included. `certificates`: of the bench's instruments.
    `remarks`: what was filled in.
    """

    run_id: str
    checksum: str
    gyro: str
    unit_id: str
    latitude_deg: float
    increments: Increments
    schedule: Schedule
    table: Table
    mounting: str
    turn_s: tuple[float, ...]
    truth: Array | None
    certificates: tuple[Calibration, ...] = ()
    remarks: tuple[str, ...] = ()


def load_calibration_run(folder: Path | str, gyro: str | None = None) -> CalibrationRun:
    """Read a run; RecordError says what keeps it from being one: procedure, outcome, axes, gaps, positions."""
    run = Run.open(folder)
    manifest = run.manifest
    if manifest.procedure != PROCEDURE or manifest.outcome != "completed":
        raise RecordError(
            "not a completed calibration run",
            where=str(folder),
            found=f"{manifest.procedure}, {manifest.outcome}"
            + (f": {manifest.reason}" if manifest.reason else ""),
            expected=f"procedure {PROCEDURE}, outcome completed",
            remedy="run the scheme again; a run that stopped on the way lacks positions",
        )
    file = bench_file_from(manifest.bench)
    name = gyro or file.gyro[0].name
    if name not in {section.name for section in file.gyro}:
        raise RecordError("no such unit in the run", where=str(folder), found=name)
    schedule = _schedule(run)
    section = file.gyro_named(name)
    start_s, end_s, turn_s = _span(run, schedule)
    table = run.gyro(name, start_s=start_s, end_s=end_s)
    rate_hz = manifest.stream.get(name, {}).get("sample_rate_hz")
    if not rate_hz:
        raise RecordError("the unit's stream has no sample rate", where=str(folder), found=name)
    entry, truth = manifest.files.get(f"raw/{name}.bin"), run.truth(name)
    # An emulated unit's K_a is lower triangular, as the gauge has it.
    parts = (
        [truth[key] for key in ("eps_rad_s", "nabla_mps2", "kg", "ka", "k2_s2pm")] if "kg" in truth else []
    )
    increments, remarks = _increments(table, name, section.axis, float(rate_hz))
    return CalibrationRun(
        run_id=manifest.run_id,
        checksum=entry.sha256 if entry else "",
        gyro=name,
        unit_id=section.unit,
        latitude_deg=file.bench.latitude_deg,
        increments=increments,
        schedule=schedule,
        table=table_type(table_axes(file.table)),
        mounting=manifest.mounting,
        turn_s=turn_s,
        truth=pack(*parts) if parts else None,
        certificates=calibrations_of(manifest.bench),
        remarks=remarks,
    )


def _schedule(run: Run) -> Schedule:
    schemes = run.of(Scheme)
    if not schemes:
        raise RecordError(
            "the run does not say which scheme it turned",
            where=str(run.place),
            expected="an event `scheme` in events.jsonl",
        )
    _, scheme = schemes[-1]
    return Schedule(
        name=scheme.name,
        moves=parse_moves(scheme.moves),
        home=home_attitude(scheme.home),
        dwell_s=scheme.dwell_s,
        rate_dps=scheme.rate_dps,
        profile="constant",
        source=scheme.source,
    )


def _span(run: Run, schedule: Schedule) -> tuple[float, float, tuple[float, ...]]:
    """Return start of the first dwell, end of the last, and how long each turn took."""
    phases = run.phases()
    dwells = [phase for phase in phases if phase.name == "dwell"]
    if len(dwells) != schedule.positions:
        raise RecordError(
            "positions are missing from the run",
            where=str(run.place),
            found=f"{len(dwells)} dwells",
            expected=f"{schedule.positions} ({schedule.name})",
            remedy="run the scheme again: what a missing position shows stays at its prior",
        )
    turns = tuple(phase.end_s - phase.start_s for phase in phases if phase.name == "turn")
    return dwells[0].start_s, dwells[-1].end_s, turns


def _increments(
    table: Mapping[str, Any], name: str, axis: str, rate_hz: float
) -> tuple[Increments, tuple[str, ...]]:
    rates = {axis: "rate_dps"} | {other: f"rate_{other}_dps" for other in AXES if other != axis}
    columns = [rates[name] for name in AXES] + [f"accelerometer_{name}_mps2" for name in AXES]
    missing = [column for column in columns if column not in table]
    if missing:
        raise RecordError(
            "the unit is no IMU of three gyros and three accelerometers",
            where=f"gyro {name}",
            found=", ".join(missing) + " not in the record",
            expected='axes = "xyz" in the bench file and a frame with three accelerometers',
        )
    values = np.column_stack([np.asarray(table[column], dtype=np.float64) for column in columns])
    values[~table["valid"]] = np.nan  # marked as faulty by the unit
    lost = np.concatenate(([0], table["lost_before"][1:].astype(np.int64)))
    if lost.max() > LONGEST_S * rate_hz:
        raise RecordError(
            "samples are missing",
            where=f"gyro {name}, {table['time_ns'][lost.argmax()] / 1e9:.2f} s",
            found=f"{lost.max()} of them",
            expected=f"at most {LONGEST_S:g} s, and at rest",
            remedy="check cable, baud rate and load of the host, then run the scheme again",
        )
    even = on_grid(np.arange(len(values)) + np.cumsum(lost), values)
    return increments_of(even[:, :3], even[:, 3:], 1.0 / rate_hz, f"gyro {name}")


def increments_of(
    rates_dps: Array, forces_mps2: Array, period_s: float, where: str
) -> tuple[Increments, tuple[str, ...]]:
    """Return increments of rates and specific forces, (n, 3) each, and what was filled in; errors as `whole`."""
    rates, forces, remarks = whole(rates_dps, forces_mps2, period_s, where)
    return Increments(period_s, np.radians(rates) * period_s, forces * period_s), tuple(remarks)
