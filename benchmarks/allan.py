"""Allan deviation: time against allantools, and how often the stated 95 % intervals hold a gyro's coefficients.

`python -m benchmarks.allan` prints both tables; the coverage takes about a minute.
"""

from __future__ import annotations

from typing import Any

import allantools
import numpy as np
from numpy.typing import NDArray

from bench.fitting import NOISE_NAMES, allan_deviation, fit_noise
from drivers.clock import host_seconds

SAMPLES = 10_000_000
SEEDS = 500
GYROS: dict[str, tuple[float, float, float, float, float]] = {
    "RLG": (1e-6, 2e-4, 1.2e-3, 5e-4, 0.0),
    "FOG": (1.2e-5, 3e-3, 4e-3, 3e-3, 2e-3),
    "FOG, drifting": (1.2e-5, 2e-3, 6e-3, 1.2e-2, 6e-3),
}
"""Q deg, N deg/sqrt(h), B deg/h, K deg/h/sqrt(h), R deg/h/h."""


def rows() -> list[dict[str, Any]]:
    """Octave averaging times of 10^7 samples, ours and allantools' in turn; the best of three each."""
    data = np.random.default_rng(0).standard_normal(SAMPLES)
    taus = 2.0 ** np.arange(int(np.log2(SAMPLES // 2)) + 1)
    timed: dict[str, list[float]] = {"few": [], "all": [], "allantools": []}
    for _ in range(3):
        for name, run in (
            ("allantools", lambda: allantools.oadev(data, rate=1.0, data_type="freq", taus=taus)),
            ("few", lambda: allan_deviation(data, 1.0)),
            ("all", lambda: allan_deviation(data, 1.0, all_starts=True)),
        ):
            start = host_seconds()
            run()
            timed[name].append(host_seconds() - start)
    yardstick = min(timed["allantools"])
    names = {
        "few": "Allan deviation, 1e7 samples, octaves (16 starts an averaging time)",
        "all": "Allan deviation, 1e7 samples, octaves, every start",
    }
    return [
        {
            "benchmark": text,
            "ours": min(timed[name]),
            "yardstick": yardstick,
            "yardstick_name": "allantools.oadev",
            "unit": "s",
            "ratio": yardstick / min(timed[name]),
        }
        for name, text in names.items()
    ]


def simulate(
    rng: np.random.Generator, count: int, coefficients: tuple[float, ...], rate_hz: float = 1.0
) -> NDArray[np.float64]:
    """Return rate samples in deg/h, (count,), with the five noises; flicker is shaped in the spectrum."""
    q, n, b, k, r = coefficients
    sample_h = 1.0 / (3600.0 * rate_hz)
    values = n / np.sqrt(sample_h) * rng.standard_normal(count)
    values += np.diff(q * rng.standard_normal(count + 1)) / sample_h
    values += np.cumsum(k * np.sqrt(sample_h) * rng.standard_normal(count))
    values += r * sample_h * np.arange(count)
    frequency = np.fft.rfftfreq(2 * count)[1:]
    # Two-sided density B^2 / (2 pi f); twice the length, half thrown away, so that the ends do not meet.
    shape = np.concatenate(([0.0], 1.0 / np.sqrt(2.0 * np.sin(np.pi * frequency))))
    flicker = np.fft.irfft(np.fft.rfft(rng.standard_normal(2 * count)) * shape, 2 * count)[:count]
    return np.asarray(values + b * flicker)


def coverage(
    coefficients: tuple[float, ...], *, count: int = 72_000, seeds: int = SEEDS
) -> NDArray[np.float64]:
    """Return the share of seeds whose 95 % interval holds the true coefficient, shape (5,)."""
    held = np.zeros(5)
    for seed in range(seeds):
        record = simulate(np.random.default_rng(seed), count, coefficients)
        fit = fit_noise(allan_deviation(record, 1.0))
        low, high = (np.sqrt(end.squares()) for end in (fit.low, fit.high))
        held += (low <= coefficients) & (np.asarray(coefficients) <= high)
    return held / seeds


if __name__ == "__main__":
    for row in rows():
        print(f"{row['benchmark']}: {row['ours']:.3f} s, {row['yardstick_name']} {row['yardstick']:.3f} s, "
              f"{row['ratio']:.1f} x")  # fmt: skip
    print(f"share of {SEEDS} seeds (20 h at 1 Hz) inside the stated 95 % interval")
    for gyro, true in GYROS.items():
        shares = coverage(true)
        text = ", ".join(f"{name} {share:.3f}" for name, share in zip(NOISE_NAMES, shares, strict=True))
        print(f"{gyro}: {text}")
