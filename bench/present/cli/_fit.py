"""`gyrobench fit cold-shock`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from bench.analysis.common.fan_out import fan_out
from bench.analysis.common.state_file import save_file, saved_together
from bench.analysis.export import c_header, lstm_to_onnx
from bench.analysis.thermal import Compensation, LstmModel, Study, load_runs, run_study
from bench.present.cli._console import Terminal
from bench.present.fitting_report import study_content
from bench.present.report import render_campaign, write_report
from bench.record.recording import Run

REPORT_FILE = "report.html"
NETWORK_FILE = "lstm.onnx"


def fit_command(
    train: Sequence[Path],
    validate: Sequence[Path],
    test: Sequence[Path],
    gyro: str | None,
    out: Path,
    models: str | None,
    jobs: int | None = None,
    cluster: str | None = None,
) -> None:
    """Fit, choose, judge, and write compensation, exports and report to `out`."""
    console = Terminal()
    names = [name.strip() for name in models.split(",")] if models else None
    with console.status("loading runs"):
        sets = [load_runs(folders, gyro) for folders in (train, validate)]
        tests = load_runs(test, gyro, allow_invalid=True)
    with console.status("fitting models"), fan_out(jobs, cluster) as fan:
        study = run_study(sets[0], sets[1], tests, names, fan=fan)
    write_study(study, [*train, *validate, *test], out, title="Cold-shock compensation")
    console.print(score_table(study))
    console.print(f"chosen on {_names(study)}: {study.chosen}; files in {out}", highlight=False)
    if study.judged_on_chosen:
        console.print("no --test runs: the figures are on the runs that chose the model", style="yellow")


def write_study(study: Study, folders: Sequence[Path], out: Path, *, title: str) -> None:
    """Write compensation.gyrocomp, compensation.h, lstm.onnx (if fitted) and report.html to `out`."""
    with saved_together(out, NETWORK_FILE) as part:
        path = part / "compensation.gyrocomp"
        study.compensation.save(path)
        saved = Compensation.load(path)
        save_file(part / "compensation.h", c_header(saved))
        network = study.models.get(LstmModel.name)
        if isinstance(network, LstmModel):
            save_file(part / NETWORK_FILE, lstm_to_onnx(network))
        content = study_content(study, [Run.open(folder) for folder in folders], path, title)
        write_report(part / REPORT_FILE, render_campaign(content))


def score_table(study: Study) -> Table:
    """Return the models' mean figures over the test runs."""
    table = Table(title="means over the test runs")
    table.add_column("model", no_wrap=True)
    for heading in (
        "1σ of 100 s, deg/h",
        "less by %",
        "of attainable %",
        "peak deg/h",
        "SF rms ppm",
        "max ppm",
    ):
        table.add_column(heading, justify="right")
    for score in study.selection:
        rows = study.scores[score.name]
        cells = [
            _mean([row.stability_dph for row in rows], ".4f"),
            _mean([row.improvement_pct for row in rows], ".1f"),
            _mean(
                [None if row.attained_fraction is None else 100 * row.attained_fraction for row in rows],
                ".1f",
            ),
            _mean([row.true_max_dph for row in rows], ".3f"),
            _mean([row.sf_true_rms_ppm or row.sf_rms_ppm for row in rows], ".2f"),
            _mean([row.sf_true_max_ppm or row.sf_max_ppm for row in rows], ".1f"),
        ]
        style = "bold green" if score.name == study.chosen else ""
        table.add_row(score.name, *cells, style=style)
    return table


def _names(study: Study) -> str:
    return ", ".join(run.run_id for run in study.validation)


def _mean(values: Sequence[float | None], spec: str) -> str:
    known = [value for value in values if value is not None]
    return format(sum(known) / len(known), spec) if known else "-"
