"""The test certificate: per unit under test every figure against its limits, and what each run is worth.

A unit passes when every planned run of it was completed and its record verified, every figure with a limit was
measured, and every value lies inside. Whatever is missing is a reason against, never left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from bench.present.report import _glossary as glossary
from bench.present.report import _parts as parts
from bench.present.report._numbers import DASH, moment, significant, unit_text
from bench.present.report._page import (
    Block,
    Cell,
    Fact,
    Headline,
    Notes,
    Page,
    Section,
    Table,
    Tone,
    Verdict,
    named,
)
from bench.present.report._run_content import RunContent
from bench.present.report._tables import (
    checks_table,
    checksum_table,
    limits_text,
    record_sections,
    runs_table,
    software_facts,
)

Judgement = Literal["pass", "fail", "not measured", "not judged"]
UnitVerdict = Literal["passed", "not passed", "not judged"]

_TONES: Mapping[str, Tone] = {
    "pass": "good",
    "passed": "good",
    "fail": "bad",
    "not passed": "bad",
    "not measured": "bad",
    "not judged": "doubt",
}
_TERMS = [
    (
        "Decision rule",
        "Simple acceptance (ISO/IEC Guide 98-4): the value measured lies inside the limits, the limits included. "
        "An interval that reaches beyond them is marked.",
    ),
    ("Value", "Of several runs the one nearest to failing: the largest magnitude where there is no limit."),
    (
        "Verified",
        "Checksums of the run's files recomputed, its tables rebuilt from the raw bytes: all equal.",
    ),
    *glossary.STANDARD_BIAS,
]


@dataclass(frozen=True)
class CertifiedFigure:
    """A figure of one unit. `values`: run id -> value; `low`, `high`: 95 % interval of the value shown."""

    name: str
    unit: str
    values: Mapping[str, float]
    lower_limit: float | None = None
    upper_limit: float | None = None
    low: float | None = None
    high: float | None = None

    @property
    def limited(self) -> bool:
        """Whether there is a limit to judge by."""
        return self.lower_limit is not None or self.upper_limit is not None

    @property
    def value(self) -> float | None:
        """The value nearest to failing, None when there is none; one that is not a number is nearest."""
        return max(self.values.values(), key=self._nearness, default=None)

    @property
    def judgement(self) -> Judgement:
        """What the limits say."""
        if not self.values:
            return "not measured" if self.limited else "not judged"
        if not self.limited:
            return "not judged"
        return "pass" if all(self._inside(value) for value in self.values.values()) else "fail"

    @property
    def doubtful(self) -> bool:
        """Whether the interval of a value inside the limits reaches beyond them."""
        ends = [end for end in (self.low, self.high) if end is not None]
        return self.judgement == "pass" and not all(self._inside(end) for end in ends)

    def _inside(self, value: float) -> bool:
        above = self.lower_limit is None or value >= self.lower_limit
        below = self.upper_limit is None or value <= self.upper_limit
        return math.isfinite(value) and above and below

    def _nearness(self, value: float) -> float:
        if not math.isfinite(value):
            return math.inf
        if not self.limited:
            return abs(value)
        above = -math.inf if self.upper_limit is None else value - self.upper_limit
        below = -math.inf if self.lower_limit is None else self.lower_limit - value
        return max(above, below)


@dataclass(frozen=True)
class UnitCertificate:
    """A unit under test: its figures, and `against`, every reason why it cannot pass."""

    unit_id: str
    figures: Sequence[CertifiedFigure]
    against: Sequence[str] = ()

    @property
    def verdict(self) -> UnitVerdict:
        """The unit's verdict; without any limit nothing was judged."""
        judged = [figure.judgement for figure in self.figures if figure.limited]
        if self.against or any(judgement != "pass" for judgement in judged):
            return "not passed"
        return "passed" if judged else "not judged"


@dataclass(frozen=True)
class CertificateContent:
    """Everything a certificate shows. `checks`: run id -> "verified" or what is wrong with its record."""

    title: str
    created_utc: str
    units: Sequence[UnitCertificate]
    runs: Sequence[RunContent] = ()
    checks: Mapping[str, str] = field(default_factory=dict)
    figures: Sequence[Block] = ()
    warnings: Sequence[str] = ()
    limits_from: str = ""
    limits_sha256: str = ""

    @property
    def verdict(self) -> UnitVerdict:
        """The worst of the units' verdicts; no unit at all is not a pass."""
        verdicts = {unit.verdict for unit in self.units}
        if not verdicts or "not passed" in verdicts:
            return "not passed"
        return "not judged" if "not judged" in verdicts else "passed"


