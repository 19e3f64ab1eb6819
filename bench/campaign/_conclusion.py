"""What a search concludes from its runs, wherever they come from: where it stands, and which run comes next."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import takewhile
from typing import TypeVar

from bench.analysis import gap
from bench.analysis.gap import Choice, Design, Diagnosis, Model, Outlook, Recordings

NO_GAP = "no gap"
DECIDED, ALIKE, UNDECIDED, BUDGET = "decided", "alike", "undecided", "budget"
_LEAST_NATS = 0.02
"""Expected information below which a run is not worth making."""
_LITTLE = 0.25
"""Part of it that a run must tell where a longer one is worth making."""
_DOUBT_NATS = 0.02
"""Information as expected that stands beside what a design's runs told, so that a run of little says little."""
_CLEAR, _FAINT = 10.0, 5.0
"""Standard deviations above the noise that a run must show of an explanation to confirm it; if no run does, the
least."""
_MOST_CONFIRMING = 2
"""Runs in a row that may fail to confirm an answer: what was fitted does not foretell, a third tells no more."""

_LEAST_PROCEDURES = 3
"""Procedures of which runs were made before a search ends: what acts in none of them is in no diagnosis."""
_MOST_ALIKE = 4
"""Explanations that an answer may leave open: as many as a diagnosis names as one cause."""
_IN_VAIN, _SOME_IN_VAIN, _MOST_IN_VAIN = 0.1, 2, 4
"""Part of what was expected below which a run told nothing; after some in a row it is not the runs' fault and all
others are expected to tell less, after the most none is expected to tell anything."""

Name = TypeVar("Name")
Order = Callable[[Sequence[Choice]], Sequence[Choice]]


@dataclass(frozen=True, eq=False)
class Made:
    """A run that was made: its design's key, and its recordings."""

    design: str
    recordings: Recordings


@dataclass(frozen=True)
class Told:
    """What a run of a design was expected to tell, and what it told, nats, as `led` has it.

    `confirming`: the answer that it was made to confirm.
    """

    design: str
    expected: float
    gained: float
    confirming: str = ""


@dataclass(frozen=True, eq=False)
class Conclusion:
    """Where a search stands after its runs.

    `confirmed` is None as long as nothing has the probability asked for, then whether what acts was seen in a
    run, any of them, after it was found in those before; `unseen` are the names that such a run has to show.
    `until`: the probability asked for; `given` are the runs in their order, `nominal` is the model before them.
    """

    outlook: Outlook
    diagnosis: Diagnosis | None
    acts: str
    probability: float
    until: float
    given: Sequence[Recordings]
    nominal: Model
    confirmed: bool | None = None
    unseen: frozenset[str] = frozenset()

    @cached_property
    def left(self) -> tuple[frozenset[str], ...]:
        """The fewest explanations that together have the probability asked for."""
        return fewest(self.outlook.probabilities, self.until)

    @property
    def one_of(self) -> tuple[frozenset[str], ...]:
        """What is left if it is a few effects by name; else nothing."""
        named = all(label and gap.UNKNOWN not in label for label in self.left)
        return self.left if named and 1 < len(self.left) <= _MOST_ALIKE else ()

    @cached_property
    def one_of_shown(self) -> bool:
        """Whether one of these was found without a run and is in it."""
        for held_out in reversed(self.given):
            others = [run for run in self.given if run is not held_out]
            if _look(held_out, self.one_of, others, self.nominal).seen:
                return True
        return False

    @property
    def verdict(self) -> str:
        """The diagnosis' verdict, or that there is none yet."""
        return self.diagnosis.verdict if self.diagnosis else "nothing recorded"


def by_information(choices: Sequence[Choice]) -> list[Choice]:
    """Return what is worth making of choices that are sorted by information an hour.

    None if no run is expected to tell enough; else a short one that tells less an hour at a time is worth it too.
    """
    if all(each.nats <= _LEAST_NATS for each in choices):
        return []
    return [each for each in choices if each.nats > _LITTLE * _LEAST_NATS]


def conclude(runs: Sequence[Made], model: Model, designs: Sequence[Design], until: float) -> Conclusion:
    """Diagnose the recordings of some runs, in their order, and judge whether that answers the question."""
    given = [run.recordings for run in runs]
    found = _diagnosed(given, model)
    shown = [each for run in given for each in run.shown]
    made = {run.design: run.recordings.shown for run in runs}
    now = gap.outlook(None if found is None else found.rate, model, shown, designs, made)
    acts, probability = leading(now.probabilities)
    confirmed, unseen = None, frozenset[str]()
    if probability >= until:
        confirmed, unseen = _confirmed([now.leading.label], given, model)
    return Conclusion(now, found, acts, probability, until, given, model, confirmed, unseen)


