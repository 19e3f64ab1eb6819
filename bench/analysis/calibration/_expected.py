"""What innovations a scheme leads to expect, rest by rest, and whether a record's are that.

A filter whitens innovations by its own covariance. They have an rms of 1 where the noise is as it was told, and
of less where the table stands stiller than told: with 1 mm/s told, a table that does not move at all leaves a
fifth. So the value to hold a record against follows from scheme, noise told and noise there: the error of a
filter that runs with the gains of the noise told is driven by the noise there (Jazwinski, Stochastic Processes
and Filtering Theory, 1970, section 7.8).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.analysis.calibration._conventions import STATES, Noise, Task
from bench.analysis.calibration._model import (
    dwell_transitions,
    measurement_times,
    process_noise,
    turn_transitions,
)
from bench.analysis.calibration._schedule import Schedule
from bench.analysis.common.statistics import stretches
from drivers.base.arrays import Array

_ALPHA = 1e-3
STILL = 0.0
"""Velocity of a table that does not move, m/s."""


def expected_innovations(task: Task, schedule: Schedule, there: Noise) -> Array:
    """Return the rms of whitened innovations to expect at each position, (positions,).

    The filter runs with `task.noise`; the noise is `there`. Of the first error the prior holds.
    """
    scale = task.prior_sigma
    attitudes = schedule.attitudes()
    times = measurement_times(schedule.dwell_s)
    steps = dwell_transitions(task.site, attitudes, times[:1])[:, 0]
    turns = turn_transitions(task.site, attitudes[:-1], schedule.moves, schedule.rate_dps, schedule.profile)
    told, true = (_Filtering(task, noise) for noise in (task.noise, there))
    p, error = np.eye(STATES), np.eye(STATES)
    found = []
    for number, step in enumerate(steps):
        whole = _scaled(step, scale)
        square = 0.0
        for _ in times:
            p, error = told.ahead(p, whole, times[0]), true.ahead(error, whole, times[0])
            own = p[3:6, 3:6] + told.r
            square += float(np.trace(np.linalg.solve(own, error[3:6, 3:6] + true.r)))
            gain = np.linalg.solve(own, p[3:6]).T
            left = np.eye(STATES)
            left[:, 3:6] -= gain
            error = left @ error @ left.T + gain @ true.r @ gain.T
            p = p - gain @ p[3:6]
        found.append(np.sqrt(square / (3.0 * len(times))))
        if number < len(turns):
            whole = _scaled(turns[number], scale)
            turn_s = abs(schedule.moves[number].angle_deg) / schedule.rate_dps
            p, error = told.ahead(p, whole, turn_s), true.ahead(error, whole, turn_s)
    return np.array(found)


def still_table(noise: Noise) -> Noise:
    """Return the noise told, on a table that does not move."""
    return replace(noise, velocity_mps=STILL)


def by_rest(innovations: Sequence[Array], resting: NDArray[np.bool_]) -> list[Array]:
    """Return whitened innovations, (3,) for each interval of rest of `resting` (m,), as (k, 3) for each rest."""
    ends = np.cumsum([stop - start for start, stop in stretches(resting)])
    return np.split(np.array(innovations), ends[:-1])


def disturbed_rests(rests: Sequence[Array]) -> list[tuple[int, float]]:
    """Return (rest, rms) of rests whose innovations are larger than the others' by more than their scatter.

    `rests`: whitened innovations (k, 3) with the noise that the record shows. Their sum of squares is chi-square;
    one in a thousand records has a rest that is named by chance.
    """
    from scipy.stats import chi2  # slow to import

    found = []
    for number, innovations in enumerate(rests):
        square = float((innovations**2).sum())
        if chi2.sf(square, innovations.size) < _ALPHA / len(rests):
            found.append((number, float(np.sqrt(square / innovations.size))))
    return found


class _Filtering:
    """Process noise and measurement noise in units of the prior."""

    def __init__(self, task: Task, noise: Noise) -> None:
        self._site, self._noise, self._scale = task.site, noise, task.prior_sigma[:6]
        self.r = np.eye(3) * (noise.velocity_mps / task.prior_sigma[3]) ** 2

    def ahead(self, covariance: Array, whole: Array, time_s: float) -> Array:
        """Return the covariance after a transition."""
        moved = whole @ covariance @ whole.T
        moved[:6, :6] += process_noise(self._site, self._noise, time_s) / np.outer(self._scale, self._scale)
        return np.asarray((moved + moved.T) / 2.0)


def _scaled(rows: Array, scale: Array) -> Array:
    whole = np.eye(STATES)
    whole[:6] = rows / scale[:6, None] * scale
    return whole
