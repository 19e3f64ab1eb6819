"""`gyrobench campaign plan`, and what other campaign commands say of a plan."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.box import SIMPLE_HEAD
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text
from typer import Option

from bench.present.cli._console import Terminal
from bench.present.cli._options import DEFAULT_BENCH, Bench, CampaignFile, JsonLines, PlantFile, Seed
from bench.present.cli._texts import duration, size
from drivers.base.clock import utc_now

if TYPE_CHECKING:
    from bench.campaign import Campaign, PlannedRun
    from bench.record.benchfile import BenchFile


def plan(
    campaign_file: CampaignFile,
    bench: Bench = DEFAULT_BENCH,
    out: Annotated[Path, Option(help="folder that the campaign will have; its disk is checked")] = Path(
        "campaign"
    ),
    plant_file: PlantFile = None,
    seed: Seed = None,
    quick: Annotated[
        bool, Option("--quick", help="the procedures' own estimates, without a rehearsal")
    ] = False,
    as_json: JsonLines = False,
) -> None:
    """Print the schedule and check it; nothing moves.

    It says the hours of the chamber and the bytes on disk, and refuses what a limit forbids.
    """
    from bench.campaign import bench_of, load_campaign, plan_campaign
    from bench.control.disk import check_disk
    from bench.lab.emulated import load_plant
    from bench.record.benchfile import load_bench_file

    console = Terminal(as_json=as_json)
    file = load_bench_file(bench)
    campaign = load_campaign(campaign_file, file)
    plant = None if quick else load_plant(plant_file, seed)
    shown = Terminal(stderr=True, quiet=as_json or plant is None)
    with run_counter(shown, "rehearsing", transient=True) as count:
        planned = plan_campaign(campaign, file, plant, count)
    begin = datetime.fromisoformat(utc_now())
    chamber_s, bytes_ = sum(row.chamber_s for row in planned), sum(row.bytes for row in planned)
    for row in planned:
        console.say_json("run", **_plan_json(row, begin))
    _print_plan(console, campaign, bench_of(campaign, file), planned, begin)
    check_disk(bytes_, out, "the campaign", "--out")
    warnings = plan_warnings(campaign)
    facts = {"outcome": "planned", "duration_s": planned[-1].end_s, "chamber_s": chamber_s, "bytes": bytes_}
    console.say_json("result", **facts, warnings=warnings)
    console.say_all((f"warning: {text}" for text in warnings), style="yellow")


def plan_warnings(campaign: Campaign) -> list[str]:
    """Return what lets a campaign run whose certificate cannot say "passed"."""
    from bench.campaign import not_measured

    missing = not_measured(campaign)
    them = "it" if len(missing) == 1 else "them"
    text = f"with limits on {them} no unit can pass ([limits] in the campaign file)"
    return [f"no run of this campaign measures {', '.join(missing)}: {text}"] if missing else []


@contextmanager
def run_counter(
    console: Terminal, what: str, *, transient: bool = False
) -> Iterator[Callable[[int, int], None]]:
    """Show a bar of the runs done; give what is to be told how many of how many are."""
    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=transient) as progress:
        task = progress.add_task(what, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


def _print_plan(
    console: Terminal, campaign: Campaign, file: BenchFile, planned: list[PlannedRun], begin: datetime
) -> None:
    console.say(campaign.title, style="bold")
    table = Table("from", "to", "length", "what", box=SIMPLE_HEAD, pad_edge=False)
    for column in table.columns[:3]:
        column.no_wrap = True
    about = "" if planned[0].rehearsed else "about "
    for row in planned:
        low, high = row.demands.min_temp_c, row.demands.max_temp_c
        band = f"{low:g}" if low == high else f"{low:g} .. {high:g}"
        chamber = f"{band} degC" if row.chamber_s else "chamber off"
        what = f"{row.run.name}: {row.run.procedure}, {chamber}, {about}{size(row.bytes)}"
        table.add_row(*_times(begin, row.start_s, row.end_s), Text(what))
        for step in row.steps:
            start_s, end_s = row.start_s + step.start_s, row.start_s + step.end_s
            table.add_row(*_times(begin, start_s, end_s), Text(step.title), style="dim")
    console.print(table)
    units = ", ".join(f"{gyro.unit} on {gyro.name} ({gyro.port or gyro.channel})" for gyro in file.gyro)
    chamber_h = sum(row.chamber_s for row in planned) / 3600.0
    console.say(f"units: {units}")
    console.say(f"total {about}{duration(planned[-1].end_s)}, chamber {chamber_h:.1f} h")
    console.say(f"on disk {about}{size(sum(row.bytes for row in planned))}")
    if about:
        console.print("estimates of the procedures; without --quick a rehearsal gives steps and bytes")
    asked = list(dict.fromkeys(question for row in planned for question in row.questions))
    console.say_all(f"will ask: {question}" for question in asked)
    for notice in campaign.notify:
        to = notice.webhook or notice.file or " ".join(notice.command or ())
        console.say(f"tells {to}: {', '.join(notice.on)}")
    for row in planned:
        if row.rehearsed not in ("", "completed"):
            text = f"rehearsal of {row.run.name} was {row.rehearsed}: {row.reason}"
            console.say(text, style="yellow")


def _times(begin: datetime, start_s: float, end_s: float) -> tuple[str, str, str]:
    start, end = ((begin + timedelta(seconds=s)).astimezone() for s in (start_s, end_s))
    return f"{start:%a %H:%M}", f"{end:%a %H:%M}", duration(end_s - start_s)


def _plan_json(row: PlannedRun, begin: datetime) -> dict[str, Any]:
    return {
        "run": row.run.name,
        "procedure": row.run.procedure,
        "start_s": row.start_s,
        "end_s": row.end_s,
        "start_utc": (begin + timedelta(seconds=row.start_s)).isoformat(timespec="seconds"),
        "chamber_s": row.chamber_s,
        "bytes": row.bytes,
        "steps": [
            {"title": step.title, "start_s": row.start_s + step.start_s, "end_s": row.start_s + step.end_s}
            for step in row.steps
        ],
        "questions": list(row.questions),
        "rehearsed": row.rehearsed,
        "reason": row.reason,
    }
