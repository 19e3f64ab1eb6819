"""`gyrobench gap rehearse`, and `gap diagnose --run`: what the gap needs of a bench."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from bench.analysis.common.state_file import save_file
from bench.analysis.gap import LogGap, Suggestion, log_gap_facts, log_gaps, read_model, read_recordings
from bench.control.procedure import find_procedure
from bench.lab.emulated import Plant, load_plant
from bench.present.cli._console import console_for
from bench.present.cli._shown_run import perform, perform_emulated
from bench.present.report import render_log_gaps
from bench.record.benchfile import bench_file_from, load_bench_file
from bench.record.recording import Run
from drivers.base.clock import utc_now
from drivers.base.errors import BenchError, ConfigurationError


def gap_rehearse_command(
    run: Path,
    model: Path,
    closed: Path,
    runs: Path,
    gyro: str | None,
    plant_file: Path | None,
    seed: int,
    as_json: bool,
    report: Path | None,
) -> None:
    """Rehearse a run's procedure with both models, and print what its log differs by from theirs."""
    console = console_for(as_json)
    recorded = Run.open(run)
    _check_model(run, closed)
    real = read_recordings([run], gyro=gyro)
    if report is not None and real.of_platform:
        raise ConfigurationError(
            "there is no report of a platform's rehearsal", expected="the table, or --json"
        )
    models = ((model, seed), (closed, seed), (closed, seed + 1))
    folders = _rehearsals(recorded, load_plant(plant_file), real.unit_id, models, runs, console, as_json)
    gaps = log_gaps(*(each.runs for each in (real, *(read_recordings([f], gyro=gyro) for f in folders))))
    run_id = recorded.manifest.run_id
    if report is not None:
        report.parent.mkdir(parents=True, exist_ok=True)
        names = (model.name, closed.name)
        save_file(report, render_log_gaps(run_id, real.unit_id, names, gaps, utc_now()))
    if as_json:
        facts = {"run": run_id, "rehearsals": [str(each) for each in folders]}
        console.print_json(json.dumps(facts | log_gap_facts(gaps)))
        return
    if gaps.headings:
        console.print(heading_table(gaps.headings))
    if gaps.rate:
        console.print(_table("phase", "rms deg/h of 100 s means", gaps.rate, ".4f"))
    if gaps.channels:
        console.print(_table("channel", "rms of 100 s means", gaps.channels, ".3g", unit=True))
    if report is not None:
        console.print(f"report: {report}", highlight=False, soft_wrap=True)


def _rehearsals(
    recorded: Run,
    plant: Plant,
    unit: str,
    models: Sequence[tuple[Path, int]],
    runs: Path,
    console: Console,
    as_json: bool,
) -> list[Path]:
    """Rehearse a run with the unit following each model, with its seed; return the new folders."""
    folders = []
    for file, seed in models:
        own = plant.model_copy(update={"seed": seed, "gap_model": {**plant.gap_model, unit: file.resolve()}})
        folders.append(rehearsed(recorded, own, runs, console, as_json))
    return folders


def _check_model(run: Path, closed: Path) -> None:
    name = Run.open(run).manifest.run_id
    if name in {each.split(" ")[0] for each in read_model(closed).fitted_on}:
        raise ConfigurationError(
            "a run that the model was fitted on cannot judge it",
            where=str(closed),
            found=name,
            expected="a held-out run",
        )


def rehearsed(recorded: Run, plant: Plant, runs: Path, console: Console, as_json: bool) -> Path:
    """Run a recorded run's procedure with its parameters on its bench, emulated; return the new run's folder."""
    manifest = recorded.manifest
    if not manifest.bench:
        raise ConfigurationError(
            "the run does not say on which bench it was made",
            where=str(recorded.place),
            expected="a run folder of this project; an imported recording has no procedure to repeat",
        )
    procedure = find_procedure(manifest.procedure)
    parameters = procedure.parse(dict(manifest.parameters))
    result = perform_emulated(
        procedure, parameters, bench_file_from(manifest.bench), plant, runs, console, as_json
    )
    if result.outcome == "aborted":
        raise BenchError(f"a rehearsal was aborted: {result.reason}")
    return result.folder


def run_suggestion(
    suggestion: Suggestion,
    bench: Path,
    runs: Path,
    plant_file: Path | None,
    *,
    emulated: bool,
    seed: int | None,
    yes: bool,
    as_json: bool,
) -> Path:
    """Run what a diagnosis suggested on a bench, real or emulated; return the new run's folder."""
    console = console_for(as_json)
    procedure = find_procedure(suggestion.procedure)
    parameters = procedure.parse(dict(suggestion.settings))
    file = load_bench_file(bench)
    if emulated:
        plant = load_plant(plant_file, seed)
        result = perform_emulated(procedure, parameters, file, plant, runs, console, as_json)
    else:
        result = perform(procedure, parameters, file, runs, yes, console, as_json)
    if result.outcome == "aborted":
        raise BenchError(f"{suggestion.procedure} was aborted: {result.reason}")
    return result.folder


def _table(first: str, what: str, gaps: Sequence[LogGap], digits: str, *, unit: bool = False) -> Table:
    """Return a table of the gaps, a row each; with `unit` every row says its own."""
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
