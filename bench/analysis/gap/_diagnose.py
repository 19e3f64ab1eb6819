"""The diagnosis: runs and a nominal model in, where, which and what is left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench.analysis.gap._align import aligned
from bench.analysis.gap._candidates import candidate_variants
from bench.analysis.gap._causes import Cause, causes_of
from bench.analysis.gap._cells import BANDS, mixing
from bench.analysis.gap._data import GapRun, Group, check_runs, unseen
from bench.analysis.gap._describe import UnknownPart, curve_part, line_part, remaining_part
from bench.analysis.gap._disturbed import Disturbed, without_disturbances
from bench.analysis.gap._fit import Floor, Solution, nominal_solution
from bench.analysis.gap._generic import PREFIX
from bench.analysis.gap._model_file import Model, Term
from bench.analysis.gap._noise import Noise
from bench.analysis.gap._prepare import Prepared, prepare
from bench.analysis.gap._stochastic import NoiseVerdict
from bench.analysis.gap._where import (
    SIGNIFICANT,
    PhasePlace,
    Place,
    RegimePlace,
    phase_map,
    places,
    regime_map,
)
from bench.analysis.gap._which import Found, judged_sets, left_of_runs, second_look, set_weights
from drivers.base.arrays import Array
from simulators.effects import Variant

_DOUBTED = 0.1
"""Probability of no gap from which on no cause is named, however probable one is beside it."""
_LONG_S = 3600.0
_LOST_FRACTION = 1e-4


@dataclass(frozen=True)
class Diagnosis:
    """Everything the diagnosis found; `model` is the nominal with corrected parameters, without the causes.

    `causes` are named; `resembles` are catalogue effects that fit part of what is called unknown.
    `unidentifiable` maps effects that these runs cannot show to the reason. `noise` is the floor;
    `stochastic` maps the noise effects and disturbances named to their probability, `disturbed` holds the latter.
    """

    unit_id: str
    model: Model
    causes: tuple[Cause, ...]
    resembles: tuple[Cause, ...]
    unknown_probability: float
    null_probability: float
    set_probabilities: Mapping[frozenset[str], float]
    stochastic: Mapping[str, float]
    disturbed: Disturbed
    noise: NoiseVerdict
    floor: Floor
    places: tuple[Place, ...]
    phases: tuple[PhasePlace, ...]
    regimes: tuple[RegimePlace, ...]
    left_places: tuple[Place, ...]
    unidentifiable: Mapping[str, str]
    warnings: tuple[str, ...]
    run_checksums: Mapping[str, str]
    unknown_parts: tuple[UnknownPart, ...]
    constant: bool

    def size_of(self, name: str) -> str:
        """Return in words the size of a noise effect or a disturbance that is named; empty for lost frames."""
        return self.disturbed.sentences.get(name) or self.noise.risen(name)

    @property
    def verdict(self) -> str:
        """One of "no gap", "explained", "explained in part", "unknown", "nothing to identify"."""
        named = bool(self.causes or self.stochastic)
        if self.constant and not named:
            return "nothing to identify"
        if self.unknown_probability > 0.5:
            return "explained in part" if named else "unknown"
        return "explained" if named else "no gap"


def diagnose(runs: Sequence[GapRun], model: Model) -> Diagnosis:
    """Diagnose the gap between runs of one unit and its nominal model."""
    check_runs(runs)
    shifted, notes = aligned(runs)
    disturbed = without_disturbances(shifted, model)
    runs = disturbed.runs
    variants = candidate_variants(model, runs)
    found = judged_sets(prepare(runs, model, variants), model, variants)
    if found.best.members:
        variants, again = second_look(found, model, variants)
        found = judged_sets(again, model, variants, found.hidden)
    return _reported(found, disturbed, model, variants, notes)


def _reported(
    found: Found, disturbed: Disturbed, model: Model, variants: Sequence[Variant], notes: Sequence[str]
) -> Diagnosis:
    runs = disturbed.runs
    data, best, judged, cells = found.data, found.best, found.judged, found.data.cells
    causes, resembles = causes_of(best, judged, found.posterior, variants, data, found.variance, model)
    weights = set_weights(judged)
    unknown = sum(both[1] for both in weights.values())
    null = weights.get(frozenset(), (0.0, 0.0))[0]
    if null > _DOUBTED:
        causes, resembles = (), ()
    stochastic = _stochastic(data.noise, runs) if unknown < 0.5 else {}
    stochastic = {**stochastic, **disturbed.probabilities}
    where = places(cells, found.before, data.floor)
    active: dict[str, set[int]] = {}
    for place in where:
        if place.p_value < SIGNIFICANT:
            active.setdefault(place.profile, set()).add(BANDS.index(place.band))
    left_places = places(cells, best.left, data.floor)
    noise = data.noise.noise
    nominal = left_of_runs(data, nominal_solution(cells, model.sigmas))
    return Diagnosis(
        runs[0].unit_id,
        _corrected(model, best.solution, data.noise.noise),
        causes,
        resembles,
        unknown,
        null,
        {names: both[0] + both[1] for names, both in weights.items() if sum(both) > 1e-4},
        stochastic,
        disturbed,
        data.noise,
        data.floor,
        tuple(where),
        tuple(phase_map(data.groups, _mixed(data.groups, nominal), data.floor, noise)),
        tuple(regime_map(data.groups, nominal, data.floor, noise, active)),
        tuple(left_places),
        found.hidden,
        (*notes, *_warnings(data)),
        {run.run_id: run.checksum for run in runs},
        tuple(_unknown_parts(found, variants, left_places, active)) if unknown > 0.5 else (),
        _constant(runs),
    )


def _stochastic(verdict: NoiseVerdict, runs: Sequence[GapRun]) -> dict[str, float]:
    found = {verdict.named: verdict.probabilities[verdict.named]} if verdict.named else {}
    if max(run.lost_fraction for run in runs) > _LOST_FRACTION:
        found["lost_frames"] = 1.0
    return found


def _corrected(model: Model, solution: Solution, noise: Noise) -> Model:
    """Return the model with its parameters re-fitted beside the best set, and with the noise that was found."""
    terms, at = [], 0
    deviations = np.sqrt(np.diag(solution.covariance))
    for term in model.terms:
        k = len(term.values)
        values = tuple(float(v + d) for v, d in zip(term.values, solution.values[at : at + k], strict=True))
        terms.append(Term(term.variant, values, tuple(deviations[at : at + k].tolist())))
        at += k
    return Model(model.name, tuple(terms), noise, model.fitted_on, disturbances=model.disturbances)


def _mixed(groups: Sequence[Group], residuals: Sequence[Array]) -> list[Array]:
    """Return the parity runs of each run's whitened coefficients."""
    return [mixing(group)[2] @ own for group, own in zip(groups, residuals, strict=True)]


