"""The shrinkage in a log: a run against rehearsals of its procedure, with the nominal and the closed model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._channel_data import ChannelSeries
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._diagnose import Recording
from bench.analysis.gap._position import PositionRun
from bench.analysis.heading import PlatformLog, stays, without_start
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.effects import CHANNEL_UNITS

_MEAN_S = 100


@dataclass(frozen=True)
class LogGap:
    """What a run differs by from rehearsals with the nominal and the closed model: rms in `unit`.

    `part` is a phase or heading, or "all" of them, or a channel. `rms_floor` is what two rehearsals of one model
    differ by: noise only. `share` is the part of the reducible gap (energy above the floor) that the closed model
    takes away, NaN where it is less than the floor.
    """

    part: str
    unit: str
    rms_nominal: float
    rms_closed: float
    rms_floor: float
    share: float


@dataclass(frozen=True, eq=False)
class LogCurve:
    """Run less rehearsal over time since power-on, 100 s means in deg/h, (m,) each."""

    run_id: str
    time_s: Array
    nominal_dph: Array
    closed_dph: Array
    floor_dph: Array


@dataclass(frozen=True, eq=False)
class LogGaps:
    """The gaps of a run's log in each signal: the rate's by phase, a position's by heading, all of them first.

    `curves` are of the rate, one for every stretch.
    """

    rate: tuple[LogGap, ...] = ()
    channels: tuple[LogGap, ...] = ()
    headings: tuple[LogGap, ...] = ()
    curves: tuple[LogCurve, ...] = ()


def log_gaps(
    run: Sequence[Recording],
    nominal: Sequence[Recording],
    closed: Sequence[Recording],
    again: Sequence[Recording],
) -> LogGaps:
    """Return the gap between a run and rehearsals of it in every signal that all of them have.

    `again` is rehearsed with the closed model and another seed. ConfigurationError if the rehearsals went through
    other phases.
    """
    logs = (run, nominal, closed, again)
    rates = [[each for each in log if isinstance(each, GapRun)] for log in logs]
    gaps, curves = _rate_log_gaps(rates) if rates[0] else ([], [])
    series = [[each for each in log if isinstance(each, ChannelSeries)] for log in logs]
    positions = [each.log for log in logs for each in log if isinstance(each, PositionRun)]
    headings = _heading_log_gaps(*positions) if positions else []
    return LogGaps(tuple(gaps), tuple(_channel_log_gaps(series)), tuple(headings), tuple(curves))


def _channel_log_gaps(logs: Sequence[Sequence[ChannelSeries]]) -> list[LogGap]:
    """Return the gap of 100 s means of every channel that run and rehearsals have, all phases together.

    Phases are laid on each other at their begins. Nothing is taken out: an offset is a gap.
    """
    gaps = []
    for channel, unit in CHANNEL_UNITS.items():
        known = [[series for series in log if series.channel == channel] for log in logs]
        if not all(known):
            continue
        phases = [_phase_means(series[0]) for series in known]
        rows = []
        for name in phases[0]:
            parts = [phase[name] for phase in phases if name in phase]
            if len(parts) == len(phases):
                count = min(len(part) for part in parts)
                rows.append(np.stack([part[:count] for part in parts]))
        values = np.concatenate(rows, axis=1) if rows else np.zeros((4, 0))
        real, first, then, other = values[:, ~np.isnan(values).any(axis=0)]
        if len(real):
            apart = np.stack((real - first, real - then, then - other))
            gaps.append(_log_gap(channel, unit, np.nanmean(apart**2, axis=1)))
    return gaps


def _phase_means(series: ChannelSeries) -> dict[str, Array]:
    """Return means over 100 s from each phase's begin, NaN without a record, by number and name of the phase."""
    time_s = series.inputs.time_s
    result: dict[str, Array] = {}
    for number, (phase, part) in enumerate(_phases(series.phase)):
        row = ((time_s[part] - time_s[part.start]) // _MEAN_S).astype(np.int64)
        known = ~np.isnan(series.values[part])
        size = int(row[-1]) + 1
        count = np.bincount(row[known], minlength=size)
        total = np.bincount(row[known], series.values[part][known], size)
        means = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        result[f"{number} {phase}"] = means
    return result


def _rate_log_gaps(logs: Sequence[Sequence[GapRun]]) -> tuple[list[LogGap], list[LogCurve]]:
    """Return the gaps of 100 s means by phase, all of them first, and the curves of every stretch.

    Phases are laid on each other at their begins, since a wait for equilibrium takes its own time in every run;
    each stretch's mean is taken out.
    """
    curves, names = [], []
    for stretches in zip(*logs, strict=False):
        blocks = [_phases(stretch.phase) for stretch in stretches]
        orders = [[name for name, _ in block] for block in blocks]
        if any(order != orders[0] for order in orders[1:]) or len(logs[0]) != len(logs[1]):
            raise ConfigurationError(
                "the rehearsal went through other phases than the run",
                where=stretches[0].run_id,
                found=", ".join(orders[1]),
                expected=", ".join(orders[0]),
                remedy="the run's procedure may have changed since, or the run was cut short",
            )
        rows, phases = [], []
        for number, (name, _) in enumerate(blocks[0]):
            parts = [block[number][1] for block in blocks]
            count = min(part.stop - part.start for part in parts) // _MEAN_S
            taken = [slice(part.start, part.start + count * _MEAN_S) for part in parts]
            means = [_means(each.output_dph[at]) for each, at in zip(stretches, taken, strict=True)]
            rows.append(np.stack((_means(stretches[0].stimulus.time_s[taken[0]]), *means)))
            phases += [name] * count
        time_s, real, first, then, other = np.concatenate(rows, axis=1)
        apart = np.stack((real - first, real - then, then - other))
        apart -= np.nanmean(apart, axis=1, keepdims=True)
        curves.append(LogCurve(stretches[0].run_id, time_s, *apart))
        names.append(np.array(phases))
    phase = np.concatenate(names)
    values = np.concatenate(
        [np.stack((curve.nominal_dph, curve.closed_dph, curve.floor_dph)) for curve in curves], axis=1
    )
    by_part = {"all": values} | {name: values[:, phase == name] for name in dict.fromkeys(phase.tolist())}
    return [_log_gap(name, "deg/h", np.nanmean(part**2, axis=1)) for name, part in by_part.items()], curves


def _heading_log_gaps(
    run: PlatformLog, nominal: PlatformLog, closed: PlatformLog, again: PlatformLog
) -> list[LogGap]:
    """Return the gaps of all stays after the first, all of them first.

    Each log's start is taken out of it: what its own first stay foretells. RecordError as `without_start`.
    """
    first, *rest = stays(run)
    origin_s = run.time_s[first.start]
    real = _position(run)
    others = []
    for log in (nominal, closed, again):
        own = _position(log)
        time_s = log.time_s - log.time_s[stays(log)[0].start] + origin_s
        known = ~np.isnan(own).any(axis=0)
        others.append(np.stack([np.interp(run.time_s, time_s[known], row[known]) for row in own]))
    apart = np.stack((real - others[0], real - others[1], others[1] - others[2]))
    parts = [slice(stay.start, stay.stop) for stay in rest]
    rows = [("all", np.concatenate([apart[:, :, part] for part in parts], axis=2))]
    rows += [
        (f"{stay.heading_deg:.0f} deg", apart[:, :, part]) for stay, part in zip(rest, parts, strict=True)
    ]
    return [_log_gap(name, "arcsec", np.nanmean((values**2).sum(axis=1), axis=1)) for name, values in rows]


def _position(log: PlatformLog) -> Array:
    """Return north and east error in arcsec less what the first stay foretells, (2, n)."""
    left = without_start("run", log, stays(log)[0], np.zeros((len(log.time_s), 3)))
    return np.stack((left.north_as, left.east_as))


def _phases(names: NDArray[np.str_]) -> list[tuple[str, slice]]:
    """Return the phases one after the other: name and samples."""
    cuts = [0, *(np.flatnonzero(names[1:] != names[:-1]) + 1).tolist(), len(names)]
    return [(str(names[start]), slice(start, stop)) for start, stop in pairwise(cuts)]


def _means(values: Array) -> Array:
    rows = values.reshape(-1, _MEAN_S)
    return np.asarray(np.nanmean(rows, axis=1)) if len(rows) else np.zeros(0)


def _log_gap(part: str, unit: str, mean_squares: Array) -> LogGap:
    """Return the gap of mean squares: run less nominal, run less closed, closed less closed again; shape (3,)."""
    nominal, closed, floor = mean_squares.tolist()
    reducible = nominal - floor
    share = 1.0 - (closed - floor) / reducible if reducible > floor else math.nan
    return LogGap(part, unit, math.sqrt(nominal), math.sqrt(closed), math.sqrt(floor), share)
