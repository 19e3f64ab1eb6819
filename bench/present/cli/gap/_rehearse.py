"""`gyrobench gap rehearse`."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from bench.present.cli._console import Terminal
from bench.present.cli._options import DiagnosedGyro, Json, NominalModel
from bench.present.cli.gap._diagnose import make_run
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError

if TYPE_CHECKING:
    from bench.analysis.gap import LogGap


def rehearse(
    run: Annotated[Path, Argument(help="run folder, held out from the fit")],
    model: NominalModel,
    closed: Annotated[Path, Option(help="model with the effects in it, as `gap close` writes it")],
    runs: Annotated[Path, Option(help="folder for the rehearsals")] = Path("runs"),
    gyro: DiagnosedGyro = None,
    plant: Annotated[Path | None, Option(help="plant file (TOML) of the emulated bench")] = None,
    seed: Annotated[int, Option(help="seed of the emulated bench")] = 1,
    as_json: Json = False,
    report: Annotated[Path | None, Option(help="HTML report to write, with the curves")] = None,
) -> None:
    """Show by how much the gap of a run shrinks.

    The run's procedure is rehearsed on the emulated bench with both models.
    """
    from bench.analysis.gap import log_gap_facts, log_gaps, read_recordings
    from bench.lab.emulated import load_plant
    from bench.present.report import log_gaps_page, write_report
    from bench.record.benchfile import bench_file_from
    from bench.record.recording import Run

    console = Terminal(as_json=as_json)
    recorded = Run.open(run)
    manifest = recorded.manifest
    _check_model(manifest.run_id, closed)
    real = read_recordings([run], gyro=gyro)
    if report is not None and real.of_platform:
        raise ConfigurationError(
            "there is no report of a platform's rehearsal", expected="the table, or --json"
        )
    if not manifest.bench:
        raise ConfigurationError(
            "the run does not say on which bench it was made",
            where=str(recorded.place),
            expected="a run folder of this project; an imported recording has no procedure to repeat",
        )
    bench, lab, folders = bench_file_from(manifest.bench), load_plant(plant), []
    for file, its_seed in ((model, seed), (closed, seed), (closed, seed + 1)):
        models = {**lab.gap_model, real.unit_id: file.resolve()}
        followed = lab.model_copy(update={"seed": its_seed, "gap_model": models})
        folders.append(
            make_run(console, manifest.procedure, manifest.parameters, bench, runs, plant=followed)
        )
    gaps = log_gaps(real.runs, *(read_recordings([folder], gyro=gyro).runs for folder in folders))
    if report is not None:
        names = (model.name, closed.name)
        write_report(report, log_gaps_page(manifest.run_id, real.unit_id, names, gaps, utc_now()))
    if as_json:
        facts = {"run": manifest.run_id, "rehearsals": [str(folder) for folder in folders]}
        Terminal(color_system=None).print_json(json.dumps(facts | log_gap_facts(gaps)))
    print_gaps(console, "heading", "rms arcsec", gaps.headings, ".1f")
    print_gaps(console, "phase", "rms deg/h of 100 s means", gaps.rate, ".4f")
    print_gaps(console, "channel", "rms of 100 s means", gaps.channels, ".3g", unit=True)
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


def print_gaps(
    console: Terminal, first: str, what: str, gaps: Sequence[LogGap], digits: str, *, unit: bool = False
) -> None:
    """Print a table of the gaps, if there are any, a row each; with `unit` every row says its own."""
    rows = []
    for gap in gaps:
        sizes = [format(rms, digits) for rms in (gap.rms_nominal, gap.rms_closed, gap.rms_floor)]
        sizes[0] += f" {gap.unit}" if unit else ""
        share = "" if math.isnan(gap.share) else f"{100.0 * gap.share:.1f}"
        rows.append((gap.part.replace("_", " "), *sizes, share))
    if rows:
        heads = (first, "nominal", "closed", "floor", "gone %")
        console.table(heads, rows, f"run less rehearsal, {what}")
