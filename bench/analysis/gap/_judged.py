"""Sets of effects as judged, and which of them differ by no more than the form of an effect.

The catalogue's formula of an effect never is quite the real one: what is left of it looks like a further effect,
or like another one in its place.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.special import expit

from bench.analysis.gap._cells import Cell
from bench.analysis.gap._fit import MISFIT, TOLERANCE, Solution, counts
from bench.analysis.gap._generic import FreeCurve, absorbed
from bench.analysis.gap._unknown import Remainder, active
from drivers.base.arrays import Array
from simulators.effects import Effect, Input

_UNKNOWN_PRIOR = 5.0
_TEMPERATURES = Input.T_IN | Input.T_OUT | Input.WARMING | Input.GRADIENT
_DYNAMIC = Input.WARMING | Input.GRADIENT | Input.HISTORY
_DIRECTIONS = Input.ANGLE | Input.ATTITUDE
_OF_ATTITUDE = 0.15
"""What the formula of a field or of gravity may miss, as TOLERANCE for temperatures."""
_UNSETTLED = 0.2
"""The same for a memory that had not settled when the record began, as every formula takes it to have."""
_PARTS = 50.0
"""Independent parts in which the misfit of a formula shows, over all runs."""
_EXACT = (10.0, 0.003)
"""Energy, and part of the gap's energy, below which what two formulas leave does not tell them apart."""
_BEHIND = 0.1
"""Log odds by which the best set stays ahead of what only the form of an effect tells from it."""


@dataclass(frozen=True)
class Judged:
    """A set of effects, fitted; `left` (cells,) is the energy it leaves, `line` log evidence of a line.

    `without_curves` is the fit of its catalogue effects alone, `in_form` that with the real forms of its effects.
    """

    names: frozenset[str]
    members: frozenset[int]
    log_evidence: float
    solution: Solution
    left: Array
    rest: Remainder
    without_curves: Solution
    in_form: Solution
    curves: frozenset[str] = frozenset()
    line: float = 0.0

    @property
    def curved(self) -> bool:
        """Whether a free curve is a member."""
        return bool(self.names & self.curves)

    @property
    def remains(self) -> bool:
        """Whether something is left that is more probably an effect than not, free curves taken out."""
        return self.rest.total + self.line > _UNKNOWN_PRIOR

    @property
    def unknown(self) -> float:
        """Probability that something is missing beside the effects of this set."""
        if self.curved:
            return 1.0
        return float(expit(self.rest.total + self.line - _UNKNOWN_PRIOR))


LeftWithout = Callable[[Judged, frozenset[str]], Array]
"""Energy that a set leaves in each cell, (cells,), fitted again without some of its effects."""


def instead_of(
    curve: str,
    names: frozenset[str],
    by_effects: Mapping[frozenset[str], float],
    curves: frozenset[str],
) -> frozenset[str] | None:
    """Return the best set with an effect of the catalogue in a curve's place, however improbable; None if none.

    Whether the curve is more than that effect's form is judged by what they take away.
    """
    if curve not in curves:
        return None
    others = names - {curve}
    possible = [
        by_effect
        for by_effect in by_effects
        if others < by_effect and len(by_effect) == len(names) and not (by_effect - others) & curves
    ]
    return max(possible, key=lambda each: by_effects[each], default=None)


def missed_beside(curve: Effect) -> float:
    """Return what an effect's formula may miss beside a curve over its very input, as a part of its amplitude.

    A table turns unevenly with any harmonics of its angle: half of the energy may be in those of no formula.
    """
    waves = isinstance(curve, FreeCurve) and curve.orders and curve.curve.of_rate
    return 1.0 if waves else TOLERANCE


