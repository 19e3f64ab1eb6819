"""`gyrobench fit whirl`: runs with rotation in, compensation and report out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from bench.present.cli._options import FitFolder, FittedRuns, GyroToFit, TestRuns

if TYPE_CHECKING:
    from rich.table import Table

    from bench.analysis.whirl import Gauge, WhirlStudy

COMPENSATION_FILE = "compensation.whirl"
REPORT_FILE = "report.html"


def whirl(
    runs: FittedRuns,
    test: TestRuns = None,
    gyro: GyroToFit = None,
    out: FitFolder = Path("whirl"),
    gauge: Annotated[str, typer.Option(help="how the unobservable constant tilt is fixed")] = "mean",
) -> None:
    """Whirl of a rotating mechanism from gyro and angle, and its compensation of the attitude."""
    from bench.analysis.common.state_file import saved_together
    from bench.analysis.whirl import load_turns, study_whirl
    from bench.present.cli._console import Terminal
    from bench.present.report import whirl_page, write_report
    from bench.record.recording import Run
    from drivers.base.errors import ConfigurationError

    if gauge not in ("mean", "start"):
        raise ConfigurationError("no such gauge", where="--gauge", found=gauge, expected="mean or start")
    console = Terminal()
    opened = [Run.open(folder) for folder in (*runs, *(test or []))]
    with console.status("reading runs"):
        turns = [load_turns(run, gyro) for run in opened]
    fitted = {run.manifest.run_id: run.checksum for run in opened[: len(runs)]}
    with console.status("fitting whirl"):
        study = study_whirl(
            turns[: len(runs)], turns[len(runs) :], gauge=cast("Gauge", gauge), checksums=fitted
        )
    with saved_together(out) as part:
        study.compensation.save(part / COMPENSATION_FILE)
        write_report(part / REPORT_FILE, whirl_page(study, opened, part / COMPENSATION_FILE))
    console.print(_lines(study))
    console.print(_judgements(study))
    for text in (*study.compensation.declared, *(finding.text for finding in study.findings)):
        console.say(f"- {text}")
    if study.judged_on_fitted:
        console.print("no --test run: the figures are on the runs that were fitted", style="yellow")
    console.say(f"files in {out}")


def _lines(study: WhirlStudy) -> Table:
    """Return the fitted lines with their standard deviations and significance."""
    from rich.table import Table

    table = Table("line m", "about x arcsec", "about y arcsec", "sd an axis", "|a|^2 / 2 sd^2")
    fit = study.fit
    columns = (fit.lines, fit.amplitudes_arcsec, fit.sd_arcsec, fit.statistic)
    for line, value, sd, evidence in zip(*columns, strict=True):
        table.add_row(f"{line:+g}", f"{value.real:.4f}", f"{value.imag:.4f}", f"{sd:.4f}", f"{evidence:,.1f}")
    return table


def _judgements(study: WhirlStudy) -> Table:
    """Return the carrier's oscillation before and after, run by run."""
    from rich.table import Table

    table = Table(
        "run", "locked to the angle, arcsec rms: before", "patent", "after", "times less", "total after"
    )
    for row in study.judgements:
        patent = "-" if row.patent is None else f"{row.patent.locked_arcsec:.3f}"
        table.add_row(
            row.record.run_id,
            f"{row.before.locked_arcsec:.3f}",
            patent,
            f"{row.after.locked_arcsec:.3f}",
            f"{row.locked_factor:.0f}",
            f"{row.after.total_arcsec:.3f}",
        )
    return table
