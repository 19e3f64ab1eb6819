"""The report of a system-level calibration: what a scheme sees, how it converges, and what a record gave."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from bench.present.report._calibration_content import CalibrationContent, SchemeColumn
from bench.present.report._figures import Curve, Lane, lanes
from bench.present.report._lettering import BOTTOM, WIDE, label_room
from bench.present.report._numbers import DASH, duration, significant
from bench.present.report._page import (
    Block,
    Cell,
    Column,
    Definitions,
    Fact,
    Facts,
    Figures,
    Headline,
    Notes,
    Page,
    Row,
    Section,
    Table,
    Verdict,
)
from bench.present.report._palette import BLUE, GREEN, MUTED, ORANGE, PURPLE, SAND
from bench.present.report._parts import made, warnings
from bench.present.report._plotting import drawing, place, printable, svg

_PAINTS = (BLUE, ORANGE, GREEN, PURPLE, SAND, MUTED)
_ROW_PT = 13.0
_FULL_DECADES = 3.0
_BLIND = 2.0
_DEFINITIONS = [
    (
        "Observability degree",
        "Size of the part of a state's effect on the velocities that no other state can imitate, for white "
        "velocity noise, as prior sigma over attainable sigma. 0: not seen at all. A screening figure: velocity "
        "errors accumulate, so it flatters states that show only over time.",
    ),
    (
        "Gain ratio",
        "Prior sigma over the sigma that the Kalman filter reaches with the noise assumed. 1: nothing learned.",
    ),
    (
        "Gauge",
        "Three of the 18 elements of K_g and K_a are conventions, since turning the body frame changes no "
        "velocity. Here K_a is lower triangular: x lies along accelerometer x, y in the plane of x and y.",
    ),
]


def calibration_page(content: CalibrationContent) -> Page:
    """Return the report."""
    return Page(
        title=f"Scheme {content.scheme}" if content.estimate is None else f"Calibration by {content.scheme}",
        kind="System-level calibration" + (", prediction" if content.estimate is None else ""),
        facts=[
            Fact("Home attitude", content.home),
            Fact("Table", content.table),
            Fact("Positions", str(len(content.up_axes))),
            Fact("Dwell", duration(content.dwell_s)),
            Fact("Duration", duration(content.duration_s)),
            *(Fact(title, text) for title, text in content.facts),
        ],
        verdict=_verdict(content),
        sections=[
            warnings(content.warnings),
            Section("Schedule", [Facts([Fact("Turns", " ".join(content.moves), code=True)])]),
            Section("States", [_states(content)]),
            Section("Degrees as turns are added", [_degrees(content.first_turns, content)]),
            Section("Beside the classical schemes", [_degrees(content.others, content)]),
            Section("Poorly seen combinations", [Notes(content.poorly_seen)] if content.poorly_seen else []),
            Section("Convergence", [_convergence(content)]),
            Section("State by position", [_heat_map(content)]),
            Section("Definitions", [Definitions(_DEFINITIONS)]),
        ],
        colophon=made(content.created_utc),
    )


def _ratio(content: CalibrationContent) -> NDArray[np.float64]:
    return content.sigma / content.target


def _verdict(content: CalibrationContent) -> Verdict:
    ratio = _ratio(content)[6:]
    missed = int(np.sum(ratio > 1.0))
    worst = int(np.argmax(ratio))
    sentences = [
        f"{len(ratio) - missed} of {len(ratio)} parameters reach their target sigma; the worst is "
        f"{content.names[6 + worst]}."
    ]
    if content.rank < len(content.names):
        sentences.append(f"Only {content.rank} of {len(content.names)} states can be told apart.")
    headlines = [
        Headline("Worst sigma over target", significant(float(ratio[worst])), note=content.names[6 + worst]),
        Headline("Rms sigma over target", significant(float(np.sqrt(np.mean(ratio**2))))),
    ]
    if content.innovation_rms is not None:
        headlines.append(
            Headline(
                "Innovations, rms", significant(content.innovation_rms), note="1 if the noise is as assumed"
            )
        )
    if content.estimate is not None and content.truth is not None:
        z = (content.estimate - content.truth) / content.sigma[6:]
        rms = float(np.sqrt(np.mean(z**2)))
        headlines.append(
            Headline("Errors over sigma, rms", significant(rms), note="against the emulated truth")
        )
        if content.nees is not None:
            headlines.append(
                Headline(
                    "NEES / 24", significant(content.nees), note="1 if the covariance is right; 0.5 to 1.6"
                )
            )
    good = missed == 0
    word = "All targets met" if good else f"{missed} targets missed"
    return Verdict(word, "good" if good else "bad", sentences, headlines)


def _states(content: CalibrationContent) -> Table:
    columns = [Column("State"), Column("Unit")]
    columns += [Column(title, number=True) for title in ("Prior σ", "σ", "Target", "σ / target")]
    columns += [Column("Gain ratio", number=True), Column("Degree", number=True)]
    if content.estimate is not None:
        columns.append(Column("Estimate", number=True))
    if content.truth is not None:
        columns += [Column("Truth", number=True), Column("Error / σ", number=True)]
    ratio = _ratio(content)
    rows = [_state(content, number, float(ratio[number])) for number in range(len(content.names))]
    return Table(columns, rows, "Prior and reached sigma by state; φ and δv have no target.")


def _state(content: CalibrationContent, number: int, ratio: float) -> Row:
    prior, sigma = float(content.prior[number]), float(content.sigma[number])
    cells = [
        Cell(content.names[number], strong=True),
        Cell(content.units[number]),
        Cell(significant(prior)),
        Cell(significant(sigma)),
        Cell(significant(float(content.target[number]))),
        Cell(significant(ratio), "bad" if ratio > 1.0 else "plain"),
        Cell(significant(prior / sigma)),
        Cell(significant(float(content.degree[number]))),
    ]
    parameter = number - 6
    cells += [
        Cell(significant(float(values[parameter]), 4) if parameter >= 0 else DASH)
        for values in (content.estimate, content.truth)
        if values is not None
    ]
    if content.estimate is not None and content.truth is not None:
        z = float((content.estimate - content.truth)[parameter]) / sigma if parameter >= 0 else float("nan")
        cells.append(Cell(significant(z, 2), "doubt" if abs(z) > 3.0 else "plain"))
    return Row(cells)


def _degrees(columns: Sequence[SchemeColumn], content: CalibrationContent) -> Table:
    heads = [Column("State")]
    for column in columns:
        heads += [Column(f"{column.title}: degree", number=True), Column("gain", number=True)]
    rows = [
        Row(
            [
                Cell(name, strong=True),
                *(cell for column in columns for cell in _seen(column, number)),
            ]
        )
        for number, name in enumerate(content.names)
    ]
    ranks = "; ".join(f"{column.title} {column.rank}" for column in columns)
    return Table(
        heads,
        rows,
        f"Observability degree (white noise) and gain ratio. Of {len(content.names)} states can be told apart: "
        f"{ranks}. Marked: a gain below {_BLIND:g}.",
    )


def _seen(column: SchemeColumn, number: int) -> list[Cell]:
    gain = float(column.gain[number])
    blind = gain < _BLIND and number >= 6
    return [
        Cell(significant(float(column.degree[number]))),
        Cell(significant(gain), "bad" if blind else "plain"),
    ]


def _groups(names: Sequence[str]) -> list[tuple[str, list[int]]]:
    diagonal = {name for name in names if name[:2] in ("Kg", "Ka") and name[-1] == name[-2]}
    kinds = [
        ("Gyro bias", [name for name in names if name.startswith("eps")]),
        ("Acc. bias", [name for name in names if name.startswith("nabla")]),
        ("K_g, scale", [name for name in names if name.startswith("Kg") and name in diagonal]),
        ("K_g, angles", [name for name in names if name.startswith("Kg") and name not in diagonal]),
        ("K_a, scale", [name for name in names if name.startswith("Ka") and name in diagonal]),
        ("K_a, angles", [name for name in names if name.startswith("Ka") and name not in diagonal]),
        ("K_2", [name for name in names if name.startswith("K2")]),
    ]
    return [(title, [names.index(name) for name in members]) for title, members in kinds]


def _convergence(content: CalibrationContent) -> Block:
    position = np.arange(1.0, len(content.course) + 1.0)
    ratio = np.log10(content.course / content.target)
    plots = [
        Lane(
            title,
            [
                Curve(content.names[at], position, ratio[:, at], paint)
                for at, paint in zip(members, _PAINTS, strict=False)
            ]
            + [Curve("target", position, np.zeros(len(position)), MUTED, "--", 1.0)],
            height=105.0,
        )
        for title, members in _groups(list(content.names))
    ]
    figure = lanes("convergence", plots, "Position", description="Sigma over target after each position")
    return Figures(
        [figure],
        "Decimal logarithm of sigma over target after each dwell; below the broken line the target is reached.",
    )


def _heat_map(content: CalibrationContent) -> Block:
    caption = (
        "How far each state is known after each dwell: empty as its prior, full a thousand times better. "
        "Above: the body axis that points up."
    )
    return Figures([_heat_figure(content)], caption)


def _heat_figure(content: CalibrationContent) -> Markup:
    from matplotlib.patches import Rectangle

    count, states = content.course.shape
    decades = np.clip(np.log10(content.prior / content.course) / _FULL_DECADES, 0.0, 1.0)
    left, top = label_room(content.names), 22.0
    with drawing(WIDE, top + states * _ROW_PT + BOTTOM) as figure:
        axes = place(figure, left, top, WIDE - left - 12.0, states * _ROW_PT)
        axes.set_xlim(0.5, count + 0.5)
        axes.set_ylim(states - 0.5, -0.5)
        axes.grid(visible=False)
        axes.set_yticks(range(states), [printable(name) for name in content.names])
        axes.set_xticks(range(1, count + 1))
        axes.set_xlabel("Position")
        for position in range(count):
            axes.text(
                position + 1, -0.75, content.up_axes[position], ha="center", va="bottom", color=MUTED.light
            )
            for state in range(states):
                place_at = (position + 0.54, state - 0.46)
                shade = float(decades[position, state])
                axes.add_patch(
                    Rectangle(place_at, 0.92, 0.92, facecolor=BLUE.light, alpha=shade, linewidth=0)
                )
        return svg(figure, "heat-map", "Gain of every state after every position")
