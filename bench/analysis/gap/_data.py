"""A run as the diagnosis sees it: the stimulus, the gyro's output, phases; runs grouped by profile."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._findings import refuse_several_units
from bench.analysis.gap._noise import Noise
from bench.analysis.gap._rounding_noise import RoundingNoise
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.effects import REFERENCE_C, Stimulus

if TYPE_CHECKING:
    from bench.analysis.gap._fast_spectrum import FastSpectrum
    from bench.analysis.gap._simulation import Simulation

T = TypeVar("T")
_COPY, _LESS = 0.8, 0.7
"""Correlation of repeats' changes from which they may be copies; part of a run's noise that their difference has
then: of two with noise of their own it has 1.4 times as much."""
_ORDER = 8
"""Of the differences: a swing of ten samples, some hundred times as large as noise, is less than it in them."""
_OF_REPEATS, _OF_CONDITIONS = 0.5, 0.9
"""Least part of the longest that a repeat, or another condition, must last to be cut to one length with it."""
MOST_MISSING = 0.6
"""Part of a run's samples that may be missing."""
SIGMA_OF_SECOND_DIFFERENCES = 1.4826 / math.sqrt(6.0)
"""Standard deviation of white noise over the median size of its second differences."""
SHORTEST = 64
"""Samples below which a run has no time scales worth separating."""


@dataclass(frozen=True)
class GapRun:
    """One stretch at constant mounting: `output_dph` (n,) with NaN where samples are missing.

    `profile` is the same for runs that went through the same temperatures; `condition` names what differs
    between them (a rate such as "+20" or an orientation). `phase` (n,) holds each sample's phase. `finest_arcsec`
    is the finest step of angle between the rows of the log that the samples are means of, NaN where not known.
    `rows_dps` (rows,), `row_s` apart: those rows, NaN where missing, of a log whose rows are even and finer.
    `simulated`: what a user's own simulation foretold is taken off, and the input rate put in its place.
    `fast`: the spectra of its rows by phase, empty where they are no finer than the samples. `remarks`: what was
    set right in its log. `unknown_dph`: rms of an input rate that nobody knows and that is another after each
    `unknown_time_s`: Earth's, of a unit turned by hand. `power_on_told`: whether the time since power-on is
    known. `rounding_noise`: of its log's stamps and of the angle's codes, None where both are exact.
    `table_rows`: times from the run's start and the table's angle, (m,) each, of a log finer than the samples.
    """

    run_id: str
    unit_id: str
    profile: str
    condition: str
    stimulus: Stimulus
    output_dph: Array
    phase: NDArray[np.str_]
    checksum: str = ""
    lost_fraction: float = 0.0
    finest_arcsec: float = math.nan
    simulated: bool = False
    rows_dps: Array | None = None
    row_s: float = math.nan
    remarks: tuple[str, ...] = ()
    fast: tuple[FastSpectrum, ...] = ()
    unknown_dph: float = 0.0
    unknown_time_s: float = 0.0
    power_on_told: bool = True
    rounding_noise: RoundingNoise | None = None
    table_rows: tuple[Array, Array] | None = None

    @property
    def code_arcsec(self) -> float:
        """Step of the table's angle as it is logged, along the axis, 0 where none is seen."""
        if self.rounding_noise is None:
            return 0.0
        along = np.abs(np.sin(np.radians(self.stimulus.elevation_deg)))
        return float(3600.0 * math.sqrt(12.0) * self.rounding_noise.sigma_deg.max() * along.max())

    @property
    def reads_codes(self) -> NDArray[np.bool_]:
        """Samples, (n,), in which the table's angle is read in codes and does not rest."""
        if self.rounding_noise is None:
            return np.zeros(len(self.stimulus), np.bool_)
        return self.rounding_noise.reads(self.stimulus)

    @cached_property
    def missing(self) -> NDArray[np.bool_]:
        """Which samples of the output are missing, (n,)."""
        return np.isnan(self.output_dph)