def curves_that_matter(
    judged: Sequence[Judged],
    left_without: LeftWithout,
    effects: Mapping[str, Effect],
) -> list[Judged]:
    """Return the sets less those with a free curve that is no better than a formula's misfit lets it be.

    Compared are sets with a catalogue effect in the curve's place, or nothing. What counts is what that effect
    takes away (with nothing there, all); a curve over its very input may be its real form: more is tolerated. A
    set that lacks others of the curve's set says something of the curve only if it has an effect of its input.
    """

    def enough(curved: Judged, curve: str, other: Judged) -> bool:
        instead = other.names - curved.names
        same = frozenset(name for name in other.names if absorbed(effects[name], [effects[curve]]))
        same = same if same & instead else frozenset()
        if not curved.names - {curve} <= other.names and not same:
            return True
        # what else it has does not stand for the curve; formulas of one input draw a curve together
        instead = same or instead
        theirs = float((left_without(other, instead or other.names) - other.left).sum())
        gained = float(other.left.sum()) - float(curved.left.sum())
        missed = missed_beside(effects[curve]) if same else MISFIT
        return gained > missed**2 * theirs

    by_names = {one.names for one in judged}
    forms: list[tuple[frozenset[str], str, frozenset[str]]] = []
    for one in judged:
        for curve in one.names & one.curves:
            for other in judged:
                if len(other.names) > len(one.names) or curve in other.names:
                    continue
                if (other.names - one.names) & other.curves:
                    continue
                if not enough(one, curve, other):
                    forms.append((one.names, curve, other.names - one.names))

    def only_form(one: Judged) -> bool:
        """Return whether a set holds a form; what is added to one makes no effect of it."""
        return any(
            names == one.names or (names < one.names and (one.names - {curve}) | instead not in by_names)
            for names, curve, instead in forms
        )

    return [one for one in judged if not only_form(one)]


def correcting(names: frozenset[str], effects: Mapping[str, Effect]) -> Iterator[frozenset[str]]:
    """Yield the members of a set that may only correct the form of those that stay, fewest first."""
    for count in range(1, len(names)):
        for gone in combinations(sorted(names), count):
            stay = names.difference(gone)
            if all(any(_missed(effects[other], effects[name]) for other in stay) for name in gone):
                yield frozenset(gone)


def less_forms(
    judged: Sequence[Judged],
    left_without: LeftWithout,
    effects: Mapping[str, Effect],
) -> list[Judged]:
    """Return the sets less those whose weaker members only correct the form of the others.

    A bench measures temperatures at one or two places; a formula of them is never quite the real effect. The
    smaller set takes over how probable the larger one is, and what that leaves.
    """
    by_names = {one.names: one for one in judged}

    def only_correct(one: Judged, gone: frozenset[str]) -> bool:
        smaller = by_names.get(one.names - gone)
        if smaller is None:
            return False
        whole = float(smaller.left.sum())
        missed = 0.0
        for name in smaller.names:
            part = min(_missed(effects[name], effects[other]) or math.inf for other in gone)
            if math.isfinite(part):
                theirs = float(left_without(smaller, frozenset([name])).sum()) - whole
                missed = max(missed, part**2 * theirs)
        return whole - float(one.left.sum()) <= missed

    heirs: dict[frozenset[str], Judged] = {}
    for one in sorted(judged, key=lambda each: -len(each.names)):
        one = heirs.pop(one.names, one)
        smaller = [one.names - gone for gone in correcting(one.names, effects) if only_correct(one, gone)]
        if not smaller:
            heirs[one.names] = one
            continue
        least = min(len(names) for names in smaller)
        heir = min(
            (by_names[names] for names in smaller if len(names) == least),
            key=lambda each: float(each.left.sum()),
        )
        heir = heirs.get(heir.names, heir)
        better = one.rest.total < heir.rest.total
        heirs[heir.names] = replace(
            heir,
            log_evidence=max(heir.log_evidence, one.log_evidence),
            rest=one.rest if better else heir.rest,
            in_form=one.in_form if better else heir.in_form,
        )
    return list(heirs.values())


