"""`gyrobench run`, `rehearse` and `lab`."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from bench.control.disk import check_disk, estimated_bytes
from bench.control.live import Live
from bench.control.procedure import Parameters, Procedure, find_procedure
from bench.control.questions import AssumeYes, StageHand
from bench.control.questions import Console as ConsoleOperator
from bench.control.runner import RunRequest, RunResult, run_procedure
from bench.lab.emulated import EmulatedLab, Plant, load_plant, save_truth
from bench.present.cli._console import Terminal
from bench.present.cli._display import RunDisplay
from bench.present.cli._settings import settings_of
from bench.present.cli._texts import duration, say_json, size
from bench.record.benchfile import BenchFile, bench_file_text, load_bench_file
from bench.record.recording import Run, read_manifest
from drivers.base.clock import host_seconds

EXIT_CODES = {"completed": 0, "invalid": 4, "aborted": 3}


def run_command(
    name: str, bench: Path, runs: Path, pairs: list[str], options: list[str], yes: bool, as_json: bool
) -> int:
    """Run on the bench file's own devices; `options`: those of the command line that the procedure declares."""
    console = console_for(as_json)
    procedure = find_procedure(name)
    parameters = procedure.parse(settings_of(procedure, pairs, options))
    result = perform(procedure, parameters, load_bench_file(bench), runs, yes, console, as_json)
    say_result(console, result, as_json=as_json, kind="result")
    return EXIT_CODES[result.outcome]


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


def rehearse_command(
    name: str,
    bench: Path,
    runs: Path,
    pairs: list[str],
    options: list[str],
    plant_file: Path | None,
    seed: int | None,
    as_json: bool,
) -> int:
    """Run on an emulated lab in virtual time, then print time plan and log size."""
    console = console_for(as_json)
    procedure = find_procedure(name)
    parameters = procedure.parse(settings_of(procedure, pairs, options))
    plant = plant_with_seed(plant_file, seed)
    started = host_seconds()
    result = rehearse(procedure, parameters, load_bench_file(bench), plant, runs, console, as_json)
    log_bytes = sum(path.stat().st_size for path in result.folder.rglob("*") if path.is_file())
    wall = host_seconds() - started
    page = None
    if result.outcome != "aborted":
        from bench.present.report import render_run, run_content, write_report

        page = write_report(result.folder / "report.html", render_run(run_content(Run.open(result.folder))))
    if as_json:
        say_result(console, result, as_json=True, kind="result", bytes=log_bytes, wall_s=wall)
        return EXIT_CODES[result.outcome]
    say_result(console, result, kind="result")
    console.print(_time_plan(result.folder))
    console.print(
        f"{duration(result.duration_s)} of bench time in {wall:.1f} s ({result.duration_s / wall:,.0f} x); "
        f"the run folder takes {size(log_bytes)}"
    )
    if page is not None:
        console.print(f"plots: {page}")
    return EXIT_CODES[result.outcome]


def rehearse(
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
    with (
        EmulatedLab(file, plant) as lab,
        Live() as live,
        RunDisplay(console, f"rehearsal of {procedure.name}", expected_s, as_json=as_json) as display,
    ):
        request = RunRequest(
            procedure,
            parameters,
            lab.file,
            runs,
            StageHand(lab.perform),
            display,
            emulated=plant.told(file),
            before_close=lambda folder: save_truth(lab, folder),
            live=live,
        )
        return run_procedure(request)


def lab_command(
    bench: Path, plant_file: Path | None, seed: int | None, virtual: bool, write: Path | None
) -> None:
    """Serve a lab until Ctrl-C."""
    console = Terminal()
    plant = plant_with_seed(plant_file, seed)
    with EmulatedLab(load_bench_file(bench), plant, clock="virtual" if virtual else "wall") as lab:
        table = Table("device", "port")
        for name, port in lab.ports.items():
            table.add_row(name, port)
        console.print(table)
        if lab.clock_url:
            console.print(f"clock: {lab.clock_url}")
            console.print("Every run begins at bench time 0; the lab goes on where the run before left it.")
        if write is not None:
            write.write_text(bench_file_text(lab.file), encoding="utf-8")
            console.print(f"bench file for these ports: {write}", highlight=False)
        try:
            signal.signal(signal.SIGTERM, signal.default_int_handler)  # SIGINT is ignored in the background
            console.print("Ctrl-C ends the lab.")
            lab.wait()
        except KeyboardInterrupt:
            console.print("lab closed")


def plant_with_seed(path: Path | None, seed: int | None) -> Plant:
    """Return the plant file's settings with the seed of the command line, if one is given."""
    plant = load_plant(path)
    return plant if seed is None else plant.model_copy(update={"seed": seed})


def console_for(as_json: bool) -> Console:
    """Return where a command prints; JSON is never wrapped or coloured, so that it goes to the bare stream."""
    return Terminal(highlight=False, color_system=None) if as_json else Terminal()


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
        said |= {"duration_s": result.duration_s, "warnings": result.warnings, "safe": result.safe}
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
    bench = "; ".join(result.safe) or "nothing was told to move or to heat"
    if "NOT CONFIRMED SAFE" in result.reason:
        bench = "; ".join([*result.safe, "the rest NOT CONFIRMED: go and look, stop it by hand"])
    said = [
        f"bench: {bench}",
        f"kept: all that came in {duration(result.duration_s)}; `gyrobench report {result.folder}` shows it",
    ]
    if alone:  # a campaign says itself how it goes on
        said.append("next: clear the cause, then give the same command again: it begins a new run folder")
    return said


def _time_plan(folder: Path) -> Table:
    table = Table("start", "length", "phase", title="time plan")
    for phase in Run.open(folder).phases():
        table.add_row(duration(phase.start_s), duration(phase.end_s - phase.start_s), phase.name)
    return table
