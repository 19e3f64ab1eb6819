"""The part of a gap report on the channels beside the gyro's rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bench.present.report._figures import Lane, lanes
from bench.present.report._gap_where import before_closed, gap_map, keys_of
from bench.present.report._numbers import DASH, fixed, plain_name, significant
from bench.present.report._page import Block, Notes, Row, Table, named

if TYPE_CHECKING:
    from bench.analysis.gap import ChannelFinding


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
    hidden = [f"{plain_name(channel.signal)}: {channel.reason}" for channel in channels if channel.reason]
    return [*blocks, Notes(["Not seen: " + "; ".join(hidden) + "."])] if hidden else blocks


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
