"""The curve of output against input rate at its ends: a limit, and a band about zero without output.

Each is a candidate only where the record shows it plainly: where output and input rate part by far more than any
slope. Whether it is the cause is then a matter of evidence like that of every other effect.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array
from simulators.effects._effect import Effect, Input, Parameter, Shape, SlowRates, Unit
from simulators.effects._stimulus import Stimulus

_SHARE = Unit("share")
_MOST = 1.2
"""Bound of the part of the formula that is there; 1 is all of it."""
_SURELY = 2.0
"""Standard deviations below nothing from which on it is less than nothing."""
_LEAST_CUT = 0.004
"""Part of the rate that must be missing beyond a limit; nobody's scale factor bends so much so suddenly."""
_LEANS = (-0.05, 0.0, 0.05)
"""Parts by which limits of both senses differ from their mean; at the ends one sense alone is cut."""
_LOW_SLOPE = 0.6
_TRIES = 48
_CLEAR = 6.0
_LEAST_LIMIT_DPS = 2.0
_HIGHEST_BAND_DPH = 360.0
_LEAST_EDGE = 0.3
"""Part of a band that blocks show from which its edge is looked for in single samples."""


def _saturation(s: Stimulus, shape: Shape) -> Array:
    """Return what is cut off; over `softness` times the limit the slope goes from one to nothing.

    An output whose zero is not in the middle of its range stops at other rates in both senses: `lean` is the part
    by which the limit of positive rates is larger, and that of negative ones smaller.
    """
    limit_dph = 3600.0 * shape["limit_dps"] * (1.0 + shape.get("lean", 0.0) * np.sign(s.input_rate_dph))
    width = max(shape.get("softness", 0.0), 1e-6) * limit_dph
    beyond = width * np.logaddexp(0.0, (np.abs(s.input_rate_dph) - limit_dph) / width)
    return np.asarray(-np.sign(s.input_rate_dph) * beyond)


def _dead_zone(s: Stimulus, shape: Shape) -> Array:
    """Return what is lost: all within the band, or with `softness` a part that falls off about its edge."""
    beyond = np.abs(s.input_rate_dph) / shape["band_dph"] - 1.0
    lost = 0.5 - 0.5 * np.tanh(0.5 * beyond / max(shape.get("softness", 0.0), 1e-6))
    return np.asarray(-s.input_rate_dph * lost)


def _lock_in(s: Stimulus, shape: Shape) -> Array:
    return np.asarray(_beat(s.input_rate_dph, shape["lock_dph"]) - s.input_rate_dph)


def _takes_away(values: Array, covariance: Array) -> bool:
    """Return whether a part of the rate may be missing: a limit or a band takes away and adds nothing."""
    return bool(values[0] > -_SURELY * math.sqrt(covariance[0, 0]))


def _without_band(rate: Array, band: float) -> Array:
    return np.where(np.abs(rate) < band, 0.0, rate)


def _beat(rate: Array, lock: float) -> Array:
    return np.asarray(np.sign(rate) * np.sqrt(np.maximum(rate**2 - lock**2, 0.0)))


def _grid(key: str, size: float | None) -> tuple[Shape, ...]:
    """Return a short grid about a size read off the record; nothing without one."""
    return () if size is None else tuple({key: part * size} for part in (0.97, 1.0, 1.03))


def _limits(rates: SlowRates) -> list[Shape]:
    """Return limits below the highest rates that occur, hard and soft, and about one that shows plainly."""
    levels = np.unique(np.round(np.abs(rates.rate) / 3600.0, 1))
    if len(levels) < 4 or levels[-1] < _LEAST_LIMIT_DPS:
        return []
    plain = [{**shape, "softness": 0.0, "lean": 0.0} for shape in _grid("limit_dps", _limit_dps(rates))]
    parts = (0.4, 0.55, 0.7, 0.8, 0.9, 0.97)
    return [
        *plain,
        *(
            {"limit_dps": part * float(levels[-1]), "softness": soft, "lean": lean}
            for part in parts
            for soft in (0.003, 0.03)
            for lean in ((0.0,) if plain else _LEANS)  # both senses stop plainly at one
        ),
    ]


def _bands(rates: SlowRates) -> list[Shape]:
    """Return bands about the lowest rates that occur, hard and soft, and about one that shows plainly."""
    speed = np.abs(rates.rate)
    levels = _levels(speed[speed < _HIGHEST_BAND_DPH])
    band_dph = _band_dph(rates, _between, _without_band)
    edge_dph = None if band_dph is None else _edge_dph(rates, band_dph)
    plain: list[Shape] = [{**shape, "softness": 0.0} for shape in _grid("band_dph", edge_dph)]
    if len(levels) < 2:
        return plain
    sizes = np.geomspace(0.5 * levels[0], min(2.0 * levels[-1], _HIGHEST_BAND_DPH), 8).tolist()
    return [*plain, *({"band_dph": size, "softness": soft} for size in sizes for soft in (0.02, 0.4))]


def _limit_dps(rates: SlowRates) -> float | None:
    """Return the rate at which the output stops, deg/s; None where it follows the fastest input rates."""
    speed, output = np.abs(rates.rate), np.abs(rates.output)
    if not len(speed):
        return None
    fastest = speed >= 0.98 * speed.max()
    limit = float(np.median(output[fastest]))
    below = (speed < 0.9 * limit) & (speed > 0.05 * limit)
    if limit <= 0.0 or below.sum() < 3:
        return None
    slope = float(np.median(output[below] / speed[below]))
    scatter = 1.4826 * float(np.median(np.abs(output[fastest] - limit)))
    cut = slope * float(np.median(speed[fastest])) - limit
    plain = cut > max(_LEAST_CUT * limit, 5.0 * abs(slope - 1.0) * limit, _CLEAR * scatter)
    # a bend would show below the limit already
    bent = float(np.quantile(np.abs(output[below] - slope * speed[below]) / speed[below], 0.9))
    return limit / 3600.0 if plain and bent < 0.25 * cut / limit else None


