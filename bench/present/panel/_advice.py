"""What an operator has to know at a glance: what happened, what the bench has done, what to press."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from bench.present.sentences import event_of, safe_sentences, sentence
from bench.record.events import Event
from bench.record.events.run import Demand, Invalid, Paused
from bench.record.events.safe import SafeState
from drivers.base.errors import BenchError

Tone = Literal["good", "bad", "doubt", "plain"]
_SILENT_S = 10.0
_GO_AND_LOOK = (
    "GO AND LOOK NOW: emergency stop at the table, main switch of the chamber if it still conditions."
)


@dataclass(frozen=True)
class Banner:
    """The head of the panel; `word` is the state in one word."""

    tone: Tone
    word: str
    happened: str = ""
    done: str = ""
    press: str = ""


NOT_HERE = Banner(
    "plain",
    "Not here",
    "There is no session of that name in this runs folder.",
    press="Open the panel without ?session=.",
)


def banner(now: Mapping[str, Any] | None, events: Sequence[Event], age_s: float) -> Banner:
    """Return the banner of a session: `now` as read, the run's last events, how long `now` stands still."""
    if now is None:
        return Banner(
            "plain", "Idle", "Nothing runs in this runs folder.", press="Start a run or a campaign."
        )
    state = str(now.get("state"))
    if state == "ended":
        return _ended(now, events)
    if not now.get("alive"):
        return Banner(
            "bad",
            "Process gone",
            "The process that drives the bench has ended without a word: killed, crashed, or the power went.",
            _told(_safe_states(events)) or "Nobody has confirmed that table and chamber are safe.",
            "Go and look at table and chamber. Then `gyrobench campaign resume`, or start the run anew.",
        )
    if age_s > _SILENT_S:
        return Banner(
            "bad",
            "No news",
            f"The bench's process runs but has said nothing for {age_s:.0f} s.",
            "Unknown.",
            "Abort. If nothing changes within a minute: emergency stop at the table, then look at the host.",
        )
    if safe := _safe_states(events):
        why = safe[0].why.capitalize()
        if not all(device.confirmed for device in safe):
            return Banner("bad", "Not confirmed safe", why, _told(safe), _GO_AND_LOOK)
        tone: Tone = "good" if safe[0].cause == "end_of_run" else "bad"
        return Banner(tone, "Closing", why, _told(safe), "Nothing: the record is being closed.")
    shown = _events(now, "alarms")
    alarms = [event for event in shown if not isinstance(event, Invalid)]
    if state == "asking":
        return Banner(
            "doubt", "Waiting for you", "The bench has a question.", "It stands still; telemetry runs.",
            "Answer the question.",
        )  # fmt: skip
    if alarms:
        return Banner(
            "bad",
            "Alarm",
            sentence(alarms[-1]),
            "The run goes on: nothing has been stopped for this alarm.",
            "Abort if table, chamber or unit are in danger; else nothing.",
        )
    invalid = [event for event in shown if isinstance(event, Invalid)]
    if invalid and state == "running":
        return Banner(
            "doubt",
            "Running, invalid",
            invalid[0].text,
            "The run goes on: the other units' data are kept. It will be sealed as invalid.",
            "Nothing is urgent. Abort if nobody needs the rest.",
        )
    if state == "paused":
        return Banner(
            "doubt", "Paused", _who_paused(events), "Telemetry runs; the chamber holds its set point.",
            "Resume, or abort.",
        )  # fmt: skip
    if now.get("pause_wanted"):
        return Banner(
            "doubt", "Pause asked for", "The run stops before its next step.", press="Nothing; or resume."
        )
    return Banner("good", "Starting" if state == "starting" else "Running")


def _ended(now: Mapping[str, Any], events: Sequence[Event]) -> Banner:
    outcome, reason = str(now.get("outcome")), str(now.get("reason") or "")
    # a record that could not be written has no line of it
    safe = _safe_states(events) or _safe_states(_events(now, "safe", kind=SafeState.kind))
    done = _told(safe)
    if outcome == "completed":
        warned = "; ".join(str(text) for text in now.get("warnings") or ())
        return Banner(
            "good", "Completed", warned, done, "Nothing; the report has the details." if warned else ""
        )
    if outcome == "invalid":
        press = "Nothing is urgent. Read the reason; repeat the run if needed."
        shown = _events(now, "alarms")
        if alarms := [event for event in shown if not isinstance(event, Invalid)]:
            press += f" The last alarm was: {sentence(alarms[-1])}"
        return Banner("doubt", "Invalid", reason, done, press)
    happened, remedy = _what_happened(now.get("error"), reason)
    if not all(device.confirmed for device in safe):
        return Banner("bad", "Not confirmed safe", happened, done, f"{_GO_AND_LOOK} {remedy}")
    word = "Aborted" if outcome == "aborted" else outcome.capitalize() or "Ended"
    return Banner("bad", word, happened, done, f"Nothing is urgent. {remedy}")


def _what_happened(error: object, reason: str) -> tuple[str, str]:
    """Return what ended a run early, without the remedy, and the remedy: `error` of live/now.json has both."""
    remedy = "clear the cause before starting again"
    if isinstance(error, Mapping):
        parts = {key: str(value) for key, value in error.items() if value}
        remedy = parts.pop("remedy", remedy)
        reason = str(BenchError(**parts)) if "what" in parts else reason
    return reason, f"{remedy[0].upper()}{remedy[1:].rstrip('.')}."


def _events(now: Mapping[str, Any], key: str, **fields: str) -> list[Event]:
    """Return the events of a list of now.json, each line with `fields` in it."""
    return [event_of(fields | dict(row)) for row in now.get(key) or () if isinstance(row, Mapping)]


def _safe_states(events: Sequence[Event]) -> list[SafeState]:
    """Return what became of each device when the bench was made safe; nothing if it was told to go on since."""
    states: dict[str, SafeState] = {}
    for event in events:
        if isinstance(event, SafeState):
            states[event.device] = event
        elif isinstance(event, Demand):
            states.pop(event.device, None)
    return list(states.values())


def _told(states: Sequence[SafeState]) -> str:
    """Return what the bench has done, first what is in danger."""
    told = "; ".join(safe_sentences(states))
    return f"bench made safe; {told}" if states and all(device.confirmed for device in states) else told


def _who_paused(events: Sequence[Event]) -> str:
    by = next((event.by for event in reversed(events) if isinstance(event, Paused)), None)
    return f"Paused by {by}." if by else "Paused between two runs."
