"""All figures of a standard-test run folder, for one gyro."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.allan import AllanDeviation, allan_deviation
from bench.analysis.common.allan_noise import NOISE_NAMES, NOISE_UNITS, NoiseFit, fit_noise
from bench.analysis.figures._bias import (
    RateStep,
    bias_figures,
    repeatability,
    temperature_sensitivity,
    threshold,
    warm_up_time_s,
)
from bench.analysis.figures._scale_factor import fit_rate_sequence, scale_factor_figures
from bench.record.events.run import Interval
from bench.record.recording import Run, row_means, seconds
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS, earth_rate_north_dph, earth_rate_up_dph
from drivers.base.errors import BenchError, ConfigurationError


@dataclass(frozen=True)
class Figure:
    """One figure: unit, where its definition stands, and the interval that holds it where one is known."""

    name: str
    value: float
    unit: str
    source: str
    low: float | None = None
    high: float | None = None

    @property
    def digits(self) -> int:
        """Significant digits worth printing: a scale factor next to 1 shows parts per million."""
        return 4 if self.unit else 8


@dataclass(frozen=True)
class StandardFigures:
    """Figures of one unit. `missing`: what the record does not give, and why."""

    run_id: str
    unit_id: str
    gyro: str
    figures: tuple[Figure, ...]
    missing: tuple[tuple[str, str], ...]
    allan: AllanDeviation | None
    noise: NoiseFit | None

    def value(self, name: str) -> float:
        """Return a figure's value; raises KeyError."""
        return {figure.name: figure.value for figure in self.figures}[name]


@dataclass(frozen=True)
class _Record:
    """The intervals of a run and what the gyro and the table did in them."""

    run: Run
    gyro: str
    axis_angle_error_deg: float

    def intervals(self, test: str) -> list[Interval]:
        return [interval for _, interval in self.run.of(Interval) if interval.test == test]

    def needed(self, test: str) -> list[Interval]:
        if intervals := self.intervals(test):
            return intervals
        manifest = self.run.manifest
        raise ConfigurationError(
            f"the run has no interval of {test.replace('_', ' ')}",
            where=f"run {manifest.run_id}",
            found=manifest.outcome,
            remedy=manifest.reason or "the test was left out of the run",
        )

    def output_dph(self, interval: Interval) -> Array:
        """Valid samples of an interval, deg/h."""
        table = self._table(interval, ("rate_dps", "valid"))
        return np.asarray(3600.0 * table["rate_dps"][table["valid"].astype(np.bool_)].astype(np.float64))

    def mean_dps(self, interval: Interval) -> float:
        return float(self.output_dph(interval).mean() / 3600.0)

    def temp_c(self, interval: Interval) -> float:
        values = self._table(interval, ("temp_c",))["temp_c"].astype(np.float64)
        if not np.isfinite(values).any():
            raise ConfigurationError(
                "the unit sends no temperature",
                where=f"{interval.test}, {self.gyro}",
                expected="a stream with the unit's temperature",
                remedy="choose a message that carries it",
            )
        return float(np.nanmean(values))

    def seconds_dph(self, interval: Interval) -> Array:
        """Means over whole seconds, the few empty ones interpolated."""
        table = self._table(interval, ("time_ns", "rate_dps", "valid"))
        row = np.floor(seconds(table) - interval.start_s).astype(np.int64)
        count = math.floor(interval.end_s - interval.start_s)
        rates = DPH_PER_DPS * table["rate_dps"].astype(np.float64)
        means = row_means(rates, row, count, table["valid"].astype(np.bool_))
        empty = np.isnan(means)
        if empty.mean() > 0.01:
            raise ConfigurationError(
                "the record has gaps",
                where=f"{interval.test}, {self.gyro}",
                found=f"{int(empty.sum())} of {count} seconds without a valid sample",
                expected="fewer than 1 %",
            )
        known = np.flatnonzero(~empty)
        return np.asarray(np.interp(np.arange(count), known, means[known]))

    def true_rate_dps(self, interval: Interval) -> float:
        """Mean table rate by its encoder: angle turned over time."""
        table = self.run.turntable(("time_ns", "angle_deg", "rate_dps"), interval.start_s, interval.end_s)
        time_s = seconds(table)
        if len(time_s) < 2:
            return interval.rate_dps or 0.0
        # Between telegrams the table turns by rate * time; the encoder tells the rest of the turn.
        step_s = np.diff(time_s)
        expected = 0.5 * (table["rate_dps"][1:] + table["rate_dps"][:-1]) * step_s
        error = (np.diff(table["angle_deg"]) - expected + 180.0) % 360.0 - 180.0
        return float((expected + error).sum() / step_s.sum())

    def earth_dph(self, interval: Interval) -> float:
        """Earth rate along the horizontal axis at the table's angle."""
        angle = self.run.turntable(("angle_deg",), interval.start_s, interval.end_s)["angle_deg"]
        along = float(np.cos(np.radians(angle + self.axis_angle_error_deg)).mean())
        return earth_rate_north_dph(self.run.manifest.latitude_deg) * along

    def _table(self, interval: Interval, columns: Sequence[str]) -> dict[str, NDArray[Any]]:
        return self.run.gyro(self.gyro, columns, interval.start_s, interval.end_s)


