"""`gyrobench fit stepwise`: the ring laser's regression from run folders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from bench.analysis.common.state_file import saved_together
from bench.analysis.rlg import CANDIDATES, RampRun, RlgStudy, load_ramp_runs, run_rlg_study
from bench.present.cli._console import Terminal
from bench.present.report import render_rlg_study, write_report
from bench.record.recording import Run
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError


def stepwise_command(
    train: Sequence[Path],
    test: Sequence[Path],
    gyro: str | None,
    out: Path,
    variables: str | None = None,
    p_enter: float = 0.05,
    p_remove: float = 0.10,
) -> None:
    """Fit every unit of the training runs, judge it on its other runs, write equations, files and reports.

    For each unit: <out>/<unit>/compensation.gyrocomp (the corrected selection, whatever the held-out runs say)
    and report.html.
    """
    console = Terminal()
    names = tuple(name.strip() for name in variables.split(",")) if variables else CANDIDATES
    wanted = (gyro,) if gyro else ()
    training = _by_unit(train, wanted, allow_invalid=False)
    tests = _by_unit(test, wanted, allow_invalid=True)
    bench_name = Run.open(train[0]).manifest.bench_name
    warnings = [
        f"Run {run.manifest.run_id} is {run.manifest.outcome}: {run.manifest.reason}"
        for run in map(Run.open, test)
        if run.manifest.outcome != "completed"
    ]
    for unit, runs in training.items():
        study = run_rlg_study(runs, tests.get(unit, []), names, p_enter=p_enter, p_remove=p_remove)
        write_rlg_study(study, out / _file_name(unit), bench_name, warnings)
        console.print(_equations(study))
        if study.tests:
            console.print(_judged(study))
        console.print(f"{study.chosen.name}: {study.chosen.compensation.equation()}", highlight=False)
        for name, why in study.left_out:
            console.print(f"{name} left out: {why}", style="yellow", highlight=False)
        for run in (*study.training, *study.tests):
            for remark in run.remarks:
                console.print(f"{run.run_id}: {remark}", style="yellow", highlight=False)
        console.print(f"files in {out / _file_name(unit)}", highlight=False)


def write_rlg_study(study: RlgStudy, folder: Path, bench_name: str, warnings: Sequence[str] = ()) -> None:
    """Write compensation.gyrocomp and report.html of a study to `folder`."""
    with saved_together(folder) as part:
        study.chosen.compensation.save(part / "compensation.gyrocomp")
        page = render_rlg_study(study, created_utc=utc_now(), bench_name=bench_name, warnings=warnings)
        write_report(part / "report.html", page)


def _by_unit(
    folders: Sequence[Path], gyros: tuple[str, ...], *, allow_invalid: bool
) -> dict[str, list[RampRun]]:
    found: dict[str, list[RampRun]] = {}
    for folder in folders:
        manifest = Run.open(folder).manifest
        if manifest.outcome != "completed" and not allow_invalid:
            raise ConfigurationError(
                "a run that was not completed cannot be fitted",
                where=str(folder),
                found=f"{manifest.outcome}: {manifest.reason}",
                expected="runs that met their own criteria",
                remedy="leave it out, or name it with --test to see what the equation makes of it",
            )
        for run in load_ramp_runs(folder, gyros):
            found.setdefault(run.unit_id, []).append(run)
    return found


def _equations(study: RlgStudy) -> Table:
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
    table = Table("run", "differs by", "before", *(variant.name for variant in study.variants),
                  title="stability of 100 s means before, deg/h, and less by %")  # fmt: skip
    table.columns[0].overflow = "fold"
    for n, row in enumerate(study.chosen.judged):
        less = [f"{variant.judged[n].improvement_pct:.1f}" for variant in study.variants]
        table.add_row(row.run_id, row.differs, f"{row.before_dph:.5f}", *less)
    return table


def _file_name(unit: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in unit)
