"""Uncertainty budgets and the certificates they are traceable to, as reports and certificates show them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from bench.present.report._numbers import DASH, significant, unit_text
from bench.present.report._page import Block, Cell, Table, named
from bench.record.benchfile import calibrations_of, overdue

if TYPE_CHECKING:
    from bench.analysis.common.uncertainty import Budget
    from bench.analysis.figures import StandardFigures
    from bench.record.recording import Manifest

_HEADS = [
    "Input",
    ">Estimate",
    ">u",
    "Unit",
    "Type",
    "Distribution",
    ">Sensitivity",
    ">ν",
    ">Share [%]",
    "From",
]
TERM = (
    "Budget",
    "u: standard uncertainty. ν: degrees of freedom. Sensitivity: change of the figure per unit of the input; "
    "times the estimate it has corrected the figure. U = k u_c (JCGM 100), k from Student's t at the effective ν "
    "of Welch and Satterthwaite; where flat distributions lead, the 95 % interval is that of draws (JCGM 101).",
)


def _degrees(freedom: float) -> str:
    return f"{freedom:.0f}" if math.isfinite(freedom) and freedom < 1000 else "∞"


def budget_tables(result: StandardFigures) -> list[Block]:
    """Return a table for every figure to which the bench adds something."""
    return [
        budget_table(f"{result.run_id}, {figure.name}", figure.budget, figure.unit)
        for figure in result.figures
        if figure.budget is not None and len(figure.budget.contributions) > 1
    ]


def budget_table(what: str, budget: Budget, unit: str) -> Block:
    """Return the table of one budget of a figure in `unit`."""
    rows = [
        named(
            item.source.replace("_", " "),
            significant(item.estimate, 3),
            significant(item.standard, 2),
            unit_text(item.unit) or DASH,
            item.kind,
            item.distribution,
            significant(item.sensitivity, 3),
            _degrees(item.freedom),
            f"{100.0 * budget.share(item):.1f}",
            item.origin,
        )
        for item in budget.contributions
    ]
    corrected = f"corrected {significant(budget.value, 5)}, " if budget.value != budget.stated else ""
    caption = (
        f"{what}: {corrected}u_c = {significant(budget.combined, 2)}, effective ν = "
        f"{_degrees(budget.freedom)}, k = {budget.k:.2f}, U = {significant(budget.expanded, 2)} "
        f"{unit_text(unit)}; half of the 95 % interval {significant(budget.half_width, 2)}."
    )
    return Table(_HEADS, rows, caption)


def traceability_table(manifests: Sequence[Manifest]) -> list[Block]:
    """Return the certificates of the benches of these runs; one that was overdue in a run is marked."""
    rows = {}
    for manifest in manifests:
        known = calibrations_of(manifest.bench)
        late = overdue(known, manifest.started_utc)
        for item in known:
            state = Cell("overdue", "bad") if item in late else Cell("valid")
            shape = f"k = {item.k or 2.0:g}" if item.distribution == "normal" else item.distribution
            rows[item, item in late] = named(
                item.quantity.replace("_", " "), item.instrument, item.certificate, item.issued_by or DASH,
                str(item.date), str(item.due), f"{item.error:g}", f"{item.uncertainty:g} ({shape})", state,
            )  # fmt: skip
    if not rows:
        return []
    heads = [
        "Quantity",
        "Instrument",
        "Certificate",
        "Issued by",
        "Date",
        "Due",
        ">Error",
        ">Uncertainty",
        "At the run",
    ]
    caption = "Certificates that the budgets rest on; a quantity that is not listed is assumed of a class."
    return [Table(heads, list(rows.values()), caption)]
