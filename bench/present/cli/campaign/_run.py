"""`gyrobench campaign run`, `resume`, `status` and `rehearse`, and the fit at a campaign's end."""

from __future__ import annotations

import itertools
import sys
from functools import partial
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from bench.present.cli import _options as options
from bench.present.cli._console import Terminal
from bench.present.cli._texts import duration
from bench.present.cli.campaign._plan import plan_warnings, run_counter
from drivers.base.clock import host_seconds
from drivers.base.errors import BenchError, ConfigurationError, RecordError
from drivers.base.system import processors

if TYPE_CHECKING:
    from bench.analysis.common.fan_out import FanOut
    from bench.campaign import Campaign, CampaignEnding, CampaignFolder
    from bench.control.runner import RunResult
    from bench.record.events.campaign import Stopped


Folder = Annotated[Path, Argument(help="the campaign's folder", metavar="folder")]


def run(
    campaign_file: options.CampaignFile,
    bench: options.Bench = options.DEFAULT_BENCH,
    out: Annotated[Path, Option(help="new folder for the campaign")] = Path("campaign"),
    emulated: Annotated[
        bool, Option("--emulated", help="on emulated labs that match the bench file")
    ] = False,
    plant_file: options.PlantFile = None,
    seed: options.Seed = None,
    ask: Annotated[
        bool, Option("--ask", help="with --emulated: put the questions to a human all the same")
    ] = False,
    yes: options.Yes = False,
    by: options.By = "",
    signed_in_as: options.SignedIn = "",
    as_json: options.JsonLines = False,
) -> None:
    """Run a campaign on the bench, one run after the other.

    `gyrobench campaign resume` goes on after a stop.
    """
    from bench.campaign import begin_campaign
    from bench.lab.emulated import load_plant
    from bench.record.benchfile import load_bench_file

    file = load_bench_file(bench)
    if not emulated and (plant_file is not None or seed is not None or ask):
        raise ConfigurationError(
            "--plant, --seed and --ask are for emulated labs", remedy="add --emulated, or leave them out"
        )
    plant = load_plant(plant_file, seed) if emulated else None
    folder = begin_campaign(campaign_file, file, out, plant=plant, ask=ask)
    sys.exit(_work(folder, Terminal(as_json=as_json), (by, signed_in_as), yes=yes))


def resume(
    path: Folder,
    yes: options.Yes = False,
    by: options.By = "",
    signed_in_as: options.SignedIn = "",
    as_json: options.JsonLines = False,
) -> None:
    """Go on at the first run that is not complete.

    A check comes first that the bench is in a known state.
    """
    from bench.campaign import resume_campaign

    sys.exit(_work(resume_campaign(path), Terminal(as_json=as_json), (by, signed_in_as), yes=yes))


def status(path: Folder, as_json: options.JsonLines = False) -> None:
    """Show how far a campaign is, from any shell; reads files only."""
    from bench.campaign import CampaignFolder
    from bench.control.live import read_now
    from bench.record.events.campaign import Stopped

    console, folder = Terminal(as_json=as_json), CampaignFolder(path)
    now, states = read_now(path), folder.states()
    stopped = [(utc, event) for utc, event in folder.events() if isinstance(event, Stopped)]
    going = str(((now or {}).get("run") or {}).get("run_id", "")) if now and now["alive"] else ""
    rows = []
    for state in states:
        name, where = state.run.name, None if state.folder is None else str(state.folder)
        facts = {"run": name, "state": state.state, "outcome": state.outcome, "reason": state.reason}
        console.say_json("run", **facts, attempts=state.attempts, folder=where)
        doing = bool(going) and state.folder is not None and state.folder.name == going
        word = str(now["state"]) if now and doing else state.outcome if state.state == "done" else "to do"
        length = "" if state.duration_s is None else duration(state.duration_s)
        reason = "" if doing else state.reason
        rows.append((name, state.run.procedure, word, length, str(state.attempts), reason))
    title, done = folder.campaign.title, sum(state.state == "done" for state in states)
    console.say_json("result", title=title, done=done, count=len(states), now=now)
    console.table(("run", "procedure", "state", "bench time", "attempts", ""), rows, title)
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
            console.say(f"`gyrobench campaign resume {quote(str(path))}` goes on", soft_wrap=True)
        return
    console.say(
        f"{now['state']}: {now['step']}: {'an operator is asked' if now['prompts'] else now['doing']}; "
        f"{duration(now['left_s'] or 0.0)} left of this run, process {now['pid']}"
    )
    for prompt in now["prompts"]:
        console.print(f"waits for an answer: {prompt['question']}", style="bold yellow")
        console.say(f"`gyrobench steer {quote(str(path))} answer yes` answers it", soft_wrap=True)
    for row in now["log"][-5:]:
        console.say(f"  {duration(float(row['time_s']))} {sentence(event_of(row))}", style="dim")


