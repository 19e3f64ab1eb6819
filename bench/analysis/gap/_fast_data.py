"""What is faster than a run's means: the spectrum of its rows in every phase, while the table turns evenly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.signal.windows import hann

from bench.analysis.common.spectrum import freedom_of, power_density, spectral_lines
from bench.analysis.gap._data import interpolated
from bench.analysis.gap._fast_spectrum import FastSpectrum
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS
from simulators.effects import Stimulus

_SEGMENT_S, _LEAST_SEGMENTS, _FEWEST_ROWS = 16.0, 4, 128
"""Length of a segment where the record has several of them; rows below which a segment tells no line."""
_AT_ONCE = 64
_EVEN_DPS, _EVEN_PART = 0.02, 0.005
"""How far the table's rate may vary in a segment, deg/s and as a part of the rate."""
_BRIDGED = 0.05
"""Part of a segment's rows that may be missing."""
_SAME_BINS, _BESIDE = 2.0, 1e-4
_KNOCKED = 10.0
"""Times the power of the median segment from which on one is left out."""


@dataclass(frozen=True, eq=False)
class FastRows:
    """A run's rows at their own rate: `rows_dps` (rows,) even, from the first step on, NaN where one is missing.

    `owner` (rows,) is the step that a row is averaged in, below zero for none; `phase` (n,) are the steps'.
    """

    rows_dps: Array
    row_s: float
    owner: NDArray[np.int64]
    stimulus: Stimulus
    phase: NDArray[np.str_]

    @cached_property
    def spectra(self) -> tuple[FastSpectrum, ...]:
        """Spectra by phase, first come first.

        A phase without a segment in which the table turns evenly has none, nor have rows that are no finer than
        the steps.
        """
        found = []
        for name, own in self._segments.items():
            frequency, density, calm = self._density(own)
            if not len(calm):
                continue
            middle = np.minimum((own + self._size // 2) * self.row_s / self.stimulus.period_s, self._last)
            rate_dps = float(self.stimulus.table_rate_dps[middle.astype(np.int64)].mean())
            start_s = float(np.argmax(self.phase == name) * self.stimulus.period_s)
            turns_hz, count = abs(rate_dps) / 360.0, int(calm.sum())
            knocked = len(calm) - count
            found.append(
                FastSpectrum(name, start_s, self.row_s, frequency, density, count, turns_hz, knocked)
            )
        return tuple(found)

    @cached_property
    def alias_dph(self) -> Array:
        """What lines above half the steps' rate leave in the means of the steps, deg/h (n,): their aliases.

        Taken off the means it makes the decimation free of them; white noise stays white. Zero where the table
        does not turn evenly, but for the seconds beside.
        """
        count = len(self.stimulus)
        starts = np.sort(np.concatenate([*self._segments.values(), np.zeros(0, dtype=np.int64)])).tolist()
        wave = np.zeros(len(self.rows_dps))
        for frequency_hz in self._lines_hz():
            wave += self._wave(frequency_hz, starts)
        used = (self.owner >= 0) & (self.owner < count) & ~np.isnan(self.rows_dps)
        sums = np.bincount(self.owner[used], wave[used], count)
        return DPH_PER_DPS * sums / np.maximum(np.bincount(self.owner[used], minlength=count), 1)

    def _density(self, starts: NDArray[np.int64]) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return `_mean_density` of segments, worked out once."""
        key = starts.tobytes()
        if key not in self._densities:
            self._densities[key] = _mean_density(self.rows_dps, self.row_s, starts.tolist(), self._size)
        return self._densities[key]

    @cached_property
    def _densities(self) -> dict[bytes, tuple[Array, Array, NDArray[np.bool_]]]:
        return {}

    def _lines_hz(self) -> list[float]:
        """Return the frequencies of lines that means show at another, in any phase while the table stands.

        A line of a table that turns may be its own rate: what acted has its alias as well.
        """
        found: list[float] = []
        for starts in self._segments.values():
            middle = np.minimum((starts + self._size // 2) * self.row_s / self.stimulus.period_s, self._last)
            stands = np.abs(self.stimulus.table_rate_dps[middle.astype(np.int64)]) < _EVEN_DPS
            frequency, density, calm = self._density(starts[stands])
            if not len(calm):
                continue
            lowest = int(np.searchsorted(frequency, 0.5 / self.stimulus.period_s))
            for line in spectral_lines(frequency, density, freedom_of(int(calm.sum())), lowest):
                known = any(abs(line.frequency_hz - other) <= _SAME_BINS * frequency[0] for other in found)
                if not line.broad and not known:
                    found.append(line.frequency_hz)
        return found

    def _wave(self, frequency_hz: float, starts: Sequence[int]) -> Array:
        """Return a line's own wave, deg/s (rows,): a sinusoid in each segment, joined under Hann windows.

        Its frequency follows from how far its phase goes on from one segment to the next.
        """
        size, wave = self._size, np.zeros(len(self.rows_dps))
        window = hann(size, sym=False)
        time_s = np.arange(size) * self.row_s
        tone = np.exp(-2j * np.pi * frequency_hz * time_s)
        parts = {}
        for start in starts:
            rows = interpolated(self.rows_dps[start : start + size])
            if not np.isnan(rows).any():
                parts[start] = complex((rows - rows.mean()) * window @ tone) * 2.0 / float(window.sum())
        hop_s = (size // 2) * self.row_s
        going_on = np.exp(-2j * np.pi * frequency_hz * hop_s)
        steps = [
            parts[at + size // 2] * np.conj(parts[at]) * going_on for at in parts if at + size // 2 in parts
        ]
        off_hz = float(np.angle(sum(steps))) / (2.0 * np.pi * hop_s) if steps else 0.0
        beyond_s = (np.arange(2 * size) - size // 2) * self.row_s
        turn = np.exp(2j * np.pi * (frequency_hz + off_hz) * beyond_s)
        # the tone is taken at the bin: over the segment the line has gone on by what it is off
        middle = np.exp(-2j * np.pi * off_hz * 0.5 * size * self.row_s)
        loss = float(np.abs((window * np.exp(2j * np.pi * off_hz * time_s)).sum())) / float(window.sum())
        # where no segment is, beside one, the line goes on as in that one
        weight = np.full(2 * size, _BESIDE)
        weight[size // 2 : size // 2 + size] += window
        total = np.zeros(len(wave))
        for start, part in parts.items():
            low, high = max(start - size // 2, 0), min(start + size + size // 2, len(wave))
            own = slice(low - start + size // 2, high - start + size // 2)
            wave[low:high] += weight[own] * np.real(part * middle / loss * turn[own])
            total[low:high] += weight[own]
        return wave / np.maximum(total, 0.5 * _BESIDE)

    @cached_property
    def _segments(self) -> dict[str, NDArray[np.int64]]:
        """First rows of the segments of each phase in which the table turns evenly."""
        size = self._size
        if size < _FEWEST_ROWS or self.row_s > 0.5 * self.stimulus.period_s:
            return {}
        starts = np.arange(0, len(self.rows_dps) - size + 1, size // 2)
        ends = np.stack((starts + 0.5, starts + size - 0.5)) * self.row_s / self.stimulus.period_s
        first, last = np.minimum(ends, self._last).astype(np.int64)
        steady = _steady(self.stimulus.table_rate_dps, first, last)
        same = np.append(0, np.cumsum(self.phase[1:] != self.phase[:-1]))
        steady &= same[first] == same[last]
        names = self.phase[first]
        return {str(name): starts[steady & (names == name)] for name in dict.fromkeys(self.phase.tolist())}

    @property
    def _size(self) -> int:
        return _size(len(self.rows_dps), self.row_s)

    @property
    def _last(self) -> float:
        return len(self.stimulus) - 1.0


def _size(rows: int, row_s: float) -> int:
    """Return the rows of a segment: a power of two of about 16 s, of which the record holds several."""
    most = min(_SEGMENT_S / row_s, rows / _LEAST_SEGMENTS)
    return 1 << round(math.log2(most)) if most >= 1.0 else 0


def _steady(rate_dps: Array, first: NDArray[np.int64], last: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return in which segments, from step `first` to `last` (k,) each, the table's rate (n,) hardly varies."""
    spans = [rate_dps[low : high + 1] for low, high in zip(first.tolist(), last.tolist(), strict=True)]
    varies = np.array([np.ptp(span) for span in spans])
    size = np.array([np.abs(span).max() for span in spans])
    return np.asarray(varies <= np.maximum(_EVEN_DPS, _EVEN_PART * size))


def _mean_density(
    rows_dps: Array, row_s: float, starts: Sequence[int], size: int
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return frequencies, the mean density of the segments with nearly all rows, (deg/h)^2/Hz, and which it took.

    Segments with many times the power of most are left out: a knock in one would hide what is in all.
    """
    frequency, densities, kept = np.zeros(0), [], []
    for at in range(0, len(starts), _AT_ONCE):
        block = np.stack([rows_dps[start : start + size] for start in starts[at : at + _AT_ONCE]])
        whole_ones = np.isnan(block).mean(axis=1) <= _BRIDGED
        block = block[whole_ones]
        kept += np.array(starts[at : at + _AT_ONCE])[whole_ones].tolist()
        if len(block):
            whole = np.stack([interpolated(own) for own in block])
            frequency, density = power_density(DPH_PER_DPS * whole, 1.0 / row_s)
            densities.append(density)
    if not densities:
        return frequency, frequency, np.zeros(0, dtype=bool)
    every = np.concatenate(densities)
    power = every.sum(axis=1)
    calm = power <= _KNOCKED * np.median(power)
    # a knock lies in two segments, in one of them near an end, where the window makes it small
    apart = np.diff(kept) > size // 2
    loud = ~calm
    calm &= ~(np.append(False, loud[:-1] & ~apart) | np.append(loud[1:] & ~apart, False))
    return frequency, every[calm].mean(axis=0), calm
