"""Spectra of rows by phase, and the lines and bands in them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.ndimage import median_filter
from scipy.stats import chi2

from bench.analysis.common.spectrum import (
    MAIN_LOBE,
    Line,
    freedom_of,
    level_around,
    median_of,
    spectral_lines,
)
from bench.analysis.common.statistics import stretches
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._fast_floor import FastFloor
from drivers.base.arrays import Array

SAME_BINS, _PIECES = 2.0, 16
"""Bins by which a line is the same in another phase; bins over which a density is smoothed to look for bands."""
_STANDS_HZ = 1e-4
_BESIDE_BINS, _RISES = 8, 1.5
"""Bins to either side of a line of which one is lower by so many times."""
_HANN_BINS, _LOST = 1.5, 0.2
"""Noise bandwidth of a Hann window, bins; part of the surroundings from which on a side lobe covers them."""
HANN_FREEDOM = 2.0 / 3.0
"""Part of a spectrum's bins that are independent under a Hann window."""
_EVERYWHERE = 0.5
"""Part of a line's largest amplitude that every phase must have for it to be there whatever is done."""
_MOST_ORDER, _TURN_BINS, _CLOSE_BINS = 200, 0.6, 4.0
_FALSE_ALARM = 1e-3
"""Probability that noise gives a line anywhere in all spectra."""


@dataclass(frozen=True, eq=False)
class FastPool:
    """The spectra of one phase in all runs of a profile, their mean: density (m,) over frequency (m,)."""

    profile: str
    phase: str
    start_s: float
    row_s: float
    frequency_hz: Array
    density: Array
    freedom: float
    turns_hz: float
    runs: int
    several: bool = False
    """Whether the phase has spectra of other rates, too."""

    @property
    def part(self) -> str:
        """The phase, with the rate of the rows where it has several."""
        return f"{self.phase}, rows at {1.0 / self.row_s:.4g} Hz" if self.several else self.phase

    @property
    def name(self) -> str:
        """Profile and part."""
        return f"{self.profile}: {self.part}"

    def shows(self, frequency_hz: float) -> bool:
        """Return whether rows are fine enough for a frequency."""
        return frequency_hz <= float(self.frequency_hz[-1])

    @cached_property
    def level(self) -> Array:
        """The density around every bin, lines left aside, (m,)."""
        return level_around(self.density) / median_of(self.freedom)

    @property
    def bin_hz(self) -> float:
        """Width of a bin."""
        return float(self.frequency_hz[1] - self.frequency_hz[0])

    def around(self, frequency_hz: float, width_hz: float) -> slice:
        """Return the bins of a line, or of a band so wide."""
        half = 0.5 * width_hz / self.bin_hz + MAIN_LOBE
        middle = frequency_hz / self.bin_hz - 1.0
        return slice(max(math.floor(middle - half), 0), math.ceil(middle + half) + 1)

    def without(self, lines: Sequence[tuple[float, float]]) -> Array:
        """Return the density, (m,), without lines of a frequency and a width in Hz, and without their side lobes.

        A Hann window leaves of a line, d bins off, the part (sinc(d) / (1 - d^2))^2 of its largest bin.
        """
        lobes, own = np.zeros(len(self.density)), np.zeros(len(self.density), np.bool_)
        for frequency_hz, width_hz in lines:
            if not self.shows(frequency_hz):
                continue
            off = (self.frequency_hz - frequency_hz) / self.bin_hz
            shape = np.sinc(off) / np.where(np.abs(np.abs(off) - 1.0) < 1e-6, np.inf, 1.0 - off**2)
            lobes += self.power(frequency_hz, width_hz)[0] / self.bin_hz / _HANN_BINS * shape**2
            own[self.around(frequency_hz, width_hz)] = True
        own |= lobes > _LOST * self.level
        if own.all():
            return self.level
        rest, every = self.density[~own] - lobes[~own], np.arange(len(own))
        result = self.density - lobes
        result[own] = np.interp(every[own], every[~own], median_filter(rest, _PIECES + 1, mode="nearest"))
        return np.asarray(np.maximum(result, 0.0))

    def stands(self, line: Line) -> bool:
        """Return whether a line rises from lower ground on both sides; the skirt of a stronger one does not."""
        at = max(round(line.frequency_hz / self.bin_hz) - 1, 0)
        top = float(self.density[max(at - 1, 0) : at + 2].max())
        sides = self.density[max(at - _BESIDE_BINS, 0) : at], self.density[at + 1 : at + 1 + _BESIDE_BINS]
        return all(len(side) > 0 and float(side.min()) < top / _RISES for side in sides)

    def power(self, frequency_hz: float, width_hz: float) -> tuple[float, float]:
        """Return the power of a line above its surroundings, (deg/h)^2, and its 1 sigma by noise."""
        own = self.around(frequency_hz, width_hz)
        level = self.level[own]
        sigma = float(level.mean()) * self.bin_hz * math.sqrt(2.0 * len(level) / HANN_FREEDOM / self.freedom)
        return max(float((self.density[own] - level).sum()) * self.bin_hz, 0.0), sigma


