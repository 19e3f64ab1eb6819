"""The gyro's noise: its power at every DCT coefficient, and a fit of its coefficients to quiet data.

In the orthonormal DCT-II of n samples a random walk from a free start and white noise are exactly uncorrelated
(the DCT-II diagonalises the second difference with reflecting ends; Strang, SIAM Review 41, 1999), Markov
processes nearly so. Noise is therefore a power per coefficient, and whitening a division.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.optimize import minimize

from drivers.base.arrays import Array

FLICKER_TIMES_S = 3.0 ** np.arange(9)
_LEAST = 1e-9
_FARTHEST = 30.0
"""In the logarithm of a coefficient, from the data sheet's."""


@dataclass(frozen=True)
class Noise:
    """Coefficients as in IEEE Std 952: ARW N, bias instability B, rate random walk K, angle quantum.

    Beside them correlated (Gauss-Markov) noise of an order and a time: what a diagnosis finds that differs from
    repeat to repeat; no model file has it.
    """

    arw_deg_per_sqrt_h: float
    bias_instability_dph: float = 0.0
    rate_random_walk_dph_per_sqrt_h: float = 0.0
    quantum_arcsec: float = 0.0
    correlated_dph: float = 0.0
    correlation_time_s: float = 0.0
    correlation_order: float = 1.0

    @property
    def coefficients(self) -> dict[str, float]:
        """The four of IEEE Std 952 by name, as a model file has them."""
        return {name: float(getattr(self, name)) for name in NAMES}

    def beside(self, known: Noise) -> Noise:
        """Return the noise together with white noise and quantisation that are no gyro's."""
        return replace(
            self,
            arw_deg_per_sqrt_h=math.hypot(self.arw_deg_per_sqrt_h, known.arw_deg_per_sqrt_h),
            quantum_arcsec=math.hypot(self.quantum_arcsec, known.quantum_arcsec),
        )

    @property
    def coarseness(self) -> float:
        """How many times coarser than 0.02 deg/sqrt(h) and 0.1 deg/h the gyro is, 1 for a better one.

        The catalogue's bounds on biases hold for optical gyros; a MEMS gyro is noisier and drifts more, alike.
        """
        return max(1.0, self.arw_deg_per_sqrt_h / 0.02, self.bias_instability_dph / 0.1)


CORRELATED = "correlated_dph"
NOTHING = Noise(0.0)
NAMES = tuple(field.name for field in fields(Noise) if not field.name.startswith("correl"))
_ALL = (*NAMES, CORRELATED)


def unit_spectra(frequency: Array, period_s: float, noise: Noise) -> Array:
    """Return power (deg/h)^2 for every coefficient equal to one, float64 (5, m).

    `frequency` (m,) is k/n of the DCT coefficients, in half cycles a sample, 0 < frequency < 1. `noise` has the
    correlation time and order.
    """
    difference = 4.0 * np.sin(0.5 * np.pi * frequency) ** 2
    cosine = np.cos(np.pi * frequency)
    decay = np.exp(-period_s / FLICKER_TIMES_S)[:, None]
    flicker = ((1.0 - decay**2) / (1.0 + decay**2 - 2.0 * decay * cosine)).sum(axis=0)
    correlated = np.zeros(len(frequency))
    if noise.correlation_time_s > 0.0:
        own = math.exp(-period_s / noise.correlation_time_s)
        correlated = ((1.0 - own) ** 2 / (1.0 + own**2 - 2.0 * own * cosine)) ** noise.correlation_order
        # of unit variance: the mean of a spectrum over all frequencies
        if noise.correlation_order == 1.0:
            correlated *= (1.0 + own) / (1.0 - own)
        else:
            correlated *= (1.0 + own) ** 3 / (1.0 - own) / (1.0 + own**2)
    return np.stack(
        (
            np.full(len(frequency), 3600.0 / period_s),
            math.log(3.0) / math.pi * flicker,
            period_s / 3600.0 / difference,
            difference / 12.0 / period_s**2,
            correlated,
        )
    )


