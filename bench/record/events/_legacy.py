"""Lines of run folders written before events were typed: the only place where a sentence is read.

Until November 2026 a demand was a `command` with a text, an invalid run and what was not confirmed safe were an
`alarm` with a text, what a device read back was a `note`. Nothing writes these any more.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from bench.record.events._base import Event
from bench.record.events.run import (
    AirDemand,
    AngleDemand,
    ConditioningDemand,
    HomeDemand,
    Invalid,
    NavigationDemand,
    RateDemand,
)
from bench.record.events.safe import SafeState, Takeover, TakeoverEnded

_GO = re.compile(r"go to (\S+) degC (?:at (\S+) K/min|as fast as possible)")
_POINT = re.compile(r"point to (\S+) deg(?:, (positive|negative) sense)?")
_SPIN = re.compile(r"spin at (\S+) deg/s(?: within (\S+) deg/s2)?")
_TABLE = re.compile(r"table(?:, (\S+) axis)?")
_AT_REST = re.compile(r"(table|chamber) at rest: (.*)")
_RATE = re.compile(r"(?:(\S+) )?(-?[\d.]+) deg/s")
_SET_POINT = re.compile(r"set point (\S+) degC")
_NOT_SAFE = re.compile(r"not confirmed safe: (?:(table|chamber|bench): )?(.*)", re.DOTALL)
_PENDING = re.compile(r"(.*): STOP IT BY HAND\. Being made safe: (.*)", re.DOTALL)
_INVALID = re.compile(r"run invalid: (.*)", re.DOTALL)
_SILENT = re.compile(r"no sign of life for (\S+) s")


def typed(row: Mapping[str, Any]) -> Event | None:
    """Return what a line says whose kind or form is no longer written; None for any other line."""
    kind, text = row["kind"], row.get("text")
    if kind == "takeover":
        return _takeover(row)
    if kind == "outcome" and row.get("outcome") in ("made safe", "not confirmed safe"):
        return TakeoverEnded(row["outcome"] == "made safe")
    if kind not in ("command", "alarm", "note") or not isinstance(text, str):
        return None
    device = row.get("device", "")
    if not isinstance(device, str):
        raise ValueError("device is no text")
    try:
        return {"command": _demand, "alarm": _alarm, "note": _read_back}[kind](device, text)
    except ValueError as error:
        raise ValueError(f"{kind}: a number in {text!r}") from error


def _demand(device: str, text: str) -> Event | None:
    if table := _TABLE.fullmatch(device):
        axis = table[1] or "table"
        if text == "go home":
            return HomeDemand("table", axis)
        if match := _POINT.match(text):
            sense: Any = match[2] or "shortest"
            return AngleDemand("table", axis, float(match[1]), sense)
        if match := _SPIN.match(text):
            return RateDemand("table", axis, float(match[1]), float(match[2]) if match[2] else None)
    if match := _GO.match(text):
        return AirDemand(device, float(match[1]), float(match[2]) if match[2] else None)
    if text in ("start", "stop"):
        return ConditioningDemand(device, text == "start")
    return NavigationDemand(device) if text == "navigate" else None


def _alarm(device: str, text: str) -> Event | None:
    if match := _INVALID.match(text):
        return Invalid("", match[1], {})
    if match := _NOT_SAFE.match(text):
        if device == "bench":
            return SafeState(match[1] or device, "not_confirmed", "trouble", error=match[2])
        pending = _PENDING.match(match[2])
        error, why = (pending[1], pending[2]) if pending else (match[2], "")
        return SafeState(device, "pending", "trouble", why, error=error)
    return None


def _read_back(_: str, text: str) -> Event | None:
    match = _AT_REST.match(text)
    if match is None:
        return None
    device, said = match[1], match[2]
    if device == "table":
        rates = {axis or "table": float(rate) for axis, rate in _RATE.findall(said)}
        return SafeState(device, "confirmed", "trouble", rates_dps=rates)
    point = _SET_POINT.search(said)
    running = "running" in said
    return SafeState(
        device, "confirmed", "trouble", running=running, set_point_c=float(point[1]) if point else None
    )


def _takeover(row: Mapping[str, Any]) -> Event | None:
    cause = row.get("cause")
    if not isinstance(cause, str) or cause in ("runner_ended", "runner_silent"):
        return None
    silent = _SILENT.search(cause)
    return Takeover(
        "runner_silent" if silent else "runner_ended",
        str(row.get("utc", "")),
        int(row.get("runner") or 0),
        float(silent[1]) if silent else None,
    )
