"""Figures of thermal runs: which arrays go into which plot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Literal

import numpy as np

from bench.present.report._content import Comparison, ModelScore, Trace
from bench.present.report._dots import Dots, dot_chart
from bench.present.report._figures import Curve, Lane, Panel, lanes, panels
from bench.present.report._numbers import fixed, known, mean, significant
from bench.present.report._page import Block, Figures, Key
from bench.present.report._palette import AFTER, BEFORE, BLUE, FLOOR, GREEN, MUTED, ORANGE, PURPLE, Paint
from bench.present.report._parts import BEFORE_AFTER
from bench.present.report._scores import attained
from drivers.base.arrays import Array

_HOUR = 3600.0
_TEMPERATURES: tuple[tuple[str, str, Paint, Literal["-", "--"]], ...] = (
    ("set_point_c", "set point", MUTED, "--"),
    ("air_temp_c", "air", GREEN, "-"),
    ("case_temp_c", "case", ORANGE, "-"),
    ("gyro_temp_c", "gyro", BLUE, "-"),
)


def trace_figure(figure_id: str, trace: Trace) -> list[Block]:
    """Return temperatures and output of one run over its phases; nothing if there is neither."""
    temperatures = _temperature_curves(trace)
    output = _output_curve(trace)
    plots = []
    if temperatures:
        plots.append(Lane("Temperature, °C", temperatures, height=178.0))
    if output is not None:
        plots.append(Lane(f"{trace.output_name}, °/h", [output], height=150.0))
    if not plots:
        return []
    end_h = max(float(curve.x[-1]) for plot in plots for curve in plot.curves if len(curve.x))
    starts = [start / _HOUR for start, _ in trace.phases]
    phases = [
        (start, end, name)
        for start, end, (_, name) in zip(starts, [*starts[1:], end_h], trace.phases, strict=True)
        if end > start
    ]
    what = " and ".join(plot.y_label.split(",")[0].lower() for plot in plots)
    who = f" of {trace.gyro}" if trace.gyro else ""
    means = f" {trace.output_name}: 100 s means." if output is not None else ""
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


def bias_panels(
    figure_id: str, comparisons: Sequence[Comparison], scores: Mapping[str, ModelScore]
) -> list[Block]:
    """Return bias before and after compensation on every held-out run; `scores` of the chosen model by run."""

    def note(comparison: Comparison) -> str:
        score = scores.get(comparison.run_id)
        if score is None or not known(score.stability_comp_dph):
            return ""
        before, after = significant(score.stability_raw_dph), significant(score.stability_comp_dph)
        return f"1σ {before} → {after} °/h"

    return _before_after(
        figure_id,
        comparisons,
        lambda item: (item.bias_before_dph, item.bias_after_dph),
        note=note,
        y_label="Bias, °/h",
        floors=True,
        caption="Bias drift before and after compensation on held-out runs, 100 s means on common axes.",
    )


def scale_factor_panels(
    figure_id: str, comparisons: Sequence[Comparison], scores: Mapping[str, ModelScore]
) -> list[Block]:
    """Return scale-factor error before and after compensation on every held-out group."""

    def note(comparison: Comparison) -> str:
        score = scores.get(comparison.run_id)
        if score is None or not known(score.sf_rms_ppm):
            return ""
        raw = f"{significant(score.sf_raw_rms_ppm)} → " if known(score.sf_raw_rms_ppm) else ""
        return f"rms {raw}{significant(score.sf_rms_ppm, 2)} ppm"

    return _before_after(
        figure_id,
        comparisons,
        lambda item: (item.sf_before_ppm, item.sf_after_ppm),
        note=note,
        y_label="SF error, ppm",
        floors=False,
        caption="Scale-factor error before and after compensation on held-out groups, on common axes.",
    )


def model_chart(figure_id: str, by_model: Mapping[str, Sequence[ModelScore]], chosen: str) -> list[Block]:
    """Return the improvement of each model: its held-out runs, their mean, and what was attainable."""
    rows = []
    for model, scores in by_model.items():
        values = [score.improvement_percent for score in scores if known(score.improvement_percent)]
        average = mean(values)
        if average is None:
            continue
        reached = attained(scores)[1]
        share = "" if reached is None else f" · {fixed(reached, 1)} % of attainable"
        numbers = [value for value in values if value is not None]
        rows.append(Dots(model, numbers, average, f"{fixed(average, 1)} %{share}", model == chosen))
    if not rows:
        return []
    by_run = {score.run_id: score.attainable_percent for scores in by_model.values() for score in scores}
    limit = mean(by_run.values())
    caption = (
        "Improvement of bias stability by model. Small dots: single held-out runs; large dot: their mean."
    )
    if limit is not None:
        caption += " Dashed: mean of what subtracting the true drift would give."
    drawn = dot_chart(
        figure_id,
        rows,
        x_label="Improvement of bias stability, %",
        limit=None if limit is None else (limit, f"attainable {fixed(limit, 1)} %"),
        description=caption,
    )
    return [Figures([drawn], caption)]


def _before_after(
    figure_id: str,
    comparisons: Sequence[Comparison],
    pick: Callable[[Comparison], tuple[Array | None, Array | None]],
    *,
    note: Callable[[Comparison], str],
    y_label: str,
    floors: bool,
    caption: str,
) -> list[Block]:
    pairs = [(item, pick(item)) for item in comparisons]
    shown = [(item, pair) for item, pair in pairs if any(array is not None for array in pair)]
    if not shown:
        return []
    plots = []
    for item, (before, after) in shown:
        curves = [
            Curve(label, item.time_s / _HOUR, np.asarray(values, dtype=np.float64), paint, width=1.25)
            for label, values, paint in (("before", before, BEFORE), ("after", after, AFTER))
            if values is not None
        ]
        title = f"{item.kind} ({item.run_id})" if item.kind else item.run_id
        description = f"{title}: {y_label} before and after compensation. {note(item)}"
        plots.append(Panel(curves, title, note(item), item.floor_dph if floors else None, description))
    keys = [*BEFORE_AFTER]
    if floors and any(known(item.floor_dph) for item, _ in shown):
        keys.append(Key("noise floor, ± 1σ", FLOOR, "band"))
    return [panels(figure_id, plots, caption, keys, x_label="Time, h", y_label=y_label, y_margin=0.06)]


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
