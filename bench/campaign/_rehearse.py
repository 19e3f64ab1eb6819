"""A campaign on emulated labs, several runs side by side."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

from bench.benchfile import BenchFile
from bench.campaign._file import Campaign, CampaignRun, bench_of
from bench.campaign._places import EmulatedPlace
from bench.emulated import Plant
from bench.live import Live
from bench.questions import AssumeYes, StageHand
from bench.runner import RunRequest, RunResult, run_procedure


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

    The bytes do not depend on `jobs`.
    """
    file = bench_of(campaign, file)
    results = {}
    with ProcessPoolExecutor(max_workers=jobs, mp_context=get_context("spawn")) as pool:
        tasks = {
            pool.submit(
                rehearse_run, run, file, plant, number, runs_folder, number % jobs if jobs > 1 else None
            ): (run.name)
            for number, run in enumerate(campaign.runs)
        }
        for task in as_completed(tasks):
            result = task.result()
            results[tasks[task]] = result
            if finished is not None:
                finished(result)
    return {run.name: results[run.name] for run in campaign.runs}


def rehearse_run(
    run: CampaignRun, file: BenchFile, plant: Plant, number: int, runs_folder: Path, lane: int | None = None
) -> RunResult:
    """Run one run of a campaign, `number` counted from 0, on an emulated lab of its own."""
    with EmulatedPlace(file, plant, lane=lane).open(number) as place, Live() as live:
        return run_procedure(
            RunRequest(
                run.test,
                run.values,
                place.file,
                runs_folder,
                AssumeYes() if place.perform is None else StageHand(place.perform),
                run_id=run.name,
                emulated=place.emulated,
                before_close=place.before_close,
                live=live,
            )
        )
