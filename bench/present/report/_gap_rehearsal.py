"""The report of a rehearsal of the gap: a run's log against those of the nominal and the closed model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from bench.present.report._figures import Panel
from bench.present.report._gap_where import before_closed, keys_of, left_over_panels
from bench.present.report._numbers import fixed, moment, plain_name, significant
from bench.present.report._page import Cell, Fact, Figures, Headline, Page, Row, Section, Table, Verdict

if TYPE_CHECKING:
    from bench.analysis.gap import LogCurve, LogGap, LogGaps

_MOSTLY = 0.9
_OF_RATE = "What the run's log differs by from the rehearsals' logs."
_OF_CHANNELS = "What the run differs by beside the gyro's rate; nothing taken out."


def log_gaps_page(
    run_id: str, unit_id: str, models: tuple[str, str], gaps: LogGaps, created_utc: str
) -> Page:
    """Return the page; `models` are the files of the nominal and the closed model."""
    whole = gaps.rate[0]
    closed = math.isfinite(whole.share) and whole.share > _MOSTLY
    share = fixed(100.0 * whole.share, 1)
    return Page(
        title=f"The gap in the log: {run_id}",
        kind="Sim-to-real gap, rehearsed",
        facts=[
            Fact("Unit under test", unit_id),
            Fact("Nominal model", models[0]),
            Fact("Closed model", models[1]),
            Fact("Report made", moment(created_utc)),
        ],
        verdict=Verdict(
            f"{share} % of the reducible gap is gone" if math.isfinite(whole.share) else "No gap in this log",
            "good" if closed or not math.isfinite(whole.share) else "doubt",
            [
                "The procedure was run on the emulated bench with each model; the run's log is held against both."
            ],
            [
                Headline(
                    "Run less rehearsal, rms",
                    significant(whole.rms_closed),
                    "°/h",
                    significant(whole.rms_nominal),
                    f"floor {significant(whole.rms_floor)} °/h: two rehearsals that differ in noise only",
                )
            ],
        ),
        sections=[
            Section("By phase", [_table(gaps.rate, _OF_RATE, "°/h")]),
            Section("Over time", [_figures(gaps.curves)]),
            Section("Other channels", [_table(gaps.channels, _OF_CHANNELS)] if gaps.channels else []),
        ],
        colophon="Means of 100 s, each stretch's own mean taken out; phases laid on each other at their begins.",
    )


def _table(gaps: Sequence[LogGap], caption: str, unit: str = "") -> Table:
    """Return a table of gaps of one unit, all of them first, or of a channel each in its own."""
    size = f"{unit} rms".strip()
    heads = ["Phase"] if unit else ["Channel", "Unit"]
    heads += [f">{model} [{size}]" for model in ("Nominal", "Closed", "Floor")] + [">Reducible gap gone [%]"]
    rows = []
    for number, gap in enumerate(gaps):
        whole = bool(unit) and number == 0
        cells = [gap.unit] if not unit else []
        cells += [significant(rms) for rms in (gap.rms_nominal, gap.rms_closed, gap.rms_floor)]
        cells.append(fixed(100.0 * gap.share, 1))
        name = Cell(plain_name(gap.part), strong=whole)
        rows.append(Row([name, *map(Cell, cells)], emphasis=whole))
    return Table(heads, rows, caption)


def _figures(curves: Sequence[LogCurve]) -> Figures:
    plots = [
        Panel(
            before_closed(curve.time_s, curve.nominal_dph, curve.closed_dph),
            curve.run_id,
            description=f"Run less rehearsal in {curve.run_id}",
        )
        for curve in curves
    ]
    keys = keys_of(plots[0].curves, "closed model")
    return left_over_panels("log", plots, "Run less rehearsal, 100 s means.", keys)
