"""What a standard test certifies perfect units with, and how often its intervals hold the truth of others.

`python -m benchmarks metrology` simulates units of three grades by closed forms of their own: white noise,
quantisation and flicker shaped in the spectrum, a cubic and an asymmetric scale factor, hysteresis, a dead zone,
an exponential warm-up, a bias that differs between power-ons and with temperature. The figures are made by the
functions that make those of a run folder, on the same intervals. A perfect unit has its noise and nothing else.
Truth is worked out from what was put in, never by those functions. `python -m benchmarks.metrology UNITS` takes
another number of units and writes the tables of docs/uncertainty.md.
"""

from __future__ import annotations

import math
import sys
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from copy import copy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import beta

from bench.analysis.common.allan_noise import NOISE_NAMES, NoiseCoefficients
from bench.analysis.common.bench_errors import BenchErrors
from bench.analysis.figures import Figure
from bench.analysis.figures._budget import with_budgets
from bench.analysis.figures._from_run import figures_of_record
from bench.record.benchfile import Calibration
from bench.record.events.run import Interval
from bench.record.figure_limits import Decision
from benchmarks._measure import Row, figure, usual
from benchmarks.allan import simulate
from drivers.base.arrays import Array
from drivers.base.constants import EARTH_RATE_DPH
from procedures._by_noise import AtRest
from procedures._standard_plan import STEPS, Plan, StandardTestParameters

UNITS, QUICK_UNITS = 100, 10
LATITUDE_DEG = 39.1
NORTH_DPH = EARTH_RATE_DPH * math.cos(math.radians(LATITUDE_DEG))
UP_DPH = EARTH_RATE_DPH * math.sin(math.radians(LATITUDE_DEG))
TEMPERATURES_C = (25.0, -40.0, 60.0)
FULL_SCALE_DPS = 20.0
MISALIGNMENT = "input-axis misalignment, component along the table"
ACROSS = "input-axis misalignment, component across the table"
ELEVATION = "input-axis elevation, unit in its fixture"
POSITIONS = {"both": (0.0, 180.0, 90.0, 270.0), "as_mounted": (0.0,)}
HYSTERESIS = "scale-factor hysteresis, rising and falling"


@dataclass(frozen=True)
class Faults:
    """What an imperfect unit has beside noise; ppm of the scale factor or of full scale, deg/h, s."""

    sf_ppm: float = 0.0
    cubic_ppm: float = 0.0
    asymmetry_ppm: float = 0.0
    hysteresis_ppm: float = 0.0
    sf_spread_ppm: float = 0.0
    bias_dph: float = 0.0
    bias_spread_dph: float = 0.0
    warm_up_dph: float = 0.0
    warm_up_s: float = 1.0
    dead_zone_dph: float = 0.0
    misalignment_deg: float = 0.0
    across_deg: float = 0.0
    bias_dph_per_c: float = 0.0
    sf_ppm_per_c: float = 0.0


@dataclass(frozen=True)
class Grade:
    """A class of units: noise, what the plan of its grade measures, and faults of the size of its class."""

    name: str
    noise: NoiseCoefficients
    rate_hz: float
    faults: Faults


