"""Impulses: now and then a sample or two stand far off their neighbours."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_RAD
from simulators.effects._disturbance import Disturbance, Draws, Finding, Record, SamplePath
from simulators.effects._effect import Parameter, Unit
from simulators.effects._stimulus import STEADY_DPS

_OUTLIER, _FAR = 5.0, 8.0
"""Standard deviations by which a sample must stand off its neighbours, itself or with the next one: where many
more do than chance has it, and where a few do.
"""
_CHANCE = 5.7e-7
"""Part of normal samples that are that far off, either way (5 standard deviations)."""
_KINDS = 1.5
"""All that is beyond a limit to single samples: of pairs alone noise has half as many as of those."""
_MANY = 1e-4
"""Probability of as many by chance, with tails as heavy as the record's own, from which they are impulses."""
_REACH = 5
"""How far away the samples are that one is held against, at most; the one next to it may hold a part of it."""
_NEAR = 41
_STAYS = 0.5
"""Part of an impulse's angle that must stay, in the median."""
_LEAST_NUMBER = 2
"""One sample off its neighbours, in hours, shows no process."""
_BY_CHANCE = 0.01
"""Probability below which it is no chance that the table turns wherever there is an impulse."""
_SAME_DPS, _SAME_DEG, _FEWEST_PAIRS = 0.05, 2.0, 3
"""Rate and angle of the table by which two samples are at the same place of a turn; fewest pairs that say so."""
_SAME_S = 3.0
"""Time by which what a run does may be earlier or later in its repeat."""


def _find(records: Sequence[Record]) -> Finding | None:
    """Find how many there are and how large they are; the samples that hold them go missing."""
    from scipy.stats import poisson  # here: a lab starts without scipy (decision 0021)

    off = [_off_neighbours(record) for record in records]
    number = sum(np.count_nonzero(_tops(sigmas) > _OUTLIER) for sigmas, _ in off)
    beyond = [sum(np.count_nonzero(sigmas[0] > level) for sigmas, _ in off) for level in (2.0, 3.0)]
    # from sigma to sigma tails fall by no less than the time before, heavy ones too
    tail = beyond[1] * (beyond[1] / max(beyond[0], 1)) ** (_OUTLIER - 3.0)
    chance = _KINDS * max(tail, _CHANCE * sum(len(record.stimulus) for record in records))
    least = _FAR if poisson.sf(number - 1, chance) > _MANY else _OUTLIER
    found = [_impulses(record, *each, least) for record, each in zip(records, off, strict=True)]
    if _at_angles(records, [at for at, _, _ in found]):
        still = [(_at_rest(record, each[0]), each[1]) for record, each in zip(records, off, strict=True)]
        found = [_impulses(record, *each, least) for record, each in zip(records, still, strict=True)]
    outputs: list[Array] = []
    sizes: list[float] = []
    places_s: list[Array] = []
    hours, stays = 0.0, list[float]()
    for record, (at, angle_arcsec, left_over) in zip(records, found, strict=True):
        places_s.append(np.asarray(at * record.stimulus.period_s, np.float64))
        hours += len(record.stimulus) * record.stimulus.period_s / 3600.0
        sizes += angle_arcsec
        stays += left_over
        output = record.output_dph
        if len(at):
            output = output.copy()
            output[at] = np.nan
        outputs.append(output)
    if len(sizes) < _LEAST_NUMBER or float(np.median(stays)) < _STAYS:
        return None
    if _come_again(records, places_s) or _with_turns(records, places_s):
        return None
    rate, size = len(sizes) / hours, float(np.sqrt(np.mean(np.square(sizes))))
    root = math.sqrt(len(sizes))
    words = (
        f"{len(sizes)} in {hours:.1f} h, {size:.3g} arcsec rms, largest {max(sizes, key=abs):.3g} arcsec; "
        "these samples are left out"
    )
    return Finding((rate, size), (rate / root, size / root), words, tuple(outputs))


def _with_turns(records: Sequence[Record], places_s: Sequence[Array]) -> bool:
    """Return whether all come while the table turns as fast as it seldom does: then table or logger bring them.

    What comes by chance comes at rest, too. `places_s` are samples off their neighbours, by record.
    """
    speeds = [np.abs(record.stimulus.table_rate_dps) for record in records]
    at = [
        speed[np.rint(own_s / record.stimulus.period_s).astype(np.int64)]
        for record, speed, own_s in zip(records, speeds, places_s, strict=True)
    ]
    slowest = float(np.concatenate(at).min(initial=math.inf))
    part = float(np.mean(np.concatenate(speeds) >= slowest - STEADY_DPS))
    return part ** sum(map(len, at)) < _BY_CHANCE


