"""The part of a gap report on the channels beside the gyro's rate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bench.present.report._figures import Curve, Lane, lanes
from bench.present.report._gap_where import in_words, place_map
from bench.present.report._numbers import DASH, fixed, significant
from bench.present.report._page import Block, Cell, Column, Figures, Key, Notes, Row, Table
from bench.present.report._palette import AFTER, BEFORE

if TYPE_CHECKING:
    from bench.analysis.gap import ChannelFinding

_HOUR_S = 3600.0


def channel_blocks(channels: Sequence[ChannelFinding]) -> list[Block]:
    """Return a table of all channels, and for each with a gap its causes, map and curves."""
    seen = [each for each in channels if not each.reason]
    if not seen:
        return []
    heads = [
        Column("Channel"),
        Column("Gap, rms", "", True),
        Column("Floor, rms", "", True),
        Column("Unit"),
        Column("Verdict"),
        Column("Explained", "%", True),
        Column("Gone on held-out runs", "%", True),
    ]
    blocks: list[Block] = [
        Table(
            heads,
            [_row(each) for each in seen],
            "Each channel against its own model and its own noise floor.",
        )
    ]
    for each in seen:
        if each.verdict not in ("no gap", "within the model's accuracy"):
            blocks += _of_channel(each)
    hidden = [f"{_plain(each.signal)}: {each.reason}" for each in channels if each.reason]
    if hidden:
        blocks.append(Notes(["Not seen: " + "; ".join(hidden) + "."]))
    return blocks


def _row(found: ChannelFinding) -> Row:
    held = next(iter(found.held_out), None)
    cells = [
        Cell(_plain(found.signal).capitalize(), strong=True),
        Cell(significant(found.rms)),
        Cell(significant(found.floor_rms)),
        Cell(found.unit),
        Cell(found.verdict),
        Cell(fixed(100.0 * found.explained, 0) if found.causes else DASH),
        Cell(fixed(100.0 * held.share, 1) if held is not None else DASH),
    ]
    notes = [f"{_plain(cause.name).capitalize()}: {found.told(cause)}" for cause in found.causes]
    notes += [found.scatter(name) + "." for name in found.stochastic]
    return Row(cells, note=" ".join(notes))


def _of_channel(found: ChannelFinding) -> list[Block]:
    name = _plain(found.signal)
    blocks: list[Block] = []
    if any(place.clear for place in found.places):
        caption = f"{name.capitalize()}: where its gap lies, rms in {found.unit} where significant."
        blocks.append(
            Figures([place_map(f"{found.signal}-map", in_words(found.places), found.bands, caption)], caption)
        )
    curve = found.curves[0]
    hours = curve.time_s / _HOUR_S
    apart = np.diff(hours, prepend=hours[0]) > 5.0 * np.median(np.diff(hours))
    plots = [Curve("nominal", hours, np.where(apart, np.nan, curve.before), BEFORE)]
    keys = [Key("nominal model", BEFORE)]
    if found.causes:
        plots.append(Curve("closed", hours, np.where(apart, np.nan, curve.after), AFTER))
        keys.append(Key("with the effects in it", AFTER))
    caption = f"{name.capitalize()}: recorded less simulated in {curve.run_id}."
    drawn = lanes(
        f"{found.signal}-curve", [Lane(found.unit, plots, 120.0)], "Time in the run, h", description=caption
    )
    blocks.append(Figures([drawn], caption, keys))
    return blocks


def _plain(name: str) -> str:
    return name.replace("_", " ")
