"""The tests of the plan one by one: from intervals of measurement to figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from bench.analysis.common.allan import AllanDeviation, allan_deviation
from bench.analysis.common.allan_confidence import confidence_interval
from bench.analysis.common.allan_noise import (
    LONGEST_SHARE,
    NOISE_NAMES,
    NOISE_UNITS,
    NoiseCoefficients,
    NoiseFit,
    fit_noise,
)
from bench.analysis.common.mean_noise import covariance_of_means, draws
from bench.analysis.common.uncertainty import Budget
from bench.analysis.figures._bias import (
    RateStep,
    bias_figures,
    temperature_sensitivity,
    threshold,
    warm_up_time_s,
)
from bench.analysis.figures._estimate import DRAWS, TWO_SIDED, Estimate, linear, spread
from bench.analysis.figures._record import Measured
from bench.analysis.figures._scale_factor import (
    RateSequence,
    fit_rate_sequence,
    scale_factor_figures,
    slope_weights,
)
from bench.record.events.run import Interval
from bench.record.shown import Shown
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS, earth_rate_north_dph, earth_rate_up_dph
from drivers.base.errors import ConfigurationError

MISALIGNMENT_ALONG = "input-axis misalignment, component along the table"
MISALIGNMENT_ACROSS = "input-axis misalignment, component across the table"
ELEVATION = "input-axis elevation, unit in its fixture"
_STANDARDS = "IEEE Std 952; GJB 2426A"


@dataclass(frozen=True, repr=False)
class Figure(Shown):
    """One figure: unit, where its definition stands, and the 95 % interval that holds it where one is known.

    `seen`: whether the record shows it at all, or only that it is at most `bound`. `budget`: what its interval is
    made of; without one the interval is that of the noise alone. `freedom`: of that noise, as of an estimate.
    """

    name: str
    value: float
    unit: str
    source: str
    low: float | None = None
    high: float | None = None
    seen: bool = True
    freedom: float = math.inf
    budget: Budget | None = None

    def shown(self) -> dict[str, object]:
        """Return the value with its unit, and the 95 % interval where it is known."""
        known = self.low is not None and self.high is not None
        interval = {"95 %": f"{self.low:.6g} .. {self.high:.6g}"} if known else {}
        return {self.name: f"{self.value:.6g} {self.unit}".rstrip(), **interval}

    @classmethod
    def of(cls, name: str, estimate: Estimate, unit: str, source: str) -> Figure:
        """Return an estimate as a figure."""
        return cls(name, estimate.value, unit, source, estimate.low, estimate.high, estimate.seen,
                   estimate.freedom)  # fmt: skip

    @property
    def bound(self) -> float | None:
        """What a figure that is not seen is at most, by magnitude; None for one that is seen."""
        if self.seen or self.low is None or self.high is None:
            return None
        return max(abs(self.low), abs(self.high))

    @property
    def standard_error(self) -> float:
        """That of the noise alone; zero where no interval is known."""
        if self.budget is not None:
            return self.budget.contributions[0].uncertainty
        return 0.0 if self.low is None or self.high is None else (self.high - self.low) / (2.0 * TWO_SIDED)

    @property
    def digits(self) -> int:
        """Significant digits worth printing: two of the interval's half."""
        half = 0.0 if self.low is None or self.high is None else 0.5 * (self.high - self.low)
        if not (0.0 < half < math.inf) or self.value == 0.0:
            return 4 if self.unit else 8
        return min(12, max(2, 2 + math.floor(math.log10(abs(self.value))) - math.floor(math.log10(half))))


def noise_of(record: Measured, test: str) -> tuple[AllanDeviation, NoiseFit]:
    """Return the Allan deviation of a test's first interval, at the full rate of the record, and its noise."""
    samples, rate_hz = record.samples_dph(record.needed(test)[0])
    allan = allan_deviation(samples, rate_hz)
    return allan, fit_noise(allan)


def noise_figures(allan: AllanDeviation, noise: NoiseFit) -> list[Figure]:
    """Return the five coefficients and the minimum of the curve they describe."""
    found = [
        Figure(
            name.rsplit("_d", 1)[0].replace("_", " "),
            getattr(noise.coefficients, name),
            unit,
            f"IEEE Std 952, Allan variance at {allan.rate_hz:.4g} Hz",
            getattr(noise.low, name),
            getattr(noise.high, name),
            getattr(noise.low, name) > 0.0,
        )
        for name, unit in zip(NOISE_NAMES, NOISE_UNITS, strict=True)
    ]
    low, high = confidence_interval(allan)
    used = np.flatnonzero(allan.tau_s <= LONGEST_SHARE * allan.record_s)
    # Where the fitted curve is lowest: the lowest of scattered points lies too low.
    least = used[np.argmin(noise.for_errors.deviation(allan.tau_s[used]))]
    source = f"IEEE Std 952; averages of {allan.tau_s[least]:.4g} s"
    value, low_end, high_end = (float(column[least]) for column in (allan.deviation, low, high))
    return [*found, Figure("Allan deviation, minimum", value, "deg/h", source, low_end, high_end)]


