"""`gyrobench fit calibration`: from the record of a scheme to 24 parameters, a calibration file and a report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.present.cli._options import Arw, FitFolder, Gravity, GyroToFit, VelocityNoise, Vrw

if TYPE_CHECKING:
    from bench.analysis.calibration import Estimate
    from bench.present.cli._console import Terminal
    from bench.present.report import CalibrationContent


def calibration(
    record: Annotated[
        Path, typer.Argument(help="run folder of system-calibration, or increments of the IMU (CSV)")
    ],
    scheme: Annotated[str | None, typer.Option(help="scheme that was turned; a run says it itself")] = None,
    gyro: GyroToFit = None,
    out: FitFolder = Path("calibration"),
    dwell_s: Annotated[float, typer.Option(help="rest after every turn; a run says it itself")] = 180.0,
    latitude_deg: Annotated[
        float | None, typer.Option(help="latitude of the bench; a run says it itself")
    ] = None,
    gravity_mps2: Gravity = None,
    arw: Arw = 0.001,
    vrw: Vrw = 10.0,
    velocity_noise_mps: VelocityNoise = 1e-3,
    wander_dph: Annotated[float, typer.Option(help="gyro bias wander, deg/h; 0: none")] = 0.0,
    wander_ug: Annotated[float, typer.Option(help="accelerometer bias wander, ug; 0: none")] = 0.0,
    lever_arms: Annotated[
        bool, typer.Option("--lever-arms", help="estimate inner lever arms and lag")
    ] = False,
    range_dps: Annotated[float | None, typer.Option(help="measuring range of the gyros, deg/s")] = None,
) -> None:
    """System-level calibration of an IMU from the record of a rotation scheme."""
    from bench.analysis.calibration import DPH_RAD_S, BiasWander, Noise, calibrate, load_record
    from bench.analysis.common.state_file import save_file, saved_together
    from bench.present.cli._console import Terminal
    from bench.present.report import calibration_content, calibration_page, write_report
    from drivers.base.clock import utc_now
    from drivers.base.constants import UG_MPS2

    run = load_record(record, scheme=scheme, gyro=gyro, dwell_s=dwell_s, latitude_deg=latitude_deg)
    wander = None
    if wander_dph > 0.0 or wander_ug > 0.0:
        wander = BiasWander(wander_dph * DPH_RAD_S, wander_ug * UG_MPS2, 1000.0)
    console = Terminal()
    with console.status(f"{len(run.increments.angle_rad):,} samples"):
        result = calibrate(
            run,
            Noise(arw, vrw, velocity_noise_mps),
            gravity_mps2=gravity_mps2,
            wander=wander,
            lever_arms=lever_arms,
            range_dps=range_dps,
        )
        content = calibration_content(
            result.evaluation, result.estimate, run.truth, utc_now(), run=run, wander=wander
        )
    compensation = result.compensation((*content.poorly_seen, *content.warnings))
    with saved_together(out) as part:
        compensation.save(part / "compensation.gyrocomp")
        save_file(part / "calibration.json", json.dumps(compensation.describe(), indent=2))
        write_report(part / "report.html", calibration_page(content))
    _print(console, result.estimate, content)
    console.say(f"{out}/compensation.gyrocomp, calibration.json, report.html")


def _print(console: Terminal, estimate: Estimate, content: CalibrationContent) -> None:
    from rich.table import Table

    from bench.analysis.calibration import PARAMETER_NAMES, STATE_UNITS, UNIT_SIZE

    heads = ["parameter", "estimate", "sigma", "target", "unit"]
    grid = Table(*heads, *(["truth", "error/sigma"] if content.truth is not None else []))
    for number, name in enumerate(PARAMETER_NAMES):
        unit = UNIT_SIZE[6 + number]
        value, sigma = estimate.parameters[number] / unit, estimate.sigma[number] / unit
        target = float(content.target[6 + number])
        cells = [name, f"{value:.4f}", f"{sigma:.4f}", f"{target:g}", STATE_UNITS[6 + number]]
        if content.truth is not None:
            truth = float(content.truth[number])
            cells += [f"{truth:.4f}", f"{(value - truth) / sigma:+.2f}"]
        grid.add_row(*cells, style="red" if sigma > target else "")
    console.print(grid)
    console.say(f"innovations rms {estimate.innovation_rms:.3f} (1 if the noise is as assumed)")
    for text in content.poorly_seen:
        console.say(f"poorly seen: {text}")
    for text in content.warnings:
        console.say(f"note: {text}")
