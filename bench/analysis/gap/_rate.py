"""The gyro's rate: runs and a nominal model in; where, which, how far and what is left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace

import numpy as np

from bench.analysis.gap._aliases import in_rows
from bench.analysis.gap._align import aligned, offset_ms, without_corners
from bench.analysis.gap._candidates import candidate_variants
from bench.analysis.gap._causes import (
    causes_of,
    crowded,
    follows_rate,
    models_with_and_without,
    nominal_beside,
    within_codes,
)
from bench.analysis.gap._cells import BANDS, codes_dph, mixing
from bench.analysis.gap._close import holding, shrinkage
from bench.analysis.gap._data import GapRun, Group, by_length, check_runs
from bench.analysis.gap._describe import UnknownPart, crowd_part, differing_parts, shaken_part, unknown_parts
from bench.analysis.gap._disturbed import Disturbed, lines_hz, without_disturbances
from bench.analysis.gap._findings import Cause, Finding, Place
from bench.analysis.gap._fit import Floor, Solution, nominal_solution
from bench.analysis.gap._jumps import find_jumps
from bench.analysis.gap._learn import Learned, learned
from bench.analysis.gap._model_file import Model, Term
from bench.analysis.gap._noise import Noise
from bench.analysis.gap._prepare import Prepared, prepare, with_unknown_rate
from bench.analysis.gap._reading import as_turned
from bench.analysis.gap._remarks import of_codes, of_floor, of_noise, of_nominal, of_same, of_time
from bench.analysis.gap._signal import Signal
from bench.analysis.gap._stochastic import EFFECT_OF, NoiseVerdict
from bench.analysis.gap._where import RegimePlace, phase_map, places, regime_map
from bench.analysis.gap._which import Found, judged_sets, left_of_runs, second_look, set_weights
from drivers.base.arrays import Array
from simulators.effects import Variant

_DOUBTED = 0.1
"""Probability of no gap from which on no cause is named, however probable one is beside it."""
_LEAST_HELD = 0.5
"""Part of what a cause adds that held-out runs, or each repeat, must show for its name to stand."""
_DIFFERS = 0.5
"""Probability that repeats differ by more than noise from which each must show a cause."""
_JUMPS = 0.95
"""Probability that repeats differ where one of them jumps: as high as any that is stated."""
_WALKS = tuple(EFFECT_OF[each] for each in ("rate_random_walk_dph_per_sqrt_h", "bias_instability_dph"))
_QUANTISATION, _FINER = EFFECT_OF["quantum_arcsec"], 0.2
"""Finest step in a log over a quantum up to which that is not the quantum of what was logged."""
_LOST_FRACTION = 1e-4


@dataclass(frozen=True, eq=False, kw_only=True)
class RateFinding(Finding[Term]):
    """What was found in the rate; `model` is the nominal with corrected parameters, without the causes.

    `resembles` are catalogue effects that fit part of what is called unknown. `unidentifiable` maps effects that
    these runs cannot show to the reason. `noise` is the floor; `stochastic` has the noise effects and
    disturbances named with their probability, `disturbed` holds the latter. `learned` is what closes a gap
    without a name, None where there is none. `held` has by cause the part of what it adds that held-out runs
    show, NaN where it adds less than five standard deviations to them. The verdict is one of "no gap",
    "explained", "explained in part", "unknown", "nothing to identify".
    """

    model: Model
    resembles: tuple[Cause[Term], ...]
    unknown_probability: float
    null_probability: float
    set_probabilities: Mapping[frozenset[str], float]
    disturbed: Disturbed
    noise: NoiseVerdict
    floor: Floor
    phases: tuple[Place, ...]
    regimes: tuple[RegimePlace, ...]
    unidentifiable: Mapping[str, str]
    unknown_parts: tuple[UnknownPart, ...]
    latitude_deg: float
    learned: Learned | None = None
    held: Mapping[str, float] = field(default_factory=dict)

    @property
    def closing(self) -> tuple[str, ...]:
        """What the closed model has beside the nominal one: effects, "learned" for its terms, disturbances."""
        learned = ["learned"] if self.learned and self.learned.terms else []
        return (*super().closing, *learned, *(term.name for term in self.disturbed.terms))

    @property
    def nominal(self) -> Model:
        """The nominal model with its parameters as fitted beside causes and learned terms."""
        if self.learned is None or not self.learned.terms:
            return self.model
        return replace(self.model, terms=self.learned.nominal)

    @property
    def bands(self) -> tuple[str, ...]:
        """Time scales of its places, slow to fast."""
        return BANDS

    def size_of(self, name: str) -> str:
        """Return in words the size of a noise effect or a disturbance that is named; empty for lost frames."""
        return self.disturbed.sentences.get(name) or self.noise.risen(name)


@dataclass(frozen=True)
class _Ready:
    """Runs aligned and without disturbances, whitened with the model's columns and every candidate's."""

    model: Model
    variants: Sequence[Variant]
    disturbed: Disturbed
    data: Prepared
    notes: Sequence[str]
    early_ms: float


_Sets = tuple[Found, Sequence[Variant]]


class RateSignal(Signal[GapRun, _Ready, _Sets, RateFinding]):
    """Output less the model's, in deg/h; a bias of each run and the model's own parameters are nuisance."""

    def prepare(self, runs: Sequence[GapRun], model: Model) -> _Ready:
        check_runs(runs)
        shifted, notes = aligned(by_length(runs))
        shifted = without_corners(shifted, model)
        early_ms = offset_ms(shifted, model)
        steady, read = as_turned(shifted, early_ms)
        notes += read + [f"{run.run_id}: {remark}" for run in runs for remark in run.remarks]
        model = with_unknown_rate(model, runs)
        disturbed = without_disturbances(steady, model)
        variants = candidate_variants(model, disturbed.runs)
        return _Ready(model, variants, disturbed, prepare(disturbed.runs, model, variants), notes, early_ms)

    def which(self, data: _Ready) -> _Sets:
        named_hz = lines_hz((*data.model.disturbances, *data.disturbed.terms))
        found = judged_sets(data.data, data.model, data.variants, lines_hz=named_hz)
        if not found.best.members:
            return found, data.variants
        variants, again = second_look(found, data.model, data.variants)
        return judged_sets(again, data.model, variants, found.hidden, named_hz), variants

    def finding(self, data: _Ready, sets: _Sets) -> RateFinding:
        found, variants = sets
        best, ready, disturbed, runs = found.best, found.data, data.disturbed, data.disturbed.runs
        causes, resembles = causes_of(found, variants, data.model)
        weights = set_weights(found.judged)
        # a level that steps has the spectrum of a random walk: runs without repeats are looked at for it, too
        jumps = find_jumps(ready, best.solution, alone=ready.noise.named in _WALKS)
        differs = max(ready.noise.differs, _JUMPS if jumps else 0.0)
        left = places(ready.cells, best.left, ready.floor)
        below = _left_by_codes(ready.groups, left)
        unnamed = 0.0 if below else sum(both[1] for both in weights.values())
        shaken = _shaken(ready.noise, runs)
        # probabilities are sums, which may be more than 1 by rounding
        unknown = 1.0 - max(1.0 - unnamed, 0.0) * max(1.0 - differs, 0.0) * max(1.0 - shaken, 0.0)
        coded = within_codes(causes, runs)
        within = frozenset().union(*(cause.effects | set(cause.one_of) for cause in coded))
        null = sum(both[0] + both[1] * below for names, both in weights.items() if names <= within)
        causes = tuple(cause for cause in causes if cause not in coded)
        resembles = () if below else resembles
        if null > _DOUBTED:
            causes, resembles = (), ()
        crowd = crowded(causes, resembles)
        causes = tuple(cause for cause in causes if cause not in crowd)
        resembles = (*resembles, *crowd)
        if not causes or crowd:
            # something is there, and no name for it is sure
            unknown = max(unknown, 1.0 - null if resembles else 0.0)
        stochastic = _stochastic(ready.noise, runs) if unknown < 0.5 else {}
        stochastic = {**stochastic, **disturbed.probabilities}
        where = places(ready.cells, found.before, ready.floor)
        active: dict[str, set[int]] = {}
        for place in where:
            if place.clear:
                active.setdefault(place.profile, set()).add(BANDS.index(place.band))
        nominal = left_of_runs(ready, nominal_solution(ready.cells, data.model.sigmas))
        model = _corrected(data.model, best.solution, ready.noise.noise)
        model = _beside(model, found, data.model, causes)
        named = [term for cause in causes for term in cause.terms]
        finding = RateFinding(
            signal="rate",
            unit="deg/h",
            verdict=_verdict(bool(causes or stochastic), unknown, runs, max(shaken, differs)),
            causes=causes,
            places=tuple(where),
            left=tuple(left),
            stochastic=stochastic,
            terms=(*named, *disturbed.terms),
            warnings=(
                *data.notes,
                *of_floor(ready),
                *_of_lines(found, disturbed),
                *of_codes(coded, below, runs),
                *of_time(causes, runs),
                *of_nominal(data.model, model),
                *of_same(data.model, runs),
                *(of_noise(data.model, runs) if unknown > 0.5 else ()),
            ),
            model=model,
            resembles=resembles,
            unknown_probability=unknown,
            null_probability=null,
            set_probabilities={
                names: both[0] + both[1] for names, both in weights.items() if sum(both) > 1e-4
            },
            disturbed=disturbed,
            noise=ready.noise,
            floor=ready.floor,
            phases=tuple(
                phase_map(ready.groups, _mixed(ready.groups, nominal), ready.floor, ready.noise.noise)
            ),
            regimes=tuple(regime_map(ready.groups, nominal, ready.floor, ready.noise.noise, active)),
            unidentifiable=found.hidden,
            unknown_parts=(
                *([crowd_part([cause.name for cause in filter(follows_rate, resembles)])] if crowd else ()),
                *(unknown_parts(found, variants, left, active) if unknown > 0.5 and not crowd else ()),
                *differing_parts(ready, best.solution, jumps, found.line if best.line else None),
                *([shaken_part(ready.noise.noise, _finest_arcsec(runs))] if shaken > 0.5 else ()),
            ),
            latitude_deg=runs[0].stimulus.latitude_deg,
        )
        if unknown > 0.5:
            # fitted beside a curve that is not in the closed model, a cause may widen the gap by itself
            named_alone = _effects_of(causes)
            parts = self._holding(finding, data, sets, runs, named_alone)
            finding = _doubted(finding, parts, "where what is unknown stays")
        if differs >= _DIFFERS:
            # what one repeat shows and another does not may resemble any effect in their mean
            repeats = np.array(
                [self._holding(finding, data, sets, each) for each in _by_repeat(ready.groups)]
            )
            # some runs have fewer repeats than others: one in which a cause adds nothing says nothing of it
            least = np.where(np.isnan(repeats), np.inf, repeats).min(axis=0)
            finding = _doubted(finding, np.where(np.isinf(least), 0.0, least).tolist(), "in every repeat")
        if unnamed < 0.5 and not crowd:
            return finding
        closing = learned(ready, data.model, [term for cause in finding.causes for term in cause.terms])
        return replace(finding, learned=closing, terms=(*finding.terms, *closing.terms))

    def judged(
        self, finding: RateFinding, data: _Ready, sets: _Sets, held_out: Sequence[GapRun]
    ) -> RateFinding:
        held_out, _ = as_turned(without_corners(aligned(held_out)[0], data.model), data.early_ms)
        parts = self._holding(finding, data, sets, held_out)
        held = {cause.name: part for cause, part in zip(finding.causes, parts, strict=True)}
        finding = replace(_doubted(finding, parts, "in held-out runs"), held=held)
        finding = replace(finding, model=_beside(finding.model, sets[0], data.model, finding.causes))
        ready = data.data
        # what the nominal model's own parameters take away is no part of the gap
        alone = nominal_solution(ready.cells, data.model.sigmas)
        before = _corrected(data.model, alone, ready.noise.noise)
        after = _closed(finding, data.disturbed.runs)
        return replace(finding, held_out=(shrinkage(before, after, held_out, finding.floor),))

    def _holding(
        self,
        finding: RateFinding,
        data: _Ready,
        sets: _Sets,
        runs: Sequence[GapRun],
        among: Set[str] | None = None,
    ) -> list[float]:
        """Return for the causes which part of what each adds is there in some runs; NaN where it adds nothing.

        Beside it stand those `among` the best set, without these all of it.
        """
        if not finding.causes:
            return []
        names = [cause.effects for cause in finding.causes]
        among = sets[0].best.names if among is None else among
        whole, *without = models_with_and_without(*sets, data.model, names, among)
        return holding(whole, without, runs, finding.floor)


def _left_by_codes(groups: Sequence[Group], left: Sequence[Place]) -> bool:
    """Return whether all that is clearly left may be of the codes of the table's angle."""
    clear = [place for place in left if place.clear]
    by_profile = {group.profile: group for group in groups}
    return bool(clear) and all(
        place.rms < codes_dph(by_profile[place.profile], BANDS.index(place.band)) for place in clear
    )


