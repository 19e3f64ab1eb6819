"""The five noise coefficients behind an Allan deviation, each with the interval that holds it.

Model: sigma^2 = 3 Q^2/tau^2 + N^2/tau + (2 ln2/pi) B^2 + K^2 tau/3 + R^2 tau^2/2 with tau in h (IEEE Std 952,
annex on the Allan variance). It is linear in the squares, which are fitted by generalised least squares: values
at neighbouring averaging times rise and fall together, and their covariance follows from the spectrum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.analysis.common.allan import AllanDeviation
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

LONGEST_SHARE = 0.1
"""Averaging times beyond this part of the record are left out: they rest on fewer than ten differences."""
_PER_OCTAVE = 96
_LOWEST = 1.0 / 64.0
"""Grid of frequencies: points an octave, from this part of one cycle a record up to half the sample rate."""
_ITERATIONS = 6
_WIDENING = 1.06
"""The covariance is made of fitted coefficients; without this, 95 % intervals held 93 to 94 % of 500 gyros."""
_UNSEEN = 0.5
"""Part of its upper limit that a flicker which is not shown counts with in the errors of other figures: with
nothing, a perfect gyro was certified with a bias repeatability in 13 of 100 tests (benchmarks/metrology.py)."""
_FLICKER, _WALK, _RAMP = 2, 3, 4
"""Positions of flicker, of the rate random walk and of the rate ramp, the one term that is not noise."""


@dataclass(frozen=True)
class NoiseCoefficients:
    """Quantisation Q, angle random walk N, bias instability B, rate random walk K, rate ramp R."""

    quantisation_deg: float
    angle_random_walk_deg_sqrt_h: float
    bias_instability_dph: float
    rate_random_walk_dph_sqrt_h: float
    rate_ramp_dph_h: float

    def deviation(self, tau_s: ArrayLike) -> Array:
        """Return the Allan deviation (deg/h) of these coefficients at `tau_s`."""
        return np.asarray(np.sqrt(_basis(np.asarray(tau_s, dtype=np.float64) / 3600.0) @ self.squares()))

    def squares(self) -> Array:
        """Return the squares of the coefficients, shape (5,), in the order Q, N, B, K, R."""
        return np.square([getattr(self, name) for name in NOISE_NAMES])


NOISE_NAMES = tuple(NoiseCoefficients.__dataclass_fields__)
NOISE_UNITS = ("deg", "deg/sqrt(h)", "deg/h", "deg/h/sqrt(h)", "deg/h/h")


@dataclass(frozen=True)
class NoiseFit:
    """Fitted coefficients (zero where the data ask for none) and the ends of their intervals of `level`.

    A low end of zero means that the record does not show this noise; the high end is then its upper limit,
    infinite if the record says nothing about it. The interval always holds the coefficient. `for_errors`: the
    fit without a walk and a ramp that are not shown, and with some flicker always, for the errors of other
    figures.
    """

    coefficients: NoiseCoefficients
    low: NoiseCoefficients
    high: NoiseCoefficients
    level: float
    for_errors: NoiseCoefficients


def fit_noise(allan: AllanDeviation, *, level: float = 0.95) -> NoiseFit:
    """Fit the five coefficients to an Allan deviation in deg/h.

    Averaging times up to a tenth of the record are used. Use it on an equilibrium record: thermal drift looks
    like rate random walk and ramp. An interval holds the values of a coefficient whose own scatter, the other
    coefficients given, puts the estimate no further away than `level` allows. ConfigurationError for fewer than
    five usable averaging times.
    """
    from scipy.special import ndtri  # slow to import

    used = allan.tau_s <= LONGEST_SHARE * allan.record_s
    if used.sum() < 5:
        raise ConfigurationError(
            "too few averaging times for five noise coefficients",
            where="Allan deviation",
            found=f"{int(used.sum())} up to a tenth of the record of {allan.record_s:g} s",
            expected="at least 5, better 10 or more over three decades",
            remedy="pass more averaging times, or a longer record",
        )
    variance = allan.deviation[used] ** 2
    scatter = _Scatter(allan.tau_s[used] / 3600.0, allan.record_s / 3600.0, 1.0 / (allan.rate_hz * 3600.0))
    start = np.diag((variance * allan.relative_error[used]) ** 2)
    squares, covariance = _fit(scatter, variance, start, np.ones(5, dtype=np.bool_))
    low, high = _intervals(
        scatter, covariance, variance, squares, _WIDENING * float(ndtri(0.5 + level / 2.0))
    )
    # The intervals are those of the unconstrained estimates. Where another coefficient would come out negative
    # the fitted one can lie below its own; in 11 such cases of 900 simulated gyros that held 3 of the true ones.
    low, high = np.minimum(low, squares), np.maximum(high, squares)
    # Flicker, walk and ramp stand for one another: what is not shown is no reason to leave the shown rise to it.
    errors, _ = _fit(
        scatter, variance, start, np.array([True, True, True, low[_WALK] > 0.0, low[_RAMP] > 0.0])
    )
    if low[_FLICKER] == 0.0:
        # A fit of zero, as in a quarter of short records, would make other figures too sure. A short record
        # gives no upper end either; flicker alone is not more than the whole variance at any time.
        whole = variance * (1.0 + allan.relative_error[used]) / scatter.basis[:, _FLICKER]
        errors[_FLICKER] = max(errors[_FLICKER], _UNSEEN**2 * min(high[_FLICKER], float(whole.min())))
    return NoiseFit(
        _coefficients(squares), _coefficients(low), _coefficients(high), level, _coefficients(errors)
    )


def _fit(
    scatter: _Scatter, variance: Array, covariance: Array, use: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Return the squares (5,), zero where not in `use`, and the covariance of the variances that they give."""
    from scipy.linalg import solve_triangular  # slow to import
    from scipy.optimize import nnls  # slow to import

    squares = np.zeros(5)
    for _ in range(_ITERATIONS):
        factor = np.linalg.cholesky(covariance)
        white = solve_triangular(factor, scatter.basis[:, use], lower=True)
        scale = np.linalg.norm(white, axis=0)
        solution, _ = nnls(white / scale, solve_triangular(factor, variance, lower=True))
        squares[use] = solution / scale
        covariance = scatter.covariance(squares)
    return squares, covariance


