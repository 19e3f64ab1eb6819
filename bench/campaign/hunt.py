"""A search for the missing effect: a campaign whose next run is chosen from what the runs so far leave open.

It ends when one explanation has the probability asked for and was seen again in a run that it was not fitted to,
when no run of this bench would tell more, or when the bench time is spent. All that it knows is in the campaign's
folder, so that a search that was stopped goes on to the same end.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bench.analysis import gap
from bench.analysis.gap import Choice, Design, Diagnosis, Outlook, Recordings
from bench.campaign._conclusion import (
    ALIKE,
    BUDGET,
    DECIDED,
    NO_GAP,
    UNDECIDED,
    Conclusion,
    Made,
    Order,
    Told,
    by_information,
    by_name,
    conclude,
    fewest,
    led,
    next_choice,
    of_another_procedure,
)
from bench.campaign._file import CampaignRun
from bench.campaign._folder import HUNT_FILE, CampaignFolder, RunState, refuse_used
from bench.lab.emulated import Plant
from bench.record.benchfile import BenchFile
from bench.record.events.campaign import NextRun, Sought
from drivers.base.errors import ConfigurationError
from drivers.base.files import SETTINGS_BYTES, parse_json, read_bounded, replace_file

__all__ = [
    "ALIKE",
    "BUDGET",
    "DECIDED",
    "NO_GAP",
    "UNDECIDED",
    "Conclusion",
    "Hunt",
    "HuntSettings",
    "Made",
    "Order",
    "Step",
    "Told",
    "begin_hunt",
    "by_information",
    "by_name",
    "conclude",
    "fewest",
    "led",
    "next_choice",
    "of_another_procedure",
    "steps_of",
]

MODEL_FILE = "nominal.toml"
_WORTH_EQUIPMENT = 0.2
"""Expected information from which other equipment is worth naming."""
_MOST_INVALID = 2
"""Invalid runs of a design after which it is not chosen again."""


class HuntSettings(BaseModel):
    """What a search was asked for: bench time in h, probability, and the gyro (the first if None)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    budget_h: float = Field(gt=0.0, le=10_000.0)
    until: float = Field(gt=0.5, lt=1.0)
    gyro: str | None = None


def begin_hunt(
    path: Path,
    file: BenchFile,
    model_file: Path,
    settings: HuntSettings,
    *,
    plant: Plant | None = None,
    ask: bool = False,
    order: Order = by_information,
) -> Hunt:
    """Begin a search in a new folder: its first run is chosen, nothing has moved. `order` as of a `Hunt`.

    ConfigurationError for a folder that is not empty, a model that cannot be read, a budget in which no run fits.
    """
    refuse_used(path)
    gyro = file.gyro_named(settings.gyro)
    nominal = gap.read_model(model_file)
    designs = gap.designs_for(file, gyro.axis)
    shortest = min((design.hours for design in designs), default=math.inf)
    if shortest > settings.budget_h:
        raise ConfigurationError(
            "no run fits into the bench time",
            found=f"{settings.budget_h:g} h",
            expected=f"at least {shortest:.1f} h, the shortest run that this bench can make",
            remedy="a larger --budget-h, or wider [limits]",
        )
    start = conclude([], nominal, designs, settings.until)
    first = order(start.outlook.choices(settings.budget_h))[0]
    run = _run_of(first.design, 1)
    title = f"search for what {nominal.name} lacks in {gyro.unit}"
    with tempfile.TemporaryDirectory() as place:
        campaign = Path(place) / "campaign.toml"
        campaign.write_text(f"title = {json.dumps(title)}\n\n{run.toml()}", encoding="utf-8")
        folder = CampaignFolder.create(path, campaign, file, plant, ask)
    replace_file(path / MODEL_FILE, model_file.read_bytes())
    replace_file(path / HUNT_FILE, settings.model_dump_json())
    hunt = Hunt(folder, order)
    hunt.note(start)
    hunt.choose(first, run, len(start.outlook.designs), to_confirm=False)
    return hunt


