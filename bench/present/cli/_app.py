"""The commands of `gyrobench`."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from bench.present.cli._campaigns import campaign_app
from bench.present.cli._can import can_app
from bench.present.cli._fits import fit_app, scheme_app
from bench.present.cli._frames import frames_app
from bench.present.cli._gaps import gap_app
from bench.present.cli._options import TextCommand, TextGroup
from drivers.base.errors import BenchError, RunAborted, RunUnsealed

app = typer.Typer(
    cls=TextGroup,
    name="gyrobench",
    help="Run gyro test procedures on a bench of turntable, thermal chamber and gyros - real or emulated.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
runs_app = typer.Typer(cls=TextGroup, help="Look at recorded runs.", no_args_is_help=True)
app.add_typer(runs_app, name="runs")
app.add_typer(campaign_app, name="campaign")
app.add_typer(fit_app, name="fit")
app.add_typer(scheme_app, name="scheme")
app.add_typer(gap_app, name="gap")
app.add_typer(frames_app, name="frames")
app.add_typer(can_app, name="can")

Bench = Annotated[Path, typer.Option("--bench", help="bench file (TOML)", show_default=True)]
RunsFolder = Annotated[Path, typer.Option("--runs", help="folder that holds the runs")]
Set = Annotated[
    list[str] | None, typer.Option("--set", "-s", help="parameter, as name=value; repeat for several")
]
PlantFile = Annotated[
    Path | None, typer.Option("--plant", help="plant file (TOML): physics behind the emulated devices")
]
CatalogueUrl = Annotated[
    str | None,
    typer.Option(
        "--catalogue",
        envvar="GYROBENCH_CATALOGUE",
        help="URL of a shared catalogue: postgresql://... or sqlite:///FILE; default a file beside the runs",
    ),
]
Seed = Annotated[int | None, typer.Option("--seed", help="seed of the emulated lab")]
Json = Annotated[
    bool, typer.Option("--json", help="for machines: one JSON object a line, the last one the result")
]

DEFAULT_BENCH = Path("lab.toml")
DEFAULT_RUNS = Path("runs")
PARAMETERS_TOO = {"allow_extra_args": True, "ignore_unknown_options": True}
"""What the command line does not know may be a parameter of the procedure."""


def main() -> None:
    """Run the command line; an error of ours is one paragraph and exit code 2, an aborted run exit code 3."""
    # Workers too (joblib starts them by `python -m`) take no module from the folder they are started in.
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        app()
    except BenchError as error:
        _complain(str(error))
        sys.exit(3 if isinstance(error, RunAborted | RunUnsealed) else 2)
    except KeyboardInterrupt:
        _complain("stopped by Ctrl-C")
        sys.exit(130)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)


def _complain(text: str) -> None:
    from bench.present.cli._console import Terminal

    Terminal(stderr=True).print(f"error: {text}", style="bold red", highlight=False)


@app.command()
def procedures(name: Annotated[str | None, typer.Argument(help="show this one in full")] = None) -> None:
    """List the procedures with parameters, units, defaults and expected duration."""
    from bench.present.cli._procedures import show_procedures

    show_procedures(name)


@app.command(context_settings=PARAMETERS_TOO)
def run(
    context: typer.Context,
    procedure: str,
    bench: Bench = DEFAULT_BENCH,
    runs: RunsFolder = DEFAULT_RUNS,
    set_: Set = None,
    yes: Annotated[bool, typer.Option("--yes", help="answer operator questions beforehand")] = False,
    json: Json = False,
) -> None:
    """Run a procedure on the bench that the bench file describes.

    The procedure's parameters are options too: --dwell-s 60 is --set dwell_s=60.
    """
    from bench.present.cli._run import run_command

    sys.exit(run_command(procedure, bench, runs, set_ or [], context.args, yes, json))


@app.command(context_settings=PARAMETERS_TOO)
def rehearse(
    context: typer.Context,
    procedure: str,
    bench: Bench = DEFAULT_BENCH,
    runs: RunsFolder = DEFAULT_RUNS,
    set_: Set = None,
    plant: PlantFile = None,
    seed: Seed = None,
    json: Json = False,
) -> None:
    """Run a procedure on an emulated lab that matches the bench file: time plan, log size and plots.

    The procedure's parameters are options too: --dwell-s 60 is --set dwell_s=60.
    """
    from bench.present.cli._run import rehearse_command

    sys.exit(rehearse_command(procedure, bench, runs, set_ or [], context.args, plant, seed, json))


@app.command()
def steer(
    session: Annotated[Path, typer.Argument(help="campaign folder, or run folder of a single run")],
    action: Annotated[str, typer.Argument(help="pause, resume, abort or answer")],
    answer: Annotated[str, typer.Argument(help="the answer to the question that is open")] = "",
    by: Annotated[str, typer.Option("--by", help="your name; default the user's")] = "",
) -> None:
    """Answer, pause, resume or abort a session that another process runs."""
    from bench.present.cli._steer import steer_command

    sys.exit(steer_command(session, action, answer, by))


@app.command()
def lab(
    bench: Bench = DEFAULT_BENCH,
    plant: PlantFile = None,
    seed: Seed = None,
    virtual: Annotated[
        bool, typer.Option("--virtual", help="serve a virtual clock instead of following the wall clock")
    ] = False,
    write: Annotated[
        Path | None, typer.Option("--write", help="write a bench file that reaches this lab's ports")
    ] = None,
) -> None:
    """Serve an emulated lab that matches the bench file, for any software, until Ctrl-C."""
    from bench.present.cli._run import lab_command

    lab_command(bench, plant, seed, virtual, write)


@app.command()
def report(
    run: Annotated[list[Path], typer.Argument(help="a run folder; several, or --limits: a test certificate")],
    out: Annotated[
        Path | None, typer.Option(help="HTML file; default report.html or certificate.html beside the runs")
    ] = None,
    limits: Annotated[
        Path | None, typer.Option("--limits", help="limits to judge by: a TOML file with a limits table")
    ] = None,
    pdf: Annotated[bool, typer.Option("--pdf", help="print a PDF too (needs Chromium or Chrome)")] = False,
) -> None:
    """Write the HTML report of a run, or the test certificate of several; a fit writes its own.

    Exit code 4 if the certificate says "not passed".
    """
    from bench.present.cli._report import report_command

    sys.exit(report_command(run, out, limits, pdf))


@app.command()
def panel(
    runs: Annotated[Path, typer.Argument(help="folder of runs and campaigns to watch")] = DEFAULT_RUNS,
    host: Annotated[
        str, typer.Option(help="address to listen on; another than this machine needs a token")
    ] = ("127.0.0.1"),
    port: Annotated[int, typer.Option(help="port to listen on", min=1, max=65535)] = 8765,
    token: Annotated[
        str | None,
        typer.Option(envvar="GYROBENCH_PANEL_TOKEN", help="what a browser must show", show_envvar=True),
    ] = None,
) -> None:
    """Show in a browser what the bench is doing; a process of its own that cannot disturb a run."""
    from bench.present.cli._panel import panel_command

    panel_command(runs, host, port, token)


@app.command()
def ports(
    identify: Annotated[
        bool, typer.Option("--identify", help="say which known device answers, by queries that only read")
    ] = False,
    port: Annotated[
        list[str] | None,
        typer.Option(
            "--port", help="with --identify: this port, also socket://host:port; repeat for several"
        ),
    ] = None,
) -> None:
    """List serial ports and CAN channels of this machine."""
    from bench.present.cli._ports import identify_command, ports_command

    if identify or port:
        identify_command(port or [])
    else:
        ports_command()


@runs_app.command("list", cls=TextCommand)
def runs_list(
    runs: Annotated[str, typer.Option("--runs", help="folder that holds the runs")] = str(DEFAULT_RUNS),
    unit: Annotated[str | None, typer.Option(help="of this unit under test")] = None,
    procedure: Annotated[str | None, typer.Option(help="of this procedure")] = None,
    outcome: Annotated[
        str | None, typer.Option(help="completed, invalid, aborted, running, unreadable")
    ] = None,
    since: Annotated[str | None, typer.Option(help="from this year, month, day or time on, UTC")] = None,
    until: Annotated[
        str | None, typer.Option(help="to the end of this year, month, day or time, UTC")
    ] = None,
    limit: Annotated[str, typer.Option(metavar="COUNT", help="show at most so many, newest first")] = "100",
    catalogue: CatalogueUrl = None,
    json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
) -> None:
    """List the runs in a folder, or those of every bench with a shared catalogue."""
    from bench.present.cli._runs_list import list_command

    wanted = {"unit": unit, "procedure": procedure, "outcome": outcome, "since": since, "until": until}
    list_command(Path(runs), catalogue, wanted, limit, json)


@runs_app.command("index")
def runs_index(
    runs: RunsFolder = DEFAULT_RUNS,
    catalogue: CatalogueUrl = None,
    rebuild: Annotated[bool, typer.Option("--rebuild", help="read every run folder again")] = False,
) -> None:
    """Bring the catalogue of runs up to date with the folders, which are the truth."""
    from bench.present.cli._runs_list import index_command

    index_command(runs, catalogue, rebuild)


@runs_app.command("export")
def runs_export(
    run: Path,
    format_: Annotated[str, typer.Option("--format", help="csv, parquet, mdf4 or blf (recorded CAN frames)")],
    out: Annotated[Path | None, typer.Option(help="file or folder; default named after the run")] = None,
) -> None:
    """Write a run for other software."""
    from bench.present.cli._exchange import export_command

    export_command(run, format_, out)


@app.command("import")
def import_(
    log: Annotated[list[Path], typer.Argument(help="logs of another bench: CSV, Parquet or MDF")],
    mapping: Annotated[Path, typer.Option("--mapping", help="mapping file (TOML): columns, units, phases")],
    out: Annotated[Path, typer.Option("--out", help="folder that holds the runs")] = DEFAULT_RUNS,
) -> None:
    """Make run folders from logs of another bench, for fitting, reports and the gap diagnosis."""
    from bench.present.cli._exchange import import_command

    import_command(log, mapping, out)


@runs_app.command("show")
def runs_show(run: Path) -> None:
    """Show what a run was, on what, and how it ended."""
    from bench.present.cli._runs import show_command

    show_command(run)


@runs_app.command("recover")
def runs_recover(
    run: Annotated[list[Path] | None, typer.Argument(help="run folders")] = None,
    all_: Annotated[
        bool, typer.Option("--all", help="every run in the runs folder that was not closed")
    ] = False,
    runs: RunsFolder = DEFAULT_RUNS,
) -> None:
    """Complete runs that a crash left open: decode, checksum, mark as aborted."""
    from bench.present.cli._runs import recover_command

    sys.exit(recover_command(run or [], runs if all_ else None))


@runs_app.command("verify")
def runs_verify(run: list[Path]) -> None:
    """Recompute the checksums of runs and rebuild their decoded tables from the raw bytes."""
    from bench.present.cli._runs import verify_command

    sys.exit(verify_command(run))
