"""Scale factor from a sequence of rates: nonlinearity, asymmetry, repeatability, hysteresis, with intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from bench.analysis.common.allan_noise import NoiseCoefficients
from bench.analysis.common.mean_noise import covariance_of_means, draws
from bench.analysis.figures._estimate import DRAWS, Estimate, largest, linear, spread
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS
from drivers.base.errors import ConfigurationError

_ENOUGH = 8
"""Degrees of freedom from which the scatter of repeats says more than the noise at rest."""


@dataclass(frozen=True)
class RateSequence:
    """Dwells of one sequence in the order of measurement, shape (n,) each.

    `nominal_dps`: the rate asked for; `rate_dps`: the rate by the table's encoder; `output`: the gyro's mean.
    """

    nominal_dps: Array
    rate_dps: Array
    output: Array
    start_s: Array
    end_s: Array


@dataclass(frozen=True)
class ScaleFactorFit:
    """Least-squares line F = K rate + F0 through one sequence; residuals of shape (n,) in the output's unit."""

    scale_factor: float
    offset: float
    residual: Array


@dataclass(frozen=True)
class ScaleFactorFigures:
    """Figures of one or more sequences, ppm but for the scale factor, each with its 95 % interval.

    Nonlinearity: largest residual of any rate, averaged over its dwells, over the output at the largest rate.
    Asymmetry: (K+ - K-) / K, positive where the gyro gives more at positive rates. Hysteresis: largest difference
    at one rate, falling less rising, of full scale, with its sign; None when no rate was approached from both
    sides. Repeatability: standard deviation of K over sequences beyond noise; None for one sequence.
    """

    scale_factor: Estimate
    nonlinearity_ppm: Estimate
    asymmetry_ppm: Estimate
    repeatability_ppm: Estimate | None
    hysteresis_ppm: Estimate | None


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
    slope = float(slope_weights(rate) @ out)
    offset = float(out.mean() - slope * rate.mean())
    return ScaleFactorFit(slope, offset, out - slope * rate - offset)


def slope_weights(rate: Array) -> Array:
    """Return the weights (n,) of outputs in the least-squares slope over `rate` (n,)."""
    centred = rate - rate.mean()
    return np.asarray(centred / (centred @ centred))


def scale_factor_figures(
    sequences: Sequence[RateSequence], noise: NoiseCoefficients | None
) -> ScaleFactorFigures:
    """Return the figures of sequences whose outputs are in deg/s.

    Every figure is linear in the outputs or the largest of linear ones; draws of the gyro's noise go through the
    same weights. The size of the noise is that of the repeats where there are enough, else that of `noise`, the
    coefficients of the unit at rest. ConfigurationError where there is neither.
    """
    fits = [fit_rate_sequence(item.rate_dps, item.output) for item in sequences]
    slopes = np.array([fit.scale_factor for fit in fits])
    mean = float(slopes.mean())
    output = np.concatenate([item.output for item in sequences])
    full_scale = abs(mean) * max(float(np.abs(item.rate_dps).max()) for item in sequences)
    to_slope = _beside(*(slope_weights(item.rate_dps)[None] for item in sequences))
    residual = _beside(*(_residual_weights(item.rate_dps) for item in sequences))
    at_rate = _rows_of_rates(sequences) @ residual
    differences = _rising_and_falling(sequences)
    errors = _errors(sequences, residual, output, noise)
    sides = np.concatenate([_asymmetry_weights(item) for item in sequences]) / len(sequences)
    hysteresis = None
    if len(differences):
        size = largest(differences @ residual @ output, errors @ (differences @ residual).T)
        hysteresis = _signed(size, differences @ residual @ output).times(1e6 / full_scale)
    of_slopes = errors @ to_slope.T
    return ScaleFactorFigures(
        scale_factor=replace(linear(mean, of_slopes.mean(axis=1)), freedom=_freedom(sequences)),
        nonlinearity_ppm=largest(at_rate @ output, errors @ at_rate.T).times(1e6 / full_scale),
        asymmetry_ppm=linear(float(sides @ output), errors @ sides).times(1e6 / abs(mean)),
        repeatability_ppm=spread(slopes, np.cov(of_slopes.T)).times(1e6 / abs(mean))
        if len(fits) > 1
        else None,
        hysteresis_ppm=hysteresis,
    )


