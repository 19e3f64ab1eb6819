"""The spectrum of a record at its full rate, and the lines in it by frequency as the record has them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.signal import periodogram, welch
from scipy.stats import chi2

from drivers.base.arrays import Array

_LONGEST = 1 << 18
_AVERAGES = 8
"""Segments, half over each other, that are averaged where the record is long enough."""
_LOWEST = 12
"""First bins, in which a drift's leakage and few neighbours tell no line."""
_NODES_A_DECADE, _FEWEST = 16, 24
_FALSE_ALARM = 1e-3
"""Probability that noise alone gives a line anywhere in a spectrum."""
MAIN_LOBE = 3
"""Bins to either side of a line that hold its power under a Hann window."""
_BROAD = 8
"""Bins wide from which on it is a band, not a line."""
_MOST = 12
_LEAST_EXCESS = 1.5


@dataclass(frozen=True)
class Line:
    """A line or band in a spectrum: frequency and width in Hz, amplitude of the sine, times the noise around.

    `broad`: a band rather than a line. The frequency is that in the record: a sampled record cannot say whether
    what causes it lies there or at another one that appears there (n times the sample rate, plus or minus it).
    """

    frequency_hz: float
    amplitude: float
    width_hz: float
    times_noise: float
    broad: bool


@dataclass(frozen=True, eq=False)
class Spectrum:
    """One-sided power density, unit^2/Hz, over frequency, (m,) each; `averages` segments; `white` its level.

    `white`: square root of the median density over the upper half of the frequencies, unit/sqrt(Hz).
    """

    frequency_hz: Array
    density: Array
    averages: int
    white: float
    lines: tuple[Line, ...]


def spectrum_of(values: Array, per_s: float) -> Spectrum:
    """Return the spectrum of an unbroken record (n,) by Welch's method (Hann, half overlap), and its lines."""
    longest = 1 << max(4, int(np.log2(max(2 * len(values) // (_AVERAGES + 1), 16))))
    size = min(_LONGEST, longest, len(values))
    frequency, density = welch(values, per_s, "hann", nperseg=size, detrend=_less_line)
    frequency, density = frequency[1:], np.maximum(density[1:], np.finfo(np.float64).tiny)
    averages = max(1, 2 * len(values) // size - 1)
    freedom = freedom_of(averages)
    white = float(np.sqrt(np.median(density[len(density) // 2 : -1]) / median_of(freedom)))
    return Spectrum(frequency, density, averages, white, spectral_lines(frequency, density, freedom))


def power_density(segments: Array, per_s: float) -> tuple[Array, Array]:
    """Return frequencies in Hz and the one-sided power density of each segment (k, size), unit^2/Hz, (k, m)."""
    frequency, density = periodogram(segments, per_s, "hann", detrend=_less_line)
    return frequency[1:], np.maximum(density[..., 1:], np.finfo(np.float64).tiny)


def freedom_of(averages: int) -> float:
    """Return the degrees of freedom of a density's bin, a mean of so many segments half over each other.

    Under a Hann window they count as 36/38 of as many apart (Welch 1967).
    """
    return 2.0 * averages * (36.0 / 38.0 if averages > 1 else 1.0)


def median_of(freedom: float) -> float:
    """Return the median of a density's bin over its mean."""
    return float(chi2.ppf(0.5, freedom) / freedom)


def _less_line(segments: Array) -> Array:
    """Return segments (..., n) without their least-squares lines."""
    from_middle = np.arange(segments.shape[-1]) - 0.5 * (segments.shape[-1] - 1.0)
    slope = segments @ from_middle / (from_middle @ from_middle)
    return np.asarray(
        segments - segments.mean(axis=-1, keepdims=True) - np.multiply.outer(slope, from_middle)
    )


def spectral_lines(
    frequency: Array,
    density: Array,
    freedom: float,
    lowest: int = _LOWEST,
    false_alarm: float = _FALSE_ALARM,
) -> tuple[Line, ...]:
    """Return lines and bands of a density, (m,) over frequency (m,); `lowest`: first bin looked at.

    They stand out of the median of their surroundings as noise does, anywhere in the spectrum, with the
    probability `false_alarm`.
    """
    count = len(density)
    if count < 4 * _FEWEST:
        return ()
    floor = level_around(density) / median_of(freedom)
    ratio = density / floor
    limit = max(float(chi2.isf(false_alarm / count, freedom) / freedom), _LEAST_EXCESS)
    above = np.flatnonzero(ratio > limit)
    above = above[(above >= lowest) & (above < count - 1)]
    step = float(frequency[1] - frequency[0])
    lines = []
    for group in np.split(above, np.flatnonzero(np.diff(above) > 2 * MAIN_LOBE) + 1) if len(above) else ():
        top = int(group[np.argmax(ratio[group])])
        span = slice(max(group[0] - MAIN_LOBE, 0), group[-1] + MAIN_LOBE + 1)
        near = slice(top - 1, top + 2)
        strong = int((ratio[group] > 0.5 * ratio[top]).sum())
        centre = float(density[near] @ frequency[near] / density[near].sum())
        amplitude = float(np.sqrt(2.0 * np.maximum(density[span] - floor[span], 0.0).sum() * step))
        lines.append(Line(centre, amplitude, strong * step, float(ratio[top]), strong > _BROAD))
    strongest = sorted(lines, key=lambda line: -line.amplitude)[:_MOST]
    return tuple(sorted(strongest, key=lambda line: line.frequency_hz))


def level_around(density: Array) -> Array:
    """Return the level around every bin, (m,): medians of bands a sixteenth of a decade wide, joined."""
    count = len(density)
    index = np.arange(count) + 1.0
    edges = [0]
    while edges[-1] < count:
        edges.append(max(edges[-1] + _FEWEST, int(edges[-1] * 10.0 ** (1.0 / _NODES_A_DECADE))))
    edges[-1] = count
    if len(edges) > 2 and edges[-1] - edges[-2] < _FEWEST:
        del edges[-2]
    bands = [slice(*edge) for edge in pairwise(edges)]
    centre, level = ([float(np.median(np.log(part[band]))) for band in bands] for part in (index, density))
    return np.asarray(np.exp(np.interp(np.log(index), centre, level)))
