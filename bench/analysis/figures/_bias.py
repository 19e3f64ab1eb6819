"""Bias, its stability, repeatability and sensitivity to temperature; the smallest rate that is seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bench.analysis.common.allan_noise import NoiseCoefficients
from bench.analysis.common.mean_noise import covariance_of_means, draws, freedom_of_blocks, white_variance
from bench.analysis.common.quantiles import chi_squared
from bench.analysis.common.statistics import BLOCK_S, bias_stability, block_means
from bench.analysis.figures._estimate import TWO_SIDED, Estimate, largest
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

_FEWEST_BLOCKS = 4
_WARM_UP_DRAWS = 400


@dataclass(frozen=True)
class BiasFigures:
    """Bias of one run in deg/h and its stability on averages of 10 s and of 100 s.

    White noise N in deg/sqrt(h) alone gives 18.97 N and 6 N: the averaging time belongs to the figure.
    """

    bias_dph: Estimate
    stability_10s_dph: Estimate
    stability_100s_dph: Estimate


def bias_figures(output_dph: Array, earth_rate_dph: float, noise: NoiseCoefficients) -> BiasFigures:
    """Return the bias figures of `output_dph`, shape (n,), 1 s means of a gyro at rest.

    Bias B0 = mean output less the Earth rate along the axis (IEEE Std 952, bias test; GJB 2426A, zero bias), that
    of this record: white noise and quantisation make its interval, slower noise is part of it. The stabilities'
    intervals are chi-squared with the degrees of freedom of `noise`. ConfigurationError for less than 200 s.
    """
    output = np.asarray(output_dph, dtype=np.float64)
    bias = float(np.nanmean(output)) - earth_rate_dph
    half = TWO_SIDED * float(white_variance(len(output), noise)) ** 0.5
    return BiasFigures(
        bias_dph=Estimate(bias, bias - half, bias + half),
        stability_10s_dph=_stability(output, 10, noise),
        stability_100s_dph=_stability(output, BLOCK_S, noise),
    )


def _stability(output: Array, length: int, noise: NoiseCoefficients) -> Estimate:
    value = bias_stability(output, length)
    freedom = freedom_of_blocks(len(output) // length, float(length), noise)
    low, high = (value * (freedom / chi_squared(p, freedom)) ** 0.5 for p in (0.975, 0.025))
    return Estimate(value, low, high)


def temperature_sensitivity(
    values: ArrayLike, temp_c: ArrayLike, errors: Array, *, relative: bool = False
) -> Estimate:
    """Return max |(v_i - v_0) / (T_i - T_0)| against the first point, per degC; `relative`: over v_0.

    GJB 2426A, temperature sensitivity of bias and (relative) of scale factor, without what errors of `values`
    (k,), distributed as `errors` (m, k), add to a largest one. Points within 1 K of the reference say nothing and
    are left out; ConfigurationError when none is left.
    """
    v, t = np.asarray(values, dtype=np.float64), np.asarray(temp_c, dtype=np.float64)
    step = t - t[0]
    use = np.abs(step) >= 1.0
    if not use.any():
        raise ConfigurationError(
            "no two temperatures for a temperature sensitivity",
            where="standard test",
            found=", ".join(f"{temp:.1f} degC" for temp in t),
            expected="points at least 1 K from the reference",
            remedy="hold the unit at other temperatures",
        )
    size = step[use] * (v[0] if relative else 1.0)
    return largest((v - v[0])[use] / size, (errors - errors[:, :1])[:, use] / size)


def warm_up_time_s(output_dph: Array, tolerance_dph: float, noise: NoiseCoefficients) -> Estimate:
    """Return the time from switch-on after which the transient stays within `tolerance_dph`.

    IEEE Std 952, warm-up time. The transient is the monotone course nearest to the 100 s means (of 1 s values)
    about the mean of the last quarter of the record: a single mean that noise puts outside is none. The interval
    is that of the same time in draws of `noise` about that course, and half a block to either side.
    ConfigurationError for less than 400 s, or if the course is still outside at the end.
    """
    means = block_means(np.asarray(output_dph, dtype=np.float64))
    count = len(means)
    if count < _FEWEST_BLOCKS or not np.isfinite(means).all():
        raise ConfigurationError(
            "this record tells no warm-up time",
            where="standard test",
            found=f"{count} blocks of {BLOCK_S} s, {int((~np.isfinite(means)).sum())} of them without data",
            expected=f"at least {_FEWEST_BLOCKS} blocks, all with data",
            remedy="record the warm-up for longer",
        )
    start = BLOCK_S * np.arange(count)
    centre = np.eye(count) - 1.0 / count
    errors = draws(centre @ covariance_of_means(start, start + BLOCK_S, noise) @ centre, _WARM_UP_DRAWS)
    course = _course(means)
    outside = _blocks_outside(course, tolerance_dph)
    if outside == count:
        raise ConfigurationError(
            "the unit is still warming up at the end of the record",
            where="standard test",
            found=f"a course of {np.ptp(course):.3g} deg/h",
            expected=f"the last quarter within {tolerance_dph:.3g} deg/h of its mean",
            remedy="set a longer warm_up_min",
        )
    drawn = [_blocks_outside(_course(course + error), tolerance_dph) for error in errors]
    low, high = np.quantile(drawn, [0.025, 0.975], method="nearest")
    half = 0.5 * BLOCK_S
    return Estimate(
        float(BLOCK_S * outside),
        max(0.0, BLOCK_S * float(min(low, outside)) - half),
        BLOCK_S * float(max(high, outside)) + half,
        seen=bool(low > 0),
    )


def _course(means: Array) -> Array:
    """Return the monotone course nearest to block means, rising or falling, about its settled value."""
    from scipy.optimize import isotonic_regression  # slow to import

    courses = [isotonic_regression(means, increasing=rising).x for rising in (True, False)]
    nearest = min(courses, key=lambda course: float(np.sum((means - course) ** 2)))
    return np.asarray(nearest - means[-max(1, len(means) // 4) :].mean())


def _blocks_outside(course: Array, tolerance: float) -> int:
    outside = np.flatnonzero(np.abs(course) > tolerance)
    return int(outside[-1]) + 1 if len(outside) else 0


@dataclass(frozen=True)
class RateStep:
    """A small input: the change of rate put in, the change of output it made and its standard error, deg/h."""

    input_dph: float
    output_dph: float
    error_dph: float = 0.0

    @property
    def ratio(self) -> float:
        """Output over input."""
        return self.output_dph / self.input_dph

    @property
    def margin(self) -> float:
        """How far noise may have moved the ratio (97.5 %)."""
        return TWO_SIDED * self.error_dph / abs(self.input_dph)


def threshold(steps: Sequence[RateStep], *, share: float = 0.5) -> Estimate:
    """Return the smallest input, deg/h, shown to give at least `share` of the expected output.

    IEEE Std 647 and 952, GJB 2426A: the threshold for inputs from rest, the resolution for changes of a rate
    far from zero. All larger inputs must be shown to pass too. The threshold lies above the largest input shown
    not to pass; where none is, it is not seen. ConfigurationError when no input is shown to pass.
    """
    found, low = math.inf, 0.0
    by_size = sorted(steps, key=lambda step: -abs(step.input_dph))
    for step in by_size:
        if not step.ratio - step.margin >= share:  # an answer that is no number shows nothing
            break
        found = abs(step.input_dph)
    low = max((abs(step.input_dph) for step in steps if step.ratio + step.margin < share), default=0.0)
    if math.isinf(found):
        raise ConfigurationError(
            "no input is shown to give its output",
            where="standard test",
            found=", ".join(
                f"{step.input_dph:g} deg/h gave {100 * step.ratio:.0f} +- {100 * step.margin:.0f} %"
                for step in by_size
            )
            or "none",
            expected=f"at least {100 * share:.0f} %, beyond the noise",
            remedy="put in larger rates, or dwell longer",
        )
    return Estimate(found, low, found, seen=low > 0.0)
