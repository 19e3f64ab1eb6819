"""Scale factor from a sequence of rates: nonlinearity, asymmetry, repeatability, temperature sensitivity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError


@dataclass(frozen=True)
class ScaleFactorFit:
    """Least-squares line F = K rate + F0 through one sequence; residuals of shape (n,) in the output's unit."""

    scale_factor: float
    offset: float
    residual: Array


@dataclass(frozen=True)
class ScaleFactorFigures:
    """Figures of one or more sequences. `repeatability_ppm` is None for one sequence.

    `hysteresis_ppm`: largest difference between output at the same rate with rates rising and falling, of full
    scale; None when no rate was approached from both sides.
    """

    scale_factor: float
    nonlinearity_ppm: float
    asymmetry_ppm: float
    repeatability_ppm: float | None
    hysteresis_ppm: float | None


def fit_rate_sequence(rate_dps: ArrayLike, output: ArrayLike) -> ScaleFactorFit:
    """Fit F = K rate + F0 (IEEE Std 952, scale-factor test; GJB 2426A, least squares).

    ConfigurationError for fewer than three different rates.
    """
    rate, out = np.asarray(rate_dps, dtype=np.float64), np.asarray(output, dtype=np.float64)
    if len(np.unique(rate)) < 3 or len(rate) != len(out) or not np.isfinite(out).all():
        raise ConfigurationError(
            "these rates give no scale factor",
            where="standard test",
            found=f"{len(np.unique(rate))} different rates, {int((~np.isfinite(out)).sum())} outputs missing",
            expected="at least 3 different rates with an output each; 11 a sign for a figure of the standards",
            remedy="add rates to the sequence",
        )
    slope = _slope(rate, out)
    offset = float(out.mean() - slope * rate.mean())
    return ScaleFactorFit(slope, offset, out - slope * rate - offset)


def scale_factor_figures(sequences: Sequence[tuple[ArrayLike, ArrayLike]]) -> ScaleFactorFigures:
    """Return the figures of sequences of (rates in deg/s, outputs), each in the order of measurement.

    Nonlinearity: largest residual over the output at the largest rate. Asymmetry: |K+ - K-| / K, each sign fitted
    with the zero-rate points through a line of its own. Repeatability: sample standard deviation of K over
    sequences by their mean.
    """
    fits = [fit_rate_sequence(rate, out) for rate, out in sequences]
    mean = float(np.mean([fit.scale_factor for fit in fits]))
    worst, hysteresis, asymmetry = 0.0, [], []
    for (rates, outputs), fit in zip(sequences, fits, strict=True):
        rate, out = np.asarray(rates, dtype=np.float64), np.asarray(outputs, dtype=np.float64)
        full_scale = abs(fit.scale_factor) * float(np.abs(rate).max())
        worst = max(worst, float(np.abs(fit.residual).max()) / full_scale)
        asymmetry.append(_asymmetry(rate, out) / abs(fit.scale_factor))
        if (difference := _rising_and_falling(rate, out)) is not None:
            hysteresis.append(difference / full_scale)
    slopes = [fit.scale_factor for fit in fits]
    return ScaleFactorFigures(
        scale_factor=mean,
        nonlinearity_ppm=1e6 * worst,
        asymmetry_ppm=1e6 * float(np.mean(asymmetry)),
        repeatability_ppm=relative_repeatability_ppm(slopes) if len(slopes) > 1 else None,
        hysteresis_ppm=1e6 * max(hysteresis) if hysteresis else None,
    )


def relative_repeatability_ppm(scale_factors: ArrayLike) -> float:
    """Return the sample standard deviation over the mean, ppm (GJB 2426A, scale-factor repeatability)."""
    values = np.asarray(scale_factors, dtype=np.float64)
    return float(1e6 * np.std(values, ddof=1) / abs(values.mean()))


def _slope(rate: Array, out: Array) -> float:
    centred = rate - rate.mean()
    return float(centred @ out / (centred @ centred))


def _asymmetry(rate: Array, out: Array) -> float:
    """Return |K+ - K-|: slopes through the rates of each sign and zero."""
    slopes = []
    for sign in (1.0, -1.0):
        side = sign * rate >= 0.0
        if len(np.unique(rate[side])) < 2:
            raise ConfigurationError(
                "no asymmetry without two rates of each sign",
                where="standard test",
                found=f"{len(np.unique(rate[side]))} of sign {sign:+.0f}",
                remedy="run the sequence to both sides",
            )
        slopes.append(_slope(rate[side], out[side]))
    return abs(slopes[0] - slopes[1])


def _rising_and_falling(rate: Array, out: Array) -> float | None:
    """Return the largest difference at one rate between arriving from below and from above."""
    change = np.diff(rate, prepend=rate[0])
    differences = []
    for value in np.unique(rate):
        at = rate == value
        up, down = out[at & (change > 0.0)], out[at & (change < 0.0)]
        if len(up) and len(down):
            differences.append(abs(float(up.mean() - down.mean())))
    return max(differences, default=None)
