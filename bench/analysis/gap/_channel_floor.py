"""A channel's noise floor without its model: what its quiet stretches do, by time scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from bench.analysis.gap._channel_data import ChannelSeries
from drivers.base.arrays import Array

_TAKEN_OUT = 5
"""Coefficients that taking out a cubic disturbs."""
_SHORTEST = 32
_LEAST_COUNT = 8
_HARMONICS = 4
_OCTAVES = 24


@dataclass(frozen=True, eq=False)
class ChannelFloor:
    """Power of noise by octave of period: `power` (octaves,) a DCT coefficient, `count` how many were averaged.

    Octave k holds periods from 2^k to 2^(k+1) s. Where nothing quiet is long enough, power grows in proportion to
    period (flicker) from the slowest octave known.
    """

    power: Array
    count: Array
    source: str

    def at(self, size: int, period_s: float) -> tuple[Array, NDArray[np.int64]]:
        """Return power and octave of the DCT coefficients of `size` samples, (size,) each."""
        octave = octaves(size, period_s)
        return self.power[octave], octave


def octaves(size: int, period_s: float) -> NDArray[np.int64]:
    """Return the octave of period of every DCT coefficient; that of the mean is the slowest of all, (size,)."""
    index = np.maximum(np.arange(size), 0.5)
    octave = np.floor(np.log2(2.0 * size * period_s / index)).astype(np.int64)
    return np.asarray(np.clip(octave, 0, _OCTAVES - 1))


def channel_floor(series: Sequence[ChannelSeries]) -> ChannelFloor:
    """Estimate from the quiet stretches of all runs; the resolution's noise is the least that is believed.

    A cubic is taken out of each stretch, and of one at a turning table what repeats every turn. Of every
    octave the quietest stretch counts: the others may still be settling. Where nothing is quiet for long enough,
    what the third differences of neighbouring samples show is the noise of the shortest periods.
    """
    power, count = np.full(_OCTAVES, np.inf), np.zeros(_OCTAVES)
    for each in series:
        for _, piece in each.pieces():
            at = np.flatnonzero(each.quiet[piece]) + piece.start
            if len(at) < _SHORTEST:
                continue
            octave = octaves(len(at), each.inputs.period_s)[_TAKEN_OUT:]
            energy = np.bincount(octave, _quiet_power(each, at)[_TAKEN_OUT:], _OCTAVES)
            own = np.bincount(octave, minlength=_OCTAVES)
            known = own >= _LEAST_COUNT
            better = known & (energy < power * np.maximum(own, 1))
            power[better], count[better] = (energy / np.maximum(own, 1))[better], own[better]
    least = max(each.resolution for each in series) ** 2 / 12.0
    seen = np.flatnonzero(count)
    source = "quiet stretches"
    if not len(seen):
        source = "neighbouring samples"
        seen = np.array([int(octaves(_SHORTEST, max(each.inputs.period_s for each in series))[-1])])
        power[seen], count[seen] = _neighbours_power(series), float(_LEAST_COUNT)
    slowest = int(seen[-1])
    beyond = np.maximum(np.arange(_OCTAVES) - slowest, 0)
    filled = np.interp(np.arange(_OCTAVES), seen, power[seen]) * 2.0**beyond
    trust = np.interp(np.arange(_OCTAVES), seen, count[seen])
    return ChannelFloor(np.maximum(filled, least), trust, source)


def _neighbours_power(series: Sequence[ChannelSeries]) -> float:
    """Return the variance of white noise by which third differences of neighbouring samples scatter, the least.

    A curve is straight enough over four samples; 20 is the variance of a third difference of unit white noise.
    """
    found = []
    for each in series:
        thirds = [np.diff(each.values[piece], 3) for _, piece in each.pieces()]
        if len(thirds := [own for own in thirds if len(own)]):
            found.append(float((1.4826 * np.median(np.abs(np.concatenate(thirds)))) ** 2 / 20.0))
    return min(found, default=0.0)


def _quiet_power(series: ChannelSeries, at: NDArray[np.int64]) -> Array:
    follows = series.channel in ("table_rate", "time_stamps")
    rest = series.values[at] - (series.inputs.drive[at] if follows else 0.0)
    run = np.linspace(-1.0, 1.0, len(at))
    columns = [run**power for power in range(4)]
    angle = series.inputs.angle_deg[at] if len(series.inputs.angle_deg) else np.zeros(1)
    if np.ptp(angle) > 90.0:
        for k in range(1, _HARMONICS + 1):
            columns += [np.cos(k * np.radians(angle)), np.sin(k * np.radians(angle))]
    basis = np.stack(columns, axis=1)
    return np.asarray(dct(rest - basis @ np.linalg.lstsq(basis, rest, rcond=None)[0], norm="ortho") ** 2)
