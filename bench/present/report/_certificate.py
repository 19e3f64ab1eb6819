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
from bench.present.report._budget import TERM, traceability_table
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
from bench.record.figure_limits import SIMPLE, Decision

Judgement = Literal["pass", "fail", "undecided", "not measured", "not judged"]
UnitVerdict = Literal["passed", "not passed", "undecided", "not judged"]

_TONES: Mapping[str, Tone] = {
    "pass": "good",
    "passed": "good",
    "fail": "bad",
    "not passed": "bad",
    "not measured": "bad",
    "undecided": "doubt",
    "not judged": "doubt",
}
_TERMS = [
    ("Not seen above", "The record does not show the figure; with 97.5 % probability it is at most this."),
    ("Value", "Of several runs the one nearest to failing: the largest magnitude where there is no limit."),
    (
        "Verified",
        "Checksums of the run's files recomputed, its tables rebuilt from the raw bytes: all equal.",
    ),
    TERM,
    *glossary.STANDARD_BIAS,
]


_RULES: Mapping[str, str] = {
    "simple acceptance": "Simple acceptance (JCGM 106): the value lies inside the limits, the limits included. A "
    "value on a limit is beyond it with a probability of 50 %; an interval that reaches beyond is marked.",
    "guard band": "Guard band w = U (JCGM 106): the 95 % interval lies inside the limits as a whole; outside as "
    "a whole it fails, else it is undecided. What passes is beyond a limit with a probability of at most 2.5 %.",
    "false acceptance": "Probability of false acceptance (JCGM 106): what passes is beyond the limits with a "
    "probability of at most {risk}, what fails is inside with no more; the rest is undecided.",
}


@dataclass(frozen=True)
class CertifiedFigure:
    """A figure of one unit. `values`: run id -> value; `intervals`: 95 % intervals by run.

    `unseen`: runs whose record does not show it. `decision`: the rule it is judged by. `digits`: worth printing.
    `standard_uncertainties`: combined, by run, where there is a budget.
    """

    name: str
    unit: str
    values: Mapping[str, float]
    lower_limit: float | None = None
    upper_limit: float | None = None
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    unseen: frozenset[str] = frozenset()
    decision: Decision = SIMPLE
    digits: int = 4
    standard_uncertainties: Mapping[str, float] = field(default_factory=dict)

    @property
    def limited(self) -> bool:
        """Whether there is a limit to judge by."""
        return self.lower_limit is not None or self.upper_limit is not None

    @property
    def value(self) -> float | None:
        """The value nearest to failing, None when there is none; one that is not a number is nearest."""
        return None if self.shown is None else self.values[self.shown]

    @property
    def shown(self) -> str | None:
        """The run of that value."""
        return max(self.values, key=lambda run: self._nearness(self.values[run]), default=None)

    @property
    def interval(self) -> tuple[float, float] | None:
        """The interval of the value shown, None where none is known."""
        return None if self.shown is None else self.intervals.get(self.shown)

    @property
    def bound(self) -> float | None:
        """What the figure is at most where the record of the run shown does not show it."""
        unseen = self.shown in self.unseen and self.interval is not None
        return max(map(abs, self.interval or ())) if unseen else None

    @property
    def judgement(self) -> Judgement:
        """What the limits say."""
        if not self.values:
            return "not measured" if self.limited else "not judged"
        if not self.limited:
            return "not judged"
        judgements = {
            self.decision.judge(
                value,
                self.intervals.get(run),
                self.lower_limit,
                self.upper_limit,
                self.standard_uncertainties.get(run),
            )
            for run, value in self.values.items()
        }
        return "fail" if "fail" in judgements else "undecided" if "undecided" in judgements else "pass"

    @property
    def doubtful(self) -> bool:
        """Whether the interval of a value inside the limits reaches beyond them."""
        ends = [end for interval in self.intervals.values() for end in interval]
        return self.judgement == "pass" and not all(self.holds(end) for end in ends)

    def holds(self, value: float) -> bool:
        """Return whether a value lies inside the limits, the limits included."""
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
        if self.against or any(judgement not in ("pass", "undecided") for judgement in judged):
            return "not passed"
        if "undecided" in judged:
            return "undecided"
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
    budgets: Sequence[Block] = ()
    limits_from: str = ""
    limits_sha256: str = ""
    decision: Decision = SIMPLE

    @property
    def verdict(self) -> UnitVerdict:
        """The worst of the units' verdicts; no unit at all is not a pass."""
        verdicts = {unit.verdict for unit in self.units}
        if not verdicts or "not passed" in verdicts:
            return "not passed"
        if "undecided" in verdicts:
            return "undecided"
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
        Fact("Decision rule", _RULES[content.decision.rule].format(risk=content.decision.risk)),
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
            Section("Traceability", traceability_table([run.manifest for run in content.runs])),
            Section("Uncertainty budgets", content.budgets),
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
        "undecided": "No figure fails, but for some the uncertainty leaves open whether they pass.",
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
    low, high = figure.interval or (None, None)
    over = (
        f"{significant(spread[0])} … {significant(spread[-1])} ({len(spread)})" if len(spread) > 1 else DASH
    )
    return [
        Cell(parts.stated(figure.value, figure.bound, figure.digits)),
        Cell(unit_text(figure.unit) or DASH),
        Cell(parts.interval(low, high, figure.digits)),
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
