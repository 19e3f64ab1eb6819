"""`gyrobench calibrate`: from the record of a schedule to 24 parameters, a calibration file and a report."""

from __future__ import annotations

import csv
import hashlib
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table as Grid

from bench.analysis.calibration import (
    DPH_RAD_S,
    PARAMETER_NAMES,
    STATE_UNITS,
    UNIT_SIZE,
    BiasWander,
    CalibrationRun,
    Estimate,
    ImuCompensation,
    Increments,
    Noise,
    Options,
    Site,
    Task,
    estimate,
    evaluate,
    load_calibration_run,
    load_scheme,
)
from bench.analysis.common.state_file import save_file, saved_together
from bench.present.cli._console import Terminal
from bench.present.report import CalibrationContent, calibration_content, render_calibration, write_report
from drivers.base.clock import utc_now
from drivers.base.constants import UG_MPS2
from drivers.base.errors import ConfigurationError, RecordError

_COLUMNS = [f"gyro_{axis}_dps" for axis in "xyz"] + [f"accelerometer_{axis}_mps2" for axis in "xyz"]
_PERIOD_TOLERANCE = 0.1


def calibrate_command(
    record: Path,
    scheme: str | None,
    out: Path,
    *,
    noise: Noise,
    gyro: str | None = None,
    dwell_s: float = 180.0,
    latitude_deg: float | None = None,
    gravity_mps2: float | None = None,
    wander_dph: float = 0.0,
    wander_ug: float = 0.0,
    lever_arms: bool = False,
    range_dps: float | None = None,
) -> None:
    """Estimate the parameters of a run folder or a CSV record; write compensation.gyrocomp, calibration.json and
    report.html into `out`.

    A CSV record has columns time_s, gyro_x_dps .. and accelerometer_x_mps2 .., means over each sample at a
    constant rate, and needs `scheme` and `latitude_deg`. RecordError says what makes a record unusable.
    """
    run = _recorded(record, scheme, gyro, dwell_s, latitude_deg)
    site = Site(latitude_deg=run.latitude_deg, gravity=gravity_mps2)
    task = Task(site=site, noise=noise)
    wander = None
    if wander_dph > 0.0 or wander_ug > 0.0:
        wander = BiasWander(wander_dph * DPH_RAD_S, wander_ug * UG_MPS2, 1000.0)
    options = Options(
        wander=wander,
        lever_arms=lever_arms,
        alignment_s=min(60.0, 0.8 * run.schedule.dwell_s),
        gyro_range_dps=range_dps,
    )
    console = Terminal()
    with console.status(f"{len(run.increments.angle_rad):,} samples, {options.passes} passes"):
        found = estimate(run.increments, task, options, run.schedule)
        evaluation = evaluate(task, run.schedule, run.table)
        content = calibration_content(evaluation, found, run.truth, utc_now(), run=run, wander=wander)
    compensation = ImuCompensation.from_estimate(
        found,
        unit_id=run.unit_id,
        scheme=run.schedule.name,
        runs={run.run_id: run.checksum},
        declared=(*content.poorly_seen, *content.warnings),
    )
    with saved_together(out) as part:
        compensation.save(part / "compensation.gyrocomp")
        save_file(part / "calibration.json", json.dumps(compensation.describe(), indent=2))
        write_report(part / "report.html", render_calibration(content))
    _print(console, found, content)
    console.print(f"{out}/compensation.gyrocomp, calibration.json, report.html", highlight=False)


def _recorded(
    record: Path, scheme: str | None, gyro: str | None, dwell_s: float, latitude_deg: float | None
) -> CalibrationRun:
    """Return what a run folder holds, or a CSV record with what the command line says of it."""
    if record.is_dir():
        run = load_calibration_run(record, gyro)
        return run if latitude_deg is None else replace(run, latitude_deg=latitude_deg)
    if scheme is None or latitude_deg is None:
        raise ConfigurationError(
            "a CSV record does not say what was turned where",
            where=str(record),
            found="--scheme " + (scheme or "left out"),
            expected="--scheme and --latitude-deg, and --dwell-s if it was not 180",
            remedy="a run folder of `gyrobench run system-calibration` says it itself",
        )
    schedule = load_scheme(scheme).with_(dwell_s=dwell_s)
    return CalibrationRun(
        run_id=record.stem,
        checksum=hashlib.sha256(record.read_bytes()).hexdigest() if record.is_file() else "",
        gyro=gyro or record.stem,
        unit_id=gyro or record.stem,
        latitude_deg=latitude_deg,
        increments=read_increments(record),
        schedule=schedule,
        table="by-hand",
        mounting="",
        turn_s=(),
        truth=None,
    )


def read_increments(path: Path) -> Increments:
    """Read a CSV record; RecordError names missing columns, text that is no number, and gaps in time."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            header = [name.strip() for name in next(csv.reader(file), [])]
            missing = [name for name in ("time_s", *_COLUMNS) if name not in header]
            if missing:
                raise RecordError(
                    "columns are missing", where=str(path), found=", ".join(missing) + " not there"
                )
            columns = [header.index(name) for name in ("time_s", *_COLUMNS)]
            lines = file.readlines()
        values = np.loadtxt(lines, delimiter=",", usecols=columns, ndmin=2) if lines else np.empty((0, 7))
    except (OSError, ValueError) as error:
        raise RecordError("the record cannot be read", where=str(path), found=str(error)) from error
    if len(values) < 2:
        raise RecordError("the record is empty", where=str(path))
    steps = np.diff(values[:, 0])
    period = float((values[-1, 0] - values[0, 0]) / (len(values) - 1))
    late = np.flatnonzero(np.abs(steps - np.median(steps)) > _PERIOD_TOLERANCE * np.median(steps))
    if len(late):
        raise RecordError(
            "samples are missing",
            where=f"{path}, {values[late[0], 0]:.3f} s",
            found=f"{len(late)} irregular steps of time, the first of {steps[late[0]]:.4g} s",
            expected=f"{np.median(steps):.4g} s: a lost increment of a turn cannot be made up",
            remedy="run the schedule again",
        )
    return Increments(period, values[:, 1:4] * math.radians(period), values[:, 4:7] * period)


def _print(console: Console, found: Estimate, content: CalibrationContent) -> None:
    heads = ["parameter", "estimate", "sigma", "target", "unit"]
    grid = Grid(*heads, *(["truth", "error/sigma"] if content.truth is not None else []))
    for number, name in enumerate(PARAMETER_NAMES):
        size = UNIT_SIZE[6 + number]
        value, sigma = found.parameters[number] / size, found.sigma[number] / size
        target = float(content.target[6 + number])
        cells = [name, f"{value:.4f}", f"{sigma:.4f}", f"{target:g}", STATE_UNITS[6 + number]]
        if content.truth is not None:
            truth = float(content.truth[number])
            cells += [f"{truth:.4f}", f"{(value - truth) / sigma:+.2f}"]
        grid.add_row(*cells, style="red" if sigma > target else "")
    console.print(grid)
    console.print(
        f"innovations rms {found.innovation_rms:.3f} (1 if the noise is as assumed)", highlight=False
    )
    for text in content.poorly_seen:
        console.print(f"poorly seen: {text}", highlight=False)
    for text in content.warnings:
        console.print(f"note: {text}", highlight=False)
