"""`gyrobench fit stepwise`: the ring laser's regression from run folders."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.present.cli._options import FitFolder, FittedRuns, GyroToFit, TestRuns

if TYPE_CHECKING:
    from rich.table import Table

    from bench.analysis.rlg import RlgStudy


def stepwise(
    runs: FittedRuns,
    test: TestRuns = None,
    gyro: GyroToFit = None,
    out: FitFolder = Path("stepwise"),
    variables: Annotated[
        str | None, typer.Option(help="candidate variables, separated by commas; default the paper's eleven")
    ] = None,
    p_enter: Annotated[float, typer.Option(help="p below which a variable enters")] = 0.05,
    p_remove: Annotated[float, typer.Option(help="p above which a variable leaves")] = 0.10,
) -> None:
    """Stepwise regression of a ring-laser gyro's bias over temperature, judged on the test runs.

    A folder for each unit: compensation (of the corrected selection, whatever the test runs say) and report.
    """
    from bench.analysis.common.state_file import saved_together
    from bench.analysis.rlg import CANDIDATES, study_units
    from bench.present.cli._console import Terminal
    from bench.present.report import stepwise_page, write_report
    from bench.record.recording import Run
    from drivers.base.clock import utc_now

    console = Terminal()
    names = tuple(name.strip() for name in variables.split(",")) if variables else CANDIDATES
    studies = study_units(
        runs, test or [], (gyro,) if gyro else (), names, p_enter=p_enter, p_remove=p_remove
    )
    bench_name = Run.open(runs[0]).manifest.bench_name
    manifests = [Run.open(folder).manifest for folder in test or []]
    warnings = [f"Run {m.run_id} is {m.outcome}: {m.reason}" for m in manifests if m.outcome != "completed"]
    for unit, study in studies.items():
        folder = out / "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in unit)
        with saved_together(folder) as part:
            study.chosen.compensation.save(part / "compensation.gyrocomp")
            page = stepwise_page(study, created_utc=utc_now(), bench_name=bench_name, warnings=warnings)
            write_report(part / "report.html", page)
        console.print(_equations(study))
        if study.tests:
            console.print(_judged(study))
        console.say(f"{study.chosen.name}: {study.chosen.compensation.equation()}")
        for name, why in study.left_out:
            console.say(f"{name} left out: {why}", style="yellow")
        for run in (*study.training, *study.tests):
            for remark in run.remarks:
                console.say(f"{run.run_id}: {remark}", style="yellow")
        console.say(f"files in {folder}")


def _equations(study: RlgStudy) -> Table:
    from rich.table import Table

    table = Table("equation", "terms", "R²", "RMSE deg/h", "before deg/h", "after deg/h", "less by %",
                  title=f"unit {study.unit_id}")  # fmt: skip
    for variant in study.variants:
        rows = variant.judged
        means = ["-"] * 3
        if rows:
            before = sum(row.before_dph for row in rows) / len(rows)
            after = sum(row.after_dph for row in rows) / len(rows)
            means = [f"{before:.5f}", f"{after:.5f}", f"{variant.mean_improvement_pct:.1f}"]
        final = variant.result.final
        table.add_row(
            variant.name, ", ".join(variant.result.selected), f"{final.r2:.4f}", f"{final.rmse:.5f}", *means
        )
    return table


def _judged(study: RlgStudy) -> Table:
    from rich.table import Table

    table = Table("run", "differs by", "before", *(variant.name for variant in study.variants),
                  title="stability of 100 s means before, deg/h, and less by %")  # fmt: skip
    table.columns[0].overflow = "fold"
    for n, row in enumerate(study.chosen.judged):
        less = [f"{variant.judged[n].improvement_pct:.1f}" for variant in study.variants]
        table.add_row(row.run_id, row.differs, f"{row.before_dph:.5f}", *less)
    return table