def _beside(corrected: Model, found: Found, model: Model, causes: Sequence[Cause[Term]]) -> Model:
    """Return a corrected nominal model with the values that fit beside the causes, and nothing else."""
    values = nominal_beside(found, model, _effects_of(causes))
    terms = model.moved(values, model.sigmas).terms
    return replace(
        corrected,
        terms=tuple(replace(own, values=new.values) for own, new in zip(corrected.terms, terms, strict=True)),
    )


def _closed(finding: RateFinding, used: Sequence[GapRun]) -> Model:
    """Return the nominal model as fitted to the runs `used`, with the terms of a finding."""
    fitted = tuple(term for term in finding.terms if isinstance(term, Term))
    checksums = {run.run_id: run.checksum for run in used}
    return replace(finding.nominal, terms=finding.nominal.terms + fitted, fitted_on=checksums)


def _effects_of(causes: Sequence[Cause[Term]]) -> Set[str]:
    """Return the names of all effects that are fitted for some causes."""
    return frozenset().union(*(cause.effects for cause in causes))


def _by_repeat(groups: Sequence[Group]) -> list[list[GapRun]]:
    """Return the runs of all groups by the number of their repeat."""
    most = max(len(repeats) for group in groups for repeats in group.runs)
    return [
        [repeats[number] for group in groups for repeats in group.runs if number < len(repeats)]
        for number in range(most)
    ]


