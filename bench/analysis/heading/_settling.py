"""How fast the platform's temperature settles: after power-on, and after each turn.

At one heading the temperature is a steady course over the sidereal angle plus c exp(-t / tau): a first-order
lag of a periodic input is periodic again. The same holds from power-on (the start-up curve) and from each turn,
so that the two time constants are of one quantity, each found by itself. The third, by which the gyros' drift
follows this temperature, is of the lagged model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from bench.analysis.heading._checks import Finding
from bench.analysis.heading._log import PlatformLog, WarmUp, stays
from bench.analysis.heading._restricted import FORMS, HOUR_S, Restricted, hourly, markov_after_lag
from bench.analysis.heading._temperature import harmonics
from drivers.base.arrays import Array
from drivers.base.constants import SIDEREAL_DAY_S

_HARMONICS = 4
_TAU_RANGE_S = (0.5 * 3600.0, 72.0 * 3600.0)
_GRID, _ROUNDS = 17, 3
_BEND = 0.02
_LEAST_STAY_S = 1.25 * SIDEREAL_DAY_S
"""A turn of the sidereal angle fixes the periodic part only if there is time left for the exponential."""
_LEAST_SIGMA = 4.0
"""An exponential is looked for at every time constant of the grid: noise makes one of two or three."""
_APART_SIGMA = 3.0


@dataclass(frozen=True)
class TimeConstant:
    """A time constant and its standard deviation, s; `change_k`: the largest exponential that it was read off."""

    tau_s: float
    sigma_s: float
    change_k: float


@dataclass(frozen=True)
class Settling:
    """Of the measured temperature: from its start-up curve and from the turns; None where a log does not show it.

    `core`: by how much the drift follows the temperature, of the lagged model.
    """

    start_up: TimeConstant | None
    turns: TimeConstant | None
    core: TimeConstant

    @property
    def slowest_s(self) -> float:
        """The time constant that a stay has to outlast: the slower of temperature and drift."""
        heat = self.start_up or self.turns
        return max(self.core.tau_s, heat.tau_s if heat else 0.0)

    def findings(self) -> list[Finding]:
        """Return a finding where start-up curve and turns differ by more than three standard deviations."""
        if self.start_up is None or self.turns is None:
            return []
        apart_s = self.start_up.tau_s - self.turns.tau_s
        if abs(apart_s) <= _APART_SIGMA * float(np.hypot(self.start_up.sigma_s, self.turns.sigma_s)):
            return []
        return [
            Finding(
                f"the temperature settled with {_told(self.start_up)} after power-on and with "
                f"{_told(self.turns)} after turns",
                "heat takes another way when the unit starts (regulation, a fan, a second body): the start-up "
                "curve does not say how long a stay has to be",
                False,
            )
        ]


def settling(log: PlatformLog, core: TimeConstant) -> Settling:
    """Return the time constants of a log. Its start-up curve is that of `log.warm_up`, or the first stay's."""
    every = stays(log)
    first = log.part(every[0].start, every[0].stop) if every else log
    begun = log.warm_up or WarmUp(first.time_s, first.sidereal_rad, first.temp_c)
    later = [log.part(stay.start, stay.stop) for stay in every[1:] if stay.duration_s >= _LEAST_STAY_S]
    return Settling(
        start_up=time_constant([begun]),
        turns=time_constant([WarmUp(part.time_s, part.sidereal_rad, part.temp_c) for part in later]),
        core=core,
    )


def time_constant(parts: Sequence[WarmUp]) -> TimeConstant | None:
    """Return the common time constant of stretches at one heading each, every one with its own steady course.

    What the exponentials leave is taken as the room, a first-order Markov process, seen through the platform's
    own lag, and white noise of the sensor, in the form of the largest restricted likelihood. None without a
    stretch of 1.25 sidereal days, or where no exponential reaches four standard deviations.
    """
    blocks = [block for block in map(_course, parts) if len(block) and block[-1, 0] >= _LEAST_STAY_S - HOUR_S]
    if not blocks:
        return None
    grid = np.log(np.geomspace(*_TAU_RANGE_S, _GRID))
    noise = FORMS[0]

    def cost(log_tau: float) -> float:
        return _Fit(blocks, float(np.exp(log_tau)), noise).cost

    log_tau, step = float(min(grid, key=cost)), float(grid[1] - grid[0])
    for _ in range(_ROUNDS):
        # tau first: what a coarse one leaves looks like noise that remembers
        log_tau = float(minimize_scalar(cost, bounds=(log_tau - step, log_tau + step), method="bounded").x)
        noise = min(FORMS, key=lambda form: _Fit(blocks, float(np.exp(log_tau)), form).cost)
    inside = _TAU_RANGE_S[0] < np.exp(log_tau) < _TAU_RANGE_S[1]
    best = _Fit(blocks, float(np.exp(log_tau)), noise)
    bend = (cost(log_tau + _BEND) + cost(log_tau - _BEND) - 2.0 * best.cost) / _BEND**2
    if not (inside and best.significance >= _LEAST_SIGMA and bend > 0.0):
        return None
    return TimeConstant(best.tau_s, best.tau_s * float(np.sqrt(2.0 / bend)), best.change_k)


class _Fit:
    """The stretches at one time constant and one form of the noise, whose size is common to all.

    `cost`: -2 log of the restricted likelihood. The exponential is the last column of each.
    """

    def __init__(self, blocks: Sequence[Array], tau_s: float, form: tuple[float, float]) -> None:
        self.tau_s = tau_s
        made = [_alone(block, tau_s, form) for block in blocks]
        freedom = sum(fit.freedom for fit in made)
        variance = sum(fit.square for fit in made) / freedom
        self.cost = freedom * float(np.log(variance)) + sum(fit.logs for fit in made)
        largest = max(made, key=_strength)
        self.change_k = float(largest.solution[-1])
        self.significance = _strength(largest) / float(np.sqrt(variance))


def _alone(block: Array, tau_s: float, form: tuple[float, float]) -> Restricted:
    time_s = block[:, 0]
    rows = np.column_stack([block[:, 1:-1], np.exp(-time_s / tau_s)])
    return Restricted.fit(rows, block[:, -1], markov_after_lag(time_s, *form, lag_s=tau_s))


def _strength(fit: Restricted) -> float:
    """Return the exponential's size in standard deviations of noise of size 1."""
    return abs(float(fit.solution[-1] * fit.root[-1, -1]))


def _course(part: WarmUp) -> Array:
    """Return hourly [time, steady course's columns, temperature]."""
    return hourly(part.time_s, np.column_stack([harmonics(part.sidereal_rad, _HARMONICS), part.temp_c]))


def _told(constant: TimeConstant) -> str:
    return f"{constant.tau_s / 3600.0:.1f} +- {constant.sigma_s / 3600.0:.1f} h"
