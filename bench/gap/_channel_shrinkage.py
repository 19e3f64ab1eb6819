"""How far a channel's gap shrinks on held-out runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.gap._channel_cells import band_name, channel_cells, channel_places
from bench.gap._channel_data import ChannelSeries
from bench.gap._channel_fit import ChannelFit, channel_rests
from bench.gap._channel_floor import ChannelFloor
from bench.gap._where import SIGNIFICANT
from simulators.effects import ChannelEffect

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ChannelShrinkage:
    """Part of the reducible gap that is gone on held-out runs, its 95 % interval, and sizes above the floor."""

    share: float
    low: float
    high: float
    rms_before: float
    rms_after: float


def judge_channel(
    held_out: Sequence[ChannelSeries],
    effects: Sequence[ChannelEffect],
    floor: ChannelFloor,
    nominal: ChannelFit,
    best: ChannelFit,
) -> ChannelShrinkage:
    """Judge the fitted values on runs that took no part; energy in squares of the channel's unit.

    The interval has the noise, and what a formula's misfit does: runs and phases in which another part of the gap
    is left say how well the share of all is known (ratio of sums over clusters; Cochran, Sampling Techniques,
    1977, 6.3).
    """
    cells = channel_cells(held_out, floor)
    places = channel_places(cells, cells.whitened(channel_rests(cells.series, effects, nominal.values)))
    clear = {(place.phase, place.band) for place in places if place.p_value < SIGNIFICANT}
    parts = [_parts(each, effects, floor, nominal, best, clear) for each in held_out]
    before, after, variance = np.concatenate(parts, axis=1)
    total = float(before.sum())
    if total <= 0.0:
        return ChannelShrinkage(math.nan, math.nan, math.nan, 0.0, 0.0)
    left = float(after.sum()) / total
    apart = float(((after - left * before) ** 2).sum())
    clusters = int((before > 0.0).sum())
    sigma = math.sqrt(float(variance.sum()) + apart * clusters / max(clusters - 1, 1)) / total
    count = sum(piece.stop - piece.start for each in held_out for _, piece in each.pieces())
    sizes = [math.sqrt(max(float(each.sum()), 0.0) / count) for each in (before, after)]
    share = 1.0 - left
    return ChannelShrinkage(share, share - 1.96 * sigma, min(share + 1.96 * sigma, 1.0), *sizes)


def _parts(
    series: ChannelSeries,
    effects: Sequence[ChannelEffect],
    floor: ChannelFloor,
    nominal: ChannelFit,
    best: ChannelFit,
    clear: set[tuple[str, str]],
) -> Array:
    """Return a run's energy above the floor before and after, and the latter's variance, by phase, (3, p)."""
    cells = channel_cells([series], floor)
    first, then = (
        cells.whitened(channel_rests(cells.series, effects, fit.values)) for fit in (nominal, best)
    )
    number = cells.sums(np.ones(len(first)))
    power = cells.sums(cells.floor) / number
    before, after = ((cells.sums(each**2) - number) * power for each in (first, then))
    noise = 2.0 * number + 4.0 * np.maximum(after / power, 0.0)
    on = np.array([(phase, band_name(band)) in clear for phase, band in cells.names], dtype=np.float64)
    rows = np.stack((before, after, noise * power**2)) * on
    phases = list(dict.fromkeys(phase for phase, _ in cells.names))
    at = np.array([phases.index(phase) for phase, _ in cells.names])
    return np.stack([np.bincount(at, row, len(phases)) for row in rows])