def _at_angles(records: Sequence[Record], places: Sequence[NDArray[np.int64]]) -> bool:
    """Return whether samples off their neighbours share the table's angle in more pairs than chance has.

    What the table does in a turn it does in the next: a wobble of which a fast turn has few samples. Pairs are of
    one run, rate and sense of turning.
    """
    from scipy.stats import poisson  # here: a lab starts without scipy (decision 0021)

    pairs, chance = 0, 0.0
    for record, at in zip(records, places, strict=True):
        angle, rate = record.stimulus.angle_deg[:-1], record.stimulus.table_rate_dps
        for speed in np.unique(rate[at].round(1)):
            own = angle[at[np.abs(rate[at] - speed) < _SAME_DPS]]
            if abs(speed) <= STEADY_DPS or len(own) < 2:
                continue
            every = angle[np.abs(rate - speed) < _SAME_DPS]
            alike = [_near(own, value) for value in own]
            chance += 0.5 * (len(own) - 1) * sum(float(_near(every, value).mean()) for value in own)
            pairs += (sum(int(same.sum()) for same in alike) - len(own)) // 2
    return bool(poisson.sf(pairs - 1, chance) < _BY_CHANCE) and pairs >= _FEWEST_PAIRS


def _near(angle_deg: Array, value_deg: float) -> NDArray[np.bool_]:
    """Return which angles are the same place of the table, (m,)."""
    return np.asarray(np.abs((angle_deg - value_deg + 180.0) % 360.0 - 180.0) < _SAME_DEG)


def _at_rest(record: Record, sigmas: Array) -> Array:
    """Return `sigmas` (2, n) where the table does not turn, 0 elsewhere."""
    return np.asarray(np.where(np.abs(record.stimulus.table_rate_dps) > STEADY_DPS, 0.0, sigmas))


def _come_again(records: Sequence[Record], places_s: Sequence[Array]) -> bool:
    """Return whether most come at the same time of other runs as long: what the run does brings them, not chance.

    `places_s` are samples off their neighbours, by record.
    """
    lengths_s = [len(record.stimulus) * record.stimulus.period_s for record in records]
    again, chance, number = 0, 0.0, 0
    for place, own_s in enumerate(places_s):
        others = [
            k
            for k, length_s in enumerate(lengths_s)
            if k != place and abs(length_s / lengths_s[place] - 1.0) < 0.01
        ]
        if not others:
            continue
        theirs_s = np.concatenate([places_s[k] for k in others])
        again += sum(bool((np.abs(theirs_s - at_s) <= _SAME_S).any()) for at_s in own_s.tolist())
        chance += len(own_s) * -math.expm1(-len(theirs_s) * 2.0 * _SAME_S / lengths_s[place])
        number += len(own_s)
    return again > chance + max(0.5 * number, 3.0)


def _off_neighbours(record: Record) -> tuple[Array, Array]:
    """Return how far each sample, and each with the next one, is off those about it, in sigmas and deg/h, (2, n).

    0 sigmas where the table does not turn steadily.
    """
    rest = record.output_dph - record.stimulus.input_rate_dph
    n = len(rest)
    if n < 4 * _REACH:
        return np.zeros((2, n)), np.zeros((2, n))
    # all neighbours with the table's rate the same
    still = np.ones(n, dtype=bool)
    for values, least in (
        (record.stimulus.table_rate_dps, STEADY_DPS),
        (record.stimulus.elevation_deg, 0.01),
    ):
        near = [np.roll(values, k) for k in range(-_REACH - 1, _REACH + 2)]
        still &= np.max(near, axis=0) - np.min(near, axis=0) < least
    still[: _REACH + 1] = still[-_REACH - 1 :] = False
    means = (rest, 0.5 * (rest + np.roll(rest, -1)))
    off = np.stack([_off(own, rest, width) for width, own in enumerate(means, start=1)])
    return np.abs(np.stack([_scaled(own, still) for own in off])), off


def _off(values: Array, rest: Array, width: int) -> Array:
    """Return by how much `values`, means of `width` samples from each on, are off the samples about them, (n,).

    A mean of eight is quiet: against the two next to it an impulse would have to be a fifth larger to stand out
    of white noise; those hold a part of it and are left out. 0 where both sides are apart by more: there the
    level steps. NaN where half of the eight are missing.
    """
    known = np.isfinite(rest)
    filled = np.where(known, rest, 0.0)
    sides = [range(-_REACH, -1), range(width + 1, width + _REACH)]
    counts = [np.sum([np.roll(known, -k) for k in side], axis=0) for side in sides]
    totals = [np.sum([np.roll(filled, -k) for k in side], axis=0) for side in sides]
    count = counts[0] + counts[1]
    off = np.where(count >= _REACH, values - (totals[0] + totals[1]) / np.maximum(count, 1), np.nan)
    left, right = (total / np.maximum(own, 1) for total, own in zip(totals, counts, strict=True))
    steps = (np.minimum(*counts) > 0) & (np.abs(left - right) > np.abs(off))
    return np.asarray(np.where(steps, 0.0, off))


