"""Records of a gyro that has nothing but its noise, drawn from its coefficients."""

from __future__ import annotations

import numpy as np

from bench.analysis.common.allan_noise import NoiseCoefficients
from drivers.base.arrays import Array


def noise_samples(noise: NoiseCoefficients, count: int, rate_hz: float, seed: int) -> Array:
    """Return samples (count,) in deg/h of quantisation, random walk, flicker, rate random walk and ramp.

    Flicker is white noise filtered to a density of B^2 / (2 pi f) (IEEE Std 952, annex C) in a record twice as
    long, of which one half is taken, so that its ends do not meet.
    """
    rng = np.random.default_rng(seed)
    sample_h = 1.0 / (3600.0 * rate_hz)
    white = noise.angle_random_walk_deg_sqrt_h / np.sqrt(sample_h) * rng.standard_normal(count)
    rounding = noise.quantisation_deg / sample_h * np.diff(rng.standard_normal(count + 1))
    steps = noise.rate_random_walk_dph_sqrt_h * np.sqrt(sample_h) * rng.standard_normal(count)
    ramp = noise.rate_ramp_dph_h * sample_h * np.arange(count)
    length = 1 << (2 * count - 1).bit_length()  # a transform of another length is slow
    frequency = np.fft.rfftfreq(length)[1:]
    gain = noise.bias_instability_dph / np.sqrt(2.0 * np.sin(np.pi * frequency))
    spectrum = np.concatenate(([0.0], np.fft.rfft(rng.standard_normal(length))[1:] * gain))
    flicker = np.fft.irfft(spectrum, length)[:count]
    return np.asarray(white + rounding + np.cumsum(steps) + ramp + flicker)