def _known(noise: NoiseCoefficients | None) -> NoiseCoefficients:
    if noise is None:
        raise ConfigurationError(
            "the unit's noise is not known, and without it no interval",
            where="standard test",
            expected="a noise or a bias record of 10 min or more",
            remedy="record the noise",
        )
    return noise


def _errors(intervals: Sequence[Interval], noise: NoiseCoefficients | None) -> Array:
    """Return draws (m, n) in deg/h of what noise does to the means of intervals, their common level taken off."""
    start, end = (np.array([getattr(item, name) for item in intervals]) for name in ("start_s", "end_s"))
    centre = np.eye(len(start)) - 1.0 / len(start)
    return draws(centre @ covariance_of_means(start, end, _known(noise)) @ centre, DRAWS)


def _earth_dph(record: Measured, interval: Interval) -> float:
    return earth_rate_north_dph(record.latitude_deg) * math.cos(math.radians(record.azimuth_deg(interval)))


def _bias(record: Measured, noise: NoiseCoefficients | None) -> list[Figure]:
    intervals = record.needed("bias")
    cycles = [
        bias_figures(record.seconds_dph(interval), _earth_dph(record, interval), _known(noise))
        for interval in intervals
    ]
    first = cycles[0]
    found = [
        Figure.of("bias", first.bias_dph, "deg/h", _STANDARDS),
        Figure.of("bias stability, 10 s averages", first.stability_10s_dph, "deg/h", _STANDARDS),
        Figure.of("bias stability, 100 s averages", first.stability_100s_dph, "deg/h", _STANDARDS),
    ]
    if len(cycles) > 1:
        start, end = (np.array([getattr(item, name) for item in intervals]) for name in ("start_s", "end_s"))
        covariance = covariance_of_means(start, end, _known(noise))
        beyond = spread([cycle.bias_dph.value for cycle in cycles], covariance)
        source = f"{_STANDARDS}; {len(cycles)} power-ons, beyond the noise"
        found.append(Figure.of("bias repeatability", beyond, "deg/h", source))
    return found


def _warm_up(record: Measured, noise: NoiseCoefficients | None) -> list[Figure]:
    output = record.seconds_dph(record.needed("warm_up")[0])
    settled = record.needed("bias")[0]
    stability = bias_figures(record.seconds_dph(settled), _earth_dph(record, settled), _known(noise))
    tolerance = 3.0 * stability.stability_100s_dph.value
    time = warm_up_time_s(output, tolerance, _known(noise))
    return [Figure.of("warm-up time to 3 s_100", time, "s", f"IEEE Std 952; to {tolerance:.3g} deg/h")]


def alternation_weights(repeats: int) -> Array:
    """Return the weights of zero, input, zero, input, ..., zero, (2 k + 1,): each input less the zeros beside it.

    The mean over k inputs of B - (A + C) / 2, in which a steady drift drops out.
    """
    inner = np.full(2 * repeats + 1, 1.0 / repeats)
    inner[::2] *= -1.0
    inner[[0, -1]] *= 0.5
    return inner


