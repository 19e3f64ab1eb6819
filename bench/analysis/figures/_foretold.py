"""What a test will be able to resolve, before it begins: its figures of units that have only their noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

from bench.analysis.common.allan_noise import NOISE_NAMES, NoiseCoefficients
from bench.analysis.common.bench_errors import BenchErrors
from bench.analysis.common.drawn_noise import noise_samples
from bench.analysis.common.mean_noise import covariance_of_means
from bench.analysis.figures._budget import with_budgets
from bench.analysis.figures._from_run import figures_of_record, standard_figures
from bench.control.procedure import Parameters, Procedure
from bench.record.benchfile import BenchFile
from bench.record.events.run import Interval
from bench.record.figure_limits import Limit
from bench.record.shown import Shown
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS, earth_rate_north_dph, earth_rate_up_dph
from drivers.base.errors import ConfigurationError

_UNITS = 15
_RATE_HZ = 1.0
_AT_DEG = {"resolution": 135.0}
_EAST_DEG = 90.0
_OWN_RATE = ("quantisation",)
"""Figures that rest on the rate at which the unit sends: records are drawn at 1 Hz."""

Intervals = Callable[[Array], Sequence[Interval]]
"""A unit's output at rest, 1 s means in deg/h (n,) -> the intervals that a test of it would have."""


@dataclass(frozen=True, repr=False)
class Foretold(Shown):
    """What a test resolves of a figure, in its unit: of so many units drawn, the median.

    `resolves`: half of the 95 % interval, or what a unit without it is "not seen above"; None where most of the
    tests do not state the figure, for `reason`.
    """

    name: str
    unit: str
    resolves: float | None
    reason: str = ""

    def shown(self) -> dict[str, object]:
        """Return what is resolved with its unit, or why nothing is."""
        return {self.name: self.reason or f"{self.text} {self.unit}".rstrip()}

    @property
    def text(self) -> str:
        """What is resolved, to two digits; empty where nothing is."""
        return "" if self.resolves is None else f"{float(f'{self.resolves:.2g}'):g}"

    def tells(self, limit: Limit) -> bool:
        """Return whether a unit in the middle of the limits, or at zero where there is one, would pass.

        Its whole 95 % interval must then lie inside (guard band w = U, JCGM 106).
        """
        if self.resolves is None:
            return False
        low, high = limit.low, limit.high
        middle = 0.0 if low is None or high is None else 0.5 * (low + high)
        least, most = middle - self.resolves, middle + self.resolves
        return (low is None or low <= least) and (high is None or most <= high)


@dataclass(frozen=True)
class _Perfect:
    """A record (see `Measured`) of a unit that has nothing but noise, on a bench without errors."""

    rows: Sequence[Interval]
    noise_dph: Array
    latitude_deg: float

    def intervals(self, test: str) -> list[Interval]:
        return [row for row in self.rows if row.test == test]

    def needed(self, test: str) -> list[Interval]:
        if found := self.intervals(test):
            return found
        raise ConfigurationError(f"the plan has no interval of {test.replace('_', ' ')}")

    def output_dph(self, interval: Interval) -> Array:
        first = math.ceil(interval.start_s * _RATE_HZ)
        count = max(1, round((interval.end_s - interval.start_s) * _RATE_HZ))
        return np.asarray(self.noise_dph[first : first + count] + self._true_dph(interval))

    def mean_dps(self, interval: Interval) -> float:
        return float(self.output_dph(interval).mean()) / DPH_PER_DPS

    def temp_c(self, interval: Interval) -> float:
        return interval.temp_c or 0.0

    def seconds_dph(self, interval: Interval) -> Array:
        return self.output_dph(interval)

    def samples_dph(self, interval: Interval) -> tuple[Array, float]:
        return self.output_dph(interval), _RATE_HZ

    def true_rate_dps(self, interval: Interval) -> float:
        return interval.rate_dps or 0.0

    def azimuth_deg(self, interval: Interval) -> float:
        return _AT_DEG.get(interval.test, _EAST_DEG)

    def _true_dph(self, interval: Interval) -> float:
        turned = DPH_PER_DPS * (interval.rate_dps or 0.0)
        if interval.test == "misalignment":
            return 0.0
        if interval.test in ("scale_factor", "temperature"):
            return turned + earth_rate_up_dph(self.latitude_deg)
        level = earth_rate_north_dph(self.latitude_deg) * math.cos(math.radians(self.azimuth_deg(interval)))
        return level + (interval.input_dph or 0.0)


@dataclass(frozen=True, repr=False)
class Outlook(Shown):
    """What a test will resolve, and how long it will take with this noise."""

    figures: tuple[Foretold, ...]
    duration_s: float

    def shown(self) -> dict[str, object]:
        """Return the duration, and each figure."""
        of_figures = {name: text for each in self.figures for name, text in each.shown().items()}
        return {"duration": f"{self.duration_s / 3600.0:.1f} h", **of_figures}


