"""How an axis follows a temperature, judged on legs of the temperature's course that took no part in the fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from drivers.base.arrays import Array

_BLOCKS = 400
_LEAST_K, _TURN = 3.0, 0.2
"""Range of temperature from which on it is looked at; part of it by which a turn divides two legs."""
_ORDERS = (1, 2, 3)
_WORTH = 0.05
"""Part of the variance that a higher order must gain."""
_FEWEST = 8
FASTEST_K_PER_S = 2.0
"""No temperature in a unit changes faster for long."""


@dataclass(frozen=True)
class TemperatureLook:
    """Slope in unit per K with 1 sigma (leg to leg), and the part of the variance that temperature explains.

    `explained` is judged on every leg in turn by a polynomial of `order` fitted to the others; None with one leg,
    where a slope and a drift are the same thing. `legs`, and `low_c`, `high_c`, the range.
    """

    channel: str
    low_c: float
    high_c: float
    legs: int
    slope: float
    slope_sigma: float
    order: int
    explained: float | None


def fastest_change(temperature: Array, per_s: float) -> float:
    """Return the usual fast change of a temperature (n,) over a hundredth of the record, K/s."""
    blocks = _means(temperature, np.isfinite(temperature), 100)
    seconds = len(temperature) / per_s / len(blocks)
    return float(np.quantile(np.abs(np.diff(blocks)), 0.9) / seconds) if len(blocks) > 10 else 0.0


def dependence(
    values: Array, temperature: Array, rest: NDArray[np.bool_], channel: str
) -> TemperatureLook | None:
    """Regress an axis (n,) on a temperature (n,), both at rest; None where that moves by less than 3 K."""
    used = rest & np.isfinite(values) & np.isfinite(temperature)
    if used.sum() < 10 * _FEWEST:
        return None
    heat, level = (_means(column, used, _BLOCKS) for column in (temperature, values))
    low, high = float(heat.min()), float(heat.max())
    if high - low < _LEAST_K:
        return None
    leg = _legs(heat, _TURN * (high - low))
    legs = int(leg[-1]) + 1
    slopes = [
        float(np.polyfit(heat[leg == k], level[leg == k], 1)[0])
        for k in range(legs)
        if (leg == k).sum() >= _FEWEST and np.ptp(heat[leg == k]) > _LEAST_K / 2
    ]
    slope = float(np.polyfit(heat, level, 1)[0])
    sigma = float(np.std(slopes, ddof=1) / np.sqrt(len(slopes))) if len(slopes) > 1 else np.nan
    if legs < 2:
        return TemperatureLook(channel, low, high, legs, slope, sigma, 1, None)
    explained = [_explained(heat, level, leg, order) for order in _ORDERS]
    best = 0
    for number in range(1, len(_ORDERS)):
        if explained[number] > explained[best] + _WORTH:
            best = number
    return TemperatureLook(channel, low, high, legs, slope, sigma, _ORDERS[best], explained[best])


def _means(values: Array, used: NDArray[np.bool_], blocks: int) -> Array:
    flat = values[used]
    size = max(1, len(flat) // blocks)
    return np.asarray(flat[: len(flat) // size * size].reshape(-1, size).mean(axis=1))


def _legs(heat: Array, turn: float) -> NDArray[np.int64]:
    """Return the number of the leg of every mean: a leg ends where the temperature turns by more than `turn`."""
    padded = np.concatenate(([heat[0]], heat, [heat[-1]]))
    turns = [find_peaks(sign * padded, prominence=turn)[0] - 1 for sign in (1.0, -1.0)]
    leg = np.zeros(len(heat), np.int64)
    leg[np.unique(np.clip(np.concatenate(turns), 0, len(heat) - 1))] = 1
    return np.asarray(np.cumsum(leg))


def _explained(heat: Array, level: Array, leg: NDArray[np.int64], order: int) -> float:
    """Return 1 - (what is left) / (what a constant leaves) of legs that were not fitted, where others reach."""
    left = plain = 0.0
    for k in np.unique(leg):
        others = leg != k
        judged = ~others & (heat >= heat[others].min()) & (heat <= heat[others].max())
        if judged.sum() < _FEWEST or others.sum() < _FEWEST + order:
            continue
        centre, scale = heat[others].mean(), heat[others].std() or 1.0
        fit = np.polynomial.Polynomial.fit((heat[others] - centre) / scale, level[others], order)
        left += float(((level[judged] - fit((heat[judged] - centre) / scale)) ** 2).sum())
        plain += float(((level[judged] - level[others].mean()) ** 2).sum())
    return 1.0 - left / plain if plain > 0.0 else 0.0