def next_choice(
    now: Conclusion,
    left_h: float,
    order: Order = by_information,
    usable: Callable[[Design], bool] = lambda design: True,
    history: Sequence[Told] = (),
) -> tuple[Choice | None, str]:
    """Return the run to make in the bench time left, or None and how the search has ended.

    A design that was made and told less than was expected of it is expected to tell that much less again, and so
    are the others of its kind. After two in a row that told nothing every run is: what is foretold of what is
    left open is wrong. The search has ended, too, where a few effects are left that no run would tell apart.
    Before it ends, with an answer or without, runs of several procedures were made.
    """
    choice, ended = _next(now, left_h, order, usable, history)
    if ended and ended != BUDGET:
        choice = of_another_procedure(now, left_h, usable, history)
    return choice, "" if choice else ended


def _next(
    now: Conclusion,
    left_h: float,
    order: Order,
    usable: Callable[[Design], bool],
    history: Sequence[Told],
) -> tuple[Choice | None, str]:
    """Return the run to make by what is left open, or None and how the search would end."""
    if now.confirmed is not None:
        tries = list(takewhile(lambda told: told.confirming == now.acts, reversed(history)))
        if not now.confirmed and len(tries) >= _MOST_CONFIRMING:
            return None, UNDECIDED
        return (None, DECIDED) if now.confirmed else _confirming(now, left_h)
    if _in_vain(history) >= _MOST_IN_VAIN:
        return None, UNDECIDED
    told = _Told.of(history)
    left = [
        replace(each, nats=each.nats * told.part(each.design.key))
        for each in now.outlook.choices(left_h)
        if usable(each.design)
    ]
    if _alike(now, told, usable):
        if now.one_of_shown:
            return None, ALIKE
        choice = now.outlook.showing(now.outlook.leading.label, left_h, _CLEAR)
        if choice and choice.design.key not in {each.design for each in history}:
            return choice, ""
    fitting = sorted(left, key=lambda choice: -choice.nats / choice.design.hours)
    choice = next(iter(order(fitting)), None)
    if order is by_information:
        made = {each.design for each in history}
        new = [each for each in fitting if each.design.key not in made]
        choice = _sooner(fitting if choice else new, now.until, choice) or choice
    return choice, "" if choice else UNDECIDED if fitting else BUDGET


def _confirming(now: Conclusion, left_h: float) -> tuple[Choice | None, str]:
    """Return the run in which what is named shows, or None and how the search would end.

    What no run of the bench shows is undecided; what a longer run than is left shows is decided, not confirmed.
    """
    for least in (_CLEAR, _FAINT):
        if choice := now.outlook.showing(now.unseen, left_h, least):
            return choice, ""
    return None, DECIDED if now.outlook.showing(now.unseen, math.inf, _FAINT) else UNDECIDED


def of_another_procedure(
    now: Conclusion,
    left_h: float,
    usable: Callable[[Design], bool] = lambda design: True,
    history: Sequence[Told] = (),
) -> Choice | None:
    """Return the run, of a procedure not made so far, that comes before an end; None after enough procedures.

    It is the one with most information of those that last no longer than the runs so far together, or the
    shortest.
    """
    made = {_procedure(told.design) for told in history}
    if len(made) >= _LEAST_PROCEDURES:
        return None
    own_h = {each.key: each.hours for each in now.outlook.designs}
    spent_h = sum(own_h.get(told.design, 0.0) for told in history)
    others = [
        each
        for each in now.outlook.choices(left_h)
        if each.design.procedure not in made and usable(each.design)
    ]
    most_h = max(spent_h, min((each.design.hours for each in others), default=0.0))
    fitting = [each for each in others if each.design.hours <= most_h]
    return max(fitting, key=lambda each: each.nats, default=None)


def _sooner(choices: Sequence[Choice], until: float, first: Choice | None) -> Choice | None:
    """Return the shortest run that would end the search if what leads is true, and is no longer than the first.

    Information an hour does not know that the search ends: of two runs that end it the longer one tells more, and
    of many small doubts each run takes little.
    """
    most_h = first.design.hours if first else math.inf
    closing = [each for each in choices if each.if_true >= until and each.design.hours <= most_h]
    return min(closing, key=lambda choice: choice.design.hours, default=None)


def _in_vain(history: Sequence[Told]) -> int:
    """Return how many of the newest runs told nothing, those made to confirm an answer aside.

    What is left open then is alike in what the bench can do, whatever the foretelling says of it.
    """
    runs = [told for told in history if not told.confirming]
    return sum(1 for _ in takewhile(lambda told: told.gained < _IN_VAIN * told.expected, reversed(runs)))


def _alike(now: Conclusion, told: _Told, usable: Callable[[Design], bool]) -> bool:
    """Return whether a few effects are left that no run of the bench is expected to tell apart."""
    return bool(now.one_of) and all(
        told.part(each.key) * now.outlook.information(each, now.one_of) <= _LEAST_NATS
        for each in now.outlook.designs
        if usable(each)
    )


