"""`gyrobench run`, `rehearse` and `lab`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import BadParameter, Context, Option, Typer

from bench.present.cli import _options as options
from bench.present.cli._texts import duration, size
from drivers.base.errors import ConfigurationError

if TYPE_CHECKING:
    from bench.control.procedure import Parameters, Procedure

app = Typer()

Set = Annotated[list[str] | None, Option("--set", "-s", help="parameter, as name=value; repeat for several")]
PARAMETERS_TOO = {"allow_extra_args": True, "ignore_unknown_options": True}
"""What the command line does not know may be a parameter of the procedure."""


@app.command(context_settings=PARAMETERS_TOO)
def run(
    context: Context,
    procedure: options.ProcedureName,
    bench: options.Bench = options.DEFAULT_BENCH,
    runs: options.RunsFolder = options.DEFAULT_RUNS,
    set_: Set = None,
    yes: options.Yes = False,
    by: options.By = "",
    signed_in_as: options.SignedIn = "",
    json: options.JsonLines = False,
) -> None:
    """Run a procedure on the bench of a bench file.

    The procedure's parameters are options too: --dwell-s 60 is --set dwell_s=60.
    """
    from bench.present.cli._console import Terminal
    from bench.present.cli._shown_run import EXIT_CODES, perform, say_result, signature
    from bench.record.benchfile import load_bench_file

    console, starter = Terminal(as_json=json), signature(by, signed_in_as)
    test, parameters = chosen(procedure, set_, context.args)
    file = load_bench_file(bench)
    result = perform(console, test, parameters, file, runs, yes=yes, started_by=starter)
    say_result(console, result, kind="result")
    sys.exit(EXIT_CODES[result.outcome])


@app.command(context_settings=PARAMETERS_TOO)
def rehearse(
    context: Context,
    procedure: options.ProcedureName,
    bench: options.Bench = options.DEFAULT_BENCH,
    runs: options.RunsFolder = options.DEFAULT_RUNS,
    set_: Set = None,
    plant: options.PlantFile = None,
    seed: options.Seed = None,
    json: options.JsonLines = False,
) -> None:
    """Run a procedure on an emulated lab, in virtual time.

    The lab matches the bench file. What was measured, the time plan and the size of the record are printed, and a
    report with plots is written.

    The procedure's parameters are options too: --dwell-s 60 is --set dwell_s=60.
    """
    from bench.lab.emulated import load_plant
    from bench.present.cli._console import Terminal
    from bench.present.cli._shown_run import EXIT_CODES, perform, say_result
    from bench.record.benchfile import load_bench_file
    from bench.record.recording import Run
    from drivers.base.clock import host_seconds

    console = Terminal(as_json=json)
    test, parameters = chosen(procedure, set_, context.args)
    emulated = load_plant(plant, seed)
    started = host_seconds()
    result = perform(console, test, parameters, load_bench_file(bench), runs, plant=emulated)
    log_bytes = sum(path.stat().st_size for path in result.folder.rglob("*") if path.is_file())
    wall_s = host_seconds() - started
    record = Run.open(result.folder)
    say_result(console, result, kind="result", bytes=log_bytes, wall_s=wall_s)
    plan = [
        (duration(phase.start_s), duration(phase.end_s - phase.start_s), phase.name)
        for phase in record.phases()
    ]
    console.table(("start", "length", "phase"), plan, "time plan")
    console.print(
        f"{duration(result.duration_s)} of bench time in {wall_s:.1f} s "
        f"({result.duration_s / wall_s:,.0f} x); the run folder takes {size(log_bytes)}"
    )
    if result.outcome != "aborted":
        from bench.present.report import run_content, run_page, write_report

        page = write_report(result.folder / "report.html", run_page(run_content(record, with_budgets=True)))
        console.print(f"plots: {page}")
    sys.exit(EXIT_CODES[result.outcome])


@app.command()
def lab(
    bench: options.Bench = options.DEFAULT_BENCH,
    plant: options.PlantFile = None,
    seed: options.Seed = None,
    virtual: Annotated[
        bool, Option("--virtual", help="serve a virtual clock instead of following the wall clock")
    ] = False,
    write: Annotated[Path | None, Option(help="write a bench file that reaches this lab's ports")] = None,
    fmu: Annotated[
        Path | None,
        Option("--fmu", help="write a gyro as an FMU for co-simulation instead, and end (extra: fmu)"),
    ] = None,
    gyro: Annotated[str | None, Option("--gyro", help="with --fmu: which gyro; default the first")] = None,
    as_json: options.Json = False,
) -> None:
    """Serve an emulated lab to other software, until Ctrl-C.

    It matches the bench file.
    """
    import signal

    from bench.lab.emulated import EmulatedLab, load_plant
    from bench.present.cli._console import Terminal
    from bench.record.benchfile import bench_file_text, load_bench_file

    if fmu is None and gyro is not None:
        raise BadParameter("--gyro goes with --fmu")
    if fmu is not None and (virtual or write is not None):
        raise BadParameter("--virtual and --write are for a lab that is served, and --fmu serves none")
    console = Terminal(as_json=as_json)
    emulated = load_plant(plant, seed)
    if fmu is not None:
        from bench.lab.unit_fmu import write_unit_fmu

        write_unit_fmu(fmu, load_bench_file(bench), emulated, gyro)
        console.say_json("result", file=fmu)
        console.say(str(fmu))
        return
    if write is not None and not write.parent.is_dir():
        raise ConfigurationError(
            "the bench file cannot be written", where=str(write), found="no such folder", expected="a folder"
        )
    clock: Literal["virtual", "wall"] = "virtual" if virtual else "wall"
    with EmulatedLab(load_bench_file(bench), emulated, clock=clock, apart=True) as served:
        console.table(("device", "port"), served.ports.items())
        if served.clock_url:
            console.print(f"clock: {served.clock_url}")
            console.print("Every run begins at bench time 0; the lab goes on where the run before left it.")
        if write is not None:
            write.write_text(bench_file_text(served.file), encoding="utf-8")
            console.say(f"bench file for these ports: {write}")
        console.say_json("lab", ports=served.ports, clock=served.clock_url, bench_file=write)
        try:
            signal.signal(signal.SIGTERM, signal.default_int_handler)  # SIGINT is ignored in the background
            console.print("Ctrl-C ends the lab.")
            served.wait()
        except KeyboardInterrupt:
            console.print("lab closed")


def chosen(name: str, pairs: list[str] | None, options: list[str]) -> tuple[Procedure, Parameters]:
    """Return a procedure and its parameters, of `--set` and of the options that it declares."""
    from bench.control.procedure import read_procedure
    from bench.present.cli._settings import settings_of

    procedure = read_procedure(name)
    return procedure, procedure.parse(settings_of(procedure, pairs or [], options))
