"""`gyrobench campaign`: plan, run, resume, status, rehearse."""

from __future__ import annotations

import os
from contextlib import ExitStack
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from bench.benchfile import BenchFile, load_bench_file
from bench.campaign import (
    Campaign,
    CampaignEnding,
    CampaignFolder,
    CampaignRunner,
    PlannedRun,
    bench_of,
    check_disk,
    check_limits,
    estimated_bytes,
    load_campaign,
    plan_campaign,
    rehearse_campaign,
)
from bench.cli._display import RunDisplay
from bench.cli._run import console_for, console_operator, plant_with_seed, say_result
from bench.cli._texts import duration, event_text, say_json, size
from bench.emulated import Plant
from bench.fan_out import ALONE, FanOut, fan_out
from bench.lease import take_lease
from bench.live import read_now
from bench.runner import RunResult
from drivers.clock import host_seconds, utc_now
from drivers.errors import BenchError, ConfigurationError, RecordError


def plan_command(
    campaign_file: Path,
    bench: Path,
    out: Path,
    plant_file: Path | None,
    seed: int | None,
    quick: bool,
    as_json: bool,
) -> int:
    """Print the schedule and what it takes; LimitExceeded or ConfigurationError for what cannot be done."""
    console = console_for(as_json)
    file = load_bench_file(bench)
    campaign = load_campaign(campaign_file, file)
    plant = None if quick else plant_with_seed(plant_file, seed)
    planned = _planned(campaign, file, plant, console, as_json)
    begin = datetime.fromisoformat(utc_now())
    if as_json:
        for row in planned:
            say_json(console, "run", **_plan_json(row, begin))
    else:
        _print_plan(console, campaign, bench_of(campaign, file), planned, begin)
    needed = sum(row.bytes or 0 for row in planned)
    check_disk(needed or estimated_bytes(campaign.runs, bench_of(campaign, file)), out)
    if as_json:
        total_s, chamber_s = planned[-1].end_s, sum(row.chamber_s for row in planned)
        say_json(
            console,
            "result",
            outcome="planned",
            duration_s=total_s,
            chamber_s=chamber_s,
            bytes=needed or None,
        )
    return 0


def run_command(
    campaign_file: Path,
    bench: Path,
    out: Path,
    *,
    emulated: bool,
    plant_file: Path | None,
    seed: int | None,
    ask: bool,
    yes: bool,
    as_json: bool,
) -> int:
    """Begin a campaign in a new folder and work until it is done or stopped."""
    file = load_bench_file(bench)
    campaign = load_campaign(campaign_file, file)
    check_limits(campaign, bench_of(campaign, file))
    check_disk(estimated_bytes(campaign.runs, bench_of(campaign, file)), out)
    if not emulated and (plant_file is not None or seed is not None or ask):
        raise ConfigurationError(
            "--plant, --seed and --ask are for emulated labs", remedy="add --emulated, or leave them out"
        )
    plant = plant_with_seed(plant_file, seed) if emulated else None
    if plant is None:
        take_lease(
            bench_of(campaign, file), f"campaign {campaign.title}"
        ).release()  # taken: nothing is begun
    folder = CampaignFolder.create(out, campaign_file, campaign, file, plant, ask)
    return _work(folder, yes=yes, as_json=as_json)


def resume_command(path: Path, *, yes: bool, as_json: bool) -> int:
    """Go on with a campaign at its first run that is not complete."""
    folder = CampaignFolder(path)
    left = [each.run for each in folder.states() if each.state == "open"]
    check_disk(estimated_bytes(left, bench_of(folder.campaign, folder.file)), path)
    return _work(folder, yes=yes, as_json=as_json)


def status_command(path: Path, as_json: bool) -> int:
    """Print how far a campaign is, from its files alone."""
    console = console_for(as_json)
    folder = CampaignFolder(path)
    now, states = read_now(path), folder.states()
    stopped = [row for row in folder.events() if row["kind"] == "stopped"]
    if as_json:
        for each in states:
            where = None if each.folder is None else str(each.folder)
            say_json(
                console,
                "run",
                run=each.run.name,
                state=each.state,
                outcome=each.outcome,
                reason=each.reason,
                attempts=each.attempts,
                folder=where,
            )
        done = sum(each.state == "done" for each in states)
        say_json(console, "result", title=folder.campaign.title, done=done, count=len(states), now=now)
        return 0
    table = Table("run", "procedure", "state", "bench time", "attempts", "", title=folder.campaign.title)
    going = str(((now or {}).get("run") or {}).get("run_id", "")) if now and now["alive"] else ""
    for each in states:
        doing = bool(going) and each.folder is not None and each.folder.name == going
        state = "running" if doing else each.outcome if each.state == "done" else "to do"
        length = "" if each.duration_s is None else duration(each.duration_s)
        reason = "" if doing else each.reason
        table.add_row(each.run.name, each.run.procedure, state, length, str(each.attempts), reason)
    console.print(table)
    _print_now(console, now, stopped[-1] if stopped else None, path)
    return 0


