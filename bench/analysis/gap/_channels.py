"""The channels beside the gyro's rate: each against its own model and its own floor, in its own unit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.analysis.gap._channel_cells import (
    ChannelCells,
    channel_bands,
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
from bench.analysis.gap._channel_floor import ChannelFloor, channel_floor
from bench.analysis.gap._channel_shrinkage import judge_channel
from bench.analysis.gap._findings import Cause, Finding, Place, rivals_of
from bench.analysis.gap._model_file import ChannelTerm, Model
from bench.analysis.gap._signal import Signal
from drivers.base.arrays import Array
from simulators.effects import CHANNEL_UNITS, Channel, ChannelEffect, NoiseEffect, catalogue

_EXPLAINED = 0.75
"""Part of a gap's energy from which it counts as explained."""
_LATE_FRACTION = 1e-4
_THERMOMETERS, _DIGIT = ("chamber_air", "case_temperature", "gyro_temperature"), 0.5
"""Channels of which nothing below this part of the last digit is a gap: no thermometer is that good."""


@dataclass(frozen=True, eq=False)
class ChannelCurve:
    """Recorded less simulated in one run: time in s, before and after, (m,) each, NaN in gaps."""

    run_id: str
    time_s: Array
    before: Array
    after: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class ChannelFinding(Finding[ChannelTerm]):
    """What was found in one channel; `terms` are the model's of this channel, fitted again, with the causes.

    `explained` is the part of the gap's energy that they take away on the runs diagnosed. `reason` says why there
    is no diagnosis, empty if there is one. `stochastic` has the noise effects of the channel with their size.
    """

    rms: float = math.nan
    floor_rms: float = math.nan
    floor_source: str = ""
    explained: float = math.nan
    curves: tuple[ChannelCurve, ...] = ()
    reason: str = ""

    @property
    def caution(self) -> str:
        """What must be said when its causes do not hold on held-out runs; empty when they do."""
        return next((held.caution for held in self.held_out if self.causes and held.caution), "")

    @property
    def bands(self) -> tuple[str, ...]:
        """Time scales of its places, fast to slow."""
        return channel_bands()

    def told(self, cause: Cause[ChannelTerm]) -> str:
        """Return in words what a cause does, its values beside nominal ones, what could stand in its place."""
        term = cause.term
        rows = zip(term.effect.parameters, term.values, term.sigmas, cause.nominal, strict=True)
        values = ", ".join(
            f"{parameter.name} = {value:.4g} ± {sigma:.2g} (nominal {nominal:.4g})"
            for parameter, value, sigma, nominal in rows
        )
        rivals = ", ".join(f"{n.replace('_', ' ')} {100 * p:.0f} %" for n, p in cause.alternatives.items())
        told = f" In its place could stand {rivals}: they do the same in these runs." if rivals else ""
        return f"{cause.meaning} {values}.{told}"

    def scatter(self, name: str) -> str:
        """Return in words what a stochastic effect of the channel does, and its size."""
        effect = catalogue()[name]
        assert isinstance(effect, NoiseEffect)
        return f"{name}: {effect.meaning} {effect.parameter.name} = {self.stochastic[name]:.3g}"


@dataclass(frozen=True, eq=False)
class _Ready:
    """A channel's runs in cells over its floor, with the fit of the model's own parameters."""

    cells: ChannelCells
    floor: ChannelFloor
    effects: Sequence[ChannelEffect]
    terms: Sequence[ChannelTerm]
    accuracy: float
    weight: Array
    nominal: ChannelFit
    places: Sequence[Place]
    rms: float
    digit: float = 0.0

    @property
    def least(self) -> float:
        """What an effect must be larger than to be named."""
        return max(self.accuracy, self.digit)


_Sets = tuple[list[ChannelFit], ChannelFit]


