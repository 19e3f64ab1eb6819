"""What happened and what was found, in words: the same for terminal, panel and report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bench.record.events import Event, Other, read_event
from bench.record.events.campaign import Continued, Started
from bench.record.events.run import (
    AirDemand,
    Alarm,
    AngleDemand,
    Answer,
    ConditioningDemand,
    Demand,
    HomeDemand,
    Invalid,
    Measured,
    NavigationDemand,
    Note,
    Outcome,
    Paused,
    PhaseBegun,
    PowerDemand,
    Prompt,
    RateDemand,
    Repeat,
    Requested,
    Resumed,
    Series,
    Step,
    UnitsOff,
    UnitsOn,
)
from bench.record.events.safe import SafeState

if TYPE_CHECKING:
    from bench.analysis.gap import Learned


def event_of(row: Mapping[str, Any]) -> Event:
    """Return the event of a line of a live file; `Other` for a line that cannot be understood."""
    try:
        return read_event({"time_s": 0.0, **row})[1]
    except ValueError:
        fields = {key: value for key, value in row.items() if key not in ("time_s", "kind")}
        return Other(str(row.get("kind", "")), fields)


_SENTENCES: dict[type[Event], str] = {
    Step: "{code} {title}",
    Series: "worked out: {title}",
    PhaseBegun: "phase {phase}",
    Note: "{text}",
    Alarm: "{device}: {text}",
    Repeat: "{device}: {text}",
    Invalid: "run invalid: {text}",
    Prompt: "asks: {question}",
    Answer: "{by} answered {answer}",
    Requested: "{by} asks for {action}",
    Paused: "paused by {by}",
    Resumed: "resumed by {by}",
    UnitsOff: "units to be switched off and on",
    UnitsOn: "units are on again",
    Outcome: "{outcome} {reason}",
    Started: "started by {by}",
    Continued: "continued by {by}",
}


def sentence(event: Event) -> str:
    """Return an event as a line of a log: one sentence, without its time."""
    if type(event) in _SENTENCES:
        return _SENTENCES[type(event)].format_map(vars(event)).strip()
    match event:
        case Measured():
            return _measured(event)
        case SafeState():
            return safe_sentence(event)
        case Demand():
            return f"{event.device}{_axis(event)}: {demand_words(event)}"
    details = event.details if isinstance(event, Other) else event.fields()
    return ", ".join(f"{key} {value}" for key, value in details.items() if key != "utc")


def demand_words(event: Event) -> str:
    """Return what a device is told, without its name; numbers with all the digits they were demanded with."""
    match event:
        case AngleDemand():
            sense = "" if event.sense == "shortest" else f", {event.sense} sense"
            return f"point to {_number(event.angle_deg)} deg{sense}"
        case RateDemand():
            within = event.acceleration_dps2
            end = "" if within is None else f" within {_number(within)} deg/s2"
            return f"spin at {_number(event.rate_dps)} deg/s{end}"
        case HomeDemand():
            return "go home"
        case AirDemand():
            ramp = event.ramp_k_per_min
            way = "as fast as possible" if ramp is None else f"at {_number(ramp)} K/min"
            return f"go to {_number(event.set_point_c)} degC {way}"
        case ConditioningDemand():
            return "start" if event.on else "stop"
        case NavigationDemand():
            return "navigate"
        case PowerDemand():
            feeds = f" ({', '.join(event.units)})" if event.units else ""
            return f"switch output {event.output} {'on' if event.on else 'off'}{feeds}"
    return ""


def demands_words(demands: Mapping[str, Mapping[str, Any] | None]) -> str:
    """Return what the axes of a table were asked last: `table.demands` of live/now.json."""
    parts = {}
    for name, fields in demands.items():
        angle_deg, rate_dps = (fields or {}).get("angle_deg"), (fields or {}).get("rate_dps")
        if isinstance(angle_deg, int | float):
            parts[name] = f"{angle_deg:.3f} deg"
        elif isinstance(rate_dps, int | float) and rate_dps != 0.0:
            parts[name] = f"{rate_dps:g} deg/s"
        else:
            parts[name] = "at rest" if fields is None or rate_dps is not None else "home"
    return ", ".join(f"{name} {text}" if len(parts) > 1 else text for name, text in parts.items())


def safe_sentence(state: SafeState) -> str:
    """Return whether a device is in its safe state."""
    if state.confirmed:
        return str(state)
    hint = ": STOP IT BY HAND" if state.state == "pending" else ""
    return f"not confirmed safe: {state}{hint}"


def safe_sentences(states: Sequence[SafeState]) -> list[str]:
    """Return what became of the bench: first what is in danger."""
    return [safe_sentence(state) for state in sorted(states, key=lambda state: state.confirmed)]


def learned_sentences(learned: Learned | None) -> list[str]:
    """Return what closes the gap without a name, how far on other profiles and where it may be used."""
    if learned is None:
        return []
    if not learned.terms:
        return [f"Nothing is offered to close it: {learned.reason}."]
    forms = " and ".join(term.name for term in learned.terms)
    shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in learned.by_profile.items())
    ranges = ", ".join(f"{name} {low:.4g} to {high:.4g}" for name, (low, high) in learned.valid.items())
    return [
        f"It can be closed without a name ({forms}): {100 * learned.share:.0f} % of it is gone in profiles that "
        f"were left out of the fit ({shares}). Use it only within {ranges}."
    ]


def _measured(event: Measured) -> str:
    number = "-" if event.value is None else f"{event.value:.6g}"
    verdict = {None: "", True: ", inside", False: ", OUTSIDE"}[event.passed]
    return f"{event.name.replace('_', ' ')} = {number} {event.unit}{verdict}"


def _axis(event: Event) -> str:
    axis = getattr(event, "axis", "table")
    return "" if axis == "table" else f", {axis} axis"


def _number(value: float) -> str:
    """Return a number with all its digits, a whole one without a point."""
    return f"{value:.17g}" if float(f"{value:.15g}") != value else f"{value:.15g}"
