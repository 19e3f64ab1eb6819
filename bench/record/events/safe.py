"""What became of the bench when a run ended or was taken over: one fact a device, with what it read back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from bench.record.events._base import Event, Flag, Number, Whole

Confirmation = Literal["confirmed", "pending", "not_confirmed"]
NotSafe = Literal[
    "port_gone", "silent", "refused", "garbled", "not_at_rest", "not_confirming", "replaced", "cut_off"
]
"""Why a device is not confirmed safe: its port is gone; it gives no answer; it says no; its answers make no
sense; it took the command and is not at rest; it has not confirmed its stop so far; its port leads to another
device; the way to the safe state was cut off."""
Cause = Literal["end_of_run", "trouble", "takeover"]


@dataclass(frozen=True)
class LastSeen:
    """The last telemetry of a device before it was made safe, and how long ago that was."""

    ago_s: Number
    rates_dps: dict[str, Number] | None = None
    air_temp_c: Number | None = None
    set_point_c: Number | None = None


class SafeState(Event, kind="safe_state"):
    """Whether a device is in its safe state; `state` "pending": not yet, a later line has the end.

    What it read back: `rates_dps` of every axis, `running` and `set_point_c` of a chamber, `outputs` of a supply
    (number -> whether it is on). `why` the bench was made safe and `error`, what the way to it met, are for
    people.
    """

    device: str
    state: Confirmation
    cause: Cause
    why: str = ""
    code: NotSafe | None = None
    error: str | None = None
    rates_dps: dict[str, Number] | None = None
    running: Flag | None = None
    set_point_c: Number | None = None
    outputs: dict[str, Flag] | None = None
    last_seen: LastSeen | None = None

    @property
    def confirmed(self) -> bool:
        """Whether it read back that it rests."""
        return self.state == "confirmed"

    @property
    def alarms(self) -> bool:
        """What is not confirmed is an alarm."""
        return not self.confirmed

    def __str__(self) -> str:
        """Return it as a text for reports of errors and for whoever stands at the bench."""
        if self.confirmed:
            return f"{self.device} {'safe' if self.outputs else 'at rest'}: {self._read_back()}"
        read_back = self._read_back()
        if self.code in ("port_gone", "cut_off") or read_back or not self.error:
            why = _REASONS[self.code or "not_confirming"] + (f": {read_back}" if read_back else "")
        else:
            why = self.error
        why = "its port is gone" if self.code == "port_gone" and self.state == "pending" else why.rstrip(".")
        return f"{self.device}: {why}{self._seen()}"

    def _read_back(self) -> str:
        return read_back_words(self.rates_dps or {}, self.running, self.set_point_c, self.outputs or {})

    def _seen(self) -> str:
        seen = self.last_seen
        if seen is None:
            return ""
        if seen.rates_dps is not None:
            rates = ", ".join(f"{rate:.3f} deg/s" for rate in seen.rates_dps.values())
            return f" ({seen.ago_s:.0f} s ago it turned at {rates})"
        if seen.air_temp_c is None or seen.set_point_c is None:
            return ""
        air, target = seen.air_temp_c, seen.set_point_c
        return f" ({seen.ago_s:.0f} s ago its air was at {air:.1f} degC, the set point {target:.1f} degC)"


_REASONS: dict[NotSafe, str] = {
    "port_gone": "its port is gone and has not come back",
    "silent": "it does not answer",
    "refused": "it refuses",
    "garbled": "its answers make no sense",
    "not_at_rest": "it took the command and is not at rest",
    "not_confirming": "it does not confirm its stop",
    "replaced": "its port leads to another device",
    "cut_off": "the way to the safe state was cut off",
}


def read_back_words(
    rates_dps: Mapping[str, float],
    running: bool | None,
    set_point_c: float | None,
    outputs: Mapping[str, bool],
) -> str:
    """Return what a device read back."""
    parts = [
        f"{axis + ' ' if len(rates_dps) > 1 else ''}{rate:.4f} deg/s" for axis, rate in rates_dps.items()
    ]
    if running is not None:
        parts.append("running" if running else "stopped")
    if set_point_c is not None:
        parts.append(f"set point {set_point_c:g} degC")
    parts += [f"output {number} {'on' if on else 'off'}" for number, on in outputs.items()]
    return ", ".join(parts)


class Takeover(Event, kind="takeover"):
    """The watchdog takes the bench over: the runner's process ended, or gave no sign of life for `silent_s`."""

    cause: Literal["runner_ended", "runner_silent"]
    utc: str
    runner: Whole
    silent_s: Number | None = None

    def __str__(self) -> str:
        if self.silent_s is None:
            return "the runner's process has ended"
        return f"no sign of life for {self.silent_s:.1f} s"


class TakeoverEnded(Event, kind="takeover_ended"):
    """The watchdog has done what it could."""

    confirmed: Flag

    def __str__(self) -> str:
        return "made safe" if self.confirmed else "not confirmed safe"
