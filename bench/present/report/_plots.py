"""Figures of thermal runs: which arrays go into which plot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench.analysis.common.statistics import attained
from bench.present.report._dots import Dots, dot_chart
from bench.present.report._figures import Curve, Lane, Panel, lanes, panels
from bench.present.report._numbers import fixed, known, mean
from bench.present.report._page import Block, Figures, Key
from bench.present.report._palette import AFTER, BEFORE, BLUE, FLOOR, GREEN, MUTED, ORANGE, PURPLE, Paint
from bench.present.report._parts import BEFORE_AFTER
from bench.present.report._run_content import Trace
from bench.present.report._scores import Models
from drivers.base.arrays import Array

_HOUR = 3600.0
_TEMPERATURES: tuple[tuple[str, str, Paint, Literal["-", "--"]], ...] = (
    ("set_point_c", "set point", MUTED, "--"),
    ("air_temp_c", "air", GREEN, "-"),
    ("case_temp_c", "case", ORANGE, "-"),
    ("gyro_temp_c", "gyro", BLUE, "-"),
)


@dataclass(frozen=True, eq=False)
class Comparison:
    """A held-out run before and after the chosen model, 100 s means, shape (n,); `floor`: 1σ of its noise."""

    run_id: str
    time_s: Array
    unit: str
    before: Array
    after: Array
    note: str = ""
    floor: float | None = None


def trace_figure(figure_id: str, trace: Trace) -> list[Block]:
    """Return temperatures and output of one run over its phases; nothing if there is neither."""
    temperatures = _temperature_curves(trace)
    output = _output_curve(trace)
    plots = []
    if temperatures:
        plots.append(Lane("Temperature, °C", temperatures, height=178.0))
    if output is not None:
        plots.append(Lane(f"{trace.output_name}, °/h", [output], height=150.0))
    if plots and trace.supply_a is not None:
        current = Curve("supply", trace.time_s / _HOUR, trace.supply_a, MUTED)
        plots.append(Lane("Supply, A", [current], height=90.0))
    if not plots:
        return []
    end_h = max(float(curve.x[-1]) for plot in plots for curve in plot.curves if len(curve.x))
    starts = [start / _HOUR for start, _ in trace.phases]
    ends = [*starts[1:], end_h][: len(starts)]  # a run of another bench may have no phases
    phases = [
        (start, end, name)
        for start, end, (_, name) in zip(starts, ends, trace.phases, strict=True)
        if end > start
    ]
    what = " and ".join(plot.y_label.split(",")[0].lower() for plot in plots)
    who = f" of {trace.gyro}" if trace.gyro else ""
    means = f" {trace.output_name}: {trace.output_block_s:g} s means." if output is not None else ""
    caption = f"Run {trace.run_id}: {what}{who} over the phases of the run.{means}"
    return [lanes(figure_id, plots, "Time since power-on, h", caption, phases=phases)]


def trace_panels(figure_id: str, traces: Sequence[Trace]) -> list[Block]:
    """Return small temperature plots of several runs on common axes."""
    shown = [(trace, curves) for trace in traces if (curves := _temperature_curves(trace, "-"))]
    if not shown:
        return []
    plots = [
        Panel(curves, trace.run_id, description=f"Temperatures of run {trace.run_id}")
        for trace, curves in shown
    ]
    present = {curve.label for plot in plots for curve in plot.curves}
    keys = [
        Key(label, paint) for _, label, paint, style in _TEMPERATURES if style == "-" and label in present
    ]
    caption = "Temperatures of the runs, on common axes."
    return [panels(figure_id, plots, caption, keys, x_label="Time, h", y_label="°C")]


_COMPARED = {
    "°/h": (
        "bias",
        "Bias, °/h",
        "Bias drift before and after compensation on held-out runs, 100 s means on common axes.",
    ),
    "ppm": (
        "scale-factor",
        "SF error, ppm",
        "Scale-factor error before and after compensation on held-out groups, on common axes.",
    ),
}
"""Id, label and caption by the unit of what is compared."""


def before_after_panels(comparisons: Sequence[Comparison], unit: str) -> list[Block]:
    """Return held-out runs before and after compensation on common axes: what is compared in that unit."""
    figure_id, y_label, caption = _COMPARED[unit]
    shown = [item for item in comparisons if item.unit == unit]
    if not shown:
        return []
    plots = []
    for item in shown:
        curves = [
            Curve(label, item.time_s / _HOUR, values, paint, width=1.25)
            for label, values, paint in (("before", item.before, BEFORE), ("after", item.after, AFTER))
        ]
        description = f"{item.run_id}: {y_label} before and after compensation. {item.note}"
        plots.append(Panel(curves, item.run_id, item.note, item.floor, description))
    keys = [*BEFORE_AFTER]
    if any(known(item.floor) for item in shown):
        keys.append(Key("noise floor, ± 1σ", FLOOR, "band"))
    return [panels(figure_id, plots, caption, keys, x_label="Time, h", y_label=y_label, y_margin=0.06)]


def model_chart(models: Models, chosen: str) -> list[Block]:
    """Return the improvement of each model: its held-out runs, their mean, and what was attainable."""
    rows = []
    for model, scores in models.items():
        values = [score.improvement_pct for score in scores if score.improvement_pct is not None]
        average = mean(values)
        if average is None:
            continue
        reached = attained(scores)[1]
        share = "" if reached is None else f" · {fixed(reached, 1)} % of attainable"
        rows.append(Dots(model, values, average, f"{fixed(average, 1)} %{share}", model == chosen))
    if not rows:
        return []
    by_run = {score.run_id: score.oracle_pct for scores in models.values() for score in scores}
    limit = mean(by_run.values())
    caption = (
        "Improvement of bias stability by model. Small dots: single held-out runs; large dot: their mean."
    )
    if limit is not None:
        caption += " Dashed: mean of what subtracting the true drift would give."
    drawn = dot_chart(
        "models",
        rows,
        x_label="Improvement of bias stability, %",
        limit=None if limit is None else (limit, f"attainable {fixed(limit, 1)} %"),
        description=caption,
    )
    return [Figures([drawn], caption)]


def _temperature_curves(trace: Trace, styles: str = "- --") -> list[Curve]:
    curves = []
    for name, label, paint, style in _TEMPERATURES:
        values = getattr(trace, name)
        if values is None or style not in styles.split() or not np.isfinite(values).any():
            continue
        width = 1.0 if style == "--" else 1.4
        curves.append(Curve(label, trace.time_s / _HOUR, values, paint, style, width))
    return curves


def _output_curve(trace: Trace) -> Curve | None:
    if trace.output_dph is None or trace.output_time_s is None or not np.isfinite(trace.output_dph).any():
        return None
    return Curve(trace.gyro or "gyro", trace.output_time_s / _HOUR, trace.output_dph, PURPLE)
