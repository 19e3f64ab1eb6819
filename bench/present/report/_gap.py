"""The report of a gap diagnosis: where, which, how far, what is left, what the unknown part looks like."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bench.present.report._figures import Curve, Lane, Panel, lanes
from bench.present.report._gap_channels import channel_blocks, channels_page
from bench.present.report._gap_fast import fast_blocks
from bench.present.report._gap_frame import gap_frame
from bench.present.report._gap_where import (
    OF_RUNS,
    before_closed,
    gap_map,
    keys_of,
    left_over_panels,
    where_blocks,
)
from bench.present.report._numbers import DASH, fixed, plain_name, significant
from bench.present.report._page import (
    Block,
    Cell,
    Headline,
    Notes,
    Page,
    Row,
    Section,
    Table,
    Tone,
    Verdict,
    named,
)
from bench.present.report._palette import PURPLE
from bench.present.report._parts import warnings
from bench.present.sentences import learned_sentences

if TYPE_CHECKING:
    from bench.analysis.gap import (
        Cause,
        Diagnosis,
        Difference,
        FastFinding,
        RateFinding,
        Shrinkage,
        Suggestion,
        Term,
    )

_VERDICTS: dict[str, tuple[str, Tone]] = {
    "no gap": ("No gap beyond noise", "good"),
    "explained": ("Gap explained", "good"),
    "explained in part": ("Gap explained in part", "doubt"),
    "unknown": ("Cause not in the catalogue", "bad"),
    "nothing to identify": ("Nothing to identify", "doubt"),
}
_TERMS = [
    ("Gap", "Gyro output less what the nominal model makes of the same recorded stimulus, above the floor."),
    (
        "Floor",
        "Noise, from differences of repeated runs where there are any, as a power at every frequency; "
        "neighbouring samples need not be independent.",
    ),
    ("Runs", "Repeats and opposite rates combined: common to all, odd in rate (scale factor), even in rate."),
    ("Significant", "Probability below 1 % that noise does this in any of all cells looked at (Holm)."),
    ("Reducible gap", "Energy under the nominal model less the floor's, in the cells where there is a gap."),
    ("Free curve", "Any function of one input; where it beats the whole catalogue, the cause is unknown."),
]


def gap_page(
    diagnosis: Diagnosis,
    differences: Sequence[Difference],
    suggestions: Sequence[Suggestion] = (),
    *,
    created_utc: str,
    model_file: str,
) -> Page:
    """Return the report of a diagnosis; `differences` are of held-out runs where there are any."""
    found = diagnosis.of_rate
    if found is None:
        return channels_page(diagnosis, created_utc=created_utc, model_file=model_file)
    shrunk = next(iter(found.held_out), None)
    hidden = [f"{plain_name(name)}: {reason}" for name, reason in found.unidentifiable.items()]
    sections = [
        warnings(found.warnings),
        Section("Where", where_blocks(found)),
        Section("Which", [*_causes(found), *_unknown(found)]),
        Section("How far", [*_how_far(shrunk, found.none_held_out), *_difference_panels(found, differences)]),
        Section("What is left", _left(found)),
        Section("Faster than 1 s", fast_blocks(diagnosis.fast)),
        Section("Other channels", channel_blocks(diagnosis.channels)),
        Section("What next", _next(suggestions)),
        Section("Not to be seen in these runs", [Notes(hidden)]),
    ]
    return gap_frame(
        diagnosis,
        _verdict(found, shrunk, diagnosis.fast),
        sections,
        _TERMS,
        created_utc=created_utc,
        model_file=model_file,
        floor_source=found.noise.source,
    )


def _verdict(found: RateFinding, shrunk: Shrinkage | None, fast: FastFinding | None) -> Verdict:
    sentences = [
        f"{plain_name(cause.name).capitalize()}: {cause.meaning}"
        + (f" These runs do not tell it from {_rivals(cause)}." if cause.alternatives else "")
        + (f" What follows the same draws its form: {_one_of(cause)}, one mechanism." if cause.form else "")
        for cause in found.causes
    ]
    for name in found.stochastic:
        noise = ": ".join(filter(None, (plain_name(name), found.size_of(name))))
        sentences.append(f"Noise: {noise}.")
    sentences += [part.sentence for part in found.unknown_parts]
    if shrunk is not None and shrunk.caution and found.causes:
        sentences.append(f"But {shrunk.caution}.")
    if not sentences:
        sentences = ["The runs agree with the nominal model, its parameters fitted within their uncertainty."]
        if found.verdict == "nothing to identify":
            sentences = [
                "The stimulus is constant in these runs; they cannot show what an effect depends on."
            ]
    faster = fast is not None and fast.verdict != "no gap"
    if fast is not None and faster:
        swings = "; ".join(line.sentence for line in fast.lines) or "more power than the noise has"
        sentences.append(f"Above 0.5 Hz {fast.verdict}: {swings}.")
    headlines = [
        Headline(_one_of(cause), fixed(100.0 * cause.acts, 0), "%", note="probability")
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
    word, tone = _VERDICTS[found.verdict]
    doubtful = shrunk is not None and shrunk.caution and found.causes
    elsewhere = fast is not None and faster and fast.verdict != found.verdict
    return Verdict(
        word, "doubt" if doubtful or (elsewhere and tone == "good") else tone, sentences, headlines
    )


def _one_of(cause: Cause[Term]) -> str:
    return " or ".join(plain_name(name) for name in cause.one_of or (cause.name,))


def _rivals(cause: Cause[Term]) -> str:
    return ", ".join(f"{plain_name(name)} {100 * value:.0f} %" for name, value in cause.alternatives.items())


def _causes(found: RateFinding) -> list[Block]:
    coarseness = found.model.noise.coarseness
    rows = [_cause_row(cause, coarseness, "named") for cause in found.causes]
    rows += [_cause_row(cause, coarseness, "resembles a part") for cause in found.resembles]
    rows += [
        named(plain_name(name), f"{100 * p:.0f}", "noise", found.size_of(name) or DASH, DASH)
        for name, p in found.stochastic.items()
    ]
    heads = ["Effect", ">Probability [%]", "Status", "Fitted parameters, 1σ", "In its place could stand"]
    return [Table(heads, rows, "Effects that explain the gap.")]


def _cause_row(cause: Cause[Term], coarseness: float, status: str) -> Row:
    others = [f"with {plain_name(term.name)}: {_fitted(term, coarseness)}" for term in cause.form]
    fitted = "; ".join([_fitted(cause.term, coarseness), *others])
    rivals = _rivals(cause)
    if cause.form:
        status += f", one mechanism with what follows the same: {_one_of(cause)}, {100 * cause.acts:.0f} %"
    elif len(cause.one_of) > 1:
        status += f", or one of its alternatives: {100 * cause.acts:.0f} %"
    effect = cause.term.variant.effect
    note = f"{cause.meaning} Follows {effect.follows}. Source: {effect.source}."
    if rivals:
        note += " The alternatives move together with it in these runs."
    row = named(
        plain_name(cause.name),
        f"{100 * cause.probability:.0f}",
        status,
        fitted,
        rivals or "nothing",
    )
    return replace(row, emphasis=status == "named", note=note)


def _fitted(term: Term, coarseness: float) -> str:
    shape = ", ".join(f"{key} = {value:g}" for key, value in term.variant.shape.items())
    fitted = term.fitted(coarseness, "±")
    return f"{fitted}; {shape}" if shape else fitted


def _unknown(found: RateFinding) -> list[Block]:
    blocks: list[Block] = []
    parts = found.unknown_parts
    if parts:
        sentences = ["The catalogue lacks: " + part.sentence for part in parts]
        blocks.append(Notes([*sentences, *learned_sentences(found.learned)], "doubt"))
    for number, part in enumerate(parts):
        if part.curve:
            curve = Curve("missing effect", np.array(part.at), np.array(part.curve), PURPLE)
            caption = f"What the missing effect looks like over {part.follows}."
            plot = Lane(part.unit, [curve], 130.0)
            blocks.append(lanes(f"unknown-{number}", [plot], _input(part.follows), caption))
    return blocks


def _input(name: str) -> str:
    return {"T_in": "T_in, °C", "T_in - T_out": "T_in − T_out, K"}.get(name, f"{name}, K/min")


def _how_far(shrunk: Shrinkage | None, none: str) -> list[Block]:
    if shrunk is None:
        return [
            Notes(["No run was held out: the curves below are of the fitted runs and prove less."], "doubt")
        ]
    if not shrunk.cells:
        return [Notes([f"{none[0].upper()}{none[1:]}."])]
    parts = [("profile", shrunk.by_profile), ("runs", shrunk.by_runs), ("phase", shrunk.by_phase)]
    rows = [Row([Cell("all"), Cell("", strong=True), Cell(fixed(100 * shrunk.share, 1), strong=True)], True)]
    rows += [
        Row([Cell(kind), Cell(plain_name(name)), Cell(fixed(100 * value, 1))])
        for kind, shares in parts
        for name, value in shares.items()
        if math.isfinite(value)
    ]
    caption = "Held-out runs, nothing fitted to them but each run's bias."
    return [Table(["By", "Part", ">Reducible gap gone [%]"], rows, caption)]


def _difference_panels(found: RateFinding, differences: Sequence[Difference]) -> list[Block]:
    plots = []
    for shown in differences:
        curves = before_closed(shown.time_s, shown.before_dph, shown.after_dph if found.causes else None)
        title = ", ".join(filter(None, (shown.profile, shown.condition)))
        plots.append(
            Panel(curves, title, description=f"Output less model in {shown.profile}, {shown.condition}")
        )
    if not plots:
        return []
    whose = "held-out runs" if found.held_out else "the runs that were fitted"
    caption = f"Output less model, mean of repeats of {whose}, 100 s means, each run's bias taken out."
    return [left_over_panels("difference", plots, caption, keys_of(plots[0].curves))]


def _left(found: RateFinding) -> list[Block]:
    caption = "What the best set leaves, by runs and time scale"
    beside = " beside the missing effect drawn above" if found.unknown_parts else ""
    nothing = Notes([f"Nothing that stands out of the noise floor{beside}."])
    return gap_map("left", found.left, found.bands, caption, OF_RUNS) or [nothing]


def _next(suggestions: Sequence[Suggestion]) -> list[Block]:
    rows = []
    for number, plan in enumerate(suggestions):
        cells = (plan.parameters, fixed(plan.hours, 1), significant(plan.log_odds), plan.decides)
        rows.append(replace(named(plan.procedure, *cells), emphasis=number == 0))
    heads = ["Procedure", "Parameters", ">Bench time [h]", ">Expected log odds", "Decides"]
    return [Table(heads, rows, "What would separate the candidates best, most log odds an hour first.")]
