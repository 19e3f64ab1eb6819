"""`gyrobench gap rehearse`."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.present.cli._options import DiagnosedGyro, Json, NominalModel
from drivers.base.errors import BenchError, ConfigurationError

if TYPE_CHECKING:
    from rich.table import Table

    from bench.analysis.gap import LogGap
    from bench.lab.emulated import Plant
    from bench.present.cli._console import Terminal
    from bench.record.recording import Run


def rehearse(
    run: Annotated[Path, typer.Argument(help="run folder, held out from the fit")],
    model: NominalModel,
    closed: Annotated[Path, typer.Option(help="model with the effects in it, as `gap close` writes it")],
    runs: Annotated[Path, typer.Option(help="folder for the rehearsals")] = Path("runs"),
    gyro: DiagnosedGyro = None,
    plant: Annotated[Path | None, typer.Option(help="plant file (TOML) of the emulated bench")] = None,
    seed: Annotated[int, typer.Option(help="seed of the emulated bench")] = 1,
    as_json: Json = False,
    report: Annotated[Path | None, typer.Option(help="HTML report to write, with the curves")] = None,
) -> None:
    """Show the shrinkage in a log: the run's procedure on the emulated bench with both models."""
    from bench.analysis.gap import log_gap_facts, log_gaps, read_recordings
    from bench.lab.emulated import load_plant
    from bench.present.cli._console import console_for
    from bench.present.report import log_gaps_page, write_report
    from bench.record.recording import Run
    from drivers.base.clock import utc_now

    console = console_for(as_json)
    recorded = Run.open(run)
    _check_model(recorded.manifest.run_id, closed)
    real = read_recordings([run], gyro=gyro)
    if report is not None and real.of_platform:
        raise ConfigurationError(
            "there is no report of a platform's rehearsal", expected="the table, or --json"
        )
    lab, folders = load_plant(plant), []
    for file, its_seed in ((model, seed), (closed, seed), (closed, seed + 1)):
        models = {**lab.gap_model, real.unit_id: file.resolve()}
        followed = lab.model_copy(update={"seed": its_seed, "gap_model": models})
        folders.append(_rehearsed(recorded, followed, runs, console))
    gaps = log_gaps(real.runs, *(read_recordings([folder], gyro=gyro).runs for folder in folders))
    run_id = recorded.manifest.run_id
    if report is not None:
        names = (model.name, closed.name)
        write_report(report, log_gaps_page(run_id, real.unit_id, names, gaps, utc_now()))
    if as_json:
        facts = {"run": run_id, "rehearsals": [str(folder) for folder in folders]}
        console.print_json(json.dumps(facts | log_gap_facts(gaps)))
        return
    if gaps.headings:
        console.print(heading_table(gaps.headings))
    if gaps.rate:
        console.print(_table("phase", "rms deg/h of 100 s means", gaps.rate, ".4f"))
    if gaps.channels:
        console.print(_table("channel", "rms of 100 s means", gaps.channels, ".3g", unit=True))
    if report is not None:
        console.say(f"report: {report}", soft_wrap=True)


def _check_model(run_id: str, closed: Path) -> None:
    from bench.analysis.gap import read_model

    if run_id in {run.split(" ")[0] for run in read_model(closed).fitted_on}:
        raise ConfigurationError(
            "a run that the model was fitted on cannot judge it",
            where=str(closed),
            found=run_id,
            expected="a held-out run",
        )


def _rehearsed(recorded: Run, plant: Plant, runs: Path, console: Terminal) -> Path:
    """Run a recorded run's procedure with its parameters on its bench, emulated; return the new run's folder."""
    from bench.control.procedure import find_procedure
    from bench.present.cli._shown_run import perform
    from bench.record.benchfile import bench_file_from

    manifest = recorded.manifest
    if not manifest.bench:
        raise ConfigurationError(
            "the run does not say on which bench it was made",
            where=str(recorded.place),
            expected="a run folder of this project; an imported recording has no procedure to repeat",
        )
    procedure = find_procedure(manifest.procedure)
    parameters = procedure.parse(dict(manifest.parameters))
    result = perform(console, procedure, parameters, bench_file_from(manifest.bench), runs, plant=plant)
    if result.outcome == "aborted":
        raise BenchError(f"a rehearsal was aborted: {result.reason}")
    return result.folder


def _table(first: str, what: str, gaps: Sequence[LogGap], digits: str, *, unit: bool = False) -> Table:
    """Return a table of the gaps, a row each; with `unit` every row says its own."""
    from rich.table import Table

    table = Table(first, "nominal", "closed", "floor", "gone %", title=f"run less rehearsal, {what}")
    for gap in gaps:
        sizes = [format(rms, digits) for rms in (gap.rms_nominal, gap.rms_closed, gap.rms_floor)]
        sizes[0] += f" {gap.unit}" if unit else ""
        share = "" if math.isnan(gap.share) else f"{100.0 * gap.share:.1f}"
        table.add_row(gap.part.replace("_", " "), *sizes, share)
    return table


def heading_table(gaps: Sequence[LogGap]) -> Table:
    """Return a table of a platform's gaps by heading."""
    return _table("heading", "rms arcsec", gaps, ".1f")
