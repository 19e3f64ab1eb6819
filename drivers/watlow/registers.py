"""Registers of the Watlow F4 and F4T, relative numbers, and what their words mean; no I/O.

F4: Watlow manual 0600-0032-0013 (F4P) and ESPEC's ChamberConnectLibrary (MIT): signed 16-bit numbers, scaled
by the decimal places that the controller itself reports. F4T: ChamberConnectLibrary and, for the ramp,
TestEquity's manual of its F4T chambers, pages 14 and 52: float32 in two registers, the low word first; data
map 1; in the unit of the Modbus channel, which is not that of the panel (1328).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

from drivers.base.errors import ProtocolError
from drivers.kit.modbus import Framing, to_signed, words_float

AIR_C, SET_POINT_C = "air_temp_c", "set_point_c"


class F4:
    """Register numbers of the F4."""

    INPUTS: ClassVar[Mapping[int, int]] = {1: 100, 2: 104, 3: 108}
    DECIMALS: ClassVar[Mapping[int, int]] = {1: 606, 2: 616, 3: 626}
    ALARMS: ClassVar[Mapping[int, int]] = {1: 102, 2: 106}
    SET_POINT = 300
    SET_POINT_LOW, SET_POINT_HIGH = 602, 603
    CELSIUS = 901
    RAMP_MODE, RAMP_RATE, RAMP_UNIT = 1100, 1101, 1102
    PROFILE, NO_PROFILE = 200, 1
    END_PROFILE = 1217
    OUTPUT_1 = 2000
    OUTPUT_STEP = 10


class F4T:
    """Register numbers of the F4T's control loop 1; loop n adds 160 (n - 1)."""

    MODE = 2730
    SET_POINT_LOW, SET_POINT_HIGH = 2774, 2776
    SET_POINT = 2782
    RAMP_ACTION, RAMP_SCALE, RAMP_RATE = 2794, 2796, 2798
    ACTIVE_SET_POINT = 2810
    ACTIVE_MODE = 2814
    AIR = 2820
    ALARM_REGISTERS: ClassVar[Mapping[int, int]] = {n + 1: 1356 + 100 * n for n in range(6)}
    UNITS: ClassVar[Mapping[Framing, int]] = {"rtu": 14080, "tcp": 6730}
    """Display Units of the serial and of the Ethernet Modbus channel."""
    CELSIUS, FAHRENHEIT = 15, 30
    AUTO, MANUAL, OFF = 10, 54, 62
    RAMP_OFF, RAMP_BOTH, PER_MINUTE = 62, 13, 57
    ALARM_WORDS: ClassVar[Mapping[int, str]] = {
        61: "",
        88: "",
        53: "low",
        37: "high",
        28: "error",
        49: "latched",
        24: "deviation",
    }
    """Alarm states that ChamberConnectLibrary names; 61 is none and 88 the start-up state, neither an alarm."""


F4_WORDS: Mapping[int, str] = {
    **{register: f"input {number}" for number, register in F4.INPUTS.items()},
    **{register: f"decimal places of input {number}" for number, register in F4.DECIMALS.items()},
    **{register: f"state of alarm {number}" for number, register in F4.ALARMS.items()},
    F4.SET_POINT: "set point",
    F4.SET_POINT_LOW: "set point limits",
    F4.CELSIUS: "unit of temperature",
    F4.RAMP_MODE: "ramp on or off",
    F4.RAMP_RATE: "ramp rate",
    F4.RAMP_UNIT: "unit of the ramp rate",
    **{F4.OUTPUT_1 + F4.OUTPUT_STEP * n: f"digital output {n + 1}" for n in range(8)},
}
F4T_WORDS: Mapping[int, str] = {
    **dict.fromkeys(F4T.UNITS.values(), "unit of temperature"),
    F4T.MODE: "control mode",
    F4T.SET_POINT_LOW: "set point limits",
    F4T.SET_POINT: "set point",
    F4T.RAMP_ACTION: "ramp on or off",
    F4T.RAMP_SCALE: "unit of the ramp rate",
    F4T.RAMP_RATE: "ramp rate",
    F4T.ACTIVE_SET_POINT: "set point in force",
    F4T.ACTIVE_MODE: "control mode in force",
    F4T.AIR: "air temperature",
    **{register: f"state of alarm {number}" for number, register in F4T.ALARM_REGISTERS.items()},
}
"""What is in the registers that the bench reads and writes, by the first one's number."""


def scaled(word: int, decimals: int) -> float:
    """Return an F4 register as a number: signed, with so many decimal places."""
    return to_signed(word) / 10.0**decimals


def unscaled(value: float, decimals: int) -> int:
    """Return the register for a number; ProtocolError beyond what 16 bits hold."""
    number = round(value * 10.0**decimals)
    if not -0x8000 <= number <= 0x7FFF:
        raise ProtocolError(
            "a value does not fit an F4 register",
            found=f"{value:g} at {decimals} decimal places",
            expected=f"{-0x8000 / 10**decimals:g} .. {0x7FFF / 10**decimals:g}",
        )
    return number & 0xFFFF


class F4Readings:
    """Turns registers of the F4 into telemetry, given what it said before; used live and on records."""

    def __init__(self) -> None:
        self.decimals = dict.fromkeys(F4.INPUTS, 1)
        self._inputs: dict[int, float] = {}

    def take(self, start: int, words: Sequence[int]) -> dict[str, float] | None:
        """Take an answer; return air, set point and inputs 2 and 3 when it completes a state.

        The set point is the one demanded: the F4 has no register for the ramp's momentary value that is public.
        """
        for number, register in F4.DECIMALS.items():
            if start == register and len(words) == 1 and words[0] in range(4):
                self.decimals[number] = words[0]
        for number, register in F4.INPUTS.items():
            if start == register and len(words) == 1:
                self._inputs[number] = scaled(words[0], self.decimals[number])
        if start != F4.SET_POINT or len(words) != 1 or 1 not in self._inputs:
            return None
        inputs, self._inputs = self._inputs, {}
        set_point_c = scaled(words[0], self.decimals[1])
        others = {f"aux_{number}_temp_c": value for number, value in inputs.items() if number > 1}
        return {AIR_C: inputs[1], SET_POINT_C: set_point_c, **others}


class F4TReadings:
    """Turns registers of the F4T into telemetry."""

    def __init__(self) -> None:
        self._air_c: float | None = None

    def take(self, start: int, words: Sequence[int]) -> dict[str, float] | None:
        """Take an answer; return air and set point in force, ramp included, when it completes a state."""
        if start not in (F4T.AIR, F4T.ACTIVE_SET_POINT) or len(words) != 2:
            return None
        value = words_float(words)
        if start == F4T.AIR:
            self._air_c = value if math.isfinite(value) else None
            return None
        air_c, self._air_c = self._air_c, None
        return None if air_c is None or not math.isfinite(value) else {AIR_C: air_c, SET_POINT_C: value}


Readings = F4Readings | F4TReadings