@dataclass(frozen=True)
class _Told:
    """Which part of what was expected was told: by the newest run of each kind, and by the newest in vain."""

    kinds: Mapping[str, float]
    vain: float

    @classmethod
    def of(cls, runs: Sequence[Told]) -> _Told:
        """Return that of some runs in their order, of each of which was expected what those before had left.

        The first run of a kind may have told much: of what a repeat tells it says nothing.
        """
        kinds: dict[str, float] = {}
        vain: list[tuple[float, float]] = []
        for run in runs:
            kind = _kind(run.design)
            own = run.expected / min(kinds.get(kind, 1.0), _in_vain_part(vain))
            kinds[kind] = _part(own, min(run.gained, own))
            if not run.confirming:
                in_vain = run.gained < _IN_VAIN * run.expected
                vain = [*vain, (own, run.gained)] if in_vain else []
        return cls(kinds, _in_vain_part(vain))

    def part(self, design: str) -> float:
        """Return the part of what is expected of a design that it will tell, at most all of it."""
        return min(self.kinds.get(_kind(design), 1.0), self.vain)


def _in_vain_part(runs: Sequence[tuple[float, float]]) -> float:
    expected, gained = (sum(each) for each in zip(*runs, strict=True)) if runs else (0.0, 0.0)
    return _part(expected, gained) if len(runs) >= _SOME_IN_VAIN else 1.0


def _part(expected: float, gained: float) -> float:
    return (_DOUBT_NATS + gained) / (_DOUBT_NATS + expected)


def _kind(design: str) -> str:
    """Return the kind of a design by its key: its procedure, and which of its settings are its own."""
    procedure, settings = json.loads(design)
    return " ".join((procedure, *sorted(settings)))


def _procedure(design: str) -> str:
    return str(json.loads(design)[0])


def by_name(probabilities: Mapping[frozenset[str], float]) -> dict[str, float]:
    """Return probabilities by the names that act, as they are written and told."""
    return {" + ".join(sorted(label)) or NO_GAP: value for label, value in probabilities.items()}


def led(before: Sequence[Mapping[str, float]], after: Mapping[str, float]) -> float:
    """Return how far a run has led, nats: from the nearest of all places where the search stood before.

    One that leads back has told nothing, whatever the newest of these was.
    """
    return min((gap.information_gained(each, after) for each in before), default=0.0)


def fewest(probabilities: Mapping[Name, float], until: float) -> tuple[Name, ...]:
    """Return the fewest explanations that together have a probability, the most probable first."""
    left: list[Name] = []
    total = 0.0
    for name, probability in sorted(probabilities.items(), key=lambda each: -each[1]):
        left.append(name)
        total += probability
        if total >= until:
            break
    return tuple(left)


def leading(probabilities: Mapping[frozenset[str], float]) -> tuple[str, float]:
    """Return what most probably acts, and how probable it is."""
    return max(by_name(probabilities).items(), key=lambda item: item[1])


def _diagnosed(
    runs: Sequence[Recordings], model: Model, held_out: Sequence[Recordings] = ()
) -> Diagnosis | None:
    if not runs:
        return None
    missing = {name: reason for run in runs for name, reason in run.missing.items()}
    judging = [each for run in held_out for each in run.runs]
    return gap.diagnose([each for run in runs for each in run.runs], model, judging, missing)


def _confirmed(
    labels: Sequence[frozenset[str]], runs: Sequence[Recordings], model: Model
) -> tuple[bool, frozenset[str]]:
    """Return whether a run, the newest first, has shown one of some explanations found in the runs before it.

    Else what a further run has to show of the first of them. What was found before other runs spoke for something
    else, and showed then, was refuted by these.
    """
    if not labels[0]:
        return True, frozenset()
    looks = []
    for place in reversed(range(len(runs))):
        looks.append(_look(runs[place], labels, runs[:place], model))
        if looks[-1].seen:
            return True, frozenset()
        if not looks[-1].found:
            break
    return False, looks[0].unseen


@dataclass(frozen=True)
class _Look:
    """Whether one of some explanations was `found` in other runs, and `seen` in a run; else what is `unseen`."""

    found: bool
    seen: bool
    unseen: frozenset[str]


def _look(
    held_out: Recordings, labels: Sequence[frozenset[str]], others: Sequence[Recordings], model: Model
) -> _Look:
    """Look for explanations in others, and at what they foretell of a run."""
    first = labels[0]
    before = _diagnosed(others, model, [held_out])
    if before is None:
        return _Look(False, False, first)
    noise = set(before.rate.stochastic)
    other = noise | ({gap.UNKNOWN} if before.rate.unknown_probability > 0.5 else set())
    names = other.union(cause.name for cause in before.rate.causes)
    # what is the form of another effect has a name of its own in the sets
    forms = other.union(*(cause.effects for cause in before.rate.causes))
    found = names in labels or forms in labels
    # what less than half of is there is no cause any more; no share of a gap tells of noise or what has no name
    held = any(math.isfinite(before.rate.held.get(cause.name, math.nan)) for cause in before.rate.causes)
    seen = found and (gap.UNKNOWN in names or names == noise or held)
    return _Look(found, seen, frozenset() if seen else (first - forms) or first)
