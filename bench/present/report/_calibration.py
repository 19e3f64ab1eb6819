"""The report of a system-level calibration: what a scheme sees, how it converges, and what a record gave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench.present.report._figures import Curve, Lane, lanes
from bench.present.report._heat_map import gain_map
from bench.present.report._numbers import DASH, duration, significant
from bench.present.report._page import (
    Block,
    Cell,
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
    named,
    numbers,
    texts,
)
from bench.present.report._palette import BLUE, GREEN, MUTED, ORANGE, PURPLE, SAND
from bench.present.report._parts import made, warnings
from drivers.base.arrays import Array

if TYPE_CHECKING:
    from bench.analysis.calibration import BiasWander, CalibrationRun, Estimate, Evaluation

CLASSICAL = ("19-position", "23-position")
_LOUD = 1.1
_PAINTS = (BLUE, ORANGE, GREEN, PURPLE, SAND, MUTED)
_FULL_DECADES = 3.0
_BLIND = 2.0
_NOISIER = (
    "Innovations have rms {:.2f}: the unit is noisier than assumed, or its biases wander. Every sigma here is "
    "too small: give the noise (--arw, --vrw, --wander-dph, --wander-ug)."
)
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


@dataclass(frozen=True, eq=False)
class SchemeColumn:
    """What one scheme, or the first turns of one, sees: white-noise degree and gain ratio by state, (30,)."""

    title: str
    rank: int
    degree: Array
    gain: Array


@dataclass(frozen=True, eq=False)
class CalibrationContent:
    """What the report shows, in printed units; arrays by state, shape (30,), or by position, (positions, 30).

    `target` is NaN for states without one. `estimate`, `truth` (24,): of the parameters, None where not known;
    `nees`: mean square of the errors over their covariance, 1 if sigma is right. `first_turns`: this scheme cut
    after so many turns; `others`: classical schemes under the same task, beside it.
    """

    evaluation: Evaluation
    names: Sequence[str]
    units: Sequence[str]
    prior: Array
    sigma: Array
    target: Array
    course: Array
    poorly_seen: Sequence[str] = ()
    warnings: Sequence[str] = ()
    estimate: Array | None = None
    truth: Array | None = None
    nees: float | None = None
    innovation_rms: float | None = None
    first_turns: Sequence[SchemeColumn] = ()
    others: Sequence[SchemeColumn] = ()
    facts: Sequence[tuple[str, str]] = ()
    created_utc: str = ""


def calibration_content(
    evaluation: Evaluation,
    estimate: Estimate | None = None,
    truth: Array | None = None,
    created_utc: str = "",
    *,
    run: CalibrationRun | None = None,
    wander: BiasWander | None = None,
) -> CalibrationContent:
    """Return what the report shows of a scheme, and with `estimate` of a calibration by it.

    `truth` (24,), SI, where the IMU is emulated.
    """
    from bench.analysis import calibration as model

    task, size, parameters = evaluation.task, model.UNIT_SIZE, model.PARAMETERS
    sigma, course, warnings = evaluation.sigma / size, evaluation.course / size, evaluation.warnings
    nees = None
    if estimate is not None:
        sigma[parameters] = estimate.sigma / size[parameters]
        if len(estimate.course) == len(course):
            course[:, parameters] = estimate.course / size[parameters]
        if truth is not None:
            error = estimate.parameters - truth
            nees = float(error @ np.linalg.solve(estimate.covariance, error)) / len(error)
        loud = estimate.innovation_rms > _LOUD and wander is None
        warnings = (
            *([_NOISIER.format(estimate.innovation_rms)] if loud else []),
            *model.missed_targets(estimate.sigma, task),
            *evaluation.cautions,
        )
    return CalibrationContent(
        evaluation=evaluation,
        names=model.STATE_NAMES,
        units=model.STATE_UNITS,
        prior=task.prior_sigma / size,
        sigma=sigma,
        target=np.concatenate([np.full(6, np.nan), task.target_sigma]) / size,
        course=course,
        poorly_seen=[str(combination) for combination in evaluation.combinations],
        warnings=warnings,
        estimate=None if estimate is None else estimate.parameters / size[parameters],
        truth=None if truth is None else truth / size[parameters],
        nees=nees,
        innovation_rms=None if estimate is None else estimate.innovation_rms,
        first_turns=_first_turns(evaluation),
        others=_others(evaluation),
        facts=[] if run is None else _facts(run),
        created_utc=created_utc,
    )


def calibration_page(content: CalibrationContent) -> Page:
    """Return the report."""
    from bench.analysis.calibration import home_text

    schedule = content.evaluation.schedule
    return Page(
        title=f"{'Scheme' if content.estimate is None else 'Calibration by'} {schedule.name}",
        kind="System-level calibration" + (", prediction" if content.estimate is None else ""),
        facts=[
            Fact("Home attitude", home_text(schedule.home)),
            Fact("Table", content.evaluation.table),
            Fact("Positions", str(len(schedule.up_axes()))),
            Fact("Dwell", duration(schedule.dwell_s)),
            Fact("Duration", duration(schedule.duration_s)),
            *(Fact(title, text) for title, text in content.facts),
        ],
        verdict=_verdict(content),
        sections=[
            warnings(content.warnings),
            Section("Schedule", [Facts([Fact("Turns", " ".join(map(str, schedule.moves)), code=True)])]),
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


def _ratio(content: CalibrationContent) -> Array:
    return content.sigma / content.target


def _verdict(content: CalibrationContent) -> Verdict:
    ratio = _ratio(content)[6:]
    missed = int(np.sum(ratio > 1.0))
    worst = int(np.argmax(ratio))
    sentences = [
        f"{len(ratio) - missed} of {len(ratio)} parameters reach their target sigma; the worst is "
        f"{content.names[6 + worst]}."
    ]
    rank = content.evaluation.degrees.rank
    if rank < len(content.names):
        sentences.append(f"Only {rank} of {len(content.names)} states can be told apart.")
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
    columns = texts("State", "Unit")
    columns += numbers("Prior σ", "σ", "Target", "σ / target", "Gain ratio", "Degree")
    columns += numbers("Estimate") if content.estimate is not None else []
    columns += numbers("Truth", "Error / σ") if content.truth is not None else []
    ratio = _ratio(content)
    rows = [_state(content, number, float(ratio[number])) for number in range(len(content.names))]
    return Table(columns, rows, "Prior and reached sigma by state; φ and δv have no target.")


def _state(content: CalibrationContent, number: int, ratio: float) -> Row:
    prior, sigma = float(content.prior[number]), float(content.sigma[number])
    cells: list[str | Cell] = [
        content.units[number],
        significant(prior),
        significant(sigma),
        significant(float(content.target[number])),
        Cell(significant(ratio), "bad" if ratio > 1.0 else "plain"),
        significant(prior / sigma),
        significant(float(content.evaluation.degrees.normalised[number])),
    ]
    parameter = number - 6
    cells += [
        significant(float(values[parameter]), 4) if parameter >= 0 else DASH
        for values in (content.estimate, content.truth)
        if values is not None
    ]
    if content.estimate is not None and content.truth is not None:
        z = float((content.estimate - content.truth)[parameter]) / sigma if parameter >= 0 else float("nan")
        cells.append(Cell(significant(z, 2), "doubt" if abs(z) > 3.0 else "plain"))
    return named(content.names[number], *cells)


def _degrees(columns: Sequence[SchemeColumn], content: CalibrationContent) -> Table:
    heads = texts("State")
    for column in columns:
        heads += numbers(f"{column.title}: degree", "gain")
    rows = [
        named(name, *(cell for column in columns for cell in _seen(column, number)))
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
                Curve(content.names[state], position, ratio[:, state], paint)
                for state, paint in zip(members, _PAINTS, strict=False)
            ]
            + [Curve("target", position, np.zeros(len(position)), MUTED, "--", 1.0)],
            height=105.0,
        )
        for title, members in _groups(list(content.names))
    ]
    caption = (
        "Decimal logarithm of sigma over target after each dwell; below the broken line the target is "
        "reached."
    )
    about = "Sigma over target after each position"
    return lanes("convergence", plots, "Position", caption, description=about)


def _heat_map(content: CalibrationContent) -> Block:
    caption = (
        "How far each state is known after each dwell: empty as its prior, full a thousand times better. "
        "Above: the body axis that points up."
    )
    decades = np.clip(np.log10(content.prior / content.course) / _FULL_DECADES, 0.0, 1.0)
    up_axes, about = content.evaluation.schedule.up_axes(), "Gain of every state after every position"
    gained = gain_map("heat-map", content.names, up_axes, decades, about)
    return Figures([gained], caption)


def _facts(run: CalibrationRun) -> list[tuple[str, str]]:
    facts = [("Unit", run.unit_id), ("Record", run.run_id), ("Latitude", f"{run.latitude_deg:.4f} deg")]
    if run.mounting:
        facts.append(("Mounted with all axes at 0", run.mounting))
    if run.turn_s:
        turned = f"{min(run.turn_s):.1f} to {max(run.turn_s):.1f} s"
        facts.append(("Turns as the table made them, settling included", turned))
    return facts


def _column(title: str, evaluation: Evaluation) -> SchemeColumn:
    degrees = evaluation.degrees
    return SchemeColumn(title, degrees.rank, degrees.normalised, evaluation.gain)


def _first_turns(evaluation: Evaluation) -> list[SchemeColumn]:
    """Return what the first one, two, three turns alone would see, and the whole scheme."""
    from bench.analysis.calibration import evaluate

    schedule = evaluation.schedule
    columns = []
    for count in (1, 2, 3):
        if count < len(schedule.moves):
            part = schedule.with_(moves=schedule.moves[:count])
            title = " ".join(str(move) for move in part.moves)
            columns.append(_column(title, evaluate(evaluation.task, part)))
    return [*columns, _column("whole scheme", evaluation)]


def _others(evaluation: Evaluation) -> list[SchemeColumn]:
    """Return the classical schemes in their own homes, and in this scheme's, under the same task and dwell."""
    from bench.analysis.calibration import evaluate, load_scheme

    schedule = evaluation.schedule
    pattern = {"dwell_s": schedule.dwell_s, "rate_dps": schedule.rate_dps, "profile": schedule.profile}
    names = [name for name in ("19-position-z-up", *CLASSICAL) if name != schedule.name]
    schemes = [load_scheme(name).with_(**pattern) for name in names]
    columns = [_column(scheme.name, evaluate(evaluation.task, scheme)) for scheme in schemes]
    return [_column(schedule.name, evaluation), *columns]
