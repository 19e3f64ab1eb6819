"""The commands `gyrobench fit ...`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from bench.present.cli._options import Cluster, Jobs

app = typer.Typer(name="fit", help="Fit compensations to recorded runs.", no_args_is_help=True)
Runs = Annotated[list[Path], typer.Argument(help="run folders to fit on")]
Test = Annotated[list[Path] | None, typer.Option("--test", help="run folder that judges; repeat for several")]
GyroName = Annotated[str | None, typer.Option(help="gyro to fit; default the first of the runs")]
Out = Annotated[Path, typer.Option(help="folder for the compensation and the report")]


@app.command("cold-shock")
def fit_cold_shock(
    runs: Runs,
    validate: Annotated[
        list[Path] | None, typer.Option("--validate", help="run folder that chooses between models")
    ] = None,
    test: Test = None,
    gyro: GyroName = None,
    out: Out = Path("fit"),
    models: Annotated[
        str | None, typer.Option(help="models to fit, separated by commas; default all")
    ] = None,
    jobs: Jobs = None,
    cluster: Cluster = None,
) -> None:
    """Fit bias and scale-factor models to cold shocks, choose on the validation runs, judge on the test runs."""
    from bench.present.cli._fit import fit_command

    fit_command(runs, validate or [], test or [], gyro, out, models, jobs, cluster)


@app.command("stepwise")
def fit_stepwise(
    runs: Runs,
    test: Test = None,
    gyro: GyroName = None,
    out: Out = Path("stepwise"),
    variables: Annotated[
        str | None, typer.Option(help="candidate variables, separated by commas; default the paper's eleven")
    ] = None,
    p_enter: Annotated[float, typer.Option(help="p below which a variable enters")] = 0.05,
    p_remove: Annotated[float, typer.Option(help="p above which a variable leaves")] = 0.10,
) -> None:
    """Stepwise regression of a ring-laser gyro's bias over temperature, judged on the test runs."""
    from bench.present.cli._stepwise import stepwise_command

    stepwise_command(runs, test or [], gyro, out, variables, p_enter, p_remove)


@app.command("chamber-cycle")
def fit_chamber_cycle(
    log: Annotated[Path, typer.Argument(help="tab-separated table: imu.gyro.x|y|z, imu.temperature")],
    out: Annotated[Path, typer.Option(help="HTML report")] = Path("chamber-cycle.html"),
) -> None:
    """Regression over temperature on a recorded chamber cycle, judged axis by axis on its last leg."""
    from bench.present.cli._cycle import cycle_command

    cycle_command(log, out)


@app.command("standard-test")
def fit_standard(
    runs: Runs,
    gyro: GyroName = None,
    out: Annotated[Path, typer.Option(help="HTML report")] = Path("standard-test.html"),
) -> None:
    """Figures of the standards (bias, noise, scale factor, threshold, temperature) from standard-test runs."""
    from bench.present.cli._standard import standard_command

    standard_command(runs, gyro, out)


@app.command("whirl")
def fit_whirl(
    runs: Runs,
    test: Test = None,
    gyro: GyroName = None,
    out: Out = Path("whirl"),
    gauge: Annotated[str, typer.Option(help="how the unobservable constant tilt is fixed")] = "mean",
) -> None:
    """Whirl of a rotating mechanism from gyro and angle, and its compensation of the attitude."""
    from bench.present.cli._whirl import whirl_command

    whirl_command(runs, gyro, out, test or [], gauge)


@app.command("heading-effect")
def fit_heading_effect(
    log: Annotated[Path, typer.Argument(help="log (CSV or Parquet), or run folder, to calibrate on")],
    latitude_deg: Annotated[
        float | None, typer.Option("--latitude-deg", help="latitude of the bench; default the run folder's")
    ] = None,
    longitude_deg: Annotated[
        float | None, typer.Option("--longitude-deg", help="its longitude, east positive; default the run's")
    ] = None,
    test: Test = None,
    out: Out = Path("heading-fit"),
    column: Annotated[
        list[str] | None, typer.Option("--column", help="quantity=column of the log; repeat for several")
    ] = None,
    epoch_s: Annotated[float | None, typer.Option(help="s since 1970 (UTC) at time 0 of the log")] = None,
    damping: Annotated[float, typer.Option(help="damping ratio of the platform's Schuler loop")] = 0.0,
    form: Annotated[
        str, typer.Option(help="lag9 or lag15; the paper's form is always shown beside")
    ] = "lag9",
    window_h: Annotated[float, typer.Option(help="moving window of the paper's form")] = 35.901708,
) -> None:
    """Heading effect of a space-stable platform from position errors and platform temperature."""
    from bench.present.cli._heading import heading_command

    sys.exit(
        heading_command(
            log,
            latitude_deg,
            longitude_deg,
            test or [],
            out,
            column or [],
            epoch_s,
            damping,
            form,
            window_h,
        )
    )


@app.command("calibration")
def fit_calibration(
    record: Annotated[
        Path, typer.Argument(help="run folder of system-calibration, or increments of the IMU (CSV)")
    ],
    scheme: Annotated[str | None, typer.Option(help="scheme that was turned; a run says it itself")] = None,
    gyro: GyroName = None,
    out: Out = Path("calibration"),
    dwell_s: Annotated[float, typer.Option(help="rest after every turn; a run says it itself")] = 180.0,
    latitude_deg: Annotated[
        float | None, typer.Option(help="latitude of the bench; a run says it itself")
    ] = None,
    gravity_mps2: Annotated[float | None, typer.Option(help="gravity; default by latitude")] = None,
    arw: Annotated[float, typer.Option(help="angle random walk, deg/sqrt(h)")] = 0.001,
    vrw: Annotated[float, typer.Option(help="velocity random walk, ug/sqrt(Hz)")] = 10.0,
    velocity_noise_mps: Annotated[float, typer.Option(help="noise of the zero-velocity measurement")] = 1e-3,
    wander_dph: Annotated[float, typer.Option(help="gyro bias wander, deg/h; 0: none")] = 0.0,
    wander_ug: Annotated[float, typer.Option(help="accelerometer bias wander, ug; 0: none")] = 0.0,
    lever_arms: Annotated[
        bool, typer.Option("--lever-arms", help="estimate inner lever arms and lag")
    ] = False,
    range_dps: Annotated[float | None, typer.Option(help="measuring range of the gyros, deg/s")] = None,
) -> None:
    """System-level calibration of an IMU from the record of a rotation scheme."""
    from bench.analysis.calibration import Noise
    from bench.present.cli._calibration import calibrate_command

    calibrate_command(
        record,
        scheme,
        out,
        gyro=gyro,
        dwell_s=dwell_s,
        latitude_deg=latitude_deg,
        gravity_mps2=gravity_mps2,
        noise=Noise(arw, vrw, velocity_noise_mps),
        wander_dph=wander_dph,
        wander_ug=wander_ug,
        lever_arms=lever_arms,
        range_dps=range_dps,
    )
