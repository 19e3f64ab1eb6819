"""`gyrobench fit cold-shock`, `stepwise` and `chamber-cycle`: models of the bias over temperature."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table
from typer import Argument, Option

from bench.present.cli._console import Terminal
from bench.present.cli._options import Cluster, FitFolder, FittedRuns, GyroToFit, Jobs, Json, TestRuns
from bench.present.cli.fit._batch import cold_shock_of_batch, unit_folder
from drivers.base.clock import utc_now

if TYPE_CHECKING:
    from bench.analysis.rlg import RlgStudy
    from bench.analysis.thermal import Study


def cold_shock(
    runs: FittedRuns,
    validate: Annotated[list[Path] | None, Option(help="run folder that chooses between models")] = None,
    test: TestRuns = None,
    gyro: GyroToFit = None,
    out: FitFolder = Path("fit"),
    models: Annotated[
        str | None,
        Option(
            help="models to fit, separated by commas; default all. A network's settings: "
            "lstm:hidden=32+seed=1+inputs=t_in/t_out/dt_60/gradient; several seeds show their spread"
        ),
    ] = None,
    batch: Annotated[
        bool,
        Option(
            "--batch", help="runs of several units: a model common to them, each with its own corrections"
        ),
    ] = False,
    jobs: Jobs = None,
    cluster: Cluster = None,
    as_json: Json = False,
) -> None:
    """Fit bias and scale-factor models to cold shocks.

    One is chosen on the validation runs and judged on the test runs. Of a batch, units left out in turn
    choose; a test run of a unit that is not in it is judged with the common model.
    """
    from bench.analysis.common.fan_out import fan_out
    from bench.analysis.thermal import study_folders
    from bench.present.report import outside_sentence, write_study

    console = Terminal(as_json=as_json)
    validate, test = validate or [], test or []
    names = [name.strip() for name in models.split(",")] if models else None
    if batch:
        cold_shock_of_batch(console, runs, validate, test, gyro, names, out, jobs, cluster)
        return
    with console.status("fitting models"), fan_out(jobs, cluster) as fan:
        study = study_folders(runs, validate, test, gyro, names, fan=fan)
    write_study(study, [*runs, *validate, *test], out, title="Cold-shock compensation")
    console.print(score_table(study))
    best = study.selection[0]
    chosen_on = ", ".join(run.run_id for run in study.validation)
    how = (
        f"chosen with each of {best.left_out} runs left out in turn"
        if best.left_out
        else f"chosen on {chosen_on}"
    )
    what = f"{study.chosen} of {', '.join(best.parts)}" if best.parts else study.chosen
    console.say(f"{how}: {what}; files in {out}")
    for score in study.scores[study.chosen]:
        if text := outside_sentence(score):
            console.say(text, style="yellow")
    console.say_all(study.remarks, style="yellow")
    if study.judged_on_chosen:
        console.print("no --test runs: the figures are on the runs that chose the model", style="yellow")
    validated = [run.run_id for run in study.validation]
    judged = {"scores": study.scores, "judged_on_chosen": study.judged_on_chosen}
    console.say_json(
        "result", chosen=study.chosen, chosen_on=validated, **judged, remarks=study.remarks, folder=out
    )


def score_table(study: Study) -> Table:
    """Return the models' mean figures over the test runs."""
    from bench.analysis.common.statistics import attained

    table = Table(title="means over the test runs")
    table.add_column("model", no_wrap=True)
    heads = ("1σ of 100 s, deg/h", "less by %", "of attainable %", "peak deg/h", "SF rms ppm", "max ppm")
    for head in heads:
        table.add_column(head, justify="right")
    for score in study.selection:
        rows = study.scores[score.name]
        cells = [
            _mean([row.stability_dph for row in rows], ".4f"),
            _mean([row.improvement_pct for row in rows], ".1f"),
            _mean([attained(rows)[1]], ".1f"),
            _mean([row.true_max_dph for row in rows], ".3f"),
            _mean([row.sf_true_rms_ppm or row.sf_rms_ppm for row in rows], ".2f"),
            _mean([row.sf_true_max_ppm or row.sf_max_ppm for row in rows], ".1f"),
        ]
        table.add_row(score.name, *cells, style="bold green" if score.name == study.chosen else "")
    return table


def _mean(values: Sequence[float | None], spec: str) -> str:
    known = [value for value in values if value is not None]
    return format(sum(known) / len(known), spec) if known else "-"


