"""The report of a campaign: runs, the compensation fitted to them, and what it does on runs it never saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bench.present.report import _glossary as glossary
from bench.present.report._content import (
    CampaignContent,
    Comparison,
    CompensationSummary,
    ModelScore,
    RunSummary,
    Trace,
    ValidRange,
)
from bench.present.report._file import REPORT_FILE, write_report
from bench.present.report._numbers import DASH, known, moment, significant, with_unit
from bench.present.report._page import (
    Block,
    Definitions,
    Fact,
    Facts,
    Page,
    Section,
    Table,
    named,
    numbers,
    texts,
)
from bench.present.report._parts import made, warnings
from bench.present.report._plots import (
    bias_panels,
    model_chart,
    scale_factor_panels,
    trace_figure,
    trace_panels,
)
from bench.present.report._run_content import run_content
from bench.present.report._scores import by_model, by_run, model_table, run_matrix
from bench.present.report._tables import (
    checks_table,
    checksum_table,
    record_sections,
    runs_table,
    software_facts,
)
from bench.present.report._verdict import campaign_verdict, chosen_scores
from bench.record.recording import Run, checksum
from drivers.base.arrays import Array
from drivers.base.clock import utc_now

if TYPE_CHECKING:
    from bench.analysis.thermal import Study, ThermalRun

_UNITS = {"t_in": "degC", "t_out": "degC", "dt_60": "degC/min", "gradient": "degC"}


def write_study(study: Study, folders: Sequence[Path], out: Path, *, title: str) -> None:
    """Write the compensation, what is exported of it and the report of the runs to `out`, all or nothing."""
    from bench.analysis.common.state_file import saved_together
    from bench.analysis.export import NETWORK_FILE, export_study  # torch behind it is slow to import

    with saved_together(out, NETWORK_FILE) as part:
        path = export_study(study, part)
        content = _study_content(study, [Run.open(folder) for folder in folders], path, title)
        write_report(part / REPORT_FILE, campaign_page(content))


def _study_content(study: Study, runs: Sequence[Run], compensation_file: Path, title: str) -> CampaignContent:
    """Return what the report shows: runs with roles, traces and comparisons of the test runs, scores."""
    roles = {run.checksum: "training" for run in study.train}
    roles |= {run.checksum: "validation" for run in study.validation}
    if not study.judged_on_chosen:
        roles |= {run.checksum: "held out" for run in study.tests}
    contents = [run_content(run) for run in runs]
    checksums = [run.checksum for run in runs]
    summaries = [
        replace(content.summary, role=roles.get(checksum, ""), checksum=checksum)
        for content, checksum in zip(contents, checksums, strict=True)
    ]
    first = summaries[0]
    floors = [row.noise_floor_dph for row in study.scores[study.chosen] if row.noise_floor_dph is not None]
    return CampaignContent(
        title=title,
        bench_name=first.bench_name,
        created_utc=utc_now(),
        runs=summaries,
        traces=_traces(study, dict(zip(checksums, (content.traces for content in contents), strict=True))),
        scores=_model_scores(study),
        comparisons=[_comparison(study, index) for index in range(len(study.tests))],
        compensation=_compensation_summary(study, compensation_file),
        software=study.compensation.software,
        warnings=_study_warnings(study, summaries),
        noise_floor_dph=float(np.median(floors)) if floors else None,
        bench_file_sha256=first.bench_file_sha256,
        subject=f"Unit {study.compensation.unit_id}",
    )


def _traces(study: Study, traces: dict[str, Sequence[Trace]]) -> list[Trace]:
    shown = []
    for run in study.tests:
        gyro = run.meta.get("gyro")
        shown += [trace for trace in traces.get(run.checksum, ()) if trace.gyro in ("", gyro)]
    return shown


def _model_scores(study: Study) -> list[ModelScore]:
    return [
        ModelScore(
            model=model.name,
            run_id=row.run_id,
            stability_raw_dph=row.raw_stability_dph,
            stability_comp_dph=row.stability_dph,
            improvement_percent=row.improvement_pct,
            attainable_percent=row.oracle_pct,
            peak_dph=row.true_max_dph,
            sf_rms_ppm=row.sf_rms_ppm if row.sf_true_rms_ppm is None else row.sf_true_rms_ppm,
            sf_max_ppm=row.sf_max_ppm if row.sf_true_max_ppm is None else row.sf_true_max_ppm,
            sf_raw_rms_ppm=row.sf_raw_rms_ppm,
        )
        for model in study.selection
        for row in study.scores[model.name]
    ]


def _comparison(study: Study, index: int) -> Comparison:
    from bench.analysis.common.statistics import block_means

    run = study.tests[index]
    bias, sf = _drift(study, run)
    used = run.time_s >= run.reference[0]
    time_s = block_means(run.time_s[used])
    before_bias = None if run.bias_dph is None else _from_reference(run, run.bias_dph)
    before_sf = None if run.sf_error_ppm is None else _from_reference(run, run.sf_error_ppm)
    return Comparison(
        run_id=run.run_id,
        time_s=time_s,
        bias_before_dph=None if before_bias is None else block_means(before_bias[used]),
        bias_after_dph=None if before_bias is None else block_means((before_bias - bias)[used]),
        sf_before_ppm=None if before_sf is None else block_means(before_sf[used]),
        sf_after_ppm=None if before_sf is None else block_means((before_sf - sf)[used]),
        floor_dph=study.scores[study.chosen][index].noise_floor_dph,
    )


def _drift(study: Study, run: ThermalRun) -> tuple[Array, ...]:
    """Return the chosen model's bias and scale-factor drift every second, counted from the reference window."""
    from bench.analysis.thermal import prepare

    step = study.compensation.step_s
    prediction = study.models[study.chosen].predict(prepare(run, step_s=step))
    count = len(run.time_s)
    return tuple(
        _from_reference(run, np.repeat(values, step)[:count])
        for values in (prediction.bias_dph, prediction.sf_error_ppm)
    )


