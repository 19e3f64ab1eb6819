"""What the equations of a regression do on runs they have not seen, by how those differ from the fitted ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bench.analysis.common.statistics import attained
from bench.present.report._numbers import DASH, fixed
from bench.present.report._page import Block, Cell, Row, Table, named

if TYPE_CHECKING:
    from bench.analysis.rlg import BeforeAfter, Judged, RlgStudy


def judged_blocks(study: RlgStudy) -> list[Block]:
    """Return the tables of improvement by kind of run, of stability before and after, of hysteresis."""
    if not study.tests:
        return []
    return [_improvement(study), _stability(study), *_outside(study), _hysteresis(study)]


def _improvement(study: RlgStudy) -> Table:
    """Improvement of every equation, runs of a kind together, means where there are several."""
    kinds = list(dict.fromkeys(row.differs for row in study.chosen.judged))
    rows = []
    for kind in kinds:
        of_kind = [n for n, row in enumerate(study.chosen.judged) if row.differs == kind]
        for first, n in enumerate(of_kind):
            rows.append(
                _shares(study, [n], "" if first else kind.capitalize(), study.chosen.judged[n].run_id)
            )
        if len(of_kind) > 1:
            rows.append(_shares(study, of_kind, "", "mean"))
    if len(study.tests) > 1:
        rows.append(_shares(study, range(len(study.tests)), "All", "mean", emphasis=True))
    heads = ["Differs by", "Run", *(f">{way.name} [%]" for way in study.everything), ">Attained [%]"]
    caption = (
        "Improvement of the stability of 100 s means on runs that had no part in the fit, by how these differ "
        f"from those that had. Attained: by {study.chosen.name}, which was taken."
    )
    return Table(heads, rows, caption)


def _shares(study: RlgStudy, which: Sequence[int], kind: str, run: str, *, emphasis: bool = False) -> Row:
    cells = [Cell(kind, strong=True), Cell(run)]
    for way in study.everything:
        mean = float(np.mean([way.judged[n].improvement_pct for n in which]))
        cells.append(Cell(fixed(mean, 1), "plain" if mean >= 0 else "bad"))
    cells.append(Cell(fixed(attained([study.chosen.judged[n] for n in which])[1], 1)))
    return Row(cells, emphasis=emphasis)


def _stability(study: RlgStudy) -> Table:
    ways = _few(study)
    rows = []
    for n, row in enumerate(study.chosen.judged):
        after = [fixed(way.judged[n].after_dph, 5) for way in ways]
        cells = [row.kind or DASH, fixed(row.before_dph, 5), *after, fixed(row.oracle_dph, 5)]
        rows.append(named(row.run_id, *cells))
    after = [f">{way.name} [°/h]" for way in ways]
    heads = ["Run", "Profile", ">Before [°/h]", *after, ">True drift off [°/h]"]
    return Table(heads, rows, "Stability, 1σ of 100 s means, before and after.")


def _outside(study: RlgStudy) -> list[Table]:
    """Return the stability inside and outside of what was fitted, where there are rows outside."""
    rows = []
    for row in study.chosen.judged:
        split = row.apart
        if not split.outside:
            continue
        pairs = ((split.inside_before, split.inside_after), (split.outside_before, split.outside_after))
        cells = [
            f"{fixed(before, 5)} → {fixed(after, 5)}" if before is not None else DASH
            for before, after in pairs
        ]
        rows.append(named(row.run_id, Cell(f"{split.outside} of {split.count}", "doubt"), *cells))
    heads = ["Run", ">Rows outside", ">Rows inside [°/h]", ">Rows outside [°/h]"]
    caption = (
        f"Stability before and after {study.chosen.name} of rows within and beyond the temperatures and rates of "
        "the training runs."
    )
    return [Table(heads, rows, caption)] if rows else []


def _few(study: RlgStudy) -> list[Judged]:
    """Return the equations, and what was taken if it is none of them."""
    return [*study.variants, *(form for form in study.forms if form.name == study.chosen.name)]


def _hysteresis(study: RlgStudy) -> Table:
    ways = _few(study)

    def row(n: int, of: BeforeAfter) -> Row:
        after = [fixed(way.judged[n].hysteresis_after_dph, 5) for way in ways]
        return named(of.run_id, of.differs, fixed(of.hysteresis_before_dph, 5), *after)

    heads = ["Run", "Differs by", ">Before [°/h]", *(f">{way.name} [°/h]" for way in ways)]
    rows = [row(n, of) for n, of in enumerate(study.chosen.judged)]
    caption = (
        "Hysteresis: rms difference between warming and cooling at the same temperature, before and after each "
        "equation."
    )
    return Table(heads, rows, caption)
