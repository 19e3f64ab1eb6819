"""What a gap diagnosis found, for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bench.analysis.gap import (
    Cause,
    ChannelFinding,
    Diagnosis,
    FastFinding,
    Place,
    PositionFinding,
    Shrinkage,
    Suggestion,
)
from bench.present.cli._console import Terminal
from bench.present.sentences import learned_sentences

_SHOWN = 8


def print_rate(console: Terminal, diagnosis: Diagnosis, following: Sequence[Suggestion]) -> None:
    """Print what was found in the rate and the channels beside it, and what to do next."""
    found = diagnosis.of_rate
    if found is None:
        _print_verdict(console, diagnosis.unit_id, diagnosis.verdict)
        _print_channels(console, diagnosis.channels)
        if not any(channel.held_out for channel in diagnosis.channels):
            console.say("no held-out runs: how far the gap shrinks is not known")
        return
    shrunk = next(iter(found.held_out), None)
    _print_verdict(console, diagnosis.unit_id, found.verdict)
    for cause in found.causes:
        coarseness = found.model.noise.coarseness
        form = "".join(f", with {term.name} {term.fitted(coarseness, '+-')}" for term in cause.form)
        console.say(f"  {_said(cause)} {cause.term.fitted(coarseness, '+-')}{form}{_rivals(cause)}")
    for name, probability in found.stochastic.items():
        parts = [f"  {name} ({100 * probability:.0f} %)", found.size_of(name)]
        console.say(": ".join(filter(None, parts)))
    if found.unknown_probability > 0.5:
        near = ", ".join(cause.name for cause in found.resembles) or "nothing in the catalogue"
        chance = f"{100 * found.unknown_probability:.0f} %"
        console.say(f"  something that the catalogue lacks ({chance}); it resembles {near}")
        for sentence in [*(part.sentence for part in found.unknown_parts), *learned_sentences(found.learned)]:
            console.say(f"  {sentence}")
    _print_map(console, "where", found.places)
    if any(place.clear for place in found.left):
        _print_map(console, "left", found.left)
    console.say(_closing(shrunk, found.none_held_out))
    if shrunk is not None and shrunk.caution:
        console.say(f"  {shrunk.caution}", style="bold red")
    _print_warnings(console, found.warnings)
    if found.unidentifiable:
        names = ", ".join(found.unidentifiable)
        console.say(f"  not to be seen in these runs: {names}", style="dim")
    _print_fast(console, diagnosis.fast)
    _print_channels(console, diagnosis.channels)
    for plan in following[:2]:
        console.say(
            f"  next: {plan.procedure} ({plan.parameters}, {plan.hours:.1f} h): {plan.decides}, "
            f"expected log odds {plan.log_odds:.3g}"
        )


def print_position(console: Terminal, unit_id: str, found: PositionFinding) -> None:
    """Print what was found in a platform's position."""
    _print_verdict(console, unit_id, found.verdict)
    for cause in found.causes:
        term = cause.term
        fitted = zip(term.effect.parameters, term.values, term.sigmas, strict=True) if term else ()
        values = ", ".join(f"{p.name} = {value:.3g} +- {sigma:.1g}" for p, value, sigma in fitted)
        console.say(f"  {_said(cause)}{values and ' '}{values}{_rivals(cause)}")
    if found.unknown:
        console.say("  part of the gap follows neither temperature nor heading alone")
    rows = [
        (
            f"{stay.heading_deg:.0f} deg",
            f"{stay.hours:.0f}",
            f"{stay.rms_before_as:.1f}",
            f"{stay.rms_after_as:.1f}",
            f"{100 * stay.share:.0f}",
        )
        for stay in found.stays
    ]
    heads = ("heading", "hours", "before arcsec", "after arcsec", "share %")
    console.table(heads, rows, "where: position error rms")
    for held in found.held_out:
        console.say(
            f"on held-out run {held.run_id} {100 * held.share:.1f} % of the position error's energy is gone "
            f"({100 * held.low:.1f} to {100 * held.high:.1f} %): {held.rms_before:.1f} -> "
            f"{held.rms_after:.1f} arcsec rms"
        )
    if not found.held_out and found.closing:
        console.say("no held-out runs: how far the gap shrinks is not known")
    _print_warnings(console, found.warnings)


