"""A batch of ring lasers on one page: a table and the output over temperature, unit by unit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from bench.analysis.common.statistics import attained
from bench.present.report import _parts as parts
from bench.present.report._figures import Curve, Panel, panels
from bench.present.report._numbers import DASH, fixed, moment
from bench.present.report._page import Cell, Fact, Figures, Headline, Page, Row, Section, Table, Verdict
from bench.present.report._palette import AFTER, BEFORE

if TYPE_CHECKING:
    from bench.analysis.rlg import Judged, RampRun, RlgStudy


def stepwise_units_page(studies: Mapping[str, RlgStudy], *, created_utc: str, bench_name: str = "") -> Page:
    """Return the page of several units, by id."""
    means = [study.chosen.mean_improvement_pct for study in studies.values() if study.tests]
    sentences = [f"{len(studies)} units were fitted on their own runs, each with a form of its own."]
    if means:
        sentences.append(
            f"On held-out runs their stability improves by {min(means):.1f} to {max(means):.1f} % in the mean."
        )
    return Page(
        title="Bias of several ring lasers over temperature",
        kind="Stepwise regression report",
        facts=[
            Fact("Units", ", ".join(studies)),
            Fact("Bench", bench_name or DASH),
            Fact("Report made", moment(created_utc)),
        ],
        verdict=Verdict(
            "Compensated" if means else "Not judged",
            "good" if means else "doubt",
            sentences,
            [Headline("mean improvement", fixed(float(np.mean(means)), 1), "%")] if means else [],
        ),
        sections=[
            Section("Units", [_table(studies)]),
            Section("Output over temperature", [_figure(studies)]),
        ],
        colophon=parts.OF_RUNS,
    )


def _table(studies: Mapping[str, RlgStudy]) -> Table:
    rows = []
    for unit, study in studies.items():
        worst = min((row.improvement_pct for row in study.chosen.judged), default=None)
        mean = study.chosen.mean_improvement_pct if study.tests else None
        spread, promise = study.spread, study.promise
        cells = [
            study.chosen.name,
            fixed(study.equation.mean_improvement_pct if study.tests else None, 1),
            fixed(mean, 1),
            fixed(worst, 1),
            fixed(attained(study.chosen.judged)[1], 1),
            DASH if promise is None else f"{fixed(promise.low_pct, 0)} to {fixed(promise.high_pct, 0)}",
            DASH if spread is None else fixed(spread.pct, 0),
        ]
        rows.append(Row([Cell(unit, strong=True), *map(Cell, cells)]))
    heads = [
        "Unit",
        "Taken",
        ">Equation [%]",
        ">Taken [%]",
        ">Worst run [%]",
        ">Attained [%]",
        ">Promised [%]",
    ]
    heads.append(">Runs lie apart [%]")
    caption = (
        "Improvement of the stability of 100 s means on held-out runs, by the corrected equation and by what was "
        "taken; promised for runs like those fitted; how far runs of a unit lie apart, in parts of the drift."
    )
    return Table(heads, rows, caption)


def _figure(studies: Mapping[str, RlgStudy]) -> Figures:
    plots = []
    for unit, study in studies.items():
        run = (*study.tests, *study.training)[0]
        note = f"{'held out' if study.tests else 'fitted'}: {run.run_id}"
        plots.append(over_temperature(unit, note, run, study.chosen))
    caption = "Bias from its mean over the case temperature, before and after, of one run of each unit."
    return panels(
        "units", plots, caption, parts.BEFORE_AFTER, x_label="Case temperature, °C", y_label="Bias, °/h"
    )


def over_temperature(title: str, note: str, run: RampRun, taken: Judged) -> Panel:
    """Return the output of a run over its case temperature, before and after what was taken."""
    left = run.bias_dph - taken.compensation.drift_dph(run)
    curves = [
        Curve("before", run.case_c, run.bias_dph - run.bias_dph.mean(), BEFORE, width=0.9),
        Curve("after", run.case_c, left - left.mean(), AFTER, width=0.9),
    ]
    return Panel(
        curves, title, note, description=f"{title}, {note}: bias over case temperature before and after"
    )
