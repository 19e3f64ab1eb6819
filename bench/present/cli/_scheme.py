"""The commands `gyrobench scheme ...`: rotation schemes of the system-level calibration, before the test."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

from rich.table import Table as Grid
from typer import Argument, Option, Typer

from bench.present.cli._console import Terminal
from bench.present.cli._options import Arw, Cluster, Gravity, Jobs, Json, VelocityNoise, Vrw
from bench.present.cli._texts import duration
from drivers.base.errors import ConfigurationError

if TYPE_CHECKING:
    from bench.analysis.calibration import Evaluation, Table, TableAxis, Task

app = Typer(name="scheme", no_args_is_help=True)

_QUICK, _THOROUGH = (8, 300, 2), (16, 800, 6)
"""Beam width, annealing steps and starts of a search."""

SchemeBench = Annotated[
    Path | None,
    Option("--bench", help="bench file: its table and latitude, in place of --table and --latitude-deg"),
]
Dwell = Annotated[float, Option(help="rest after every turn")]
Rate = Annotated[float, Option(help="rate of the turns")]
Latitude = Annotated[float, Option(help="latitude")]
After = Annotated[
    list[str] | None,
    Option(
        help="a run that was made before: its calibration (.gyrocomp), folder or scheme; once for each",
    ),
]


@app.command()
def evaluate(
    scheme: Annotated[str, Argument(help="scheme by name (23-position, 19-position, ...) or turns")],
    table: Annotated[
        str, Option(help="by-hand, two-axis-horizontal, two-axis-vertical, three-axis")
    ] = "by-hand",
    home: Annotated[str | None, Option(help="attitude at the start")] = None,
    dwell_s: Dwell = 180.0,
    rate_dps: Rate = 10.0,
    latitude_deg: Latitude = 45.7796,
    gravity_mps2: Gravity = None,
    arw: Arw = 0.001,
    vrw: Vrw = 10.0,
    velocity_noise_mps: VelocityNoise = 1e-3,
    json: Json = False,
    out: Annotated[Path | None, Option(help="write an HTML report here")] = None,
    bench: SchemeBench = None,
    after: After = None,
) -> None:
    """Predict the accuracy of a scheme before the test.

    It gives the degree of observability and the accuracy of every parameter.

    With a bench file its latitude and table count, and the home that this table really starts from.
    """
    from bench.analysis import calibration
    from bench.present.report import CalibrationContent, calibration_page, write_report
    from drivers.base.clock import utc_now

    schedule = calibration.load_scheme(scheme).with_(
        dwell_s=_positive("dwell", dwell_s), rate_dps=_positive("rate", rate_dps)
    )
    if home is not None:
        schedule = schedule.with_(home=calibration.home_attitude(home, "--home"))
    if bench is not None:
        table, latitude_deg, axes = _of_bench(bench)
        schedule = calibration.plan_turns(schedule, axes).schedule
    task = _task(latitude_deg, gravity_mps2, arw, vrw, velocity_noise_mps)
    task = _after(task, after, dwell_s, rate_dps)
    evaluation = calibration.evaluate(task, schedule, _table(table))
    if out is not None:
        write_report(out, calibration_page(CalibrationContent(evaluation, created_utc=utc_now())))
    if json:
        Terminal(soft_wrap=True).print_json(data=evaluation.as_json())
        return
    _print(Terminal(), evaluation)


@app.command()
def search(
    turns: Annotated[int, Argument(help="turns of the scheme")],
    table: Annotated[str, Option(help="the table that has to turn it")] = "two-axis-horizontal",
    dwell_s: Dwell = 180.0,
    rate_dps: Rate = 10.0,
    latitude_deg: Latitude = 45.7796,
    arw: Arw = 0.001,
    vrw: Vrw = 10.0,
    seed: Annotated[int, Option(help="seed of the annealing")] = 0,
    thorough: Annotated[bool, Option("--thorough", help="search longer")] = False,
    angles: Annotated[
        str, Option(help="angles of the turns, of 90, 180, 270, 360, separated by commas")
    ] = "90",
    out: Annotated[Path | None, Option(help="write the scheme found (TOML) here")] = None,
    bench: SchemeBench = None,
    after: After = None,
    jobs: Jobs = None,
    cluster: Cluster = None,
    as_json: Json = False,
) -> None:
    """Find a better rotation scheme for a table.

    It keeps to the time and the accuracy targets.

    With a bench file what is promised is what this table reaches: each scheme counts from the home that the table
    really starts it from.

    With --after it is the scheme that adds most to the runs that were made before.
    """
    import numpy as np

    from bench.analysis import calibration
    from bench.analysis.common.fan_out import fan_out
    from bench.analysis.common.state_file import save_file

    axes: list[TableAxis] = []
    if bench is not None:
        table, latitude_deg, axes = _of_bench(bench)
    pattern = calibration.Schedule(
        "", (), np.eye(3), _positive("dwell", dwell_s), _positive("rate", rate_dps)
    )
    task = _after(_task(latitude_deg, None, arw, vrw, 1e-3), after, dwell_s, rate_dps)
    if not 2 <= turns <= 40:
        raise ConfigurationError("turns out of range", where="--turns", found=str(turns), expected="2 to 40")
    with fan_out(jobs, cluster) as fan:
        result = calibration.search(
            task,
            turns=turns,
            table=_table(table),
            pattern=pattern,
            effort=calibration.Effort(*(_THOROUGH if thorough else _QUICK)),
            seed=seed,
            angles_deg=_angles(angles),
            fan=fan,
            outer=axes[0].direction if axes else None,
        )
    console = Terminal(as_json=as_json)
    console.say(
        f"{calibration.moves_text(result.schedule.moves)}\nhome: {calibration.home_text(result.schedule.home)}"
    )
    if axes:
        plan = calibration.plan_turns(result.schedule, axes)
        console.say(f"mount with all axes at 0: {plan.mount_text}")
    rows = []
    classical = [calibration.load_scheme(name) for name in ("19-position", "23-position", "t22")]
    for schedule in (result.schedule, *classical):
        timed = schedule.with_(dwell_s=dwell_s, rate_dps=rate_dps)
        length, worst, rms = "", "not on this table", ""
        with suppress(ConfigurationError):
            turned = calibration.plan_turns(timed, axes).schedule if axes else timed
            evaluation = calibration.evaluate(task, turned)
            length = duration(evaluation.schedule.duration_s)
            worst, rms = f"{evaluation.merit.worst:.3f}", f"{evaluation.merit.rms:.3f}"
        rows.append((timed.name, str(len(timed.moves)), length, worst, rms))
    console.table(("scheme", "turns", "time", "worst sigma/target", "rms"), rows)
    console.say(result.statement)
    if out is not None:
        named = result.schedule.with_(name=out.stem, source="gyrobench scheme search", notes=result.statement)
        save_file(out, calibration.scheme_file(named))
        console.say(f"{out}")
    moves, home = calibration.moves_text(result.schedule.moves), calibration.home_text(result.schedule.home)
    heads = ("scheme", "turns", "time", "worst", "rms")
    schemes = [dict(zip(heads, row, strict=True)) for row in rows]
    console.say_json("result", moves=moves, home=home, schemes=schemes, statement=result.statement, file=out)


def _of_bench(path: Path) -> tuple[str, float, list[TableAxis]]:
    """Return type of table, latitude in deg and axes of a bench file."""
    from bench.analysis.calibration import table_axes, table_type
    from bench.record.benchfile import load_bench_file

    file = load_bench_file(path)
    axes = table_axes(file.table)
    return table_type(axes), file.bench.latitude_deg, axes


def _angles(text: str) -> tuple[int, ...]:
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdecimal() for part in parts):
        raise ConfigurationError(
            "not a list of angles", where="--angles", found=repr(text), expected="such as 90,180"
        )
    return tuple(int(part) for part in parts)


def _task(
    latitude_deg: float, gravity: float | None, arw: float, vrw: float, velocity_noise_mps: float
) -> Task:
    from bench.analysis.calibration import Noise, Site, Task

    if not -89.0 <= latitude_deg <= 89.0:
        raise ConfigurationError(
            "no calibration at this latitude",
            where="--latitude",
            found=f"{latitude_deg:g} deg",
            expected="-89 to 89 deg: near a pole the Earth's rate shows no north",
        )
    noise = Noise(
        _positive("arw", arw), _positive("vrw", vrw), _positive("velocity-noise", velocity_noise_mps)
    )
    return Task(site=Site(latitude_deg=latitude_deg, gravity=gravity), noise=noise)


def _after(task: Task, runs: Sequence[str] | None, dwell_s: float, rate_dps: float) -> Task:
    """Return the task of a further run after some: calibrations, run folders, schemes of this dwell and rate."""
    from bench.analysis import calibration

    def told(run: str) -> calibration.Schedule | calibration.ImuCompensation:
        if run.endswith(".gyrocomp"):
            return calibration.ImuCompensation.load(Path(run))
        if Path(run).is_dir():
            return calibration.load_calibration_run(Path(run)).schedule
        return calibration.load_scheme(run).with_(dwell_s=dwell_s, rate_dps=rate_dps)

    return calibration.after(task, [told(run) for run in runs]) if runs else task


def _table(name: str) -> Table:
    from bench.analysis.calibration import TABLES

    if name not in TABLES:
        raise ConfigurationError("no such table", where="--table", found=name, expected=" or ".join(TABLES))
    return cast("Table", name)


def _positive(name: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0.0):
        raise ConfigurationError(f"{name} must be above zero", where=f"--{name}", found=f"{value:g}")
    return value


def _print(console: Terminal, evaluation: Evaluation) -> None:
    from bench.analysis import calibration

    schedule, task = evaluation.schedule, evaluation.task
    console.say(
        f"{schedule.name}: {schedule.positions} positions, {duration(schedule.duration_s)}, home "
        f"{calibration.home_text(schedule.home)}, table {evaluation.table}\n"
        f"{calibration.moves_text(schedule.moves)}"
    )
    grid = Grid(
        "state", "unit", "prior", "sigma", "target", "sigma/target", "gain ratio", "white-noise degree"
    )
    targets = [None] * 6 + list(task.target_sigma)  # the first six states are attitude and velocity
    for number, (name, target) in enumerate(zip(calibration.STATE_NAMES, targets, strict=True)):
        unit, sigma = calibration.UNIT_SIZE[number], evaluation.sigma[number]
        grid.add_row(
            name,
            calibration.STATE_UNITS[number],
            f"{task.prior_sigma[number] / unit:g}",
            f"{sigma / unit:.3g}",
            "" if target is None else f"{target / unit:g}",
            "" if target is None else f"{sigma / target:.2f}",
            f"{evaluation.gain[number]:,.1f}",
            f"{evaluation.degrees.normalised[number]:,.0f}",
            style="red" if target is not None and sigma > target else "",
        )
    console.print(grid)
    console.say(
        f"worst sigma/target {evaluation.merit.worst:.3f}, rms {evaluation.merit.rms:.3f}, rank "
        f"{evaluation.degrees.rank} of {len(calibration.STATE_NAMES)}"
    )
    still = float((evaluation.still_innovations**2).mean() ** 0.5)
    console.say(
        f"innovations to expect: {still:.2f} rms on a table that does not move, 1 if it jitters as told"
    )
    console.say_all(f"poorly seen: {combination}" for combination in evaluation.combinations)
    console.say_all(f"note: {text}" for text in evaluation.warnings)