def told_by_form(
    judged: Sequence[Judged],
    left_without: LeftWithout,
    cells: Sequence[Cell],
    effects: Mapping[str, Effect],
) -> list[Judged]:
    """Return the sets, those made more probable that only the form of one effect tells from the best.

    What a formula leaves of the real effect is no noise: it repeats from run to run. Of unknown size and with few
    independent parts, its log likelihood is Student's, -n/2 ln(energy left), and not -1/2 energy left (Box and
    Tiao, Bayesian Inference in Statistical Analysis, 1973, section 2.4). No formula is trusted to leave less than
    a small part of what its effect takes away; what is left where another effect acts is not the formula's.
    """
    best = max(judged, key=lambda one: one.log_evidence)
    number = counts(cells)
    acting: dict[str, tuple[Array, float]] = {}

    def acts(name: str) -> tuple[Array, float]:
        """Return the part of each cell that an effect of the best set has, and what its formula leaves, energy.

        Above the noise, and at least what may be left.
        """
        if name not in acting:
            without = left_without(best, frozenset([name]))
            taken = np.maximum(without - best.left, 0.0)
            own = active(cells, taken + number)
            part = taken / np.maximum(np.maximum(without - number, taken), 1e-12)
            excess = np.maximum(best.left - number, 0.0)
            acting[name] = (
                part,
                _EXACT[0] + _EXACT[1] * float(taken.sum()) + float((part * excess)[own].sum()),
            )
        return acting[name]

    result = []
    for one in judged:
        theirs, ours = one.names - best.names, best.names - one.names
        if len(theirs) == len(ours) == 1:
            other, own = effects[next(iter(theirs))], effects[next(iter(ours))]
            if _missed(own, other) and not isinstance(other, FreeCurve):
                part, leaves = acts(own.name)
                # elsewhere a stronger effect of both sets, fitted a little otherwise, leaves more or less
                more = max(float((part * (one.left - best.left)).sum()), 0.0)
                behind = 0.5 * _PARTS * math.log1p(more / leaves)
                behind = max(behind + 0.5 * _further(other, own) * math.log(1.0 + _PARTS), _BEHIND)
                one = replace(one, log_evidence=max(one.log_evidence, best.log_evidence - behind))
        result.append(one)
    return result


def _further(other: Effect, own: Effect) -> int:
    """Return how many parameters an effect has beyond one in its place, whose shapes make up for some."""
    more = len(other.parameters) - len(own.parameters)
    shapes = len(own.moving) - len(other.moving)
    return max(more - max(shapes, 0), 0) if more > 0 else more


def same_driver(one: Effect, other: Effect) -> bool:
    """Return whether two effects follow the very same: one mechanism of another form may need both formulas.

    Of rates, even functions are of one kind, and odd ones; else the inputs of temperature count.
    """
    if one.parity is not None and one.parity == other.parity:
        return True
    return one.unit == other.unit and one.inputs == other.inputs and bool(one.inputs & _TEMPERATURES)


def _missed(one: Effect, other: Effect) -> float:
    """Return the part of an effect's amplitude that another, added alike, may correct in its formula; 0 for none.

    Temperatures are measured at one or two places, and all that follows them follows their changes and their
    memory, too; a free curve only what it is over. Attitudes are known; what a field does with them less so. Of
    rates, even functions are akin, and odd ones: a curve bends as it will, and keeps its parity. A memory is
    settled at its first value in every formula; what it was in truth dies away like something that warms up.
    """
    if one.parity is not None and one.parity == other.parity:
        return TOLERANCE
    if one.unit != other.unit:
        return 0.0
    common, either = one.inputs & other.inputs, one.inputs | other.inputs
    curves = [each for each in (one, other) if isinstance(each, FreeCurve)]
    if curves:
        least = MISFIT if any(curve.local for curve in curves) else TOLERANCE
        return least if common & (_TEMPERATURES | Input.TIME) else 0.0
    if (one.inputs & _TEMPERATURES and other.inputs & _TEMPERATURES) or common & (Input.TIME | Input.CLOCKS):
        return TOLERANCE
    if either & Input.TIME and either & _DYNAMIC:
        return _UNSETTLED
    return _OF_ATTITUDE if common & _DIRECTIONS else 0.0
