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

    `explained` is judged on every leg in turn by a polynomial of `order` fitted to the others; None with one
    leg, where a slope and a drift are the same thing. `legs`, and `low_c`, `high_c`, the range.
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
    blocks = _means(temperature[np.isfinite(temperature)], 100)
    seconds = len(temperature) / per_s / max(len(blocks), 1)
    return float(np.quantile(np.abs(np.diff(blocks)), 0.9) / seconds) if len(blocks) > 10 else 0.0


def dependence(
    values: Array, temperature: Array, rest: NDArray[np.bool_], channel: str
) -> TemperatureLook | None:
    """Regress an axis (n,) on a temperature (n,), both at rest; None where that moves by less than 3 K."""
    used = rest & np.isfinite(values) & np.isfinite(temperature)
    if used.sum() < 10 * _FEWEST:
        return None
    heat, level = (_means(column[used], _BLOCKS) for column in (temperature, values))
    low, high = float(heat.min()), float(heat.max())
    if high - low < _LEAST_K:
        return None
    leg = legs_of(heat, _TURN * (high - low))
    slopes = [
        float(np.polyfit(heat[leg == k], level[leg == k], 1)[0])
        for k in np.unique(leg)
        if (leg == k).sum() >= _FEWEST and np.ptp(heat[leg == k]) > _LEAST_K / 2
    ]
    sigma = float(np.std(slopes, ddof=1) / np.sqrt(len(slopes))) if len(slopes) > 1 else np.nan
    best, explained = 1, None
    if leg[-1] > 0:
        parts = {order: _explained(heat, level, leg, order) for order in _ORDERS}
        for order in _ORDERS[1:]:
            best = order if parts[order] > parts[best] + _WORTH else best
        explained = parts[best]
    slope = float(np.polyfit(heat, level, 1)[0])
    return TemperatureLook(channel, low, high, int(leg[-1]) + 1, slope, sigma, best, explained)


def _means(values: Array, blocks: int) -> Array:
    size = max(1, len(values) // blocks)
    return np.asarray(values[: len(values) // size * size].reshape(-1, size).mean(axis=1))


def legs_of(heat: Array, turn: float) -> NDArray[np.int64]:
    """Return the leg's number of every mean, (n,): a leg ends where the temperature turns by more than `turn`."""
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
        if judged.sum() >= _FEWEST and others.sum() >= _FEWEST + order:
            fit = np.polynomial.Polynomial.fit(heat[others], level[others], order)
            left += float(((level[judged] - fit(heat[judged])) ** 2).sum())
            plain += float(((level[judged] - level[others].mean()) ** 2).sum())
    return 1.0 - left / plain if plain > 0.0 else 0.0
