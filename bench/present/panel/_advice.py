"""What an operator has to know at a glance: what happened, what the bench has done, what to press."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from bench.present.sentences import event_of, safe_sentences, sentence
from bench.record.events import Event
from bench.record.events.run import Demand, Invalid, Paused, Requested
from bench.record.events.safe import SafeState, Takeover, TakeoverEnded
from drivers.base.errors import BenchError

Tone = Literal["good", "bad", "doubt", "plain"]
_SILENT_S = 10.0
_GO_AND_LOOK = (
    "GO AND LOOK NOW: emergency stop at the table, main switch of the chamber if it still conditions."
)
MANUAL = "manual"
"""The procedure that asks for orders: its question is answered by buttons of its own."""


@dataclass(frozen=True)
class Banner:
    """The head of the panel; `word` is the state in one word."""

    tone: Tone
    word: str
    happened: str = ""
    done: str = ""
    press: str = ""


@dataclass(frozen=True)
class Situation:
    """What is known of a session: its live state as read, the run's last events, those of its watchdog.

    `silent_s`: how long a living session has said nothing. `problem`: why its live state cannot be read.
    """

    now: Mapping[str, Any] | None
    events: Sequence[Event] = ()
    watchdog: Sequence[Event] = ()
    silent_s: float = 0.0
    problem: str = ""
    emulated: bool = False

    @property
    def safe(self) -> list[SafeState]:
        """What became of each device when the bench was made safe; nothing if it was told to go on since."""
        listed = [] if self.now is None else _listed(self.now, "safe", kind=SafeState.kind)
        return _safe_states([*self.events, *self.watchdog]) or _safe_states(listed)


NOT_HERE = Banner(
    "plain",
    "Not here",
    "There is no session of that name in this runs folder.",
    press="Choose a bench above, or open the panel's first page.",
)


def nothing_yet(folder: str, there: bool, queue: bool, bench: str = "") -> Banner:
    """Return the banner of a runs folder, or a bench, without sessions; `queue`: whether runs can be started."""
    press = f"`gyrobench run PROCEDURE --runs {folder}` begins one: this page then shows it by itself."
    happened = f"No run has begun in {folder} so far." if there else f"There is no folder {folder} yet."
    if bench and there:
        happened = f"Nothing goes on at {bench}: no live file of it is in {folder}."
    return Banner(
        "plain",
        "Idle",
        happened,
        press="Queue, above: choose what to run. This page then shows it by itself." if queue else press,
    )


def banner(found: Situation) -> Banner:
    """Return the banner of a session."""
    now = found.now
    if found.problem:
        return Banner(
            "bad",
            "Cannot be read",
            f"The live file of this session cannot be read: {found.problem}",
            "Unknown to this panel. What is shown below is what was read before.",
            "Look at table and chamber; the terminal that runs the session says how it is.",
        )
    if now is None:
        return NOT_HERE
    state = str(now["state"])
    if state == "ended":
        return _ended(now, found)
    if not now["alive"]:
        return _gone(found)
    if found.silent_s > _SILENT_S:
        return Banner(
            "bad",
            "No news",
            f"The bench's process runs but has said nothing for {found.silent_s:.0f} s.",
            "Unknown.",
            "Abort. If nothing changes within a minute: emergency stop at the table, then look at the host.",
        )
    if safe := _safe_states(found.events):
        why = safe[0].why.capitalize()
        if not all(device.confirmed for device in safe):
            return Banner("bad", "Not confirmed safe", why, _told(safe), _GO_AND_LOOK)
        tone: Tone = "good" if safe[0].cause == "end_of_run" else "bad"
        return Banner(tone, "Closing", why, _told(safe), "Nothing: the record is being closed.")
    return _going_on(now, state, found.events)


def _going_on(now: Mapping[str, Any], state: str, events: Sequence[Event]) -> Banner:
    shown = _listed(now, "alarms")
    alarms = [event for event in shown if not isinstance(event, Invalid)]
    if state == "asking" and not alarms and (now.get("run") or {}).get("procedure") == MANUAL:
        return Banner(
            "plain", "By hand", "The bench does what it is told, one order at a time.",
            "Limits, watchdog and record are those of every run.",
            "Order something below. Abort ends the run and makes the bench safe.",
        )  # fmt: skip
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
            "Abort if table, chamber or unit are in danger; else acknowledge it below.",
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


def _gone(found: Situation) -> Banner:
    """Return the banner of a session whose process ended without a word, with what its watchdog did."""
    happened = (
        "The process that drives the bench has ended without a word: killed, crashed, or the power went."
    )
    campaign = bool((found.now or {}).get("campaign"))
    after = (
        f"When the cause is clear: {'go on with the campaign' if campaign else 'start the run anew'} (Queue)."
    )
    begun = next((event for event in found.watchdog if isinstance(event, Takeover)), None)
    ended = next((event for event in found.watchdog if isinstance(event, TakeoverEnded)), None)
    told = _told(found.safe)
    if begun is None:
        if found.safe and all(device.confirmed for device in found.safe):
            return Banner("bad", "Process gone", happened, told, f"Nothing is urgent. {after}")
        if found.emulated:
            done = "The lab is emulated: nothing real moves."
            return Banner("bad", "Process gone", happened, done, f"Nothing is urgent. {after}")
        done = told or "No watchdog has said anything: nobody has confirmed that table and chamber are safe."
        return Banner("bad", "Process gone", happened, done, f"Go and look at table and chamber. {after}")
    took = f"The watchdog took over at {begun.utc[11:19]} UTC ({begun})"
    if ended is None:
        going = f"{took} and is stopping table and chamber" + (f": {told}" if told else ".")
        press = (
            "Watch this page for some seconds: it says when table and chamber have confirmed that they rest."
        )
        if any(not device.confirmed for device in found.safe):
            press = _GO_AND_LOOK
        return Banner("bad", "Watchdog at work", happened, going, press)
    if not ended.confirmed:
        return Banner("bad", "Not confirmed safe", happened, f"{took}; {told}", f"{_GO_AND_LOOK} {after}")
    press = f"Nothing is urgent: table and chamber have read back that they rest. {after}"
    return Banner("bad", "Stopped by the watchdog", happened, f"{took}; {told}", press)


def _ended(now: Mapping[str, Any], found: Situation) -> Banner:
    outcome, reason = str(now.get("outcome")), str(now.get("reason") or "")
    safe = found.safe
    done = _told(safe)
    if outcome == "completed":
        warned = "; ".join(str(text) for text in now.get("warnings") or ())
        return Banner(
            "good", "Completed", warned, done, "Nothing; the report has the details." if warned else ""
        )
    if outcome == "invalid":
        press = "Nothing is urgent. Read the reason; repeat the run if needed."
        shown = _listed(now, "alarms")
        if alarms := [event for event in shown if not isinstance(event, Invalid)]:
            press += f" The last alarm was: {sentence(alarms[-1])}"
        return Banner("doubt", "Invalid", reason, done, press)
    happened, remedy = _what_happened(now.get("error"), reason)
    if by := _who_aborted(found.events):
        happened = (
            f"{by} pressed abort." if happened == f"stopped by {by}" else f"{by} pressed abort. {happened}"
        )
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
        known = {key: text for key, text in parts.items() if key in ("what", "where", "found", "expected")}
        reason = str(BenchError(**known)) if "what" in known else reason
    return reason, f"{remedy[0].upper()}{remedy[1:].rstrip('.')}."


def _listed(now: Mapping[str, Any], key: str, **fields: str) -> list[Event]:
    """Return the events of a list of now.json, each line with `fields` in it."""
    return [event_of(fields | dict(row)) for row in now.get(key) or () if isinstance(row, Mapping)]


def _safe_states(events: Sequence[Event]) -> list[SafeState]:
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


def _who_aborted(events: Sequence[Event]) -> str:
    asked = [event.by for event in events if isinstance(event, Requested) and event.action == "abort"]
    return asked[0] if asked else ""
