"""`gyrobench gap diagnose`, and with `--run` the run that would decide most."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.present.cli._options import DiagnosedGyro, DiagnosedRuns, Json, NominalModel
from drivers.base.errors import BenchError

if TYPE_CHECKING:
    from bench.analysis.gap import Diagnosis, Recordings, Suggestion
    from bench.present.report import Page


@dataclass(frozen=True)
class NextRun:
    """Where and how the suggested procedure is to be run: on the bench, or on a lab emulated after it."""

    bench: Path
    runs: Path
    plant: Path | None
    emulated: bool
    seed: int | None
    yes: bool


def diagnose(
    runs: DiagnosedRuns,
    model: NominalModel,
    held_out: Annotated[
        list[Path] | None,
        typer.Option(help="run to judge the closing on: id of one given, folder or mapping file"),
    ] = None,
    gyro: DiagnosedGyro = None,
    as_json: Json = False,
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
    then = None
    if run:
        if bench is None:
            raise typer.BadParameter("--run needs --bench, the bench to run on")
        then = NextRun(bench, runs_folder, plant, emulated, seed, yes)
    elif bench is not None or plant is not None or emulated:
        raise typer.BadParameter("--bench, --plant and --emulated go with --run")
    _diagnose(runs, model, held_out or [], gyro, as_json, report, then)


def _diagnose(
    runs: Sequence[Path],
    model: Path,
    held_out: Sequence[Path],
    gyro: str | None,
    as_json: bool,
    report: Path | None,
    then: NextRun | None,
) -> None:
    """Diagnose and print; with `then`, run what would decide most and diagnose with that run among the others."""
    from bench.analysis import gap
    from bench.present.cli._console import Terminal
    from bench.present.cli.gap._text import print_position, print_rate
    from bench.present.report import write_report

    console = Terminal()
    nominal = gap.read_model(model)
    with console.status("diagnosing"):
        given = gap.read_recordings(runs, held_out, gyro)
        found = gap.diagnose(given.runs, nominal, given.held_out, given.missing)
        following = gap.suggest(found)
    if then is not None and following:
        if not as_json:
            causes = ", ".join(cause.name for cause in found.rate.causes) or "no cause named"
            console.say(
                f"so far: {found.verdict}, {causes}; now {following[0].procedure} ({following[0].parameters}, "
                f"{following[0].hours:.1f} h of bench time) to decide {following[0].decides}"
            )
        folder = run_suggestion(following[0], then, as_json=as_json)
        _diagnose([*runs, folder], model, held_out, gyro, as_json, report, None)
        return
    if report is not None:
        write_report(report, _page(found, given, following, model))
    if as_json:
        console.print_json(json.dumps(gap.diagnosis_facts(found, following)))
        return
    if found.position is not None:
        print_position(console, found.unit_id, found.position)
    else:
        print_rate(console, found, following)
    if then is not None:
        console.print("  nothing was run: no procedure of the bench would decide more")
    if report is not None:
        console.say(f"report: {report}", soft_wrap=True)


def _page(found: Diagnosis, given: Recordings, following: Sequence[Suggestion], model: Path) -> Page:
    from bench.analysis.gap import closed_model, differences
    from bench.present.report import GapContent, gap_page, heading_page
    from drivers.base.clock import utc_now

    if found.position is not None:
        runs = dict(found.run_checksums)
        return heading_page(found.position.study, found.unit_id, runs, created_utc=utc_now())
    shown = differences(given.shown, found.model, closed_model(found))
    return gap_page(GapContent(found, shown, utc_now(), model.name, following))


def run_suggestion(suggestion: Suggestion, then: NextRun, *, as_json: bool) -> Path:
    """Run what a diagnosis suggested on a bench, real or emulated; return the new run's folder."""
    from bench.control.procedure import find_procedure
    from bench.lab.emulated import load_plant
    from bench.present.cli._console import console_for
    from bench.present.cli._shown_run import perform
    from bench.record.benchfile import load_bench_file

    console = console_for(as_json)
    procedure = find_procedure(suggestion.procedure)
    parameters = procedure.parse(dict(suggestion.settings))
    file = load_bench_file(then.bench)
    plant = load_plant(then.plant, then.seed) if then.emulated else None
    result = perform(console, procedure, parameters, file, then.runs, plant=plant, yes=then.yes)
    if result.outcome == "aborted":
        raise BenchError(f"{suggestion.procedure} was aborted: {result.reason}")
    return result.folder
