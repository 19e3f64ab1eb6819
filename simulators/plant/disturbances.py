"""What comes into a gyro's samples whatever it does: a line of one frequency, and impulses at random times."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drivers.base.constants import ARCSEC_RAD
from simulators.plant.effect import SamplePath
from simulators.plant.noise import NoiseSource, SampleNoise


class Line:
    """A sinusoid on the rate with a phase drawn at power-on, its mean over each sample exactly."""

    def __init__(self, amplitude_dph: float, frequency_hz: float, source: NoiseSource) -> None:
        self._swing_rad = amplitude_dph * ARCSEC_RAD / (2.0 * math.pi * frequency_hz) if frequency_hz else 0.0
        self._frequency_hz = frequency_hz
        self._phase = 2.0 * math.pi * float(source.generator(0).random())

    def __call__(self, path: SamplePath) -> NDArray[np.float64]:
        """Return what it adds to the angle increments, rad (n,)."""
        turn = 2.0 * math.pi * np.modf(self._frequency_hz * path.edges_s)[0] + self._phase
        return np.asarray(-self._swing_rad * np.diff(np.cos(turn)))


class Impulses:
    """Steps of angle at random times (Poisson, at most one a second), either way up, all of one size."""

    def __init__(self, per_h: float, size_arcsec: float, source: NoiseSource) -> None:
        self._chance = per_h / 3600.0
        self._size_rad = size_arcsec * ARCSEC_RAD
        self._drawn = SampleNoise(source, "uniform")
        self._when = SampleNoise(source.substream(source.stream + 1), "uniform")

    def __call__(self, path: SamplePath) -> NDArray[np.float64]:
        """Return what they add to the angle increments, rad (n,)."""
        edges_s = path.edges_s
        result = np.zeros(len(edges_s) - 1)
        first = int(edges_s[0])
        count = int(edges_s[-1]) - first + 1
        drawn = self._drawn.values(first, count)
        hits = np.flatnonzero(np.abs(drawn) < 0.5 * self._chance)
        times = first + hits + 0.5 + self._when.values(first, count)[hits]
        at = np.searchsorted(edges_s, times, side="right") - 1
        inside = (at >= 0) & (at < len(result))
        np.add.at(result, at[inside], np.sign(drawn[hits[inside]]) * self._size_rad)
        return result