def beside(simulation: Simulation | None, runs: Sequence[T]) -> list[T | GapRun]:
    """Return runs with what a simulation foretells in the place of the input rate, other signals as they are."""
    if simulation is None:
        return list(runs)
    return [_beside(simulation, run) if isinstance(run, GapRun) else run for run in runs]


def _beside(simulation: Simulation, run: GapRun) -> GapRun:
    if run.simulated:
        return run
    foretold = simulation.foretold_dph(run.stimulus, run.run_id)
    return replace(run, output_dph=run.output_dph - foretold + run.stimulus.input_rate_dph, simulated=True)


def long_enough(runs: Sequence[GapRun]) -> tuple[list[GapRun], list[str]]:
    """Return the runs but those that were aborted too early, and which these are; all if none is long enough."""
    kept = [run for run in runs if len(run.stimulus) >= SHORTEST]
    if not kept:
        return list(runs), []
    return kept, [
        f"{run.run_id}: left out, it has {len(run.stimulus)} samples and {SHORTEST} are needed"
        for run in runs
        if len(run.stimulus) < SHORTEST
    ]


def check_runs(runs: Sequence[GapRun]) -> None:
    """Raise ConfigurationError for runs that one diagnosis cannot take together."""
    if not runs:
        raise ConfigurationError("no runs to diagnose", expected="at least one run")
    refuse_several_units(run.unit_id for run in runs)
    for run in runs:
        _check_run(run)
    quietest: dict[float, float] = {}
    for run in runs:
        if scatter := _scatter(run.output_dph - run.stimulus.input_rate_dph):
            period_s = run.stimulus.period_s
            quietest[period_s] = min(scatter, quietest.get(period_s, scatter))
    for group in group_runs(runs):
        for repeats in group.runs:
            _check_copies(repeats, quietest.get(repeats[0].stimulus.period_s, 0.0))


def _scatter(error_dph: Array) -> float:
    """Return the median size of high differences, which slow things hardly move; 0 where none is known."""
    sizes = np.abs(np.diff(error_dph, _ORDER))
    known = sizes[np.isfinite(sizes)]
    return float(np.median(known)) if len(known) else 0.0


def _check_copies(repeats: Sequence[GapRun], quietest: float) -> None:
    """Raise ConfigurationError for repeats with the same noise: their differences would be no floor.

    A large ripple that repeats share makes their changes alike, too, and leaves the noise of both in their
    difference: at least as much as the `quietest` run of their period has.
    """
    # signs, so that a few large steps of rate, which repeats share, do not count for more than noise
    errors = [run.output_dph - run.stimulus.input_rate_dph for run in repeats]
    steps = [np.sign(np.nan_to_num(np.diff(error, _ORDER))) for error in errors]
    for index, (run, step) in enumerate(zip(repeats, steps, strict=True)):
        for at, (other, theirs) in enumerate(zip(repeats[:index], steps[:index], strict=True)):
            together = float(step @ theirs) / max(
                float(np.linalg.norm(step) * np.linalg.norm(theirs)), 1e-300
            )
            alike = together > _COPY and _scatter(errors[index] - errors[at]) <= _LESS * quietest
            if run.run_id == other.run_id or alike:
                raise ConfigurationError(
                    "two runs hold the same samples",
                    where=f"{other.run_id}, {run.run_id}",
                    found=f"sample-to-sample changes correlated by {together:.2f}",
                    expected="repeats with noise of their own",
                    remedy="leave one out; an emulated lab repeats itself with the same seed",
                )


