"""The channels beside the gyro's rate, as a recording has them: recorded signal, and what acted on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d

from bench.analysis.gap._channel_source import ChannelSource, Trace
from bench.record.events.run import AngleDemand, RateDemand
from bench.record.recording import Arrivals, row_means
from drivers.base.arrays import Array
from simulators.effects import Channel, ChannelInputs, Demand

_STEP_S = 10.0
_STEPS = 200
"""Length of a step of temperature, and the steps from which a short recording has finer ones."""
_SETTLED_S = 1800.0
"""Time after the demand's end from which a temperature counts as quiet."""
_COARSE = 0.25
"""Part of a step from which on a row counts as long."""
_STEADY_K = 1.0
"""Change of the air in that time below which it is steady, where nobody says what was demanded of it."""
_AT_REST_DPS = 0.01
_LEAST_SPIN_S = 30.0
_SHORT = 8
_LATE_MS = 50.0
_ENVELOPE_S = 61
"""Seconds over which the earliest arrivals are taken for punctual."""


@dataclass(frozen=True, eq=False)
class ChannelSeries:
    """One channel of one run: `values` (n,) with NaN where the channel has nothing to be compared with.

    `phase` (n,) are names; `quiet` (n,) says where nothing is demanded to change, for the noise floor.
    `resolution` is the least step seen. `scatter` maps stochastic effects of the channel to their size. `unit_id`
    is what was under test.
    """

    channel: Channel
    run_id: str
    inputs: ChannelInputs
    values: Array
    phase: NDArray[np.str_]
    quiet: NDArray[np.bool_]
    resolution: float
    checksum: str = ""
    scatter: Mapping[str, float] = field(default_factory=dict)
    unit_id: str = ""

    def pieces(self) -> list[tuple[str, slice]]:
        """Return phases and stretches without gap inside one phase, of at least 8 samples."""
        known = ~np.isnan(self.values)
        cut = (self.phase[1:] != self.phase[:-1]) | (known[1:] != known[:-1])
        cut |= np.diff(self.inputs.time_s) > 1.5 * self.inputs.period_s
        changes = np.flatnonzero(cut) + 1
        edges = [0, *changes.tolist(), len(self.values)]
        return [
            (str(self.phase[low]), slice(low, high))
            for low, high in pairwise(edges)
            if known[low] and high - low >= _SHORT
        ]


def channels_of(source: ChannelSource) -> tuple[list[ChannelSeries], dict[str, str]]:
    """Return the channels of a recording, and for those that it cannot show the reason by channel."""
    found: list[ChannelSeries] = []
    missing: dict[str, str] = {}
    readers: dict[str, Callable[[ChannelSource], ChannelSeries | str]] = {
        "chamber_air": _air,
        "case_temperature": _case,
        "gyro_temperature": _inside,
        "table_angle": _angle,
        "table_rate": _rate,
        "time_stamps": _stamps,
    }
    for channel, read in readers.items():
        series = read(source)
        if isinstance(series, str):
            missing[channel] = series
        else:
            found.append(series)
    return found, missing


def _air(source: ChannelSource) -> ChannelSeries | str:
    ran = source.conditioning()
    if isinstance(ran, str):
        return ran
    demands, raw = ran.demands, ran.air.values
    if len(raw) < 2 * _SHORT:
        return "the chamber did not run long enough"
    step_s = step_of(ran.air.time_s)
    time_s, air = _stepped(ran.air.time_s, raw, step_s)
    # without a demanded rate there is nothing to compare with until the air has arrived
    blind = np.zeros(len(time_s), np.bool_)
    ends = [demand.time_s for demand in demands[1:]] + [math.inf]
    for demand, end in zip(demands, ends, strict=True):
        if math.isinf(demand.ramp_per_s):
            own = (time_s >= demand.time_s) & (time_s < end)
            near = np.flatnonzero(own & (np.abs(air - demand.target) < 1.0))
            arrived_s = (
                time_s[near[0]] + 300.0 if len(near) and abs(air[own][0] - demand.target) > 1.0 else 0.0
            )
            blind |= own & (time_s < (arrived_s if len(near) else math.inf))
    if blind.all():
        return (
            "the air never arrived at a set point, and no set point ramped: there is nothing to compare with"
        )
    held = np.array([demand.target for demand in demands])[_in_force(demands, time_s)]
    inputs = ChannelInputs(time_s, held, float(air[0]), step_s, tuple(demands))
    values = np.where(blind, np.nan, air)
    return _series(source, "chamber_air", inputs, values, raw, _quiet(demands, time_s))


def _in_force(demands: Sequence[Demand], time_s: Array) -> NDArray[np.int64]:
    """Return which demand is in force at every time, the first also before it, (n,)."""
    starts = np.array([demand.time_s for demand in demands])
    return np.maximum(np.searchsorted(starts, time_s, side="right") - 1, 0)