@dataclass(frozen=True)
class ChannelSignal(Signal[ChannelSeries, _Ready, _Sets, ChannelFinding]):
    """Recorded less simulated from what acted on the channel; the model's own parameters are nuisance."""

    channel: Channel

    def refused(self, runs: Sequence[ChannelSeries], model: Model) -> str:
        """Return why there is nothing to diagnose in runs and model, empty if there is."""
        if not runs:
            return "not in these runs"
        terms = {term.name for term in model.channel_terms}
        lacking = sorted(
            effect.name for effect in self._effects() if effect.needed and effect.name not in terms
        )
        return f"the model has no {', '.join(lacking)}: nothing to compare with" if lacking else ""

    def not_seen(self, reason: str) -> ChannelFinding:
        """Return the finding of a channel without a diagnosis."""
        unit = CHANNEL_UNITS[self.channel]
        return ChannelFinding(signal=self.channel, unit=unit, verdict="not seen", reason=reason)

    def prepare(self, runs: Sequence[ChannelSeries], model: Model) -> _Ready:
        effects = self._effects()
        terms = [term for term in model.channel_terms if term.effect.channel == self.channel]
        accuracy = model.accuracy.get(self.channel, 0.0)
        floor = channel_floor(runs)
        cells = channel_cells(runs, floor)
        start = fit_effects(cells, effects, terms, frozenset(), np.ones(len(cells.cell)), None)
        weight = tolerance(cells, start.left, accuracy)
        nominal = fit_effects(cells, effects, terms, frozenset(), weight, start.values)
        places = channel_places(cells, nominal.left)
        rms = gap_rms(cells, nominal.left, places)
        resolution = max(series.resolution for series in runs) if self.channel in _THERMOMETERS else 0.0
        digit = 0.0 if math.isnan(resolution) else _DIGIT * resolution
        return _Ready(cells, floor, effects, terms, accuracy, weight, nominal, places, rms, digit)

    def which(self, data: _Ready) -> _Sets:
        """Return the fits of all sets, and the best; of the empty set alone where there is no gap."""
        if data.rms <= data.least or not any(place.clear for place in data.places):
            return [data.nominal], data.nominal
        return search_effects(data.cells, data.effects, data.terms, data.weight, data.nominal, data.least)

    def finding(self, data: _Ready, sets: _Sets) -> ChannelFinding:
        (fits, best), cells = sets, data.cells
        causes = _causes(fits, best, data.effects, data.nominal)
        excess = [float(((fit.left**2 - 1.0) * cells.floor).sum()) for fit in (data.nominal, best)]
        explained = 1.0 - max(excess[1], 0.0) / excess[0] if causes else 0.0
        own = {term.name: term for term in data.terms}
        return ChannelFinding(
            signal=self.channel,
            unit=CHANNEL_UNITS[self.channel],
            verdict=_verdict(data, causes, explained),
            causes=causes,
            places=tuple(data.places),
            left=tuple(channel_places(cells, best.left)),
            stochastic=_scatter(cells.series, data.accuracy),
            terms=tuple(
                _term(effect, best, own.get(effect.name))
                for effect in data.effects
                if effect.name in own or effect.name in best.names
            ),
            rms=data.rms,
            floor_rms=float(np.sqrt(cells.floor.mean())),
            floor_source=data.floor.source,
            explained=explained,
            curves=tuple(_curves(cells.series, data.effects, data.nominal, best)),
        )

    def judged(
        self, finding: ChannelFinding, data: _Ready, sets: _Sets, held_out: Sequence[ChannelSeries]
    ) -> ChannelFinding:
        best = sets[1]
        curves = tuple(_curves(held_out, data.effects, data.nominal, best))
        if not finding.causes:
            return replace(finding, curves=curves)
        own = judge_channel(held_out, data.cells.series, data.effects, data.floor, data.nominal, best)
        return replace(finding, held_out=(own,), curves=curves)

    def _effects(self) -> list[ChannelEffect]:
        every = (each for each in catalogue().values() if isinstance(each, ChannelEffect))
        return [each for each in every if each.channel == self.channel]


def _scatter(series: Sequence[ChannelSeries], accuracy: float) -> dict[str, float]:
    """Return the worst run's scatter by noise effect: those beyond the accuracy in ms, or a part in 10,000."""
    worst: dict[str, float] = {}
    for each in series:
        for name, value in each.scatter.items():
            worst[name] = max(worst.get(name, 0.0), value)
    least = {"arrival_jitter": max(accuracy, 0.05), "late_frames": _LATE_FRACTION}
    return {name: value for name, value in worst.items() if value > least[name]}


def _term(effect: ChannelEffect, best: ChannelFit, before: ChannelTerm | None) -> ChannelTerm:
    given = best.sigmas.get(effect.name) or (before.sigmas if before is not None else ())
    return ChannelTerm(effect, best.values[effect.name], tuple(max(float(each), 1e-12) for each in given))


def _verdict(data: _Ready, causes: Sequence[Cause[ChannelTerm]], explained: float) -> str:
    if not any(place.clear for place in data.places) or data.accuracy < data.rms <= data.digit:
        return "no gap"
    if data.rms <= data.accuracy:
        return "within the model's accuracy"
    if not causes:
        return "unknown"
    return "explained" if explained >= _EXPLAINED else "explained in part"


def _causes(
    fits: Sequence[ChannelFit], best: ChannelFit, effects: Sequence[ChannelEffect], nominal: ChannelFit
) -> tuple[Cause[ChannelTerm], ...]:
    top = max(log_evidence(fit) for fit in fits)
    weights = {fit.names: math.exp(max(log_evidence(fit) - top, -700.0)) for fit in fits}
    total = sum(weights.values())
    known = {effect.name: effect for effect in effects}
    return tuple(
        Cause(
            name,
            known[name].meaning,
            sum(value for names, value in weights.items() if name in names) / total,
            ChannelTerm(known[name], best.values[name], best.sigmas[name]),
            rivals_of(name, best.names, weights),
            nominal=nominal.values.get(name, known[name].neutral),
        )
        for name in sorted(best.names)
    )


def _curves(
    series: Iterable[ChannelSeries], effects: Sequence[ChannelEffect], nominal: ChannelFit, best: ChannelFit
) -> list[ChannelCurve]:
    result = []
    for each in series:
        before, after = (channel_rests([each], effects, fit.values)[0] for fit in (nominal, best))
        at = np.unique(np.linspace(0, len(before) - 1, 500).astype(np.int64))
        result.append(ChannelCurve(each.run_id, each.inputs.time_s[at], before[at], after[at]))
    return result
