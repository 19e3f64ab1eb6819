"""Fits of a channel's effects: the model's own parameters within their priors, others freely; sets of effects."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import least_squares

from bench.analysis.gap._channel_cells import ChannelCells
from bench.analysis.gap._channel_data import ChannelSeries
from bench.analysis.gap._model_file import ChannelTerm
from drivers.base.arrays import Array
from simulators.effects import ChannelEffect, simulate

_MOST_CAUSES = 3
_CLEAR = 5.0
"""Log evidence that another effect must bring."""
_WITHIN = 3.0
"""Standard deviations by which a model's own parameter may be off without being an effect."""


@dataclass(frozen=True, eq=False)
class ChannelFit:
    """A fit of effects `names`: values and 1 sigma, cost, `count` of free values, what is left, whitened."""

    names: frozenset[str]
    values: Mapping[str, tuple[float, ...]]
    sigmas: Mapping[str, tuple[float, ...]]
    cost: float
    count: int
    left: Array


def channel_rests(
    series: Sequence[ChannelSeries],
    effects: Sequence[ChannelEffect],
    values: Mapping[str, tuple[float, ...]],
) -> list[Array]:
    return [each.values - simulate(each.channel, each.inputs, values, effects) for each in series]


def fit_effects(
    cells: ChannelCells,
    effects: Sequence[ChannelEffect],
    terms: Sequence[ChannelTerm],
    names: frozenset[str],
    weight: Array,
    start: Mapping[str, tuple[float, ...]] | None,
) -> ChannelFit:
    """Fit the model's own parameters within their priors, and those of the effects `names` freely."""
    own = {term.name: term for term in terms}
    free = [effect for effect in effects if effect.name in own or effect.name in names]
    first = {each.name: own[each.name].values if each.name in own else each.neutral for each in free}
    begin = np.array([v for each in free for v in (start or first).get(each.name, first[each.name])])
    prior = np.array([v for each in free for v in first[each.name]])
    sigma = np.array(
        [
            s
            for each in free
            for s in ((math.inf,) * len(each.parameters) if each.name in names else own[each.name].sigmas)
        ]
    )
    bounds = np.array([(p.low, p.high) for each in free for p in each.parameters]).reshape(-1, 2)
    bounded = np.isfinite(sigma)
    bounds[bounded, 0] = np.maximum(bounds[bounded, 0], (prior - _WITHIN * sigma)[bounded])
    bounds[bounded, 1] = np.minimum(bounds[bounded, 1], (prior + _WITHIN * sigma)[bounded])
    cuts = np.cumsum([0, *(len(each.parameters) for each in free)])

    def named(at: Array) -> dict[str, tuple[float, ...]]:
        rows = zip(free, pairwise(cuts.tolist()), strict=True)
        return {each.name: tuple(at[low:high].tolist()) for each, (low, high) in rows}

    def left(at: Array) -> Array:
        return cells.whitened(channel_rests(cells.series, effects, named(at)))

    def cost(at: Array) -> Array:
        return np.concatenate((left(at) / weight, (at - prior) / sigma))

    if not len(begin):
        rest = left(begin)
        return ChannelFit(names, {}, {}, float(((rest / weight) ** 2).sum()), 0, rest)
    tries = [begin]
    for each, low in zip(free, cuts[:-1], strict=True):
        for values in each.begins(named(begin)) if each.name in names else ():
            tries.append(begin.copy())
            tries[-1][low : low + len(values)] = values
    best = min((np.clip(at, *bounds.T) for at in tries), key=lambda at: float((cost(at) ** 2).sum()))
    # a mass or a conductance of any size is known to a part of itself
    sizes = np.maximum(0.1 * np.abs(best), 1e-3 * np.ptp(bounds, axis=1))
    sizes = np.where((bounds[:, 0] >= 0.0) & (best > 0.0), 0.1 * best, sizes)
    scale = np.where(bounded, sigma, sizes)
    # in steps of the scale, counted from 1: the step of a derivative is a share of the value
    lowest, highest = (1.0 + (bounds - best[:, None]) / scale[:, None]).T
    found = least_squares(
        lambda at: cost(best + (at - 1.0) * scale),
        np.clip(np.ones(len(best)), lowest + 1e-9, highest - 1e-9),
        bounds=(lowest, highest),
        diff_step=1e-3,
        max_nfev=30,
    )
    values = best + (found.x - 1.0) * scale
    normal = found.jac.T @ found.jac
    deviation = scale * np.sqrt(np.maximum(np.diag(np.linalg.pinv(normal)), 0.0))
    return ChannelFit(
        names,
        named(values),
        named(deviation),
        2.0 * float(found.cost),
        sum(len(each.parameters) for each in free if each.name in names),
        left(values),
    )


def log_evidence(fit: ChannelFit) -> float:
    """Return the log evidence, by Schwarz: half the weighted energy and half a log of the size a parameter."""
    return -0.5 * fit.cost - 0.5 * fit.count * math.log(len(fit.left)) - _CLEAR * len(fit.names)


def search_effects(
    cells: ChannelCells,
    effects: Sequence[ChannelEffect],
    terms: Sequence[ChannelTerm],
    weight: Array,
    nominal: ChannelFit,
    accuracy: float,
) -> tuple[list[ChannelFit], ChannelFit]:
    """Return fits of no effect, of every one, then more beside the best while that helps; and the best."""
    candidates = [
        each
        for each in effects
        if not each.known and (each.acts is None or any(each.acts(series.inputs) for series in cells.series))
    ]
    fits, best = [nominal], nominal
    for _ in range(_MOST_CAUSES):
        more = [
            fit_effects(cells, effects, terms, best.names | {effect.name}, weight, best.values)
            for effect in candidates
            if effect.name not in best.names
        ]
        fits += more
        before = best
        worth = [fit for fit in more if _smallest(cells, effects, fit, nominal) > accuracy]
        best = max(worth, key=log_evidence, default=before)
        if log_evidence(best) <= log_evidence(before):
            best = before
            break
    # what stands in another's place beside the rest of the best set
    for name in best.names if len(best.names) > 1 else ():
        for effect in candidates:
            wanted = (best.names - {name}) | {effect.name}
            if effect.name not in best.names and wanted not in [fit.names for fit in fits]:
                fits.append(fit_effects(cells, effects, terms, wanted, weight, nominal.values))
    return fits, best


def _smallest(
    cells: ChannelCells, effects: Sequence[ChannelEffect], fit: ChannelFit, nominal: ChannelFit
) -> float:
    """Return the rms of what the least of a fit's effects does to the signal, in the channel's unit."""
    whole = channel_rests(cells.series, effects, fit.values)
    sizes = []
    for name in fit.names:
        without = {key: value for key, value in fit.values.items() if key != name}
        if name in nominal.values:
            without[name] = nominal.values[name]
        rests = zip(whole, channel_rests(cells.series, effects, without), strict=True)
        changes = np.concatenate([one - other for one, other in rests])
        sizes.append(math.sqrt(float(np.nanmean(changes**2))))
    return min(sizes)
