"""What rounding of stamps and of the table's angle does to the rate that a gyro is compared with: known noise."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.statistics import stretches
from bench.analysis.gap._noise import Noise
from drivers.base.arrays import Array
from simulators.effects import Stimulus

_SIGMAS = 2.0
_MOST_OF, _FEWEST_BENDS, _MEDIAN_OF_SQUARES = 0.25, 16, 0.4549
"""Part of the largest variance from which samples say how large it is, and how many do; of normal values."""
_SHOWS = 3.0
"""Times the power that is seen that there may be: the median of uniform errors is as of normal ones, roughly."""
_PARTS = (1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.5)
_COARSEST_DEG = 0.1
_STEPS_DEG = sorted(
    (
        step
        for step in (
            *(360.0 / 2**bits for bits in range(33)),
            *(part * 10.0**-digits for digits in range(1, 9) for part in _PARTS),
            *(part * 10.0**-digits / 3600.0 for digits in range(-2, 4) for part in _PARTS),
        )
        if step <= _COARSEST_DEG
    ),
    reverse=True,
)
"""Of encoders by bits, and of lines and last digits of degrees and of arc seconds."""
_ON_GRID = 0.1
"""Part of a step by which values may be off its grid, rms: they may be printed with few digits."""
_EVEN_DEG, _EVEN = 1e-9, 8
"""Change of the turn from sample to sample, and samples without one, of a turn whose code errors are alike."""
_FEWEST, _FEWEST_TURNS, _ENOUGH, _MOST = 40, 10, 1000, 20_000
"""Different values, and different turns from row to row, that say something; values, and rows, that are enough.

