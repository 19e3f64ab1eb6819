"""Limits and dead bands read off the records: where output and input rate part by far more than any slope.

Only what the record shows plainly becomes a candidate; whether it is the cause is then a matter of evidence like
that of every other effect.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._data import GapRun
from drivers.base.arrays import Array
from simulators.effects import Effect, Variant

_BLOCK = 20
"""Samples that are averaged, at one rate."""
_STEADY = 1e-3
"""Part of a block's rate by which it may change in the block, or 0.5 deg/h."""
_LEAST_CUT = 0.004
"""Part of the rate that must be missing beyond a limit; nobody's scale factor bends so much so suddenly."""
_LOW_SLOPE = 0.6
_TRIES = 48
_GRID = (0.97, 1.0, 1.03)
_CLEAR = 6.0


def proposed_variants(effects: Sequence[Effect], runs: Sequence[GapRun]) -> list[Variant]:
    """Return the variants of `proposed` effects that the runs show plainly, on a short grid about their shape."""
    own = [effect for effect in effects if effect.proposed]
    if not own:
        return []
    blocks = _blocks(runs)
    variants: list[Variant] = []
    for effect in own:
        size = _PLAIN[effect.name](blocks) if effect.name in _PLAIN else None
        if size is None:
            continue
        (key,) = effect.shapes[0]
        shapes: tuple[Mapping[str, float], ...] = tuple({key: part * size} for part in _GRID)
        variants += replace(effect, shapes=shapes).variants()
    return variants


class _Blocks:
    """Means over blocks at one rate: input and output rate in deg/h, run number, each (m,)."""

    def __init__(self, rate: Array, output: Array, run: NDArray[np.int64]) -> None:
        self.rate, self.output, self.run = rate, output, run

    def apart(self, values: Array, use: NDArray[np.bool_]) -> Array:
        """Return values less the mean over their run of those in `use`; of a run without any they stay."""
        result = values.copy()
        for run in np.unique(self.run[use]):
            at = self.run == run
            result[at] -= values[at & use].mean()
        return result


def _blocks(runs: Sequence[GapRun]) -> _Blocks:
    rates, outputs, numbers = [], [], []
    for number, run in enumerate(runs):
        s = run.stimulus
        count = len(s) // _BLOCK
        rate = s.input_rate_dph[: count * _BLOCK].reshape(count, _BLOCK)
        output = run.output_dph[: count * _BLOCK].reshape(count, _BLOCK)
        middle = rate.mean(axis=1)
        steady = np.ptp(rate, axis=1) <= np.maximum(_STEADY * np.abs(middle), 0.5)
        steady &= ~np.isnan(output).any(axis=1)
        rates.append(middle[steady])
        outputs.append(output[steady].mean(axis=1))
        numbers.append(np.full(int(steady.sum()), number))
    return _Blocks(*(np.concatenate(each) for each in (rates, outputs, numbers)))


def _limit_dps(blocks: _Blocks) -> float | None:
    """Return the rate at which the output stops, deg/s; None where it follows the fastest input rates."""
    speed, output = np.abs(blocks.rate), np.abs(blocks.output)
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


def _band_dph(blocks: _Blocks, *, locked: bool) -> float | None:
    """Return the rate below which the output stands still, deg/h; None where it follows small rates, too."""
    speed = np.abs(blocks.rate)
    levels = _levels(speed)
    standing = [size for size in levels.tolist() if _stands(blocks, speed <= size)]
    if not standing:
        return None
    highest = _above(speed, standing[-1])
    near = speed < 20.0 * highest
    few = _Blocks(blocks.rate[near], blocks.output[near], blocks.run[near])
    tried = np.geomspace(0.5 * levels[0], highest, _TRIES) if locked else _between(levels, highest)
    return float(tried[int(np.argmin([_left_by(few, band, locked=locked) for band in tried.tolist()]))])


def _levels(speed: Array) -> Array:
    """Return sizes of the input rate, just above those that occur, at which a band may end, smallest first."""
    levels = np.unique(np.round(speed[speed > 0.05], 1)) + 0.1
    return levels if len(levels) <= _TRIES else np.quantile(levels, np.linspace(0.0, 1.0, _TRIES))


def _between(levels: Array, highest: float) -> Array:
    """Return bands halfway between levels up to the highest; where rates are far apart, close to the lower."""
    following = np.append(levels[1:], highest)
    return np.asarray(0.5 * (levels + np.minimum(following, 1.5 * levels))[levels <= highest])


def _above(speed: Array, size: float) -> float:
    """Return the next rate above a size, at most three times it: the band ends somewhere between."""
    higher = speed[speed > 1.05 * size]
    return min(float(higher.min()), 3.0 * size) if len(higher) else 1.5 * size


def _stands(blocks: _Blocks, use: NDArray[np.bool_]) -> bool:
    """Return whether the output hardly follows the input rate in blocks that differ in it enough to tell."""
    if use.sum() < 8:
        return False
    rate, output = blocks.apart(blocks.rate, use)[use], blocks.apart(blocks.output, use)[use]
    power = float(rate @ rate)
    if power <= 0.0:
        return False
    slope = float(rate @ output) / power
    rest = output - slope * rate
    # blocks of one level share what is wrong with it: few of them count as independent
    sigma = float(np.sqrt(rest @ rest / power / max(len(rest) / 8.0, 2.0)))
    return abs(slope) < _LOW_SLOPE and _CLEAR * sigma < 1.0 - abs(slope)


def _left_by(blocks: _Blocks, band: float, *, locked: bool) -> float:
    """Return the energy that a band without output leaves, run means taken out."""
    rate = blocks.rate
    if locked:
        expected = np.sign(rate) * np.sqrt(np.maximum(rate**2 - band**2, 0.0))
    else:
        expected = np.where(np.abs(rate) < band, 0.0, rate)
    rest = blocks.apart(blocks.output - expected, np.ones(len(rate), dtype=bool))
    return float(rest @ rest)


_PLAIN: dict[str, Callable[[_Blocks], float | None]] = {
    "saturation": _limit_dps,
    "dead_zone": lambda blocks: _band_dph(blocks, locked=False),
    "lock_in": lambda blocks: _band_dph(blocks, locked=True),
}
