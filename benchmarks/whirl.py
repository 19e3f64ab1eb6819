"""Whirl: reduction of the carrier's oscillation case by case, coverage of the sd, time of a fit.

Run as `python -m benchmarks.whirl`. In every case the plant's bearing wobbles and table and gyro are carried as
bytes; the fit sees one hour, another hour (other noise, other turn-on) judges it beside its whirl-free twin.
The yardstick of `rows` is the patent's own second-order integral fit at the nominal angle w t.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from bench.analysis.whirl import WhirlCompensation
from bench.analysis.whirl._attitude import carrier_tilt, oscillation, uncompensated, unit_attitude
from bench.analysis.whirl._direct import DirectFit, fit_direct
from bench.analysis.whirl._integral import body_lines, fit_integral, match_coefficients
from bench.analysis.whirl._lines import choose_lines, scan_lines
from bench.analysis.whirl._residual import heading_from_body_rate
from bench.analysis.whirl._study import judge
from bench.analysis.whirl._types import TurnRecord
from benchmarks._measure import Row, figure
from benchmarks.whirl_runs import QUIET, STILL, TABLE, Plan, emulate, nominal_angle, reversing
from drivers.base.clock import host_seconds
from simulators.plant.wobble import BACKWARD_LINE, CAGE_LINE, CONSTANT_TILT, PATENT_CLASS, Wobble

_FULL: dict[float, complex] = {**PATENT_CLASS, **CONSTANT_TILT, **BACKWARD_LINE}
_HOUR = ((3600.0, 6.0),)
_TEN_MINUTES = ((600.0, 6.0),)

_PATENT = "the patent's second-order integral fit"


@dataclass(frozen=True)
class Case:
    """One line of the table."""

    name: str
    wobble: Wobble
    stretches: Sequence[tuple[float, float]] = _HOUR
    fitted: Sequence[tuple[float, float]] | None = None
    settings: dict[str, Any] = field(default_factory=dict)
    fit: dict[str, Any] = field(default_factory=dict)


_IDEAL = {"without": QUIET, "table": STILL}
_REVERSALS = tuple(reversing(60, 4, 6.0))
CASES = (
    Case("1 patent's class", Wobble(PATENT_CLASS)),
    Case("1b the same, ideal sensors", Wobble(PATENT_CLASS), settings=_IDEAL),
    Case("2 + constant tilt and line -2", Wobble(_FULL)),
    Case("2b + installation error 2 arcsec", Wobble(_FULL, misalignment_arcsec=(2.0, -1.0))),
    Case("3 reversal every 4 turns", Wobble(_FULL), _REVERSALS),
    Case("3c + play of 5 arcsec", Wobble(_FULL, play_arcsec=5.0), _REVERSALS),
    Case("3c, play not fitted", Wobble(_FULL, play_arcsec=5.0), _REVERSALS, fit={"play": False}),
    Case("4b rate ripple 5 %", Wobble(PATENT_CLASS), settings={"table": replace(TABLE, ripple_once_ppm=5e4)}),
    Case("5 + cage line 1.5 arcsec", Wobble({**_FULL, **CAGE_LINE})),
    Case("10 fitted on 10 min", Wobble(PATENT_CLASS), fitted=_TEN_MINUTES),
    Case("all: reversals, ripple, play", Wobble(_FULL, play_arcsec=5.0), _REVERSALS,
         settings={"table": replace(TABLE, ripple_once_ppm=5e4)}),
)  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """Rms an axis, arcsec."""

    locked_before: float
    locked_nominal: float
    locked_measured: float
    locked_direct: float
    locked_floor: float
    total_direct: float
    total_floor: float


def outcome(case: Case, seed: int = 1) -> Outcome:
    """Fit on one run, judge on another beside its whirl-free twin."""
    plan = Plan(case.fitted or case.stretches, case.wobble, seed=seed, **case.settings)
    fitted, _ = emulate(plan)
    judged, _ = emulate(replace(plan, stretches=case.stretches, seed=seed + 1000))
    empty = Wobble(misalignment_arcsec=case.wobble.misalignment_arcsec)
    twin, _ = emulate(replace(plan, stretches=case.stretches, seed=seed + 1000, wobble=empty))
    fit = fit_direct([fitted], **case.fit)
    judgement = judge(judged, WhirlCompensation.from_fit(fit, "INS-1", {}, gauge="mean"), fit)
    floor = _uncompensated(twin, fit)
    return Outcome(
        judgement.before.locked_arcsec,
        _patent(fitted, judged, fit, judgement.tilt_before, nominal=True),
        _patent(fitted, judged, fit, judgement.tilt_before, nominal=False),
        judgement.after.locked_arcsec,
        floor.locked_arcsec,
        judgement.after.total_arcsec,
        floor.total_arcsec,
    )


def _uncompensated(record: TurnRecord, fit: DirectFit) -> Any:
    attitude = unit_attitude(record, heading_from_body_rate(fit.body_rate_dph[0].value))
    tilt = carrier_tilt(uncompensated(attitude, record.angle_rad))
    return oscillation(tilt, record.time_s, record.angle_rad)


def _patent(fitted: TurnRecord, judged: TurnRecord, fit: DirectFit, tilt: Any, *, nominal: bool) -> float:
    """Return what the patent's second order leaves locked, at the measured angle or at w t."""
    angle = _steady_angle(fitted) if nominal else None
    series = fit_integral(fitted, 2, body_rate_dph=fit.body_rate_dph[0].value, angle_rad=angle)
    lines, amplitudes = body_lines(match_coefficients(series))
    at = _steady_angle(judged) if nominal else judged.angle_rad
    left = tilt - sum(a * np.exp(1j * m * at) for m, a in zip(lines, amplitudes, strict=True))
    return float(oscillation(left, judged.time_s, judged.angle_rad).locked_arcsec)


