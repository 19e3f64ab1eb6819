"""Where a search for the missing effect stands: explanations with probability, and what the next run would tell.

An explanation is a set of effects that a diagnosis names, or one more that may act beside it and that the runs so
far could not show. Such a hidden effect is taken for one that the bench's best run for it would show with 40
standard deviations; each run that could have shown it and did not makes it less probable.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np

from bench.analysis.gap._candidates import effects_beside
from bench.analysis.gap._columns import Columns, usual_variant
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._designs import Design
from bench.analysis.gap._evidence import reduced
from bench.analysis.gap._heat import Heat, heat_of
from bench.analysis.gap._information import Alikeness, Foretold, alikeness, deflection, expected_if
from bench.analysis.gap._model_file import Model, Term
from bench.analysis.gap._predictions import fitted, log_odds
from bench.analysis.gap._rate import RateFinding
from drivers.base.arrays import Array

UNKNOWN = "unknown"
_WORTH_FINDING = 40.0
"""Standard deviations that a hidden effect has in the bench's best run for it."""
_MOST_SIGMAS = 1e6
"""The most of any effect."""
_VISIBLE = 5.0
"""Standard deviations below which a bench does not show an effect however large it may be."""
_FIRST, _ANOTHER = 1.0, 0.25
"""Prior odds that something acts where nothing was found, and that one more does beside what was found."""
_DOUBTED = 0.1
"""Probability that a diagnosis gives to something unknown, whatever the runs, as a rule: no evidence of it."""
_MOST_LOG_ODDS = 50.0
"""Log odds of a hidden effect beyond which they are not told apart: it is as probable as what leads."""
_LEAST = 1e-3
"""Probability below which an explanation is left out."""

NOTHING_MADE: Mapping[str, Sequence[GapRun]] = MappingProxyType({})

