"""What a scheme can and cannot see, before it is run: degrees, predicted sigma, convergence, weak spots.

The paper's degree of observability of state i is beta_i = || part of column i of Q that is orthogonal to all
others ||, found from null spaces. It equals 1 / || row i of the pseudo-inverse of Q || where unit vector i is in
the row space of Q, and 0 otherwise: there the pseudo-inverse alone misleads, hence the rank test. For white noise
beta_i = sigma_v / sqrt(CRLB_ii). The velocity error of a real navigator is an integrated random walk, so the
degree is a screening figure; the Kalman gain ratio (prior over posterior sigma) is the one to design with.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from bench.analysis.calibration._conventions import (
    PARAMETER_NAMES,
    PARAMETERS,
    STATE_NAMES,
    STATE_UNITS,
    UNIT_SIZE,
    Task,
)
from bench.analysis.calibration._expected import expected_innovations, still_table
from bench.analysis.calibration._model import observability_matrix
from bench.analysis.calibration._schedule import Schedule, home_text, moves_text
from bench.analysis.calibration._search import Merit, merit_of
from bench.analysis.calibration._segments import (
    chain_segments,
    covariance,
    fold,
    posterior_sigma,
    schedule_segments,
)
from bench.analysis.calibration._table import Table, require_possible
from drivers.base.arrays import Array

_UNSEEN = 0.5
"""A combination whose sigma is still above this part of its prior is called poorly seen."""
_SHARE = 0.15
_RANK_TOLERANCE = 1e-9
_SEEN_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Observability:
    """Degrees by state, shape (30,): `normalised` = prior sigma / white-noise sigma."""

    normalised: Array
    rank: int


def observability(q: Array, task: Task, tolerance: float = _RANK_TOLERANCE) -> Observability:
    """Return the degrees of Q (m, 30); singular values below `tolerance` of the largest count as zero."""
    scaled = q * (task.prior_sigma / task.noise.velocity_mps)
    _, singular, right = np.linalg.svd(np.linalg.qr(scaled, mode="r"))
    rank = int(np.sum(singular > tolerance * singular[0]))
    # Row i of the pseudo-inverse is right[:rank, i] / singular @ left^T, and the left vectors are orthonormal.
    inverse_norm = np.sqrt(np.sum((right[:rank] / singular[:rank, None]) ** 2, axis=0))
    seen = np.linalg.norm(right[rank:], axis=0) < _SEEN_TOLERANCE
    normalised = np.where(seen, 1.0 / np.maximum(inverse_norm, np.finfo(float).tiny), 0.0)
    return Observability(normalised, rank)


@dataclass(frozen=True)
class Combination:
    """A combination of parameters that is poorly seen: `remaining` = posterior over prior sigma of it.

    `shares`: (parameter, share) in units of prior sigma, the larger ones.
    """

    remaining: float
    shares: tuple[tuple[str, float], ...]

    def __str__(self) -> str:
        terms = " ".join(f"{share:+.2f} {name}" for name, share in self.shares)
        return f"{terms}: {100 * self.remaining:.0f} % of the prior sigma remains"


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A scheme under a task; SI: `sigma` (30,) at the end, `course` (positions, 30) after each dwell.

    `cautions`: what to mind about the scheme itself; `warnings` also names the targets that it misses.
    """

    schedule: Schedule
    task: Task
    table: Table
    degrees: Observability
    sigma: Array
    course: Array
    merit: Merit
    combinations: tuple[Combination, ...]
    cautions: tuple[str, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """The cautions after the targets missed, if any."""
        return (*missed_targets(self.sigma[PARAMETERS], self.task), *self.cautions)

    @cached_property
    def still_innovations(self) -> Array:
        """Rms of innovations to expect at each position, (positions,), on a table that does not move; 1 if it
        jitters as told.
        """
        return expected_innovations(self.task, self.schedule, still_table(self.task.noise))

    @property
    def gain(self) -> Array:
        """Kalman gain ratio, prior over posterior sigma, shape (30,)."""
        return np.asarray(self.task.prior_sigma / self.sigma)

    def as_json(self) -> dict[str, Any]:
        """Return the evaluation as plain values, in printed units."""
        schedule = self.schedule
        return {
            "scheme": schedule.name,
            "home": home_text(schedule.home),
            "moves": moves_text(schedule.moves),
            "table": self.table,
            "positions": schedule.positions,
            "dwell_s": schedule.dwell_s,
            "duration_s": schedule.duration_s,
            "latitude_deg": self.task.site.latitude_deg,
            "gravity_mps2": self.task.site.gravity_mps2,
            "worst_sigma_over_target": self.merit.worst,
            "rms_sigma_over_target": self.merit.rms,
            "rank": self.degrees.rank,
            "innovations_still_table": float(np.sqrt(np.mean(self.still_innovations**2))),
            "states": [self._state(number) for number in range(len(STATE_NAMES))],
            "poorly_seen": [
                {"remaining": combination.remaining, "shares": dict(combination.shares)}
                for combination in self.combinations
            ],
            "warnings": list(self.warnings),
        }

    def _state(self, number: int) -> dict[str, Any]:
        unit = UNIT_SIZE[number]
        target = None if number < 6 else float(self.task.target_sigma[number - 6] / unit)
        return {
            "name": STATE_NAMES[number],
            "unit": STATE_UNITS[number],
            "prior_sigma": float(self.task.prior_sigma[number] / unit),
            "sigma": float(self.sigma[number] / unit),
            "target_sigma": target,
            "white_noise_degree": float(self.degrees.normalised[number]),
            "kalman_gain_ratio": float(self.gain[number]),
            "sigma_by_position": [float(value) for value in self.course[:, number] / unit],
        }


def evaluate(task: Task, schedule: Schedule, table: Table = "by-hand") -> Evaluation:
    """Return what the schedule shows; ConfigurationError if the table cannot turn it. Takes about 50 ms."""
    require_possible(table, schedule)
    reached = chain_segments(schedule_segments(task, schedule))
    scaled = np.array([np.sqrt(np.diag(covariance(segment))) for segment in reached])
    course = scaled * task.prior_sigma
    last = covariance(reached[-1])[PARAMETERS, PARAMETERS]
    merit = merit_of(course[-1, PARAMETERS], task)
    degrees = observability(observability_matrix(task.site, schedule), task)
    return Evaluation(
        schedule=schedule,
        task=task,
        table=table,
        degrees=degrees,
        sigma=course[-1],
        course=course,
        merit=merit,
        combinations=poorly_seen(last),
        cautions=tuple(_cautions(task, schedule, course[-1], degrees)),
    )


def poorly_seen(scaled_covariance: Array) -> tuple[Combination, ...]:
    """Return the eigenvectors of a prior-scaled parameter covariance (24, 24) that the scheme hardly shrank."""
    values, vectors = np.linalg.eigh(scaled_covariance)
    found = []
    for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
        if value < _UNSEEN**2:
            break
        large = [at for at in np.argsort(-np.abs(vector)) if abs(vector[at]) >= _SHARE]
        sign = np.sign(vector[large[0]])
        shares = tuple((PARAMETER_NAMES[at], float(sign * vector[at])) for at in large)
        found.append(Combination(float(np.sqrt(max(value, 0.0))), shares))
    return tuple(found)


def missed_targets(sigma: Array, task: Task) -> tuple[str, ...]:
    """Return a sentence on the parameters whose sigma (24,), SI, is above target, the worst first; none: ()."""
    ratio = sigma / task.target_sigma
    missed = [f"{PARAMETER_NAMES[at]} {ratio[at]:.2f} x" for at in np.argsort(-ratio) if ratio[at] > 1.0]
    return ("Targets missed (sigma over target): " + ", ".join(missed) + ".",) if missed else ()


def _cautions(task: Task, schedule: Schedule, sigma: Array, degrees: Observability) -> list[str]:
    texts = []
    if not schedule.closes:
        texts.append("The scheme does not end at home: the next run cannot start where this one ends.")
    ratio = sigma[PARAMETERS] / task.target_sigma
    if degrees.rank < len(STATE_NAMES):
        texts.append(
            f"Only {degrees.rank} of {len(STATE_NAMES)} states can be told apart: the others keep their prior, "
            "and their estimates are no measurement."
        )
    better = _better_home(task, schedule, float(ratio.max()))
    if better:
        texts.append(better)
    net = [axis for axis, turns in zip("xyz", schedule.net_turns, strict=True) if turns]
    if net and ratio.max() <= 1.0:
        texts.append(
            f"The turns about {', '.join(net)} do not add up to zero: an error of latitude shows up in the scale "
            "factor of that gyro (0.1 deg: several ppm)."
        )
    texts.append(
        "Gravity: an error of 1 mGal is 1.02 ppm in all accelerometer scale factors. Latitude: needed to .01 deg."
    )
    return texts


def _better_home(task: Task, schedule: Schedule, worst: float) -> str:
    """Return advice if the same turns from another home are at least a third better."""
    best, name = worst, ""
    for cycle in ([0, 1, 2], [1, 2, 0], [2, 0, 1]):
        # The same turns; only which body axis is up at the start changes.
        home = np.eye(3)[:, cycle]
        other = schedule.with_(home=home)
        end = fold(schedule_segments(task, other))
        found = merit_of(posterior_sigma(end.information, task), task)
        if found.worst < best / 1.5:
            best, name = found.worst, home_text(home)
    if not name:
        return ""
    return (
        f"Home attitude: the same turns started with {name} reach a worst sigma over target of {best:.2f} "
        f"instead of {worst:.2f}."
    )
