"""A run on the terminal, while it goes on and when it has ended: for every command that makes runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Any

from rich.text import Text

from bench.control.disk import check_disk, estimated_bytes
from bench.control.live import Live
from bench.control.operators import Signature, checked_name, checked_role
from bench.control.procedure import Parameters, Procedure
from bench.control.questions import AssumeYes, user_name
from bench.control.questions import Console as ConsoleOperator
from bench.control.runner import RunRequest, RunResult, run_procedure
from bench.lab.emulated import Plant
from bench.lab.rehearsal import rehearse_procedure
from bench.present.cli._console import Terminal
from bench.present.cli._display import RunDisplay
from bench.present.cli._measured import say_measurements
from bench.present.cli._texts import duration
from bench.present.sentences import safe_sentence
from bench.record.benchfile import BenchFile
from bench.record.recording import read_manifest
from drivers.base.errors import RecordError

EXIT_CODES = {"completed": 0, "invalid": 4, "aborted": 3}


def perform(
    console: Terminal,
    procedure: Procedure,
    parameters: Parameters,
    file: BenchFile,
    runs: Path,
    *,
    plant: Plant | None = None,
    yes: bool = False,
    started_by: Signature | None = None,
) -> RunResult:
    """Run a procedure, shown on `console`; with `plant` in virtual time, on a lab emulated after the bench.

    `yes` answers the questions of a run on real devices.
    """
    expected_s = procedure.expected_duration_s(parameters)
    bytes_ = estimated_bytes(expected_s, file)
    check_disk(bytes_, runs, "the run" if plant is None else "the rehearsal", "--runs")
    title = procedure.name if plant is None else f"rehearsal of {procedure.name}"
    with RunDisplay(console, title, expected_s) as display:
        if plant is not None:
            return rehearse_procedure(procedure, parameters, file, plant, runs, display)
        with Live() as live:
            human = live if console.as_json else live.beside(console_operator(console))
            operator = AssumeYes() if yes else human
            request = RunRequest(procedure, parameters, file, runs, operator, display, live=live)
            return run_procedure(replace(request, started_by=started_by))


def signature(by: str, signed_in_as: str) -> Signature:
    """Return who starts something on the terminal, by the options `--by` and `--signed-in-as`."""
    role = checked_role(signed_in_as) if signed_in_as else None
    return Signature(checked_name(by) if by else user_name(), role)


def console_operator(console: Terminal) -> ConsoleOperator:
    """Return the operator at the terminal."""
    return ConsoleOperator(
        lambda text: console.input(Text.assemble((text, "bold"), " [yes/no] ")),
        lambda text: console.say(f"{text} [yes/no] ", style="bold"),
    )


def say_result(console: Terminal, result: RunResult, *, kind: str = "run", **fields: Any) -> None:
    """Print how a run ended; `kind` "result": it is all that the command does, "run": one of several."""
    if console.as_json:
        console.say_json(
            kind,
            outcome=result.outcome,
            reason=result.reason,
            folder=str(result.folder),
            duration_s=result.duration_s,
            warnings=result.warnings,
            safe=[state.fields() for state in result.safe],
            measurements=list(read_manifest(result.folder).measurements),
            **fields,
        )
        return
    style = {"completed": "green", "invalid": "yellow", "aborted": "red"}[result.outcome]
    console.parts((result.outcome, style), f"  {result.folder}")
    if result.reason:
        console.say(result.reason, style=style)
    if kind == "result":
        say_measurements(console, _measurements(result.folder))
    if result.outcome == "aborted":
        _say_aftermath(console, result, alone=kind == "result")
    console.say_all((f"warning: {warning}" for warning in result.warnings), style="yellow")


def _measurements(folder: Path) -> Sequence[Mapping[str, Any]]:
    """Return what a run measured; nothing of one that ended before it had a record."""
    try:
        return read_manifest(folder).measurements
    except RecordError:
        return ()


def _say_aftermath(console: Terminal, result: RunResult, *, alone: bool) -> None:
    """Say what the bench has done after a run that ended early, what is kept, and (`alone`) what is next."""
    confirmed = [safe_sentence(state) for state in result.safe if state.confirmed]
    bench = "; ".join(confirmed) or "nothing was told to move or to heat"
    if len(confirmed) < len(result.safe):
        bench = "; ".join([*confirmed, "the rest NOT CONFIRMED: go and look, stop it by hand"])
    console.say(f"bench: {bench}")
    length = duration(result.duration_s)
    console.say(
        f"kept: all that came in {length}; `gyrobench report {quote(str(result.folder))}` shows it",
        soft_wrap=True,
    )
    if alone:  # a campaign says itself how it goes on
        console.say("next: clear the cause, then give the same command again: it begins a new run folder")
