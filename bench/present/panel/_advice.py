"""What an operator has to know at a glance: what happened, what the bench has done, what to press."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

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

    def as_dict(self) -> dict[str, str]:
        """Return it as plain values."""
        return asdict(self)


NOT_HERE = Banner(
    "plain",
    "Not here",
    "There is no session of that name in this runs folder.",
    press="Open the panel without ?session=.",
)


def banner(now: Mapping[str, Any] | None, lines: Sequence[Mapping[str, Any]], age_s: float) -> Banner:
    """Return the banner of a session: `now` as read, the run's last events, how long `now` stands still."""
    if now is None:
        return Banner(
            "plain", "Idle", "Nothing runs in this runs folder.", press="Start a run or a campaign."
        )
    state = str(now.get("state"))
    if state == "ended":
        return _ended(now, lines)
    if not now.get("alive"):
        return Banner(
            "bad",
            "Process gone",
            "The process that drives the bench has ended without a word: killed, crashed, or the power went.",
            _made_safe(lines) or "Nobody has confirmed that table and chamber are safe.",
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
    if safe := _made_safe(lines):
        why = _why(lines)
        if "not confirmed safe" in safe:
            return Banner("bad", "Not confirmed safe", why, safe, _GO_AND_LOOK)
        tone: Tone = "good" if why.startswith("End of the run") else "bad"
        return Banner(tone, "Closing", why, safe, "Nothing: the record is being closed.")
    alarms = [line for line in now.get("alarms") or () if _is_alarm(line)]
    if state == "asking":
        return Banner(
            "doubt", "Waiting for you", "The bench has a question.", "It stands still; telemetry runs.",
            "Answer the question.",
        )  # fmt: skip
    if alarms:
        last = alarms[-1]
        return Banner(
            "bad",
            "Alarm",
            f"{last.get('device', 'bench')}: {last.get('text', '')}",
            "The run goes on: nothing has been stopped for this alarm.",
            "Abort if table, chamber or unit are in danger; else nothing.",
        )
    invalid = [text for line in now.get("alarms") or () if (text := _invalid(line))]
    if invalid and state == "running":
        return Banner(
            "doubt",
            "Running, invalid",
            invalid[0],
            "The run goes on: the other units' data are kept. It will be sealed as invalid.",
            "Nothing is urgent. Abort if nobody needs the rest.",
        )
    if state == "paused":
        return Banner(
            "doubt", "Paused", _who_paused(lines), "Telemetry runs; the chamber holds its set point.",
            "Resume, or abort.",
        )  # fmt: skip
    if now.get("pause_wanted"):
        return Banner(
            "doubt", "Pause asked for", "The run stops before its next step.", press="Nothing; or resume."
        )
    return Banner("good", "Starting" if state == "starting" else "Running")


def _ended(now: Mapping[str, Any], lines: Sequence[Mapping[str, Any]]) -> Banner:
    outcome, reason = str(now.get("outcome")), str(now.get("reason") or "")
    done = _made_safe(lines)
    if outcome == "completed":
        warned = "; ".join(str(text) for text in now.get("warnings") or ())
        return Banner(
            "good", "Completed", warned, done, "Nothing; the report has the details." if warned else ""
        )
    if outcome == "invalid":
        press = "Nothing is urgent. Read the reason; repeat the run if needed."
        if alarms := [line for line in now.get("alarms") or () if _is_alarm(line)]:
            press += f" The last alarm was: {alarms[-1].get('device', 'bench')}: {alarms[-1].get('text', '')}"
        return Banner("doubt", "Invalid", reason, done, press)
    unsafe = "NOT CONFIRMED SAFE" in reason or "not confirmed safe" in done
    # What is not confirmed is said under what the bench has done, the remedy under what to press.
    happened, _, remedy = reason.partition("NOT CONFIRMED SAFE")[0].strip().partition(" Remedy: ")
    remedy = remedy.removeprefix("the bench is being made safe; ") or "clear the cause before starting again."
    press = f"{_GO_AND_LOOK if unsafe else 'Nothing is urgent.'} {remedy[0].upper()}{remedy[1:]}"
    if unsafe:
        return Banner("bad", "Not confirmed safe", happened, done, press)
    return Banner(
        "bad", "Aborted" if outcome == "aborted" else outcome.capitalize() or "Ended", happened, done, press
    )


def _made_safe(lines: Sequence[Mapping[str, Any]]) -> str:
    """Return what the event log says of the safe state at its end, empty if nothing was made safe since."""
    ending: list[str] = []
    for line in reversed(lines):
        if line.get("kind") not in ("note", "alarm", "outcome", "request"):
            break
        text = str(line.get("text", ""))
        if "made safe" in text or text.startswith(("table ", "chamber ", "not confirmed safe")):
            ending.append(text)
        if text.startswith(("made safe", "not made safe")):  # what stands before was said on the way
            break
    if not any("made safe" in text for text in ending):
        return ""
    ending.reverse()
    if any(text.startswith("not confirmed safe") for text in ending):  # first what is in danger
        ending = [text for text in ending if not text.startswith("not made safe")] or ending
        ending.sort(key=lambda text: not text.startswith("not confirmed safe"))
    return "; ".join(_shortened(text) for text in ending)


def _why(lines: Sequence[Mapping[str, Any]]) -> str:
    """Return why the bench was made safe, as its own note says."""
    said = next((str(line["text"]) for line in reversed(lines) if "made safe: " in str(line.get("text"))), "")
    return said.partition("made safe: ")[2].capitalize()


def _shortened(text: str) -> str:
    """Return a log line without the long reason that the banner says already."""
    head, colon, _ = text.partition(": ")
    return f"bench {head}" if colon and head.endswith("made safe") else text


def _who_paused(lines: Sequence[Mapping[str, Any]]) -> str:
    by = next((line.get("by") for line in reversed(lines) if line.get("kind") == "paused"), None)
    return f"Paused by {by}." if by else "Paused between two runs."


def _is_alarm(line: Mapping[str, Any]) -> bool:
    return not _invalid(line)


def _invalid(line: Mapping[str, Any]) -> str:
    """Return why the run was found invalid, if this alarm says so."""
    head, _, why = str(line.get("text", "")).partition("run invalid: ")
    return "" if head else why


def sentence(line: Mapping[str, Any]) -> str:
    """Return an event as a line of the log."""
    kind = line.get("kind")
    forms = {
        "step": "{code} {title}",
        "phase": "phase {phase}",
        "command": "{device}: {text}",
        "prompt": "asks: {question}",
        "answer": "{by} answered {answer}",
        "request": "{by} asks for {action}",
        "paused": "paused by {by}",
        "resumed": "resumed by {by}",
        "note": "{text}",
        "alarm": "{device}: {text}",
        "units_off": "units to be switched off and on",
        "units_on": "units are on again",
        "outcome": "{outcome} {reason}",
    }
    if kind == "measurement":
        value = line.get("value")
        number = f"{value:.6g}" if isinstance(value, int | float) else "-"
        verdict = {True: ", inside", False: ", OUTSIDE"}.get(line.get("passed"), "")  # type: ignore[arg-type]
        limited = line.get("low") is not None or line.get("high") is not None
        name = str(line.get("name", "")).replace("_", " ")
        return f"{name} = {number} {line.get('unit') or ''}{verdict if limited else ''}"
    form = forms.get(str(kind))
    if form is None:
        rest = {key: value for key, value in line.items() if key not in ("time_s", "kind", "utc")}
        return ", ".join(f"{key} {value}" for key, value in rest.items())
    return form.format_map(_Blank(line)).strip()


class _Blank(dict[str, Any]):
    """Fields of a line; one that is missing is blank."""

    def __missing__(self, key: str) -> str:
        return ""