def _work(folder: CampaignFolder, console: Terminal, by: tuple[str, str], *, yes: bool) -> int:
    """Do what is left of a campaign, fit and certify; return the exit code."""
    from bench.analysis.common.fan_out import ALONE
    from bench.campaign import CampaignRunner
    from bench.present.cli._display import RunDisplay
    from bench.present.cli._shown_run import console_operator, say_result, signature
    from bench.record.events.campaign import Fitted, Fitting

    campaign, reasons = folder.campaign, [""]
    console.say(f"{_extent(campaign)}, in {folder.path}")
    for text in plan_warnings(campaign):
        console.say_json("warning", text=text)
        console.say(f"warning: {text}", style="yellow")

    def say(result: RunResult) -> None:
        """Print how a run ended and write its report; one that cannot be made is said and stops nothing."""
        from bench.present.report import report_run

        reasons.append(result.reason)
        say_result(console, result)
        try:
            if result.outcome != "aborted":
                report_run(result.folder)
        except BenchError as error:
            console.say(f"no report of this run: {error}", style="yellow")

    operator = None if console.as_json else console_operator(console)
    starter = signature(*by)
    ending = CampaignRunner(folder, operator, yes, partial(RunDisplay, console), say, starter).run()
    if ending.outcome == "completed" and campaign.gyro is not None:
        folder.event(Fitting(campaign.gyro))
        _fit_campaign(campaign, ending.folders, folder.path, ALONE, console)
        folder.event(Fitted(campaign.gyro, "."))
    verdict = _certify(folder, console, quiet=ending.outcome != "completed")
    return _say_ending(console, folder, ending, verdict, said=reasons[-1])


def _extent(campaign: Campaign) -> str:
    expected = duration(campaign.expected_duration_s())
    return f"{campaign.title}: {len(campaign.runs)} runs, about {expected} of bench time"


def _certify(folder: CampaignFolder, console: Terminal, *, quiet: bool) -> str:
    """Write the campaign's certificate, whatever became of it; return its verdict, if there is one."""
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
        console.say_json("warning", text=str(error))
        console.say(str(error), style="red")
        return "not passed"
    verdict = certificate.verdict
    say_certificate(shown, certificate)
    passed = {"passed": True, "not passed": False, "undecided": None, "not judged": None}[verdict]
    folder.event(CertificateMade(CERTIFICATE_FILE, passed))
    shown.say(f"certificate: {folder.path / CERTIFICATE_FILE}", soft_wrap=True)
    return verdict


