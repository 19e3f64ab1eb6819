"""The report of a gap diagnosis: where, which, how far, what is left, what the unknown part looks like."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from bench.present.report._figures import Curve, Lane, Panel, lanes
from bench.present.report._gap_channels import channel_blocks
from bench.present.report._gap_curves import left_over_panels
from bench.present.report._gap_where import rate_map, where_blocks
from bench.present.report._numbers import DASH, fixed, moment, significant
from bench.present.report._page import (
    Block,
    Cell,
    Column,
    Definitions,
    Fact,
    Figures,
    Headline,
    Key,
    Notes,
    Page,
    Row,
    Section,
    Table,
    Tone,
    Verdict,
)
from bench.present.report._palette import AFTER, BEFORE, PURPLE
from bench.present.report._tables import checksum_table

if TYPE_CHECKING:
    from bench.analysis.gap import (
        Cause,
        Diagnosis,
        Difference,
        RateFinding,
        Shrinkage,
        Suggestion,
        Term,
        UnknownPart,
    )

_HOUR_S = 3600.0
_TONES: dict[str, Tone] = {
    "no gap": "good",
    "explained": "good",
    "explained in part": "doubt",
    "unknown": "bad",
    "nothing to identify": "doubt",
}
_WORDS = {
    "no gap": "No gap beyond noise",
    "explained": "Gap explained",
    "explained in part": "Gap explained in part",
    "unknown": "Cause not in the catalogue",
    "nothing to identify": "Nothing to identify",
}
_TERMS = [
    (
        "Gap",
        "Gyro output less what the nominal model makes of the same recorded stimulus, above the floor.",
    ),
    (
        "Floor",
        "Noise, from differences of repeated runs where there are any, as a power at every frequency; "
        "neighbouring samples need not be independent.",
    ),
    ("Runs", "Repeats and opposite rates combined: common to all, odd in rate (scale factor), even in rate."),
    ("Significant", "Probability below 1 % that noise does this in any of all cells looked at (Holm)."),
    ("Reducible gap", "Energy under the nominal model less the floor's, in the cells where there is a gap."),
    (
        "Free curve",
        "Any function of one input; where it beats the whole catalogue, the cause is unknown.",
    ),
]


@dataclass(frozen=True)
class GapContent:
    """What the report is made of. `differences` are of held-out runs where there are any."""

    diagnosis: Diagnosis
    differences: Sequence[Difference]
    created_utc: str = ""
    model_file: str = ""
    suggestions: Sequence[Suggestion] = field(default=())

    @property
    def found(self) -> RateFinding:
        """What was found in the rate."""
        return self.diagnosis.rate

    @property
    def shrunk(self) -> Shrinkage | None:
        """How far the rate's gap shrinks on held-out runs, None without any."""
        return next(iter(self.found.held_out), None)


def gap_page(content: GapContent) -> Page:
    """Return the report of a diagnosis."""
    found, diagnosis = content.found, content.diagnosis
    return Page(
        title=f"Simulation against bench: unit {diagnosis.unit_id}",
        kind="Sim-to-real gap report",
        facts=[
            Fact("Unit under test", diagnosis.unit_id),
            Fact("Nominal model", content.model_file or found.model.name),
            Fact("Runs", str(len(diagnosis.run_checksums))),
            Fact("Noise floor from", found.noise.source),
            Fact("Report made", moment(content.created_utc)),
        ],
        verdict=_verdict(content),
        sections=[
            Section("Warnings", [Notes(found.warnings, "doubt")] if found.warnings else []),
            Section("Where", where_blocks(found)),
            Section("Which", [*_causes(found), *_unknown(found.unknown_parts)]),
            Section("How far", _how_far(content)),
            Section("What is left", _left(found)),
            Section("Other channels", channel_blocks(diagnosis.channels)),
            Section("What next", _next(content.suggestions)),
            Section("Not to be seen in these runs", _hidden(found)),
            Section("Provenance", checksum_table(diagnosis.run_checksums, "Runs diagnosed, by checksum.")),
            Section("Definitions", [Definitions(_TERMS)]),
        ],
        colophon="All figures are computed from the runs and the model named above; times are UTC.",
    )