def _intervals(
    scatter: _Scatter, covariance: Array, variance: Array, squares: Array, z: float
) -> tuple[Array, Array]:
    """Return low and high ends of the squares: the x with (estimate - x)^2 <= z^2 Var(estimate | x).

    The estimates are the unconstrained ones; their variance is a quadratic a + b x + q x^2 of the coefficient
    in question, so the ends are the roots of a quadratic too.
    """
    scale = np.linalg.norm(scatter.basis, axis=0)
    basis = scatter.basis / scale
    weighted = np.linalg.solve(covariance, basis)
    weights = np.linalg.solve(basis.T @ weighted, weighted.T) / scale[:, None]
    estimate = weights @ variance
    low, high = np.zeros(5), np.full(5, np.inf)
    a, b, q = scatter.variance_of(weights[_WALK], squares, _WALK)
    walk_error = np.sqrt(a + (b + q * squares[_WALK]) * squares[_WALK])
    for index in range(5):
        given = squares.copy()
        if index == _RAMP:  # a walk taken for a ramp comes out low itself, and its scatter with it
            given[_WALK] += walk_error
        a, b, q = scatter.variance_of(weights[index], given, index)
        outer, inner = 1.0 - z * z * q, estimate[index] + 0.5 * z * z * b
        constant = estimate[index] ** 2 - z * z * a
        root = np.sqrt(max(inner * inner - outer * constant, 0.0))
        # In the form that stays finite when the variance grows as fast as the square of the coefficient.
        low[index] = max(constant / (inner + root), 0.0) if inner + root > 0.0 else 0.0
        if outer > 0.0:
            # An estimate below zero is scatter: as an upper limit it would claim more than the record knows.
            above = max(estimate[index], 0.0)
            inner = above + 0.5 * z * z * b
            root = np.sqrt(max(inner * inner - outer * (above**2 - z * z * a), 0.0))
            high[index] = (inner + root) / outer
    return low, high


