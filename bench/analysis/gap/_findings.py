"""What a diagnosis finds, in one shape for every kind of signal: places, causes, shrinkage, verdict."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from bench.analysis.gap._model_file import AnyTerm
from drivers.base.errors import ConfigurationError

SIGNIFICANT = 0.01
"""Probability, allowing for all places looked at, below which a place counts as gap."""
AMBIGUOUS = 0.02
"""Probability from which what could stand in a cause's place is listed."""

TermT = TypeVar("TermT", bound=AnyTerm | None, covariant=True)


@dataclass(frozen=True)
class Place:
    """One part of a signal at one time scale; `rms` above the floor is in the signal's unit.

    `part` is a combination of a profile's runs ("odd in rate") or a phase; a channel's places have no profile.
    `energy_ratio` is energy over floor, `p_value` allows for all places (Holm); `share` is of the gap in all
    significant places, 0 for the others. A phase begins at `start_s`.
    """

    profile: str
    part: str
    band: str
    rms: float
    share: float
    energy_ratio: float
    p_value: float
    start_s: float = 0.0

    @property
    def clear(self) -> bool:
        """Whether noise alone hardly does this in any of the places."""
        return self.p_value < SIGNIFICANT


@dataclass(frozen=True)
class Cause(Generic[TermT]):
    """An effect that explains (part of) a signal's gap; `term` has its values, None for one without values.

    `alternatives` maps what could stand in its place to its probability, `rivals` are those fitted there.
    `credibility` is the part of the gap explained where it acts (the rate's causes only). `nominal` are the
    values that the effect has without being a cause (a channel's only). `one_of` are the effects that these runs
    cannot tell apart, the named one first, and `set_probability` that one of them acts (the rate's causes only).
    `form` are effects of the same driver fitted beside it: one mechanism of a form that no formula has alone.
    """

    name: str
    meaning: str
    probability: float
    term: TermT
    alternatives: Mapping[str, float]
    rivals: Mapping[str, TermT] = field(default_factory=dict)
    credibility: float = math.nan
    nominal: tuple[float, ...] = ()
    one_of: tuple[str, ...] = ()
    set_probability: float = math.nan
    form: tuple[TermT, ...] = ()

    @property
    def acts(self) -> float:
        """Probability that it acts, or one of those that these runs cannot tell from it."""
        return self.set_probability if len(self.one_of) > 1 else self.probability

    @property
    def terms(self) -> tuple[TermT, ...]:
        """What a closed model needs of it, the named effect first; none for one without values."""
        return () if self.term is None else (self.term, *self.form)

    @property
    def effects(self) -> frozenset[str]:
        """Names of the effects that are fitted for it."""
        return frozenset({self.name, *(term.name for term in self.form if term is not None)})


@dataclass(frozen=True)
class Shrinkage:
    """Part of the reducible gap that is gone on held-out runs, with its 95 % interval; sizes before and after.

    `rms_*` are what is left above the floor, in the signal's unit. A position is judged run by run (`run_id`).
    For the rate `by_profile`, `by_runs` (common, odd in rate, ...) and `by_phase` ("profile: phase") hold the
    same share for their part of the data (NaN where it had no gap). `active` says which cells of the rate or of a
    channel have a gap; with none the share is NaN.
    """

    share: float
    low: float
    high: float
    rms_before: float
    rms_after: float
    run_id: str = ""
    by_profile: Mapping[str, float] = field(default_factory=dict)
    by_runs: Mapping[str, float] = field(default_factory=dict)
    by_phase: Mapping[str, float] = field(default_factory=dict)
    active: tuple[bool, ...] = ()

    @property
    def cells(self) -> int:
        """How many cells have a gap."""
        return sum(self.active)

    @property
    def caution(self) -> str:
        """What must be said when the model, fitted to some runs, does not hold on others; empty when it does."""
        if not self.cells or self.low > 0.5:
            return ""
        if self.high <= 0.0:
            return (
                "the held-out runs come no nearer with what was found: it belongs to the diagnosed runs alone; "
                "do not close the model with it"
            )
        return (
            "half of the gap or more may stay on held-out runs: what was found changes from run to run, "
            "or more is missing"
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Finding(Generic[TermT]):
    """What was found in one signal, sizes in `unit`: where, which, how far, what is left.

    `terms` go into the closed model. `stochastic` maps noise effects that stand out to probability or size.
    """

    signal: str
    unit: str
    verdict: str
    causes: tuple[Cause[TermT], ...] = ()
    places: tuple[Place, ...] = ()
    left: tuple[Place, ...] = ()
    stochastic: Mapping[str, float] = field(default_factory=dict)
    terms: tuple[AnyTerm, ...] = ()
    held_out: tuple[Shrinkage, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def closing(self) -> tuple[str, ...]:
        """Names of the effects that a closed model has and the nominal one has not."""
        return tuple(term.name for cause in self.causes for term in cause.terms if term is not None)

    @property
    def none_held_out(self) -> str:
        """What is to say where the held-out runs show no gap."""
        judged = ": they neither confirm nor refute what is named" if self.causes else ""
        return f"no gap above the floor on the held-out runs{judged}"


def rivals_of(name: str, names: frozenset[str], weights: Mapping[frozenset[str], float]) -> dict[str, float]:
    """Return what could stand in an effect's place in a set, the others kept, with probability among those.

    `weights` are of sets of effects, in any unit.
    """
    others = names - {name}
    places = {
        next(iter(each - others)): value
        for each, value in weights.items()
        if others <= each and len(each) == len(names)
    }
    total = sum(places.values())
    rivals = {rival: value / total for rival, value in places.items() if rival != name}
    return {rival: value for rival, value in rivals.items() if value > AMBIGUOUS}


def refuse_judges(judges: Iterable[tuple[str, str]], used: Iterable[tuple[str, str]]) -> None:
    """Raise ConfigurationError if a recording that is to judge a model is among those `used` for it.

    Of each its name and checksum: a copy of another name is the same, another recording of the name is not.
    """
    pairs = set(used)
    names, checksums = ({pair[k] for pair in pairs if pair[k]} for k in (0, 1))
    told = {name for name, checksum in pairs if checksum}
    if both := sorted(
        name
        for name, checksum in judges
        if checksum in checksums or (name in names and not (checksum and name in told))
    ):
        raise ConfigurationError(
            "a run that the model was fitted on cannot judge it",
            found=", ".join(both),
            expected="held-out runs",
        )


def refuse_several_units(units: Iterable[str]) -> None:
    """Raise ConfigurationError for runs of more than one unit."""
    several = sorted(set(units))
    if len(several) > 1:
        raise ConfigurationError(
            "runs of different units under one model",
            found=", ".join(several),
            expected="runs of one unit",
            remedy="diagnose each unit by itself; coefficients differ between units",
        )
