"""What the F4 and the F4T do differently: each verb of a chamber in their own registers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from drivers.base.errors import ProtocolError
from drivers.kit.instruments import ChamberCapabilities, ChamberLimits
from drivers.kit.modbus import ModbusMaster, float_words, words_float
from drivers.watlow.registers import F4, F4T, F4Readings, F4TReadings, scaled, unscaled


class Controller(Protocol):
    """One controller behind a Modbus master. Every verb returns when the device has confirmed it."""

    model: str
    questions: tuple[tuple[int, int], ...]
    """(first register, count) of the reads that make up a state, in order."""
    stop_write: tuple[int, int]
    """(register, word) that stops conditioning."""

    def take(self, start: int, words: Sequence[int]) -> dict[str, float] | None:
        """Take registers that were read; return the state when they complete one."""
        ...

    def introduce(self) -> dict[str, str]:
        """Read what a controller of this kind must have; ProtocolError if this one has not."""
        ...

    def capabilities(self) -> ChamberCapabilities:
        """Return what it can do, once it was introduced."""
        ...

    def limits(self) -> ChamberLimits:
        """Read the set point's limits."""
        ...

    def ramp(self, k_per_min: float | None) -> None:
        """Limit the set point's rate of change, or not."""
        ...

    def set_point(self, temp_c: float) -> None:
        """Write the set point."""
        ...

    def demanded_c(self) -> float:
        """Read the set point back."""
        ...

    def switch(self, on: bool) -> None:
        """Start or stop conditioning."""
        ...

    def is_running(self) -> bool:
        """Read whether conditioning is on."""
        ...

    def alarms(self) -> list[str]:
        """Read the alarms in force, in words."""
        ...


class F4Controller:
    """Watlow F4: conditioning is switched by digital output `start_output`, as chamber makers wire it.

    `auxiliary`: inputs, 2 or 3, to read with every state.
    """

    model = "F4"

    def __init__(self, modbus: ModbusMaster, start_output: int, auxiliary: Sequence[int] = ()) -> None:
        inputs = (1, *(number for number in auxiliary if number in F4.INPUTS))
        self.questions: tuple[tuple[int, int], ...] = (
            *((F4.INPUTS[number], 1) for number in inputs),
            (F4.SET_POINT, 1),
        )
        self._readings = F4Readings()
        self._modbus = modbus
        self._output = F4.OUTPUT_1 + F4.OUTPUT_STEP * (start_output - 1)
        self.stop_write = (self._output, 0)

    def take(self, start: int, words: Sequence[int]) -> dict[str, float] | None:
        """Take registers that were read; return the state when they complete one."""
        return self._readings.take(start, words)

    def introduce(self) -> dict[str, str]:
        """Read decimal places and unit; ProtocolError if they make no sense or it works in Fahrenheit."""
        for number, register in F4.DECIMALS.items():
            (places,) = self._modbus.read(register, 1)
            if places > 3:
                raise ProtocolError(
                    "not an F4", found=f"register {register} = {places}", expected="decimal places, 0 to 3"
                )
            self._readings.take(register, (places,))
            if number == 1:
                decimals = places
        (celsius,) = self._modbus.read(F4.CELSIUS, 1)
        if celsius != 1:
            raise ProtocolError(
                "not an F4 in degrees Celsius",
                found=f"register {F4.CELSIUS} = {celsius}",
                expected="1 (degrees Celsius)",
            )
        return {"decimal places": str(decimals)}

    def capabilities(self) -> ChamberCapabilities:
        """Everything comes in steps of the last decimal place."""
        places = self._readings.decimals[1]
        step, most = scaled(1, places), scaled(0x7FFF, places)
        return ChamberCapabilities(step, (step, most), tuple(number for number in F4.INPUTS if number > 1))

    def limits(self) -> ChamberLimits:
        """Read the set point's limits."""
        low, high = self._modbus.read(F4.SET_POINT_LOW, 2)
        return ChamberLimits(self._number(low), self._number(high))

    def ramp(self, k_per_min: float | None) -> None:
        """Rate first, mode last: no ramp ever begins at an old rate."""
        if k_per_min is not None:
            self._modbus.write(F4.RAMP_RATE, [unscaled(k_per_min, self._readings.decimals[1])])
            self._modbus.write(F4.RAMP_UNIT, [0])
        self._modbus.write(F4.RAMP_MODE, [0 if k_per_min is None else 2])

    def set_point(self, temp_c: float) -> None:
        """Write the set point."""
        self._modbus.write(F4.SET_POINT, [unscaled(temp_c, self._readings.decimals[1])])

    def demanded_c(self) -> float:
        """Read the set point back."""
        return self._number(self._modbus.read(F4.SET_POINT, 1)[0])

    def switch(self, on: bool) -> None:
        """Set or clear the output."""
        self._modbus.write(self._output, [int(on)])

    def is_running(self) -> bool:
        """Read the output."""
        return bool(self._modbus.read(self._output, 1)[0])

    def alarms(self) -> list[str]:
        """Read alarms 1 and 2."""
        words = {0: "", 1: "high", 2: "low"}
        found = {number: self._modbus.read(register, 1)[0] for number, register in F4.ALARMS.items()}
        return [
            f"alarm {number}: {words.get(state, f'state {state}')}"
            for number, state in found.items()
            if state
        ]

    def _number(self, word: int) -> float:
        return scaled(word, self._readings.decimals[1])


