"""The report of a system-level calibration: what a scheme sees, how it converges, and what a record gave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from bench.present.report._figures import Curve, Lane, Panel, lanes, panels
from bench.present.report._heat_map import gain_map
from bench.present.report._numbers import DASH, duration, significant
from bench.present.report._page import (
    Block,
    Cell,
    Fact,
    Facts,
    Figures,
    Headline,
    Key,
    Notes,
    Page,
    Row,
    Section,
    Table,
    Verdict,
    named,
)
from bench.present.report._palette import BLUE, FLOOR, GREEN, MUTED, ORANGE, PURPLE, SAND
from bench.present.report._parts import made, warnings
from drivers.base.arrays import Array

if TYPE_CHECKING:
    from bench.analysis.calibration import BiasWander, CalibrationRun, Estimate, Evaluation, RecordNoise
    from bench.analysis.common.uncertainty import Budget, Contribution

_CLASSICAL = ("19-position-z-up", "19-position", "23-position")
_PAINTS = (BLUE, ORANGE, GREEN, PURPLE, SAND, MUTED)
_FULL_DECADES = 3.0
_BLIND = 2.0
_REACH = 4.0
"""Estimates over time are drawn to so many targets."""
_SHOWN = 0.0005
"""Shares of a variance above this are listed."""
_SIGMAS = {
    True: "The sigmas are with the noise that the record shows.",
    False: "Every sigma here is with the noise that was told, and wrong accordingly.",
}
_LANES = {
    "Gyro bias": "eps_x eps_y eps_z",
    "Acc. bias": "nabla_x nabla_y nabla_z",
    "K_g, scale": "Kg_xx Kg_yy Kg_zz",
    "K_g, angles": "Kg_yx Kg_zx Kg_xy Kg_zy Kg_xz Kg_yz",
    "K_a, scale": "Ka_xx Ka_yy Ka_zz",
    "K_a, angles": "Ka_yx Ka_zx Ka_zy",
    "K_2": "K2_x K2_y K2_z",
}
"""The states that are drawn together."""
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
class CalibrationContent:
    """What a scheme sees, and with `estimate` what a calibration by it gave.

    `truth` (24,), SI, where the IMU is emulated; `wander` if the filter was told that the biases wander, `noise`
    what the record shows of its noise, `corrected` if the estimate is with that. `budgets`: of the parameters.
    Arrays in printed units: by state, shape (30,), by parameter (24,), or by position (positions, 30).
    """

    evaluation: Evaluation
    estimate: Estimate | None = None
    truth: Array | None = None
    created_utc: str = ""
    run: CalibrationRun | None = None
    wander: BiasWander | None = None
    noise: RecordNoise | None = None
    corrected: bool = False
    budgets: Mapping[str, Budget] = field(default_factory=dict)

    @cached_property
    def prior(self) -> Array:
        """Sigma before, by state."""
        return np.asarray(self.evaluation.task.prior_sigma / _model().UNIT_SIZE)

    @cached_property
    def target(self) -> Array:
        """Sigma wanted, by state; NaN for attitude and velocity."""
        targets = np.concatenate([np.full(6, np.nan), self.evaluation.task.target_sigma])
        return np.asarray(targets / _model().UNIT_SIZE)

    @cached_property
    def sigma(self) -> Array:
        """Sigma reached, by state."""
        sigma = self.evaluation.sigma.copy()
        if self.estimate is not None:
            sigma[_model().PARAMETERS] = self.estimate.sigma
        return np.asarray(sigma / _model().UNIT_SIZE)

    @cached_property
    def course(self) -> Array:
        """Sigma after each dwell, by position and state."""
        course = self.evaluation.course.copy()
        if self.estimate is not None and len(self.estimate.course) == len(course):
            course[:, _model().PARAMETERS] = self.estimate.course
        return np.asarray(course / _model().UNIT_SIZE)

    @cached_property
    def values(self) -> dict[str, Array]:
        """The estimate and the truth as far as they are known, by parameter."""
        size = _model().UNIT_SIZE[_model().PARAMETERS]
        known = {"Estimate": self.estimate and self.estimate.parameters, "Truth": self.truth}
        return {name: values / size for name, values in known.items() if values is not None}

    @cached_property
    def z(self) -> Array | None:
        """Errors over sigma, by parameter; None without estimate and truth."""
        if len(self.values) < 2:
            return None
        return np.asarray((self.values["Estimate"] - self.values["Truth"]) / self.sigma[6:])

    @property
    def poorly_seen(self) -> list[str]:
        """The combinations of states that the scheme hardly tells apart."""
        return [str(combination) for combination in self.evaluation.combinations]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to mind about the scheme, or about the calibration by it."""
        if self.estimate is None:
            return self.evaluation.warnings
        alarms = () if self.noise is None else self.noise.alarms
        return (
            *alarms,
            *([_SIGMAS[self.corrected]] if alarms else []),
            *_model().missed_targets(self.estimate.sigma, self.evaluation.task),
            *self.evaluation.cautions,
        )


def _model() -> ModuleType:
    from bench.analysis import calibration  # scipy behind it is slow to import

    return calibration