def _quiet(demands: Sequence[Demand], time_s: Array) -> NDArray[np.bool_]:
    """Return when the demand in force will have been reached for half an hour, (n,); always without demands."""
    if not demands:
        return np.ones(len(time_s), np.bool_)
    here = demands[0].target
    settled = []
    for demand in demands:
        rate = demand.ramp_per_s if math.isfinite(demand.ramp_per_s) else 1.0 / 60.0
        settled.append(demand.time_s + abs(demand.target - here) / rate + _SETTLED_S)
        here = demand.target
    return np.asarray(time_s > np.array(settled)[_in_force(demands, time_s)])


def _case(source: ChannelSource) -> ChannelSeries | str:
    case, air = source.case(), source.air()
    if isinstance(case, str):
        return case
    if isinstance(air, str):
        return air
    return _following(source, "case_temperature", case, air)


def _inside(source: ChannelSource) -> ChannelSeries | str:
    case = source.case()
    if isinstance(case, str):
        return f"nothing that the gyro's temperature could follow: {case}"
    inside = source.inside()
    if not isinstance(inside, str) and len(inside.values) < 2 * _SHORT:
        return "the gyro says no temperature"
    return inside if isinstance(inside, str) else _following(source, "gyro_temperature", inside, case)


def _following(source: ChannelSource, channel: Channel, body: Trace, around: Trace) -> ChannelSeries | str:
    """Return a temperature that follows the one around it; what acts on a case acts on it, too."""
    if len(body.values) < 2 * _SHORT:
        return f"{len(body.values)} values only"
    step_s = step_of(body.time_s)
    time_s, values = _stepped(body.time_s, body.values, step_s)
    _, drive = _stepped(body.time_s, np.interp(body.time_s, *around), step_s)
    acts = (source.heat_w(), source.door()) if channel == "case_temperature" else (None, None)
    heat_w, door = (
        np.zeros(0) if command is None else _means_of(command, time_s, step_s) for command in acts
    )
    inputs = ChannelInputs(time_s, drive, float(body.values[0]), step_s, heat_w=heat_w, door=door)
    demands = source.air_demands()
    quiet = _quiet(demands, time_s) if demands else _steady(drive, _STEADY_K, step_s)
    for means in (heat_w, door):
        quiet = quiet & _steady(means, 1e-9 * float(np.ptp(means)), step_s) if len(means) else quiet
    return _series(source, channel, inputs, values, body.values, quiet)


def _steady(values: Array, within: float, step_s: float) -> NDArray[np.bool_]:
    """Return where values changed by no more than that in the half hour before, (n,); not in the first one."""
    size = math.ceil(_SETTLED_S / step_s) + 1
    shift = size // 2  # the window ends at the value
    highest = maximum_filter1d(values, size, mode="nearest", origin=shift if size % 2 else shift - 1)
    lowest = minimum_filter1d(values, size, mode="nearest", origin=shift if size % 2 else shift - 1)
    known = np.arange(len(values)) >= size - 1
    return np.asarray((highest - lowest <= within) & known)


def _means_of(command: Trace, middles_s: Array, step_s: float) -> Array:
    """Return a command's means over steps, (n,); each of its values is in force until the next."""
    edges_s = np.append(middles_s - 0.5 * step_s, middles_s[-1] + 0.5 * step_s)
    times_s = np.append(command.time_s, max(command.time_s[-1], edges_s[-1]) + 1.0)
    values = np.append(command.values, command.values[-1])
    area = np.concatenate(([0.0], np.cumsum(values[:-1] * np.diff(times_s))))
    # before its first value it is taken to have been what that says
    before = np.minimum(edges_s - times_s[0], 0.0) * values[0]
    return np.asarray(np.diff(np.interp(edges_s, times_s, area) + before) / step_s)


def _angle(source: ChannelSource) -> ChannelSeries | str:
    if not source.has_table():
        return "the run has no table"
    parts, demands, step_s = [], [], _STEP_S
    for start, end, demand in source.table_demands():
        if not isinstance(demand, AngleDemand) or end - start < _LEAST_SPIN_S:
            continue
        table = source.table(start, end)
        moving = np.flatnonzero(np.abs(table.rate_dps) > _AT_REST_DPS)
        first = max(int(moving[-1]) + 5 if len(moving) else 5, 5)
        at_s, angle = table.time_s[first:], table.angle_deg[first:]
        if len(at_s) < 2 * _SHORT:
            continue
        off = 3600.0 * np.remainder(angle - demand.angle_deg + 180.0, 360.0) - 648000.0
        step_s = max(_STEP_S, float(np.median(np.diff(at_s))))
        middle_s, means = _stepped(at_s, off, step_s)
        parts.append(np.stack((middle_s, means, np.full(len(means), demand.angle_deg))))
        demands.append(Demand(float(at_s[0]), 0.0, math.inf))
    if not parts:
        return "no angle was demanded of the table and held for half a minute"
    time_s, off, angle = np.concatenate(parts, axis=1)
    inputs = ChannelInputs(time_s, np.zeros(len(off)), float(off[0]), step_s, tuple(demands), angle)
    raw = source.table().angle_deg * 3600.0
    return _series(source, "table_angle", inputs, off, raw)


