"""Strategies: by expected information, standard tests in an order, at random, by repeated suggestion.

All have the same runs to choose from beside the standard tests, the same diagnosis and the same rule when to
end. Only `search` looks for the run that confirms; the others confirm with the run that is next anyway.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Protocol

from bench.analysis.gap import Design, suggest
from bench.campaign.hunt import BUDGET, DECIDED, Conclusion, Told, next_choice, of_another_procedure
from benchmarks.gap_exam._signals import drawn
from benchmarks.hunt._plants import HuntPlant, tests_at

SEARCH, FIXED, RANDOM, SUGGESTED = "search", "fixed", "random", "suggested"
STRATEGIES = (SEARCH, FIXED, RANDOM, SUGGESTED)
DEFAULT_ORDER = (
    "zero-bias-cold-shock",
    "scale-factor-cold-shock",
    "standard-test",
    "constant-rotation",
    "thermal-ramp",
)
"""The standard tests as a laboratory makes them: thermal first, as the campaign of the demo."""


class Strategy(Protocol):
    """Says which run comes next, with the information expected of it; without one, how the search has ended."""

    def next(
        self, now: Conclusion, left_h: float, told: Sequence[Told]
    ) -> tuple[Design | None, float, str]: ...


class Search:
    """What `gyrobench gap hunt` does."""

    def next(self, now: Conclusion, left_h: float, told: Sequence[Told]) -> tuple[Design | None, float, str]:
        choice, ended = next_choice(now, left_h, history=told)
        return (None, 0.0, ended) if choice is None else (choice.design, choice.nats, "")


class Other:
    """A strategy that makes its run whatever the search would, until the answer is confirmed."""

    def next(self, now: Conclusion, left_h: float, told: Sequence[Told]) -> tuple[Design | None, float, str]:
        if now.confirmed and of_another_procedure(now, left_h, history=told) is None:
            return None, 0.0, DECIDED
        for design in self.wanted(now):
            if design.hours <= left_h:
                return design, now.outlook.information(design), ""
        # a budget that is spent before the answer was seen again ends as the search does
        return None, 0.0, BUDGET if now.confirmed is None else DECIDED

    def wanted(self, now: Conclusion) -> Sequence[Design]:
        """Return the runs in the order in which they would be made now."""
        raise NotImplementedError


class Fixed(Other):
    """The standard tests in an order, again from the first after the last."""

    def __init__(self, plant: HuntPlant, order: Sequence[str]) -> None:
        tests = {each.procedure: each for each in standard_tests(plant)}
        self._order, self._made = [tests[name] for name in order], 0

    def wanted(self, now: Conclusion) -> Sequence[Design]:
        self._made += 1
        return [self._order[(self._made - 1) % len(self._order)]]


class Random(Other):
    """A run drawn from all."""

    def __init__(self, plant: HuntPlant, seed: int) -> None:
        self._draw = random.Random(int(drawn(seed, "random", plant.name).integers(2**31)))

    def wanted(self, now: Conclusion) -> Sequence[Design]:
        return self._draw.sample(list(now.outlook.designs), len(now.outlook.designs))


class Suggested(Other):
    """What `gap diagnose` suggests after each run: the standard test with most log odds an hour for what is open.

    Where it suggests nothing, and before the first run, the next standard test comes.
    """

    def __init__(self, plant: HuntPlant, order: Sequence[str]) -> None:
        self._fixed = Fixed(plant, order)
        self._tests = {(each.procedure, each.text): each for each in standard_tests(plant)}

    def wanted(self, now: Conclusion) -> Sequence[Design]:
        found = suggest(now.diagnosis) if now.diagnosis is not None else []
        known = [self._tests.get((each.procedure, each.parameters)) for each in found]
        return [each for each in known if each is not None] or self._fixed.wanted(now)


def standard_tests(plant: HuntPlant) -> list[Design]:
    """Return the standard tests at a family's latitude."""
    latitude_deg = next(iter(plant.designs[0].stimuli.values())).latitude_deg
    return tests_at(latitude_deg)


def strategy_of(name: str, plant: HuntPlant, seed: int, order: Sequence[str]) -> Strategy:
    """Return a fresh strategy for one search."""
    if name == SEARCH:
        return Search()
    if name == RANDOM:
        return Random(plant, seed)
    return Fixed(plant, order) if name == FIXED else Suggested(plant, order)