def _from_reference(run: ThermalRun, values: Array) -> Array:
    inside = (run.time_s > run.reference[0]) & (run.time_s <= run.reference[1])
    return np.asarray(values - np.nanmean(values[inside]))


def _compensation_summary(study: Study, path: Path) -> CompensationSummary:
    best, *others = study.selection
    reason = f"smallest error on the validation runs (left over / raw {best.score:.3f}"
    reason += f"; next {others[0].name} {others[0].score:.3f})" if others else ")"
    limits = study.compensation.limits
    return CompensationSummary(
        unit_id=study.compensation.unit_id,
        model=study.chosen,
        reason=reason,
        training_runs={run.run_id: run.checksum for run in study.train},
        validation_runs={run.run_id: run.checksum for run in study.validation},
        valid_ranges=[
            ValidRange(name, float(low), float(high), _UNITS[name])
            for name, (low, high) in limits.inputs.items()
        ],
        file_name=path.name,
        file_sha256=checksum(path).sha256,
    )


def _study_warnings(study: Study, summaries: Sequence[RunSummary]) -> list[str]:
    warnings = [f"{summary.run_id}: {text}" for summary in summaries for text in summary.warnings]
    if study.judged_on_chosen:
        warnings.append(
            "No test runs were given: the figures are on the runs that chose the model and flatter it."
        )
    return warnings


def campaign_page(content: CampaignContent) -> Page:
    """Return the report of a campaign."""
    return Page(
        title=content.title,
        kind="Thermal compensation report"
        + (", emulated bench" if any(run.emulated for run in content.runs) else ""),
        facts=_header(content),
        verdict=campaign_verdict(content),
        sections=_sections(content),
        colophon=made(content.created_utc, "Times are UTC; 1σ is a sample standard deviation."),
    )


def _header(content: CampaignContent) -> list[Fact]:
    units = list(dict.fromkeys(unit for run in content.runs for unit in run.units.values()))
    subject = content.subject or (content.compensation.unit_id if content.compensation else ", ".join(units))
    started = sorted(run.started_utc for run in content.runs if run.started_utc)
    period = " to ".join(dict.fromkeys(moment(utc) for utc in (started[:1] + started[-1:]))) or DASH
    facts = [
        Fact("Unit under test", subject or DASH),
        Fact("Procedures", ", ".join(dict.fromkeys(run.procedure for run in content.runs)) or DASH),
        Fact("Bench", content.bench_name),
        Fact("Runs started", period),
        Fact("Report made", moment(content.created_utc)),
    ]
    operators = content.operator or ", ".join(
        dict.fromkeys(run.operator for run in content.runs if run.operator)
    )
    described = [run.emulated.rpartition(", seed ") for run in content.runs if run.emulated]
    models = dict.fromkeys(model for model, _, _ in described)
    seeds = {model: [seed for other, _, seed in described if other == model] for model in models}
    emulated = "; ".join(
        f"{model}, seed {those[0]}" + (f" to {those[-1]}" if those[-1] != those[0] else "")
        for model, those in seeds.items()
    )
    optional = (("Operator", operators), ("Emulated devices", emulated))
    return facts + [Fact(label, text) for label, text in optional if text]


