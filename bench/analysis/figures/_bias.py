"""Bias, its stability, repeatability and sensitivity to temperature; the smallest rate that is seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bench.analysis.common.statistics import BLOCK_S, bias_stability, block_means
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError


@dataclass(frozen=True)
class BiasFigures:
    """Bias of one run in deg/h and its stability on averages of 10 s and of 100 s.

    White noise N in deg/sqrt(h) alone gives 18.97 N and 6 N: the averaging time belongs to the figure.
    """

    bias_dph: float
    stability_10s_dph: float
    stability_100s_dph: float


def bias_figures(output_dph: Array, earth_rate_dph: float) -> BiasFigures:
    """Return the bias figures of `output_dph`, shape (n,), 1 s means of a gyro at rest.

    Bias B0 = mean output less the Earth rate along the axis (IEEE Std 952, bias test; GJB 2426A, zero bias).
    ConfigurationError for less than 200 s.
    """
    output = np.asarray(output_dph, dtype=np.float64)
    return BiasFigures(
        bias_dph=float(np.nanmean(output_dph)) - earth_rate_dph,
        stability_10s_dph=bias_stability(output, 10),
        stability_100s_dph=bias_stability(output),
    )


def repeatability(values: ArrayLike) -> float:
    """Return the sample standard deviation of one figure over power cycles, in its unit.

    GJB 2426A and IEEE Std 952 want at least six; ConfigurationError for fewer than two.
    """
    values = np.asarray(values, dtype=np.float64)
    if len(values) < 2:
        raise ConfigurationError(
            "a repeatability needs repeats",
            where="standard test",
            found=f"{len(values)} value",
            expected="at least 2 power cycles, 6 for a figure of the standards",
            remedy="set cycles, or give the runs of several days",
        )
    return float(np.std(values, ddof=1))


def temperature_sensitivity(values: ArrayLike, temp_c: ArrayLike, *, relative: bool = False) -> float:
    """Return max |(v_i - v_0) / (T_i - T_0)| against the first point, per degC; `relative`: over v_0.

    GJB 2426A, temperature sensitivity of bias and (relative) of scale factor. Points within 1 K of the reference
    say nothing and are left out; ConfigurationError when none is left.
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
    size = v[0] if relative else 1.0
    return float(np.max(np.abs((v - v[0])[use] / (size * step[use]))))


def warm_up_time_s(output_dph: Array, tolerance_dph: float) -> float:
    """Return the time from switch-on after which 100 s means (of 1 s values) stay within `tolerance_dph`.

    IEEE Std 952, warm-up time. The band lies about the mean of the last quarter of the record. NaN if the record
    leaves the band at its very end.
    """
    means = block_means(np.asarray(output_dph, dtype=np.float64))
    settled = float(np.nanmean(means[-max(1, len(means) // 4) :]))
    outside = np.flatnonzero(~(np.abs(means - settled) <= tolerance_dph))
    if not len(outside):
        return 0.0
    return float("nan") if outside[-1] == len(means) - 1 else float((outside[-1] + 1) * BLOCK_S)


@dataclass(frozen=True)
class RateStep:
    """A small input: the change of rate that was put in, and the change of output it made, deg/h."""

    input_dph: float
    output_dph: float

    @property
    def ratio(self) -> float:
        """Output over input."""
        return self.output_dph / self.input_dph


def threshold(steps: Sequence[RateStep], *, share: float = 0.5) -> float:
    """Return the smallest input, deg/h, that gives at least `share` of the expected output.

    IEEE Std 647 and 952, GJB 2426A: the threshold for inputs from rest, the resolution for changes of a rate
    far from zero. All larger inputs must pass too; ConfigurationError when none does.
    """
    found = math.inf
    for step in sorted(steps, key=lambda step: -abs(step.input_dph)):
        if step.ratio < share:
            break
        found = abs(step.input_dph)
    if math.isinf(found):
        raise ConfigurationError(
            "no input gave its output: the threshold is above all of them",
            where="standard test",
            found=", ".join(f"{step.input_dph:g} deg/h gave {100 * step.ratio:.0f} %" for step in steps)
            or "none",
            expected=f"at least {100 * share:.0f} %",
            remedy="put in larger rates, or average longer",
        )
    return found
