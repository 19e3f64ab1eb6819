"""`gyrobench gap diagnose`, with `--run` the run that would decide most, and `gyrobench gap close`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import BadParameter, Option

from bench.present.cli._console import Terminal
from bench.present.cli._options import DiagnosedGyro, DiagnosedRuns, Json, NominalModel, OwnEffects
from drivers.base.clock import utc_now
from drivers.base.errors import BenchError, ConfigurationError

if TYPE_CHECKING:
    from bench.analysis.gap import Diagnosis, Recordings, Suggestion
    from bench.lab.emulated import Plant
    from bench.present.report import Page
    from bench.record.benchfile import BenchFile


def diagnose(
    runs: DiagnosedRuns,
    model: NominalModel,
    held_out: Annotated[
        list[Path] | None, Option(help="run to judge the closing on: id of one given, folder or mapping file")
    ] = None,
    gyro: DiagnosedGyro = None,
    as_json: Json = False,
    report: Annotated[Path | None, Option(help="HTML report to write, with the map and curves")] = None,
    run: Annotated[
        bool, Option("--run", help="run the first suggestion on --bench, then diagnose with it")
    ] = False,
    bench: Annotated[Path | None, Option(help="with --run: bench file (TOML)")] = None,
    emulated: Annotated[
        bool, Option("--emulated", help="with --run: on an emulated lab that matches the bench")
    ] = False,
    plant: Annotated[
        Path | None, Option(help="with --run --emulated: plant file (TOML) of the emulated lab")
    ] = None,
    seed: Annotated[int | None, Option(help="with --run --emulated: seed of the lab")] = None,
    runs_folder: Annotated[Path, Option("--runs", help="with --run: folder that holds the runs")] = Path(
        "runs"
    ),
    yes: Annotated[
        bool, Option("--yes", "-y", help="with --run: answer the procedure's questions with yes")
    ] = False,
    effects: OwnEffects = None,
) -> None:
    """Say where the gap is and which effect explains it.

    It also says how far the gap closes on held-out runs.
    """
    from bench.analysis import gap
    from bench.lab.emulated import load_plant
    from bench.present.cli.gap._text import print_position, print_rate
    from bench.present.report import write_report
    from bench.record.benchfile import load_bench_file

    if run and bench is None:
        raise BadParameter("--run needs --bench, the bench to run on")
    if not run and (bench is not None or plant is not None or emulated or seed is not None):
        raise BadParameter("--bench, --plant, --seed and --emulated go with --run")
    if (plant is not None or seed is not None) and not emulated:
        raise BadParameter("--plant and --seed go with --emulated: without it the bench itself is driven")
    for file_of_effects in effects or ():
        gap.take_own(file_of_effects)
    console, nominal = Terminal(), gap.read_model(model)

    def diagnosed(recorded: Sequence[Path]) -> tuple[Recordings, Diagnosis, Sequence[Suggestion]]:
        with console.status("diagnosing"):
            given = gap.read_recordings(recorded, held_out or [], gyro)
            found = gap.diagnose(given.runs, nominal, given.held_out, given.missing)
            return given, found, gap.suggest(found)

    given, found, following = diagnosed(runs)
    if bench is not None and following:
        plan = following[0]
        if not as_json:
            causes = ", ".join(cause.name for cause in found.causes) or "no cause named"
            console.say(
                f"so far: {found.verdict}, {causes}; now {plan.procedure} ({plan.parameters}, "
                f"{plan.hours:.1f} h of bench time) to decide {plan.decides}"
            )
        file, lab = load_bench_file(bench), load_plant(plant, seed) if emulated else None
        progress = Terminal(as_json=as_json)
        folder = make_run(progress, plan.procedure, plan.settings, file, runs_folder, plant=lab, yes=yes)
        given, found, following = diagnosed([*runs, folder])
        run = False
    if report is not None:
        write_report(report, _page(found, given, following, model))
    if as_json:
        console.print_json(json.dumps(gap.diagnosis_facts(found, following)))
        return
    if found.position is not None:
        print_position(console, found.unit_id, found.position)
    else:
        print_rate(console, found, following)
    if run:
        console.print("  nothing was run: no procedure of the bench would decide more")
    if report is not None:
        console.say(f"report: {report}", soft_wrap=True)


def _page(found: Diagnosis, given: Recordings, following: Sequence[Suggestion], model: Path) -> Page:
    from bench.analysis.gap import closed_model, differences
    from bench.present.report import gap_page, heading_page

    if found.position is not None:
        runs = dict(found.run_checksums)
        return heading_page(found.position.study, found.unit_id, runs, created_utc=utc_now())
    shown = differences(given.shown, found.model, closed_model(found))
    return gap_page(found, shown, following, created_utc=utc_now(), model_file=model.name)


def make_run(
    console: Terminal,
    name: str,
    settings: Mapping[str, Any],
    file: BenchFile,
    runs: Path,
    *,
    plant: Plant | None = None,
    yes: bool = False,
) -> Path:
    """Run a procedure for a diagnosis, with `plant` emulated; return the run's folder, BenchError if aborted."""
    from bench.control.procedure import find_procedure
    from bench.present.cli._shown_run import perform

    procedure = find_procedure(name)
    values = procedure.parse(dict(settings))
    result = perform(console, procedure, values, file, runs, plant=plant, yes=yes)
    if result.outcome == "aborted":
        raise BenchError(f"{name} was aborted: {result.reason}")
    return result.folder


