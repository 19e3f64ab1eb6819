"""The report of a campaign: runs, the compensation fitted to them, and what it does on runs it never saw."""

from __future__ import annotations

from bench.present.report import _glossary as glossary
from bench.present.report._content import CampaignContent, CompensationSummary
from bench.present.report._layout import render_page
from bench.present.report._numbers import DASH, known, moment, significant, with_unit
from bench.present.report._page import (
    Block,
    Column,
    Definitions,
    Fact,
    Facts,
    Page,
    Section,
    Table,
)
from bench.present.report._parts import made, named, warnings
from bench.present.report._plots import (
    bias_panels,
    model_chart,
    scale_factor_panels,
    trace_figure,
    trace_panels,
)
from bench.present.report._scores import by_model, by_run, model_table, run_matrix
from bench.present.report._tables import (
    checks_table,
    checksum_table,
    devices_table,
    runs_table,
    software_facts,
    streams_table,
)
from bench.present.report._verdict import campaign_verdict, chosen_scores


def render_campaign(content: CampaignContent) -> str:
    """Return the report of a campaign as a self-contained HTML file."""
    page = Page(
        title=content.title,
        kind="Thermal compensation report"
        + (", emulated bench" if any(run.emulated for run in content.runs) else ""),
        facts=_header(content),
        verdict=campaign_verdict(content),
        sections=_sections(content),
        colophon=made(content.created_utc, "Times are UTC; 1σ is a sample standard deviation."),
    )
    return render_page(page)


def _header(content: CampaignContent) -> list[Fact]:
    units = list(dict.fromkeys(unit for run in content.runs for unit in run.units.values()))
    subject = content.subject or (content.compensation.unit_id if content.compensation else ", ".join(units))
    started = sorted(run.started_utc for run in content.runs if run.started_utc)
    period = (
        " to ".join(dict.fromkeys(moment(each) for each in (started[0], started[-1]))) if started else DASH
    )
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
        f"{model}, seed {found[0]}" + (f" to {found[-1]}" if len(found) > 1 else "")
        for model, found in seeds.items()
    )
    facts += [
        Fact(label, text) for label, text in (("Operator", operators), ("Emulated devices", emulated)) if text
    ]
    return facts


def _sections(content: CampaignContent) -> list[Section]:
    models = by_model(content.scores)
    chosen_name = content.compensation.model if content.compensation else ""
    chosen = by_run(chosen_scores(content))
    remarks = [
        *content.warnings,
        *(f"Run {run.run_id}: {text}" for run in content.runs for text in run.warnings),
    ]
    bias = bias_panels("bias", content.comparisons, chosen)
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
        Section("Streams", streams_table(content.runs)),
        Section("Devices", devices_table(content.runs)),
        Section(
            "Provenance",
            [
                *software_facts(content.software, content.bench_file_sha256),
                *checksum_table(
                    {run.run_id: run.checksum for run in content.runs if run.checksum},
                    "Checksums of the runs.",
                ),
            ],
        ),
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
        heads = [Column("Input"), Column("From", number=True), Column("To", number=True)]
        blocks.append(
            Table(heads, rows, "Where the compensation is valid. Outside it says so and is not to be used.")
        )
    blocks += checksum_table(compensation.training_runs, "Runs the model was fitted on.")
    blocks += checksum_table(compensation.validation_runs, "Runs the model was chosen on.")
    return blocks


def _terms(content: CampaignContent) -> list[tuple[str, str]]:
    terms = []
    if content.scores:
        terms += [
            glossary.STABILITY,
            glossary.IMPROVEMENT,
            glossary.ATTAINABLE,
            glossary.HELD_OUT,
            glossary.PEAK,
        ]
    if known(content.noise_floor_dph) or any(known(item.floor_dph) for item in content.comparisons):
        terms.append(glossary.FLOOR)
    if any(known(score.sf_rms_ppm) for score in content.scores):
        terms.append(glossary.SCALE_FACTOR)
    if any(run.streams for run in content.runs):
        terms += [glossary.LOST, glossary.CLOCK]
    return terms