def figures_of_unit(
    folders: Sequence[Path], gyro: str | None = None
) -> tuple[list[StandardFigures], Sequence[Figure]]:
    """Return the figures of one unit's `standard-test` runs, and those over several runs, which are power-ons."""
    results = [standard_figures(folder, gyro) for folder in folders]
    units = sorted({result.unit_id for result in results})
    if len(units) != 1:
        raise ConfigurationError(
            "one report is of one unit",
            where="standard test",
            found=", ".join(units) or "no run",
            expected="runs of one unit",
            remedy="name a gyro, or report each unit on its own",
        )
    return results, figures_over_runs(results) if len(results) > 1 else ()


def standard_figures(folder: Path, gyro: str | None = None) -> StandardFigures:
    """Return every figure that a `standard-test` run folder gives; what is missing is named, not guessed."""
    run = Run.open(folder)
    name = gyro or next(iter(run.manifest.units), "")
    if not run.of(Interval) or name not in run.manifest.units:
        raise ConfigurationError(
            "no standard test of that gyro in this run",
            where=str(folder),
            found=f"{run.manifest.procedure}, gyros {', '.join(run.manifest.units)}",
            expected=f"a standard-test run with gyro {name}",
        )
    record = _Record(run, name, run.azimuth_error_deg)
    figures: list[Figure] = []
    missing: list[tuple[str, str]] = []
    for what, part in (
        ("bias", _bias),
        ("threshold and resolution", _small_rates),
        ("misalignment", _misalignment),
        ("scale factor", _scale_factor),
        ("temperature sensitivity", _over_temperature),
    ):
        try:
            figures += part(record)
        except BenchError as error:
            missing.append((what, str(error)))
    allan = noise = None
    try:
        deviation = allan_deviation(record.seconds_dph(record.needed("noise")[0]), 1.0)
        allan, noise = deviation, fit_noise(deviation)
        figures += [
            Figure(
                name.rsplit("_d", 1)[0].replace("_", " "),
                getattr(noise.coefficients, name),
                unit,
                "IEEE Std 952, Allan variance; 95 % interval",
                getattr(noise.low, name),
                getattr(noise.high, name),
            )
            for name, unit in zip(NOISE_NAMES, NOISE_UNITS, strict=True)
        ]
    except BenchError as error:
        missing.append(("noise", str(error)))
    return StandardFigures(
        run.manifest.run_id, run.manifest.unit(name), name, tuple(figures), tuple(missing), allan, noise
    )


def figures_over_runs(runs: Iterable[StandardFigures]) -> tuple[Figure, ...]:
    """Return repeatabilities over runs of one unit, a power-on each (the standards want at least six)."""
    runs = list(runs)
    source = f"GJB 2426A, {len(runs)} power-ons"
    found = []
    for name, title, unit in (
        ("bias", "bias repeatability", "deg/h"),
        ("scale factor", "scale-factor repeatability between runs", "ppm"),
    ):
        values = np.array([run.value(name) for run in runs if any(item.name == name for item in run.figures)])
        if len(values) > 1:
            factor = 1e6 / float(values.mean()) if unit == "ppm" else 1.0
            found.append(Figure(title, repeatability(values) * factor, unit, source))
    return tuple(found)


