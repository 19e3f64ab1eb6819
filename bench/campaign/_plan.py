"""The schedule of a campaign before anything moves: steps with start and end, chamber hours, bytes, limits."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from bench.campaign._file import Campaign, CampaignRun, bench_of, load_campaign
from bench.control.disk import check_disk, estimated_bytes
from bench.control.procedure import Demands, beyond_limits, require_none_beyond
from bench.lab.emulated import Plant
from bench.lab.rehearsal import rehearse_procedure
from bench.record.benchfile import BenchFile
from bench.record.events.run import ConditioningDemand, Prompt, Step
from bench.record.figure_limits import OVER_RUNS, own_figure
from bench.record.recording import read_events
from drivers.base.errors import ConfigurationError


@dataclass(frozen=True)
class PlannedStep:
    """A step of a run, from its start, s."""

    title: str
    start_s: float
    end_s: float


@dataclass(frozen=True)
class PlannedRun:
    """A run in the schedule: `start_s` from the campaign's start, and what it takes.

    `rehearsed` is the outcome of its rehearsal, empty without one: times and `bytes` (of the run folder) are
    estimates then, and there are no `steps`. `chamber_s`: time that the chamber conditions.
    """

    run: CampaignRun
    demands: Demands
    start_s: float
    duration_s: float
    chamber_s: float
    bytes: int
    steps: tuple[PlannedStep, ...] = ()
    questions: tuple[str, ...] = ()
    rehearsed: str = ""
    reason: str = ""

    @property
    def end_s(self) -> float:
        """End, from the campaign's start."""
        return self.start_s + self.duration_s


def check_limits(campaign: Campaign, file: BenchFile) -> None:
    """Raise LimitExceeded that names every run which demands more than the bench file allows, ConfigurationError
    for one whose procedure needs another bench.
    """
    for run in campaign.runs:
        run.test.check_bench(file)
    found = [
        f"{run.name}: {text}"
        for run in campaign.runs
        for text in beyond_limits(run.test.demands(run.values), file)
    ]
    require_none_beyond(found, file, "the campaign", campaign.title)


def campaign_to_rehearse(campaign_file: Path, file: BenchFile, out: Path) -> tuple[Campaign, Path]:
    """Return a campaign and the folder in `out` for its runs; refused beyond limits, over runs, without room."""
    campaign = load_campaign(campaign_file, file)
    check_limits(campaign, bench_of(campaign, file))
    runs_folder = out / "runs"
    if runs_folder.exists() and any(runs_folder.iterdir()):
        raise ConfigurationError(
            "the folder already holds runs",
            where=str(runs_folder),
            expected="a new or empty folder: runs are never overwritten",
            remedy="name another one with --out, or remove this one",
        )
    check_disk(estimated_bytes(campaign.expected_duration_s(), file), out, "the campaign", "--out")
    return campaign, runs_folder


def not_measured(campaign: Campaign) -> list[str]:
    """Return the figures with a limit that no run of the campaign measures: its certificate cannot say passed."""
    runs = campaign.runs
    measured = {figure for run in runs for figure in run.test.figures(run.values)}
    if sum(bool(run.test.figures(run.values)) for run in runs) > 1:
        measured.update(OVER_RUNS)
    procedures = {run.procedure for run in runs}
    return [
        figure
        for figure in campaign.limits
        if figure not in measured and not ((own := own_figure(figure)) and own[0] in procedures)
    ]


def plan_campaign(
    campaign: Campaign,
    file: BenchFile,
    plant: Plant | None,
    progress: Callable[[int, int], None] | None = None,
) -> list[PlannedRun]:
    """Return the schedule. With `plant` every run is rehearsed on an emulated lab, the same run only once;
    without, durations and bytes are estimates and nothing is known of steps.

    `progress` is told how many of how many rehearsals are done.
    """
    file = bench_of(campaign, file)
    check_limits(campaign, file)
    different = {_key(run): run for run in campaign.runs}
    known = {}
    for number, (key, run) in enumerate(different.items()):
        if progress is not None:
            progress(number, len(different))
        known[key] = _estimated(run, file) if plant is None else _rehearsed(run, file, plant)
    planned, start_s = [], 0.0
    for run in campaign.runs:
        planned.append(replace(known[_key(run)], run=run, start_s=start_s))
        start_s = planned[-1].end_s
    return planned


def _key(run: CampaignRun) -> str:
    return json.dumps([run.procedure, run.values.model_dump(mode="json")], sort_keys=True)


def _estimated(run: CampaignRun, file: BenchFile) -> PlannedRun:
    demands = run.test.demands(run.values)
    duration_s = run.test.expected_duration_s(run.values)
    usual = Demands()
    conditions = (demands.min_temp_c, demands.max_temp_c) != (usual.min_temp_c, usual.max_temp_c)
    chamber_s = duration_s if conditions else 0.0
    return PlannedRun(run, demands, 0.0, duration_s, chamber_s, estimated_bytes(duration_s, file))


def _rehearsed(run: CampaignRun, file: BenchFile, plant: Plant) -> PlannedRun:
    with tempfile.TemporaryDirectory(prefix="gyrobench-plan-") as scratch:
        result = rehearse_procedure(run.test, run.values, file, plant, Path(scratch), run_id=run.name)
        events = read_events(result.folder)
        size = sum(
            path.stat().st_size
            for path in result.folder.rglob("*")
            if path.is_file() and not path.name.startswith("truth_")
        )
    begins = [(time_s, f"{step.code} {step.title}") for time_s, step in events.of(Step)]
    ends = [*(start for start, _ in begins[1:]), result.duration_s]
    return PlannedRun(
        run,
        demands=run.test.demands(run.values),
        start_s=0.0,
        duration_s=result.duration_s,
        chamber_s=_chamber_s(events.of(ConditioningDemand), ends[-1]),
        bytes=size,
        steps=tuple(PlannedStep(title, start, end) for (start, title), end in zip(begins, ends, strict=True)),
        questions=tuple(prompt.question for _, prompt in events.of(Prompt)),
        rehearsed=result.outcome,
        reason=result.reason,
    )


def _chamber_s(demands: list[tuple[float, ConditioningDemand]], end_s: float) -> float:
    """Return how long the chamber was on, from what it was told."""
    total, since = 0.0, None
    for time_s, demand in demands:
        if demand.on and since is None:
            since = time_s
        elif not demand.on and since is not None:
            total, since = total + time_s - since, None
    return total if since is None else total + end_s - since
