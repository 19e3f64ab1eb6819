"""`gyrobench fit` for whirl: runs with rotation in, compensation and report out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

from rich.table import Table

from bench.analysis.common.state_file import saved_together
from bench.analysis.whirl import Gauge, WhirlStudy, load_turns, study_whirl
from bench.present.cli._console import Terminal
from bench.present.report import render_whirl, run_content, write_report
from bench.present.whirl_report import whirl_content
from bench.record.recording import Run
from drivers.base.errors import ConfigurationError

COMPENSATION_FILE = "compensation.whirl"
REPORT_FILE = "report.html"


def whirl_command(
    runs: Sequence[Path], gyro: str | None, out: Path, test: Sequence[Path] = (), gauge: str = "mean"
) -> None:
    """Fit on `runs`, judge on `test`, write compensation.whirl and report.html to `out`; print what was found."""
    console = Terminal()
    chosen = _gauge(gauge)
    opened = [Run.open(folder) for folder in (*runs, *test)]
    with console.status("reading runs"):
        turns = [load_turns(run, gyro) for run in opened]
    checksums = {run.manifest.run_id: run.checksum for run in opened}
    fitted = {turn.record.run_id: checksums[turn.record.run_id] for turn in turns[: len(runs)]}
    with console.status("fitting whirl"):
        study = study_whirl(turns[: len(runs)], turns[len(runs) :], gauge=chosen, checksums=fitted)
    summaries = [
        replace(run_content(run).summary, checksum=checksums[run.manifest.run_id], role=role)
        for run, role in zip(opened, ["fitted"] * len(runs) + ["held out"] * len(test), strict=True)
    ]
    with saved_together(out) as part:
        study.compensation.save(part / COMPENSATION_FILE)
        content = whirl_content(study, summaries, part / COMPENSATION_FILE)
        write_report(part / REPORT_FILE, render_whirl(content))
    console.print(lines_table(study))
    console.print(judgement_table(study))
    for text in (*study.compensation.declared, *(finding.text for finding in study.findings)):
        console.print(f"- {text}", highlight=False)
    if study.judged_on_fitted:
        console.print("no --test run: the figures are on the runs that were fitted", style="yellow")
    console.print(f"files in {out}", highlight=False)


def lines_table(study: WhirlStudy) -> Table:
    """Return the fitted lines with their standard deviations and significance."""
    table = Table("line m", "about x arcsec", "about y arcsec", "sd an axis", "|a|^2 / 2 sd^2")
    fit = study.fit
    for line, value, sd, evidence in zip(
        fit.lines, fit.amplitudes_arcsec, fit.sd_arcsec, fit.statistic, strict=True
    ):
        table.add_row(f"{line:+g}", f"{value.real:.4f}", f"{value.imag:.4f}", f"{sd:.4f}", f"{evidence:,.1f}")
    return table


def judgement_table(study: WhirlStudy) -> Table:
    """Return the carrier's oscillation before and after, run by run."""
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


def _gauge(name: str) -> Gauge:
    for known in get_args(Gauge):
        if name == known and name != "external":
            return known  # type: ignore[no-any-return]  # get_args returns Any
    raise ConfigurationError("no such gauge", where="--gauge", found=name, expected="mean or start")