GRADES = (
    Grade("MEMS", NoiseCoefficients(0.0, 0.2, 4.0, 0.0, 0.0), 1.0,
          Faults(300.0, 150.0, 200.0, 60.0, 40.0, 30.0, 6.0, 150.0, 150.0, 20.0, 0.2, 0.2, 3.0, 30.0)),
    Grade("FOG", NoiseCoefficients(0.0, 0.004, 0.006, 0.0, 0.0), 1.0,
          Faults(50.0, 20.0, 15.0, 6.0, 4.0, 0.05, 0.01, 0.5, 600.0, 0.1, 0.02, 0.02, 1e-3, 1.0)),
    Grade("RLG", NoiseCoefficients(2.4e-5, 2e-4, 8e-4, 0.0, 0.0), 4.0,
          Faults(4.0, 1.5, 0.6, 0.3, 0.3, 0.004, 0.002, 0.02, 800.0, 0.02, 0.002, 0.002, 2e-4, 0.08)),
)  # fmt: skip
PERFECT = Faults()
_OF_BENCH = (
    ("time_base_ppm", 0.5, "normal"),
    ("table_rate_ppm", 0.3, "rectangular"),
    ("table_angle_deg", 3e-4, "rectangular"),
    ("table_level_deg", 0.002, "normal"),
    ("table_wobble_deg", 5e-4, "rectangular"),
    ("azimuth_deg", 0.01, "rectangular"),
    ("fixture_deg", 0.005, "rectangular"),
    ("fixture_seat_deg", 0.001, "rectangular"),
    ("latitude_deg", 0.001, "rectangular"),
    ("unit_temp_c", 0.5, "normal"),
)


def certificate(quantity: str, uncertainty: float, distribution: str, error: float = 0.0) -> Calibration:
    """Return a certificate of the simulated bench."""
    text = {"instrument": "simulated", "certificate": "drawn", "date": "2026-01-01", "due": "2027-01-01"}
    facts = {"quantity": quantity, "error": error, "uncertainty": uncertainty, "distribution": distribution}
    return Calibration.model_validate(text | facts)


BENCH = tuple(certificate(*row) for row in _OF_BENCH)
"""Certificates of the simulated bench: U with k = 2, or half widths; its errors are drawn from them."""


def bench_errors(rng: np.random.Generator) -> dict[str, float]:
    """Return the errors of a bench that keeps what its certificates say."""
    return {
        item.quantity: item.standard_uncertainty
        * float(rng.standard_normal() if item.distribution == "normal" else rng.uniform(-(3**0.5), 3**0.5))
        for item in BENCH
    }