def _errors(
    sequences: Sequence[RateSequence], residual: Array, output: Array, noise: NoiseCoefficients | None
) -> Array:
    """Return draws (m, n) of the outputs' errors, a level of each sequence taken off."""
    start, end = (
        np.concatenate([getattr(item, name) for item in sequences]) for name in ("start_s", "end_s")
    )
    repeats = _repeats(sequences)
    if repeats is None and noise is None:
        raise ConfigurationError(
            "these rates tell nothing of their own noise",
            where="standard test",
            found=f"{len(sequences)} sequence of {len(sequences[0].output)} dwells, no noise record",
            expected="the noise coefficients of the unit, or at least two equal sequences",
            remedy="record the noise, or set sequences to 2 or more",
        )
    covariance = np.zeros((len(start), len(start)))
    if noise is not None:
        covariance = covariance_of_means(start, end, noise)
    if repeats is not None and not covariance.any():
        covariance = np.diag(1.0 / (end - start))
    centre = _beside(*(np.eye(len(item.output)) - 1.0 / len(item.output) for item in sequences))
    # With a level taken off the covariance is one: of flicker and random walk only differences have a variance.
    errors = draws(centre @ covariance @ centre, DRAWS) / DPH_PER_DPS
    if repeats is None:
        return errors
    weights = repeats @ residual
    drawn = np.linalg.norm(errors @ weights.T, axis=1)
    return np.asarray(errors * (np.linalg.norm(weights @ output) / drawn)[:, None])


def _repeats(sequences: Sequence[RateSequence]) -> Array | None:
    """Return what compares each dwell with the same one of the other sequences; None for too few repeats."""
    if math.isinf(_freedom(sequences)):
        return None
    first, count = sequences[0].nominal_dps, len(sequences)
    return np.asarray(np.kron(np.eye(count) - 1.0 / count, np.eye(len(first))))


def _freedom(sequences: Sequence[RateSequence]) -> float:
    """Return the degrees of freedom of the repeats; infinite for too few of them."""
    first = sequences[0].nominal_dps
    equal = all(np.array_equal(item.nominal_dps, first) for item in sequences)
    freedom = (len(sequences) - 1) * (len(first) - 2)
    return float(freedom) if equal and freedom >= _ENOUGH else math.inf


def _residual_weights(rate: Array) -> Array:
    design = np.column_stack([np.ones_like(rate), rate])
    return np.asarray(np.eye(len(rate)) - design @ np.linalg.pinv(design))


def _rows_of_rates(sequences: Sequence[RateSequence]) -> Array:
    """Return the means over the dwells of each rate, (rates, n)."""
    nominal = np.concatenate([item.nominal_dps for item in sequences])
    same = nominal == np.unique(nominal)[:, None]
    return np.asarray(same / same.sum(axis=1, keepdims=True))


def _rising_and_falling(sequences: Sequence[RateSequence]) -> Array:
    """Return for each rate approached from both sides the mean after falling less that after rising, (k, n)."""
    nominal = np.concatenate([item.nominal_dps for item in sequences])
    change = np.concatenate([np.diff(item.nominal_dps, prepend=item.nominal_dps[0]) for item in sequences])
    rows = []
    for value in np.unique(nominal):
        up, down = ((nominal == value) & (sign * change > 0.0) for sign in (1.0, -1.0))
        if up.any() and down.any():
            rows.append(down / down.sum() - up / up.sum())
    return np.array(rows).reshape(len(rows), len(nominal))


def _signed(size: Estimate, values: Array) -> Estimate:
    """Return a largest magnitude with the sign of the value it came from; one not seen may have either."""
    if not size.seen:
        return Estimate(size.value, -size.high, size.high, seen=False)
    return size.times(float(np.sign(values[np.argmax(np.abs(values))])))


def _asymmetry_weights(item: RateSequence) -> Array:
    """Return the weights of outputs in K+ - K-: slopes through the rates of each sign and zero."""
    weights = np.zeros_like(item.rate_dps)
    for sign in (1.0, -1.0):
        side = sign * item.nominal_dps >= 0.0
        if len(np.unique(item.nominal_dps[side])) < 2:
            raise ConfigurationError(
                "no asymmetry without two rates of each sign",
                where="standard test",
                found=f"{len(np.unique(item.nominal_dps[side]))} of sign {sign:+.0f}",
                remedy="run the sequence to both sides",
            )
        weights[side] += sign * slope_weights(item.rate_dps[side])
    return weights


def _beside(*blocks: Array) -> Array:
    """Return matrices (m, n) along the diagonal of one that is zero elsewhere."""
    ends = np.cumsum([block.shape for block in blocks], axis=0)
    whole = np.zeros(ends[-1])
    for block, (row, column) in zip(blocks, ends.tolist(), strict=True):
        whole[row - block.shape[0] : row, column - block.shape[1] : column] = block
    return whole