def _verdict(content: GapContent) -> Verdict:
    found, shrunk = content.found, content.shrunk
    sentences = [
        f"{_plain(cause.name).capitalize()}: {cause.meaning}{_rivals(cause)}" for cause in found.causes
    ]
    sentences += [f"Noise: {_plain(name)}{_told(found.size_of(name))}." for name in found.stochastic]
    sentences += [part.sentence for part in found.unknown_parts]
    if shrunk is not None and shrunk.caution and found.causes:
        sentences.append(f"But {shrunk.caution}.")
    if not sentences:
        sentences = ["The runs agree with the nominal model, its parameters fitted within their uncertainty."]
        if found.verdict == "nothing to identify":
            sentences = [
                "The stimulus is constant in these runs; they cannot show what an effect depends on."
            ]
    headlines = [
        Headline(_plain(cause.name), fixed(100.0 * cause.probability, 0), "%", note="probability")
        for cause in found.causes
    ]
    if shrunk is not None and shrunk.cells:
        headlines.append(
            Headline(
                "Gap on held-out runs, rms",
                significant(shrunk.rms_after),
                "°/h",
                significant(shrunk.rms_before),
                f"{fixed(100 * shrunk.share, 1)} % of the reducible gap is gone "
                f"({fixed(100 * shrunk.low, 1)} to {fixed(100 * shrunk.high, 1)} %)",
            )
        )
    doubtful = shrunk is not None and shrunk.caution and found.causes
    tone = "doubt" if doubtful else _TONES[found.verdict]
    return Verdict(_WORDS[found.verdict], tone, sentences, headlines)


def _rivals(cause: Cause[Term]) -> str:
    if not cause.alternatives:
        return ""
    rivals = ", ".join(f"{_plain(name)} {100 * value:.0f} %" for name, value in cause.alternatives.items())
    return f" These runs do not tell it from {rivals}."


def _told(size: str) -> str:
    return f": {size}" if size else ""


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _causes(found: RateFinding) -> list[Block]:
    coarseness = found.model.noise.coarseness
    rows = [_cause_row(cause, coarseness, "named") for cause in found.causes]
    rows += [_cause_row(cause, coarseness, "resembles a part") for cause in found.resembles]
    rows += [
        Row(
            [
                Cell(_plain(name), strong=True),
                Cell(f"{100 * p:.0f}"),
                Cell("noise"),
                Cell(found.size_of(name) or DASH),
                Cell(DASH),
            ]
        )
        for name, p in found.stochastic.items()
    ]
    if not rows:
        return []
    heads = [
        Column("Effect"),
        Column("Probability", "%", True),
        Column("Status"),
        Column("Fitted parameters, 1σ"),
        Column("In its place could stand"),
    ]
    return [Table(heads, rows, "Effects that explain the gap.")]


def _cause_row(cause: Cause[Term], coarseness: float, status: str) -> Row:
    fitted = cause.term.fitted(coarseness, "±")
    shape = ", ".join(f"{key} = {value:g}" for key, value in cause.term.variant.shape.items())
    rivals = ", ".join(f"{_plain(name)} {100 * value:.0f} %" for name, value in cause.alternatives.items())
    effect = cause.term.variant.effect
    note = f"{cause.meaning} Follows {effect.follows}. Source: {effect.source}."
    if rivals:
        note += " The alternatives move together with it in these runs."
    cells = [
        Cell(_plain(cause.name), strong=True),
        Cell(f"{100 * cause.probability:.0f}"),
        Cell(status),
        Cell(f"{fitted}; {shape}" if shape else fitted),
        Cell(rivals or "nothing"),
    ]
    return Row(cells, emphasis=status == "named", note=note)


