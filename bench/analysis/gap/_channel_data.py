"""The channels beside the gyro's rate, as a run folder has them: recorded signal, and what acted on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from bench.control.run_record import gyro_source
from bench.record.benchfile import bench_file_from
from bench.record.events import Event
from bench.record.events.run import AirDemand, AngleDemand, ConditioningDemand, HomeDemand, RateDemand
from bench.record.events.safe import SafeState
from bench.record.recording import Arrivals, Run, row_means, seconds
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError, RecordError
from simulators.effects import CHANNEL_UNITS, Channel, ChannelInputs, Demand

_STEP_S = 10.0
_SETTLED_S = 1800.0
"""Time after the demand's end from which a temperature counts as quiet."""
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
    `resolution` is the least step seen. `scatter` maps stochastic effects of the channel to their size.
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


def load_channels(folder: Path, gyro: str | None = None) -> tuple[list[ChannelSeries], dict[str, str]]:
    """Return the channels of a run folder, and for those that it cannot show the reason by channel."""
    run = Run.open(folder)
    if run.manifest.imported is not None:
        return [], dict.fromkeys(CHANNEL_UNITS, "an imported recording has no commands in it")
    units = [unit for unit in run.manifest.units if run.manifest.device(unit).role == "gyro"]
    name = gyro or next(iter(units), "")
    found: list[ChannelSeries] = []
    missing: dict[str, str] = {}
    readers: dict[str, Callable[[], ChannelSeries | str]] = {
        "chamber_air": lambda: _air(run),
        "case_temperature": lambda: _case(run, name),
        "gyro_temperature": lambda: _inside(run, name),
        "table_angle": lambda: _angle(run),
        "table_rate": lambda: _rate(run),
        "time_stamps": lambda: _stamps(run, name),
    }
    for channel, read in readers.items():
        series = read()
        if isinstance(series, str):
            missing[channel] = series
        else:
            found.append(series)
    return found, missing


def _air(run: Run) -> ChannelSeries | str:
    if "chamber" not in run.tables:
        return "the run has no chamber"
    demands, running_s = _chamber_demands(run)
    if not demands or running_s is None:
        return "the chamber was not started in this run"
    table = run.chamber(("time_ns", "air_temp_c"), *running_s)
    raw = table["air_temp_c"].astype(np.float64)
    if len(raw) < 2 * _SHORT:
        return "the chamber did not run long enough"
    time_s, air = _stepped(seconds(table), raw)
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
    held = np.array([demand.target for demand in demands])[_in_force(demands, time_s)]
    inputs = ChannelInputs(time_s, held, float(air[0]), _STEP_S, tuple(demands))
    values = np.where(blind, np.nan, air)
    return _series(run, "chamber_air", inputs, values, raw, _quiet(demands, time_s))


def _chamber_demands(run: Run) -> tuple[list[Demand], tuple[float, float] | None]:
    """Return the demands in force while the chamber ran, and from when to when it did."""
    target: tuple[float, float] | None = None
    demands: list[Demand] = []
    start_s: float | None = None
    end_s = _end_s(run)
    for time_s, event in run.lines:
        if isinstance(event, AirDemand):
            ramp = event.ramp_k_per_min
            target = event.set_point_c, math.inf if ramp is None else ramp / 60.0
            if start_s is not None:
                demands.append(Demand(time_s, *target))
        elif isinstance(event, ConditioningDemand):
            if not event.on and start_s is not None:
                end_s = min(end_s, time_s)
                break
            if event.on and start_s is None:
                start_s = time_s
                demands += [] if target is None else [Demand(time_s, *target)]
    return demands, None if start_s is None else (start_s, end_s)


def _in_force(demands: list[Demand], time_s: Array) -> NDArray[np.int64]:
    """Return which demand is in force at every time, the first also before it, (n,)."""
    starts = np.array([demand.time_s for demand in demands])
    return np.maximum(np.searchsorted(starts, time_s, side="right") - 1, 0)


def _quiet(demands: list[Demand], time_s: Array) -> NDArray[np.bool_]:
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


def _case(run: Run, gyro: str) -> ChannelSeries | str:
    sensor = run.manifest.device(gyro).case_sensor if gyro else None
    if sensor is None or "chamber" not in run.tables:
        return "no sensor on the unit's case (case_sensor in the bench file)"
    table = run.chamber()
    if "air_temp_c" not in table:
        return "no record of the air that the case could follow"
    try:
        read_s, raw = run.sensor(sensor)
    except RecordError:
        return f"no record of the sensor on the unit's case (case_sensor {sensor})"
    time_s, case = _stepped(read_s, raw)
    _, air = _stepped(read_s, np.interp(read_s, seconds(table), table["air_temp_c"].astype(np.float64)))
    return _following(run, "case_temperature", time_s, case, air, raw)


def _inside(run: Run, gyro: str) -> ChannelSeries | str:
    sensor = run.manifest.device(gyro).case_sensor if gyro else None
    if sensor is None or "chamber" not in run.tables:
        return "no sensor on the unit's case that the gyro's temperature could follow"
    around_s, around_c = run.sensor(sensor)
    table = run.gyro(gyro, ("time_ns", "temp_c"))
    known = ~np.isnan(table["temp_c"])
    if known.sum() < 2 * _SHORT:
        return "the gyro says no temperature"
    raw = table["temp_c"][known].astype(np.float64)
    time_s, inside = _stepped(seconds(table)[known], raw)
    case = np.interp(time_s, around_s, around_c)
    return _following(run, "gyro_temperature", time_s, inside, case, raw)