def _unknown_parts(
    found: Found, variants: Sequence[Variant], left: Sequence[Place], bands: Mapping[str, set[int]]
) -> list[UnknownPart]:
    best, q = found.best, found.best.solution.indices.size
    parts: list[UnknownPart] = []
    nominal = q - sum(len(found.posterior.candidates[each].columns) for each in best.members)
    at = nominal
    for each in sorted(best.members):
        k = len(found.posterior.candidates[each].columns)
        if variants[each].effect.name.startswith(PREFIX):
            parts.append(curve_part(variants[each], best.solution.values[at : at + k].tolist()))
        at += k
    if found.line is not None and best.line:
        parts.append(line_part(found.line))
    if not parts:
        left_over = left_of_runs(found.data, best.solution)
        regimes = regime_map(found.data.groups, left_over, found.data.floor, found.data.noise.noise, bands)
        rest = remaining_part(left, regimes)
        parts += [] if rest is None else [rest]
    return parts


def _constant(runs: Sequence[GapRun]) -> bool:
    """Return whether neither temperature, nor rate, nor angle, nor attitude changes in or between the runs."""
    spans = (
        (2.0, [run.stimulus.warm_k for run in runs]),
        (0.01, [run.stimulus.table_rate_dps for run in runs]),
        (0.5, [run.stimulus.elevation_deg for run in runs]),
        (1.0, [run.stimulus.angle_deg % 360.0 for run in runs]),
    )
    return all(np.ptp(np.concatenate(values)) < least for least, values in spans)


def _warnings(data: Prepared) -> tuple[str, ...]:
    notes = []
    if not data.floor.from_repeats:
        notes.append("no repeated runs: the noise floor rests on " + data.noise.source)
    if data.noise.source == "data sheet":
        notes.append("no repeats and no quiet run: a wrong data sheet would look like a gap")
    runs = [run for group in data.groups for each in group.runs for run in each]
    hidden = {text for run in runs if (text := unseen(run.stimulus))}
    notes += sorted(hidden)
    if not hidden and all(np.ptp(run.stimulus.warm_k) < 2.0 for run in runs):
        notes.append("temperature hardly changes in these runs: no effect of temperature can be seen")
    longest = max(len(each.runs[0][0].stimulus) * each.runs[0][0].stimulus.period_s for each in data.groups)
    if longest < _LONG_S:
        notes.append(
            f"the longest run has {longest:.0f} s: what takes longer than {longest / 2.0:.0f} s (thermal lags, "
            "relaxation, bias instability) is not told from the run's own bias"
        )
    return tuple(notes)
