"""What a gap diagnosis found, for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.table import Table
from rich.text import Text

from bench.analysis.gap import Cause, ChannelFinding, Diagnosis, Place, PositionFinding, Shrinkage, Suggestion
from bench.present.cli._console import Terminal

_SHOWN = 8


def print_rate(console: Terminal, diagnosis: Diagnosis, following: Sequence[Suggestion]) -> None:
    """Print what was found in the rate and the channels beside it, and what to do next."""
    found = diagnosis.rate
    shrunk = next(iter(found.held_out), None)
    _print_verdict(console, diagnosis.unit_id, found.verdict)
    for cause in found.causes:
        values = cause.term.fitted(found.model.noise.coarseness, "+-")
        console.say(f"  {_said(cause)} {values}{_rivals(cause)}")
    for name, probability in found.stochastic.items():
        parts = [f"  {name} ({100 * probability:.0f} %)", found.size_of(name)]
        console.say(": ".join(filter(None, parts)))
    if found.unknown_probability > 0.5:
        near = ", ".join(cause.name for cause in found.resembles) or "nothing in the catalogue"
        chance = f"{100 * found.unknown_probability:.0f} %"
        console.say(f"  something that the catalogue lacks ({chance}); it resembles {near}")
        for part in found.unknown_parts:
            console.say(f"  {part.sentence}")
    console.print(_map("where", found.places))
    if any(place.clear for place in found.left):
        console.print(_map("left", found.left))
    console.say(_closing(shrunk))
    if shrunk is not None and shrunk.caution and found.causes:
        console.say(f"  {shrunk.caution}", style="bold red")
    _print_warnings(console, found.warnings)
    if found.unidentifiable:
        names = ", ".join(found.unidentifiable)
        console.say(f"  not to be seen in these runs: {names}", style="dim")
    _print_channels(console, diagnosis.channels)
    for each in following[:2]:
        console.say(
            f"  next: {each.procedure} ({each.parameters}, {each.hours:.1f} h): {each.decides}, "
            f"expected log odds {each.log_odds:.3g}"
        )


def print_position(console: Terminal, unit_id: str, found: PositionFinding) -> None:
    """Print what was found in a platform's position."""
    _print_verdict(console, unit_id, found.verdict)
    for cause in found.causes:
        term = cause.term
        rows = zip(term.effect.parameters, term.values, term.sigmas, strict=True) if term else ()
        values = ", ".join(f"{p.name} = {value:.3g} +- {sigma:.1g}" for p, value, sigma in rows)
        console.say(f"  {_said(cause)}{values and ' '}{values}{_rivals(cause)}")
    if found.unknown:
        console.say("  part of the gap follows neither temperature nor heading alone")
    table = Table(
        "heading", "hours", "before arcsec", "after arcsec", "share %", title="where: position error rms"
    )
    for stay in found.stays:
        table.add_row(
            f"{stay.heading_deg:.0f} deg",
            f"{stay.hours:.0f}",
            f"{stay.rms_before_as:.1f}",
            f"{stay.rms_after_as:.1f}",
            f"{100 * stay.share:.0f}",
        )
    console.print(table)
    for each in found.held_out:
        console.say(
            f"on held-out run {each.run_id} {100 * each.share:.1f} % of the position error's energy is gone "
            f"({100 * each.low:.1f} to {100 * each.high:.1f} %): {each.rms_before:.1f} -> "
            f"{each.rms_after:.1f} arcsec rms"
        )
    if not found.held_out and found.closing:
        console.say("no held-out runs: how far the gap shrinks is not known")
    _print_warnings(console, found.warnings)


def _print_verdict(console: Terminal, unit_id: str, verdict: str) -> None:
    console.print(Text.assemble(f"unit {unit_id}: ", (verdict, "bold")))


def _print_warnings(console: Terminal, warnings: Sequence[str]) -> None:
    for warning in warnings:
        console.say(f"  {warning}", style="yellow")


def _said(cause: Cause[Any]) -> str:
    return f"{cause.name} ({100 * cause.probability:.0f} %): {cause.meaning}"


def _rivals(cause: Cause[Any]) -> str:
    rivals = ", ".join(f"{name} {100 * value:.0f} %" for name, value in cause.alternatives.items())
    return f"; in its place could stand {rivals}" if rivals else ""


def _map(title: str, places: Sequence[Place]) -> Table:
    table = Table("profile", "runs", "time scale", "rms deg/h", "share %", "energy / floor", title=title)
    for place in [place for place in places if place.clear][:_SHOWN]:
        table.add_row(
            place.profile,
            place.part,
            place.band,
            f"{place.rms:.4f}",
            f"{100 * place.share:.0f}",
            f"{place.energy_ratio:.1f}",
        )
    return table


def _closing(shrunk: Shrinkage | None) -> str:
    if shrunk is None:
        return "no held-out runs: how far the gap shrinks is not known"
    if not shrunk.cells:
        return "no gap above the floor on the held-out runs"
    return (
        f"on held-out runs {100 * shrunk.share:.1f} % of the reducible gap is gone "
        f"({100 * shrunk.low:.1f} to {100 * shrunk.high:.1f} %): "
        f"{shrunk.rms_before:.4f} -> {shrunk.rms_after:.4f} deg/h rms above the floor"
    )


def _print_channels(console: Terminal, channels: Sequence[ChannelFinding]) -> None:
    """Print a line for each channel, its causes, and what cannot be seen."""
    seen = [each for each in channels if not each.reason]
    if not seen:
        return
    table = Table("channel", "gap rms", "floor", "most of it", "verdict", "gone on held-out runs")
    for each in seen:
        table.add_row(
            each.signal.replace("_", " "),
            f"{each.rms:.3g} {each.unit}",
            f"{each.floor_rms:.2g}",
            _most(each.places),
            each.verdict,
            "".join(
                f"{100 * held.share:.1f} %: {held.rms_before:.3g} -> {held.rms_after:.3g} {each.unit}"
                for held in each.held_out
            ),
        )
    console.print(table)
    for each in seen:
        for cause in each.causes:
            chance = f"{100 * cause.probability:.0f} %"
            console.say(f"  {cause.name} ({chance}): {each.told(cause)}")
        for name in each.stochastic:
            console.say(f"  {each.scatter(name)}")
    for each in channels:
        if each.reason:
            console.say(f"  not seen: {each.signal.replace('_', ' ')}: {each.reason}", style="dim")


def _most(places: Sequence[Place]) -> str:
    most = next((place for place in places if place.clear), None)
    return f"{most.part}, {most.band} ({100 * most.share:.0f} %)" if most else ""
