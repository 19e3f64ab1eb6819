"""`gyrobench fit cold-shock`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.present.cli._options import Cluster, FitFolder, FittedRuns, GyroToFit, Jobs, TestRuns

if TYPE_CHECKING:
    from rich.table import Table

    from bench.analysis.thermal import Study


def cold_shock(
    runs: FittedRuns,
    validate: Annotated[
        list[Path] | None, typer.Option("--validate", help="run folder that chooses between models")
    ] = None,
    test: TestRuns = None,
    gyro: GyroToFit = None,
    out: FitFolder = Path("fit"),
    models: Annotated[
        str | None, typer.Option(help="models to fit, separated by commas; default all")
    ] = None,
    jobs: Jobs = None,
    cluster: Cluster = None,
) -> None:
    """Fit bias and scale-factor models to cold shocks, choose on the validation runs, judge on the test runs."""
    from bench.analysis.common.fan_out import fan_out
    from bench.analysis.thermal import load_runs, run_study
    from bench.present.cli._console import Terminal
    from bench.present.report import write_study

    console = Terminal()
    validate, test = validate or [], test or []
    names = [name.strip() for name in models.split(",")] if models else None
    with console.status("loading runs"):
        training, validation = (load_runs(folders, gyro) for folders in (runs, validate))
        tests = load_runs(test, gyro, allow_invalid=True)
    with console.status("fitting models"), fan_out(jobs, cluster) as fan:
        study = run_study(training, validation, tests, names, fan=fan)
    write_study(study, [*runs, *validate, *test], out, title="Cold-shock compensation")
    console.print(score_table(study))
    chosen_on = ", ".join(run.run_id for run in study.validation)
    console.say(f"chosen on {chosen_on}: {study.chosen}; files in {out}")
    if study.judged_on_chosen:
        console.print("no --test runs: the figures are on the runs that chose the model", style="yellow")


def score_table(study: Study) -> Table:
    """Return the models' mean figures over the test runs."""
    from rich.table import Table

    table = Table(title="means over the test runs")
    table.add_column("model", no_wrap=True)
    heads = ("1σ of 100 s, deg/h", "less by %", "of attainable %", "peak deg/h", "SF rms ppm", "max ppm")
    for head in heads:
        table.add_column(head, justify="right")
    for score in study.selection:
        rows = study.scores[score.name]
        shares = [None if row.attained_fraction is None else 100 * row.attained_fraction for row in rows]
        cells = [
            _mean([row.stability_dph for row in rows], ".4f"),
            _mean([row.improvement_pct for row in rows], ".1f"),
            _mean(shares, ".1f"),
            _mean([row.true_max_dph for row in rows], ".3f"),
            _mean([row.sf_true_rms_ppm or row.sf_rms_ppm for row in rows], ".2f"),
            _mean([row.sf_true_max_ppm or row.sf_max_ppm for row in rows], ".1f"),
        ]
        table.add_row(score.name, *cells, style="bold green" if score.name == study.chosen else "")
    return table


def _mean(values: Sequence[float | None], spec: str) -> str:
    known = [value for value in values if value is not None]
    return format(sum(known) / len(known), spec) if known else "-"