class F4TController:
    """Watlow F4T, control loop 1: conditioning is switched by the loop's control mode."""

    model = "F4T"
    questions: tuple[tuple[int, int], ...] = ((F4T.AIR, 2), (F4T.ACTIVE_SET_POINT, 2))
    stop_write = (F4T.MODE, F4T.OFF)

    def __init__(self, modbus: ModbusMaster) -> None:
        self._readings = F4TReadings()
        self._modbus = modbus

    def take(self, start: int, words: Sequence[int]) -> dict[str, float] | None:
        """Take registers that were read; return the state when they complete one."""
        return self._readings.take(start, words)

    def introduce(self) -> dict[str, str]:
        """Read the loop's mode and limits; ProtocolError if they make no sense."""
        (mode,) = self._modbus.read(F4T.MODE, 1)
        limits = self.limits()
        if mode not in (F4T.AUTO, F4T.MANUAL, F4T.OFF) or not limits.min_temp_c < limits.max_temp_c:
            raise ProtocolError(
                "not an F4T",
                found=f"mode {mode}, set point {limits.min_temp_c:g} .. {limits.max_temp_c:g}",
                expected="mode 10, 54 or 62 and a range of set points",
            )
        return {"control mode": {F4T.AUTO: "auto", F4T.MANUAL: "manual", F4T.OFF: "off"}[mode]}

    def capabilities(self) -> ChamberCapabilities:
        """Values are float32; the thermometer behind them resolves about 0.01 K."""
        return ChamberCapabilities(0.01, (0.001, 99_999.0), ())

    def limits(self) -> ChamberLimits:
        """Read the set point's limits."""
        words = self._modbus.read(F4T.SET_POINT_LOW, 4)
        return ChamberLimits(words_float(words[:2]), words_float(words[2:]))

    def ramp(self, k_per_min: float | None) -> None:
        """Rate first, action last: no ramp ever begins at an old rate."""
        if k_per_min is not None:
            self._modbus.write(F4T.RAMP_RATE, float_words(k_per_min))
            self._modbus.write(F4T.RAMP_SCALE, [F4T.PER_MINUTE])
        self._modbus.write(F4T.RAMP_ACTION, [F4T.RAMP_OFF if k_per_min is None else F4T.RAMP_BOTH])

    def set_point(self, temp_c: float) -> None:
        """Write the set point."""
        self._modbus.write(F4T.SET_POINT, float_words(temp_c))

    def demanded_c(self) -> float:
        """Read the set point back."""
        return words_float(self._modbus.read(F4T.SET_POINT, 2))

    def switch(self, on: bool) -> None:
        """Set the loop to auto or off."""
        self._modbus.write(F4T.MODE, [F4T.AUTO if on else F4T.OFF])

    def is_running(self) -> bool:
        """Read the mode in force."""
        return self._modbus.read(F4T.ACTIVE_MODE, 1)[0] != F4T.OFF

    def alarms(self) -> list[str]:
        """Read the state of alarms 1 to 6; a state without a name is told by its number."""
        found = []
        for number in range(F4T.ALARMS):
            (state,) = self._modbus.read(F4T.ALARM_1 + F4T.ALARM_STEP * number, 1)
            words = F4T.ALARM_WORDS.get(state, f"state {state}")
            if words:
                found.append(f"alarm {number + 1}: {words}")
        return found