def _sections(content: CampaignContent) -> list[Section]:
    models = by_model(content.scores)
    chosen_name = content.compensation.model if content.compensation else ""
    chosen = by_run(chosen_scores(content))
    remarks = [
        *content.warnings,
        *(f"Run {run.run_id}: {text}" for run in content.runs for text in run.warnings),
    ]
    bias = bias_panels("bias", content.comparisons, chosen)
    checksums = {run.run_id: run.checksum for run in content.runs if run.checksum}
    provenance = software_facts(content.software, content.bench_file_sha256)
    provenance += checksum_table(checksums, "Checksums of the runs.")
    return [
        warnings(remarks),
        Section("Runs", [*runs_table(content.runs), *checks_table(content.runs)]),
        Section("Temperature and output", _course(content)),
        Section("Bias before and after", bias, _held_out_intro(content, bool(bias))),
        Section(
            "Scale factor before and after", scale_factor_panels("scale-factor", content.comparisons, chosen)
        ),
        Section(
            "Models",
            [
                *model_chart("models", models, chosen_name),
                *model_table(models, chosen_name),
                *run_matrix(models, chosen_name),
            ],
        ),
        Section("Compensation", _compensation(content.compensation)),
        *record_sections(content.runs, provenance),
        Section("Definitions", [Definitions(terms)] if (terms := _terms(content)) else []),
    ]


def _course(content: CampaignContent) -> list[Block]:
    """One run in full, the others small: the first one that the compensation was judged on, or the first."""
    if not content.traces:
        return []
    judged = {comparison.run_id for comparison in content.comparisons}
    main = next((trace for trace in content.traces if trace.run_id in judged), content.traces[0])
    others = [trace for trace in content.traces if trace is not main]
    return [*trace_figure("trace", main), *trace_panels("course", others)]


def _held_out_intro(content: CampaignContent, shown: bool) -> str:
    if not shown or content.compensation is None:
        return ""
    return (
        f"What model {content.compensation.model} leaves on runs that had no part in fitting or choosing it. The "
        "model is causal: at every moment it knows the temperatures up to then and nothing else."
    )


def _compensation(compensation: CompensationSummary | None) -> list[Block]:
    if compensation is None:
        return []
    facts = [Fact("Model", compensation.model), Fact("Unit", compensation.unit_id)]
    optional = (
        ("Why this model", compensation.reason, False),
        ("File", compensation.file_name, False),
        ("File, SHA-256", compensation.file_sha256, True),
    )
    facts += [Fact(label, text, code) for label, text, code in optional if text]
    blocks: list[Block] = [Facts(facts)]
    if compensation.valid_ranges:
        rows = [
            named(
                item.name,
                with_unit(significant(item.low), item.unit),
                with_unit(significant(item.high), item.unit),
            )
            for item in compensation.valid_ranges
        ]
        caption = "Where the compensation is valid. Outside it says so and is not to be used."
        blocks.append(Table(texts("Input") + numbers("From", "To"), rows, caption))
    blocks += checksum_table(compensation.training_runs, "Runs the model was fitted on.")
    blocks += checksum_table(compensation.validation_runs, "Runs the model was chosen on.")
    return blocks


def _terms(content: CampaignContent) -> list[tuple[str, str]]:
    terms = []
    if content.scores:
        terms += [glossary.STABILITY, glossary.IMPROVEMENT, glossary.ATTAINABLE]
        terms += [glossary.HELD_OUT, glossary.PEAK]
    if known(content.noise_floor_dph) or any(known(item.floor_dph) for item in content.comparisons):
        terms.append(glossary.FLOOR)
    if any(known(score.sf_rms_ppm) for score in content.scores):
        terms.append(glossary.SCALE_FACTOR)
    if any(run.streams for run in content.runs):
        terms += [glossary.LOST, glossary.CLOCK]
    return terms