def _check_run(run: GapRun) -> None:
    s = run.stimulus
    finite = all(np.isfinite(each).all() for each in (s.t_in_c, s.t_out_c, s.angle_deg, s.elevation_deg))
    if len(s) != len(run.output_dph) or len(s.angle_deg) != len(s) + 1 or len(run.phase) != len(s):
        raise ConfigurationError("the arrays of a run differ in length", where=run.run_id)
    if len(s) < SHORTEST:
        raise ConfigurationError(
            "the run is too short",
            where=run.run_id,
            found=f"{len(s)} samples",
            expected=f"at least {SHORTEST}",
            remedy="leave it out, or log more rows a second",
        )
    if (missing := run.missing.mean()) > MOST_MISSING:
        raise ConfigurationError(
            "too much of the output is missing",
            where=run.run_id,
            found="; ".join([f"{100 * missing:.0f} %", *run.remarks]),
            expected=f"at most {100 * MOST_MISSING:.0f} %; gaps are bridged",
        )
    if not finite:
        raise ConfigurationError(
            "a temperature or angle is missing",
            where=run.run_id,
            expected="T_in, T_out and table angle without gaps; without them their effects cannot be told",
        )


def stand_ins(t_in_c: Array | None, t_out_c: Array | None, count: int) -> tuple[Array, Array]:
    """Return T_in and T_out, (count,), where one that was not measured is the other, and none are 25 degC.

    What cannot be seen then drops out by itself: columns of T_in - T_out, or of any temperature, are zero.
    """
    if t_in_c is None and t_out_c is None:
        t_in_c = np.full(count, REFERENCE_C)
    t_in_c = t_out_c if t_in_c is None else t_in_c
    t_out_c = t_in_c if t_out_c is None else t_out_c
    assert t_in_c is not None
    assert t_out_c is not None
    return t_in_c, t_out_c


def interpolated(values: Array) -> Array:
    """Return values with NaN replaced by what lies between their neighbours, (n,); all NaN stays so."""
    known = ~np.isnan(values)
    if known.all():
        return values
    at = np.arange(len(values))
    return np.asarray(np.interp(at, at[known], values[known])) if known.any() else values


def unseen(s: Stimulus) -> str:
    """Return what a run's temperatures cannot show, because one or both were not measured; empty if both were."""
    if not np.array_equal(s.t_in_c, s.t_out_c):
        return ""
    if not np.ptp(s.t_in_c):
        return "no temperature was recorded: no effect of temperature can be seen, nor that there is none"
    return (
        "one temperature only, of the gyro or of its case: effects of the difference between them (gradient, "
        "part of Shupe's) cannot be seen"
    )


def cut(run: GapRun, count: int) -> GapRun:
    """Return the first `count` samples of a run."""
    s = run.stimulus
    if count >= len(s):
        return run
    shorter = Stimulus(
        s.time_s[:count],
        s.t_in_c[:count],
        s.t_out_c[:count],
        s.angle_deg[: count + 1],
        s.elevation_deg[:count],
        s.latitude_deg,
        s.period_s,
        None if s.edge_rate_dps is None else s.edge_rate_dps[: count + 1],
        None if s.force_g is None else s.force_g[:, :count],
        None if s.cross_rate_dph is None else s.cross_rate_dph[:, :count],
        None if s.over_offset_dph is None else s.over_offset_dph[:count],
    )
    noise = run.rounding_noise
    return replace(
        run,
        stimulus=shorter,
        output_dph=run.output_dph[:count],
        phase=run.phase[:count],
        rounding_noise=None if noise is None else noise.cut(count),
    )


