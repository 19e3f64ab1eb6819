"""One axis of an emulated ACUTROL3000: interlock, mode, demands and limits."""

from __future__ import annotations

import math
from collections.abc import Mapping

from drivers.acutrol.codec import DIAGNOSTIC_BITS, INTERLOCK_BITS, SOFTWARE_FAULT_BITS
from drivers.acutrol.grammar import DATA_TYPE_ERROR, NOT_IMPLEMENTED, PARAMETER_OUT_OF_RANGE, Refusal
from simulators.plant.table import TableAxis

# Modes an axis has, with the number A<n>STATE shows in bits 0-3. The manual refers to the list in 4.7 for the
# numbers; counting that list from 0 is our reading.
MODES: Mapping[str, int] = {"POSITION": 0, "RATE": 1, "OFF": 6}
DEMANDS = ("POSITION", "RATE", "DELTAPOSITION")
_AXIS_SERVOED, _NORMAL_UNSERVO, _SOFTWARE_ABORT, _HARDWARE_ABORT = 1 << 4, 1 << 5, 1 << 6, 1 << 7
_POSITION_COMPLETE, _RATE_COMPLETE = 1 << 8, 1 << 9


class Refused(Exception):
    """A command was not carried out; its argument is the `Refusal`."""

    def __init__(self, refusal: Refusal) -> None:
        super().__init__(refusal.text)
        self.refusal = refusal


