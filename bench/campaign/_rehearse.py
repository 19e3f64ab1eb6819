"""A campaign on emulated labs, several runs side by side."""

from __future__ import annotations

import os
import shutil
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from functools import partial
from multiprocessing import active_children, get_context, parent_process
from pathlib import Path
from types import FrameType

from bench.analysis.common.fan_out import FanOut
from bench.campaign._file import Campaign, CampaignRun, bench_of
from bench.control.runner import RunResult
from bench.lab.emulated import Plant
from bench.lab.rehearsal import rehearse_procedure
from bench.record.benchfile import BenchFile
from drivers.base.errors import RunAborted


def rehearse_campaign(
    campaign: Campaign,
    file: BenchFile,
    plant: Plant,
    runs_folder: Path,
    *,
    jobs: int = 1,
    fan: FanOut | None = None,
    finished: Callable[[RunResult], None] | None = None,
) -> dict[str, RunResult]:
    """Run a campaign on emulated labs, one fresh lab a run, `jobs` at a time; results by run name.

    With `fan` the labs are where its work is, a cluster's workers, which see `runs_folder` under the same path;
    a run whose worker died is made anew by another. The bytes do not depend on `jobs` or `fan`.

    Stopped by a signal or an error, no further run begins, those that go on end safely first, and without a
    cluster no process is left; RunAborted for SIGTERM. If this process is killed they do the same.
    """
    file = bench_of(campaign, file)
    if fan is not None:
        return _on_cluster(campaign, file, plant, runs_folder, fan, finished)
    results = {}
    waiting = list(enumerate(campaign.runs))
    going: dict[Future[RunResult], str] = {}
    with _workers(jobs) as pool:
        while waiting or going:
            # no more than can begin at once: what waits in the pool's own queue could not be taken back
            while waiting and len(going) < jobs:
                number, run = waiting.pop(0)
                lane = number % jobs if jobs > 1 else None
                task = pool.submit(_work, run, file, plant, number, runs_folder, lane)
                going[task] = run.name
            for task in wait(going, return_when=FIRST_COMPLETED).done:
                result = task.result()
                results[going.pop(task)] = result
                if finished is not None:
                    finished(result)
    return {run.name: results[run.name] for run in campaign.runs}


def _on_cluster(
    campaign: Campaign,
    file: BenchFile,
    plant: Plant,
    runs_folder: Path,
    fan: FanOut,
    finished: Callable[[RunResult], None] | None,
) -> dict[str, RunResult]:
    results = {}
    made = fan.each(partial(_anew, file, plant, runs_folder.resolve()), enumerate(campaign.runs))
    for run, result in zip(campaign.runs, made, strict=True):
        results[run.name] = result
        if finished is not None:
            finished(result)
    return results


def _anew(file: BenchFile, plant: Plant, runs_folder: Path, numbered: tuple[int, CampaignRun]) -> RunResult:
    """Rehearse a run on a cluster's worker; what one that died has left of it goes."""
    number, run = numbered
    shutil.rmtree(runs_folder / run.name, ignore_errors=True)
    return rehearse_procedure(run.test, run.values, file, plant.for_run(number), runs_folder, run_id=run.name)


@contextmanager
def _workers(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that run runs; told to stop when this one is stopped, or is no more."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise RunAborted(f"stopped by {signal.Signals(number).name}")

    main = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGTERM, stop) if main else None
    pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_end_with_parent)
    try:
        yield pool
    except BaseException:
        for process in active_children():
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        if main:
            signal.signal(signal.SIGTERM, before)


def _end_with_parent() -> None:
    """Stop this process's run when the process that began it is no more; `_work` ends it then."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        if hasattr(os, "killpg"):
            os.kill(os.getpid(), signal.SIGTERM)
        else:
            signal.raise_signal(signal.SIGTERM)  # on Windows the former ends this process at once

    threading.Thread(target=watch, name="parent", daemon=True).start()


def _work(
    run: CampaignRun, file: BenchFile, plant: Plant, number: int, runs_folder: Path, lane: int | None
) -> RunResult:
    """Rehearse run `number` of a campaign, counted from 0, on an emulated lab of its own."""
    numbered = plant.for_run(number)
    result = rehearse_procedure(run.test, run.values, file, numbered, runs_folder, run_id=run.name, lane=lane)
    parent = parent_process()
    if parent is not None and not parent.is_alive():
        os._exit(3)  # nobody will ever ask for the result
    return result