@dataclass
class Unit:
    """A simulated standard test: what `Measured` asks for, from noise and faults instead of a run folder."""

    grade: Grade
    faults: Faults
    seed: int
    bench: Mapping[str, float] = field(default_factory=dict)
    rows: list[Interval] = field(default_factory=list)
    misalignment: Literal["both", "as_mounted"] = "both"

    def __post_init__(self) -> None:
        """Lay out the intervals of the procedure's plan by the unit's noise, draw power-ons and noise."""
        grade = self.grade
        rng = np.random.default_rng((self.seed, zlib.crc32(grade.name.encode())))
        q, n, b, k, r = (float(getattr(grade.noise, name)) for name in NOISE_NAMES)
        before = Plan.of(
            StandardTestParameters(
                grade=cast(Any, grade.name.lower()),
                max_rate_dps=FULL_SCALE_DPS,
                misalignment=self.misalignment,
            )
        )
        at_rest = simulate(rng, round(3600.0 * before.grade.noise_h), (q, n, b, k, r))
        plan = before.after({"unit": AtRest.of_means(at_rest)})
        self.rows = plan.intervals()
        self.inputs = plan.inputs
        self.power_ons_dph = self.faults.bias_spread_dph * rng.standard_normal(plan.grade.power_cycles + 1)
        rolls, root = POSITIONS[self.misalignment], 3**0.5
        self._shares = (
            rng.standard_normal(len(TEMPERATURES_C)),
            rng.uniform(-root, root, (2, STEPS, 2)),
            rng.standard_normal(2),
            rng.uniform(-root, root, len(rolls)),
        )
        self.set_errors()
        self.sequence_ppm = self.faults.sf_spread_ppm * rng.standard_normal(plan.sequences)
        # a transform of another length is slow
        count = 1 << (math.ceil(self.rows[-1].end_s * grade.rate_hz) + 1).bit_length()
        self.fast = simulate(rng, count, (q, n, 0.0, 0.0, 0.0), grade.rate_hz)
        self.slow = simulate(rng, count, (0.0, 0.0, b, k, r), grade.rate_hz)

    def set_errors(self) -> None:
        """Give the errors that scatter within a test the sizes that they have on the bench."""
        errors = {item.quantity: item.standard_uncertainty for item in BENCH if item.quantity in self.bench}
        of_temps, of_angles, off_table, of_seats = self._shares
        spread_c = errors.get("unit_temp_c", 0.0)
        self.of_temps_c: dict[float, float] = dict(
            zip(TEMPERATURES_C, (spread_c * of_temps).tolist(), strict=True)
        )
        self.of_angles_deg = errors.get("table_angle_deg", 0.0) * of_angles
        parts = [errors.get(name, 0.0) for name in ("fixture_deg", "table_wobble_deg")]
        own = np.array([self.faults.misalignment_deg, self.faults.across_deg])
        self.off_table_deg = own + math.hypot(*parts) * off_table
        rolls = POSITIONS[self.misalignment]
        # of a single seat the fixture's error has it
        seats = errors.get("fixture_seat_deg", 0.0) * of_seats * (len(rolls) > 1)
        self.seats_deg = dict(zip(rolls, seats.tolist(), strict=True))

    def on(self, bench: Mapping[str, float]) -> Unit:
        """Return the same unit with the same noise, tested on a bench with other errors."""
        other = copy(self)
        other.bench = bench
        other.set_errors()
        return other

    @property
    def latitude_deg(self) -> float:
        return LATITUDE_DEG + self.error("latitude_deg")

    def error(self, quantity: str) -> float:
        """Return what an instrument of the bench shows less what is true."""
        return self.bench.get(quantity, 0.0)

    def intervals(self, test: str) -> list[Interval]:
        return [row for row in self.rows if row.test == test]

    def needed(self, test: str) -> list[Interval]:
        return self.intervals(test)

    def output_dph(self, interval: Interval) -> Array:
        part = self.part(interval)
        output = self.fast[part] + self.slow[part] + self.systematic_dph(interval)
        if interval.test == "warm_up":
            output = output + self.transient_dph(np.arange(len(output)) / self.grade.rate_hz)
        return np.asarray(output)

    def samples_dph(self, interval: Interval) -> tuple[Array, float]:
        return self.output_dph(interval), self.grade.rate_hz

    def seconds_dph(self, interval: Interval) -> Array:
        samples = self.output_dph(interval)
        return np.asarray(samples.reshape(-1, round(self.grade.rate_hz)).mean(axis=1))

    def mean_dps(self, interval: Interval) -> float:
        return float(self.output_dph(interval).mean()) / 3600.0

    def temp_c(self, interval: Interval) -> float:
        return (interval.temp_c or 0.0) + float(self.of_temps_c.get(interval.temp_c or 0.0, 0.0))

    def true_rate_dps(self, interval: Interval) -> float:
        faster = 1.0 + 1e-6 * self.error("table_rate_ppm")
        return (interval.rate_dps or 0.0) * faster / (1.0 + 1e-6 * self.error("time_base_ppm"))

    def azimuth_deg(self, interval: Interval) -> float:
        return 135.0 if interval.test == "resolution" else 90.0

    def part(self, interval: Interval) -> slice:
        """Return the samples of an interval."""
        begin = math.ceil(interval.start_s * self.grade.rate_hz)
        return slice(begin, begin + round((interval.end_s - interval.start_s) * self.grade.rate_hz))

    def transient_dph(self, time_s: Array) -> Array:
        """Return the warm-up."""
        return np.asarray(self.faults.warm_up_dph * np.exp(-time_s / self.faults.warm_up_s))

    def systematic_dph(self, interval: Interval) -> float:
        """Return the output without noise and warm-up."""
        f, rate = self.faults, interval.rate_dps or 0.0
        lies = math.radians(self.elevation_deg(interval.roll_deg or 0.0))
        if interval.test == "misalignment":
            return 3600.0 * rate * math.sin(lies)
        lies += math.radians(self.error("table_level_deg"))
        azimuth = math.radians(self.azimuth_deg(interval) - self.error("azimuth_deg"))
        earth_dph = NORTH_DPH * math.cos(azimuth) * math.cos(lies) + UP_DPH * math.sin(lies)
        if interval.test in ("threshold", "resolution"):
            return earth_dph + f.bias_dph + self.small_dph(interval)
        if interval.test == "scale_factor":
            return 3600.0 * float(self.rates_dps(interval.sequence or 1)[self._place(interval)])
        if interval.test == "temperature":
            warmer = (interval.temp_c or 0.0) - TEMPERATURES_C[0]
            return 3600.0 * rate * (1.0 + 1e-6 * (f.sf_ppm + f.sf_ppm_per_c * warmer)) + (
                UP_DPH + f.bias_dph + f.bias_dph_per_c * warmer
            )
        cycle = int(interval.cycle or 0) if interval.test == "bias" else 0
        colder = f.bias_dph_per_c * self.error("unit_temp_c")
        return earth_dph + f.bias_dph - colder + float(self.power_ons_dph[cycle])

    def elevation_deg(self, roll_deg: float) -> float:
        """Return how far the input axis is raised, the unit turned about it in its fixture."""
        turned = math.radians(roll_deg)
        of_unit = self.faults.misalignment_deg * math.cos(turned) + self.faults.across_deg * math.sin(turned)
        return float(of_unit + self.error("fixture_deg") + self.seats_deg[roll_deg])

    def small_dph(self, interval: Interval) -> float:
        """Return what a unit with a dead zone gives of a small turn whose angles have errors."""
        if not interval.input_dph:
            return 0.0
        azimuth = math.radians(self.azimuth_deg(interval))
        off = azimuth - math.radians(self.error("azimuth_deg"))
        shown = math.cos(math.radians(self.latitude_deg)) * math.sin(azimuth)
        size = interval.input_dph * math.cos(math.radians(LATITUDE_DEG)) * math.sin(off) / shown
        angles = self.of_angles_deg[int(interval.test == "resolution"), int(interval.step or 0)]
        size -= NORTH_DPH * math.sin(off) * math.radians(float(angles[1] - angles[0]))
        return size if abs(size) >= self.faults.dead_zone_dph else 0.0

    def _place(self, interval: Interval) -> int:
        same = [row for row in self.intervals("scale_factor") if row.sequence == interval.sequence]
        return same.index(interval)

    def rates_dps(self, sequence: float, *, alone: bool = False) -> Array:
        """Return the outputs of one rate sequence without noise, deg/s; `alone`: without the bench's errors."""
        f = self.faults
        rates = np.array([row.rate_dps for row in self.intervals("scale_factor") if row.sequence == sequence])
        share = rates / FULL_SCALE_DPS
        sense = np.sign(np.diff(rates, prepend=rates[0]))
        of_bench = f.sf_ppm_per_c * self.error("unit_temp_c") + 0.5e6 * np.sum(
            np.radians(self.off_table_deg) ** 2
        )
        ppm = (
            f.sf_ppm
            + self.sequence_ppm[int(sequence) - 1]
            - (0.0 if alone else float(of_bench))
            + 0.5 * f.asymmetry_ppm * np.sign(rates)
        )
        shape = f.cubic_ppm * share**3 - 0.5 * f.hysteresis_ppm * sense * (1.0 - share**2)
        return np.asarray(rates * (1.0 + 1e-6 * ppm) + 1e-6 * FULL_SCALE_DPS * shape + UP_DPH / 3600.0)


