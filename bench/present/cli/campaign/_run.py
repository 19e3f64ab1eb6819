"""`gyrobench campaign run`, `resume` and `status`."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bench.present.cli._options import DEFAULT_BENCH, Bench, CampaignFile, JsonLines, PlantFile, Seed, Yes
from bench.present.cli._texts import duration
from drivers.base.errors import BenchError, ConfigurationError, RecordError

if TYPE_CHECKING:
    from bench.campaign import CampaignEnding, CampaignFolder
    from bench.control.runner import RunResult
    from bench.present.cli._console import Terminal
    from bench.present.cli._display import RunDisplay
    from bench.record.events.campaign import Stopped


Folder = Annotated[Path, typer.Argument(help="the campaign's folder", metavar="folder")]


def run(
    campaign_file: CampaignFile,
    bench: Bench = DEFAULT_BENCH,
    out: Annotated[Path, typer.Option(help="new folder for the campaign")] = Path("campaign"),
    emulated: Annotated[
        bool, typer.Option("--emulated", help="on emulated labs that match the bench file")
    ] = False,
    plant_file: PlantFile = None,
    seed: Seed = None,
    ask: Annotated[
        bool, typer.Option("--ask", help="with --emulated: put the questions to a human all the same")
    ] = False,
    yes: Yes = False,
    as_json: JsonLines = False,
) -> None:
    """Run a campaign on the bench, one run after the other; `resume` goes on after a stop."""
    from bench.campaign import begin_campaign
    from bench.lab.emulated import load_plant
    from bench.present.cli._console import console_for
    from bench.record.benchfile import load_bench_file

    file = load_bench_file(bench)
    if not emulated and (plant_file is not None or seed is not None or ask):
        raise ConfigurationError(
            "--plant, --seed and --ask are for emulated labs", remedy="add --emulated, or leave them out"
        )
    plant = load_plant(plant_file, seed) if emulated else None
    folder = begin_campaign(campaign_file, file, out, plant=plant, ask=ask)
    sys.exit(_work(folder, console_for(as_json), yes=yes))


def resume(path: Folder, yes: Yes = False, as_json: JsonLines = False) -> None:
    """Go on at the first run that is not complete, after a check that the bench is in a known state."""
    from bench.campaign import resume_campaign
    from bench.present.cli._console import console_for

    sys.exit(_work(resume_campaign(path), console_for(as_json), yes=yes))


def status(path: Folder, as_json: JsonLines = False) -> None:
    """Show how far a campaign is, from any shell; reads files only."""
    from rich.table import Table

    from bench.campaign import CampaignFolder
    from bench.control.live import read_now
    from bench.present.cli._console import console_for
    from bench.record.events.campaign import Stopped

    console = console_for(as_json)
    folder = CampaignFolder(path)
    now, states = read_now(path), folder.states()
    stopped = [(utc, event) for utc, event in folder.events() if isinstance(event, Stopped)]
    if as_json:
        for run in states:
            where = None if run.folder is None else str(run.folder)
            facts = {"run": run.run.name, "state": run.state, "outcome": run.outcome, "reason": run.reason}
            console.say_json("run", **facts, attempts=run.attempts, folder=where)
        done = sum(run.state == "done" for run in states)
        console.say_json("result", title=folder.campaign.title, done=done, count=len(states), now=now)
        return
    table = Table("run", "procedure", "state", "bench time", "attempts", "", title=folder.campaign.title)
    going = str(((now or {}).get("run") or {}).get("run_id", "")) if now and now["alive"] else ""
    for run in states:
        doing = bool(going) and run.folder is not None and run.folder.name == going
        state = str(now["state"]) if now and doing else run.outcome if run.state == "done" else "to do"
        length = "" if run.duration_s is None else duration(run.duration_s)
        reason = "" if doing else run.reason
        table.add_row(run.run.name, run.run.procedure, state, length, str(run.attempts), reason)
    console.print(table)
    _print_now(console, now, stopped[-1] if stopped else None, path)


def _print_now(
    console: Terminal, now: dict[str, Any] | None, stopped: tuple[str, Stopped] | None, path: Path
) -> None:
    from bench.present.sentences import event_of, sentence

    if now is None or not now["alive"]:
        died = now is not None and now["state"] != "ended"
        if died and now is not None:
            console.print(
                f"the process {now['pid']} ended without a word, last seen {now['utc']}", style="red"
            )
        elif stopped is not None:
            utc, how = stopped
            text = f"{how.outcome} at {utc}"
            console.print(f"{text}: {how.reason}" if how.reason else text)
        if died or stopped is None or stopped[1].outcome != "completed":
            console.say(f"`gyrobench campaign resume {path}` goes on")
        return
    console.say(
        f"{now['state']}: {now['step']}: {'an operator is asked' if now['prompts'] else now['doing']}; "
        f"{duration(now['left_s'] or 0.0)} left of this run, process {now['pid']}"
    )
    for prompt in now["prompts"]:
        console.print(f"waits for an answer: {prompt['question']}", style="bold yellow")
        console.say(f"`gyrobench steer {path} answer yes` answers it")
    for row in now["log"][-5:]:
        console.say(f"  {duration(float(row['time_s']))} {sentence(event_of(row))}", style="dim")


def _work(folder: CampaignFolder, console: Terminal, *, yes: bool) -> int:
    from bench.analysis.common.fan_out import ALONE
    from bench.campaign import CampaignRunner
    from bench.present.cli._display import RunDisplay
    from bench.present.cli._shown_run import console_operator, say_result
    from bench.present.cli.campaign._plan import plan_warnings, say_warnings
    from bench.present.cli.campaign._rehearse import fit_campaign
    from bench.record.events.campaign import Fitted, Fitting

    campaign, as_json = folder.campaign, console.as_json
    if not as_json:
        expected = duration(campaign.expected_duration_s())
        console.say(
            f"{campaign.title}: {len(campaign.runs)} runs, about {expected} of bench time, in {folder.path}"
        )
    say_warnings(console, plan_warnings(campaign))
    with ExitStack() as stack:
        shown: list[ExitStack] = []
        reasons = [""]

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
            reasons.append(result.reason)
            say_result(console, result)
            _report_run(result, console)

        stack.callback(hide)
        operator = None if as_json else console_operator(console)
        ending = CampaignRunner(folder, operator, yes, display, say).run()
    if ending.outcome == "completed" and campaign.gyro is not None:
        folder.event(Fitting(campaign.gyro))
        fit_campaign(campaign, ending.folders, folder.path, ALONE, console)
        folder.event(Fitted(campaign.gyro, "."))
    verdict = _certify(folder, console, quiet=as_json or ending.outcome != "completed")
    return _say_ending(console, folder, ending, verdict, said=reasons[-1])


def _report_run(result: RunResult, console: Terminal) -> None:
    """Write a run's report beside it; a report that cannot be made is said and stops nothing."""
    if result.outcome == "aborted":
        return
    from bench.present.report import report_run

    try:
        report_run(result.folder)
    except BenchError as error:
        if not console.as_json:
            console.say(f"no report of this run: {error}", style="yellow")


