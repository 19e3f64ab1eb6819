"""How late one run's temperature profile is against another's."""

from __future__ import annotations

import numpy as np

from bench.analysis.thermal._features import centred_mean, hold
from drivers.base.arrays import Array


def find_shift(reference_c: Array, other_c: Array, *, max_shift_s: int = 600, smooth_s: int = 30) -> int:
    """Return by how many seconds `other_c` lags `reference_c` (negative: leads), both 1 s series of any length.

    The shift of the largest cross-correlation of the slopes d(T_out)/dt of `smooth_s` means, within
    +-`max_shift_s`: the ramps of a temperature shock are sharp in the slope, plateaus do not count.
    """
    slopes = [np.gradient(centred_mean(hold(series), smooth_s)) for series in (reference_c, other_c)]
    length = sum(map(len, slopes))
    spectrum = np.conj(np.fft.rfft(slopes[0], length)) * np.fft.rfft(slopes[1], length)
    correlation = np.fft.irfft(spectrum, length)
    shifts = np.arange(-max_shift_s, max_shift_s + 1)
    shifts = shifts[(shifts > -len(slopes[0])) & (shifts < len(slopes[1]))]
    return int(shifts[np.argmax(correlation[shifts])])


def shifted(values: Array, shift_s: int, count: int) -> Array:
    """Return `values` moved earlier by `shift_s` samples, `count` of them; NaN where there are none."""
    index = np.arange(count) + shift_s
    inside = (index >= 0) & (index < len(values))
    result = np.full(count, np.nan)
    result[inside] = values[index[inside]]
    return result