def _small_rates(test: str, record: Measured, noise: NoiseCoefficients | None) -> list[Figure]:
    by_step: dict[float, list[Interval]] = {}
    for interval in record.needed(test):
        by_step.setdefault(interval.step or 0.0, []).append(interval)
    steps = []
    for _, rows in sorted(by_step.items()):
        whole = rows[: len(rows) - (len(rows) + 1) % 2]  # a stopped run may end with an input
        if len(whole) > 2:
            weights = alternation_weights(len(whole) // 2)
            means = np.array([record.output_dph(item).mean() for item in whole])
            error = float(np.std(_errors(whole, noise) @ weights))
            steps.append(RateStep(whole[1].input_dph or 0.0, float(weights @ means), error))
    found = threshold(steps)
    source = "IEEE Std 647, 952; smallest input shown to give 50 % of its output"
    if found.value == min(abs(step.input_dph) for step in steps):
        source += ", no smaller one was put in"
    return [Figure.of(test, found, "deg/h", source)]


def turned_over(intervals: Sequence[Interval]) -> dict[float, list[int]]:
    """Return which intervals of the misalignment test are at which turn about the axis under test, in deg.

    Turns without both senses of rotation, as a stopped run has, are left out.
    """
    found: dict[float, list[int]] = {}
    for number, row in enumerate(intervals):
        found.setdefault((row.roll_deg or 0.0) % 360.0, []).append(number)
    return {
        roll_deg: there
        for roll_deg, there in found.items()
        if len({intervals[number].rate_dps for number in there}) > 1
    }


def _misalignment(record: Measured, noise: NoiseCoefficients | None) -> list[Figure]:
    """Elevation of the input axis as first mounted, and its misalignment.

    The slope of the output over the two senses of rotation is the sine of the elevation: bias and the mean of the
    turning Earth rate drop out. Turned by 180 deg about the axis under test the unit's part of it changes its
    sign and the fixture's does not: half the difference is the unit's alone. With 90 and 270 deg it is the
    component that lay across the table at first.
    """
    intervals = record.needed("misalignment")
    rates = np.array([record.true_rate_dps(row) for row in intervals])
    outputs = np.array([record.mean_dps(row) for row in intervals])
    errors = _errors(intervals, noise) / DPH_PER_DPS
    slopes = {}
    for roll_deg, there in turned_over(intervals).items():
        slopes[roll_deg] = np.zeros(len(rates))
        slopes[roll_deg][there] = slope_weights(rates[there])
    if 0.0 not in slopes:
        raise ConfigurationError(
            "the table turned to one side only",
            where="misalignment test",
            found=", ".join(f"{row.rate_dps} deg/s" for row in intervals),
            expected="both senses of rotation",
        )

    def angle(name: str, weights: Array, source: str) -> Figure:
        sine = linear(float(weights @ outputs), errors @ weights)
        value, low, high = (
            math.degrees(math.asin(max(-1.0, min(1.0, end)))) for end in (sine.value, sine.low, sine.high)
        )
        return Figure.of(name, Estimate(value, low, high, sine.seen), "deg", source)

    source = "IEEE Std 952; fixture included"
    found = [angle(ELEVATION, slopes[0.0], source)]
    if 180.0 not in slopes:
        return [angle(MISALIGNMENT_ALONG, slopes[0.0], source), *found]
    source = f"IEEE Std 952; turned about the axis in {len(slopes)} positions"
    for name, first, turned in ((MISALIGNMENT_ALONG, 0.0, 180.0), (MISALIGNMENT_ACROSS, 90.0, 270.0)):
        if first in slopes and turned in slopes:
            found.append(angle(name, 0.5 * (slopes[first] - slopes[turned]), source))
    return found


def _scale_factor(record: Measured, noise: NoiseCoefficients | None) -> list[Figure]:
    sequences: dict[float | None, list[Interval]] = {}
    for interval in record.needed("scale_factor"):
        sequences.setdefault(interval.sequence, []).append(interval)
    figures = scale_factor_figures([_sequence(record, rows) for rows in sequences.values()], noise)
    named = [
        ("scale factor", figures.scale_factor, ""),
        ("scale-factor nonlinearity", figures.nonlinearity_ppm, "ppm"),
        ("scale-factor asymmetry", figures.asymmetry_ppm, "ppm"),
        ("scale-factor repeatability", figures.repeatability_ppm, "ppm"),
        ("scale-factor hysteresis, rising and falling", figures.hysteresis_ppm, "ppm"),
    ]
    return [Figure.of(name, value, unit, _STANDARDS) for name, value, unit in named if value is not None]


def _sequence(record: Measured, rows: Sequence[Interval]) -> RateSequence:
    columns = [
        (row.rate_dps or 0.0, record.true_rate_dps(row), record.mean_dps(row), row.start_s, row.end_s)
        for row in rows
    ]
    return RateSequence(*np.array(columns).T)


def _over_temperature(record: Measured, noise: NoiseCoefficients | None) -> list[Figure]:
    groups: dict[float | None, list[Interval]] = {}
    for interval in record.needed("temperature"):
        groups.setdefault(interval.temp_c, []).append(interval)
    errors = _errors([row for rows in groups.values() for row in rows], noise)
    bias, scale, temp, of_bias, of_scale = [], [], [], [], []
    begin = 0
    for rows in groups.values():
        rates = np.array([record.true_rate_dps(row) for row in rows])
        fit = fit_rate_sequence(rates, [record.mean_dps(row) for row in rows])
        earth_dph = earth_rate_up_dph(record.latitude_deg)
        bias.append(DPH_PER_DPS * fit.offset / fit.scale_factor - earth_dph)
        scale.append(fit.scale_factor)
        temp.append(float(np.mean([record.temp_c(row) for row in rows])))
        own = errors[:, begin : begin + len(rows)]
        begin += len(rows)
        slope = own @ slope_weights(rates)
        of_scale.append(slope / DPH_PER_DPS)
        of_bias.append((own.mean(axis=1) - slope * rates.mean()) / fit.scale_factor)
    bias_per_c = temperature_sensitivity(bias, temp, np.column_stack(of_bias))
    scale_per_c = temperature_sensitivity(scale, temp, np.column_stack(of_scale), relative=True)
    return [
        Figure.of("bias temperature sensitivity", bias_per_c, "deg/h/degC", "GJB 2426A"),
        Figure.of("scale-factor temperature sensitivity", scale_per_c.times(1e6), "ppm/degC", "GJB 2426A"),
    ]


PARTS: Mapping[str, Callable[[Measured, NoiseCoefficients | None], list[Figure]]] = {
    "bias": _bias,
    "warm-up time": _warm_up,
    "threshold": partial(_small_rates, "threshold"),
    "resolution": partial(_small_rates, "resolution"),
    "misalignment": _misalignment,
    "scale factor": _scale_factor,
    "temperature sensitivity": _over_temperature,
}
"""What a standard test measures beside the noise; each takes the unit's noise for its intervals."""