@dataclass(frozen=True)
class FastLine:
    """A line or band: amplitude in deg/h of a sine of its power, by phase ("profile: phase").

    `order`: which harmonic of the table's turn it is, 0 for none. `turning`: it is there only while the table
    turns, whose own rate it may be. `everywhere`: in every phase whose rows are fine enough, so that it is a term
    of a closed model. Its cause may lie at any multiple of the rows' rate plus or minus the frequency.
    """

    frequency_hz: float
    width_hz: float
    amplitudes_dph: Mapping[str, float]
    broad: bool
    order: int
    everywhere: bool
    turning: bool = False

    @property
    def amplitude_dph(self) -> float:
        """The largest amplitude."""
        return max(self.amplitudes_dph.values())

    def amplitude_in(self, pool: FastPool) -> float:
        """Return its amplitude in a pool's phase; where that has none of its own, the rms of all."""
        values = list(self.amplitudes_dph.values())
        rms = math.sqrt(sum(own**2 for own in values) / len(values))
        return self.amplitudes_dph.get(pool.name, rms)

    @property
    def sentence(self) -> str:
        """What it is, where it is."""
        most = max(self.amplitudes_dph, key=lambda name: self.amplitudes_dph[name])
        if self.broad:
            text = f"a band {self.width_hz:.3g} Hz wide at {self.frequency_hz:.4g} Hz"
            size = f"{self.amplitude_dph / math.sqrt(2.0):.3g} deg/h rms"
        else:
            text, size = f"a line at {self.frequency_hz:.5g} Hz", f"{self.amplitude_dph:.3g} deg/h"
        if self.order:
            text += f", {self.order} times a turn of the table"
        where = "" if self.everywhere else f", most in {most}"
        return f"{text}: {size}{where}" + (
            "; the table turns there, and it may be its own rate" * self.turning
        )


def fast_pools(runs: Sequence[GapRun]) -> tuple[FastPool, ...]:
    """Return the spectra of runs by profile and phase, means of those with the same bins."""
    by_place: dict[tuple[str, str, int, float], list[FastPool]] = {}
    for run in runs:
        for own in run.fast:
            pool = FastPool(
                run.profile, own.phase, own.start_s, own.row_s, own.frequency_hz, own.density,
                freedom_of(own.averages), own.turns_hz, 1,
            )  # fmt: skip
            key = run.profile, own.phase, len(own.density), round(own.row_s, 9)
            by_place.setdefault(key, []).append(pool)
    found = [_mean(pools) for pools in by_place.values()]
    often = Counter((pool.profile, pool.phase) for pool in found)
    return tuple(replace(pool, several=often[pool.profile, pool.phase] > 1) for pool in found)


def _mean(pools: Sequence[FastPool]) -> FastPool:
    weights = [pool.freedom for pool in pools]
    density = np.average([pool.density for pool in pools], axis=0, weights=weights)
    turns = float(np.average([pool.turns_hz for pool in pools], weights=weights))
    return replace(pools[0], density=density, freedom=sum(weights), turns_hz=turns, runs=len(pools))


def lowest_hz(pool: FastPool) -> float:
    """Return the frequency above which the means show nothing as it is."""
    return max(0.5, 4.0 * pool.bin_hz)


def above_means(pool: FastPool) -> slice:
    """Return the bins that the means do not show, the last one left out."""
    return slice(int(np.searchsorted(pool.frequency_hz, lowest_hz(pool))), len(pool.frequency_hz) - 1)


def octaves(pool: FastPool) -> list[tuple[str, slice]]:
    """Return names and bins of octaves from 0.5 Hz up to half the rows' rate."""
    top = float(pool.frequency_hz[-1])
    edges = [0.5]
    while edges[-1] < top:
        edges.append(min(2.0 * edges[-1], top))
    if len(edges) > 2 and edges[-1] < 1.2 * edges[-2]:
        del edges[-2]
    at = np.searchsorted(pool.frequency_hz, edges)
    names = [f"{low:.4g}..{high:.4g} Hz" for low, high in pairwise(edges)]
    return [
        (name, slice(*part))
        for name, part in zip(names, pairwise(at.tolist()), strict=True)
        if part[0] < part[1]
    ]