def stepwise(
    runs: FittedRuns,
    test: TestRuns = None,
    gyro: GyroToFit = None,
    out: FitFolder = Path("stepwise"),
    variables: Annotated[
        str | None, Option(help="candidate variables, separated by commas; default the paper's eleven")
    ] = None,
    p_enter: Annotated[float, Option(help="p below which a variable enters")] = 0.05,
    p_remove: Annotated[float, Option(help="p above which a variable leaves")] = 0.10,
    as_json: Json = False,
) -> None:
    """Fit a ring-laser gyro's bias over temperature.

    By stepwise regression and by a smooth form; what goes into the file is chosen by leaving each fitted run
    out, and judged on the test runs.

    A folder for each unit with compensation and report; of several units a page that has them all.
    """
    from bench.analysis.common.state_file import saved_together
    from bench.analysis.rlg import CANDIDATES, study_units
    from bench.present.report import (
        choice_sentence,
        expected_sentence,
        stepwise_page,
        stepwise_units_page,
        write_report,
    )
    from bench.record.recording import Run

    console, facts = Terminal(as_json=as_json), {}
    names = tuple(name.strip() for name in variables.split(",")) if variables else CANDIDATES
    gyros = (gyro,) if gyro else ()
    studies = study_units(runs, test or [], gyros, names, p_enter=p_enter, p_remove=p_remove)
    bench_name = Run.open(runs[0]).manifest.bench_name
    manifests = [Run.open(folder).manifest for folder in test or []]
    warnings = [f"Run {m.run_id} is {m.outcome}: {m.reason}" for m in manifests if m.outcome != "completed"]
    for unit, study in studies.items():
        folder = unit_folder(out, unit)
        with saved_together(folder) as part:
            study.chosen.compensation.save(part / "compensation.gyrocomp")
            page = stepwise_page(study, created_utc=utc_now(), bench_name=bench_name, warnings=warnings)
            write_report(part / "report.html", page)
        _print_equations(console, study)
        console.say(f"{study.equation.name}: {study.equation.compensation.equation()}")
        console.say(choice_sentence(study))
        console.say(expected_sentence(study))
        console.say_all((f"{name} left out: {why}" for name, why in study.left_out), style="yellow")
        for run in (*study.training, *study.tests):
            console.say_all((f"{run.run_id}: {remark}" for remark in run.remarks), style="yellow")
        console.say(f"files in {folder}")
        facts[unit] = _stepwise_facts(study) | {"folder": folder}
    if len(studies) > 1:
        write_report(
            out / "units.html", stepwise_units_page(studies, created_utc=utc_now(), bench_name=bench_name)
        )
        console.say(f"all units: {out / 'units.html'}")
    console.say_json("result", units=facts, warnings=warnings)


def _stepwise_facts(study: RlgStudy) -> dict[str, object]:
    """Return what was taken and why, what to expect, and the stability before and after on every test run."""
    keys = ("run_id", "before_dph", "after_dph", "improvement_pct", "promise", "inside")
    return {
        "chosen": study.chosen.name,
        "choice": study.choice,
        "equation": study.equation.compensation.equation(),
        "terms": list(study.equation.result.selected),
        "spread": study.spread,
        "promise": study.promise,
        "outlook": study.outlook,
        "left_out": dict(study.left_out),
        "tests": [{key: getattr(row, key) for key in keys} for row in study.chosen.judged],
    }


def _print_equations(console: Terminal, study: RlgStudy) -> None:
    """Print the regression equations, and how each does on every test run."""
    equations = []
    for variant in study.variants:
        rows, final = variant.judged, variant.result.final
        before = _mean([row.before_dph for row in rows], ".5f")
        after = _mean([row.after_dph for row in rows], ".5f")
        less = f"{variant.mean_improvement_pct:.1f}" if rows else "-"
        terms = ", ".join(variant.result.selected)
        equations.append((variant.name, terms, f"{final.r2:.4f}", f"{final.rmse:.5f}", before, after, less))
    heads = ("equation", "terms", "R²", "RMSE deg/h", "before deg/h", "after deg/h", "less by %")
    console.table(heads, equations, f"unit {study.unit_id}")
    if not study.tests:
        return
    ways = [way for way in study.everything if way is not study.variants[0]]
    short = [way.name.replace(",", " ").split()[0] for way in ways]
    table = Table("run", "differs by", "before", *short,
                  title="stability of 100 s means before, deg/h, and less by %")  # fmt: skip
    table.columns[0].overflow = "fold"
    for n, row in enumerate(study.chosen.judged):
        improvements = [f"{way.judged[n].improvement_pct:.1f}" for way in ways]
        table.add_row(row.run_id, row.differs, f"{row.before_dph:.5f}", *improvements)
    console.print(table)


def chamber_cycle(
    log: Annotated[Path, Argument(help="log of gyros and a temperature; see `gyrobench look` for formats")],
    mapping: Annotated[
        Path | None,
        Option(help="mapping file (TOML) that says which columns; default imu.gyro.x|y|z, imu.temperature"),
    ] = None,
    block: Annotated[int, Option(help="rows that make a mean", min=1)] = 25,
    out: Annotated[Path, Option(help="HTML report")] = Path("chamber-cycle.html"),
    as_json: Json = False,
) -> None:
    """Fit a recorded chamber cycle over temperature.

    Each axis is judged on the last leg of the cycle, which is not fitted.
    """
    from bench.analysis.rlg import load_chamber_cycle, study_chamber_cycle
    from bench.present.report import chamber_cycle_page, write_report
    from bench.record.recording import checksum

    console, study = Terminal(as_json=as_json), study_chamber_cycle(*load_chamber_cycle(log, mapping), block)
    page = chamber_cycle_page(study, source=log.name, checksum=checksum(log).sha256, created_utc=utc_now())
    write_report(out, page)
    rows = [
        (
            axis.axis,
            f"{axis.before.sigma:.4g} ({axis.before.rms:.4g})",
            f"{axis.after_static.sigma:.4g} ({axis.after_static.rms:.4g})",
            f"{axis.static_pct:.1f}",
            f"{axis.after_dynamic.sigma:.4g} ({axis.after_dynamic.rms:.4g})",
            f"{axis.dynamic_pct:.1f}",
        )
        for axis in study.axes
    ]
    heads = ("axis", "before", "T only", "gain %", "T, rate, past", "gain %")
    console.table(heads, rows, f"1 sigma (rms with the offset between legs) of {log.name} on its last leg")
    console.say_all(f"{axis.axis}: {axis.verdict}" for axis in study.axes)
    console.say_all((f"{name}: not judged: {why}" for name, why in study.failed), style="yellow")
    console.say_all(study.remarks, style="yellow")
    console.say(f"{out}")
    keys = ("axis", "before", "after_static", "after_dynamic", "static_pct", "dynamic_pct", "verdict")
    axes = [{key: getattr(axis, key) for key in keys} for axis in study.axes]
    console.say_json("result", axes=axes, failed=dict(study.failed), remarks=study.remarks, file=out)
