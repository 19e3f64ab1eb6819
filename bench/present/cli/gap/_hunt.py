"""`gyrobench gap hunt`: runs chosen one after the other until it is known which effect is missing."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from bench.present.cli import _options as options
from bench.present.cli._console import Terminal
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError

if TYPE_CHECKING:
    from bench.campaign.hunt import Hunt
    from bench.control.runner import RunResult
    from bench.record.events.campaign import Sought

_ENDS = {
    "decided": "decided",
    "alike": "decided: one of several that no run of this bench tells apart",
    "undecided": "undecided: no run that this bench can make would tell more",
    "budget": "the bench time is spent",
}


def hunt(
    bench: options.Bench = options.DEFAULT_BENCH,
    model: Annotated[Path | None, Option(help="nominal model (TOML); a search that goes on has it")] = None,
    out: Annotated[Path, Option(help="folder of the search; one that was begun goes on")] = Path("hunt"),
    budget_h: Annotated[float, Option("--budget-h", help="bench time that may be spent, h")] = 60.0,
    until: Annotated[float, Option(help="probability from which an explanation counts as found")] = 0.95,
    gyro: options.DiagnosedGyro = None,
    emulated: Annotated[bool, Option("--emulated", help="on emulated labs that match the bench")] = False,
    plant_file: options.PlantFile = None,
    seed: options.Seed = None,
    report: Annotated[Path | None, Option(help="HTML report of the last diagnosis")] = None,
    yes: options.Yes = False,
    by: options.By = "",
    signed_in_as: options.SignedIn = "",
    as_json: options.JsonLines = False,
) -> None:
    """Find the missing effect by runs that the search chooses.

    It chooses the run that tells most per hour, makes it, diagnoses, and goes on until it knows enough.
    """
    from bench.campaign import HUNT_FILE, CampaignRunner, resume_campaign
    from bench.campaign.hunt import Hunt, HuntSettings, begin_hunt
    from bench.lab.emulated import load_plant
    from bench.present.cli._display import RunDisplay
    from bench.present.cli._shown_run import console_operator, say_result, signature
    from bench.record.benchfile import load_bench_file

    console = Terminal(as_json=as_json)
    if (out / HUNT_FILE).exists():
        search = Hunt(resume_campaign(out))
    elif model is None:
        raise ConfigurationError(
            "a search begins with a nominal model",
            where="--model",
            found="none",
            expected="a TOML file such as examples/nominal/fog_cold_shock.toml",
        )
    else:
        if not emulated and (plant_file is not None or seed is not None):
            raise ConfigurationError(
                "--plant and --seed are for emulated labs", remedy="add --emulated, or leave them out"
            )
        settings = HuntSettings(budget_h=budget_h, until=until, gyro=gyro)
        plant = load_plant(plant_file, seed) if emulated else None
        search = begin_hunt(out, load_bench_file(bench), model, settings, plant=plant)
    console.say(f"{search.folder.campaign.title}, in {out}")
    _say_next(console, search)

    def said(result: RunResult) -> None:
        say_result(console, result)

    def further() -> Any:
        with console.status("diagnosing"):
            run = search.next_run()
        _say_state(console, search)
        if run is not None:
            _say_next(console, search)
        return run

    operator = None if as_json else console_operator(console)
    ending = CampaignRunner(
        search.folder,
        operator,
        yes,
        partial(RunDisplay, console),
        said,
        signature(by, signed_in_as),
        further=further,
    ).run()
    if report is not None and search.diagnosis is not None:
        _write_page(report, search)
    sys.exit(_say_end(console, search, ending.outcome, ending.reason))


def _say_next(console: Terminal, search: Hunt) -> None:
    from bench.record.events.campaign import NextRun

    chosen = [step for step in search.steps if isinstance(step, NextRun)]
    if not chosen:
        return
    run = chosen[-1]
    console.say_json("next_run", **run.fields())
    why = "to confirm" if run.to_confirm else f"{run.expected_nats:.2f} nats expected"
    console.say(
        f"next: {run.procedure} ({run.parameters}), {run.hours:.1f} h, {why}, of {run.considered} considered"
    )


def _say_state(console: Terminal, search: Hunt) -> None:
    from bench.record.events.campaign import Sought

    state = [step for step in search.steps if isinstance(step, Sought)][-1]
    console.say_json("sought", **state.fields())
    gained = "" if state.gained_nats is None else f", {state.gained_nats:.2f} nats gained"
    console.say(f"so far: {_answer(state)}{gained}, {state.used_h:.1f} h used")
    others = sorted(state.probabilities.items(), key=lambda row: -row[1])[1:4]
    if alternatives := ", ".join(f"{name} {100 * value:.0f} %" for name, value in others if value >= 0.01):
        console.say(f"  or {alternatives}", style="dim")


def _answer(state: Sought) -> str:
    return f"{state.verdict}, {state.acts} {100 * state.probability:.1f} %"


def _say_end(console: Terminal, search: Hunt, outcome: str, reason: str) -> int:
    """Say how a search ended; return the exit code."""
    from bench.campaign.hunt import fewest, steps_of

    end, steps = search.end, steps_of(search)
    rows = [
        (
            step.chosen.run,
            f"{step.chosen.hours:.1f} h",
            f"{step.chosen.expected_nats:.2f}",
            "" if step.after is None or step.after.gained_nats is None else f"{step.after.gained_nats:.2f}",
            "" if step.after is None else f"{step.after.acts} {100 * step.after.probability:.0f} %",
        )
        for step in steps
    ]
    console.table(("run", "expected", "nats expected", "gained", "then"), rows)
    facts = {"outcome": outcome, "reason": reason, "ended": "" if end is None else end.ended}
    if end is None:
        console.say_json("result", **facts, folder=str(search.folder.path))
        console.say(f"{reason or outcome}; the same command goes on", style="red")
        return 3
    known = end.ended in ("decided", "alike")
    elsewhere = search.elsewhere() if end.ended in ("alike", "undecided") else []
    console.say_json(
        "result",
        **facts,
        acts=end.acts,
        probability=end.probability,
        confirmed=end.confirmed,
        used_h=end.used_h,
        elsewhere=elsewhere,
        folder=str(search.folder.path),
    )
    console.say(
        f"{_ENDS[end.ended]}: {_answer(end)}, {end.used_h:.1f} h of bench time",
        style="green" if known else "yellow",
    )
    if end.ended == "alike":
        left = fewest(end.probabilities, search.settings.until)
        console.say("one of " + ", ".join(f"{name} {100.0 * end.probabilities[name]:.0f} %" for name in left))
    if end.ended == "decided" and not end.confirmed:
        console.say("not confirmed: no run that fits into the bench time left would show it again")
    if end.ended == "undecided" and end.confirmed is False:
        console.say("not confirmed: what was fitted did not foretell the runs made to see it again")
    console.say_all(f"this would tell more: {text}" for text in elsewhere)
    return 0 if known else 4


def _write_page(report: Path, search: Hunt) -> None:
    from bench.analysis import gap
    from bench.present.report import gap_page, write_report

    diagnosis = search.diagnosis
    assert diagnosis is not None
    states = [state.folder for state in search.folder.states() if state.outcome == "completed"]
    folders = [folder for folder in states if folder is not None]
    given = gap.read_recordings(folders, gyro=search.gyro.name)
    shown = gap.differences(given.shown, diagnosis.model, gap.closed_model(diagnosis))
    page = gap_page(
        diagnosis, shown, gap.suggest(diagnosis), created_utc=utc_now(), model_file=search.model.name
    )
    write_report(report, page)
