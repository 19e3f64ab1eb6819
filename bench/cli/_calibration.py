"""`gyrobench calibrate`: from the record of a schedule to 24 parameters, a calibration file and a report."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table as Grid

from bench.calibration import (
    DPH_RAD_S,
    PARAMETER_NAMES,
    PARAMETERS,
    STATE_UNITS,
    UG_MPS2,
    UNIT_SIZE,
    BiasWander,
    Estimate,
    Increments,
    Noise,
    Options,
    Site,
    Task,
    estimate,
    evaluate,
    load_scheme,
)
from bench.report import calibration_content, render_calibration, write_report
from drivers.clock import utc_now
from drivers.errors import RecordError

_COLUMNS = [f"gyro_{axis}_dps" for axis in "xyz"] + [f"accelerometer_{axis}_mps2" for axis in "xyz"]
_PERIOD_TOLERANCE = 0.1


def calibrate_command(
    record: Path,
    scheme: str,
    out: Path,
    dwell_s: float = 180.0,
    latitude_deg: float = 45.7796,
    gravity_mps2: float | None = None,
    arw_deg_per_sqrt_h: float = 0.001,
    vrw_ug_per_sqrt_hz: float = 10.0,
    wander_dph: float = 0.0,
    wander_ug: float = 0.0,
    lever_arms: bool = False,
) -> None:
    """Estimate the parameters from a CSV record and write `calibration.json` and `report.html` into `out`.

    The record has columns time_s, gyro_x_dps .. and accelerometer_x_mps2 .., means over each sample at a constant
    rate. RecordError says what makes it unusable.
    """
    schedule = load_scheme(scheme).with_(dwell_s=dwell_s)
    site = Site(latitude_deg=latitude_deg, gravity=gravity_mps2)
    task = Task(site=site, noise=Noise(arw_deg_per_sqrt_h, vrw_ug_per_sqrt_hz))
    wander = None
    if wander_dph > 0.0 or wander_ug > 0.0:
        wander = BiasWander(wander_dph * DPH_RAD_S, wander_ug * UG_MPS2, 1000.0)
    options = Options(wander=wander, lever_arms=lever_arms, alignment_s=min(60.0, 0.8 * dwell_s))
    found = estimate(read_increments(record), task, options, schedule)
    evaluation = evaluate(task, schedule)
    out.mkdir(parents=True, exist_ok=True)
    page = render_calibration(calibration_content(evaluation, found, created_utc=utc_now()))
    write_report(out / "report.html", page)
    (out / "calibration.json").write_text(
        json.dumps(calibration_file(found, scheme), indent=2), encoding="utf-8"
    )
    _print(Console(), found)


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


def calibration_file(found: Estimate, scheme: str) -> dict[str, Any]:
    """Return the calibration as plain values: parameters with unit and sigma, SI covariance, conventions."""
    units, sizes = STATE_UNITS[6:], UNIT_SIZE[PARAMETERS]
    return {
        "format": 1,
        "model": "gyro w~ = (I + K_g) w + eps; accelerometer f~ = (I + K_a) f + nabla + K_2 (f * f)",
        "gauge": "K_a lower triangular: x along accelerometer x, y in the plane of accelerometers x and y",
        "scheme": scheme,
        "parameters": {
            name: {"value": float(value / size), "sigma": float(sigma / size), "unit": unit}
            for name, value, sigma, unit, size in zip(
                PARAMETER_NAMES, found.parameters, found.sigma, units, sizes, strict=True
            )
        },
        "lever_arm_m": found.lever_m.tolist(),
        "accelerometer_lag_s": found.lag_s,
        "innovation_rms": found.innovation_rms,
        "covariance_si": found.covariance.tolist(),
    }


def _print(console: Console, found: Estimate) -> None:
    grid = Grid("parameter", "estimate", "sigma", "unit")
    for number, name in enumerate(PARAMETER_NAMES):
        size = UNIT_SIZE[6 + number]
        value, sigma = found.parameters[number] / size, found.sigma[number] / size
        grid.add_row(name, f"{value:.4f}", f"{sigma:.4f}", STATE_UNITS[6 + number])
    console.print(grid)
    console.print(
        f"innovations rms {found.innovation_rms:.3f} (1 if the noise is as assumed)", highlight=False
    )