def lines_of(pools: Sequence[FastPool], floor: FastFloor) -> list[FastLine]:
    """Return lines and bands of all pools by frequency."""
    # what the stop band of a filter shows lies below the noise of any model without one
    least = 7200.0 * floor.arw_deg_per_sqrt_h**2
    lines: list[tuple[float, float]] = []
    for pool in pools:
        lowest = int(np.searchsorted(pool.frequency_hz, lowest_hz(pool)))
        chance = _FALSE_ALARM / len(pools)
        for line in spectral_lines(pool.frequency_hz, pool.density, pool.freedom, lowest, chance):
            own = pool.around(line.frequency_hz, 0.0)
            near_hz = SAME_BINS * pool.bin_hz
            known = any(abs(line.frequency_hz - other) <= near_hz for other, _ in lines)
            if line.broad or known or not pool.shows(line.frequency_hz):
                continue
            if pool.density[own].max() >= least and pool.stands(line):
                lines.append((line.frequency_hz, line.width_hz))
    bands = _joined([band for pool in pools for band in _bands(pool, floor, lines)])
    found = [_line(pools, *line) for line in lines] + [_band(pools, floor, lines, *band) for band in bands]
    return sorted(found, key=lambda line: line.frequency_hz)


def _line(pools: Sequence[FastPool], frequency_hz: float, width_hz: float) -> FastLine:
    """Return a line with its amplitude in every pool that shows its frequency."""
    pools = [pool for pool in pools if pool.shows(frequency_hz)]
    both = [pool.power(frequency_hz, width_hz) for pool in pools]
    amplitudes = {pool.name: math.sqrt(2.0 * power) for pool, (power, _) in zip(pools, both, strict=True)}
    largest = max(power for power, _ in both)
    strongest = pools[[power for power, _ in both].index(largest)]
    # amplitudes as the square roots of powers, as far as their noise lets one see
    everywhere = all(power + 2.0 * sigma >= _EVERYWHERE**2 * largest for power, sigma in both)
    strong = [power >= _EVERYWHERE**2 * largest for power, _ in both]
    turning = all(pool.turns_hz > _STANDS_HZ for pool, own in zip(pools, strong, strict=True) if own)
    return FastLine(
        frequency_hz,
        width_hz,
        amplitudes,
        broad=False,
        order=_order(frequency_hz, strongest),
        everywhere=everywhere,
        turning=turning,
    )


def _band(
    pools: Sequence[FastPool],
    floor: FastFloor,
    lines: Sequence[tuple[float, float]],
    low_hz: float,
    high_hz: float,
) -> FastLine:
    """Return a band between two frequencies: middle of its power, width, amplitudes of a sine of its power."""
    pools = [pool for pool in pools if pool.shows(high_hz)] or pools
    powers, middles = [], []
    for pool in pools:
        own = slice(*np.searchsorted(pool.frequency_hz, (low_hz, high_hz)).tolist())
        excess = np.maximum(pool.without(lines)[own] - floor.density(pool.frequency_hz[own], pool.row_s), 0.0)
        powers.append(float(excess.sum()) * pool.bin_hz)
        middles.append(float(excess @ pool.frequency_hz[own]) / max(float(excess.sum()), 1e-300))
    largest = max(powers)
    amplitudes = {pool.name: math.sqrt(2.0 * power) for pool, power in zip(pools, powers, strict=True)}
    everywhere = min(powers) >= _EVERYWHERE**2 * largest
    middle_hz = middles[powers.index(largest)]
    return FastLine(middle_hz, high_hz - low_hz, amplitudes, broad=True, order=0, everywhere=everywhere)


def _bands(
    pool: FastPool, floor: FastFloor, lines: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Return stretches of frequency in which a pool's density, lines left aside, is well above the floor's."""
    density = pool.without(lines) / floor.density(pool.frequency_hz, pool.row_s)
    smooth = np.convolve(density, np.full(_PIECES, 1.0 / _PIECES), mode="same")
    lowest = int(np.searchsorted(pool.frequency_hz, lowest_hz(pool)))
    high = smooth > max(_RISES, float(chi2.isf(_FALSE_ALARM / len(smooth), _PIECES * pool.freedom * HANN_FREEDOM)
                                     / (_PIECES * pool.freedom * HANN_FREEDOM)))  # fmt: skip
    high[:lowest] = False
    return [
        (float(pool.frequency_hz[low]), float(pool.frequency_hz[stop - 1]))
        for low, stop in stretches(high).tolist()
        if stop - low > _PIECES // 2
    ]


def _joined(bands: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return stretches of frequency with those that touch made one."""
    result: list[tuple[float, float]] = []
    for low, high in sorted(bands):
        if result and low <= result[-1][1]:
            result[-1] = result[-1][0], max(high, result[-1][1])
        else:
            result.append((low, high))
    return result


def _order(frequency_hz: float, pool: FastPool) -> int:
    """Return which harmonic of the table's turn a frequency is; 0 for none, and where they lie close."""
    if pool.turns_hz <= _CLOSE_BINS * pool.bin_hz:
        return 0
    near = round(frequency_hz / pool.turns_hz)
    off = abs(near * pool.turns_hz - frequency_hz)
    return near if near <= _MOST_ORDER and off < _TURN_BINS * pool.bin_hz else 0