def spectrum(noise: Noise, frequency: Array, period_s: float) -> Array:
    """Return the noise's power (deg/h)^2 at DCT coefficients, (m,)."""
    coefficients = np.array([getattr(noise, name) for name in _ALL])
    return np.asarray(coefficients**2 @ unit_spectra(frequency, period_s, noise))


def power_of(noise: Noise, n: int, period_s: float) -> Array:
    """Return the noise's power (deg/h)^2 at the coefficients 1 .. n-1 of n samples, (n - 1,)."""
    return spectrum(noise, np.arange(1, n) / n, period_s)


@dataclass(frozen=True)
class Periodogram:
    """DCT power gathered in bins: mean frequency, sum of squares and count, each (bins,).

    `beside`: noise that is there beside the gyro's, and known: of the angle it is compared with.
    """

    frequency: Array
    energy: Array
    count: Array
    period_s: float
    beside: Noise = NOTHING

    def power(self, noise: Noise) -> Array:
        """Return the power per coefficient in each bin, (bins,), of a gyro's noise and of what is known."""
        return spectrum(noise.beside(self.beside), self.frequency, self.period_s)


def periodogram(
    coefficients: Array,
    period_s: float,
    known: Array | None = None,
    *,
    skip: int = 1,
    beside: Noise = NOTHING,
) -> Periodogram:
    """Gather DCT coefficients (rows, n) of residuals of one length in 8 bins an octave, `skip` lowest left out.

    Coefficient 0, the free bias, is never used. `known` (n - 1,) is the part of each other one that samples
    which are not missing make out.
    """
    rows, n = coefficients.shape
    index = np.arange(max(skip, 1), n)
    bins = np.floor(8.0 * np.log2(index)).astype(np.int64)
    _, bins = np.unique(bins, return_inverse=True)
    power = (coefficients[:, index] ** 2).sum(axis=0)
    part = np.ones(len(index)) if known is None else known[index - 1]
    count = np.asarray(np.bincount(bins, part), dtype=np.float64)
    mean = np.asarray(np.bincount(bins, part * index / n) / count, dtype=np.float64)
    energy = np.asarray(np.bincount(bins, part * power), dtype=np.float64)
    return Periodogram(mean, energy, count * rows, period_s, beside)


@dataclass(frozen=True)
class NoiseFit:
    """A fitted noise model and its cost, minus the logarithm of posterior density (up to a constant)."""

    noise: Noise
    cost: float


def fit_noise(data: Sequence[Periodogram], sheet: Noise, widths: dict[str, float]) -> NoiseFit:
    """Fit by maximum posterior: gamma likelihood of the bins, log-normal priors on the sheet's values.

    `widths` gives each coefficient's prior standard deviation in its logarithm; one that it lacks stays as
    the sheet has it.
    """
    free = [name for name in _ALL if name in widths]
    energy = np.concatenate([each.energy for each in data])
    count = np.concatenate([each.count for each in data])
    unit = np.concatenate([unit_spectra(part.frequency, part.period_s, sheet) for part in data], axis=1)
    beside = np.concatenate([spectrum(part.beside, part.frequency, part.period_s) for part in data])
    start = np.array([getattr(sheet, name) for name in _ALL])
    at = [_ALL.index(name) for name in free]
    centre = np.log(np.maximum(start[at], _LEAST))
    width = np.array([widths[name] for name in free])

    def cost(log: Array) -> tuple[float, Array]:
        values = start.copy()
        values[at] = np.exp(log)
        power = values**2 @ unit + beside
        ratio = energy / power
        slope = count - ratio
        away = (log - centre) / width
        value = 0.5 * (count * np.log(power) + ratio).sum() + 0.5 * (away**2).sum()
        gradient = (slope * unit[at] * values[at][:, None] ** 2 / power).sum(axis=1) + away / width
        return float(value), gradient

    # a step of the search into where nobody looks would leave the range of numbers
    bounds = np.stack([centre - _FARTHEST, centre + _FARTHEST], axis=1)
    found = minimize(cost, centre, jac=True, method="L-BFGS-B", bounds=bounds)
    fitted = dict(zip(free, np.exp(found.x).tolist(), strict=True))
    return NoiseFit(replace(sheet, **fitted), float(found.fun))