def _certify(folder: CampaignFolder, console: Terminal, *, quiet: bool) -> str:
    """Write the campaign's certificate, whatever became of it; return its verdict, if there is one."""
    from bench.present.cli._console import Terminal
    from bench.present.cli._report import say_certificate
    from bench.present.report import CERTIFICATE_FILE, certify_campaign
    from bench.record.events.campaign import CertificateMade

    shown = Terminal(quiet=True) if quiet else console
    try:
        with shown.status("verifying records"):
            certificate = certify_campaign(folder)
    except ConfigurationError:  # not one run was begun: nothing to certify
        return ""
    except RecordError as error:
        console.say(str(error), style="red")
        return "not passed"
    verdict = certificate.verdict
    say_certificate(shown, certificate)
    passed = {"passed": True, "not passed": False, "not judged": None}[verdict]
    folder.event(CertificateMade(CERTIFICATE_FILE, passed))
    if not quiet:
        path = folder.path / CERTIFICATE_FILE
        console.say(f"certificate: {path}", soft_wrap=True)
    return verdict


def _say_ending(
    console: Terminal, folder: CampaignFolder, ending: CampaignEnding, verdict: str, said: str
) -> int:
    invalid = [state.run.name for state in ending.states if state.outcome == "invalid"]
    done = sum(state.state == "done" for state in ending.states)
    if console.as_json:
        console.say_json(
            "result",
            outcome=ending.outcome,
            reason=ending.reason,
            done=done,
            count=len(ending.states),
            invalid=invalid,
            certificate=verdict or None,
            folder=str(folder.path),
        )
    else:
        style = "green" if ending.outcome == "completed" else "red"
        console.print(f"campaign {ending.outcome}, {done} of {len(ending.states)} runs recorded", style=style)
        if ending.reason:
            if ending.reason != said:  # else it stands above, with the run
                console.say(ending.reason, style=style)
            console.say(f"`gyrobench campaign resume {folder.path}` goes on")
        if invalid:
            console.print(f"invalid for their purpose: {', '.join(invalid)}", style="yellow")
    if ending.outcome != "completed":
        return 3
    return 4 if invalid or verdict == "not passed" else 0