A few commanded angles, and those of a simulated table at a few rates, are on any grid.
"""


@dataclass(frozen=True)
class RoundingNoise:
    """White noise of the times and angles at a run's edges as they were read, `sigma_s` and `sigma_deg` (n + 1,).

    `span_s` (n,) is the time between the two readings that a sample's rate comes from. `even` (n + 1,): the angle
    was put on the line of an even turn there. `told`: whether the log says what its codes are.
    """

    sigma_s: Array
    sigma_deg: Array
    span_s: Array
    even: NDArray[np.bool_]
    told: bool = True

    def cut(self, count: int) -> RoundingNoise:
        """Return that of the first `count` samples."""
        edges = slice(count + 1)
        span_s = self.span_s[:count]
        return RoundingNoise(self.sigma_s[edges], self.sigma_deg[edges], span_s, self.even[edges], self.told)

    def moved(self, edges: NDArray[np.int64]) -> RoundingNoise:
        """Return that of an angle whose edges were taken from `edges` (n + 1,)."""
        return replace(
            self, sigma_s=self.sigma_s[edges], sigma_deg=self.sigma_deg[edges], even=self.even[edges]
        )

    def coded(self, angle_deg: Array, step: float) -> RoundingNoise:
        """Return that of codes of a step that other logs of the table have, where the angle (n + 1,) changes."""
        return replace(self, sigma_deg=_read(angle_deg, step))

    def on_a_line(self, edges: slice) -> RoundingNoise:
        """Return that of an angle that was put on the line of an even turn at some edges.

        Codes make none there. A stamp makes none between samples of one rate; at the end of the turn it does.
        """
        even = self.even.copy()
        even[edges] = True
        return replace(self, even=even)

    def as_shown(self, s: Stimulus, left_dph: Array, missing: NDArray[np.bool_]) -> RoundingNoise:
        """Return that of stamps, and of codes, no larger than it shows in what the model leaves, `left_dph` (n,).

        A log may say less than it knows: stamps on ticks of 12 ms, printed in milliseconds, are true, and angles
        of a table that starts and stops on the second lie on a coarse grid. Second differences where either would
        show most, hardly see a gap; their median does not see the moves, which have other rates, and their mean
        sees that most samples of a slow turn have one code.
        """
        seen = np.diff(left_dph, 2) ** 2
        of_stamps = _of_bends(self.sigma_s, self._gain(s, missing) * s.table_rate_dps)
        of_codes = _of_bends(self.sigma_deg, self._turning_gain(s, missing))
        parts = [1.0, 1.0]
        for which, told in enumerate((of_stamps, of_codes)):
            use = np.isfinite(seen) & (told > _MOST_OF * np.max(told, initial=0.0))
            if np.count_nonzero(use) >= _FEWEST_BENDS:
                median = float(np.median(seen[use] / told[use])) / _MEDIAN_OF_SQUARES
                parts[which] = median if which == 0 else float(np.mean(seen[use])) / float(np.mean(told[use]))
        factors = [math.sqrt(min(_SHOWS * part, 1.0)) for part in parts]
        return replace(self, sigma_s=factors[0] * self.sigma_s, sigma_deg=factors[1] * self.sigma_deg)

    def of_stamps(self, s: Stimulus, missing: NDArray[np.bool_]) -> Noise:
        """Return what stamps do to the rate along the axis, as noise of an angle and white; `missing` (n,)."""
        known = np.pad(~missing, 1)
        between = self.even & known[1:] & known[:-1]
        sigma_s = np.where(self.even & ~between, 0.0, self.sigma_s)
        return _of_edges(sigma_s, self._gain(s, missing) * s.table_rate_dps, s.period_s, self.even)

    def of_codes(self, s: Stimulus, missing: NDArray[np.bool_]) -> Noise:
        """Return what the angle's codes do, which repeats of a motion may share.

        Where the table rests one code is read on: what it is off by at the end of a move stays with the move. An
        even turn of whole codes in each sample does the same.
        """
        sigma_deg = np.where(self.even, 0.0, self.sigma_deg)
        return _of_edges(sigma_deg, self._turning_gain(s, missing), s.period_s, np.zeros_like(self.even))

    def code_arcsec(self, s: Stimulus, missing: NDArray[np.bool_]) -> float:
        """Return the step of the codes along the axis, rms over the samples, 0 where they are off by one amount.

        On the line of an even turn, too: how even it was nobody knows to better than a code.
        """
        gain = self._turning_gain(s, missing)
        variance = 0.5 * (self.sigma_deg[1:] ** 2 + self.sigma_deg[:-1] ** 2)
        return s.period_s * math.sqrt(12.0 * float(np.mean(gain**2 * variance)))

    def reads(self, s: Stimulus) -> NDArray[np.bool_]:
        """Return the samples, (n,), in which codes change what they are off by: none of a standstill.

        Nor those of a turn by whole codes in each sample, unless it was put on its line.
        """
        bends = np.abs(np.diff(s.angle_deg, 2)) < _EVEN_DEG
        even = np.append(bends, True) & np.append(True, bends)
        for first, stop in stretches(even).tolist():
            if stop - first < _EVEN:
                even[first:stop] = False
        return np.asarray(~even | (self.even[1:] & self.even[:-1]))

    def _turning_gain(self, s: Stimulus, missing: NDArray[np.bool_]) -> Array:
        return np.where(self.reads(s), self._gain(s, missing), 0.0)

    def _gain(self, s: Stimulus, missing: NDArray[np.bool_]) -> Array:
        along = 3600.0 * np.sin(np.radians(s.elevation_deg)) / self.span_s
        return np.where(missing, 0.0, along)


def _read(angle_deg: Array, step: float) -> Array:
    """Return the deviation of codes at edges (n + 1,) beside which the angle changes, 0 where it stands."""
    turning = np.diff(angle_deg) != 0.0
    read = np.append(False, turning) | np.append(turning, False)
    return np.where(read, step / math.sqrt(12.0), 0.0)


def rounding_noise(angle_deg: Array, step: float | None, sigma_s: float, span_s: Array) -> RoundingNoise:
    """Return that of an angle (n + 1,) in codes of a step, None if not known, and of stamps off by `sigma_s`."""
    count = len(angle_deg)
    even = np.zeros(count, np.bool_)
    return RoundingNoise(
        np.full(count, sigma_s), _read(angle_deg, step or 0.0), span_s, even, step is not None
    )


def _of_bends(sigma: Array, gain: Array) -> Array:
    """Return the variance of second differences, (n - 2,), of a rate wrong by `gain[k]` (e[k+1] - e[k])."""
    before, here, after = gain[:-2], gain[1:-1], gain[2:]
    weights = (before, before + 2.0 * here, 2.0 * here + after, after)
    edges = (sigma[:-3], sigma[1:-2], sigma[2:-1], sigma[3:])
    return np.asarray(sum((weight * edge) ** 2 for weight, edge in zip(weights, edges, strict=True)))


def _of_edges(sigma: Array, gain: Array, period_s: float, even: NDArray[np.bool_]) -> Noise:
    """Return the noise of a rate, sample k wrong by `gain[k]` (e[k+1] - e[k]), of white e of `sigma` (n + 1,).

    At one rate and with spans alike that is noise of an angle. What an edge does to the sample before it and does
    not take back in the one after it is white: little where the gain changes slowly, all of it beside samples
    that are missing, whose gain is 0, and twice as much in slow coefficients at a run's ends. Where the angle is
    on the line of an `even` turn (n + 1,) that is all that is left: the stamp moves the reading and the line by
    the turn's rate, and the sample beside it by its own.

    A few fast moves may have nearly all of it: what m samples share scatters by sqrt(2 / m) of itself, and by
    twice that it may be larger.
    """
    before, after = np.append(0.0, gain), np.append(gain, 0.0)
    lone = (sigma * (before - after)) ** 2
    lone[[0, -1]] *= 2.0
    by_edge = np.where(even, lone, sigma**2 * (before**2 + after**2))
    most = 1.0 + _SIGMAS * math.sqrt(2.0 * float((by_edge**2).sum())) / max(float(by_edge.sum()), 1e-300)
    white = most * float(lone.sum()) / len(gain)
    angle = most * max(float((sigma**2 * before * after)[~even].sum()), 0.0) / len(gain)
    return Noise(math.sqrt(white * period_s / 3600.0), quantum_arcsec=math.sqrt(12.0 * angle) * period_s)


def step_deg(angle_deg: Array) -> float | None:
    """Return the coarsest step of codes or digits that an angle (m,) is logged in; 0 without one.

    None where its values, or its turns from row to row, are too few to say.
    """
    known = angle_deg[np.isfinite(angle_deg)][:_MOST]
    values = np.unique(np.remainder(known, 360.0))
    if len(values) < _FEWEST:
        return None
    apart, turned = values[1 :: max(len(values) // _ENOUGH, 1)] - values[:1], np.diff(known)
    for step in _STEPS_DEG:
        steps = apart / step
        if np.sqrt(np.mean((steps - np.rint(steps)) ** 2)) < _ON_GRID:
            return float(step) if len(np.unique(np.rint(turned / step))) >= _FEWEST_TURNS else None
    return 0.0
