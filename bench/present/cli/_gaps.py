"""The commands `gyrobench gap ...`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bench.present.cli._options import Cluster, Jobs

app = typer.Typer(
    name="gap", help="Where simulation and bench part, and which effect is missing.", no_args_is_help=True
)

Runs = Annotated[list[Path], typer.Argument(help="run folders, or mapping files of foreign recordings")]
Model = Annotated[Path, typer.Option("--model", help="nominal model (TOML)")]
GyroName = Annotated[str | None, typer.Option(help="gyro to diagnose; default the first of the runs")]


@app.command("diagnose")
def gap_diagnose(
    runs: Runs,
    model: Model,
    held_out: Annotated[
        list[Path] | None,
        typer.Option(
            "--held-out", help="run to judge the closing on: id of one given, folder or mapping file"
        ),
    ] = None,
    gyro: GyroName = None,
    json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
    report: Annotated[Path | None, typer.Option(help="HTML report to write, with the map and curves")] = None,
    run: Annotated[
        bool, typer.Option("--run", help="run the first suggestion on --bench, then diagnose with it")
    ] = False,
    bench: Annotated[Path | None, typer.Option(help="with --run: bench file (TOML)")] = None,
    emulated: Annotated[
        bool, typer.Option("--emulated", help="with --run: on an emulated lab that matches the bench")
    ] = False,
    plant: Annotated[
        Path | None, typer.Option(help="with --run --emulated: plant file (TOML) of the emulated lab")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="with --run --emulated: seed of the lab")] = None,
    runs_folder: Annotated[
        Path, typer.Option("--runs", help="with --run: folder that holds the runs")
    ] = Path("runs"),
    yes: Annotated[
        bool, typer.Option("--yes", "-y", help="with --run: answer the procedure's questions with yes")
    ] = False,
) -> None:
    """Say where the gap is, which effect explains it, and how far it closes on held-out runs."""
    from bench.present.cli._gap import NextRun, gap_diagnose_command

    following = None
    if run:
        if bench is None:
            raise typer.BadParameter("--run needs --bench, the bench to run on")
        following = NextRun(bench, runs_folder, plant, emulated, seed, yes)
    elif bench is not None or plant is not None or emulated:
        raise typer.BadParameter("--bench, --plant and --emulated go with --run")
    gap_diagnose_command(runs, model, held_out or [], gyro, json, report, following)


@app.command("close")
def gap_close(
    runs: Runs,
    model: Model,
    gyro: GyroName = None,
    out: Annotated[
        Path | None, typer.Option(help="file; default nominal+<effect>.toml beside the model")
    ] = None,
) -> None:
    """Write the nominal model with the missing effect fitted into it."""
    from bench.present.cli._gap import gap_close_command

    gap_close_command(runs, model, gyro, out)


@app.command("rehearse")
def gap_rehearse(
    run: Annotated[Path, typer.Argument(help="run folder, held out from the fit")],
    model: Model,
    closed: Annotated[Path, typer.Option(help="model with the effects in it, as `gap close` writes it")],
    runs: Annotated[Path, typer.Option(help="folder for the rehearsals")] = Path("runs"),
    gyro: GyroName = None,
    plant: Annotated[Path | None, typer.Option(help="plant file (TOML) of the emulated bench")] = None,
    seed: Annotated[int, typer.Option(help="seed of the emulated bench")] = 1,
    json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
    report: Annotated[Path | None, typer.Option(help="HTML report to write, with the curves")] = None,
) -> None:
    """Show the shrinkage in a log: the run's procedure on the emulated bench with both models."""
    from bench.present.cli._gap_rehearse import gap_rehearse_command

    gap_rehearse_command(run, model, closed, runs, gyro, plant, seed, json, report)


@app.command("exam")
def gap_exam(
    seed: Annotated[
        int | None, typer.Option(help="fresh seed; every case of a seed once looked at is spent")
    ] = None,
    cases: Annotated[int, typer.Option(help="number of cases, a quarter of them without any effect")] = 600,
    out: Annotated[
        Path | None, typer.Option(help="new folder for cases, seals, results; default: nothing is kept")
    ] = None,
    jobs: Jobs = None,
    cluster: Cluster = None,
    held: Annotated[
        Path | None,
        typer.Option("--from", help="folder of an exam held, finished or not: print its table, hold none"),
    ] = None,
    table: Annotated[Path | None, typer.Option(help="with --from: file for the table (Markdown)")] = None,
    note: Annotated[str, typer.Option(help="with --from: words for its first line, e.g. the commit")] = "",
) -> None:
    """Examine the diagnosis on plants whose physics is not the catalogue's, answers sealed beforehand."""
    from bench.present.cli._gap_exam import gap_exam_command, gap_exam_table_command

    if held is not None:
        gap_exam_table_command(held, table, note)
        return
    if seed is None:
        raise typer.BadParameter("an exam needs --seed, or --from with the folder of one that was held")
    gap_exam_command(cases, seed, out, jobs, cluster)
