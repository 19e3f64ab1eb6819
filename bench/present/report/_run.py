"""The report of one run, before or without any fit."""

from __future__ import annotations

from pathlib import Path

from bench.present.report._budget import TERM, budget_table
from bench.present.report._file import REPORT_FILE, write_report
from bench.present.report._glossary import CLOCK, LOST
from bench.present.report._numbers import DASH, duration, moment, parameter, significant, unit_text
from bench.present.report._page import Block, Definitions, Fact, Facts, Headline, Page, Section, Verdict
from bench.present.report._parts import made, warnings
from bench.present.report._plots import trace_figure
from bench.present.report._run_content import RunContent, run_content
from bench.present.report._run_notes import notes_blocks
from bench.present.report._series import series_blocks
from bench.present.report._tables import (
    checksum_table,
    limited,
    measured,
    measurements_table,
    outcome,
    record_sections,
    software_facts,
)
from bench.record.recording import Run
from bench.record.run_folder import MANIFEST_FILE, is_run, url_of
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError

_SENTENCES = {
    "completed": "The run was completed and met the criteria of its procedure.",
    "invalid": "The run was completed but missed a criterion of its procedure. Its data are kept; it must not "
    "be used for a compensation.",
    "aborted": "The run was stopped before its end; everything received until then was kept.",
    "running": "The run was never closed; what was written until then is shown.",
}


_NOTES = {None: "", True: "inside its limits", False: "✕ outside its limits"}


def run_page(run: RunContent, created_utc: str = "") -> Page:
    """Return the report of one run."""
    return Page(
        title=f"Run {run.run_id}",
        kind="Test run report" + (", emulated bench" if run.emulated else ""),
        facts=_header(run),
        verdict=_verdict(run),
        sections=_sections(run),
        colophon=made(created_utc, "Figures are computed from the run's record; times are UTC."),
    )


def report_run(folder: Path, out: Path | None = None) -> Path:
    """Write the report of a run folder, beside it unless `out` says where, and return its path."""
    if not is_run(folder):
        raise ConfigurationError(
            "no run to report on",
            where=str(folder),
            found=f"no {MANIFEST_FILE}",
            expected="a run folder",
            remedy="`gyrobench fit` writes the report of a fit into its own folder",
        )
    page = run_page(run_content(Run.open(folder), with_budgets=True), utc_now())
    return write_report(out or (Path(folder.name) if url_of(folder) else folder) / REPORT_FILE, page)


def _header(run: RunContent) -> list[Fact]:
    manifest = run.manifest
    return [
        Fact("Procedure", manifest.procedure),
        Fact(
            "Unit under test", ", ".join(f"{unit} ({name})" for name, unit in manifest.units.items()) or DASH
        ),
        Fact("Bench", manifest.bench_name or DASH),
        Fact("Started", moment(manifest.started_utc)),
        Fact("Duration", duration(manifest.duration_s)),
        Fact("Mounting", manifest.mounting.replace("_", " ")),
        Fact("Operator", run.operator),
        Fact("Emulated devices", run.emulated),
    ]


def _verdict(run: RunContent) -> Verdict:
    if run.changed:
        return Verdict(
            "Record changed", "bad", ["The manifest is not the one that was sealed: nothing counts."]
        )
    word, tone = outcome(run)
    judged = [item for item in run.measurements if limited(item)]
    headlines = [
        Headline(measured(item.name), significant(item.value), unit_text(item.unit), "", _NOTES[item.passed])
        for item in judged[:4]
    ]
    return Verdict(f"Run {word}", tone, [_SENTENCES[run.manifest.outcome], *run.reasons], headlines)


def _budget_tables(run: RunContent) -> list[Block]:
    units = {item.name: item.unit for item in run.measurements}
    tables = [budget_table(measured(name), budget, units[name]) for name, budget in run.budgets.items()]
    return [*tables, Definitions([TERM])] if tables else []


def _sections(run: RunContent) -> list[Section]:
    figures: list[Block] = []
    for number, trace in enumerate(run.traces, start=1):
        figures += trace_figure(f"trace-{number}", trace)
    parameters = [Fact(*parameter(name, value)) for name, value in run.manifest.parameters.items()]
    caption = "Checksum of the run's manifest, which holds those of all its files."
    provenance = software_facts(run.manifest.software, run.manifest.bench_file_sha256)
    provenance += checksum_table({run.run_id: run.checksum} if run.checksum else {}, caption)
    return [
        warnings(run.warnings),
        Section("Notes", notes_blocks(run.notes)),
        Section("Course of the run", figures),
        Section("Measurements", measurements_table(run.measurements, run.budgets)),
        Section("Uncertainty budgets", _budget_tables(run)),
        Section("Worked out by the procedure", series_blocks(run.series)),
        Section("Parameters", [Facts(parameters)]),
        *record_sections([run], provenance, [Definitions([LOST, CLOCK])]),
    ]