def _following(
    run: Run, channel: Channel, time_s: Array, values: Array, around: Array, raw: Array
) -> ChannelSeries:
    """Return a temperature that follows the one around it, (n,) each; `raw` are the values as recorded."""
    inputs = ChannelInputs(time_s, around, float(raw[0]), _STEP_S)
    return _series(run, channel, inputs, values, raw, _quiet(_chamber_demands(run)[0], time_s))


def _table_demands(run: Run) -> Iterator[tuple[float, float, Event]]:
    """Yield (from, until, demand) of the axis that carries the unit; it ends when that axis is told another.

    Making the table safe ends every demand.
    """
    carrier = bench_file_from(run.manifest.bench).table.all_axes[-1].name
    told: list[tuple[float, Event]] = [
        (time_s, event)
        for time_s, event in run.lines
        if (isinstance(event, AngleDemand | RateDemand | HomeDemand) and event.axis == carrier)
        or (isinstance(event, SafeState) and event.device == "table")
    ]
    for (start_s, event), end_s in zip(told, [*(at for at, _ in told[1:]), _end_s(run)], strict=True):
        yield start_s, end_s, event


def _angle(run: Run) -> ChannelSeries | str:
    if "turntable" not in run.tables:
        return "the run has no table"
    parts, demands = [], []
    for start, end, demand in _table_demands(run):
        if not isinstance(demand, AngleDemand) or end - start < _LEAST_SPIN_S:
            continue
        table = run.turntable(("time_ns", "angle_deg", "rate_dps"), start, end)
        moving = np.flatnonzero(np.abs(table["rate_dps"]) > _AT_REST_DPS)
        first = max(int(moving[-1]) + 5 if len(moving) else 5, 5)
        at_s, angle = seconds(table)[first:], table["angle_deg"][first:].astype(np.float64)
        if len(at_s) < 2 * _SHORT:
            continue
        off = 3600.0 * np.remainder(angle - demand.angle_deg + 180.0, 360.0) - 648000.0
        middle_s, means = _stepped(at_s, off)
        parts.append(np.stack((middle_s, means, np.full(len(means), demand.angle_deg))))
        demands.append(Demand(float(at_s[0]), 0.0, math.inf))
    if not parts:
        return "the table was not held at any angle for half a minute"
    time_s, off, angle = np.concatenate(parts, axis=1)
    inputs = ChannelInputs(time_s, np.zeros(len(off)), float(off[0]), _STEP_S, tuple(demands), angle)
    raw = run.turntable(("angle_deg",))["angle_deg"].astype(np.float64) * 3600.0
    return _series(run, "table_angle", inputs, off, raw)


def _rate(run: Run) -> ChannelSeries | str:
    if "turntable" not in run.tables:
        return "the run has no table"
    parts = []
    for start, end, told in _table_demands(run):
        if not isinstance(told, RateDemand) or end - start < _LEAST_SPIN_S or told.rate_dps == 0.0:
            continue
        table = run.turntable(("time_ns", "angle_deg", "rate_dps"), start, end)
        rate = table["rate_dps"].astype(np.float64)
        steady = np.abs(np.diff(rate, prepend=0.0)) < 0.01 * abs(told.rate_dps)
        first = int(np.argmax(steady)) + 3
        kept = slice(first, len(rate) - 1)
        if len(rate[kept]) >= 2 * _SHORT:
            demand = np.full(len(rate[kept]), told.rate_dps)
            parts.append(np.stack((seconds(table)[kept], rate[kept], demand, table["angle_deg"][kept])))
    if not parts:
        return "the table was not turned at a steady rate for half a minute"
    time_s, rate, demand, angle = np.concatenate(parts, axis=1)
    inputs = ChannelInputs(time_s, demand, float(rate[0]), float(np.median(np.diff(time_s))), (), angle)
    return _series(run, "table_rate", inputs, rate, rate)


def _stamps(run: Run, gyro: str) -> ChannelSeries | str:
    if gyro not in run.manifest.stream or not run.has_arrivals(gyro):
        return "no arrival times of the gyro's stream"
    try:
        source = gyro_source(run.manifest, gyro)
    except ConfigurationError as error:
        return f"the stream cannot be decoded again: {error}"
    seen = run.arrivals(source)
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
    series = _series(run, "time_stamps", inputs, values, values)
    return replace(series, scatter=scatter, resolution=max(series.resolution, 1e-3))


def _late_fraction(seen: Arrivals, beyond_ms: Array) -> float:
    """Return the part of all frames that came late; a mark stands for every frame since the mark before."""
    frame_ms = 1e3 * seen.count_s * float(np.median(np.diff(seen.count)))
    frames = np.rint(1e3 * seen.count_s * np.diff(seen.count) / frame_ms)
    late = np.ceil((beyond_ms[1:] + (frames - 1.0) * frame_ms - _LATE_MS) / frame_ms)
    return float(np.clip(late, 0.0, frames).sum() / max(frames.sum(), 1.0))


def _stepped(time_s: Array, values: Array, step_s: float = _STEP_S) -> tuple[Array, Array]:
    """Return means over equal steps: their middles (m,) and values (m,), empty steps interpolated."""
    row = np.floor((time_s - time_s[0]) / step_s).astype(np.int64)
    count = int(row[-1])
    means = row_means(values, row, count)
    middle = time_s[0] + (np.arange(count) + 0.5) * step_s
    full = ~np.isnan(means)
    return middle, np.interp(middle, middle[full], means[full]) if full.any() else np.zeros(count)


def _end_s(run: Run) -> float:
    return max(line.time_s for line in run.lines)


def _series(
    run: Run,
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
        run.manifest.run_id,
        inputs,
        values,
        run.phase_at(inputs.time_s),
        np.ones(len(values), np.bool_) if quiet is None else quiet,
        resolution,
        run.checksum,
    )