class Hunt:
    """A search that was begun. `next_run` is what `CampaignRunner.further` asks.

    `order` puts the runs that fit into the bench time left in the order in which they would be made.
    """

    def __init__(
        self,
        folder: CampaignFolder,
        order: Order = by_information,
    ) -> None:
        self.folder, self._order = folder, order
        path = folder.path / HUNT_FILE
        try:
            self.settings = HuntSettings.model_validate(parse_json(read_bounded(path, SETTINGS_BYTES)))
            self.model = gap.read_model(folder.path / MODEL_FILE)
        except (OSError, ValueError, ValidationError) as error:
            raise ConfigurationError(
                "this is no search for a missing effect",
                where=str(folder.path),
                found=str(error),
                expected=f"{HUNT_FILE} and {MODEL_FILE} as `gyrobench gap hunt` writes them",
            ) from error
        self.gyro = folder.file.gyro_named(self.settings.gyro)
        self.diagnosis: Diagnosis | None = None
        """What the newest look at the runs found."""
        self.outlook: Outlook | None = None
        self._read: dict[Path, Recordings] = {}

    @cached_property
    def designs(self) -> list[Design]:
        """What the bench can do."""
        return gap.designs_for(self.folder.file, self.gyro.axis)

    @property
    def steps(self) -> list[Sought | NextRun]:
        """What was thought and chosen so far, in order."""
        return [event for _, event in self.folder.events() if isinstance(event, Sought | NextRun)]

    @property
    def end(self) -> Sought | None:
        """How the search ended, None while it goes on."""
        return next((each for each in self.steps if isinstance(each, Sought) and each.ended), None)

    def next_run(self) -> CampaignRun | None:
        """Diagnose what is recorded and choose the next run; None when the search has ended."""
        if self.end is not None:
            return None
        done = [state for state in self.folder.states() if state.state == "done"]
        good = [state for state in done if state.outcome == "completed"]
        now = conclude(self._made(good), self.model, self.designs, self.settings.until)
        self.diagnosis, self.outlook = now.diagnosis, now.outlook
        left_h = self.settings.budget_h - sum(state.duration_s or 0.0 for state in done) / 3600.0
        choice, ended = next_choice(
            now, left_h, self._order, lambda design: _usable(design, done), self._history(now, good)
        )
        self.note(now, ended)
        if choice is None:
            return None
        run = _run_of(choice.design, len(self.folder.campaign.runs) + 1)
        self.choose(choice, run, len(now.outlook.designs), to_confirm=now.confirmed is not None)
        return run

    def note(self, now: Conclusion, ended: str = "") -> None:
        """Write to the journal where the search stands, once after each run."""
        states = [state for state in self.folder.states() if state.state == "done"]
        before = [each for each in self.steps if isinstance(each, Sought)]
        after = [state.run.name for state in states]
        if before and before[-1].after == after:
            return  # a process that was stopped came as far
        probabilities = by_name(now.outlook.probabilities)
        gained = gap.information_gained(before[-1].probabilities, probabilities) if before else None
        used_h = sum(state.duration_s or 0.0 for state in states) / 3600.0
        verdict = now.verdict if states else "not begun"
        self.folder.event(
            Sought(
                after,
                verdict,
                now.acts,
                now.probability,
                probabilities,
                used_h,
                gained,
                now.confirmed,
                ended,
            )
        )

    def choose(self, choice: Choice, run: CampaignRun, considered: int, *, to_confirm: bool) -> None:
        """Write to the journal which run comes next."""
        design = choice.design
        self.folder.event(
            NextRun(
                run.name, design.procedure, design.text, choice.nats, design.hours, considered, to_confirm
            )
        )

    def elsewhere(self) -> list[str]:
        """Return the equipment, in words, with which a run would tell what this bench cannot."""
        if self.outlook is None:
            return []
        others = gap.other_equipment(self.folder.file.bench.latitude_deg)
        return [text for text, design in others if self.outlook.information(design) > _WORTH_EQUIPMENT]

    def _made(self, good: Sequence[RunState]) -> list[Made]:
        """Return what was recorded, each folder read once."""
        made = []
        for state in good:
            if state.folder is None:
                continue
            if state.folder not in self._read:
                self._read[state.folder] = gap.read_recordings([state.folder], gyro=self.gyro.name)
            key = gap.key_of(state.run.procedure, state.run.parameters)
            made.append(Made(key, self._read[state.folder]))
        return made

    def _history(self, now: Conclusion, good: Sequence[RunState]) -> list[Told]:
        """Return what the runs told of what was expected, the newest by where the search stands now."""
        names = {state.run.name: state.run for state in good}
        after_of = {step.chosen.run: step.after for step in steps_of(self)}
        probabilities = by_name(now.outlook.probabilities)
        history, acts = [], ""
        stood: list[dict[str, float]] = []
        for step in self.steps:
            if isinstance(step, Sought):
                stood.append(step.probabilities)
                acts = step.acts
            elif (run := names.get(step.run)) is not None:
                after = after_of[step.run]
                told = led(stood, after.probabilities if after else probabilities)
                key = gap.key_of(run.procedure, run.parameters)
                history.append(Told(key, step.expected_nats, told, acts if step.to_confirm else ""))
        return history


@dataclass(frozen=True)
class Step:
    """One run of a search: what was expected of it and what it gave, in nats; None before it is recorded."""

    chosen: NextRun
    after: Sought | None


def steps_of(hunt: Hunt) -> list[Step]:
    """Return the runs of a search with what was thought after each."""
    events = hunt.steps
    thought = {each.after[-1]: each for each in events if isinstance(each, Sought) and each.after}
    return [Step(each, thought.get(each.run)) for each in events if isinstance(each, NextRun)]


def _usable(design: Design, done: Sequence[RunState]) -> bool:
    """Whether a design was not invalid again and again."""
    bad = [state.run for state in done if state.outcome != "completed"]
    same = [
        run for run in bad if (run.procedure, run.parameters) == (design.procedure, dict(design.settings))
    ]
    return len(same) < _MOST_INVALID


def _run_of(design: Design, number: int) -> CampaignRun:
    name = f"{number:02d}-{design.procedure}"
    return CampaignRun(name=name, procedure=design.procedure, parameters=dict(design.settings))