def calibration_page(content: CalibrationContent) -> Page:
    """Return the report."""
    schedule, run = content.evaluation.schedule, content.run
    predicted = content.estimate is None
    facts = [
        Fact("Home attitude", _model().home_text(schedule.home)),
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
            Section("Convergence", [_convergence(content)]),
            Section("Estimates over time", _estimates_over_time(content)),
            Section("State by position", [_heat_map(content)]),
        ],
        terms=_DEFINITIONS,
        colophon=made(content.created_utc),
    )


def _verdict(content: CalibrationContent) -> Verdict:
    names, estimate = _model().STATE_NAMES, content.estimate
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
        _model().STATE_UNITS[number],
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
    return named(_model().STATE_NAMES[number], *cells)


def _of_bench(part: Contribution, share: float) -> str:
    what = part.source.rsplit("_", 1)[0].replace("_", " ")
    return f"{what} {100.0 * share:.1f} %, {part.origin}"


def _uncertainties(content: CalibrationContent) -> list[Block]:
    """Return value and 95 % interval of every parameter, and how much of the variance noise and bench make."""
    rows = []
    units = dict(zip(_model().PARAMETER_NAMES, _model().STATE_UNITS[6:], strict=True))
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


def _degrees(schemes: Mapping[str, Evaluation]) -> Table:
    names = _model().STATE_NAMES
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
    seen = {" ".join(map(str, part.moves)): _model().evaluate(evaluation.task, part) for part in parts}
    return seen | {"whole scheme": evaluation}


def _others(evaluation: Evaluation) -> dict[str, Evaluation]:
    """Return the classical schemes in their own homes, and in this scheme's, under the same task and dwell."""
    schedule = evaluation.schedule
    pattern = {"dwell_s": schedule.dwell_s, "rate_dps": schedule.rate_dps, "profile": schedule.profile}
    seen = {schedule.name: evaluation}
    for name in _CLASSICAL:
        if name != schedule.name:
            scheme = _model().load_scheme(name).with_(**pattern)
            seen[scheme.name] = _model().evaluate(evaluation.task, scheme)
    return seen


def _convergence(content: CalibrationContent) -> Block:
    position = np.arange(1.0, len(content.course) + 1.0)
    ratio = np.log10(content.course / content.target)
    by_name = dict(zip(_model().STATE_NAMES, ratio.T, strict=True))
    plots = []
    for title, states in _LANES.items():
        curves = [
            Curve(state, position, by_name[state], paint)
            for state, paint in zip(states.split(), _PAINTS, strict=False)
        ]
        curves.append(Curve("target", position, np.zeros(len(position)), MUTED, "--", 1.0))
        plots.append(Lane(title, curves, height=105.0))
    caption = (
        "Decimal logarithm of sigma over target after each dwell; below the broken line the target is "
        "reached."
    )
    about = "Sigma over target after each position"
    return lanes("convergence", plots, "Position", caption, description=about)


def _estimates_over_time(content: CalibrationContent) -> list[Block]:
    """Return every estimate with two of its sigma after each rest, about the truth or the last estimate."""
    estimate = content.estimate
    if estimate is None:
        return []
    model = _model()
    target = content.evaluation.task.target_sigma
    about = estimate.parameters if content.truth is None else content.truth
    minutes = estimate.course_s / 60.0
    off, spread = ((part / target).T for part in (estimate.course_parameters - about, 2.0 * estimate.course))
    plots = [
        Panel(
            [
                Curve("estimate", minutes, np.clip(off[number], -_REACH, _REACH), BLUE),
                Curve(
                    "two sigma", minutes, np.clip(off[number] + spread[number], -_REACH, _REACH), MUTED, "--"
                ),
                Curve(
                    "two sigma", minutes, np.clip(off[number] - spread[number], -_REACH, _REACH), MUTED, "--"
                ),
            ],
            f"{name}, target {target[number] / model.UNIT_SIZE[6 + number]:g} {model.STATE_UNITS[6 + number]}",
            floor=1.0,
            description=f"estimate of {name} and its sigma over time",
        )
        for number, name in enumerate(model.PARAMETER_NAMES)
    ]
    of = "last estimate" if content.truth is None else "truth"
    caption = (
        f"Estimates less the {of}, in targets, after each rest, and two sigma on both sides; shaded: one target. "
        f"What is beyond {_REACH:g} targets lies on the border."
    )
    keys = [Key("estimate", BLUE), Key("two sigma", MUTED), Key("one target", FLOOR, "band")]
    y_label = f"less the {of}, targets"
    return [panels("estimates", plots, caption, keys, x_label="time, min", y_label=y_label)]


def _heat_map(content: CalibrationContent) -> Block:
    caption = (
        "How far each state is known after each dwell: empty as its prior, full a thousand times better. "
        "Above: the body axis that points up."
    )
    decades = np.clip(np.log10(content.prior / content.course) / _FULL_DECADES, 0.0, 1.0)
    up_axes, about = content.evaluation.schedule.up_axes(), "Gain of every state after every position"
    return Figures([gain_map("heat-map", _model().STATE_NAMES, up_axes, decades, about)], caption)
