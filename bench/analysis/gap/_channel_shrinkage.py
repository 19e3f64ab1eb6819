"""How far a channel's gap shrinks on held-out runs."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import t as student

from bench.analysis.gap._channel_cells import band_name, channel_cells, channel_places
from bench.analysis.gap._channel_data import ChannelSeries
from bench.analysis.gap._channel_fit import ChannelFit, channel_rests
from bench.analysis.gap._channel_floor import ChannelFloor
from bench.analysis.gap._findings import Shrinkage
from drivers.base.arrays import Array
from simulators.effects import ChannelEffect

_TWO_SIDED = 1.96


def judge_channel(
    held_out: Sequence[ChannelSeries],
    diagnosed: Sequence[ChannelSeries],
    effects: Sequence[ChannelEffect],
    floor: ChannelFloor,
    nominal: ChannelFit,
    best: ChannelFit,
) -> Shrinkage:
    """Judge the fitted values on runs that took no part; energy in squares of the channel's unit.

    The interval has the noise, and what a formula's misfit and a run's own parameters do: by how much the share
    differs from run to run, those diagnosed among them, with Student's factor for so few.
    """
    cells = channel_cells(held_out, floor)
    places = channel_places(cells, cells.whitened(channel_rests(cells.series, effects, nominal.values)))
    clear = {(place.part, place.band) for place in places if place.clear}
    runs = [_energies(each, effects, floor, nominal, best, clear) for each in (*held_out, *diagnosed)]
    before, after, variance = np.sum(runs[: len(held_out)], axis=0).tolist()
    if before <= 0.0:
        return Shrinkage(math.nan, math.nan, math.nan, 0.0, 0.0)
    shares = [1.0 - max(own[1], 0.0) / own[0] for own in runs if own[0] > 0.0]
    noise = _TWO_SIDED * math.sqrt(variance) / before
    if len(shares) > 1:
        factor = float(student.ppf(0.975, len(shares) - 1)) / math.sqrt(len(held_out))
        noise = math.hypot(noise, factor * float(np.std(shares, ddof=1)))
    # what is left cannot be less than the floor: by as much as it seems so, the floor is not known
    noise = math.hypot(noise, _TWO_SIDED * max(-after, 0.0) / before)
    count = sum(piece.stop - piece.start for each in held_out for _, piece in each.pieces())
    rms_before, rms_after = (math.sqrt(max(each, 0.0) / count) for each in (before, after))
    share = 1.0 - max(after, 0.0) / before
    active = tuple(place.clear for place in places)
    return Shrinkage(share, share - noise, min(share + noise, 1.0), rms_before, rms_after, active=active)


def _energies(
    series: ChannelSeries,
    effects: Sequence[ChannelEffect],
    floor: ChannelFloor,
    nominal: ChannelFit,
    best: ChannelFit,
    clear: set[tuple[str, str]],
) -> Array:
    """Return a run's energy above the floor in clear cells, before and after, and the latter's variance, (3,)."""
    cells = channel_cells([series], floor)
    first, then = (
        cells.whitened(channel_rests(cells.series, effects, fit.values)) for fit in (nominal, best)
    )
    number = cells.sums(np.ones(len(first)))
    power = cells.sums(cells.floor) / number
    before, after = ((cells.sums(each**2) - number) * power for each in (first, then))
    noise = 2.0 * number + 4.0 * np.maximum(after / power, 0.0)
    on = np.array([(phase, band_name(band)) in clear for phase, band in cells.names], dtype=bool)
    return np.asarray(np.stack((before, after, noise * power**2))[:, on].sum(axis=1))
