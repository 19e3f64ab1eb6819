"""One axis of an emulated ACUTROL3000: interlock, mode, demands and limits.

In Synthesis mode the axis swings about its position demand, or about where it comes to rest if it was not in
Position mode (4.7.6); an enabled oscillator swings it in Position mode, too (4.2.19). In Track mode it follows
the vectors it is given and goes to Off mode where the next one is late (4.7.7).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from drivers.acutrol.codec import DIAGNOSTIC_BITS, INTERLOCK_BITS, SOFTWARE_FAULT_BITS
from drivers.acutrol.grammar import NOT_IMPLEMENTED, PARAMETER_OUT_OF_RANGE, WRONG_PARAMETER_COUNT
from simulators.emulators._acutrol_arguments import Refused, numbers
from simulators.emulators._acutrol_oscillator import Bounds, Oscillator
from simulators.plant.table import TableAxis

# Modes an axis has, with the number A<n>STATE shows in bits 0-3. The manual refers to the list in 4.7 for the
# numbers; counting that list from 0 is our reading.
MODES: Mapping[str, int] = {"POSITION": 0, "RATE": 1, "SYNTHESIS": 3, "TRACK": 4, "OFF": 6}
LIMITED_MODES = ("POSITION", "RATE", "ARATE", "SYNTHESIS", "TRACK")
_VECTORS: Mapping[str, int] = {"SHORTVECTOR": 2, "VECTOR": 3}
"""How many numbers a demand of all states has."""
_INTERVALS_MS = (0.0, 65535.0)
_AXIS_SERVOED, _NORMAL_UNSERVO, _SOFTWARE_ABORT, _HARDWARE_ABORT = 1 << 4, 1 << 5, 1 << 6, 1 << 7
_POSITION_COMPLETE, _RATE_COMPLETE = 1 << 8, 1 << 9


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
        self.oscillator = Oscillator()
        self._demands = {"POSITION": 0.0, "RATE": 0.0, "ACCELERATION": 0.0}
        self._interval_s = 0.0
        self._late_s = math.inf
        self.moving = False
        self._angle_limits = (min_angle_deg, max_angle_deg)
        self._unservo = _NORMAL_UNSERVO
        self._software_faults = 0
        self._interlock_faults = 0
        self._diagnostics = 0
        self._highest = {"RATE": plant.max_rate_dps, "ACCELERATION": plant.max_acceleration_dps2}
        self._limits = {mode: dict(self._highest) for mode in LIMITED_MODES}

    def trip(self, software: int, hardware: int, diagnostics: int, now_s: float) -> None:
        """Open the interlock by a fault, given as the bits of the two fault words and of what explains it."""
        self._diagnostics |= diagnostics
        self._software_faults |= software
        self._interlock_faults |= hardware
        self._unservo = _SOFTWARE_ABORT if software else _HARDWARE_ABORT
        self.interlock = "Fault"
        self.moving = False
        self.mode = "OFF"
        self.oscillator.reset()
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
            self.oscillator.reset()
            self.plant.servo(now_s, False)

    def reset(self) -> None:
        """Clear the faults."""
        if self.interlock == "Fault":
            self.interlock, self._unservo = "Open", _NORMAL_UNSERVO
            self._software_faults = self._interlock_faults = self._diagnostics = 0

    def mode_at(self, now_s: float) -> str:
        """Return the mode at `now_s`: a Track mode whose next vector is late has become Off."""
        if now_s > self._late_s:
            self.mode, self._late_s = "OFF", math.inf
        return self.mode

    def change_mode(self, mode: str, now_s: float, interval_ms: str = "1") -> None:
        """Take a mode of `MODES`; the demand that waits for it runs. `interval_ms`: of the vectors of Track."""
        (interval,) = numbers([interval_ms])
        low, high = _INTERVALS_MS
        if not low <= interval <= high:
            raise Refused(PARAMETER_OUT_OF_RANGE)
        before = self.mode_at(now_s)
        self.mode, self._interval_s, self._late_s = mode, interval / 1000.0, math.inf
        if mode == "SYNTHESIS" and before == mode:
            return
        self._apply(now_s, moving=before == "POSITION" and mode == "SYNTHESIS")

    def demand(self, name: str, texts: Sequence[str], now_s: float) -> None:
        """Take a demand; a relative one needs Position mode and changes the position demand."""
        mode = self.mode_at(now_s)
        if name == "OSCILLATOR":
            self.oscillator.set(texts)
            self._swing(now_s)
            return
        if name in _VECTORS:
            self._follow(texts, _VECTORS[name], now_s)
            return
        if name not in ("POSITION", "RATE", "DELTAPOSITION"):
            raise Refused(NOT_IMPLEMENTED)
        if len(texts) != 1:
            raise Refused(WRONG_PARAMETER_COUNT)
        (value,) = numbers(texts)
        if name == "DELTAPOSITION":
            self._turn(value, now_s)
            return
        if not self._within_limits(name, value):
            raise Refused(PARAMETER_OUT_OF_RANGE)
        self._demands[name] = value
        if mode == name:
            self._apply(now_s)

    def demanded(self, name: str) -> str:
        """Return the answer to a query of a demand."""
        if name == "OSCILLATOR":
            sine = self.oscillator.demand
            return f"{sine.amplitude:.6f};{sine.frequency_hz:.6f};{sine.phase_deg:.6f}"
        if name in _VECTORS:
            return ";".join(f"{value:.6f}" for value in list(self._demands.values())[: _VECTORS[name]])
        if name not in self._demands:
            raise Refused(NOT_IMPLEMENTED)
        return f"{self._demands[name]:.6f}"

    def configure_oscillator(self, texts: Sequence[str], now_s: float) -> None:
        """Take a configuration of the oscillator; what swings goes on by it."""
        self.oscillator.configure(texts)
        if self.mode_at(now_s) == "POSITION":
            self._apply(now_s)
        else:
            self._swing(now_s)

    def limit_values(self) -> tuple[float, ...]:
        """Return the absolute limits: rate, acceleration, jerk, low and high position, velocity trip."""
        low, high = self._angle_limits
        rate, acceleration = self.plant.max_rate_dps, self.plant.max_acceleration_dps2
        span = (-180.0 if low is None else low, 180.0 if high is None else high)
        return (rate, acceleration, 1000.0 * acceleration, *span, 1.1 * rate)

    def limit(self, name: str, mode: str) -> float:
        """Return the limit `name`, RATE or ACCELERATION, in force in `mode`."""
        return self._limits[mode][name]

    def set_limit(self, name: str, mode: str, text: str) -> None:
        """Set a limit of `mode`, one of `LIMITED_MODES`; it counts from the next demand on."""
        (value,) = numbers([text])
        if not 0.0 < value <= self._highest[name]:
            raise Refused(PARAMETER_OUT_OF_RANGE)
        self._limits[mode][name] = value

    def register(self, name: str, now_s: float) -> int | None:
        """Return status word A<n>`name`; None for a name there is none of."""
        if name in ("STATE", "STATIC"):
            servoed = _AXIS_SERVOED if self.interlock == "Close" else self._unservo
            return MODES[self.mode_at(now_s)] | servoed
        if name == "DYN":
            done = _POSITION_COMPLETE if self.mode_at(now_s) in ("POSITION", "SYNTHESIS") else _RATE_COMPLETE
            return self.oscillator.bits(now_s) | (done if self.plant.settled(now_s) else 0)
        software = self._software_faults
        words = {"SWFLT": software, "SWFAULT": software, "ERR": 0, "DIAG": self._diagnostics}
        return (words | {"INTLK": self._interlock_faults}).get(name)

    def _within_limits(self, name: str, value: float) -> bool:
        if name == "RATE":
            return abs(value) <= self._limits["RATE"]["RATE"]
        low, high = self._angle_limits
        return (low is None or value >= low) and (high is None or value <= high) and abs(value) < 1e6

    def _turn(self, by_deg: float, now_s: float) -> None:
        angle = self._demands["POSITION"] + by_deg
        if self.mode != "POSITION" or not self._within_limits("POSITION", angle):
            raise Refused(PARAMETER_OUT_OF_RANGE)
        self._demands["POSITION"] = angle
        if self.interlock == "Close":
            self.plant.demand_turn(now_s, by_deg, *self._limits["POSITION"].values())
            self.moving = True

    def _follow(self, texts: Sequence[str], count: int, now_s: float) -> None:
        """Take position, rate and, of three, acceleration of a vector; it runs in Track mode."""
        if len(texts) != count:
            raise Refused(WRONG_PARAMETER_COUNT)
        angle, rate, acceleration = (*numbers(texts), 0.0)[:3]
        limits = self._limits["TRACK"]
        if (
            not self._within_limits("POSITION", angle)
            or abs(rate) > limits["RATE"]
            or abs(acceleration) > limits["ACCELERATION"]
        ):
            raise Refused(PARAMETER_OUT_OF_RANGE)
        self._demands = {"POSITION": angle, "RATE": rate, "ACCELERATION": acceleration}
        if self.mode != "TRACK" or self.interlock != "Close":
            return
        hold_s = self._interval_s or math.inf
        self._late_s = now_s + hold_s
        shortest = None in self._angle_limits
        self.plant.demand_states(
            now_s, (angle, rate, acceleration), hold_s, *limits.values(), shortest=shortest
        )
        self.moving = True

    def _apply(self, now_s: float, *, moving: bool = False) -> None:
        """Run the demand of the mode. `moving`: a motion to a position goes on, to be swung about."""
        if not (moving and self.oscillator.enabled):
            self.oscillator.reset()
        if self.interlock != "Close":
            return
        limits = self._limits["POSITION"].values()
        if self.mode == "POSITION" and None not in self._angle_limits:
            self.plant.demand_turn(now_s, self._way(now_s), *limits)
        elif self.mode == "POSITION":
            self.plant.demand_angle(now_s, self._demands["POSITION"], *limits)
        elif self.mode == "RATE":
            self.plant.demand_rate(now_s, self._demands["RATE"], self._limits["RATE"]["ACCELERATION"])
        elif not moving:
            self.plant.demand_rate(now_s, 0.0)
        self.moving = True
        self._swing(now_s)

    def _swing(self, now_s: float) -> None:
        """Let the oscillator move the axis where it does so in this mode."""
        swung = self.mode == "SYNTHESIS" or (self.mode == "POSITION" and self.oscillator.enabled)
        if self.interlock != "Close" or not swung:
            return
        limits, (low, high) = self._limits["SYNTHESIS"], self._angle_limits
        from_s, centre = self.plant.rest(now_s)
        room = min(math.inf if high is None else high - centre, math.inf if low is None else centre - low)
        bounds = Bounds(limits["RATE"], limits["ACCELERATION"], room)
        self.plant.demand_swing(now_s, self.oscillator.swings(from_s, bounds))

    def _way(self, now_s: float) -> float:
        """Return the turn to the position demand that stays between the stops of a limited axis."""
        middle = sum(limit or 0.0 for limit in self._angle_limits) / 2.0
        return (
            self._demands["POSITION"] - middle - math.remainder(self.plant.angle_deg(now_s) - middle, 360.0)
        )


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