def _steady_angle(record: TurnRecord) -> Any:
    """Return w t; with reversals at the speed of the first sense, since it knows nothing else."""
    if np.abs(np.diff(record.angle_rad)).sum() > 1.5 * np.ptp(record.angle_rad):
        return record.angle_rad[0] + math.radians(6.0) * (record.time_s - record.time_s[0])
    return nominal_angle(record)


def coverage(seeds: int = 200) -> tuple[float, int]:
    """Return the share of real coefficients within 2 sd of the truth, and how many there were, full plant."""
    wobble, inside, count = Wobble(_FULL, play_arcsec=5.0 - 2.0j), 0, 0
    for seed in range(seeds):
        plan = Plan(tuple(reversing(12, 2, 6.0)), wobble, seed=seed + 1, rate_hz=25, poll_s=5.0)
        record, _ = emulate(plan)
        fit = fit_direct([record])
        truths = {line: _FULL.get(line, 0j) for line in fit.lines}
        pairs = [(fit.amplitude(line), truth) for line, truth in truths.items()]
        if fit.play_arcsec is not None:
            pairs.append((fit.play_arcsec, wobble.play_arcsec))
        for estimate, truth in pairs:
            off = estimate.value - truth
            inside += (abs(off.real) < 2.0 * estimate.sd) + (abs(off.imag) < 2.0 * estimate.sd)
            count += 2
    return inside / count, count


def fit_seconds(repeats: int = 15) -> tuple[float, float]:
    """Return the median wall time of a direct fit and of the patent's, 10 min at 250 Hz, in s."""
    record, _ = emulate(Plan(_TEN_MINUTES, Wobble(_FULL), rate_hz=250))
    fits: tuple[Callable[[], object], ...] = (lambda: fit_direct([record]), lambda: fit_integral(record))
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(repeats):
        for taken, work in zip(times, fits, strict=True):
            start = host_seconds()
            work()
            taken.append(host_seconds() - start)
    return statistics.median(times[0]), statistics.median(times[1])


def false_alarms(runs: int = 300) -> tuple[float, float]:
    """Return the share of whirl-free runs (of 8 min) in which the order test at 1 % and the scan found a line."""
    orders = scans = 0
    for seed in range(runs):
        record, _ = emulate(
            Plan(((480.0, 6.0),), Wobble(), seed=seed + 1, rate_hz=25, without=("drift", "turn_on"))
        )
        orders += bool(choose_lines([record], false_alarm=0.01))
        scans += bool(scan_lines(fit_direct([record])))
    return orders / runs, scans / runs


def rows() -> list[Row]:
    """Return the comparison with the patent's form, case 2 and reversals, and the time of a fit."""
    table = []
    for case in (CASES[2], CASES[4]):
        found = outcome(case)
        ours, theirs = found.locked_before / found.locked_direct, found.locked_before / found.locked_nominal
        table.append(figure(f"whirl locked to the angle, {case.name}", ours, theirs, _PATENT, "times less"))
    ours, theirs = fit_seconds()
    return [*table, figure("whirl fit, 10 min at 250 Hz", ours, theirs, _PATENT, "s", least=True)]


def main() -> None:
    print(
        f"{'case':34s} locked: before  w t    angle  direct  floor | factor w t angle direct | all: direct floor"
    )
    for case in CASES:
        o = outcome(case)
        factors = [
            o.locked_before / value for value in (o.locked_nominal, o.locked_measured, o.locked_direct)
        ]
        print(
            f"{case.name:34s} {o.locked_before:13.2f} {o.locked_nominal:6.3f} {o.locked_measured:6.3f} "
            f"{o.locked_direct:7.4f} {o.locked_floor:6.4f} | {factors[0]:10.1f} {factors[1]:5.1f} "
            f"{factors[2]:6.0f} | {o.total_direct:11.3f} {o.total_floor:5.3f}"
        )
    share, count = coverage()
    print(
        f"truth within 2 sd: {100.0 * share:.2f} % of {count} real coefficients, 200 seeds (95.45 expected)"
    )
    direct, integral = fit_seconds()
    print(f"fit of 10 min at 250 Hz: direct {1e3 * direct:.1f} ms, integral {1e3 * integral:.1f} ms")
    order, scan = false_alarms()
    print(
        f"false alarms, whirl-free runs: order {100.0 * order:.2f} %, scan {100.0 * scan:.2f} %, nominal 1 %"
    )


if __name__ == "__main__":
    main()