def _rate(source: ChannelSource) -> ChannelSeries | str:
    if not source.has_table():
        return "the run has no table"
    parts = []
    for start, end, told in source.table_demands():
        if not isinstance(told, RateDemand) or end - start < _LEAST_SPIN_S or told.rate_dps == 0.0:
            continue
        table = source.table(start, end)
        rate = table.rate_dps
        steady = np.abs(np.diff(rate, prepend=0.0)) < 0.01 * abs(told.rate_dps)
        first = int(np.argmax(steady)) + 3
        kept = slice(first, len(rate) - 1)
        if len(rate[kept]) >= 2 * _SHORT:
            demand = np.full(len(rate[kept]), told.rate_dps)
            parts.append(np.stack((table.time_s[kept], rate[kept], demand, table.angle_deg[kept])))
    if not parts:
        return "no rate was demanded of the table and held for half a minute"
    time_s, rate, demand, angle = np.concatenate(parts, axis=1)
    inputs = ChannelInputs(time_s, demand, float(rate[0]), float(np.median(np.diff(time_s))), (), angle)
    return _series(source, "table_rate", inputs, rate, rate)


def _stamps(source: ChannelSource) -> ChannelSeries | str:
    seen = source.arrivals()
    if isinstance(seen, str):
        return seen
    if len(seen.count) < 4 * _SHORT:
        return "no arrival times of the gyro's stream"
    late_ms = 1e3 * (seen.arrival_s - seen.count_s * seen.count)
    second = np.floor(seen.arrival_s).astype(np.int64)
    starts = np.flatnonzero(np.diff(second, prepend=second[0] - 1))
    earliest = np.minimum.reduceat(late_ms, starts)
    line = np.interp(
        seen.arrival_s, seen.arrival_s[starts], median_filter(earliest, _ENVELOPE_S, mode="nearest")
    )
    beyond = late_ms - line
    scatter = {
        "arrival_jitter": float(1.4826 * np.median(np.abs(beyond - np.median(beyond)))),
        "late_frames": _late_fraction(seen, beyond),
    }
    time_s = seen.arrival_s[starts]
    values = np.where(earliest - line[starts] > _LATE_MS, line[starts], earliest)
    values = values - values.mean()
    inputs = ChannelInputs(time_s, np.zeros(len(time_s)), float(values[0]), 1.0)
    series = _series(source, "time_stamps", inputs, values, values)
    return replace(series, scatter=scatter, resolution=max(series.resolution, 1e-3))


def _late_fraction(seen: Arrivals, beyond_ms: Array) -> float:
    """Return the part of all frames that came late; a mark stands for every frame since the mark before."""
    frame_ms = 1e3 * seen.count_s * float(np.median(np.diff(seen.count)))
    frames = np.rint(1e3 * seen.count_s * np.diff(seen.count) / frame_ms)
    late = np.ceil((beyond_ms[1:] + (frames - 1.0) * frame_ms - _LATE_MS) / frame_ms)
    return float(np.clip(late, 0.0, frames).sum() / max(frames.sum(), 1.0))


def _stepped(time_s: Array, values: Array, step_s: float = _STEP_S) -> tuple[Array, Array]:
    """Return means over equal steps: their middles (m,) and values (m,), empty steps interpolated.

    Rows of which a step has few count as instants: theirs is the mean time of an even step's rows, and a row that
    is early or late stays in its step.
    """
    row_s = float(np.median(np.diff(time_s)))
    begin_s = time_s[0] - (0.5 * row_s if row_s > _COARSE * step_s else 0.0)
    row = np.floor((time_s - begin_s) / step_s).astype(np.int64)
    count = int(row[-1])
    means = row_means(values, row, count)
    middle = begin_s + (np.arange(count) + 0.5) * step_s
    full = ~np.isnan(means)
    return middle, np.interp(middle, middle[full], means[full]) if full.any() else np.zeros(count)


def step_of(time_s: Array) -> float:
    """Return the step for temperatures recorded at times (n,): 10 s, less in a short one, whole rows.

    A plant that was recorded for less than half an hour is a quick one.
    """
    row_s = float(np.median(np.diff(time_s)))
    wanted_s = min(_STEP_S, float(time_s[-1] - time_s[0]) / _STEPS)
    return wanted_s if row_s <= _COARSE * wanted_s else row_s * max(math.floor(wanted_s / row_s + 0.5), 1)


def _series(
    source: ChannelSource,
    channel: Channel,
    inputs: ChannelInputs,
    values: Array,
    raw: Array,
    quiet: NDArray[np.bool_] | None = None,
) -> ChannelSeries:
    steps = np.diff(np.unique(raw[:100_000]))
    resolution = float(steps[steps > 1e-12].min()) if (steps > 1e-12).any() else 1e-6
    return ChannelSeries(
        channel,
        source.run_id,
        inputs,
        values,
        source.phase_at(inputs.time_s),
        np.ones(len(values), np.bool_) if quiet is None else quiet,
        resolution,
        source.checksum,
        unit_id=source.unit_id,
    )
