"""`gyrobench scheme evaluate` and `gyrobench scheme search`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, cast

import numpy as np
from rich.console import Console
from rich.table import Table as Grid

from bench.analysis.calibration import (
    PARAMETERS,
    STATE_NAMES,
    STATE_UNITS,
    TABLES,
    UNIT_SIZE,
    Effort,
    Evaluation,
    Noise,
    Schedule,
    Site,
    Table,
    TableAxis,
    Task,
    evaluate,
    home_attitude,
    home_text,
    load_scheme,
    moves_text,
    plan_turns,
    scheme_file,
    search,
    table_axes,
    table_type,
)
from bench.analysis.common.fan_out import fan_out
from bench.analysis.common.state_file import save_file
from bench.present.cli._console import Terminal
from bench.present.cli._texts import duration
from bench.present.report import render_calibration, scheme_content, write_report
from bench.record.benchfile import load_bench_file
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError

_QUICK, _THOROUGH = Effort(8, 300, 2), Effort(16, 800, 6)


def scheme_evaluate_command(
    scheme: str,
    table: str = "by-hand",
    home: str | None = None,
    dwell_s: float = 180.0,
    rate_dps: float = 10.0,
    latitude_deg: float = 45.7796,
    gravity_mps2: float | None = None,
    arw_deg_per_sqrt_h: float = 0.001,
    vrw_ug_per_sqrt_hz: float = 10.0,
    velocity_noise_mps: float = 1e-3,
    as_json: bool = False,
    out: Path | None = None,
    bench: Path | None = None,
) -> None:
    """Show degree and predicted accuracy of every state, on the terminal, as JSON, and as a page in `out`.

    `bench`: a bench file, whose latitude and table then count, and the home that this table really starts from.
    """
    schedule = load_scheme(scheme).with_(
        dwell_s=_positive("dwell", dwell_s), rate_dps=_positive("rate", rate_dps)
    )
    if home is not None:
        schedule = schedule.with_(home=home_attitude(home, "--home"))
    if bench is not None:
        table, latitude_deg, axes = _of_bench(bench)
        schedule = plan_turns(schedule, axes).schedule
    task = _task(latitude_deg, gravity_mps2, arw_deg_per_sqrt_h, vrw_ug_per_sqrt_hz, velocity_noise_mps)
    evaluation = evaluate(task, schedule, _table(table))
    if out is not None:
        write_report(out, render_calibration(scheme_content(evaluation, utc_now())))
    if as_json:
        Terminal(soft_wrap=True).print_json(json.dumps(evaluation.as_json()))
        return
    _print(Terminal(), evaluation)


def scheme_search_command(
    turns: int,
    table: str = "two-axis-horizontal",
    dwell_s: float = 180.0,
    rate_dps: float = 10.0,
    latitude_deg: float = 45.7796,
    arw_deg_per_sqrt_h: float = 0.001,
    vrw_ug_per_sqrt_hz: float = 10.0,
    seed: int = 0,
    thorough: bool = False,
    angles: str = "90",
    out: Path | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    bench: Path | None = None,
) -> None:
    """Search a closed scheme of turns by `angles`, show it beside the classical ones, write its file.

    `bench`: a bench file, whose latitude and table then count. What is promised is then what this table reaches:
    each scheme counts from the home that the table really starts it from.
    """
    axes: list[TableAxis] = []
    if bench is not None:
        table, latitude_deg, axes = _of_bench(bench)
    pattern = Schedule("", (), np.eye(3), _positive("dwell", dwell_s), _positive("rate", rate_dps))
    task = _task(latitude_deg, None, arw_deg_per_sqrt_h, vrw_ug_per_sqrt_hz, 1e-3)
    if not 2 <= turns <= 40:
        raise ConfigurationError("turns out of range", where="--turns", found=str(turns), expected="2 to 40")
    effort = _THOROUGH if thorough else _QUICK
    with fan_out(jobs, cluster) as fan:
        result = search(
            task,
            turns=turns,
            table=_table(table),
            pattern=pattern,
            effort=effort,
            seed=seed,
            angles_deg=_angles(angles),
            fan=fan,
            outer=axes[0].direction if axes else None,
        )
    console = Terminal()
    console.print(
        f"{moves_text(result.schedule.moves)}\nhome: {home_text(result.schedule.home)}", highlight=False
    )
    if axes:
        plan = plan_turns(result.schedule, axes)
        console.print(f"mount with all axes at 0: {plan.mount_text}", highlight=False)
    grid = Grid("scheme", "turns", "time", "worst sigma/target", "rms")
    for each in (
        result.schedule,
        load_scheme("19-position"),
        load_scheme("23-position"),
        load_scheme("t22"),
    ):
        scheme = each.with_(dwell_s=dwell_s, rate_dps=rate_dps)
        try:
            found = evaluate(task, plan_turns(scheme, axes).schedule if axes else scheme)
        except ConfigurationError:
            grid.add_row(scheme.name, str(len(scheme.moves)), "", "not on this table", "")
            continue
        merit, length = found.merit, duration(found.schedule.duration_s)
        grid.add_row(scheme.name, str(len(scheme.moves)), length, f"{merit.worst:.3f}", f"{merit.rms:.3f}")
    console.print(grid)
    console.print(result.statement, highlight=False)
    if out is not None:
        named = result.schedule.with_(name=out.stem, source="gyrobench scheme search", notes=result.statement)
        save_file(out, scheme_file(named))
        console.print(f"{out}", highlight=False)


def _of_bench(path: Path) -> tuple[str, float, list[TableAxis]]:
    """Return type of table, latitude in deg and axes of a bench file."""
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


def _table(name: str) -> Table:
    if name not in TABLES:
        raise ConfigurationError("no such table", where="--table", found=name, expected=" or ".join(TABLES))
    return cast(Table, name)


def _positive(name: str, value: float) -> float:
    if not (np.isfinite(value) and value > 0.0):
        raise ConfigurationError(f"{name} must be above zero", where=f"--{name}", found=f"{value:g}")
    return value


def _print(console: Console, evaluation: Evaluation) -> None:
    schedule, ratio = evaluation.schedule, evaluation.sigma[PARAMETERS] / evaluation.task.target_sigma
    console.print(
        f"{schedule.name}: {schedule.positions} positions, {duration(schedule.duration_s)}, home "
        f"{home_text(schedule.home)}, table {evaluation.table}\n{moves_text(schedule.moves)}",
        highlight=False,
    )
    grid = Grid(
        "state", "unit", "prior", "sigma", "target", "sigma/target", "gain ratio", "white-noise degree"
    )
    for number, name in enumerate(STATE_NAMES):
        unit = UNIT_SIZE[number]
        cells: list[Any] = [
            f"{evaluation.task.prior_sigma[number] / unit:g}",
            f"{evaluation.sigma[number] / unit:.3g}",
        ]
        judged = ratio[number - 6] if number >= 6 else None
        target = "" if judged is None else f"{evaluation.task.target_sigma[number - 6] / unit:g}"
        cells += [target, "" if judged is None else f"{judged:.2f}", f"{evaluation.gain[number]:,.1f}"]
        cells.append(f"{evaluation.degrees.normalised[number]:,.0f}")
        grid.add_row(
            name, STATE_UNITS[number], *cells, style="red" if judged is not None and judged > 1 else ""
        )
    console.print(grid)
    console.print(
        f"worst sigma/target {evaluation.merit.worst:.3f}, rms {evaluation.merit.rms:.3f}, rank "
        f"{evaluation.degrees.rank} of {len(STATE_NAMES)}",
        highlight=False,
    )
    for combination in evaluation.combinations:
        console.print(f"poorly seen: {combination}", highlight=False)
    for text in evaluation.warnings:
        console.print(f"note: {text}", highlight=False)