Label = frozenset[str]
"""Names of the effects that act; empty: no gap."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """What may be true: effects as fitted, and perhaps a hidden one beside them, of which the size is unknown.

    The label has the noise effects and disturbances, too, that the diagnosis names beside any of them.
    """

    label: Label
    probability: float
    terms: tuple[Term, ...] = ()
    hidden: str = ""

    @property
    def bare(self) -> bool:
        """Whether nothing acts but noise and disturbances, if these do."""
        return not (self.terms or self.hidden or UNKNOWN in self.label)


@dataclass(frozen=True)
class Choice:
    """A run that could be made next, with the information expected of it, in nats.

    `if_true`: the probability that what acts most probably will have after it, if it is what acts.
    """

    design: Design
    nats: float
    if_true: float = math.nan


@dataclass(frozen=True, eq=False)
class Outlook:
    """Explanations after some runs, and the bench's `designs`; what is `hidden_from_bench` none of them shows.

    `energies` are of each effect in the bench's best run for it, its first parameter at 1: the square of the
    standard deviations by which it stands above the noise.
    """

    model: Model
    designs: Sequence[Design]
    explanations: tuple[Explanation, ...]
    hidden_from_bench: tuple[str, ...]
    energies: Mapping[str, float]
    _columns: Columns = field(repr=False)
    _before: Array = field(repr=False)
    _recorded: Array = field(repr=False)
    _sigmas: Array = field(repr=False)
    _acting: Array = field(repr=False)
    _made: Mapping[str, Sequence[GapRun]] = field(repr=False, default_factory=dict)
    _heat: Heat | None = None
    _seen: dict[tuple[str, str], tuple[Array, Array]] = field(repr=False, default_factory=dict)
    _alike: dict[tuple[str, str], Alikeness] = field(repr=False, default_factory=dict)

    @property
    def leading(self) -> Explanation:
        """The most probable explanation."""
        return max(self.explanations, key=lambda each: each.probability)

    @cached_property
    def probabilities(self) -> dict[Label, float]:
        """Probability by what acts, hidden effects included."""
        found: dict[Label, float] = {}
        for each in self.explanations:
            found[each.label] = found.get(each.label, 0.0) + each.probability
        return found

    def choices(self, most_h: float = math.inf) -> list[Choice]:
        """Return the designs that last at most so long, by expected information an hour."""
        made = [self._choice(each) for each in self.designs if each.hours <= most_h]
        return sorted(made, key=lambda each: -each.nats / each.design.hours)

    def information(self, design: Design, among: Collection[Label] = ()) -> float:
        """Return the information expected of a run, in nats; `among`: if only these may act.

        It is about what acts and, if that is a hidden effect, about another beside it: of two the first has its
        probability, the second that of any other. Two are taken to be as far apart in a run as each alone.
        """
        at = design.key, design.text
        if at not in self._alike:
            self._alike[at] = alikeness(self._grams(design)[1][1:, 1:], self._predictions)
        alike = self._alike[at]
        first = [0.0 if among and each.label not in among else each.probability for each in self.explanations]
        nats = alike.information(first)
        hidden = [each.probability if each.hidden else 0.0 for each in self.explanations]
        if among or self.leading.label or not any(hidden):
            return nats
        beside = [_ANOTHER * own / sum(hidden) for own in hidden]
        beside[self.explanations.index(self.leading)] = 1.0
        return nats + sum(hidden) / sum(first) * alike.information(beside)

    @cached_property
    def _predictions(self) -> list[Foretold]:
        return [self._foretold(each) for each in self.explanations]

    def _choice(self, design: Design) -> Choice:
        gram = self._grams(design)[1][1:, 1:]
        leading = self.leading
        after = expected_if(gram, self._predictions, self.explanations.index(leading))
        same = [each.label == leading.label for each in self.explanations]
        return Choice(design, self.information(design), float(after[same].sum()))

    def showing(self, names: Label, most_h: float, least: float) -> Choice | None:
        """Return the shortest run in which some leading effects stand so far above the noise, if there is one.

        A run of another kind than those made comes before one of the same: a wrong form that was fitted to a run
        fits its repeat as well. Noise and disturbances alone show in any run.
        """
        terms = [term for term in self.leading.terms if term.name in names] or list(self.leading.terms)
        mean = self._columns.values(terms)
        for design in sorted(self.designs, key=lambda each: (each.key in self._made, each.hours)):
            if design.hours > most_h:
                continue
            plain = reduced(self._grams(design)[0], self.model.sigmas)[1:, 1:]
            if self.leading.bare or deflection(plain, mean) >= least:
                return Choice(design, self.information(design))
        return None

    def _grams(self, design: Design) -> tuple[Array, Array]:
        """Return the products in a run of [data, nominal, effects' columns], and the same on effects' misfit."""
        at = design.key, design.text
        if at not in self._seen:
            runs = self._foreseen(design)
            self._seen[at] = self._columns.products(runs, self._acting, self._before)
        return self._seen[at]

    def _foreseen(self, design: Design) -> Sequence[GapRun]:
        """Return what would act on the gyro: of a run that was made what was recorded, else what is foretold.

        Explanations that are fitted to a record agree on it. They do not agree on a stimulus that differs from it
        by what the foretelling of heat is off, and the same run would seem to tell them apart again and again.
        """
        recorded = self._made.get(design.key)
        if recorded or self._heat is None:
            return recorded or design.runs()
        return [self._heat.on(run) for run in design.runs()]

    def _foretold(self, explanation: Explanation) -> Foretold:
        own = [self._columns.place(term.variant) for term in explanation.terms]
        if explanation.hidden:
            own.append(self._columns.usual(explanation.hidden))
        follows = np.concatenate((np.zeros(len(self.model.sigmas)), self._acting))
        at = self._columns.indices(own)
        return fitted(self._recorded, self._sigmas, at, follows, explanation.probability)


def outlook(
    finding: RateFinding | None,
    model: Model,
    recorded: Sequence[GapRun],
    designs: Sequence[Design],
    made: Mapping[str, Sequence[GapRun]] = NOTHING_MADE,
) -> Outlook:
    """Return where a search stands: `finding` is that of the `recorded` runs, None before the first.

    `made`: the stretches of the newest run of a design by its key.
    """
    known = model if finding is None else finding.nominal
    effects = effects_beside(model)
    named = _named(finding)
    total = sum(each.probability for each in named)
    named = [replace(each, probability=each.probability / total) for each in named]
    leading = max(named, key=lambda each: each.probability)
    usual = {name: usual_variant(effect) for name, effect in effects.items()}
    columns = Columns(known, usual).with_terms([term for each in named for term in each.terms])
    acting = columns.values(leading.terms)
    heat = heat_of(recorded)
    foretold = [[run if heat is None else heat.on(run) for run in design.runs()] for design in designs]
    before, tolerant = columns.products(recorded, acting)
    grams = [columns.products(runs, acting, before) for runs in foretold]
    energies = np.array([np.diag(reduced(plain, known.sigmas))[1:] for plain, _ in grams])
    best = energies.max(axis=0, initial=0.0)
    sigmas = foreseeable(columns.bounds(model.noise.coarseness), best)
    shown: dict[str, float] = {}
    for name in effects:
        own = columns.usual(name)
        sigmas[own] = np.minimum(_WORTH_FINDING / np.sqrt(np.maximum(best[own], 1e-300)), sigmas[own])
        if (sigmas[own] * np.sqrt(best[own])).max() >= _VISIBLE:
            shown[name] = float(best[own][0])
    prior = np.concatenate((model.sigmas, sigmas))
    odds = _odds(columns, tolerant, prior, leading, [name for name in shown if name not in leading.label])
    share = (_ANOTHER if leading.label else _FIRST) / max(len(shown), 1)
    hidden = [
        Explanation(leading.label | {name}, min(share * each, 1.0) * leading.probability, leading.terms, name)
        for name, each in odds.items()
    ]
    kept = [*named, *(each for each in hidden if each.probability > _LEAST * share)]
    total = sum(each.probability for each in kept)
    normed = tuple(replace(each, probability=each.probability / total) for each in kept)
    unseen = tuple(name for name in effects if name not in shown)
    ready = {
        (design.key, design.text): own
        for design, own in zip(designs, grams, strict=True)
        if design.key not in made
    }
    return Outlook(
        known,
        designs,
        normed,
        unseen,
        shown,
        columns,
        before,
        tolerant[1:, 1:],
        prior,
        acting,
        made,
        heat,
        ready,
    )


def foreseeable(bounds: Array, best: Array) -> Array:
    """Return prior sigmas (p,): the bounds of parameters, as far as arithmetic goes.

    `best` (p,) is the energy of a unit of each in the bench's best run. A bound of a coarse gyro may be 1e10
    standard deviations there: of its square and of 1 double precision leaves nothing.
    """
    return np.minimum(bounds, _MOST_SIGMAS / np.sqrt(np.maximum(best, 1e-300)))


def _odds(
    columns: Columns, recorded: Array, prior: Array, leading: Explanation, names: Sequence[str]
) -> dict[str, float]:
    """Return the odds that the recorded runs give for each hidden effect against none beside the leading ones.

    They are those of data in which there is nothing of it. Where no effect is named but the data show it clearly,
    they are not: what a diagnosis does not name for its other reasons is no less probable for that. Beside named
    effects the data hold what these effects' formulas miss.
    """
    known = columns.indices([columns.place(term.variant) for term in leading.terms])
    found = {}
    for name in names:
        own = np.setdiff1d(columns.indices([columns.usual(name)]), known)
        as_fitted, without = log_odds(recorded, prior, known, own)
        shown = leading.bare and 2.0 * (as_fitted - without) > _VISIBLE**2
        found[name] = math.exp(min(as_fitted if shown else without, _MOST_LOG_ODDS))
    return found


def information_gained(before: Mapping[str, float], after: Mapping[str, float]) -> float:
    """Return how far the probabilities moved, in nats: the Kullback-Leibler divergence of after from before.

    Names that act together are joined by " + ". What was not held possible before had the probability that
    one effect, or one and others beside it, have before any run; nothing had less than two together.
    """
    count = max(len({one for name in before for one in name.split(" + ")}), 1)
    first, another = _FIRST / (1.0 + _FIRST) / count, _ANOTHER / count

    def prior(name: str) -> float:
        fresh = first * another ** name.count(" + ")
        return max(before.get(name, fresh), first * another)

    gained = 0.0
    for label, probability in after.items():
        if probability > _LEAST:
            gained += probability * math.log(probability / prior(label))
    return max(gained, 0.0)


def _named(finding: RateFinding | None) -> list[Explanation]:
    """Return what a diagnosis holds possible, with the terms that it fitted."""
    if finding is None:
        return [Explanation(frozenset(), 1.0)]
    beside = frozenset(finding.stochastic)
    terms = {name: term for cause in finding.causes for name, term in cause.rivals.items()}
    terms |= {term.name: term for cause in (*finding.resembles, *finding.causes) for term in cause.terms}
    unknown = finding.unknown_probability if finding.unknown_probability > _DOUBTED else 0.0
    found = [
        Explanation(
            label | beside, probability * (1.0 - unknown), tuple(terms[name] for name in sorted(label))
        )
        for label, probability in finding.set_probabilities.items()
        if label <= terms.keys() and probability > _LEAST
    ]
    if unknown > _LEAST:
        label = beside.union({UNKNOWN}, (cause.name for cause in finding.causes))
        curves = [part.term for part in finding.unknown_parts if part.term is not None]
        learned = finding.learned.terms if finding.learned and not curves else ()
        parts = (*(term for cause in finding.causes for term in cause.terms), *curves, *learned)
        found.append(Explanation(label, unknown, parts))
    return found or [Explanation(beside, 1.0)]
