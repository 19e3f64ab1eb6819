"""`gyrobench campaign rehearse`, and the fit at the end of every campaign."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.present.cli._options import DEFAULT_BENCH, Bench, CampaignFile, Cluster, JsonLines, PlantFile, Seed
from bench.present.cli._texts import duration

if TYPE_CHECKING:
    from bench.analysis.common.fan_out import FanOut
    from bench.campaign import Campaign
    from bench.control.runner import RunResult
    from bench.present.cli._console import Terminal


def rehearse(
    campaign_file: CampaignFile,
    bench: Bench = DEFAULT_BENCH,
    out: Annotated[Path, typer.Option(help="new folder for runs, compensation and report")] = Path(
        "campaign"
    ),
    plant_file: PlantFile = None,
    seed: Seed = None,
    jobs: Annotated[int | None, typer.Option(help="runs at the same time; default one a processor")] = None,
    cluster: Cluster = None,
    as_json: JsonLines = False,
) -> None:
    """Run a whole campaign on emulated labs, fit the compensation and write the report."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from bench.analysis.common.fan_out import fan_out
    from bench.campaign import campaign_to_rehearse, rehearse_campaign
    from bench.lab.emulated import load_plant
    from bench.present.cli._console import Terminal, console_for
    from bench.present.cli._shown_run import say_result
    from bench.record.benchfile import load_bench_file
    from drivers.base.clock import host_seconds

    console = console_for(as_json)
    file = load_bench_file(bench)
    plant = load_plant(plant_file, seed)
    campaign, runs_folder = campaign_to_rehearse(campaign_file, file, out)
    count = jobs or len(os.sched_getaffinity(0))
    expected = duration(campaign.expected_duration_s())
    if not as_json:
        console.print(
            f"{campaign.title}: {len(campaign.runs)} runs, about {expected} of bench time, {count} at a time",
        )
    started = host_seconds()
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=Terminal(stderr=True, quiet=True) if as_json else console,
    ) as progress:
        task = progress.add_task("runs", total=len(campaign.runs))

        def finished(result: RunResult) -> None:
            say_result(console, result)
            progress.advance(task)

        results = rehearse_campaign(campaign, file, plant, runs_folder, jobs=count, finished=finished)
    wall = host_seconds() - started
    bench_s = sum(result.duration_s for result in results.values())
    aborted = [name for name, result in results.items() if result.outcome == "aborted"]
    if not as_json:
        console.print(f"{duration(bench_s)} of bench time in {wall:.0f} s ({bench_s / wall:,.0f} x)")
    if not aborted and campaign.gyro is not None:
        folders = {name: result.folder for name, result in results.items()}
        with fan_out(None if cluster else count, cluster) as fan:
            fit_campaign(campaign, folders, out, fan, console)
    if as_json:
        outcome = "aborted" if aborted else "completed"
        times = {"duration_s": bench_s, "wall_s": wall}
        console.say_json("result", outcome=outcome, aborted=aborted, **times, folder=str(out))
    sys.exit(3 if aborted else 0)


def fit_campaign(
    campaign: Campaign, folders: dict[str, Path], out: Path, fan: FanOut, console: Terminal
) -> None:
    """Fit on the training runs, choose on the validation runs, judge on the tests; write everything to `out`."""
    from rich.text import Text

    from bench.campaign.study import study_of
    from bench.present.cli._console import Terminal
    from bench.present.cli.fit._cold_shock import score_table
    from bench.present.report import write_study

    shown = Terminal(quiet=True) if console.as_json else console
    with shown.status("fitting models"):
        study = study_of(campaign, folders, fan=fan)
        write_study(study, list(folders.values()), out, title=campaign.title)
    shown.print(score_table(study))
    shown.print(Text.assemble("chosen on the validation runs: ", (study.chosen, "bold")))
    for name in ("compensation.gyrocomp", "compensation.h", "lstm.onnx", "report.html"):
        if (out / name).exists():
            shown.say(f"  {out / name}")
