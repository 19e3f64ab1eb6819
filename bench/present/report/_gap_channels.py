"""The part of a gap report on the channels beside the gyro's rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bench.present.report._figures import Lane, lanes
from bench.present.report._gap_frame import gap_frame
from bench.present.report._gap_where import before_closed, gap_map, keys_of
from bench.present.report._numbers import DASH, fixed, plain_name, significant
from bench.present.report._page import (
    Block,
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

if TYPE_CHECKING:
    from bench.analysis.gap import ChannelFinding, Diagnosis

_VERDICTS: dict[str, tuple[str, Tone]] = {
    "no gap": ("No gap beyond noise", "good"),
    "within the model's accuracy": ("Within the model's accuracy", "good"),
    "explained": ("Gap explained", "good"),
    "explained in part": ("Gap explained in part", "doubt"),
    "unknown": ("Cause not in the catalogue", "bad"),
    "not seen": ("Nothing to identify", "doubt"),
}
_TERMS = [
    ("Gap", "A channel as recorded less what its model makes of what acted on it, above the floor."),
    ("Floor", "Noise, from stretches in which nothing changed, as a power at every period."),
    (
        "Gone on held-out runs",
        "Part of the gap's energy that the causes take away in runs not used for the fit.",
    ),
]


def channels_page(diagnosis: Diagnosis, *, created_utc: str, model_file: str) -> Page:
    """Return the report of recordings without a gyro: their channels alone."""
    named_channels = [channel for channel in diagnosis.channels if channel.causes]
    sentences = [
        f"{plain_name(channel.signal).capitalize()}: {plain_name(cause.name)}. {channel.told(cause)}"
        for channel in named_channels
        for cause in channel.causes
    ]
    sentences += [f"But {channel.caution}." for channel in named_channels if channel.caution]
    doubtful = any(channel.caution for channel in named_channels)
    word, tone = _VERDICTS[diagnosis.verdict]
    blocks = channel_blocks(diagnosis.channels)
    verdict = Verdict(
        word,
        "doubt" if doubtful else tone,
        sentences or ["The recordings have no gyro: the channels are diagnosed alone."],
        [headline for channel in named_channels for headline in _headline(channel)],
    )
    sections = [Section("Channels", blocks or [Notes([_hidden(diagnosis.channels)])])]
    return gap_frame(diagnosis, verdict, sections, _TERMS, created_utc=created_utc, model_file=model_file)


def _headline(channel: ChannelFinding) -> list[Headline]:
    return [
        Headline(
            f"{plain_name(channel.signal).capitalize()} on held-out runs, rms",
            significant(held.rms_after),
            channel.unit,
            significant(held.rms_before),
            f"{fixed(100 * held.share, 1)} % of the gap is gone "
            f"({fixed(100 * held.low, 1)} to {fixed(100 * held.high, 1)} %)",
        )
        for held in channel.held_out
        if held.cells
    ]


def _hidden(channels: Sequence[ChannelFinding]) -> str:
    hidden = [f"{plain_name(channel.signal)}: {channel.reason}" for channel in channels if channel.reason]
    return "Not seen: " + "; ".join(hidden) + "."


def channel_blocks(channels: Sequence[ChannelFinding]) -> list[Block]:
    """Return a table of all channels, and for each with a gap its causes, map and curves."""
    seen = [channel for channel in channels if not channel.reason]
    if not seen:
        return []
    heads = ["Channel", ">Gap, rms", ">Floor, rms", "Unit", "Verdict"]
    heads += [">Explained [%]", ">Gone on held-out runs [%]"]
    rows = [_row(channel) for channel in seen]
    blocks: list[Block] = [Table(heads, rows, "Each channel against its own model and its own noise floor.")]
    for channel in seen:
        if channel.verdict not in ("no gap", "within the model's accuracy"):
            blocks += _of_channel(channel)
    blocks += [
        Notes([f"{plain_name(channel.signal).capitalize()}: {channel.caution}."], "doubt")
        for channel in seen
        if channel.caution
    ]
    hidden = any(channel.reason for channel in channels)
    return [*blocks, Notes([_hidden(channels)])] if hidden else blocks


def _row(found: ChannelFinding) -> Row:
    held = next(iter(found.held_out), None)
    row = named(
        plain_name(found.signal).capitalize(),
        significant(found.rms),
        significant(found.floor_rms),
        found.unit,
        found.verdict,
        fixed(100.0 * found.explained, 0) if found.causes else DASH,
        fixed(100.0 * held.share, 1) if held is not None else DASH,
    )
    notes = [f"{plain_name(cause.name).capitalize()}: {found.told(cause)}" for cause in found.causes]
    notes += [found.scatter(name) + "." for name in found.stochastic]
    return replace(row, note=" ".join(notes))


def _of_channel(found: ChannelFinding) -> list[Block]:
    name = plain_name(found.signal)
    caption = f"{name.capitalize()}: where its gap lies, rms in {found.unit} where significant."
    blocks = gap_map(f"{found.signal}-map", found.places, found.bands, caption)
    curve = found.curves[0]
    apart = np.diff(curve.time_s, prepend=curve.time_s[0]) > 5.0 * np.median(np.diff(curve.time_s))
    before, after = (np.where(apart, np.nan, values) for values in (curve.before, curve.after))
    plots = before_closed(curve.time_s, before, after if found.causes else None)
    caption = f"{name.capitalize()}: recorded less simulated in {curve.run_id}."
    lane = Lane(found.unit, plots, 120.0)
    return [*blocks, lanes(f"{found.signal}-curve", [lane], "Time in the run, h", caption, keys_of(plots))]
