"""Diagnosis of the channels beside the gyro's rate: where, which, how far; each against its own floor."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bench.gap._channel_cells import (
    ChannelCells,
    ChannelPlace,
    band_name,
    channel_cells,
    channel_places,
    gap_rms,
    tolerance,
)
from bench.gap._channel_data import ChannelSeries
from bench.gap._channel_floor import ChannelFloor, channel_floor
from bench.gap._model_file import ChannelTerm, Model
from bench.gap._where import SIGNIFICANT
from drivers.errors import ConfigurationError
from simulators.effects import CHANNEL_UNITS, Channel, ChannelEffect, NoiseEffect, catalogue, simulate

Array = NDArray[np.float64]
_MOST_CAUSES = 3
_CLEAR = 5.0
"""Log evidence that another effect must bring."""
_EXPLAINED = 0.75
"""Part of a gap's energy from which it counts as explained."""
_ALTERNATIVE = 0.02
_LATE_FRACTION = 1e-4
_WITHIN = 3.0
"""Standard deviations by which a model's own parameter may be off without being an effect."""


@dataclass(frozen=True)
class ChannelCause:
    """An effect of a channel that explains (part of) its gap: nominal and fitted values, 1 sigma.

    `alternatives` maps effects that could stand in its place to their probability.
    """

    effect: ChannelEffect
    nominal: tuple[float, ...]
    values: tuple[float, ...]
    sigmas: tuple[float, ...]
    probability: float
    alternatives: Mapping[str, float]


@dataclass(frozen=True)
class ChannelShrinkage:
    """Part of the reducible gap that is gone on held-out runs, its 95 % interval, and sizes above the floor."""

    share: float
    low: float
    high: float
    rms_before: float
    rms_after: float


@dataclass(frozen=True, eq=False)
class ChannelCurve:
    """Recorded less simulated in one run: time in s, before and after, (m,) each, NaN in gaps."""

    run_id: str
    time_s: Array
    before: Array
    after: Array


@dataclass(frozen=True, eq=False)
class ChannelDiagnosis:
    """What was found in one channel; `terms` are the model's of this channel, fitted again, with the causes.

    `explained` is the part of the gap's energy that they take away on the runs diagnosed. `reason` says why there
    is no diagnosis, empty if there is one. `left` are the places that remain. `stochastic` maps noise effects of
    the channel that stand out to their size.
    """

    channel: Channel
    unit: str
    verdict: str
    rms: float
    floor_rms: float
    floor_source: str
    places: tuple[ChannelPlace, ...]
    causes: tuple[ChannelCause, ...]
    explained: float
    left: tuple[ChannelPlace, ...]
    terms: tuple[ChannelTerm, ...]
    held_out: ChannelShrinkage | None
    curves: tuple[ChannelCurve, ...]
    reason: str = ""
    stochastic: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Fit:
    names: frozenset[str]
    values: Mapping[str, tuple[float, ...]]
    sigmas: Mapping[str, tuple[float, ...]]
    cost: float
    count: int
    left: Array


def diagnose_channels(
    series: Sequence[ChannelSeries],
    model: Model,
    held_out: Sequence[ChannelSeries] = (),
    missing: Mapping[str, str] | None = None,
) -> list[ChannelDiagnosis]:
    """Return a diagnosis for every channel, in the order of the signal's way; `missing` says what runs lack.

    A channel that `held_out` runs have is judged on them. ConfigurationError if one of them is among the others.
    """
    both = {each.run_id for each in series} & {each.run_id for each in held_out}
    both |= {each.run_id for each in held_out} & set(model.fitted_on)
    if both:
        raise ConfigurationError(
            "a run that the model was fitted on cannot judge it",
            found=", ".join(sorted(both)),
            expected="held-out runs",
        )
    effects = [each for each in catalogue().values() if isinstance(each, ChannelEffect)]
    result = []
    for channel in CHANNEL_UNITS:
        own = [each for each in series if each.channel == channel and each.pieces()]
        known = [each for each in effects if each.channel == channel]
        terms = [term for term in model.channel_terms if term.effect.channel == channel]
        lacking = sorted({each.name for each in known if each.needed} - {term.name for term in terms})
        if not own:
            result.append(_not_seen(channel, (missing or {}).get(channel, "not in these runs")))
        elif lacking:
            reason = f"the model has no {', '.join(lacking)}: nothing to compare with"
            result.append(_not_seen(channel, reason))
        else:
            kept = [each for each in held_out if each.channel == channel and each.pieces()]
            result.append(_diagnosed(channel, own, kept, known, terms, model.accuracy.get(channel, 0.0)))
    return result


