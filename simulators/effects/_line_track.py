"""A line whose frequency is not quite the same from run to run, or follows something: tracked window by window.

What is driven at nearly the sampling frequency beats slowly; a part in a thousand of the drive's is a large part
of the beat's frequency. In windows that overlap by half, each weighed by a raised cosine, frequency and its
change are fitted anew; the windows' waves add up to the line (Allen and Rabiner, Proc. IEEE 65, 1977).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array

WANDERS = 0.05
"""Part of its frequency by which a line may be off from run to run, and wander in it."""
_CYCLES = 8.0
"""Of the line in a window, at least."""
_CLEAR = 5.0
"""Amplitude of the line in a window over that of noise in a bin, from which on it can be followed."""
_ALIKE = 0.5
"""Part by which its amplitude in a window may differ from that in the steady runs."""
_SHORTEST, _GLANCE = 64, 256
_MEAN_CYCLES = 2.0
_NOTHING = 0.25
"""Part of its amplitude in short windows below which nothing of a line is left."""
_PENALTY = 8.0
"""Chi-square that the four parameters of a window have to take away."""
_LEAST_KNOWN = 1.0
"""Half windows of samples that have to be known in a window for it to tell anything."""
_STEPS = 4
_FINER = 4


def amplitude_near(rest: Array, frequency: float) -> float:
    """Return the amplitude of a line that wanders about `frequency`, cycles a sample: a median of windows."""
    size = min(max(math.ceil(_CYCLES / frequency), _GLANCE), len(rest))
    weight = np.hanning(size)
    windows = np.lib.stride_tricks.sliding_window_view(rest, size)[:: size // 2]
    windows = (windows - windows.mean(axis=1, keepdims=True)) * weight
    power = np.abs(np.fft.rfft(windows, _FINER * size, axis=1)) ** 2 * (2.0 / weight.sum()) ** 2
    wide = max(WANDERS * frequency, 1.5 / size)
    low, high = (math.floor((frequency + sign * wide) * _FINER * size) for sign in (-1.0, 1.0))
    return math.sqrt(float(np.median(power[:, max(low, _FINER) : high + 2].max(axis=1))))


def tracked(rest: Array, frequency: float, amplitude: float, steady: Array) -> Array:
    """Return a line near `frequency`, cycles a sample, as it wanders through a record, (n,) -> (n,).

    `rest` has NaN where nothing is known, `amplitude` is the line's. Windows are as long as leaves least, their
    parameters counted (Akaike); where `steady`, the line as it is without any wandering, leaves no more, it is
    that. Where nothing of about that amplitude is there, it is zero.
    """
    from scipy.ndimage import uniform_filter1d  # here: a lab starts without scipy (decision 0021)

    known = np.isfinite(rest)
    n, count, best = len(rest), int(known.sum()), steady
    apart = np.abs(np.diff(rest - steady)[known[1:] & known[:-1]])
    if count < 2 * _SHORTEST or not len(apart):
        return best
    sigma = max(float(np.median(apart)) / 0.6745 / math.sqrt(2.0), 1e-12)
    # a mean over whole cycles has nothing of the line, but all that is slower
    cycles = round(_MEAN_CYCLES / frequency)
    shares = uniform_filter1d(known.astype(np.float64), cycles, mode="nearest")
    means = uniform_filter1d(np.where(known, rest, 0.0), cycles, mode="nearest") / np.maximum(shares, 1e-6)
    rest = np.where(known, rest - means, 0.0)
    left = np.where(known, rest - steady, 0.0)
    if steady.any() and amplitude_near(left, frequency) < _NOTHING * amplitude:
        return best
    cost = float(np.square(left / sigma).sum()) + _PENALTY
    # a raised cosine's bin of m samples has noise of sigma sqrt(6 / m) in amplitude
    size = 2 * math.ceil(0.5 * max(_CYCLES / frequency, 6.0 * (_CLEAR * sigma / amplitude) ** 2, _SHORTEST))
    while size <= n // 2:
        wave = _overlapped(rest, known, size, frequency, amplitude)
        own = float(np.square((rest - wave)[known] / sigma).sum()) + _PENALTY * n / size
        if own < cost:
            best, cost = wave, own
        size *= 2
    return best


def _overlapped(
    rest: Array, known: NDArray[np.bool_], size: int, frequency: float, amplitude: float
) -> Array:
    """Return the waves of windows of a `size` that overlap by half, added up, (n,)."""
    n, half = len(rest), size // 2
    weight = 0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(size) + 0.5) / size)
    padded, use = np.pad(rest, (half, half + size)), np.pad(known, (half, half + size))
    wave = np.zeros(len(padded))
    for start in range(0, n + half, half):
        at = slice(start, start + size)
        if use[at].sum() > _LEAST_KNOWN * half:
            wave[at] += weight * _wave(padded[at], weight * use[at], frequency, amplitude)
    return np.asarray(wave[half : half + n])


def _wave(own: Array, weight: Array, frequency: float, amplitude: float) -> Array:
    """Return the line in one window; zeros where there is none of about its amplitude."""
    size = len(own)
    time = (np.arange(size) - 0.5 * (size - 1)) / size
    spectrum = np.abs(np.fft.rfft(own * weight, _FINER * size))
    wide = max(WANDERS * frequency, 1.5 / size)
    low = max(math.floor((frequency - wide) * _FINER * size), _FINER)
    near = spectrum[low : math.ceil((frequency + wide) * _FINER * size) + 1]
    if not len(near):
        return np.zeros(size)
    turn = 2.0 * np.pi * (low + int(near.argmax())) / _FINER
    speed = 0.0
    for step in range(_STEPS + 1):
        phase = turn * time + speed * time**2
        wave = np.stack((np.cos(phase), np.sin(phase)))
        values = np.linalg.lstsq((wave * weight).T, own * weight, rcond=None)[0]
        if step == _STEPS:
            break
        ahead = values[1] * wave[0] - values[0] * wave[1]
        slopes = np.stack((*wave, time * ahead, time**2 * ahead))
        moved = np.linalg.lstsq((slopes * weight).T, own * weight, rcond=None)[0]
        turn += float(np.clip(moved[2], -math.pi, math.pi))
        speed += float(np.clip(moved[3], -4.0 * math.pi, 4.0 * math.pi))
    found = float(np.hypot(*values))
    off = abs(turn / (2.0 * np.pi * size) - frequency)
    if off > wide + 1.0 / size or abs(found / amplitude - 1.0) > _ALIKE:
        return np.zeros(size)
    return np.asarray(values @ wave)