@dataclass(frozen=True)
class Group:
    """Runs of one profile, cut to one length: `runs[condition][repeat]`.

    `shared`: the part of what the angle's codes do that is the same in all repeats, from 0 to 1.
    """

    profile: str
    conditions: tuple[str, ...]
    runs: tuple[tuple[GapRun, ...], ...]
    shared: float = 0.0

    @property
    def flat(self) -> tuple[GapRun, ...]:
        """All runs, condition by condition."""
        return tuple(run for repeats in self.runs for run in repeats)

    @cached_property
    def known_noise(self) -> Noise:
        """What rounding of stamps and angles does to the rate along the axis, rms of the runs."""
        return self.known_stamps.beside(self.known_codes)

    @cached_property
    def known_stamps(self) -> Noise:
        """What rounded stamps alone do."""
        return self._rms(RoundingNoise.of_stamps)

    @cached_property
    def known_codes(self) -> Noise:
        """What the angle's codes alone do."""
        return self._rms(RoundingNoise.of_codes)

    def _rms(self, noise_of: Callable[[RoundingNoise, Stimulus, NDArray[np.bool_]], Noise]) -> Noise:
        parts = [
            noise_of(run.rounding_noise, run.stimulus, run.missing)
            for run in self.flat
            if run.rounding_noise is not None
        ]

        def rms(values: list[float]) -> float:
            return math.sqrt(sum(value**2 for value in values) / len(self.flat))

        arcsec = rms([part.quantum_arcsec for part in parts])
        return Noise(rms([part.arw_deg_per_sqrt_h for part in parts]), quantum_arcsec=arcsec)

    @property
    def balanced(self) -> bool:
        """Whether every condition was repeated equally often."""
        return len({len(run) for run in self.runs}) == 1


def group_runs(runs: Sequence[GapRun]) -> list[Group]:
    """Return the runs by profile and sampling period, in order of appearance, cut to one length.

    Programmes of one profile that differ in length are groups of their own: see `by_length`.
    """
    result = []
    for (profile, _), by_condition in _gathered(by_length(runs)).items():
        count = good_length(min(len(run.stimulus) for each in by_condition.values() for run in each))
        rows = tuple(tuple(cut(run, count) for run in each) for each in by_condition.values())
        result.append(Group(profile, tuple(by_condition), rows))
    return result


def by_length(runs: Sequence[GapRun]) -> list[GapRun]:
    """Return the runs, those of a profile whose length differs named by it: "rates, 14 min", "rates, 111 min".

    A condition is cut by a tenth at most to the length of others. Its repeats stay together down to half of the
    longest: what differs between them tells the noise.
    """
    named: dict[int, str] = {}
    for (profile, period_s), by_condition in _gathered(runs).items():
        parts = [part for each in by_condition.values() for part in _split(each, _OF_REPEATS, _samples)]
        alike = _split(parts, _OF_CONDITIONS, lambda part: min(map(_samples, part)))
        for each in alike if len(alike) > 1 else ():
            minutes = min(_samples(run) for part in each for run in part) * period_s / 60.0
            named |= {id(run): f"{profile}, {minutes:.3g} min" for part in each for run in part}
    return [replace(run, profile=named[id(run)]) if id(run) in named else run for run in runs]


def _gathered(runs: Sequence[GapRun]) -> dict[tuple[str, float], dict[str, list[GapRun]]]:
    """Return the runs by profile and period, and there by condition."""
    gathered: dict[tuple[str, float], dict[str, list[GapRun]]] = {}
    for run in runs:
        by_condition = gathered.setdefault((run.profile, run.stimulus.period_s), {})
        by_condition.setdefault(run.condition, []).append(run)
    return gathered


def _samples(run: GapRun) -> int:
    return len(run.stimulus)


def _split(items: Sequence[T], least: float, length: Callable[[T], int]) -> list[list[T]]:
    """Return items in classes, longest first, none shorter than `least` of the longest in its class."""
    classes: list[list[T]] = []
    for item in sorted(items, key=length, reverse=True):
        if classes and length(item) >= least * length(classes[-1][0]):
            classes[-1].append(item)
        else:
            classes.append([item])
    return classes


def good_length(count: int) -> int:
    """Return the largest length up to `count` without prime factors above 7, for a fast transform."""
    while True:
        rest = count
        for factor in (2, 3, 5, 7):
            while rest % factor == 0:
                rest //= factor
        if rest == 1:
            return count
        count -= 1