def _print_now(
    console: Console, now: dict[str, Any] | None, stopped: dict[str, Any] | None, path: Path
) -> None:
    if now is None or not now["alive"]:
        died = now is not None and now["state"] != "ended"
        if died and now is not None:
            console.print(
                f"the process {now['pid']} ended without a word, last seen {now['utc']}", style="red"
            )
        elif stopped is not None:
            text = f"{stopped['outcome']} at {stopped['utc']}"
            console.print(f"{text}: {stopped['reason']}" if stopped["reason"] else text, markup=False)
        if died or stopped is None or stopped["outcome"] != "completed":
            console.print(f"`gyrobench campaign resume {path}` goes on", highlight=False)
        return
    console.print(
        f"{now['state']}: {now['step']} {now['doing']}; "
        f"{duration(now['left_s'] or 0.0)} left of this run, process {now['pid']}",
        highlight=False,
        markup=False,
    )
    for prompt in now["prompts"]:
        console.print(f"waits for an answer: {prompt['question']}", style="bold yellow", markup=False)
        console.print(f"`gyrobench steer {path} answer yes` answers it", highlight=False)
    for row in now["log"][-5:]:
        console.print("  " + event_text(row), style="dim", highlight=False, markup=False)


def _work(folder: CampaignFolder, *, yes: bool, as_json: bool) -> int:
    console = console_for(as_json)
    campaign = folder.campaign
    if not as_json:
        expected = duration(campaign.expected_duration_s())
        console.print(
            f"{campaign.title}: {len(campaign.runs)} runs, about {expected} of bench time, in {folder.path}",
            highlight=False,
            markup=False,
        )
    with ExitStack() as stack:
        shown: list[ExitStack] = []

        def hide() -> None:
            while shown:
                shown.pop().close()

        def display(name: str, expected_s: float) -> RunDisplay:
            hide()
            view = ExitStack()
            shown.append(view)
            return view.enter_context(RunDisplay(console, name, expected_s, as_json=as_json))

        def say(result: RunResult) -> None:
            hide()
            say_result(console, result, as_json=as_json)
            _report_run(result, console, as_json)

        stack.callback(hide)
        operator = None if as_json else console_operator(console)
        ending = CampaignRunner(folder, operator, yes, display, say).run()
    if ending.outcome == "completed" and campaign.gyro is not None:
        folder.event("fitting", gyro=campaign.gyro)
        fit_campaign(campaign, ending.folders, folder.path, fan=ALONE, console=console, quiet=as_json)
        folder.event("fitted", gyro=campaign.gyro, folder=".")
    code = _certify(folder, console, quiet=as_json)
    return _say_ending(console, folder, ending, as_json) or code


def _report_run(result: RunResult, console: Console, as_json: bool) -> None:
    """Write a run's report beside it; a report that cannot be made is said and stops nothing."""
    if result.outcome == "aborted":
        return
    from bench.cli._report import run_report

    try:
        run_report(result.folder)
    except BenchError as error:
        if not as_json:
            console.print(f"no report of this run: {error}", style="yellow", highlight=False, markup=False)


def _certify(folder: CampaignFolder, console: Console, *, quiet: bool) -> int:
    """Write the campaign's certificate, whatever became of it; exit code 4 if it says "not passed"."""
    from bench.cli._report import CERTIFICATE_FILE, certify_campaign

    try:
        code = certify_campaign(folder, Console(quiet=True) if quiet else console)
    except ConfigurationError:  # not one run was begun: nothing to certify
        return 0
    except RecordError as error:
        console.print(str(error), style="red", highlight=False, markup=False)
        return 4
    folder.event("certificate", file=CERTIFICATE_FILE, passed=code == 0)
    return code


def _say_ending(console: Console, folder: CampaignFolder, ending: CampaignEnding, as_json: bool) -> int:
    invalid = [state.run.name for state in ending.states if state.outcome == "invalid"]
    done = sum(state.state == "done" for state in ending.states)
    if as_json:
        say_json(
            console,
            "result",
            outcome=ending.outcome,
            reason=ending.reason,
            done=done,
            count=len(ending.states),
            invalid=invalid,
            folder=str(folder.path),
        )
    else:
        style = "green" if ending.outcome == "completed" else "red"
        console.print(f"campaign {ending.outcome}, {done} of {len(ending.states)} runs recorded", style=style)
        if ending.reason:
            console.print(ending.reason, style=style, highlight=False, markup=False)
            console.print(f"`gyrobench campaign resume {folder.path}` goes on", highlight=False)
        if invalid:
            console.print(f"invalid for their purpose: {', '.join(invalid)}", style="yellow")
    if ending.outcome != "completed":
        return 3
    return 4 if invalid else 0