def _not_seen(channel: Channel, reason: str) -> ChannelDiagnosis:
    nan = math.nan
    unit = CHANNEL_UNITS[channel]
    return ChannelDiagnosis(channel, unit, "not seen", nan, nan, "", (), (), nan, (), (), None, (), reason)


def _diagnosed(
    channel: Channel,
    series: Sequence[ChannelSeries],
    held_out: Sequence[ChannelSeries],
    effects: Sequence[ChannelEffect],
    terms: Sequence[ChannelTerm],
    accuracy: float,
) -> ChannelDiagnosis:
    floor = channel_floor(series)
    cells = channel_cells(series, floor)
    start = _fitted(cells, effects, terms, frozenset(), np.ones(len(cells.cell)), None)
    weight = tolerance(cells, start.left, accuracy)
    nominal = _fitted(cells, effects, terms, frozenset(), weight, start.values)
    places = channel_places(cells, nominal.left)
    rms = gap_rms(cells, nominal.left, places)
    best = nominal
    causes: tuple[ChannelCause, ...] = ()
    if rms > accuracy and any(place.p_value < SIGNIFICANT for place in places):
        fits, best = _search(cells, effects, terms, weight, nominal, accuracy)
        causes = _causes(fits, best, effects, nominal)
    excess = [float(((fit.left**2 - 1.0) * cells.floor).sum()) for fit in (nominal, best)]
    explained = 1.0 - max(excess[1], 0.0) / excess[0] if causes else 0.0
    left = channel_places(cells, best.left)
    fitted = tuple(
        ChannelTerm(effect, best.values[effect.name], _positive(best.sigmas.get(effect.name), term))
        for effect in effects
        for term in [next((each for each in terms if each.name == effect.name), None)]
        if term is not None or effect.name in best.names
    )
    judged = _judged(held_out, effects, floor, nominal, best) if held_out and causes else None
    return ChannelDiagnosis(
        channel,
        CHANNEL_UNITS[channel],
        _verdict(rms, accuracy, places, causes, explained),
        rms,
        float(np.sqrt(cells.floor.mean())),
        floor.source,
        tuple(places),
        causes,
        explained,
        tuple(left),
        fitted,
        judged,
        tuple(_curves(held_out or series, effects, nominal, best)),
        stochastic=_scatter(series, accuracy),
    )


def _scatter(series: Sequence[ChannelSeries], accuracy: float) -> dict[str, float]:
    """Return the worst run's scatter by noise effect: those beyond the accuracy in ms, or a part in 10,000."""
    worst: dict[str, float] = {}
    for each in series:
        for name, value in each.scatter.items():
            worst[name] = max(worst.get(name, 0.0), value)
    least = {"arrival_jitter": max(accuracy, 0.05), "late_frames": _LATE_FRACTION}
    return {name: value for name, value in worst.items() if value > least[name]}


def scatter_sentence(name: str, size: float) -> str:
    """Return in words what a stochastic effect of a channel does, and its size."""
    effect = catalogue()[name]
    assert isinstance(effect, NoiseEffect)
    return f"{name}: {effect.meaning} {effect.parameter.name} = {size:.3g}"


def _positive(sigmas: tuple[float, ...] | None, term: ChannelTerm | None) -> tuple[float, ...]:
    given = sigmas or (term.sigmas if term is not None else ())
    return tuple(max(float(each), 1e-12) for each in given)


