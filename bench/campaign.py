"""A campaign: runs with their parameters and roles, from a TOML file."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bench.benchfile import BenchFile
from bench.emulated import EmulatedLab, Plant, save_truth
from bench.procedure import find_procedure
from bench.questions import StageHand
from bench.runner import RunRequest, RunResult, run_procedure
from drivers.errors import ConfigurationError

Role = Literal["training", "validation", "test"]


class CampaignRun(BaseModel):
    """One run: what, with which parameters, and what it is for. `name` is its folder."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")
    procedure: str
    role: Role
    parameters: dict[str, Any] = Field(default_factory=dict)


class Campaign(BaseModel):
    """Runs in order. `gyro` is the one whose compensation is fitted at the end."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    title: str
    gyro: str
    run: tuple[CampaignRun, ...] = Field(min_length=1)

    def expected_duration_s(self) -> float:
        """Return the bench time of all runs together."""
        total = 0.0
        for run in self.run:
            procedure = find_procedure(run.procedure)
            total += procedure.expected_duration_s(procedure.parse(run.parameters))
        return total


def load_campaign(path: Path, file: BenchFile) -> Campaign:
    """Read a campaign file and check it against the bench; ConfigurationError names every mistake."""
    try:
        campaign = Campaign.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except ValidationError as error:
        mistakes = [f"{'.'.join(map(str, item['loc']))}: {item['msg'].lower()}" for item in error.errors()]
        raise _unusable(path, "; ".join(mistakes)) from error
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise _unusable(path, str(error)) from error
    names = [run.name for run in campaign.run]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise _unusable(path, f"runs of the same name: {', '.join(twice)}")
    if campaign.gyro not in [gyro.name for gyro in file.gyro]:
        raise _unusable(path, f"gyro {campaign.gyro!r} is not on the bench")
    for run in campaign.run:
        find_procedure(run.procedure).parse(run.parameters)
    return campaign


def rehearse_campaign(
    campaign: Campaign,
    file: BenchFile,
    plant: Plant,
    runs_folder: Path,
    *,
    jobs: int = 1,
    finished: Callable[[RunResult], None] | None = None,
) -> dict[str, RunResult]:
    """Run a campaign on emulated labs, one fresh lab a run, `jobs` at a time; results by run name.

    Every run has a seed of its own, counted from the plant's, so that a campaign gives the same bytes however
    many jobs there are.
    """
    results = {}
    with ProcessPoolExecutor(max_workers=jobs, mp_context=get_context("spawn")) as pool:
        tasks = {
            pool.submit(
                _rehearse,
                run,
                file,
                plant.model_copy(update={"seed": plant.seed + number}),
                runs_folder,
                number % jobs if jobs > 1 else None,
            ): run.name
            for number, run in enumerate(campaign.run)
        }
        for task in as_completed(tasks):
            result = task.result()
            results[tasks[task]] = result
            if finished is not None:
                finished(result)
    return {run.name: results[run.name] for run in campaign.run}


def _rehearse(
    run: CampaignRun, file: BenchFile, plant: Plant, runs_folder: Path, lane: int | None
) -> RunResult:
    procedure = find_procedure(run.procedure)
    with EmulatedLab(file, plant, lane=lane) as lab:
        return run_procedure(
            RunRequest(
                procedure,
                procedure.parse(run.parameters),
                lab.file,
                runs_folder,
                StageHand(lab.perform),
                run_id=run.name,
                emulated={"seed": plant.seed, "model": plant.summary(file)},
                before_close=lambda folder: save_truth(lab, folder),
            )
        )


def _unusable(path: Path, found: str) -> ConfigurationError:
    return ConfigurationError(
        "the campaign file cannot be used",
        where=str(path),
        found=found,
        expected="title, gyro and [[run]] tables with name, procedure, role and parameters",
        remedy="examples/cold_shock_campaign.toml is one that works",
    )
