"""A run on the terminal, while it goes on and when it has ended: for every command that makes runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from bench.control.disk import check_disk, estimated_bytes
from bench.control.live import Live
from bench.control.procedure import Parameters, Procedure
from bench.control.questions import AssumeYes
from bench.control.questions import Console as ConsoleOperator
from bench.control.runner import RunRequest, RunResult, run_procedure
from bench.lab.emulated import Plant
from bench.lab.rehearsal import rehearse_procedure
from bench.present.cli._display import RunDisplay
from bench.present.cli._texts import duration, say_json
from bench.present.sentences import safe_sentence
from bench.record.benchfile import BenchFile
from bench.record.recording import read_manifest

EXIT_CODES = {"completed": 0, "invalid": 4, "aborted": 3}


def perform(
    procedure: Procedure,
    parameters: Parameters,
    file: BenchFile,
    runs: Path,
    yes: bool,
    console: Console,
    as_json: bool,
) -> RunResult:
    """Run a procedure on the devices of a bench, shown on `console`; `yes` answers all questions."""
    expected_s = procedure.expected_duration_s(parameters)
    check_disk(estimated_bytes(expected_s, file), runs, "the run", "--runs")
    name = procedure.name
    with Live() as live, RunDisplay(console, name, expected_s, as_json=as_json) as display:
        human = live if as_json else live.beside(console_operator(console))
        operator = AssumeYes() if yes else human
        return run_procedure(RunRequest(procedure, parameters, file, runs, operator, display, live=live))


def perform_emulated(
    procedure: Procedure,
    parameters: Parameters,
    file: BenchFile,
    plant: Plant,
    runs: Path,
    console: Console,
    as_json: bool,
) -> RunResult:
    """Run a procedure on an emulated lab that matches a bench, in virtual time, shown on `console`."""
    expected_s = procedure.expected_duration_s(parameters)
    check_disk(estimated_bytes(expected_s, file), runs, "the rehearsal", "--runs")
    title = f"rehearsal of {procedure.name}"
    with RunDisplay(console, title, expected_s, as_json=as_json) as display:
        return rehearse_procedure(procedure, parameters, file, plant, runs, display)


def console_operator(console: Console) -> ConsoleOperator:
    """Return the operator at the terminal."""
    return ConsoleOperator(
        lambda text: console.input(Text.assemble((text, "bold"), " [yes/no] ")),
        lambda text: console.print(f"{text} [yes/no] ", style="bold", highlight=False),
    )


def say_result(
    console: Console, result: RunResult, *, as_json: bool = False, kind: str = "run", **fields: Any
) -> None:
    """Print how a run ended; `kind` "result": it is all that the command does, "run": one of several."""
    if as_json:
        said: dict[str, Any] = {
            "outcome": result.outcome,
            "reason": result.reason,
            "folder": str(result.folder),
        }
        safe = [state.fields() for state in result.safe]
        said |= {"duration_s": result.duration_s, "warnings": result.warnings, "safe": safe}
        measured = read_manifest(result.folder).measurements
        say_json(console, kind, **said, measurements=list(measured), **fields)
        return
    style = {"completed": "green", "invalid": "yellow", "aborted": "red"}[result.outcome]
    console.print(Text.assemble((result.outcome, style), f"  {result.folder}"))
    if result.reason:
        console.print(result.reason, style=style, highlight=False)
    if result.outcome == "aborted":
        for line in _aftermath(result, alone=kind == "result"):
            console.print(line, highlight=False)
    for warning in result.warnings:
        console.print(f"warning: {warning}", style="yellow", highlight=False)


def _aftermath(result: RunResult, *, alone: bool) -> list[str]:
    """Say what the bench has done after a run that ended early, what is kept, and (`alone`) what is next."""
    confirmed = [safe_sentence(state) for state in result.safe if state.confirmed]
    bench = "; ".join(confirmed) or "nothing was told to move or to heat"
    if len(confirmed) < len(result.safe):
        bench = "; ".join([*confirmed, "the rest NOT CONFIRMED: go and look, stop it by hand"])
    said = [
        f"bench: {bench}",
        f"kept: all that came in {duration(result.duration_s)}; `gyrobench report {result.folder}` shows it",
    ]
    if alone:  # a campaign says itself how it goes on
        said.append("next: clear the cause, then give the same command again: it begins a new run folder")
    return said
