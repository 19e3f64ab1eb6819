"""Clocks of gyro, table and bench: a change of rate comes early or late, samples come too often or too seldom."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._channel import ChannelEffect, ChannelInputs, Values
from simulators.effects._effect import PPM, Effect, Input, Parameter, Shape, Unit
from simulators.effects._stimulus import Stimulus

_LONGEST, _STEADY, _WITHIN_ONE = 3, 0.005, 2
"""Samples of a change of rate that is looked at as one, part of it that is none; edges of one within a sample."""
_SIDES: tuple[Shape, ...] = tuple({"side": side} for side in (0.0, 0.5, -0.5, 1.0, -1.0))


def _change(s: Stimulus, shape: Shape) -> Array:
    """Return rate at the end less rate at the start of each sample.

    Side 0.5 has changes of rate begin at samples' edges, -0.5 has them end there, 0 is for a smooth rate; a step
    right at an edge moves into the sample before if samples are late (side 1), into the one after if early (side
    -1). Where the rate at the edges is known there is nothing to choose.
    """
    if s.edge_rate_dps is not None:
        return np.asarray(3600.0 * np.diff(s.edge_rate_dps) * np.sin(np.radians(s.elevation_deg)))
    side = min(max(shape["side"], -1.0), 1.0)
    edges = s.once("rates at edges", lambda: _edges(s.input_rate_dph))
    weights = np.array([np.interp(side, (-1.0, -0.5, 0.0, 0.5, 1.0), row) for row in np.eye(5)])
    return np.diff(np.einsum("i,ij->j", weights, edges))


def _edges(rate: Array) -> Array:
    """Return the rate at samples' edges if its changes begin or end there, or it is smooth, (5, n + 1).

    A change from one steady rate to another within one sample has these at its ends, wherever it begins and ends.
    Within two or three it is of constant acceleration where the rate is smooth; a servo that creeps to its rate
    is nearer to changes that begin, or end, at edges.
    """
    forward, backward = _edge_values(rate), _edge_values(rate[::-1])[::-1]
    late = np.append(rate, rate[-1])
    early = np.insert(rate, 0, rate[0])
    edges = np.stack((early, backward, _smooth_edges(rate), forward, late))
    for first, values in _transitions(rate):
        forms = slice(1, 4) if len(values) == _WITHIN_ONE else slice(2, 3)
        edges[forms, first : first + len(values)] = values
    return edges


def _transitions(means: Array) -> Iterator[tuple[int, list[float]]]:
    """Yield each change of a few samples between steady means (n,): its first edge, and the values at its edges.

    In one sample it has both steady values at its edges. Of constant acceleration, of which the mean of a part of
    a sample goes with the square of the value at its inner edge, in two and three the inner edges follow.
    """
    step = np.diff(means)
    size = np.abs(step)
    # what is small beside the changes about it is steady: codes of an angle, a servo's ripple
    wide = np.pad(size, _LONGEST, mode="edge")
    largest = np.lib.stride_tricks.sliding_window_view(wide, 2 * _LONGEST + 1).max(axis=1)
    moving = size > np.maximum(_STEADY * largest, 1e-9)
    ends = np.flatnonzero(np.diff(np.concatenate(([False], moving, [False])).astype(np.int8)))
    for start, stop in ends.reshape(-1, 2).tolist():
        inner = stop - start - 1
        if not 1 <= inner <= _LONGEST or start == 0 or stop == len(step):
            continue
        before, after = float(means[start]), float(means[stop])
        if before == after:
            continue
        # from 0 to 1
        parts = [(float(each) - before) / (after - before) for each in means[start + 1 : stop]]
        if not all(0.0 <= part <= 1.0 for part in parts):
            continue
        if inner == 1:
            inside: list[float] = []
        elif inner == 2:
            low, high = math.sqrt(parts[0]), math.sqrt(1.0 - parts[1])
            inside = [low / (low + high) if low + high > 0.0 else 0.5]
        else:
            reach = parts[1] + 2.0 * parts[0]
            grows = 2.0 * (reach - math.sqrt(max(reach**2 - parts[1] ** 2, 0.0)))
            inside = [min(max(parts[1] + side * grows, 0.0), 1.0) for side in (-0.5, 0.5)]
        yield start + 1, [before, *(before + part * (after - before) for part in inside), after]


def _smooth_edges(means: Array) -> Array:
    """Return values at the edges (n + 1,) of a smooth signal from its means (n,), never beyond both neighbours.

    Fourth order: Colella and Woodward, J. Comput. Phys. 54, 1984, eq. 1.9.
    """
    wide = np.pad(means, 2, mode="edge")
    left, right = wide[1:-2], wide[2:-1]
    edges = (7.0 * (left + right) - wide[:-3] - wide[3:]) / 12.0
    return np.asarray(np.clip(edges, np.minimum(left, right), np.maximum(left, right)))


def _edge_values(means: Array) -> Array:
    """Return values at the edges (n + 1,) of a signal linear in each sample from its means (n,), left to right.

    A value that overshoots the neighbouring samples is cut: there the slope changes inside the sample.
    """
    edges = np.append(means[:1], means)
    value = float(means[0])
    moving = np.flatnonzero(means[1:] != means[:-1])
    for k in np.unique(np.concatenate((moving, moving + 1)).clip(0, len(means) - 2)).tolist():
        here, following = float(means[k]), float(means[k + 1])
        if k and means[k - 1] == here:
            value = here
        value = min(max(2.0 * here - value, min(here, following)), max(here, following))
        edges[k + 1] = value
    return edges


def _time_offset(s: Stimulus, shape: Shape) -> Array:
    if s.over_offset_dph is not None:
        return s.over_offset_dph
    return np.asarray(1e-3 / s.period_s * _change(s, shape))


def _clock_skew(s: Stimulus, shape: Shape) -> Array:
    since = (s.time_s - s.time_s[0]) / s.period_s
    return np.asarray(1e-6 * (since * _change(s, shape)))


SAMPLE_TIME_EFFECTS = (
    Effect(
        "time_offset",
        (Parameter("offset_ms", -2000.0, 2000.0, Unit("ms")),),
        _time_offset,
        Input.CLOCKS,
        "change of rate",
        "sample time and table telemetry on different clocks",
        "The gyro's samples are early or late against the table's telemetry.",
        _SIDES,
    ),
    Effect(
        "clock_skew",
        (Parameter("skew_ppm", -1e4, 1e4, PPM),),
        _clock_skew,
        Input.CLOCKS,
        "change of rate, growing with time",
        "clocks of different rate",
        "The gyro's clock runs fast or slow against the bench's.",
        _SIDES,
    ),
)
SAMPLE_CLOCK_SKEW = ChannelEffect(
    "sample_clock_skew",
    "time_stamps",
    (Parameter("skew_ppm", -1e5, 1e5, PPM),),
    (0.0,),
    "time in the run",
    "oscillator's data sheet",
    "The gyro's sample clock is fast (positive) or slow against the bench's.",
    emulated_by="sample_clock",
)


def time_stamps(inputs: ChannelInputs, values: Values) -> Array:
    """Arrival of the earliest sample of each second against its own count at the nominal rate, mean 0, ms."""
    (skew_ppm,) = SAMPLE_CLOCK_SKEW.of(values)
    since_s = inputs.time_s - inputs.time_s.mean()
    return np.asarray(inputs.drive - 1e-3 * skew_ppm * since_s)