def close(
    runs: DiagnosedRuns,
    model: NominalModel,
    gyro: DiagnosedGyro = None,
    out: Annotated[Path | None, Option(help="file; default nominal+<effect>.toml beside the model")] = None,
    fmu: Annotated[
        Path | None, Option(help="write what is missing as an FMU for co-simulation, too (extra: fmu)")
    ] = None,
    as_json: Json = False,
    effects: OwnEffects = None,
) -> None:
    """Write the nominal model with the missing effects in it.

    What is left without a name is written as learned terms. If the nominal model is a simulation of your own, a
    CSV file for each run has what it lacks, over time.
    """
    from bench.analysis import gap
    from bench.analysis.common.fmu import check_can_write
    from bench.analysis.common.state_file import save_file
    from bench.present.sentences import learned_sentences

    for file in effects or ():
        gap.take_own(file)
    if fmu is not None:
        check_can_write(fmu)
    console, nominal = Terminal(as_json=as_json), gap.read_model(model)
    given = gap.read_recordings(runs, gyro=gyro)
    found = gap.diagnose(given.runs, nominal, missing=given.missing)
    facts = {"verdict": found.verdict, "effects": list(found.closing)}
    if not found.closing:
        console.say_json("result", **facts, file=None, tables=[], fmu=None)
        named = "".join(f", {cause.name}" for cause in found.causes)
        text = f"{found.verdict}{named}: there is no effect to put into the model"
        console.say(text, style="yellow")
        return
    if fmu is not None and found.of_rate is None:
        raise ConfigurationError(
            "an FMU of what is missing is one of a gyro's rate",
            where="--fmu",
            found="runs without a gyro",
            remedy="close without --fmu: the model file has the channels' effects",
        )
    if fmu is not None:
        gap.write_missing_fmu(gap.closed_model(found), nominal, given.shown, fmu)
    path = out or model.with_name(f"{model.stem}+{'+'.join(found.closing)}.toml")
    closed = gap.closed_model(found)
    if closed.simulation is not None:
        closed = replace(closed, simulation=closed.simulation.moved(path.parent))
    save_file(path, gap.model_text(closed))
    tables = gap.write_missing(closed, given.shown, path)
    console.say_json("result", **facts, file=path, tables=tables, fmu=fmu)
    console.say_all((path, *tables, *([fmu] if fmu else [])), soft_wrap=True)
    console.say_all(learned_sentences(found.of_rate.learned) if found.of_rate is not None else ())
