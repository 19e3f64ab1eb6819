"""Blind cases: singles, pairs, unknowns, nulls, in turn; and whether an end is right."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from bench.analysis.gap import UNKNOWN
from bench.campaign.hunt import DECIDED, NO_GAP
from benchmarks.gap_exam._signals import drawn
from benchmarks.hunt._plants import Gap, HuntPlant

SINGLE, PAIR, OUTSIDE, NULL = "single", "pair", "unknown", "null"
_TURN = (SINGLE, NULL, PAIR, OUTSIDE, SINGLE, NULL, SINGLE, NULL)
"""Half of what is hunted for is one effect, as rare as none; the rest pairs and unknowns."""
LEAST_SIGMA, MOST_SIGMA = 20.0, 120.0
"""Standard deviations that an effect has in the bench's best run for it."""
_APART = 1000
"""Of the seeds of two cases: the runs of a case take the seeds after its own."""


@dataclass(frozen=True)
class Case:
    """A unit of a plant family: its kind, what it has beyond its nominal model, and the seed of all it does."""

    family: str
    number: int
    kind: str
    seed: int
    gap: Gap

    @property
    def name(self) -> str:
        """A name for journal and table."""
        return f"{self.family} {self.seed // _APART}"

    @property
    def acts(self) -> str:
        """What it has, by its family's names."""
        return " + ".join(sorted(self.gap)) or NO_GAP


def drawn_case(plant: HuntPlant, number: int, seed: int) -> Case:
    """Return case `number` of a seed.

    A family without effects that are foreign to the catalogue has singles in place of unknowns. An effect that
    this bench shows in no run is drawn again.
    """
    rng = drawn(seed, "hunt", plant.name, number)
    own_seed = _APART * (1000 * seed + number)
    kind = _TURN[number % len(_TURN)]
    if kind == OUTSIDE and not plant.foreign:
        kind = SINGLE
    wanted = {SINGLE: 1, PAIR: 2, OUTSIDE: 1, NULL: 0}[kind]
    among = sorted(plant.foreign if kind == OUTSIDE else plant.known)
    gap: dict[str, float] = {}
    for name in rng.permutation(among).tolist():
        if len(gap) == wanted:
            break
        sigmas = math.exp(rng.uniform(math.log(LEAST_SIGMA), math.log(MOST_SIGMA)))
        sign = float(rng.choice((-1.0, 1.0))) if plant.signed(name) else 1.0
        size = plant.size(name, sigmas, own_seed)
        if size and not _same(plant, name, gap):
            gap[name] = sign * size
    return Case(plant.name, number, kind, own_seed, gap)


def _same(plant: HuntPlant, name: str, gap: Iterable[str]) -> bool:
    """Whether the catalogue calls an effect the same as one that is there already: no pair."""
    own = set(plant.known.get(name, ()))
    return any(own & set(plant.known.get(other, ())) for other in gap)


def is_right(plant: HuntPlant, case: Case, ended: str, acts: str) -> bool:
    """Whether a search has decided for exactly what acts; several names of an effect are all right."""
    if ended != DECIDED:
        return False
    named = set() if acts == NO_GAP else set(acts.split(" + "))
    foreign = [name for name in case.gap if name in plant.foreign]
    if (UNKNOWN in named) != bool(foreign):
        return False
    named -= {UNKNOWN}
    allowed: set[str] = set()
    for name in case.gap:
        own = set(plant.known.get(name, ()))
        if own and not named & own:
            return False
        allowed |= own | set(plant.beside(name))
    return named <= allowed