def _doubted(finding: RateFinding, parts: Sequence[float], where: str) -> RateFinding:
    """Return a finding without the causes of which less than half is there `where` named, `parts` (causes,)."""
    kept = tuple(cause for cause, part in zip(finding.causes, parts, strict=True) if not part < _LEAST_HELD)
    if len(kept) == len(finding.causes):
        return finding
    gone = [cause for cause in finding.causes if cause not in kept]
    names = ", ".join(cause.name for cause in gone)
    terms = [term for cause in gone for term in cause.terms]
    return replace(
        finding,
        causes=kept,
        resembles=(*finding.resembles, *gone),
        terms=tuple(term for term in finding.terms if all(term is not other for other in terms)),
        warnings=(*finding.warnings, f"not named, less than half of it is there {where}: {names}"),
        verdict="explained in part" if kept else "unknown",
        unknown_probability=max(finding.unknown_probability, max(cause.acts for cause in gone)),
    )


def _verdict(named: bool, unknown: float, runs: Sequence[GapRun], at_rest: float) -> str:
    """Return the verdict; `at_rest` is the probability of what shows in runs in which nothing changes, too."""
    if not named and at_rest < 0.5 and _constant(runs):
        return "nothing to identify"
    if unknown > 0.5:
        return "explained in part" if named else "unknown"
    return "explained" if named else "no gap"


