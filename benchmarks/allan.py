"""Allan deviation: time against allantools, and how often the stated 95 % intervals hold a gyro's coefficients.

`python -m benchmarks.allan` prints both tables; the coverage takes about a minute.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from importlib.metadata import version

import allantools
import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.allan import allan_deviation
from bench.analysis.common.allan_noise import NOISE_NAMES, fit_noise
from benchmarks._measure import Row, figure, in_turns, row

SAMPLES = 10_000_000
SEEDS = 500
GYROS: dict[str, tuple[float, float, float, float, float]] = {
    "RLG": (1e-6, 2e-4, 1.2e-3, 5e-4, 0.0),
    "FOG": (1.2e-5, 3e-3, 4e-3, 3e-3, 2e-3),
    "FOG, drifting": (1.2e-5, 2e-3, 6e-3, 1.2e-2, 6e-3),
}
"""Q deg, N deg/sqrt(h), B deg/h, K deg/h/sqrt(h), R deg/h/h."""


def rows() -> Iterator[Row]:
    """Yield octave averaging times of 10^7 samples, ours and allantools' in turns, and reading them once."""
    data = np.random.default_rng(0).standard_normal(SAMPLES)
    taus = 2.0 ** np.arange(int(np.log2(SAMPLES // 2)) + 1)
    peer = partial(allantools.oadev, data, rate=1.0, data_type="freq", taus=taus)
    name = f"allantools {version('allantools')} oadev"
    few, every = partial(allan_deviation, data, 1.0), partial(allan_deviation, data, 1.0, all_starts=True)
    title = f"Allan deviation, {SAMPLES:.0e} samples, octaves"
    yield row(f"{title}, 16 starts an averaging time", in_turns(few, peer, turns=3), name)
    all_of_them = in_turns(every, peer)
    yield row(f"{title}, every start", all_of_them, name)
    yield figure(
        f"{title}, every start: times faster than allantools", all_of_them.ratio, 8.0, "goal", "times"
    )
    ramp = data + np.linspace(0.0, 1e6, SAMPLES)  # ten octaves of it lose digits
    drifting = in_turns(
        partial(allan_deviation, ramp, 1.0, all_starts=True),
        partial(allantools.oadev, ramp, rate=1.0, data_type="freq", taus=taus),
    )
    yield row(f"{title}, every start, a ramp of 1e6 times the noise", drifting, name)
    limit = "limit: their running sum, once"
    yield row(f"{title}, 16 starts an averaging time", in_turns(few, partial(np.cumsum, data)), limit)
    day = data[:86_400]
    yield row(
        "noise of a day of 1 s means: five coefficients and their intervals",
        in_turns(lambda: fit_noise(allan_deviation(day, 1.0)), partial(_identified, day)),
        f"{name}, noise type and its interval at each averaging time",
    )


def _identified(data: NDArray[np.float64]) -> list[tuple[float, float]]:
    """Return what allantools says of each averaging time: lag-1 identification, then a chi-squared interval."""
    taus, deviations, *_ = allantools.oadev(data, rate=1.0, data_type="freq", taus="octave")
    found = []
    for tau, deviation in zip(taus, deviations, strict=True):
        averages = int(tau)
        if len(data) // averages < 30:
            continue  # lag-1 needs as many
        alpha = allantools.autocorr_noise_id(data, averages, data_type="freq")[0]
        freedom = allantools.edf_greenhall(alpha=alpha, d=2, m=averages, N=len(data), overlapping=True)
        found.append(allantools.confidence_interval(deviation, freedom, 0.95))
    return found


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
    from benchmarks.__main__ import show

    show(rows())
    print(f"share of {SEEDS} seeds (20 h at 1 Hz) inside the stated 95 % interval")
    for gyro, true in GYROS.items():
        shares = coverage(true)
        text = ", ".join(f"{name} {share:.3f}" for name, share in zip(NOISE_NAMES, shares, strict=True))
        print(f"{gyro}: {text}")
