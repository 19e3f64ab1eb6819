"""The channels beside the gyro's rate, for `gyrobench gap`: loaded, printed, as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from bench.analysis.gap import (
    SIGNIFICANT,
    ChannelDiagnosis,
    ChannelSeries,
    Model,
    diagnose_channels,
    load_channels,
    scatter_sentence,
)


def diagnosed_channels(
    folders: Sequence[Path], held_out: Sequence[Path], gyro: str | None, model: Model
) -> list[ChannelDiagnosis]:
    """Diagnose what run folders hold beside the gyro's rate; recordings made elsewhere have no demand in them."""
    missing: dict[str, str] = {}
    parts: list[list[ChannelSeries]] = [[], []]
    for part, paths in zip(parts, (folders, held_out), strict=True):
        for path in paths:
            if path.suffix != ".toml":
                series, without = load_channels(path, gyro)
                part += series
                missing |= without
    return diagnose_channels(parts[0], model, parts[1], missing) if parts[0] else []


def print_channels(console: Console, channels: Sequence[ChannelDiagnosis]) -> None:
    """Print a line for each channel, its causes, and what cannot be seen."""
    seen = [each for each in channels if not each.reason]
    if not seen:
        return
    table = Table("channel", "gap rms", "floor", "most of it", "verdict", "gone on held-out runs")
    for each in seen:
        table.add_row(
            each.channel.replace("_", " "),
            f"{each.rms:.3g} {each.unit}",
            f"{each.floor_rms:.2g}",
            _most(each),
            each.verdict,
            _gone(each),
        )
    console.print(table)
    for each in seen:
        for cause in each.causes:
            chance = f"{100 * cause.probability:.0f} %"
            console.print(f"  {cause.effect.name} ({chance}): {cause.sentence}", highlight=False)
        for name, size in each.stochastic.items():
            console.print(f"  {scatter_sentence(name, size)}", highlight=False)
    for each in channels:
        if each.reason:
            console.print(
                f"  not seen: {each.channel.replace('_', ' ')}: {each.reason}", style="dim", highlight=False
            )


def _most(found: ChannelDiagnosis) -> str:
    clear = [place for place in found.places if place.p_value < SIGNIFICANT]
    return f"{clear[0].phase}, {clear[0].band} ({100 * clear[0].share:.0f} %)" if clear else ""


def _gone(found: ChannelDiagnosis) -> str:
    if found.held_out is None:
        return ""
    held = found.held_out
    return f"{100 * held.share:.1f} %: {held.rms_before:.3g} -> {held.rms_after:.3g} {found.unit}"


def channel_facts(found: ChannelDiagnosis) -> dict[str, Any]:
    """Return a channel's diagnosis for JSON."""
    if found.reason:
        return {"channel": found.channel, "verdict": found.verdict, "reason": found.reason}
    return {
        "channel": found.channel,
        "unit": found.unit,
        "verdict": found.verdict,
        "rms": found.rms,
        "floor_rms": found.floor_rms,
        "floor_from": found.floor_source,
        "explained": found.explained,
        "causes": [
            {
                "name": cause.effect.name,
                "probability": cause.probability,
                "alternatives": dict(cause.alternatives),
                **{
                    key: dict(
                        zip([parameter.name for parameter in cause.effect.parameters], row, strict=True)
                    )
                    for key, row in (
                        ("parameters", cause.values),
                        ("sigma", cause.sigmas),
                        ("nominal", cause.nominal),
                    )
                },
            }
            for cause in found.causes
        ],
        "places": [vars(place) for place in found.places],
        "left": [vars(place) for place in found.left],
        "stochastic": dict(found.stochastic),
        "held_out": None if found.held_out is None else vars(found.held_out),
    }