def _band_dph(
    rates: SlowRates, tries: Callable[[Array, float], Array], answer: Callable[[Array, float], Array]
) -> float | None:
    """Return the band, deg/h, whose answer leaves the least energy in slow rates, run means taken out.

    `tries` gives bands from levels of rate and the highest at which the output may stand still; None if it never
    does.
    """
    speed = np.abs(rates.rate)
    levels = _levels(speed)
    standing = [size for size in levels.tolist() if _stands(rates, speed <= size)]
    if not standing:
        return None
    highest = _above(speed, standing[-1])
    tried = tries(levels, highest)
    near = np.abs(rates.rate) < 20.0 * highest
    few = SlowRates(rates.rate[near], rates.output[near], rates.run[near])
    every = np.ones(len(few.rate), dtype=bool)
    rests = [few.apart(few.output - answer(few.rate, band), every) for band in tried.tolist()]
    return float(tried[int(np.argmin([float(rest @ rest) for rest in rests]))])


def _edge_dph(rates: SlowRates, band_dph: float) -> float:
    """Return where a band about as wide as `band_dph` ends, deg/h, by every sample of the records.

    A band takes the rate itself off each sample within: of all bands, from sums over the samples in the order of
    their speed, that which leaves the least energy.
    """
    speeds, gains = [], []
    for s, rest in rates.records:
        speed = np.abs(s.input_rate_dph)
        offset = np.nanmean(rest + np.where(speed < band_dph, s.input_rate_dph, 0.0))
        near = (speed < 20.0 * band_dph) & ~np.isnan(rest)
        speeds.append(speed[near])
        gains.append((s.input_rate_dph * (s.input_rate_dph + 2.0 * (rest - offset)))[near])
    speed, gain = np.concatenate(speeds), np.concatenate(gains)
    order = np.argsort(speed)
    ordered, left = speed[order], np.cumsum(gain[order])
    # a band ends between two speeds: samples of one speed are all within or all beyond
    ends = np.flatnonzero((np.diff(ordered) > 1e-9 * ordered[-1]) & (ordered[1:] > _LEAST_EDGE * band_dph))
    if not len(ends) or left[ends].min() >= 0.0:
        return band_dph
    last = int(ends[np.argmin(left[ends])])
    return float(0.5 * (ordered[last] + min(ordered[last + 1], 1.5 * ordered[last])))


def _levels(speed: Array) -> Array:
    """Return sizes of the input rate, just above those that occur, at which a band may end, smallest first."""
    levels = np.unique(np.round(speed[speed > 0.05], 1)) + 0.1
    return levels if len(levels) <= _TRIES else np.quantile(levels, np.linspace(0.0, 1.0, _TRIES))


def _between(levels: Array, highest: float) -> Array:
    """Return bands halfway between levels up to the highest; where rates are far apart, close to the lower."""
    following = np.append(levels[1:], highest)
    return np.asarray(0.5 * (levels + np.minimum(following, 1.5 * levels))[levels <= highest])


def _locks(levels: Array, highest: float) -> Array:
    return np.geomspace(0.5 * levels[0], highest, _TRIES)


def _above(speed: Array, size: float) -> float:
    """Return the next rate above a size, at most three times it: the band ends somewhere between."""
    higher = speed[speed > 1.05 * size]
    return min(float(higher.min()), 3.0 * size) if len(higher) else 1.5 * size


def _stands(rates: SlowRates, use: NDArray[np.bool_]) -> bool:
    """Return whether the output hardly follows the input rate in blocks that differ in it enough to tell."""
    if use.sum() < 8:
        return False
    rate, output = rates.apart(rates.rate, use)[use], rates.apart(rates.output, use)[use]
    power = float(rate @ rate)
    if power <= 0.0:
        return False
    slope = float(rate @ output) / power
    rest = output - slope * rate
    # blocks of one level share what is wrong with it: few of them count as independent
    sigma = float(np.sqrt(rest @ rest / power / max(len(rest) / 8.0, 2.0)))
    return abs(slope) < _LOW_SLOPE and _CLEAR * sigma < 1.0 - abs(slope)


LIMIT_EFFECTS = (
    Effect(
        "saturation",
        (Parameter("cut_share", 0.0, _MOST, _SHARE),),
        _saturation,
        Input.RATE,
        "rate beyond a limit",
        "IEEE Std 952, maximum input rate",
        "Output stays at a limit however fast the unit turns.",
        ({"limit_dps": 100.0, "softness": 0.0, "lean": 0.0},),
        propose=_limits,
        possible=_takes_away,
    ),
    Effect(
        "dead_zone",
        (Parameter("lost_share", 0.0, _MOST, _SHARE),),
        _dead_zone,
        Input.RATE,
        "rate about zero",
        "IEEE Std 528, dead band",
        "Small rates give no output.",
        ({"band_dph": 10.0, "softness": 0.0},),
        propose=_bands,
        possible=_takes_away,
    ),
    Effect(
        "lock_in",
        (Parameter("locked_share", 0.0, _MOST, _SHARE),),
        _lock_in,
        Input.RATE,
        "rate about zero",
        "Aronowitz, The Laser Gyro, 1971: the beat of two coupled beams is the root of rate^2 - lock-in^2",
        "Small rates give no output and those a little larger too little: the beams lock.",
        ({"lock_dph": 10.0},),
        propose=lambda rates: _grid("lock_dph", _band_dph(rates, _locks, _beat)),
        possible=_takes_away,
    ),
)