def certificate_page(content: CertificateContent) -> Page:
    """Return the certificate."""
    first = content.runs[0] if content.runs else None
    started = min((run.manifest.started_utc for run in content.runs), default="")
    emulated = any(run.emulated for run in content.runs)
    facts = [
        Fact("Units under test", ", ".join(unit.unit_id for unit in content.units) or DASH),
        Fact("Bench", (first.manifest.bench_name if first else "") or DASH),
        Fact("Procedures", ", ".join(dict.fromkeys(run.manifest.procedure for run in content.runs)) or DASH),
        Fact("First run started", moment(started)),
        Fact("Operator", ", ".join(dict.fromkeys(r.operator for r in content.runs if r.operator)) or DASH),
        Fact("Limits", content.limits_from or "none given"),
    ]
    return Page(
        title=content.title,
        kind="Test certificate" + (", emulated bench: not valid for a real unit" if emulated else ""),
        facts=facts,
        verdict=_verdict(content),
        sections=[
            *(Section(f"Unit {unit.unit_id}", _unit(unit)) for unit in content.units),
            parts.warnings(
                [*content.warnings, *(f"Run {r.run_id}: {t}" for r in content.runs for t in r.warnings)]
            ),
            Section("Runs", [*runs_table(content.runs), *checks_table(content.runs)]),
            Section("Records", _checks(content)),
            Section("Figures", content.figures),
            *record_sections(content.runs, _provenance(content)),
        ],
        terms=_TERMS,
        colophon=parts.made(content.created_utc, parts.OF_RUNS),
    )


def _verdict(content: CertificateContent) -> Verdict:
    word = content.verdict
    sentences = {
        "passed": "Every figure with a limit was measured and lies inside; every run is complete and verified.",
        "not passed": "Not every condition for a pass is met; the reasons stand with each unit.",
        "not judged": "No limits were given: figures are reported, nothing was judged.",
    }
    headlines = [
        Headline(
            unit.unit_id,
            unit.verdict,
            note=f"{sum(f.judgement == 'pass' for f in unit.figures)} of "
            f"{sum(f.limited for f in unit.figures)} limits met",
        )
        for unit in content.units
    ]
    return Verdict(word.capitalize(), _TONES[word], [sentences[word]], headlines)


def _unit(unit: UnitCertificate) -> list[Block]:
    heads = ["Figure", ">Value", "Unit", ">95 % interval", ">Over runs", ">Limits", "Verdict"]
    caption = f"Test summary of unit {unit.unit_id}."
    return [
        Notes(unit.against, "bad"),
        Table(heads, [named(f.name, *_cells(f)) for f in unit.figures], caption),
    ]


def _cells(figure: CertifiedFigure) -> list[Cell]:
    judgement = figure.judgement
    text = judgement + (", interval beyond limit" if figure.doubtful else "")
    tone = "doubt" if figure.doubtful else _TONES[judgement]
    spread = sorted(figure.values.values())
    over = (
        f"{significant(spread[0])} … {significant(spread[-1])} ({len(spread)})" if len(spread) > 1 else DASH
    )
    return [
        Cell(significant(figure.value, 7 if figure.name == "scale factor" else 4)),
        Cell(unit_text(figure.unit) or DASH),
        Cell(parts.interval(figure.low, figure.high)),
        Cell(over),
        Cell(limits_text(figure.lower_limit, figure.upper_limit) or DASH),
        Cell(text, tone) if figure.limited else Cell(DASH if figure.values else "not measured"),
    ]


def _checks(content: CertificateContent) -> list[Block]:
    rows = [
        named(run, Cell(text, "good" if text == "verified" else "bad"))
        for run, text in content.checks.items()
    ]
    caption = "Each record as it was when the certificate was made."
    return [Table(["Run", "Record"], rows, caption)]


def _provenance(content: CertificateContent) -> list[Block]:
    blocks: list[Block] = []
    for run in content.runs:
        for block in software_facts(run.manifest.software, run.manifest.bench_file_sha256):
            if block not in blocks:
                blocks.append(block)
    sums = {content.limits_from: content.limits_sha256} if content.limits_sha256 else {}
    sums |= {run.run_id: run.checksum for run in content.runs}
    caption = "Checksums of the limits' file and of the runs' manifests, which hold those of all their files."
    return [*blocks, *checksum_table(sums, caption)]
