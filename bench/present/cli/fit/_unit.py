"""`gyrobench fit standard-test` and `calibration`: figures of a unit, and the 24 parameters of an IMU."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table
from typer import Argument, BadParameter, Context, Option

from bench.present.cli._console import Terminal
from bench.present.cli._options import (
    Arw,
    FitFolder,
    FittedRuns,
    Gravity,
    GyroToFit,
    Json,
    VelocityNoise,
    Vrw,
)
from bench.present.cli.fit._by_hand import by_hand
from drivers.base.clock import utc_now

if TYPE_CHECKING:
    from bench.analysis.calibration import Calibration, Estimate
    from bench.analysis.figures import Figure
    from bench.present.report import CalibrationContent


def standard_test(
    runs: FittedRuns,
    gyro: GyroToFit = None,
    out: Annotated[Path, Option(help="HTML report")] = Path("standard-test.html"),
    as_json: Json = False,
) -> None:
    """Work out the figures of the standards from standard tests.

    They are bias, noise, scale factor, threshold, temperature sensitivity and others.

    Several runs are several power-ons: bias and scale-factor repeatability are then computed over them.
    """
    from bench.analysis.figures import figures_of_unit
    from bench.present.report import standard_test_page, write_report
    from bench.record.recording import Run

    console = Terminal(as_json=as_json)
    results, over_runs = figures_of_unit(runs, gyro)
    manifests = [Run.open(folder).manifest for folder in runs]
    warnings = [f"Run {m.run_id} is {m.outcome}: {m.reason}" for m in manifests if m.outcome != "completed"]
    bench_name = str(manifests[0].bench["bench"]["name"])
    page = standard_test_page(
        results, over_runs, created_utc=utc_now(), bench_name=bench_name, warnings=warnings
    )
    write_report(out, page)
    for result in results:
        _print_figures(console, result.run_id, result.figures)
        for what, why in result.missing:
            console.say(f"{result.run_id}: no {what}. {why}", style="yellow")
    if over_runs:
        _print_figures(console, "over runs", over_runs)
    console.say(f"{out}")
    by_run = [
        {
            "run_id": result.run_id,
            "figures": result.figures,
            "missing": dict(result.missing),
            "uncertainty": {figure.name: _uncertainty(figure) for figure in result.figures},
        }
        for result in results
    ]
    console.say_json("result", runs=by_run, over_runs=over_runs, warnings=warnings, file=out)


def _uncertainty(figure: Figure) -> dict[str, float] | None:
    keys = ("combined", "freedom", "k", "expanded", "half_width")
    return None if figure.budget is None else {key: getattr(figure.budget, key) for key in keys}


def _print_figures(console: Terminal, title: str, figures: Sequence[Figure]) -> None:
    rows = []
    for figure in figures:
        known = figure.low is not None and figure.high is not None
        digits = max(3, figure.digits)
        interval = f"{figure.low:.{digits}g} .. {figure.high:.{digits}g}" if known else ""
        value = f"{figure.value:.{figure.digits}g}"
        if figure.bound is not None:
            value = f"not seen above {float(f'{figure.bound:.2g}'):g}"
        rows.append((figure.name, value, figure.unit, interval))
    console.table(("figure", "value", "unit", "95 % interval"), rows, title)


def calibration(
    record: Annotated[
        Path,
        Argument(
            help="run folder of system-calibration; or of another bench an imported run, a mapping file, or a "
            "log with columns time_s, gyro_x_dps .. and accelerometer_x_mps2 .."
        ),
    ],
    scheme: Annotated[str | None, Option(help="scheme that was turned; a run says it itself")] = None,
    gyro: GyroToFit = None,
    out: FitFolder = Path("calibration"),
    dwell_s: Annotated[float, Option(help="rest after every turn; a run says it itself")] = 180.0,
    latitude_deg: Annotated[float | None, Option(help="latitude of the bench; a run says it itself")] = None,
    gravity_mps2: Gravity = None,
    arw: Arw = 0.001,
    vrw: Vrw = 10.0,
    velocity_noise_mps: VelocityNoise = 1e-3,
    wander_dph: Annotated[float, Option(help="gyro bias wander, deg/h; 0: none")] = 0.0,
    wander_ug: Annotated[float, Option(help="accelerometer bias wander, ug; 0: none")] = 0.0,
    prior_scale: Annotated[
        float,
        Option(help="how many times larger the unit's errors may be than a navigation-grade unit's, to 30"),
    ] = 1.0,
    lever_arms: Annotated[bool, Option("--lever-arms", help="estimate inner lever arms and lag")] = False,
    range_dps: Annotated[float | None, Option(help="measuring range of the gyros, deg/s")] = None,
    as_told: Annotated[
        bool, Option("--as-told", help="keep the noise that was told, whatever the record shows")
    ] = False,
    after: Annotated[
        list[Path] | None,
        Option(
            help="calibration of the unit by another run (.gyrocomp), to be taken together; once for each"
        ),
    ] = None,
    hand: Annotated[
        bool, Option("--by-hand", help="the unit was turned by hand; the record is a mapping file (TOML)")
    ] = False,
    turn_deg: Annotated[
        float | None, Option(help="with --by-hand: angle of the turns that are about as large")
    ] = None,
    as_json: Json = False,
    context: Context = None,  # type: ignore[assignment]  # Typer passes it
) -> None:
    """Calibrate an IMU from the record of a rotation scheme.

    With --by-hand from a log in which it was turned by hand.
    """
    if hand:
        own = ("record", "out", "gravity_mps2", "hand", "turn_deg", "as_json")
        if given := [name for name in _given(context) if name not in own]:
            names = ", ".join("--" + name.replace("_", "-") for name in given)
            raise BadParameter(f"{names}: not with --by-hand, whose mapping file says what is known")
        by_hand(Terminal(as_json=as_json), record, out, gravity=gravity_mps2, turn_deg=turn_deg)
        return
    if turn_deg is not None:
        raise BadParameter("--turn-deg goes with --by-hand")
    from bench.analysis.calibration import (
        DPH_RAD_S,
        BiasWander,
        ImuCompensation,
        Noise,
        calibrate,
        load_record,
    )
    from bench.present.report import CalibrationContent
    from drivers.base.constants import UG_MPS2

    run = load_record(record, scheme=scheme, gyro=gyro, dwell_s=dwell_s, latitude_deg=latitude_deg)
    wander = None
    if wander_dph > 0.0 or wander_ug > 0.0:
        wander = BiasWander(wander_dph * DPH_RAD_S, wander_ug * UG_MPS2, 1000.0)
    console = Terminal(as_json=as_json)
    with console.status(f"{len(run.increments.angle_rad):,} samples"):
        result = calibrate(
            run,
            Noise(arw, vrw, velocity_noise_mps),
            gravity_mps2=gravity_mps2,
            wander=wander,
            lever_arms=lever_arms,
            range_dps=range_dps,
            as_told=as_told,
            earlier=[ImuCompensation.load(path) for path in after or ()],
            prior_scale=prior_scale,
        )
        content = CalibrationContent(
            result.evaluation,
            result.estimate,
            run.truth,
            utc_now(),
            run=run,
            wander=result.wander,
            noise=result.noise,
            corrected=result.corrected,
            budgets=result.budgets,
            inflation=result.inflation,
        )
    _keep(console, out, result, content)


def _given(context: Context | None) -> list[str]:
    """Return the options that were typed on the command line; none where a program calls."""
    if context is None:
        return []
    sources = {name: context.get_parameter_source(name) for name in context.params}
    return [name for name, source in sources.items() if source is not None and source.name == "COMMANDLINE"]


def _keep(console: Terminal, out: Path, result: Calibration, content: CalibrationContent) -> None:
    """Write compensation, figures and page of a calibration, and say what it found."""
    from bench.analysis.common.state_file import save_file, saved_together
    from bench.present.report import calibration_page, write_report

    compensation = result.compensation((*content.poorly_seen, *content.warnings))
    with saved_together(out) as part:
        compensation.save(part / "compensation.gyrocomp")
        save_file(part / "calibration.json", json.dumps(compensation.describe(), indent=2))
        write_report(part / "report.html", calibration_page(content))
    _print(console, result.estimate, content)
    console.say(f"{out}/compensation.gyrocomp, calibration.json, report.html")
    console.say_json(
        "result",
        compensation=compensation.describe(),
        uncertainty={name: budget.half_width for name, budget in content.budgets.items()},
        innovation_rms=result.estimate.innovation_rms,
        inflation={
            "factor": result.inflation.factor,
            "hours": result.inflation.hours,
            **dict(zip(result.inflation.errors, result.inflation.factors.tolist(), strict=True)),
        },
        innovations={"told": result.noise.innovations, "expected": result.noise.expected},
        poorly_seen=content.poorly_seen,
        warnings=content.warnings,
        folder=out,
    )


def _print(console: Terminal, estimate: Estimate, content: CalibrationContent) -> None:
    from bench.analysis.calibration import PARAMETER_NAMES, STATE_UNITS, UNIT_SIZE

    heads = ["parameter", "estimate", "sigma", "target", "unit"]
    grid = Table(*heads, *(["truth", "error/sigma"] if content.truth is not None else []))
    for number, name in enumerate(PARAMETER_NAMES):
        unit = UNIT_SIZE[6 + number]
        value, sigma = estimate.parameters[number] / unit, estimate.sigma[number] / unit
        target = float(content.target[6 + number])
        cells = [name, f"{value:.4f}", f"{sigma:.4f}", f"{target:g}", STATE_UNITS[6 + number]]
        if content.truth is not None:
            truth = float(content.values["Truth"][number])
            cells += [f"{truth:.4f}", f"{(value - truth) / sigma:+.2f}"]
        grid.add_row(*cells, style="red" if sigma > target else "")
    console.print(grid)
    console.say(f"innovations rms {estimate.innovation_rms:.3f} (1 if the noise is as assumed)")
    if (noise := content.noise) is not None:
        told, due = (sum(rms**2 for rms in part) ** 0.5 for part in (noise.innovations, noise.expected))
        count = len(noise.expected) ** 0.5
        console.say(
            f"with the noise told {told / count:.2f}; the schedule predicts {due / count:.2f} on this table"
        )
    if content.inflation is not None:
        console.say(
            f"for {content.inflation.hours[-1]:g} h of navigation a filter has to take the noise "
            f"{content.inflation.factor:.1f} times as large"
        )
    console.say_all(f"poorly seen: {text}" for text in content.poorly_seen)
    console.say_all(f"note: {text}" for text in content.warnings)