class AcutrolAxis:
    """State of one axis on its plant.

    `min_angle_deg` and `max_angle_deg` make a limited-motion axis; None for both is a continuous one. Demands
    wait while the axis is not servoed and run from the moment the interlock closes.
    """

    def __init__(
        self, plant: TableAxis, min_angle_deg: float | None = None, max_angle_deg: float | None = None
    ) -> None:
        self.plant = plant
        self.interlock = "Open"
        self.mode = "OFF"
        self.demands = {"POSITION": 0.0, "RATE": 0.0}
        self.moving = False
        self._angle_limits = (min_angle_deg, max_angle_deg)
        self._unservo = _NORMAL_UNSERVO
        self._software_faults = 0
        self._interlock_faults = 0
        self._diagnostics = 0
        self._highest = {"RATE": plant.max_rate_dps, "ACCELERATION": plant.max_acceleration_dps2}
        self._limits = {mode: dict(self._highest) for mode in ("POSITION", "RATE")}

    def trip(self, software: int, hardware: int, diagnostics: int, now_s: float) -> None:
        """Open the interlock by a fault, given as the bits of the two fault words and of what explains it."""
        self._diagnostics |= diagnostics
        self._software_faults |= software
        self._interlock_faults |= hardware
        self._unservo = _SOFTWARE_ABORT if software else _HARDWARE_ABORT
        self.interlock = "Fault"
        self.moving = False
        self.mode = "OFF"
        self.plant.servo(now_s, False)

    def close(self, now_s: float) -> None:
        """Close the interlock of an axis that is open and without fault."""
        if self.interlock == "Open":
            self.interlock = "Close"
            self.plant.servo(now_s, True)
            self._apply(now_s)

    def open(self, now_s: float) -> None:
        """Open the interlock: the axis coasts to rest."""
        if self.interlock == "Close":
            self.interlock, self._unservo, self.mode = "Open", _NORMAL_UNSERVO, "OFF"
            self.plant.servo(now_s, False)

    def reset(self) -> None:
        """Clear the faults."""
        if self.interlock == "Fault":
            self.interlock, self._unservo = "Open", _NORMAL_UNSERVO
            self._software_faults = self._interlock_faults = self._diagnostics = 0

    def change_mode(self, mode: str, now_s: float) -> None:
        """Take a mode of `MODES`; the demand that waits for it runs."""
        self.mode = mode
        self._apply(now_s)

    def demand(self, name: str, text: str, now_s: float) -> None:
        """Take a demand of `DEMANDS`; a relative one needs position mode and changes the position demand."""
        try:
            value = float(text)
        except ValueError:
            raise Refused(DATA_TYPE_ERROR) from None
        if name == "DELTAPOSITION":
            self._turn(value, now_s)
            return
        if not self._within_limits(name, value):
            raise Refused(PARAMETER_OUT_OF_RANGE)
        self.demands[name] = value
        if self.mode == name:
            self._apply(now_s)

    def limit_values(self) -> tuple[float, ...]:
        """Return the absolute limits: rate, acceleration, jerk, low and high position, velocity trip."""
        low, high = self._angle_limits
        rate, acceleration = self.plant.max_rate_dps, self.plant.max_acceleration_dps2
        span = (-180.0 if low is None else low, 180.0 if high is None else high)
        return (rate, acceleration, 1000.0 * acceleration, *span, 1.1 * rate)

    def limit(self, name: str, mode: str) -> float:
        """Return the limit `name`, RATE or ACCELERATION, in force in `mode`."""
        return self._limits.get(mode, self._highest)[name]

    def set_limit(self, name: str, mode: str, text: str) -> None:
        """Set a limit of `mode`, POSITION or RATE; it counts from the next demand on."""
        if mode not in self._limits or name == mode == "RATE":
            raise Refused(NOT_IMPLEMENTED)
        try:
            value = float(text)
        except ValueError:
            raise Refused(DATA_TYPE_ERROR) from None
        if not 0.0 < value <= self._highest[name]:
            raise Refused(PARAMETER_OUT_OF_RANGE)
        self._limits[mode][name] = value

    def register(self, name: str, now_s: float) -> int | None:
        """Return status word A<n>`name`; None for a name there is none of."""
        if name in ("STATE", "STATIC"):
            servoed = _AXIS_SERVOED if self.interlock == "Close" else self._unservo
            return MODES[self.mode] | servoed
        if name == "DYN":
            done = _POSITION_COMPLETE if self.mode == "POSITION" else _RATE_COMPLETE
            return done if self.plant.settled(now_s) else 0
        software = self._software_faults
        words = {"SWFLT": software, "SWFAULT": software, "ERR": 0, "DIAG": self._diagnostics}
        return (words | {"INTLK": self._interlock_faults}).get(name)

    def _within_limits(self, name: str, value: float) -> bool:
        if name == "RATE":
            return abs(value) <= self.plant.max_rate_dps
        low, high = self._angle_limits
        return (low is None or value >= low) and (high is None or value <= high) and abs(value) < 1e6

    def _turn(self, by_deg: float, now_s: float) -> None:
        angle = self.demands["POSITION"] + by_deg
        if self.mode != "POSITION" or not math.isfinite(by_deg) or not self._within_limits("POSITION", angle):
            raise Refused(PARAMETER_OUT_OF_RANGE)
        self.demands["POSITION"] = angle
        if self.interlock == "Close":
            self.plant.demand_turn(now_s, by_deg, *self._limits["POSITION"].values())
            self.moving = True

    def _apply(self, now_s: float) -> None:
        if self.interlock != "Close":
            return
        limits = self._limits["POSITION"].values()
        if self.mode == "POSITION" and None not in self._angle_limits:
            self.plant.demand_turn(now_s, self._way(now_s), *limits)
        elif self.mode == "POSITION":
            self.plant.demand_angle(now_s, self.demands["POSITION"], *limits)
        elif self.mode == "RATE":
            self.plant.demand_rate(now_s, self.demands["RATE"], self._limits["RATE"]["ACCELERATION"])
        else:
            self.plant.demand_rate(now_s, 0.0)
        self.moving = True

    def _way(self, now_s: float) -> float:
        """Return the turn to the position demand that stays between the stops of a limited axis."""
        middle = sum(limit or 0.0 for limit in self._angle_limits) / 2.0
        return self.demands["POSITION"] - middle - math.remainder(self.plant.angle_deg(now_s) - middle, 360.0)


FAULT_NAMES = (
    *SOFTWARE_FAULT_BITS.values(),
    *INTERLOCK_BITS.values(),
    *(words for words in DIAGNOSTIC_BITS.values() if words.endswith("fault")),
)
"""What may open an interlock, in words."""


def fault_bits(reason: str) -> tuple[int, int, int] | None:
    """Return (software, interlock, diagnostic) words of a fault's name; None if there is no such fault.

    A fault that diagnostics find is a failed self-test.
    """
    software = {words: 1 << bit for bit, words in SOFTWARE_FAULT_BITS.items()}
    hardware = {words: 1 << bit for bit, words in INTERLOCK_BITS.items()}
    diagnostics = {words: 1 << bit for bit, words in DIAGNOSTIC_BITS.items() if words.endswith("fault")}
    if reason in diagnostics:
        return software["self-test failure"], 0, diagnostics[reason]
    if reason not in software and reason not in hardware:
        return None
    return software.get(reason, 0), hardware.get(reason, 0), 0
