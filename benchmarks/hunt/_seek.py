"""One search in process: runs recorded by a plant without bytes; diagnosis and end as `gap hunt` has them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import process_time
from typing import Any

from bench.analysis.gap import information_gained
from bench.campaign.hunt import ALIKE, BUDGET, DECIDED, Made, Told, by_name, conclude, fewest, led
from benchmarks.hunt._cases import Case, is_right
from benchmarks.hunt._plants import HuntPlant
from benchmarks.hunt._strategies import Strategy
from drivers.base.files import replace_file

BUDGET_H, UNTIL = 60.0, 0.95
ENDS = (DECIDED, ALIKE)
JOURNAL = "searches.jsonl"


@dataclass(frozen=True)
class Step:
    """A run of a search: what it is, what it was expected to tell and told, nats; what stood after it."""

    procedure: str
    text: str
    hours: float
    expected: float
    gained: float
    to_confirm: bool
    acts: str
    probability: float
    diagnosis_s: float
    choice_s: float
    """Processor time."""


@dataclass(frozen=True)
class Searched:
    """How one search ended. `mode`: "in process", or "bytes"."""

    family: str
    case: str
    kind: str
    seed: int
    number: int
    truth: str
    sizes: dict[str, float]
    strategy: str
    mode: str
    ended: str
    acts: str
    probability: float
    right: bool
    hours: float
    steps: tuple[Step, ...]
    among: bool = False
    """Whether what acts is among the fewest explanations that together have the probability asked for."""
    one_of: tuple[str, ...] = ()
    """These explanations, where it ended because no run tells them apart."""
    checked: bool = True
    """Whether that claim was checked; as long as it is not, the end is not right and not wrong."""

    @property
    def wrong(self) -> bool:
        """Whether it decided for something else."""
        return self.ended in ENDS and self.checked and not self.right

    @property
    def key(self) -> tuple[str, str, str, str]:
        """What makes it another search."""
        return (self.family, self.case, self.strategy, self.mode)


def seek(plant: HuntPlant, case: Case, name: str, strategy: Strategy) -> Searched:
    """Let a strategy search for what a unit has."""
    runs: list[Made] = []
    told: list[Told] = []
    stood: list[dict[str, float]] = []
    steps, used_h, ended = [], 0.0, ""
    now = conclude(runs, plant.model, plant.designs, UNTIL)
    while True:
        begun_s = process_time()
        design, expected, ended = strategy.next(now, BUDGET_H - used_h, told)
        chosen_s = process_time() - begun_s
        if design is None:
            break
        used_h += design.hours
        to_confirm = now.confirmed is not None
        confirming = now.acts if to_confirm else ""
        stood.append(by_name(now.outlook.probabilities))
        runs.append(Made(design.key, plant.recorded(design, case.gap, case.seed, len(runs))))
        begun_s = process_time()
        now = conclude(runs, plant.model, plant.designs, UNTIL)
        after = by_name(now.outlook.probabilities)
        gained = information_gained(stood[-1], after)
        told.append(Told(design.key, expected, led(stood, after), confirming))
        taken_s = process_time() - begun_s
        steps.append(
            Step(
                design.procedure, design.text, design.hours, expected, gained, to_confirm, now.acts,
                now.probability, taken_s, chosen_s,
            )
        )  # fmt: skip
    left = fewest(by_name(now.outlook.probabilities), UNTIL)
    found = among(plant, case, left)
    one_of = left if ended == ALIKE else ()
    right = is_right(plant, case, ended, now.acts)
    return Searched(
        case.family, case.name, case.kind, case.seed, case.number, case.acts, dict(case.gap), name,
        "in process", ended, now.acts, now.probability, right, used_h if ended != BUDGET else BUDGET_H,
        tuple(steps), found, one_of, not (one_of and found),
    )  # fmt: skip


def among(plant: HuntPlant, case: Case, names: Sequence[str]) -> bool:
    """Return whether what acts is one of some explanations."""
    return any(is_right(plant, case, DECIDED, name) for name in names)


def stay_alike(plant: HuntPlant, case: Case, steps: Sequence[Step]) -> bool:
    """Return whether after a search's runs no single further one that the bench can make decides.

    All are made once more, in process, and diagnosed: nothing that was foretold takes part.
    """
    designs = {(each.procedure, each.text): each for each in plant.designs}
    order = [*(designs[step.procedure, step.text] for step in steps), *plant.designs]
    made = [
        Made(design.key, plant.recorded(design, case.gap, case.seed, number))
        for number, design in enumerate(order)
    ]
    for further in made[len(steps) :]:
        runs = [*made[: len(steps)], further]
        # what no run has shown makes the whole bench less sure than one run of it
        if all(
            conclude(runs, plant.model, known, UNTIL).probability >= UNTIL
            for known in (plant.designs[:1], plant.designs)
        ):
            return False
    return True


def check(plant: HuntPlant, case: Case, one: Searched) -> Searched:
    """Return a search with its claim checked, that no run tells what is left apart."""
    if one.checked:
        return one
    return replace(one, right=stay_alike(plant, case, one.steps), checked=True)


def keep(folder: Path, one: Searched) -> None:
    """Add a search to the journal of a folder, a line each."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / JOURNAL).open("a", encoding="utf-8") as file:
        file.write(_line(one))


def keep_all(folder: Path, searches: Sequence[Searched]) -> None:
    """Write searches to the journal of a folder in place of what it has."""
    replace_file(folder / JOURNAL, "".join(_line(one) for one in searches))


def _line(one: Searched) -> str:
    return json.dumps(asdict(one)) + "\n"


def kept(folders: Sequence[Path]) -> Iterator[Searched]:
    """Yield the searches of journals; a last line that was cut off is no search."""
    for folder in folders:
        path = folder / JOURNAL
        lines = path.read_text(encoding="utf-8").split("\n")[:-1] if path.exists() else []
        for line in lines:
            data: dict[str, Any] = json.loads(line)
            steps = tuple(Step(**step) for step in data.pop("steps"))
            one_of = tuple(data.pop("one_of", ()))
            yield Searched(**data, steps=steps, one_of=one_of)
