"""`gyrobench campaign`."""

from __future__ import annotations

import os
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from bench.benchfile import load_bench_file
from bench.campaign import Campaign, load_campaign, rehearse_campaign
from bench.cli._display import duration
from bench.cli._fit import score_table, write_study
from bench.cli._run import plant_with_seed, say_result
from bench.fitting import Study, load_runs, run_study
from bench.runner import RunResult
from drivers.clock import host_seconds
from drivers.errors import ConfigurationError


def rehearse_command(
    campaign_file: Path, bench: Path, out: Path, plant_file: Path | None, seed: int | None, jobs: int | None
) -> int:
    """Rehearse a campaign, fit, report; exit code 0 if every run completed or is invalid for a stated reason."""
    console = Console()
    file = load_bench_file(bench)
    plant = plant_with_seed(plant_file, seed)
    campaign = load_campaign(campaign_file, file)
    runs_folder = out / "runs"
    if runs_folder.exists() and any(runs_folder.iterdir()):
        raise ConfigurationError(
            "the folder already holds runs",
            where=str(runs_folder),
            expected="a new or empty folder: runs are never overwritten",
            remedy="name another one with --out, or remove this one",
        )
    count = jobs or len(os.sched_getaffinity(0))
    expected = duration(campaign.expected_duration_s())
    console.print(
        f"{campaign.title}: {len(campaign.run)} runs, about {expected} of bench time, {count} at a time"
    )
    started = host_seconds()
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
    ) as progress:
        task = progress.add_task("runs", total=len(campaign.run))

        def finished(result: RunResult) -> None:
            say_result(progress.console, result)
            progress.advance(task)

        results = rehearse_campaign(campaign, file, plant, runs_folder, jobs=count, finished=finished)
    wall = host_seconds() - started
    bench_s = sum(result.duration_s for result in results.values())
    console.print(f"{duration(bench_s)} of bench time in {wall:.0f} s ({bench_s / wall:,.0f} x)")
    if any(result.outcome == "aborted" for result in results.values()):
        return 3
    fit_campaign(campaign, results, out, jobs=count, console=console)
    return 0


def fit_campaign(
    campaign: Campaign, results: dict[str, RunResult], out: Path, *, jobs: int, console: Console
) -> None:
    """Fit on the training runs, choose on the validation runs, judge on the tests; write everything to `out`."""
    folders = {name: result.folder for name, result in results.items()}
    with console.status("fitting models"):
        study = study_of(campaign, folders, jobs=jobs)
        write_study(study, list(folders.values()), out, title=campaign.title)
    console.print(score_table(study))
    console.print(f"chosen on the validation runs: [bold]{study.chosen}[/bold]")
    for name in ("compensation.gyrocomp", "compensation.h", "lstm.onnx", "report.html"):
        if (out / name).exists():
            console.print(f"  {out / name}", highlight=False)


def study_of(campaign: Campaign, folders: dict[str, Path], *, jobs: int) -> Study:
    """Return the study of a campaign's run folders, by run name."""
    training, validation, tests = (
        load_runs(
            [folders[run.name] for run in campaign.run if run.role == role],
            campaign.gyro,
            allow_invalid=role == "test",
        )
        for role in ("training", "validation", "test")
    )
    return run_study(training, validation, tests, n_jobs=jobs)
