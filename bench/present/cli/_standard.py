"""`gyrobench fit standard`: figures and report of standard-test runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from bench.analysis.figures import Figure, StandardFigures, figures_over_runs, standard_figures
from bench.present.cli._console import Terminal
from bench.present.report import render_standard_test, write_report
from bench.record.recording import Run
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError


def standard_command(folders: Sequence[Path], gyro: str | None, out: Path) -> None:
    """Compute the figures of one unit's standard-test runs, print them and write the report to `out`.

    Several runs are several power-ons: bias and scale-factor repeatability are then computed over them.
    """
    console = Terminal()
    results = [standard_figures(folder, gyro) for folder in folders]
    units = sorted({result.unit_id for result in results})
    if len(units) != 1:
        raise ConfigurationError(
            "one report is of one unit",
            where="standard test",
            found=", ".join(units) or "no run",
            expected="runs of one unit",
            remedy="name a gyro, or report each unit on its own",
        )
    manifests = [Run.open(folder).manifest for folder in folders]
    warnings = [f"Run {m.run_id} is {m.outcome}: {m.reason}" for m in manifests if m.outcome != "completed"]
    over_runs = figures_over_runs(results) if len(results) > 1 else ()
    page = render_standard_test(
        results,
        over_runs,
        created_utc=utc_now(),
        bench_name=str(manifests[0].bench["bench"]["name"]),
        warnings=warnings,
    )
    write_report(out, page)
    for result in results:
        console.print(_table(result.run_id, result.figures))
        _say_missing(console, result)
    if over_runs:
        console.print(_table("over runs", over_runs))
    console.print(f"{out}", highlight=False)


def _table(title: str, figures: Sequence[Figure]) -> Table:
    table = Table("figure", "value", "unit", "95 % interval", title=title)
    for figure in figures:
        known = figure.low is not None and figure.high is not None
        interval = f"{figure.low:.3g} .. {figure.high:.3g}" if known else ""
        table.add_row(figure.name, f"{figure.value:.{figure.digits}g}", figure.unit, interval)
    return table


def _say_missing(console: Console, result: StandardFigures) -> None:
    for what, why in result.missing:
        console.print(f"{result.run_id}: no {what}. {why}", style="yellow", highlight=False)
