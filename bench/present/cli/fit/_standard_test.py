"""`gyrobench fit standard-test`: figures and report of standard-test runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.present.cli._options import FittedRuns, GyroToFit

if TYPE_CHECKING:
    from rich.table import Table

    from bench.analysis.figures import Figure


def standard_test(
    runs: FittedRuns,
    gyro: GyroToFit = None,
    out: Annotated[Path, typer.Option(help="HTML report")] = Path("standard-test.html"),
) -> None:
    """Figures of the standards (bias, noise, scale factor, threshold, temperature) from standard-test runs.

    Several runs are several power-ons: bias and scale-factor repeatability are then computed over them.
    """
    from bench.analysis.figures import figures_of_unit
    from bench.present.cli._console import Terminal
    from bench.present.report import standard_test_page, write_report
    from bench.record.recording import Run
    from drivers.base.clock import utc_now

    console = Terminal()
    results, over_runs = figures_of_unit(runs, gyro)
    manifests = [Run.open(folder).manifest for folder in runs]
    page = standard_test_page(
        results,
        over_runs,
        created_utc=utc_now(),
        bench_name=str(manifests[0].bench["bench"]["name"]),
        warnings=[
            f"Run {m.run_id} is {m.outcome}: {m.reason}" for m in manifests if m.outcome != "completed"
        ],
    )
    write_report(out, page)
    for result in results:
        console.print(_table(result.run_id, result.figures))
        for what, why in result.missing:
            console.say(f"{result.run_id}: no {what}. {why}", style="yellow")
    if over_runs:
        console.print(_table("over runs", over_runs))
    console.say(f"{out}")


def _table(title: str, figures: Sequence[Figure]) -> Table:
    from rich.table import Table

    table = Table("figure", "value", "unit", "95 % interval", title=title)
    for figure in figures:
        known = figure.low is not None and figure.high is not None
        interval = f"{figure.low:.3g} .. {figure.high:.3g}" if known else ""
        table.add_row(figure.name, f"{figure.value:.{figure.digits}g}", figure.unit, interval)
    return table
