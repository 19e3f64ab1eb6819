"""What rounded stamps do to the table's rate that a gyro is compared with: noise that is known."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._noise import Noise
from drivers.base.arrays import Array
from simulators.effects import Stimulus

_SIGMAS = 2.0


@dataclass(frozen=True)
class StampNoise:
    """White noise of the times at which a run's edges were read, `sigma_s` (n + 1,).

    `span_s` (n,) is the time between the two readings that a sample's rate comes from.
    """

    sigma_s: Array
    span_s: Array

    def cut(self, count: int) -> StampNoise:
        """Return that of the first `count` samples."""
        return StampNoise(self.sigma_s[: count + 1], self.span_s[:count])

    def moved(self, edges: NDArray[np.int64]) -> StampNoise:
        """Return that of an angle whose edges were taken from `edges` (n + 1,)."""
        return replace(self, sigma_s=self.sigma_s[edges])

    def without(self, edges: slice) -> StampNoise:
        """Return that of an angle that no stamp of some edges has to do with any more."""
        sigma = self.sigma_s.copy()
        sigma[edges] = 0.0
        return replace(self, sigma_s=sigma)

    def noise(self, s: Stimulus, missing: NDArray[np.bool_]) -> Noise:
        """Return the noise of the rate along the axis: of an angle, as a quantum, and white.

        A span that is wrong by e[k+1] - e[k] makes the rate wrong by as large a part. At one rate and with spans
        alike that is noise of an angle. What an edge does to the sample before it and does not take back in the
        one after it is white: little where the rate changes slowly, all of it beside samples that are `missing`
        (n,), and twice as much in slow coefficients at a run's ends.

        A few fast moves may have nearly all of it: what m samples share scatters by sqrt(2 / m) of itself, and
        by twice that it may be larger.
        """
        gain = np.where(missing, 0.0, 3600.0 * s.axis_rate_dps / self.span_s)
        before, after = np.append(0.0, gain), np.append(gain, 0.0)
        lone = (self.sigma_s * (before - after)) ** 2
        lone[[0, -1]] *= 2.0
        by_edge = self.sigma_s**2 * (before**2 + after**2)
        most = 1.0 + _SIGMAS * math.sqrt(2.0 * float((by_edge**2).sum())) / max(float(by_edge.sum()), 1e-300)
        white = most * float(lone.sum()) / len(s)
        angle = most * max(float((self.sigma_s**2 * before * after).sum()), 0.0) / len(s)
        arcsec = math.sqrt(12.0 * angle) * s.period_s
        return Noise(math.sqrt(white * s.period_s / 3600.0), quantum_arcsec=arcsec)