def _planned(
    campaign: Campaign, file: BenchFile, plant: Plant | None, console: Console, as_json: bool
) -> list[PlannedRun]:
    with Progress(
        TextColumn("rehearsing"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True, quiet=as_json or plant is None),
        transient=True,
    ) as progress:
        task = progress.add_task("runs", total=None)
        return plan_campaign(
            campaign, file, plant, lambda done, count: progress.update(task, completed=done, total=count)
        )


def _print_plan(
    console: Console, campaign: Campaign, file: BenchFile, planned: list[PlannedRun], begin: datetime
) -> None:
    table = Table("run and steps", title=campaign.title)
    for name in ("from", "to", "length", "chamber", "bytes"):
        table.add_column(name, no_wrap=True)
    for row in planned:
        low, high = row.demands.min_temp_c, row.demands.max_temp_c
        chamber = f"{low:g} .. {high:g} degC" if row.chamber_s else "off"
        bytes_text = "" if row.bytes is None else size(row.bytes)
        name = f"{escape(row.run.name)} ({row.run.procedure})"
        table.add_row(name, *_times(begin, row.start_s, row.end_s), chamber, bytes_text)
        for step in row.steps:
            start_s, end_s = row.start_s + step.start_s, row.start_s + step.end_s
            table.add_row(f"  {escape(step.title)}", *_times(begin, start_s, end_s), style="dim")
    console.print(table)
    units = ", ".join(f"{gyro.unit} on {gyro.name} ({gyro.port or gyro.channel})" for gyro in file.gyro)
    chamber_h = sum(row.chamber_s for row in planned) / 3600.0
    console.print(f"units: {units}", highlight=False, markup=False)
    console.print(f"total {duration(planned[-1].end_s)}, chamber {chamber_h:.1f} h", highlight=False)
    if planned[0].bytes is None:
        console.print("estimates of the procedures; without --quick a rehearsal gives steps and bytes")
    else:
        console.print(f"on disk {size(sum(row.bytes or 0 for row in planned))}", highlight=False)
    asked = list(dict.fromkeys(question for row in planned for question in row.questions))
    for question in asked:
        console.print(f"will ask: {question}", highlight=False, markup=False)
    for notice in campaign.notify:
        to = notice.webhook or notice.file or " ".join(notice.command or ())
        console.print(f"tells {to}: {', '.join(notice.on)}", highlight=False, markup=False)
    for row in planned:
        if row.rehearsed not in ("", "completed"):
            text = f"rehearsal of {row.run.name} was {row.rehearsed}: {row.reason}"
            console.print(text, style="yellow", highlight=False, markup=False)


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


def rehearse_command(
    campaign_file: Path,
    bench: Path,
    out: Path,
    plant_file: Path | None,
    seed: int | None,
    jobs: int | None,
    as_json: bool = False,
    cluster: str | None = None,
) -> int:
    """Rehearse a campaign, fit, report; exit code 0 if every run completed or is invalid for a stated reason."""
    console = console_for(as_json)
    file = load_bench_file(bench)
    plant = plant_with_seed(plant_file, seed)
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
    count = jobs or len(os.sched_getaffinity(0))
    expected = duration(campaign.expected_duration_s())
    if not as_json:
        console.print(
            f"{campaign.title}: {len(campaign.runs)} runs, about {expected} of bench time, {count} at a time",
            markup=False,
        )
    started = host_seconds()
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True, quiet=True) if as_json else console,
    ) as progress:
        task = progress.add_task("runs", total=len(campaign.runs))

        def finished(result: RunResult) -> None:
            say_result(console if as_json else progress.console, result, as_json=as_json)
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
            fit_campaign(campaign, folders, out, fan=fan, console=console, quiet=as_json)
    if as_json:
        outcome = "aborted" if aborted else "completed"
        say_json(
            console,
            "result",
            outcome=outcome,
            aborted=aborted,
            duration_s=bench_s,
            wall_s=wall,
            folder=str(out),
        )
    return 3 if aborted else 0


def fit_campaign(
    campaign: Campaign, folders: dict[str, Path], out: Path, *, fan: FanOut, console: Console, quiet: bool
) -> None:
    """Fit on the training runs, choose on the validation runs, judge on the tests; write everything to `out`."""
    from bench.campaign_study import study_of
    from bench.cli._fit import score_table, write_study

    shown = Console(quiet=True) if quiet else console
    with shown.status("fitting models"):
        study = study_of(campaign, folders, fan=fan)
        write_study(study, list(folders.values()), out, title=campaign.title)
    shown.print(score_table(study))
    shown.print(f"chosen on the validation runs: [bold]{study.chosen}[/bold]")
    for name in ("compensation.gyrocomp", "compensation.h", "lstm.onnx", "report.html"):
        if (out / name).exists():
            shown.print(f"  {out / name}", highlight=False)