def foretell_procedure(
    procedure: Procedure, parameters: Parameters, noise: NoiseCoefficients, file: BenchFile
) -> Outlook:
    """Return what a procedure will resolve on a bench; ConfigurationError for one that plans no intervals."""
    plan = procedure.intervals
    if plan is None:
        raise ConfigurationError(
            "what this procedure resolves cannot be foretold",
            where=procedure.name,
            found="no `intervals`",
            expected="a procedure that says which intervals of measurement it has, as standard-test does",
        )
    bench = BenchErrors(tuple(file.calibration))
    return foretell(lambda at_rest: plan(parameters, at_rest), noise, file.bench.latitude_deg, bench)


def noise_named(values: Mapping[str, float | str]) -> NoiseCoefficients:
    """Return coefficients by name, those not named zero; ConfigurationError for another name, or no number.

    quantisation (deg), angle_random_walk (deg/sqrt(h)), bias_instability (deg/h), rate_random_walk
    (deg/h/sqrt(h)), rate_ramp (deg/h/h).
    """
    names = {name.rsplit("_d", 1)[0]: name for name in NOISE_NAMES}
    found = dict.fromkeys(NOISE_NAMES, 0.0)
    for name, value in values.items():
        try:
            found[names[name]] = abs(float(value))
            if not math.isfinite(found[names[name]]):
                raise ValueError(value)
        except (KeyError, ValueError) as error:
            raise ConfigurationError(
                "a coefficient that is no number" if name in names else "no such coefficient of noise",
                where="noise",
                found=f"{name}={value}",
                expected=", ".join(names),
            ) from error
    return NoiseCoefficients(**found)


def noise_like(folder: Path, gyro: str | None = None) -> NoiseCoefficients:
    """Return the noise of a unit by its standard-test run; ConfigurationError for a run that does not tell it."""
    figures = standard_figures(folder, gyro)
    if figures.noise is None:
        raise ConfigurationError(
            "this run does not tell the unit's noise",
            where=str(folder),
            found="; ".join(why for what, why in figures.missing if what == "noise"),
            expected="a noise record of half an hour or more",
        )
    return figures.noise.coefficients


def foretell(
    intervals: Intervals, noise: NoiseCoefficients, latitude_deg: float, bench: BenchErrors
) -> Outlook:
    """Return what a test will resolve of a unit with this noise, figure by figure.

    Fifteen units without any fault are drawn and go through the functions that make the figures of a run, budgets
    of the bench included. Where the plan has a search for east (`axis_east`), its doubt is that of the noise.
    ConfigurationError for a unit without any noise.
    """
    if not noise.squares().any():
        raise ConfigurationError(
            "the noise of the unit is not known",
            where="noise",
            found="all coefficients zero",
            expected="angle_random_walk=..., of its data sheet, or a standard-test run of such a unit",
        )
    values: dict[str, list[float]] = {}
    units: dict[str, str] = {}
    reasons: dict[str, str] = {}
    durations_s: list[float] = []
    before = intervals(np.zeros(0))
    if not before:
        raise ConfigurationError(
            "the test measures nothing",
            where="intervals",
            found="no interval",
            expected="one interval or more",
        )
    rest_s = round(max((row.end_s - row.start_s for row in before if row.test == "noise"), default=3600.0))
    for seed in range(_UNITS):
        rows = intervals(noise_samples(noise, rest_s, _RATE_HZ, 2 * seed))
        durations_s.append(rows[-1].end_s)
        count = math.ceil(rows[-1].end_s * _RATE_HZ) + 1
        record = _Perfect(rows, noise_samples(noise, count, _RATE_HZ, 2 * seed + 1), latitude_deg)
        figures, missing, _, _ = figures_of_record(record)
        reasons |= dict(missing)
        known = BenchErrors(bench.calibrations, _azimuth_sigma_deg(rows, noise, latitude_deg))
        for figure in with_budgets(figures, record, known):
            if figure.low is None or figure.high is None or figure.name in _OWN_RATE:
                continue
            units[figure.name] = figure.unit
            half = 0.5 * (figure.high - figure.low) if figure.seen else figure.bound
            values.setdefault(figure.name, []).append(half or 0.0)
    found = [
        Foretold(name, units[name], median(each))
        if 2 * len(each) > _UNITS
        else Foretold(name, units[name], None, reasons.get(name, "not stated in most of the tests"))
        for name, each in values.items()
    ]
    found += [Foretold(what, "", None, why) for what, why in reasons.items() if what not in values]
    return Outlook(tuple(found), median(durations_s))


def _azimuth_sigma_deg(
    rows: Sequence[Interval], noise: NoiseCoefficients, latitude_deg: float
) -> float | None:
    """Return how well the Earth rate tells east at east, west, west, east: (w + w - e - e) / 4 over its size."""
    four = [row for row in rows if row.test == "axis_east"]
    if len(four) != 4:
        return None
    weights = np.array([-0.25, 0.25, 0.25, -0.25])
    covariance = covariance_of_means([row.start_s for row in four], [row.end_s for row in four], noise)
    return math.degrees(math.sqrt(weights @ covariance @ weights) / earth_rate_north_dph(latitude_deg))
