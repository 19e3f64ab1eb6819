"""What every gap report has about its content: title, facts, provenance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from bench.present.report._numbers import moment
from bench.present.report._page import Fact, Page, Section, Verdict
from bench.present.report._tables import checksum_table

if TYPE_CHECKING:
    from bench.analysis.gap import Diagnosis


def gap_frame(
    diagnosis: Diagnosis,
    verdict: Verdict,
    sections: Sequence[Section],
    terms: Sequence[tuple[str, str]],
    *,
    created_utc: str,
    model_file: str,
    floor_source: str = "",
) -> Page:
    """Return a page with the runs diagnosed at its end; `floor_source` where one floor serves all."""
    floor = [Fact("Noise floor from", floor_source)] if floor_source else []
    return Page(
        title=f"Simulation against bench: unit {diagnosis.unit_id}",
        kind="Sim-to-real gap report",
        facts=[
            Fact("Unit under test", diagnosis.unit_id),
            Fact("Nominal model", model_file),
            Fact("Runs", str(len(diagnosis.run_checksums))),
            *floor,
            Fact("Report made", moment(created_utc)),
        ],
        verdict=verdict,
        sections=[
            *sections,
            Section("Provenance", checksum_table(diagnosis.run_checksums, "Runs diagnosed, by checksum.")),
        ],
        terms=terms,
        colophon="All figures are computed from the runs and the model named above; times are UTC.",
    )