def _print_verdict(console: Terminal, unit_id: str, verdict: str) -> None:
    console.parts(f"unit {unit_id}: ", (verdict, "bold"))


def _print_warnings(console: Terminal, warnings: Sequence[str]) -> None:
    console.say_all((f"  {warning}" for warning in warnings), style="yellow")


def _said(cause: Cause[Any]) -> str:
    return f"{cause.name} ({100 * cause.probability:.0f} %): {cause.meaning}"


def _rivals(cause: Cause[Any]) -> str:
    chance = f"{100 * cause.acts:.0f} %"
    if cause.form:
        return f"; they follow the same, so one mechanism acts: {' or '.join(cause.one_of)} ({chance})"
    if len(cause.one_of) > 1:
        return f"; these runs cannot tell it from {', '.join(cause.one_of[1:])} (one of them: {chance})"
    rivals = ", ".join(f"{name} {100 * value:.0f} %" for name, value in cause.alternatives.items())
    return f"; in its place could stand {rivals}" if rivals else ""


def _print_map(console: Terminal, title: str, places: Sequence[Place]) -> None:
    rows = []
    for place in [place for place in places if place.clear][:_SHOWN]:
        sizes = (f"{place.rms:.4f}", f"{100 * place.share:.0f}", f"{place.energy_ratio:.1f}")
        rows.append((place.profile, place.part, place.band, *sizes))
    console.table(("profile", "runs", "time scale", "rms deg/h", "share %", "energy / floor"), rows, title)


def _closing(shrunk: Shrinkage | None, none: str) -> str:
    if shrunk is None:
        return "no held-out runs: how far the gap shrinks is not known"
    if not shrunk.cells:
        return none
    return (
        f"on held-out runs {100 * shrunk.share:.1f} % of the reducible gap is gone "
        f"({100 * shrunk.low:.1f} to {100 * shrunk.high:.1f} %): "
        f"{shrunk.rms_before:.4f} -> {shrunk.rms_after:.4f} deg/h rms above the floor"
    )


def _print_fast(console: Terminal, found: FastFinding | None) -> None:
    """Print what the rows show above half the rate of the means."""
    if found is None:
        return
    console.parts("rows, above 0.5 Hz: ", (found.verdict, "bold"), f"; {found.floor.sentence}")
    console.say_all(f"  {line.sentence}" for line in found.lines)
    if found.lines:
        console.say(f"  {found.alias_sentence}", style="dim")
    if any(place.clear for place in found.left):
        _print_map(console, "left above 0.5 Hz", found.left)
    for held in found.held_out:
        console.say(
            f"  {100 * held.share:.1f} % of the lines' power in the held-out runs is what was found here: "
            f"{held.rms_before:.3g} -> {held.rms_after:.3g} deg/h rms"
        )
    _print_warnings(console, found.notes)


def _print_channels(console: Terminal, channels: Sequence[ChannelFinding]) -> None:
    """Print a line for each channel, its causes, and what cannot be seen."""
    seen = [channel for channel in channels if not channel.reason]
    rows = []
    for channel in seen:
        gone = "".join(
            f"{100 * held.share:.1f} %: {held.rms_before:.3g} -> {held.rms_after:.3g} {channel.unit}"
            for held in channel.held_out
        )
        rms, floor = f"{channel.rms:.3g} {channel.unit}", f"{channel.floor_rms:.2g}"
        name = channel.signal.replace("_", " ")
        rows.append((name, rms, floor, _most(channel.places), channel.verdict, gone))
    if seen:
        console.table(("channel", "gap rms", "floor", "most of it", "verdict", "gone on held-out runs"), rows)
    for channel in seen:
        if channel.caution:
            console.say(f"  {channel.signal.replace('_', ' ')}: {channel.caution}", style="bold red")
        for cause in channel.causes:
            console.say(f"  {cause.name} ({100 * cause.probability:.0f} %): {channel.told(cause)}")
        console.say_all(f"  {channel.scatter(name)}" for name in channel.stochastic)
    for channel in channels:
        if channel.reason:
            console.say(f"  not seen: {channel.signal.replace('_', ' ')}: {channel.reason}", style="dim")


def _most(places: Sequence[Place]) -> str:
    most = next((place for place in places if place.clear), None)
    return f"{most.part}, {most.band} ({100 * most.share:.0f} %)" if most else ""
