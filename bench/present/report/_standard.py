"""The report of a standard test: every figure with its definition, and the Allan deviation it rests on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bench.present.report import _glossary as glossary
from bench.present.report import _parts as parts
from bench.present.report._budget import TERM, budget_tables
from bench.present.report._figures import Curve, Lane, lanes
from bench.present.report._numbers import DASH, moment, unit_text
from bench.present.report._page import Block, Fact, Headline, Page, Section, Table, Verdict, named
from bench.present.report._palette import BLUE, MUTED, ORANGE

if TYPE_CHECKING:
    from bench.analysis.figures import Figure, StandardFigures

_HEADLINES = (
    "bias stability, 100 s averages",
    "bias stability, 10 s averages",
    "scale-factor nonlinearity",
    "angle random walk",
)
_TERMS = [
    *glossary.STANDARD_BIAS,
    (
        "Interval",
        "Holds the figure with 95 % probability; the noise and what is known of the bench are in it.",
    ),
    (
        "Not seen above",
        "The record does not show the figure: noise alone gives as much. It is at most this, with 97.5 % "
        "probability.",
    ),
    TERM,
    (
        "Threshold",
        "Smallest input from rest that gives at least half of its output; resolution likewise at a rate.",
    ),
]


def standard_test_page(
    results: Sequence[StandardFigures],
    over_runs: Sequence[Figure] = (),
    *,
    created_utc: str,
    bench_name: str = "",
    warnings: Sequence[str] = (),
) -> Page:
    """Return the report of one or more standard tests of one unit."""
    missing = [f"{result.run_id}: no {what}. {why}" for result in results for what, why in result.missing]
    units = ", ".join(dict.fromkeys(result.unit_id for result in results))
    return Page(
        title=f"Standard test of {units}",
        kind="Test report after IEEE Std 952 / 647 and GJB 2426A",
        facts=[
            Fact("Unit under test", units),
            Fact("Bench", bench_name or DASH),
            Fact("Runs", ", ".join(result.run_id for result in results)),
            Fact("Report made", moment(created_utc)),
        ],
        verdict=_verdict(results, missing),
        sections=[
            parts.warnings([*warnings, *missing]),
            Section("Figures", [_figure_table(result.run_id, result.figures) for result in results]),
            Section("Over runs", [_figure_table("all runs", over_runs)] if over_runs else []),
            Section("Uncertainty budgets", [block for result in results for block in budget_tables(result)]),
            Section(
                "Allan deviation",
                [block for n, result in enumerate(results) for block in allan_figure(n, result)],
            ),
        ],
        terms=_TERMS,
        colophon=parts.OF_RUNS,
    )


def _verdict(results: Sequence[StandardFigures], missing: Sequence[str]) -> Verdict:
    figures = {figure.name: figure for figure in results[0].figures}
    headlines = [
        Headline(name, parts.stated(figures[name].value, figures[name].bound), unit_text(figures[name].unit))
        for name in _HEADLINES
        if name in figures
    ]
    if missing:
        return Verdict("Incomplete", "doubt", ["Some figures are missing; the warnings say why."], headlines)
    return Verdict("Measured", "good", ["Every figure of the test plan was measured."], headlines)


def _figure_table(run_id: str, figures: Sequence[Figure]) -> Table:
    rows = [
        named(
            figure.name,
            parts.stated(figure.value, figure.bound, figure.digits),
            unit_text(figure.unit) or DASH,
            parts.interval(figure.low, figure.high, figure.digits),
            figure.source,
        )
        for figure in figures
    ]
    heads = ["Figure", ">Value", "Unit", ">95 % interval", "Definition"]
    return Table(heads, rows, f"Figures of {run_id}.")


def allan_figure(number: int, result: StandardFigures) -> list[Block]:
    """Return the Allan deviation of a run with its interval and fit; nothing if there is none."""
    if result.allan is None or result.noise is None:
        return []
    from bench.analysis.common.allan_confidence import (
        confidence_interval,  # scipy behind it is slow to import
    )

    allan = result.allan
    low, high = confidence_interval(allan)
    tau = np.log10(allan.tau_s)
    curves = [
        Curve("measured", tau, np.log10(allan.deviation), BLUE),
        Curve("95 % interval", tau, np.log10(low), MUTED, ":"),
        Curve("", tau, np.log10(high), MUTED, ":"),
        Curve("fitted noise", tau, np.log10(result.noise.coefficients.deviation(allan.tau_s)), ORANGE, "--"),
    ]
    caption = (
        f"Run {result.run_id}: overlapping Allan deviation, its 95 % interval, and the five fitted noises."
    )
    plots = [Lane("log10 of deviation, °/h", curves, height=240.0)]
    return [lanes(f"allan-{number}", plots, "log10 of averaging time, s", caption)]
