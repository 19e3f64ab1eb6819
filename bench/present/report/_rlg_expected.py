"""What further runs of a ring laser will show: the form taken and why, spread, promise, what more runs bring."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bench.present.report._numbers import fixed, significant
from bench.present.report._page import Block, Cell, Notes, Row, Table, named

if TYPE_CHECKING:
    from bench.analysis.rlg import RlgStudy


def expected_blocks(study: RlgStudy) -> list[Block]:
    """Return why the form was taken, and what to expect of further runs."""
    return [*_choice(study), *_expected(study)]


def choice_sentence(study: RlgStudy) -> str:
    """Return which form was taken and on what it was decided."""
    choice = study.choice
    if choice.failed:
        return f"Taken: {choice.taken}. Nothing could be left out to compare with: {choice.failed}"
    what = "each run" if len(study.training) > 1 else "each quarter of the run"
    return f"Taken: {choice.taken}, with {what} left out of the fit in turn."


def expected_sentence(study: RlgStudy) -> str:
    """Return spread and promise in words, or why there are none."""
    if study.spread is None or study.promise is None:
        return "One run was fitted: how far runs lie apart is not known, and nothing is promised."
    spread, promise = study.spread, study.promise
    return (
        f"Runs lie {spread.pct:.0f} % of the drift apart ({spread.low_pct:.0f} to {spread.high_pct:.0f} %). A "
        f"further run like those fitted will improve by {promise.low_pct:.0f} to {promise.high_pct:.0f} %, "
        f"{promise.middle_pct:.0f} % in the middle."
    )


def more_runs(value: float) -> str:
    """Return how many more runs, in words."""
    return "no end of runs" if math.isinf(value) else "as fitted" if value == 0 else f"{value:.0f} more"


def _choice(study: RlgStudy) -> list[Block]:
    choice = study.choice
    if choice.failed:
        return [Notes([choice_sentence(study)], "doubt")]
    rows = []
    for name, errors in choice.errors.items():
        cells = [fixed(100.0 * value, 1) for value in (*errors, sum(errors) / len(errors))]
        rows.append(Row([Cell(name, strong=True), *map(Cell, cells)], emphasis=name == choice.taken))
    heads = ["Form", *(f">{name} [%]" for name in choice.left_out), ">mean [%]"]
    caption = (
        "What each form leaves of a run's 1σ when that run is left out of its fit. Within one standard error of "
        "the best forms are tied; where equation and smooth form both are, or neither, their mean is taken."
    )
    return [Table(heads, rows, caption)]


def _expected(study: RlgStudy) -> list[Block]:
    if study.spread is None or study.promise is None:
        return [Notes([expected_sentence(study)], "doubt")]
    spread, promise = study.spread, study.promise
    rows = [
        named(
            "Runs lie apart",
            f"{significant(spread.dph, 3)} °/h, {fixed(spread.pct, 0)} % of the drift",
            f"{fixed(spread.low_pct, 0)} to {fixed(spread.high_pct, 0)} %",
        ),
        named(
            "Improvement of a further run",
            f"{fixed(promise.middle_pct, 1)} %",
            f"{fixed(promise.low_pct, 1)} to {fixed(promise.high_pct, 1)} %",
        ),
    ]
    first = Table(
        ["Figure", "Estimate", "90 % interval"], rows, "From the fitted runs alone, for runs like these."
    )
    outlook = Table(
        ["Runs fitted", ">Improvement to expect [%]"],
        [named(more_runs(row.more_runs), fixed(row.improvement_pct, 1)) for row in study.outlook],
        "What more runs would bring, by the smooth form. What no number of runs removes is noise and what every "
        "power-on has of its own.",
    )
    judged = [row for row in study.chosen.judged if row.promise is not None]
    promised = [
        named(
            row.run_id,
            f"{fixed(row.promise.low_pct, 1)} to {fixed(row.promise.high_pct, 1)}" if row.promise else "",
            Cell(fixed(row.improvement_pct, 1)),
            fixed(None if row.inside is None else 100.0 * row.inside, 1),
        )
        for row in judged
    ]
    told = Table(
        ["Run", ">Promised [%]", ">Improved by [%]", ">Rows in the 95 % interval [%]"],
        promised,
        "Held-out runs: promised from their temperatures alone, before their bias was read.",
    )
    return [first, outlook, *([told] if promised else [])]