def _bias(record: _Record) -> list[Figure]:
    warm_up = record.intervals("warm_up")
    intervals = record.needed("bias")
    source = "GJB 2426A; IEEE Std 952"
    cycles = [
        bias_figures(record.seconds_dph(interval), record.earth_dph(interval)) for interval in intervals
    ]
    first = cycles[0]
    found = [
        Figure("bias", first.bias_dph, "deg/h", source),
        Figure("bias stability, 10 s averages", first.stability_10s_dph, "deg/h", source),
        Figure("bias stability, 100 s averages", first.stability_100s_dph, "deg/h", source),
    ]
    if len(cycles) > 1:
        over = f"{source}, {len(cycles)} power-ons"
        found.append(
            Figure("bias repeatability", repeatability([cycle.bias_dph for cycle in cycles]), "deg/h", over)
        )
    if warm_up:
        time_s = warm_up_time_s(record.seconds_dph(warm_up[0]), 3.0 * first.stability_100s_dph)
        if math.isfinite(time_s):
            found.append(Figure("warm-up time to 3 s_100", time_s, "s", "IEEE Std 952"))
    return found


def _small_rates(record: _Record) -> list[Figure]:
    found = []
    for test in ("threshold", "resolution"):
        by_step: dict[float, list[Interval]] = {}
        for interval in record.needed(test):
            by_step.setdefault(interval.step or 0.0, []).append(interval)
        steps = []
        for _, (before, there, after) in sorted(by_step.items()):
            zero = 0.5 * (record.output_dph(before).mean() + record.output_dph(after).mean())
            steps.append(RateStep(there.input_dph or 0.0, float(record.output_dph(there).mean() - zero)))
        value = threshold(steps)
        source = "IEEE Std 647, 952; smallest input with 50 % of its output"
        if value == min(abs(step.input_dph) for step in steps):
            source += ", no smaller one was put in"
        found.append(Figure(test, value, "deg/h", source))
    return found


def _misalignment(record: _Record) -> list[Figure]:
    intervals = record.needed("misalignment")
    rates = np.array([record.true_rate_dps(row) for row in intervals])
    outputs = np.array([record.mean_dps(row) for row in intervals])
    # Half the difference between the two senses: bias and the mean of the turning Earth rate drop out.
    sine = float(np.ptp(outputs) / np.ptp(rates))
    angle = math.degrees(math.asin(min(1.0, sine)))
    return [Figure("input-axis misalignment, component along the table", angle, "deg", "IEEE Std 952")]


def _scale_factor(record: _Record) -> list[Figure]:
    sequences: dict[float | None, list[Interval]] = {}
    for interval in record.needed("scale_factor"):
        sequences.setdefault(interval.sequence, []).append(interval)
    pairs = [
        ([record.true_rate_dps(row) for row in rows], [record.mean_dps(row) for row in rows])
        for rows in sequences.values()
    ]
    figures = scale_factor_figures(pairs)
    source = "IEEE Std 952; GJB 2426A"
    named = [
        ("scale factor", figures.scale_factor, ""),
        ("scale-factor nonlinearity", figures.nonlinearity_ppm, "ppm"),
        ("scale-factor asymmetry", figures.asymmetry_ppm, "ppm"),
        ("scale-factor repeatability", figures.repeatability_ppm, "ppm"),
        ("scale-factor hysteresis, rising and falling", figures.hysteresis_ppm, "ppm"),
    ]
    return [Figure(name, value, unit, source) for name, value, unit in named if value is not None]


def _over_temperature(record: _Record) -> list[Figure]:
    groups: dict[float | None, list[Interval]] = {}
    for interval in record.needed("temperature"):
        groups.setdefault(interval.temp_c, []).append(interval)
    bias, scale, temp = [], [], []
    for rows in groups.values():
        rates = [record.true_rate_dps(row) for row in rows]
        fit = fit_rate_sequence(rates, [record.mean_dps(row) for row in rows])
        earth_dph = earth_rate_up_dph(record.run.manifest.latitude_deg)
        bias.append(3600.0 * fit.offset / fit.scale_factor - earth_dph)
        scale.append(fit.scale_factor)
        temp.append(float(np.mean([record.temp_c(row) for row in rows])))
    of_bias, of_scale = (
        temperature_sensitivity(bias, temp),
        temperature_sensitivity(scale, temp, relative=True),
    )
    return [
        Figure("bias temperature sensitivity", of_bias, "deg/h/degC", "GJB 2426A"),
        Figure("scale-factor temperature sensitivity", 1e6 * of_scale, "ppm/degC", "GJB 2426A"),
    ]