class _Scatter:
    """How Allan variances of one record scatter together, given the squares of the noise coefficients.

    The estimate at tau is the periodogram weighted with |H_tau|^2; its ordinates are independent and exponential,
    so Cov_ij = integral of S^2 |H_i|^2 |H_j|^2 df / T. A ramp multiplies the mean of the differences, which the
    noise moves too.
    """

    def __init__(self, tau_h: Array, record_h: float, sample_h: float) -> None:
        octaves = np.log2([_LOWEST / record_h, 0.5 / sample_h])
        grid = 2.0 ** np.arange(octaves[0] + 0.5 / _PER_OCTAVE, octaves[1], 1.0 / _PER_OCTAVE)
        step = grid * np.log(2.0) / _PER_OCTAVE
        length = (tau_h / sample_h)[:, None]
        starts = record_h / sample_h - 2.0 * length + 1.0
        phase = np.pi * grid * sample_h
        sine = np.sin(phase)
        self.basis = _basis(tau_h)
        self.spectra = _spectra(sine, sample_h)
        self.power = 4.0 * np.sin(length * phase) ** 4 / (length * sine) ** 2 * np.sqrt(step / record_h)
        mean = 2.0 * np.sin(length * phase) ** 2 / (length * sine)
        mean *= np.sin(starts * phase) / (starts * sine)
        self.drift = tau_h[:, None] * mean * np.sqrt(2.0 * step)

    def covariance(self, squares: Array) -> Array:
        """Return the covariance of the variances, shape (k, k)."""
        spectrum = self.spectra @ squares
        quadratic = self.power * spectrum
        linear = self.drift * np.sqrt(spectrum * squares[_RAMP])
        total = quadratic @ quadratic.T + linear @ linear.T
        # Octaves of exact model data would be singular to rounding.
        return np.asarray(total + 1e-6 * np.diag(np.diag(total)))

    def variance_of(self, weights: Array, squares: Array, index: int) -> tuple[float, float, float]:
        """Return (a, b, q): a weighted sum of the variances has variance a + b x + q x^2, x = squares[index]."""
        others = np.where(np.arange(5) == index, 0.0, squares)
        rest, own = self.spectra @ others, self.spectra[:, index]
        quadratic, linear = weights @ self.power, (weights @ self.drift) ** 2
        u, v = quadratic * rest, quadratic * own
        a, b, q = float(u @ u), 2.0 * float(u @ v), float(v @ v)
        if index == _RAMP:
            return a, b + float(linear @ rest), q
        return a + squares[_RAMP] * float(linear @ rest), b + squares[_RAMP] * float(linear @ own), q


def _spectra(sine: Array, sample_h: float) -> Array:
    """Two-sided spectra of the sampled rate for unit squares, (frequencies, 5); a ramp is not noise."""
    angular = 2.0 * sine / sample_h
    white = np.ones_like(sine)
    return np.stack(
        [4.0 * sine**2 / sample_h, white, 1.0 / angular, 1.0 / angular**2, np.zeros_like(sine)], axis=-1
    )


def _basis(tau_h: Array) -> Array:
    flicker = np.full_like(tau_h, 2.0 * np.log(2.0) / np.pi)
    return np.stack([3.0 / tau_h**2, 1.0 / tau_h, flicker, tau_h / 3.0, tau_h**2 / 2.0], axis=-1)


def _coefficients(squares: Array) -> NoiseCoefficients:
    return NoiseCoefficients(*(float(root) for root in np.sqrt(squares)))
