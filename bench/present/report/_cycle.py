"""The report of a chamber cycle recorded elsewhere: what each axis gains on the leg it was not fitted on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench.present.report._figures import Curve, Lane, lanes
from bench.present.report._numbers import fixed, moment, significant
from bench.present.report._page import (
    Cell,
    Fact,
    Figures,
    Headline,
    Notes,
    Page,
    Section,
    Table,
    Verdict,
    named,
)
from bench.present.report._palette import AFTER, BEFORE, GREEN, SAND

if TYPE_CHECKING:
    from bench.analysis.rlg import CycleStudy, Spread

_TERMS = [
    (
        "Before",
        "Standard deviation of the row means on the held-out leg about their own mean, 1σ, in the table's unit.",
    ),
    ("rms", "The same about what the fitted legs foretell: an offset between the legs counts in it."),
    ("Temperature only", "Stepwise selection from T, T², T³ on the fitted legs."),
    (
        "Rate and past",
        "The same, with dT, T·dT and the distance of T from its own lagged course (lag T) on offer.",
    ),
    (
        "Held-out leg",
        "What follows the last turn of temperature. Nothing of it took part in the fit; where it goes beyond the "
        "fitted temperatures it is not judged.",
    ),
]


def chamber_cycle_page(study: CycleStudy, *, source: str, checksum: str, created_utc: str) -> Page:
    """Return the report of a chamber cycle."""
    gaining = [axis.axis for axis in study.axes if axis.gains]
    losing = [axis.axis for axis in study.axes if min(axis.static_pct, axis.dynamic_pct) < 0.0]
    sentences = [
        "Gains on the held-out leg: "
        + ", ".join(f"{axis.axis} {fixed(axis.best_pct, 0)} %" for axis in study.axes)
        + " by the better of two equations. The better one is known only after looking at that leg."
    ]
    if losing:
        sentences.append(f"At least one equation makes {', '.join(losing)} worse than no compensation.")
    failed = [f"Axis {name} was not judged: {why}" for name, why in study.failed]
    rows = [
        named(
            axis.axis,
            *_spread(axis.before),
            *_spread(axis.after_static),
            _gain(axis.static_pct),
            *_spread(axis.after_dynamic),
            _gain(axis.dynamic_pct),
            axis.verdict,
        )
        for axis in study.axes
    ]
    heads = [
        "Axis",
        ">Before",
        ">rms",
        ">Temperature only",
        ">rms",
        ">Gain [%]",
        ">Rate and past",
        ">rms",
        ">Gain [%]",
        "Verdict",
    ]
    terms = [
        named(axis.axis, ", ".join(axis.terms_static) or "none", ", ".join(axis.terms_dynamic) or "none")
        for axis in study.axes
    ]
    judged = Table(heads, rows, "1σ on the held-out leg, in the table's unit.")
    return Page(
        title="Chamber cycle",
        kind="Regression over temperature, one recording",
        facts=[Fact("Recording", source), Fact("SHA-256", checksum, code=True),
               Fact("Report made", moment(created_utc))],
        verdict=Verdict(
            f"{len(gaining)} of {len(study.axes)} axes gain",
            "good" if len(gaining) == len(study.axes) else "doubt",
            sentences,
            [Headline(f"axis {axis.axis}", fixed(axis.best_pct, 1), "%") for axis in study.axes],
        ),
        sections=[
            Section("Held-out leg", [judged, _courses(study)]),
            Section("Left out of the recording", [Notes([*study.remarks, *failed])]),
            Section(
                "Terms",
                [Table(["Axis", "Temperature only", "Rate and past"], terms)],
                "Chosen on the fitted legs, autocorrelation of the residuals taken off first.",
            ),
        ],
        terms=_TERMS,
    )  # fmt: skip


def _courses(study: CycleStudy) -> Figures:
    number = np.arange(len(study.temp_c), dtype=np.float64)
    plots = [Lane("Temperature, °C", [Curve("T", number, study.temp_c, SAND)], height=90.0)]
    for axis in study.axes:
        curves = [
            Curve(label, number, values - values[study.turn :].mean(), paint)
            for label, values, paint in (
                ("before", axis.means, BEFORE),
                ("temperature only", axis.left_static, GREEN),
                ("rate and past", axis.left_dynamic, AFTER),
            )
        ]
        plots.append(Lane(f"Axis {axis.axis}", curves, height=110.0))
    legs = [(0.0, float(study.turn), "fitted"), (float(study.turn), number[-1], "held out")]
    caption = f"Means of {study.block} rows, in the table's unit, from their mean over the held-out leg."
    return lanes("cycle", plots, "Number of the mean", caption, phases=legs)


def _spread(spread: Spread) -> tuple[str, str]:
    return significant(spread.sigma, 4), significant(spread.rms, 4)


def _gain(percent: float) -> Cell:
    return Cell(fixed(percent, 1), "bad" if percent < 0.0 else "plain")