def _stochastic(verdict: NoiseVerdict, runs: Sequence[GapRun]) -> dict[str, float]:
    found = {verdict.named: verdict.probabilities[verdict.named]} if verdict.named else {}
    if max(run.lost_fraction for run in runs) > _LOST_FRACTION:
        found["lost_frames"] = 1.0
    return found


def _of_lines(found: Found, disturbed: Disturbed) -> list[str]:
    """Say where the lines that were found lie in the rows of the logs."""
    lines = [found.line.frequency_hz] if found.line is not None and found.best.line else []
    for term in disturbed.terms:
        lines += [
            value
            for one, value in zip(term.effect.parameters, term.values, strict=True)
            if one.unit.symbol == "Hz"
        ]
    return [in_rows(frequency_hz, disturbed.runs).sentence for frequency_hz in lines]


def _shaken(verdict: NoiseVerdict, runs: Sequence[GapRun]) -> float:
    """Return the probability of noise as of quantisation where the logs have steps far finer than its quantum.

    White noise of the angle has the same spectrum: a base that shakes makes it.
    """
    if verdict.named != _QUANTISATION or not _finest_arcsec(runs) < _FINER * verdict.noise.quantum_arcsec:
        return 0.0
    return verdict.probabilities[_QUANTISATION]


def _finest_arcsec(runs: Sequence[GapRun]) -> float:
    """Return the coarsest of the logs' finest steps of angle, NaN where one is not known."""
    return float(np.max([run.finest_arcsec for run in runs]))


def _corrected(model: Model, solution: Solution, noise: Noise) -> Model:
    """Return the model with its parameters re-fitted beside the best set, and with the noise that was found."""
    return replace(model.moved(solution.values, np.sqrt(np.diag(solution.covariance))), noise=noise)


def _mixed(groups: Sequence[Group], residuals: Sequence[Array]) -> list[Array]:
    """Return the parity runs of each run's whitened coefficients."""
    return [mixing(group)[2] @ own for group, own in zip(groups, residuals, strict=True)]


def _constant(runs: Sequence[GapRun]) -> bool:
    """Return whether neither temperature, nor rate, nor angle, nor attitude changes in or between the runs."""
    spans = (
        (2.0, [run.stimulus.warm_k for run in runs]),
        (0.01, [run.stimulus.table_rate_dps for run in runs]),
        (0.5, [run.stimulus.elevation_deg for run in runs]),
        (1.0, [run.stimulus.angle_deg % 360.0 for run in runs]),
    )
    return all(np.ptp(np.concatenate(values)) < least for least, values in spans)
