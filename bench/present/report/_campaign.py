"""The report of a campaign: runs, the compensation fitted to them, and what it does on runs it never saw."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bench.present.report import _glossary as glossary
from bench.present.report import _scores as models
from bench.present.report._file import REPORT_FILE, write_report
from bench.present.report._numbers import known, moment, significant, with_unit
from bench.present.report._page import Block, Fact, Facts, Headline, Page, Section, Table, Verdict, named
from bench.present.report._parts import made, warnings
from bench.present.report._plots import (
    Comparison,
    before_after_panels,
    model_chart,
    trace_figure,
    trace_panels,
)
from bench.present.report._run_content import RunContent, run_content
from bench.present.report._tables import (
    checks_table,
    checksum_table,
    record_sections,
    runs_table,
    software_facts,
)
from bench.record.recording import Run, checksum
from drivers.base.arrays import Array
from drivers.base.clock import utc_now

if TYPE_CHECKING:
    from bench.analysis.thermal import Scores, Study, ThermalRun

_UNITS = {"t_in": "degC", "t_out": "degC", "dt_60": "degC/min", "gradient": "degC"}


def write_study(study: Study, folders: Sequence[Path], out: Path, *, title: str) -> None:
    """Write the compensation, what is exported of it and the report of the runs to `out`, all or nothing."""
    from bench.analysis.common.state_file import saved_together
    from bench.analysis.export import NETWORK_FILE, export_study  # torch behind it is slow to import

    roles = {run.checksum: "training" for run in study.train}
    roles |= {run.checksum: "validation" for run in study.validation}
    if not study.judged_on_chosen:
        roles |= {run.checksum: "held out" for run in study.tests}
    with saved_together(out, NETWORK_FILE) as part:
        path = export_study(study, part)
        opened = [Run.open(folder) for folder in folders]
        runs = [run_content(run, roles.get(run.checksum, "")) for run in opened]
        page = campaign_page(study, runs, comparisons(study), path, title=title, created_utc=utc_now())
        write_report(part / REPORT_FILE, page)


def comparisons(study: Study) -> list[Comparison]:
    """Return the runs that the chosen model is judged on, before and after it."""
    judged = zip(study.tests, study.scores[study.chosen], strict=True)
    return [_comparison(study, run, score) for run, score in judged]


def _comparison(study: Study, run: ThermalRun, score: Scores) -> Comparison:
    """Values of every second counted from the reference window, as means of 100 s."""
    from bench.analysis.common.statistics import block_means
    from bench.analysis.thermal import prepare

    step = study.compensation.step_s
    prediction = study.models[study.chosen].predict(prepare(run, step_s=step))
    unit, values, drift, note = "°/h", run.bias_dph, prediction.bias_dph, ""
    if known(score.stability_dph):
        note = f"1σ {significant(score.raw_stability_dph)} → {significant(score.stability_dph)} °/h"
    if run.sf_error_ppm is not None:
        unit, values, drift = "ppm", run.sf_error_ppm, prediction.sf_error_ppm
        raw = f"{significant(score.sf_raw_rms_ppm)} → " if known(score.sf_raw_rms_ppm) else ""
        note = f"rms {raw}{significant(models.sf_rms_ppm(score), 2)} ppm"
    assert values is not None
    before = _from_reference(run, values)
    after = before - _from_reference(run, np.repeat(drift, step)[: len(run.time_s)])
    time_s, before, after = (
        block_means(every_s[run.time_s >= run.reference[0]]) for every_s in (run.time_s, before, after)
    )
    return Comparison(run.run_id, time_s, unit, before, after, note, score.noise_floor_dph)


def _from_reference(run: ThermalRun, values: Array) -> Array:
    inside = (run.time_s > run.reference[0]) & (run.time_s <= run.reference[1])
    return np.asarray(values - np.nanmean(values[inside]))


def campaign_page(
    study: Study,
    runs: Sequence[RunContent],
    compared: Sequence[Comparison],
    compensation_file: Path,
    *,
    title: str,
    created_utc: str,
) -> Page:
    """Return the report of a campaign; `runs` took part in the study, its compensation is in a file."""
    floors = [
        score.noise_floor_dph for score in study.scores[study.chosen] if score.noise_floor_dph is not None
    ]
    floor_dph = float(np.median(floors)) if floors else None
    ranked = models.ranked(study)
    remarks = [f"{run.run_id}: {text}" for run in runs for text in run.warnings] + study.remarks
    remarks += [text for score in study.scores[study.chosen] if (text := models.outside_sentence(score))]
    if study.judged_on_chosen:
        remarks.append(
            "No test runs were given: the figures are on the runs that chose the model and flatter it."
        )
    intro = (
        f"What model {study.chosen} leaves on runs that had no part in fitting or choosing it. The model is "
        "causal: at every moment it knows the temperatures up to then and nothing else."
    )
    provenance = software_facts(study.compensation.software, runs[0].manifest.bench_file_sha256)
    provenance += checksum_table({run.run_id: run.checksum for run in runs}, "Checksums of the runs.")
    return Page(
        title=title,
        kind="Thermal compensation report"
        + (", emulated bench" if any(run.emulated for run in runs) else ""),
        facts=_header(study, runs, created_utc),
        verdict=_verdict(study, runs, floor_dph),
        sections=[
            warnings(remarks),
            Section("Runs", [*runs_table(runs), *checks_table(runs)]),
            Section("Temperature and output", _course(study, runs)),
            Section("Bias before and after", before_after_panels(compared, "°/h"), intro),
            Section("Scale factor before and after", before_after_panels(compared, "ppm")),
            Section(
                "Models",
                [
                    *model_chart(ranked, study.chosen),
                    *models.model_table(ranked, study.chosen),
                    *models.run_matrix(ranked, study.chosen),
                ],
            ),
            Section("Compensation", _compensation(study, compensation_file)),
            *record_sections(runs, provenance),
        ],
        terms=_terms(study, runs, floor_dph),
        colophon=made(created_utc, "Times are UTC; 1σ is a sample standard deviation."),
    )


def _header(study: Study, runs: Sequence[RunContent], created_utc: str) -> list[Fact]:
    started = sorted(run.manifest.started_utc for run in runs)
    period = " to ".join(dict.fromkeys(moment(utc) for utc in (started[0], started[-1])))
    seeds: dict[str, list[int]] = {}
    for lab in (run.manifest.emulated for run in runs):
        if lab is not None:
            seeds.setdefault(lab.model, []).append(lab.seed)
    emulated = "; ".join(
        f"{model}, seed {those[0]}" + (f" to {those[-1]}" if those[-1] != those[0] else "")
        for model, those in seeds.items()
    )
    return [
        Fact("Unit under test", f"Unit {study.compensation.unit_id}"),
        Fact("Procedures", ", ".join(dict.fromkeys(run.manifest.procedure for run in runs))),
        Fact("Bench", runs[0].manifest.bench_name),
        Fact("Runs started", period),
        Fact("Report made", moment(created_utc)),
        Fact("Operator", ", ".join(dict.fromkeys(run.operator for run in runs if run.operator))),
        Fact("Emulated devices", emulated),
    ]


def _verdict(study: Study, runs: Sequence[RunContent], floor_dph: float | None) -> Verdict:
    """Good: all runs valid, and less drift left on held-out runs."""
    scores = study.scores[study.chosen]
    valid, tone = sum(run.valid for run in runs), models.judged(scores)
    word, sentences = f"Compensated by {study.chosen}", [models.sentence(study)]
    if invalid := len(runs) - valid:
        word += f"; {valid} of {len(runs)} runs valid"
        missed = "One run is" if invalid == 1 else f"{invalid} runs are"
        sentences.append(f"{missed} not valid; the table of runs gives the reasons.")
        tone = "bad" if tone == "bad" or not valid else "doubt"
    headlines = [Headline("Valid runs", f"{valid} of {len(runs)}"), *models.headlines(scores, floor_dph)]
    return Verdict(word, tone, sentences, headlines)


def _course(study: Study, runs: Sequence[RunContent]) -> list[Block]:
    """The first run that the compensation was judged on in full, the others small."""
    contents = {run.checksum: run.traces for run in runs}
    traces = [
        trace
        for run in study.tests
        for trace in contents.get(run.checksum, ())
        if trace.gyro in ("", run.meta.get("gyro"))
    ]
    return [*trace_figure("trace", traces[0]), *trace_panels("course", traces[1:])] if traces else []


def _compensation(study: Study, path: Path) -> list[Block]:
    best, *others = study.selection
    where = f"on {best.left_out} runs, each left out in turn" if best.left_out else "on the validation runs"
    reason = f"smallest error {where} (left over / raw {best.score:.3f}"
    if best.parts:
        reason = f"mean of {', '.join(best.parts)}, between which the runs do not decide: {reason}"
    reason += f"; next {others[0].name} {others[0].score:.3f})" if others else ")"
    facts = [
        Fact("Model", study.chosen),
        Fact("Unit", study.compensation.unit_id),
        Fact("Why this model", reason),
        Fact("File", path.name),
        Fact("File, SHA-256", checksum(path).sha256, code=True),
    ]
    rows = [
        named(name, *(with_unit(significant(float(end)), _UNITS[name]) for end in interval))
        for name, interval in study.compensation.limits.inputs.items()
    ]
    caption = "Where the compensation is valid. Outside it says so and is not to be used."
    training, validation = (
        {run.run_id: run.checksum for run in of} for of in (study.train, study.validation)
    )
    return [
        Facts(facts),
        Table(["Input", ">From", ">To"], rows, caption),
        *checksum_table(training, "Runs the model was fitted on."),
        *checksum_table(validation, "Runs the model was chosen on."),
    ]


def _terms(study: Study, runs: Sequence[RunContent], floor_dph: float | None) -> list[tuple[str, str]]:
    terms = [glossary.STABILITY, glossary.IMPROVEMENT, glossary.ATTAINABLE, glossary.HELD_OUT, glossary.PEAK]
    if known(floor_dph):
        terms.append(glossary.FLOOR)
    if any(known(models.sf_rms_ppm(score)) for scores in study.scores.values() for score in scores):
        terms.append(glossary.SCALE_FACTOR)
    if any(run.manifest.stream for run in runs):
        terms += [glossary.LOST, glossary.CLOCK]
    return terms