def _verdict(
    rms: float,
    accuracy: float,
    places: Sequence[ChannelPlace],
    causes: Sequence[ChannelCause],
    explained: float,
) -> str:
    if not any(place.p_value < SIGNIFICANT for place in places):
        return "no gap"
    if rms <= accuracy:
        return "within the model's accuracy"
    if not causes:
        return "unknown"
    return "explained" if explained >= _EXPLAINED else "explained in part"


def _rests(
    series: Sequence[ChannelSeries],
    effects: Sequence[ChannelEffect],
    values: Mapping[str, tuple[float, ...]],
) -> list[Array]:
    return [each.values - simulate(each.channel, each.inputs, values, effects) for each in series]


def _fitted(
    cells: ChannelCells,
    effects: Sequence[ChannelEffect],
    terms: Sequence[ChannelTerm],
    names: frozenset[str],
    weight: Array,
    start: Mapping[str, tuple[float, ...]] | None,
) -> _Fit:
    """Fit the model's own parameters within their priors, and those of the effects `names` freely."""
    own = {term.name: term for term in terms}
    free = [each for each in effects if each.name in own or each.name in names]
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
    scale = np.where(
        np.isfinite(sigma), sigma, np.maximum(0.1 * np.abs(begin), 1e-3 * np.ptp(bounds, axis=1))
    )
    cuts = np.cumsum([0, *(len(each.parameters) for each in free)])

    def named(at: Array) -> dict[str, tuple[float, ...]]:
        rows = zip(free, pairwise(cuts.tolist()), strict=True)
        return {each.name: tuple(at[low:high].tolist()) for each, (low, high) in rows}

    def left(at: Array) -> Array:
        return cells.whitened(_rests(cells.series, effects, named(at)))

    def cost(at: Array) -> Array:
        return np.concatenate((left(at) / weight, (at - prior) / sigma))

    if not len(begin):
        rest = left(begin)
        return _Fit(names, {}, {}, float(((rest / weight) ** 2).sum()), 0, rest)
    tries = [begin]
    for each, low in zip(free, cuts[:-1], strict=True):
        for values in each.starts if each.name in names else ():
            tries.append(begin.copy())
            tries[-1][low : low + len(values)] = values
    best = min((np.clip(at, *bounds.T) for at in tries), key=lambda at: float((cost(at) ** 2).sum()))
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
    return _Fit(
        names,
        named(values),
        named(deviation),
        2.0 * float(found.cost),
        sum(len(each.parameters) for each in free if each.name in names),
        left(values),
    )


def _evidence(fit: _Fit) -> float:
    """Return the log evidence, by Schwarz: half the weighted energy and half a log of the size a parameter."""
    return -0.5 * fit.cost - 0.5 * fit.count * math.log(len(fit.left)) - _CLEAR * len(fit.names)


def _search(
    cells: ChannelCells,
    effects: Sequence[ChannelEffect],
    terms: Sequence[ChannelTerm],
    weight: Array,
    nominal: _Fit,
    accuracy: float,
) -> tuple[list[_Fit], _Fit]:
    """Return fits of no effect, of every one, then more beside the best while that helps; and the best."""
    fits, best = [nominal], nominal
    for _ in range(_MOST_CAUSES):
        more = [
            _fitted(cells, effects, terms, best.names | {each.name}, weight, best.values)
            for each in effects
            if each.name not in best.names and not each.known
        ]
        fits += more
        before = best
        worth = [fit for fit in more if _smallest(cells, effects, fit, nominal) > accuracy]
        best = max(worth, key=_evidence, default=before)
        if _evidence(best) <= _evidence(before):
            best = before
            break
    # what stands in another's place beside the rest of the best set
    for name in best.names if len(best.names) > 1 else ():
        for each in effects:
            wanted = (best.names - {name}) | {each.name}
            if each.name not in best.names and not each.known and wanted not in [fit.names for fit in fits]:
                fits.append(_fitted(cells, effects, terms, wanted, weight, nominal.values))
    return fits, best


