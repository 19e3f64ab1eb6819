"""Diagnosis of the channels beside the gyro's rate: where, which, how far; each against its own floor."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bench.analysis.gap._channel_cells import (
    ChannelPlace,
    channel_cells,
    channel_places,
    gap_rms,
    tolerance,
)
from bench.analysis.gap._channel_data import ChannelSeries
from bench.analysis.gap._channel_fit import (
    ChannelFit,
    channel_rests,
    fit_effects,
    log_evidence,
    search_effects,
)
from bench.analysis.gap._channel_floor import channel_floor
from bench.analysis.gap._channel_shrinkage import ChannelShrinkage, judge_channel
from bench.analysis.gap._model_file import ChannelTerm, Model
from bench.analysis.gap._where import SIGNIFICANT
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.effects import CHANNEL_UNITS, Channel, ChannelEffect, NoiseEffect, catalogue

_EXPLAINED = 0.75
"""Part of a gap's energy from which it counts as explained."""
_ALTERNATIVE = 0.02
_LATE_FRACTION = 1e-4


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

    @property
    def sentence(self) -> str:
        """What the effect does, its values beside the nominal ones, and what could stand in its place."""
        values = ", ".join(
            f"{parameter.name} = {value:.4g} ± {sigma:.2g} (nominal {nominal:.4g})"
            for parameter, value, sigma, nominal in zip(
                self.effect.parameters, self.values, self.sigmas, self.nominal, strict=True
            )
        )
        rivals = ", ".join(
            f"{name.replace('_', ' ')} {100 * value:.0f} %" for name, value in self.alternatives.items()
        )
        told = f" In its place could stand {rivals}: they do the same in these runs." if rivals else ""
        return f"{self.effect.meaning} {values}.{told}"


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
    start = fit_effects(cells, effects, terms, frozenset(), np.ones(len(cells.cell)), None)
    weight = tolerance(cells, start.left, accuracy)
    nominal = fit_effects(cells, effects, terms, frozenset(), weight, start.values)
    places = channel_places(cells, nominal.left)
    rms = gap_rms(cells, nominal.left, places)
    best = nominal
    causes: tuple[ChannelCause, ...] = ()
    if rms > accuracy and any(place.p_value < SIGNIFICANT for place in places):
        fits, best = search_effects(cells, effects, terms, weight, nominal, accuracy)
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
    judged = judge_channel(held_out, series, effects, floor, nominal, best) if held_out and causes else None
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


def _causes(
    fits: Sequence[ChannelFit], best: ChannelFit, effects: Sequence[ChannelEffect], nominal: ChannelFit
) -> tuple[ChannelCause, ...]:
    top = max(log_evidence(fit) for fit in fits)
    weights = {fit.names: math.exp(max(log_evidence(fit) - top, -700.0)) for fit in fits}
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


def _curves(
    series: Iterable[ChannelSeries], effects: Sequence[ChannelEffect], nominal: ChannelFit, best: ChannelFit
) -> list[ChannelCurve]:
    result = []
    for each in series:
        before, after = (channel_rests([each], effects, fit.values)[0] for fit in (nominal, best))
        at = np.unique(np.linspace(0, len(before) - 1, 500).astype(np.int64))
        result.append(ChannelCurve(each.run_id, each.inputs.time_s[at], before[at], after[at]))
    return result


def with_channels(model: Model, found: Sequence[ChannelDiagnosis]) -> Model:
    """Return the model with the channels' terms as fitted, causes included."""
    fitted = {term.name: term for each in found for term in each.terms}
    kept = [fitted.pop(term.name, term) for term in model.channel_terms]
    return replace(model, channel_terms=(*kept, *fitted.values()))
