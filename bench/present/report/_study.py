"""From a study of cold shocks to the report: runs, compensation, and what it does on runs it never saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bench.present.report._campaign import render_campaign
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
from bench.present.report._run_content import run_content
from bench.record.recording import Run, checksum
from drivers.base.arrays import Array
from drivers.base.clock import utc_now

if TYPE_CHECKING:
    from bench.analysis.thermal import Scores, Study, ThermalRun

_UNITS = {"t_in": "degC", "t_out": "degC", "dt_60": "degC/min", "gradient": "degC"}
_BLOCK_S = 100


def write_study(study: Study, folders: Sequence[Path], out: Path, *, title: str) -> None:
    """Write the compensation, what is exported of it and the report of the runs to `out`, all or nothing."""
    from bench.analysis.common.state_file import saved_together
    from bench.analysis.export import NETWORK_FILE, export_study  # torch behind it is slow to import

    with saved_together(out, NETWORK_FILE) as part:
        path = export_study(study, part)
        content = _study_content(study, [Run.open(folder) for folder in folders], path, title)
        write_report(part / REPORT_FILE, render_campaign(content))


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
    ordered = [score.name for score in study.selection]
    return [_model_score(name, row) for name in ordered for row in study.scores[name]]


def _model_score(name: str, row: Scores) -> ModelScore:
    return ModelScore(
        model=name,
        run_id=row.run_id,
        stability_raw_dph=row.raw_stability_dph,
        stability_comp_dph=row.stability_dph,
        improvement_percent=row.improvement_pct,
        attainable_percent=row.oracle_pct,
        peak_dph=row.true_max_dph,
        sf_rms_ppm=row.sf_true_rms_ppm if row.sf_true_rms_ppm is not None else row.sf_rms_ppm,
        sf_max_ppm=row.sf_true_max_ppm if row.sf_true_max_ppm is not None else row.sf_max_ppm,
        sf_raw_rms_ppm=row.sf_raw_rms_ppm,
    )


def _comparison(study: Study, index: int) -> Comparison:
    from bench.analysis.common.statistics import block_means

    run = study.tests[index]
    bias, sf = _drift(study, run)
    used = run.time_s >= run.reference[0]
    time_s = block_means(run.time_s[used])
    floor = study.scores[study.chosen][index].noise_floor_dph
    before_bias = None if run.bias_dph is None else _from_reference(run, run.bias_dph)
    before_sf = None if run.sf_error_ppm is None else _from_reference(run, run.sf_error_ppm)
    return Comparison(
        run_id=run.run_id,
        time_s=time_s,
        bias_before_dph=None if before_bias is None else block_means(before_bias[used]),
        bias_after_dph=None if before_bias is None else block_means((before_bias - bias)[used]),
        sf_before_ppm=None if before_sf is None else block_means(before_sf[used]),
        sf_after_ppm=None if before_sf is None else block_means((before_sf - sf)[used]),
        floor_dph=floor,
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