def _unknown(parts: Sequence[UnknownPart]) -> list[Block]:
    blocks: list[Block] = []
    if parts:
        blocks.append(Notes(["The catalogue lacks: " + part.sentence for part in parts], "doubt"))
    for number, part in enumerate(parts):
        if part.curve:
            curve = Curve("missing effect", np.array(part.at), np.array(part.curve), PURPLE)
            caption = f"What the missing effect looks like over {part.follows}."
            drawn = lanes(
                f"unknown-{number}",
                [Lane(part.unit, [curve], 130.0)],
                _input(part.follows),
                description=caption,
            )
            blocks.append(Figures([drawn], caption))
    return blocks


def _input(name: str) -> str:
    return {"T_in": "T_in, °C", "T_in - T_out": "T_in − T_out, K"}.get(name, f"{name}, K/min")


def _how_far(content: GapContent) -> list[Block]:
    blocks: list[Block] = []
    shrunk = content.shrunk
    if shrunk is None:
        blocks.append(
            Notes(
                ["No run was held out: the curves below are of the fitted runs and prove less."],
                "doubt",
            )
        )
    elif not shrunk.cells:
        blocks.append(Notes(["No gap above the floor on the held-out runs."]))
    else:
        parts = [("profile", shrunk.by_profile), ("runs", shrunk.by_runs), ("phase", shrunk.by_phase)]
        rows = [
            Row([Cell("all"), Cell("", strong=True), Cell(fixed(100 * shrunk.share, 1), strong=True)], True)
        ]
        rows += [
            Row([Cell(kind), Cell(name.replace("_", " ")), Cell(fixed(100 * value, 1))])
            for kind, shares in parts
            for name, value in shares.items()
            if math.isfinite(value)
        ]
        heads = [Column("By"), Column("Part"), Column("Reducible gap gone", "%", True)]
        caption = "Held-out runs, nothing fitted to them but each run's bias."
        blocks.append(Table(heads, rows, caption))
    return blocks + _difference_panels(content)


def _difference_panels(content: GapContent) -> list[Block]:
    shown = content.differences
    if not shown:
        return []
    closed = bool(content.found.causes)
    plots = [
        Panel(
            [
                Curve("before", each.time_s / _HOUR_S, each.before_dph, BEFORE),
                *([Curve("after", each.time_s / _HOUR_S, each.after_dph, AFTER)] if closed else []),
            ],
            f"{each.profile}, {each.condition}" if each.condition else each.profile,
            description=f"Output less model in {each.profile}, {each.condition}",
        )
        for each in shown
    ]
    whose = "held-out runs" if content.shrunk is not None else "the runs that were fitted"
    keys = [Key("nominal model", BEFORE), *([Key("with the effects in it", AFTER)] if closed else [])]
    caption = f"Output less model, mean of repeats of {whose}, 100 s means, each run's bias taken out."
    return [left_over_panels("difference", plots, caption, keys)]


def _left(found: RateFinding) -> list[Block]:
    blocks = rate_map("left", found, found.left, "What the best set leaves, by runs and time scale")
    if blocks:
        return blocks
    beside = " beside the missing effect drawn above" if found.unknown_parts else ""
    return [Notes([f"Nothing that stands out of the noise floor{beside}."])]


def _next(suggestions: Sequence[Suggestion]) -> list[Block]:
    if not suggestions:
        return []
    rows = [
        Row(
            [
                Cell(each.procedure, strong=True),
                Cell(each.parameters),
                Cell(fixed(each.hours, 1)),
                Cell(significant(each.log_odds)),
                Cell(each.decides),
            ],
            emphasis=number == 0,
        )
        for number, each in enumerate(suggestions)
    ]
    heads = [
        Column("Procedure"),
        Column("Parameters"),
        Column("Bench time", "h", True),
        Column("Expected log odds", "", True),
        Column("Decides"),
    ]
    return [Table(heads, rows, "What would separate the candidates best, most log odds an hour first.")]


def _hidden(found: RateFinding) -> list[Block]:
    if not found.unidentifiable:
        return []
    return [Notes([f"{_plain(name)}: {reason}" for name, reason in found.unidentifiable.items()])]