def _say_ending(
    console: Terminal, folder: CampaignFolder, ending: CampaignEnding, verdict: str, said: str
) -> int:
    """Say how a campaign ended, `said` being its last run's reason that was printed already; return the code."""
    invalid = [state.run.name for state in ending.states if state.outcome == "invalid"]
    done, count = sum(state.state == "done" for state in ending.states), len(ending.states)
    facts = {"outcome": ending.outcome, "reason": ending.reason, "done": done, "count": count}
    where = str(folder.path)
    console.say_json("result", **facts, invalid=invalid, certificate=verdict or None, folder=where)
    style = "green" if ending.outcome == "completed" else "red"
    console.print(f"campaign {ending.outcome}, {done} of {count} runs recorded", style=style)
    if ending.reason:
        if ending.reason != said:
            console.say(ending.reason, style=style)
        console.say(f"`gyrobench campaign resume {quote(str(where))}` goes on", soft_wrap=True)
    if invalid:
        console.print(f"invalid for their purpose: {', '.join(invalid)}", style="yellow")
    if ending.outcome != "completed":
        return 3
    return 4 if invalid or verdict == "not passed" else 0


def rehearse(
    campaign_file: options.CampaignFile,
    bench: options.Bench = options.DEFAULT_BENCH,
    out: Annotated[Path, Option(help="new folder for runs, compensation and report")] = Path("campaign"),
    plant_file: options.PlantFile = None,
    seed: options.Seed = None,
    jobs: Annotated[int | None, Option(help="runs at the same time; default one a processor")] = None,
    cluster: options.Cluster = None,
    as_json: options.JsonLines = False,
) -> None:
    """Run a campaign on emulated labs, fit, and write the report."""
    from bench.analysis.common.fan_out import fan_out
    from bench.campaign import campaign_to_rehearse, rehearse_campaign
    from bench.lab.emulated import load_plant
    from bench.present.cli._shown_run import say_result
    from bench.record.benchfile import load_bench_file

    console = Terminal(as_json=as_json)
    file = load_bench_file(bench)
    plant = load_plant(plant_file, seed)
    campaign, runs_folder = campaign_to_rehearse(campaign_file, file, out)
    at_once = jobs or processors()
    console.print(f"{_extent(campaign)}, {f'on {cluster}' if cluster else f'{at_once} at a time'}")
    started, done = host_seconds(), itertools.count(1)
    whole = len(campaign.runs)
    with run_counter(console, "runs") as count:
        count(0, whole)

        def finished(result: RunResult) -> None:
            say_result(console, result)
            count(next(done), whole)

        # without a cluster the labs have processes of their own, which a signal stops safely
        with fan_out(jobs if cluster else None, cluster) as fan:
            results = rehearse_campaign(
                campaign,
                file,
                plant,
                runs_folder,
                jobs=at_once,
                fan=fan if cluster else None,
                finished=finished,
            )
    wall_s = host_seconds() - started
    bench_s = sum(result.duration_s for result in results.values())
    aborted = [name for name, result in results.items() if result.outcome == "aborted"]
    console.print(f"{duration(bench_s)} of bench time in {wall_s:.0f} s ({bench_s / wall_s:,.0f} x)")
    if not aborted and campaign.gyro is not None:
        folders = {name: result.folder for name, result in results.items()}
        with fan_out(jobs if cluster else at_once, cluster) as fan:
            _fit_campaign(campaign, folders, out, fan, console)
    outcome = "aborted" if aborted else "completed"
    times = {"duration_s": bench_s, "wall_s": wall_s}
    console.say_json("result", outcome=outcome, aborted=aborted, **times, folder=str(out))
    sys.exit(3 if aborted else 0)


def _fit_campaign(
    campaign: Campaign, folders: dict[str, Path], out: Path, fan: FanOut, console: Terminal
) -> None:
    """Fit on the training runs, choose on the validation runs, judge on the tests; write everything to `out`."""
    from bench.campaign.study import study_of
    from bench.present.cli.fit._temperature import score_table
    from bench.present.report import write_study

    with console.status("fitting models"):
        study = study_of(campaign, folders, fan=fan)
        write_study(study, list(folders.values()), out, title=campaign.title)
    console.print(score_table(study))
    console.parts("chosen on the validation runs: ", (study.chosen, "bold"))
    for name in ("compensation.gyrocomp", "compensation.h", "lstm.onnx", "report.html"):
        if (out / name).exists():
            console.say(f"  {out / name}")