def length_s(unit: Unit, test: str) -> float:
    """Return the length of a test's first interval."""
    first = unit.intervals(test)[0]
    return first.end_s - first.start_s


def truth(unit: Unit, tolerance_dph: float) -> dict[str, float]:
    """Return what the figures should be, by what was put in; `tolerance_dph`: the band of the warm-up."""
    f, first = unit.faults, unit.intervals("bias")[0]
    rates = np.array([row.rate_dps for row in unit.intervals("scale_factor") if row.sequence == 1])
    sequences = sorted({row.sequence or 0.0 for row in unit.intervals("scale_factor")})
    outputs = [unit.rates_dps(sequence, alone=True) for sequence in sequences]
    slopes = [np.polyfit(rates, out, 1)[0] for out in outputs]
    left = np.mean([out - np.polyval(np.polyfit(rates, out, 1), rates) for out in outputs], axis=0)
    at_rate = [left[rates == rate].mean() for rate in np.unique(rates)]
    sense = np.diff(rates, prepend=rates[0])
    falling = [
        left[(rates == rate) & (sense < 0)].mean() - left[(rates == rate) & (sense > 0)].mean()
        for rate in np.unique(rates)
        if (sense[rates == rate] < 0).any() and (sense[rates == rate] > 0).any()
    ]
    sides = [
        np.polyfit(rates[rates >= 0], out[rates >= 0], 1)[0]
        - np.polyfit(rates[rates <= 0], out[rates <= 0], 1)[0]
        for out in outputs
    ]
    ppm, full_ppm = 1e6 / np.mean(slopes), 1e6 / np.mean(slopes) / FULL_SCALE_DPS
    time_s = np.arange(length_s(unit, "warm_up"))
    course = unit.transient_dph(time_s)
    course = course - course[-len(course) // 4 :].mean()
    outside = time_s[np.abs(course) > tolerance_dph]
    hot = np.array([1.0 + 1e-6 * (f.sf_ppm + f.sf_ppm_per_c * (t - 25.0)) for t in TEMPERATURES_C])
    noise = unit.grade.noise
    taus_h = 2.0 ** np.arange(30) / unit.grade.rate_hz / 3600.0
    taus_h = taus_h[taus_h <= 0.1 * length_s(unit, "noise") / 3600.0]
    return {
        "bias": f.bias_dph + float(unit.power_ons_dph[0] + unit.slow[unit.part(first)].mean()),
        "bias repeatability": f.bias_spread_dph,
        "warm-up time to 3 s_100": float(outside[-1]) if len(outside) else 0.0,
        "threshold": f.dead_zone_dph,
        "resolution": f.dead_zone_dph,
        MISALIGNMENT: f.misalignment_deg,
        ACROSS: f.across_deg,
        ELEVATION: unit.elevation_deg(0.0),
        "scale factor": float(np.mean(slopes)),
        "scale-factor nonlinearity": float(full_ppm * np.abs(at_rate).max()),
        "scale-factor asymmetry": float(ppm * np.mean(sides)),
        "scale-factor repeatability": f.sf_spread_ppm,
        HYSTERESIS: float(full_ppm * falling[int(np.argmax(np.abs(falling)))]),
        "bias temperature sensitivity": abs(f.bias_dph_per_c),
        "scale-factor temperature sensitivity": float(
            max(abs(1e6 * (hot[1:] / hot[0] - 1.0) / (np.array(TEMPERATURES_C[1:]) - 25.0)))
        ),
        "angle random walk": noise.angle_random_walk_deg_sqrt_h,
        "bias instability": noise.bias_instability_dph,
        "quantisation": noise.quantisation_deg,
        "rate random walk": noise.rate_random_walk_dph_sqrt_h,
        "rate ramp": noise.rate_ramp_dph_h,
        "Allan deviation, minimum": float(_allan_deviation(noise, taus_h).min()),
    }


def _allan_deviation(noise: NoiseCoefficients, tau_h: ArrayLike) -> Array:
    """IEEE Std 952: 3 Q^2/tau^2 + N^2/tau + 2 ln2/pi B^2 + K^2 tau/3 + R^2 tau^2/2."""
    tau = np.asarray(tau_h, dtype=np.float64)
    q, n, b, k, r = (float(getattr(noise, name)) for name in NOISE_NAMES)
    fast = 3.0 * q**2 / tau**2 + n**2 / tau + 2.0 * math.log(2.0) / math.pi * b**2
    return np.asarray(np.sqrt(fast + k**2 * tau / 3.0 + r**2 * tau**2 / 2.0))


def drawn(grade: Grade, seed: int) -> Faults:
    """Return faults of the size of a grade: a tenth to all of it, of either sign where it has one."""
    rng = np.random.default_rng((seed, 9, zlib.crc32(grade.name.encode())))
    signed = {"sf_ppm", "cubic_ppm", "asymmetry_ppm", "hysteresis_ppm", "bias_dph", "warm_up_dph",
              "misalignment_deg", "across_deg", "bias_dph_per_c", "sf_ppm_per_c"}  # fmt: skip
    values = {}
    for name in Faults.__dataclass_fields__:
        size = getattr(grade.faults, name) * rng.uniform(0.1, 1.0)
        values[name] = size * (rng.choice((-1.0, 1.0)) if name in signed else 1.0)
    return Faults(**{**values, "warm_up_s": grade.faults.warm_up_s})


def measured(grade: Grade, seed: int, perfect: bool) -> tuple[dict[str, Figure], dict[str, float]]:
    """Return the figures of a unit and the truth behind them."""
    errors = bench_errors(np.random.default_rng((seed, 7, perfect)))
    unit = Unit(grade, PERFECT if perfect else drawn(grade, seed), 2 * seed + perfect, errors)
    found = with_budgets(figures_of_record(unit)[0], unit, BenchErrors(BENCH))
    figures = {item.name: item for item in found}
    return figures, truth(unit, 3.0 * figures["bias stability, 100 s averages"].value)


@dataclass
class Tally:
    """A figure of a grade: of how many units it was stated and seen, how often it held, its bounds."""

    units: int = 0
    stated: int = 0
    seen: int = 0
    held: int = 0
    values: list[float] = field(default_factory=list)
    bounds: list[float] = field(default_factory=list)
    passed: Counter[str] = field(default_factory=Counter)
    """By rule: how often the unit passed an upper limit that lay exactly at its true value."""

    def add(self, item: Figure | None, true: float) -> None:
        """Count a unit; a stability's truth is not known from one unit."""
        self.units += 1
        if item is None or item.low is None or item.high is None:
            return
        self.stated += 1
        self.seen += item.seen
        self.held += item.low <= true <= item.high
        self.values.append(item.value)
        if item.bound is not None:
            self.bounds.append(item.bound)
        standard = None if item.budget is None else item.budget.combined
        for title, rule in RULES.items():
            self.passed[title] += (
                rule.judge(item.value, (item.low, item.high), None, true, standard) == "pass"
            )


RULES = {
    "simple acceptance": Decision(),
    "guard band": Decision(rule="guard band"),
    "false acceptance, risk 0.05": Decision(rule="false acceptance", risk=0.05),
}
_JUDGED = ("bias", "scale factor", MISALIGNMENT, "scale-factor asymmetry")
"""Figures of either sign, for which a limit at the true value means something."""
STABILITIES = ("bias stability, 10 s averages", "bias stability, 100 s averages")


def tallies(grade: Grade, units: int, perfect: bool) -> dict[str, Tally]:
    """Return the tally of every figure of so many units.

    The truth of a bias stability, a figure of noise, is the root mean square over all of them.
    """
    found = [measured(grade, seed, perfect) for seed in range(units)]
    for name in STABILITIES:
        mean = math.sqrt(np.mean([figures[name].value ** 2 for figures, _ in found]))
        for _, true in found:
            true[name] = mean
    table: dict[str, Tally] = {}
    for figures, true in found:
        for name, value in true.items():
            table.setdefault(name, Tally()).add(figures.get(name), value)
    return table


def rows() -> Iterator[Row]:
    """Yield for each grade the lowest coverage of an interval, and what perfect units are certified with."""
    units = usual(UNITS, QUICK_UNITS)
    for grade in GRADES:
        good, bad = (tallies(grade, units, perfect) for perfect in (True, False))
        worst = min(bad, key=lambda name: _share(bad[name]))
        yield figure(
            f"{grade.name}, {units} imperfect units: lowest coverage, {worst}",
            100.0 * _share(bad[worst]), 93.0, "aim: at least", "%",
        )  # fmt: skip
        shown = {name: good[name].seen / max(good[name].stated, 1) for name in ZERO_WHEN_PERFECT}
        most = max(shown, key=lambda name: shown[name])
        yield figure(
            f"{grade.name}, {units} perfect units: most often certified with {most}",
            100.0 * shown[most], 5.0, "aim: at most", "%", least=True,
        )  # fmt: skip


ZERO_WHEN_PERFECT = (
    "bias repeatability", "warm-up time to 3 s_100", "threshold", "resolution", MISALIGNMENT, ACROSS,
    "scale-factor nonlinearity", "scale-factor asymmetry", "scale-factor repeatability", HYSTERESIS,
    "bias temperature sensitivity", "scale-factor temperature sensitivity",
)  # fmt: skip
"""Figures that a unit with nothing but its noise does not have."""


def _share(tally: Tally) -> float:
    return tally.held / tally.stated if tally.stated else math.nan


def section(grade: Grade, good: Mapping[str, Tally], bad: Mapping[str, Tally]) -> str:
    """Return the tables of a grade for docs/uncertainty.md."""
    text = [
        f"### {grade.name}\n",
        "| figure | imperfect: stated, seen | held, 95 % interval | perfect: stated, seen | held, 95 % interval "
        "| not seen above, median |",
        "|---|---|---|---|---|---|",
    ]
    for name, other in bad.items():
        own = good[name]
        bound = f"{np.median(own.bounds):.3g}" if own.bounds else ""
        cells = (f"{t.stated} of {t.units}, {t.seen} | {_of(t.held, t.stated)}" for t in (other, own))
        text.append(f"| {name} | {' | '.join(cells)} | {bound} |")
    text += [f"\n| passed with a true value on the limit, {grade.name} | " + " | ".join(RULES) + " |"]
    text += ["|---|" + "---|" * len(RULES)]
    for name in _JUDGED:
        tallied = (good[name], bad[name])
        stated = sum(tally.stated for tally in tallied)
        cells = (_of(sum(tally.passed[rule] for tally in tallied), stated) for rule in RULES)
        text.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(text) + "\n"


def _of(count: int, number: int) -> str:
    """Return a share with its 95 % interval by Clopper and Pearson, in percent."""
    if number == 0:
        return ""
    low = beta.ppf(0.025, count, number - count + 1) if count else 0.0
    high = beta.ppf(0.975, count + 1, number - count) if count < number else 1.0
    return f"{100 * count / number:.1f} % ({100 * low:.0f} to {100 * high:.0f})"


_BEGIN, _END = "### MEMS\n", "\n## What switching"


def write(path: Path, units: int) -> None:
    """Put the tables of so many units of each grade, imperfect and perfect, into docs/uncertainty.md."""
    sections = [section(grade, tallies(grade, units, True), tallies(grade, units, False)) for grade in GRADES]
    text = path.read_text(encoding="utf-8")
    before, _, rest = text.partition(_BEGIN)
    path.write_text(before + "\n".join(sections) + _END + rest.partition(_END)[2], encoding="utf-8")


if __name__ == "__main__":
    write(Path("docs/uncertainty.md"), int(sys.argv[1]) if len(sys.argv) > 1 else UNITS)