def _smallest(cells: ChannelCells, effects: Sequence[ChannelEffect], fit: _Fit, nominal: _Fit) -> float:
    """Return the rms of what the least of a fit's effects does to the signal, in the channel's unit."""
    whole = _rests(cells.series, effects, fit.values)
    sizes = []
    for name in fit.names:
        without = {key: value for key, value in fit.values.items() if key != name}
        if name in nominal.values:
            without[name] = nominal.values[name]
        rests = zip(whole, _rests(cells.series, effects, without), strict=True)
        changes = np.concatenate([one - other for one, other in rests])
        sizes.append(math.sqrt(float(np.nanmean(changes**2))))
    return min(sizes)


def _causes(
    fits: Sequence[_Fit], best: _Fit, effects: Sequence[ChannelEffect], nominal: _Fit
) -> tuple[ChannelCause, ...]:
    top = max(_evidence(fit) for fit in fits)
    weights = {fit.names: math.exp(max(_evidence(fit) - top, -700.0)) for fit in fits}
    total = sum(weights.values())
    result = []
    for name in sorted(best.names):
        effect = next(each for each in effects if each.name == name)
        places = {
            next(iter(names - (best.names - {name}))): value
            for names, value in weights.items()
            if len(names) == len(best.names) and best.names - {name} <= names
        }
        whole = sum(places.values())
        rivals = {key: value / whole for key, value in places.items() if key != name}
        result.append(
            ChannelCause(
                effect,
                nominal.values.get(name, effect.neutral),
                best.values[name],
                best.sigmas[name],
                sum(value for names, value in weights.items() if name in names) / total,
                {key: value for key, value in rivals.items() if value > _ALTERNATIVE},
            )
        )
    return tuple(result)


def _judged(
    held_out: Sequence[ChannelSeries],
    effects: Sequence[ChannelEffect],
    floor: ChannelFloor,
    nominal: _Fit,
    best: _Fit,
) -> ChannelShrinkage:
    """Judge the fitted values on runs that took no part; energy in squares of the channel's unit.

    The interval is that of noise alone: these runs' share, not that of another unit's.
    """
    cells = channel_cells(held_out, floor)
    first, then = (cells.whitened(_rests(cells.series, effects, fit.values)) for fit in (nominal, best))
    places = channel_places(cells, first)
    clear = {(place.phase, place.band) for place in places if place.p_value < SIGNIFICANT}
    on = np.array([(phase, band_name(band)) in clear for phase, band in cells.names])
    number = cells.sums(np.ones(len(first)))
    power = cells.sums(cells.floor) / number
    before, after = ((cells.sums(each**2) - number)[on] * power[on] for each in (first, then))
    total = float(before.sum())
    if total <= 0.0:
        return ChannelShrinkage(math.nan, math.nan, math.nan, 0.0, 0.0)
    share = 1.0 - float(after.sum()) / total
    noise = np.sqrt(2.0 * number[on] + 4.0 * np.maximum(after / power[on], 0.0)) * power[on]
    sigma = math.sqrt(float((noise**2).sum())) / total
    sizes = [math.sqrt(max(float(each.sum()), 0.0) / len(first)) for each in (before, after)]
    return ChannelShrinkage(share, share - 1.96 * sigma, min(share + 1.96 * sigma, 1.0), *sizes)


def _curves(
    series: Iterable[ChannelSeries], effects: Sequence[ChannelEffect], nominal: _Fit, best: _Fit
) -> list[ChannelCurve]:
    result = []
    for each in series:
        before, after = (_rests([each], effects, fit.values)[0] for fit in (nominal, best))
        at = np.unique(np.linspace(0, len(before) - 1, 500).astype(np.int64))
        result.append(ChannelCurve(each.run_id, each.inputs.time_s[at], before[at], after[at]))
    return result


def with_channels(model: Model, found: Sequence[ChannelDiagnosis]) -> Model:
    """Return the model with the channels' terms as fitted, causes included."""
    fitted = {term.name: term for each in found for term in each.terms}
    kept = [fitted.pop(term.name, term) for term in model.channel_terms]
    return replace(model, channel_terms=(*kept, *fitted.values()))
