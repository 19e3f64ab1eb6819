"""The report of a system-level calibration: what a scheme sees, how it converges, and what a record gave."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from bench.present.report._calibration_content import CalibrationContent, calibration_model
from bench.present.report._calibration_figures import (
    convergence,
    estimates_over_time,
    heat_map,
)
from bench.present.report._numbers import DASH, duration, fixed, significant
from bench.present.report._page import (
    Block,
    Cell,
    Fact,
    Facts,
    Headline,
    Notes,
    Page,
    Row,
    Section,
    Table,
    Tone,
    Verdict,
    named,
)
from bench.present.report._parts import made, warnings
from drivers.base.constants import ARCSEC_PER_RAD

if TYPE_CHECKING:
    from bench.analysis.calibration import Evaluation
    from bench.analysis.common.uncertainty import Contribution

_CLASSICAL = ("19-position-z-up", "19-position", "23-position")
_BLIND = 2.0
_SHOWN = 0.0005
"""Shares of a variance above this are listed."""
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
    schedule, run = content.evaluation.schedule, content.run
    predicted = content.estimate is None
    facts = [
        Fact("Home attitude", calibration_model().home_text(schedule.home)),
        Fact("Table", content.evaluation.table),
        Fact("Positions", str(len(schedule.up_axes()))),
        Fact("Dwell", duration(schedule.dwell_s)),
        Fact("Duration", duration(schedule.duration_s)),
    ]
    if run is not None:
        facts += [Fact("Unit", run.unit_id), Fact("Record", run.run_id)]
        facts.append(Fact("Latitude", f"{run.latitude_deg:.4f} deg"))
        facts.append(Fact("Mounted with all axes at 0", run.mounting))
        turned = f"{min(run.turn_s):.1f} to {max(run.turn_s):.1f} s" if run.turn_s else ""
        facts.append(Fact("Turns as the table made them, settling included", turned))
    return Page(
        title=f"{'Scheme' if predicted else 'Calibration by'} {schedule.name}",
        kind="System-level calibration" + (", prediction" if predicted else ""),
        facts=facts,
        verdict=_verdict(content),
        sections=[
            warnings(content.warnings),
            Section("Schedule", [Facts([Fact("Turns", " ".join(map(str, schedule.moves)), code=True)])]),
            Section("States", [_states(content)]),
            Section("Uncertainty of the parameters", _uncertainties(content)),
            Section("Degrees as turns are added", [_degrees(_first_turns(content.evaluation))]),
            Section("Beside the classical schemes", [_degrees(_others(content.evaluation))]),
            Section("Poorly seen combinations", [Notes(content.poorly_seen)]),
            Section("Innovations", _innovations(content)),
            Section("Noise for a navigation filter", _inflation(content)),
            Section("Convergence", [convergence(content)]),
            Section("Estimates over time", estimates_over_time(content)),
            Section("State by position", [heat_map(content)]),
        ],
        terms=_DEFINITIONS,
        colophon=made(content.created_utc),
    )


def _verdict(content: CalibrationContent) -> Verdict:
    names, estimate = calibration_model().STATE_NAMES, content.estimate
    ratio = (content.sigma / content.target)[6:]
    missed = int(np.sum(ratio > 1.0))
    worst = int(np.argmax(ratio))
    sentences = [
        f"{len(ratio) - missed} of {len(ratio)} parameters reach their target sigma; the worst is "
        f"{names[6 + worst]}."
    ]
    rank = content.evaluation.degrees.rank
    if rank < len(names):
        sentences.append(f"Only {rank} of {len(names)} states can be told apart.")
    figures = [
        ("Worst sigma over target", ratio[worst], names[6 + worst]),
        ("Rms sigma over target", np.sqrt(np.mean(ratio**2)), ""),
    ]
    if estimate is not None:
        figures.append(("Innovations, rms", estimate.innovation_rms, "1 if the noise is as assumed"))
    if estimate is not None and content.truth is not None and content.z is not None:
        error = estimate.parameters - content.truth
        nees = error @ np.linalg.solve(estimate.covariance, error) / len(error)
        figures.append(
            ("Errors over sigma, rms", np.sqrt(np.mean(content.z**2)), "against the emulated truth")
        )
        figures.append(("NEES / 24", nees, "1 if the covariance is right; 0.5 to 1.6"))
    headlines = [Headline(label, significant(float(value)), note=note) for label, value, note in figures]
    word = f"{missed} targets missed" if missed else "All targets met"
    return Verdict(word, "bad" if missed else "good", sentences, headlines)


def _states(content: CalibrationContent) -> Table:
    heads = ["State", "Unit", ">Prior σ", ">σ", ">Target", ">σ / target", ">Gain ratio", ">Degree"]
    heads += [f">{name}" for name in content.values] + ([] if content.z is None else [">Error / σ"])
    rows = [_state(content, number) for number in range(len(content.sigma))]
    return Table(heads, rows, "Prior and reached sigma by state; φ and δv have no target.")


def _state(content: CalibrationContent, number: int) -> Row:
    prior, sigma, target = (float(a[number]) for a in (content.prior, content.sigma, content.target))
    cells: list[str | Cell] = [
        calibration_model().STATE_UNITS[number],
        significant(prior),
        significant(sigma),
        significant(target),
        Cell(significant(sigma / target), "bad" if sigma > target else "plain"),
        significant(prior / sigma),
        significant(float(content.evaluation.degrees.normalised[number])),
    ]
    parameter = number - 6
    cells += [
        significant(float(values[parameter]), 4) if parameter >= 0 else DASH
        for values in content.values.values()
    ]
    if content.z is not None:
        z = float(content.z[parameter]) if parameter >= 0 else float("nan")
        cells.append(Cell(significant(z, 2), "doubt" if abs(z) > 3.0 else "plain"))
    return named(calibration_model().STATE_NAMES[number], *cells)


def _of_bench(part: Contribution, share: float) -> str:
    what = part.source.rsplit("_", 1)[0].replace("_", " ")
    return f"{what} {100.0 * share:.1f} %, {part.origin}"


def _uncertainties(content: CalibrationContent) -> list[Block]:
    """Return value and 95 % interval of every parameter, and how much of the variance noise and bench make."""
    rows = []
    units = dict(zip(calibration_model().PARAMETER_NAMES, calibration_model().STATE_UNITS[6:], strict=True))
    for name, budget in content.budgets.items():
        noise, *bench = budget.contributions
        shown = [part for part in bench if budget.share(part) > _SHOWN]
        row = named(
            name,
            significant(budget.value, 4),
            significant(budget.half_width, 2),
            units[name],
            f"{100.0 * budget.share(noise):.1f}",
            "; ".join(_of_bench(part, budget.share(part)) for part in shown) or DASH,
        )
        rows.append(row)
    heads = ["Parameter", ">Estimate", ">±", "Unit", ">Noise [%]", "The bench, share and certificate"]
    caption = (
        "± is half of the 95 % interval (JCGM 100): noise as the filter has it, gravity, time base and latitude "
        "as their certificates have them. Angles of the table are no references of a scheme and add nothing."
    )
    return [Table(heads, rows, caption)] if rows else []


def _innovations(content: CalibrationContent) -> list[Block]:
    """Return the rms of innovations by position: what the schedule leads to expect, and what a record gave."""
    still, noise = content.evaluation.still_innovations, content.noise
    up = content.evaluation.schedule.up_axes()
    heads = ["Position", "Up", ">Still table"]
    rows: list[list[str | Cell]] = [[up[number], fixed(value, 2)] for number, value in enumerate(still)]
    caption = (
        "Rms of innovations over the filter's own sigma, noise as told. Still table: expected where the table "
        "does not move; 1 is expected where it jitters as told."
    )
    if noise is not None and len(noise.innovations) == len(rows) == len(noise.expected):
        heads += [">This table", ">Record"]
        caption += " This table: expected with sensors as told and the jitter that the rests show."
        named_rests = {number for number, _ in noise.disturbed}
        for number, row in enumerate(rows):
            tone: Tone = "bad" if number in named_rests else "plain"
            row += [fixed(noise.expected[number], 2), Cell(fixed(noise.innovations[number], 2), tone)]
    return [Table(heads, [named(str(number + 1), *row) for number, row in enumerate(rows)], caption)]


def _inflation(content: CalibrationContent) -> list[Block]:
    """Return by how much a navigation filter has to take the noise larger, error by error."""
    found = content.inflation
    if found is None:
        return []
    heads = ["Error, 1 σ", "Unit"]
    heads += [f">{part}, {each:g} h" for each in found.hours for part in ("White", "Whole", "Factor")]
    units = (("heading", "″", ARCSEC_PER_RAD), ("velocity", "m/s", 1.0), ("position", "m", 1.0))
    rows = []
    for (name, unit, size), *values in zip(units, found.white, found.whole, found.factors, strict=True):
        each = [(size * white, size * whole, factor) for white, whole, factor in zip(*values, strict=True)]
        rows.append(named(name, unit, *(significant(float(value)) for part in each for value in part)))
    caption = (
        "Errors of an unaided INS at rest, altitude held, its biases those of this calibration: by white noise, "
        "and with the wander about their mean. A filter that takes the noise "
        f"{significant(found.factor)} times as large covers all of them. The record of {found.record_h:.1f} h "
        "shows no wander slower than itself."
    )
    return [Table(heads, rows, caption)]


def _degrees(schemes: Mapping[str, Evaluation]) -> Table:
    names = calibration_model().STATE_NAMES
    heads = ["State", *(head for title in schemes for head in (f">{title}: degree", ">gain"))]
    rows = [
        named(name, *(cell for scheme in schemes.values() for cell in _seen(scheme, number)))
        for number, name in enumerate(names)
    ]
    ranks = "; ".join(f"{title} {scheme.degrees.rank}" for title, scheme in schemes.items())
    return Table(
        heads,
        rows,
        f"Observability degree (white noise) and gain ratio. Of {len(names)} states can be told apart: "
        f"{ranks}. Marked: a gain below {_BLIND:g}.",
    )


def _seen(scheme: Evaluation, number: int) -> list[Cell]:
    degree, gain = float(scheme.degrees.normalised[number]), float(scheme.gain[number])
    blind = gain < _BLIND and number >= 6
    return [Cell(significant(degree)), Cell(significant(gain), "bad" if blind else "plain")]


def _first_turns(evaluation: Evaluation) -> dict[str, Evaluation]:
    """Return what the first one, two, three turns alone would see, and the whole scheme."""
    schedule = evaluation.schedule
    parts = [
        schedule.with_(moves=schedule.moves[:count]) for count in (1, 2, 3) if count < len(schedule.moves)
    ]
    seen = {
        " ".join(map(str, part.moves)): calibration_model().evaluate(evaluation.task, part) for part in parts
    }
    return seen | {"whole scheme": evaluation}


def _others(evaluation: Evaluation) -> dict[str, Evaluation]:
    """Return the classical schemes in their own homes, and in this scheme's, under the same task and dwell."""
    schedule = evaluation.schedule
    pattern = {"dwell_s": schedule.dwell_s, "rate_dps": schedule.rate_dps, "profile": schedule.profile}
    seen = {schedule.name: evaluation}
    for name in _CLASSICAL:
        if name != schedule.name:
            scheme = calibration_model().load_scheme(name).with_(**pattern)
            seen[scheme.name] = calibration_model().evaluate(evaluation.task, scheme)
    return seen