def _tops(off: Array) -> Array:
    """Return how far off each sample is that is farther off than those about it, (m,)."""
    from scipy.ndimage import maximum_filter1d  # here: a lab starts without scipy (decision 0021)

    most = off.max(axis=0, initial=0.0)
    return np.asarray(most[most == maximum_filter1d(most, 7)])


def _impulses(
    record: Record, sigmas: Array, off: Array, least: float
) -> tuple[NDArray[np.int64], list[float], list[float]]:
    """Return the samples that hold impulses, the angle of each in arcsec (deg/h times s), and what of it stays.

    One or two samples that are `off` by at `least` so many standard deviations, `sigmas`. What stays is the part
    that the samples next to them do not take back.
    """
    rest = record.output_dph - record.stimulus.input_rate_dph
    marks: list[int] = []
    taken: list[float] = []
    stays: list[float] = []
    left = sigmas.copy()
    while left.size:
        kind, k = np.unravel_index(int(left.argmax()), left.shape)
        if not left[kind, k] > least or len(taken) > len(rest) // 50:
            break
        own = [int(k)] if kind == 0 else [int(k), int(k) + 1]
        taken.append(len(own) * float(off[kind, k]) * record.stimulus.period_s)
        marks += own
        stays.append(_stays(rest, own))
        left[:, max(own[0] - 3, 0) : own[-1] + 4] = 0.0
    return np.array(sorted(marks), dtype=np.int64), taken, stays


def _stays(rest: Array, own: Sequence[int]) -> float:
    """Return the part of the angle of samples off their neighbours that the sample on either side leaves.

    1 of a shock or a lost count; -1 where an angle is read wrong once, as coarse steps do: it comes back.
    """
    first, last = own[0], own[-1]
    about = np.concatenate(
        (rest[max(first - _NEAR // 2, 0) : first - 1], rest[last + 2 : last + 1 + _NEAR // 2])
    )
    about = about[np.isfinite(about)]
    centre = float(np.median(about)) if len(about) else 0.0
    angle = float(np.sum(rest[first : last + 1] - centre))
    return float(np.nansum(rest[first - 1 : last + 2] - centre)) / angle if angle else 0.0


def _scaled(values: Array, still: NDArray[np.bool_]) -> Array:
    """Return values over their robust standard deviation, in the run and about each sample, whichever is larger.

    0 where the table does not turn steadily.
    """
    from scipy.ndimage import median_filter  # here: a lab starts without scipy (decision 0021)

    use = still & ~np.isnan(values)
    if use.sum() < 32:
        return np.zeros(len(values))
    centre = float(np.median(values[use]))
    away = np.abs(values[use] - centre)
    # the 95 % point beside the median: noise in steps may have a median of nothing
    sigma = max(float(np.median(away)) / 0.6745, float(np.quantile(away, 0.95)) / 1.96)
    # where the run is unquiet (a harmonic of a fast turn) its own neighbourhood counts
    near = median_filter(np.where(use, np.abs(values - centre), 0.0), _NEAR, mode="reflect") / 0.6745
    return np.where(use, (values - centre) / np.maximum(max(sigma, 1e-12), near), 0.0)


class _Impulses:
    """Steps of angle at random times (Poisson, at most one a second), either way up, all of one size."""

    def __init__(self, values: Sequence[float], draws: Draws) -> None:
        per_h, size_arcsec = values
        self._chance = per_h / 3600.0
        self._size_rad = size_arcsec * ARCSEC_RAD
        self._drawn, self._when = draws.uniform(0), draws.uniform(1)

    def __call__(self, path: SamplePath) -> Array:
        """Return what they add to the angle increments, rad (n,)."""
        edges_s = path.edges_s
        result = np.zeros(len(edges_s) - 1)
        first = int(edges_s[0])
        count = int(edges_s[-1]) - first + 1
        drawn = self._drawn(first, count)
        hits = np.flatnonzero(np.abs(drawn) < 0.5 * self._chance)
        times = first + hits + 0.5 + self._when(first, count)[hits]
        at = np.searchsorted(edges_s, times, side="right") - 1
        inside = (at >= 0) & (at < len(result))
        np.add.at(result, at[inside], np.sign(drawn[hits[inside]]) * self._size_rad)
        return result


IMPULSES = Disturbance(
    "impulses",
    (
        Parameter("impulses_per_h", 0.0, 3600.0, Unit("1/h")),
        Parameter("impulse_arcsec", 0.0, 1e5, Unit("arcsec")),
    ),
    "outliers of single samples against their neighbours",
    "Now and then a sample or two stand far off their neighbours: shocks, lost counts, interference.",
    _find,
    _Impulses,
)
