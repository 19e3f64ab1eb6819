"""Driver of a chamber with a Watlow F4 or F4T controller: each verb in the registers of either."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Literal

from drivers.base.errors import DeviceSilent, ProtocolError
from drivers.kit.chamber import PolledChamber
from drivers.kit.config import ChamberConfig, key
from drivers.kit.instruments import ChamberCapabilities, ChamberLimits, ChamberState, Identity, require_ramp
from drivers.kit.kinds import Connection
from drivers.kit.modbus import Framing, ModbusMaster, float_words, words_float
from drivers.kit.polled import TROUBLES
from drivers.kit.retry import query_with_retry
from drivers.watlow.registers import (
    AIR_C,
    F4,
    F4_WORDS,
    F4T,
    F4T_WORDS,
    SET_POINT_C,
    F4Readings,
    F4TReadings,
    Readings,
    scaled,
    unscaled,
)


class _WatlowConfig(ChamberConfig):
    simserv: Literal[True] = key(default=True, exclude=True, description="none: a Watlow has no SimServ")

    @property
    def device(self) -> int:
        """The controller's Modbus address."""
        return self.address or 1


class F4Config(_WatlowConfig):
    """`[chamber]` of an F4: Modbus RTU, through a device server too; `auxiliary` are inputs 2 and 3."""

    start_channel: int = key(
        default=1, ge=1, le=8, description="the digital output of the F4 that starts the chamber, 1 to 8"
    )


class F4TConfig(_WatlowConfig):
    """`[chamber]` of an F4T."""

    start_channel: Literal[1] = key(
        default=1, exclude=True, description="none: an F4T is started by its mode"
    )

    @property
    def framing(self) -> Framing:
        """How it is spoken to: Modbus TCP over a socket, RTU over a serial line."""
        return "tcp" if self.port.startswith("socket://") else "rtu"


class WatlowChamber(PolledChamber):
    """One chamber (`drivers.kit.instruments.Chamber`) at a serial port or a socket.

    Registers by what they hold; a temperature or ramp takes `_width` of them.
    """

    model: str
    _questions: tuple[tuple[int, int], ...]
    """(first register, count) of the reads that make up a state, in order."""
    _width: int
    _set_point_register: int
    _limits_register: int
    _ramp_registers: tuple[int, int, int]
    """Of the ramp's rate, its unit, its mode."""
    _ramp_words: tuple[int, int, int]
    """The unit K/min; the modes without and with a ramp."""
    _switch_register: int
    _switched_register: int
    """Whether it conditions, read back."""
    _off: int
    _on: int
    _alarm_registers: Mapping[int, int]
    _alarm_words: Mapping[int, str]
    """Of each state, empty for none; a state that is not here is told by its number."""
    _known_by = "registers of this model with plausible contents"
    _check = "check which device the bench file names for this port, its Modbus address, and its unit"
    _switched_by = "check door, alarms, and start_channel: the controller's output that starts this chamber"

    def __init__(
        self,
        config: F4Config | F4TConfig,
        connection: Connection,
        framing: Framing,
        words: Mapping[int, str],
        readings: Readings,
    ) -> None:
        super().__init__(connection.link(config.port, config.baudrate), connection.safe_set_point_c)
        self.auxiliary = tuple(config.auxiliary)
        self._product = f"a Watlow {self.model} in degrees Celsius"
        self._framing = framing
        self._modbus = ModbusMaster(self.link, framing, config.device, words)
        self._readings = readings

    @abstractmethod
    def _introduce(self) -> dict[str, str]:
        """Read what a controller of this kind must have; ProtocolError if this one has not."""

    @abstractmethod
    def _encoded(self, value: float) -> Sequence[int]:
        """Return the words of a temperature or a ramp."""

    @abstractmethod
    def _decoded(self, words: Sequence[int]) -> float:
        """Return the temperature in words."""

    def _introduction(self) -> Identity:
        """Read registers that make sense in this model only; it has none for a serial number."""
        return Identity("Watlow", self.model, details=self._introduce())

    def limits(self) -> ChamberLimits:
        """Read the set point's limits."""
        words = self._modbus.read(self._limits_register, 2 * self._width)
        return ChamberLimits(self._decoded(words[: self._width]), self._decoded(words[self._width :]))

    def set_temperature(self, set_point_c: float, ramp_k_per_min: float | None = None) -> None:
        """Demand a set point; a ramp limits both directions, None takes the limit away."""
        require_ramp(self.capabilities(), set_point_c, ramp_k_per_min, self._where)
        self._ramp(ramp_k_per_min)
        self._set_point(set_point_c)

    def request_state(self) -> None:
        """Send the first question of a state without waiting; `read_state` must follow before anything else."""
        self._modbus.request(*self._questions[0])

    def read_state(self) -> ChamberState:
        """Take the answer to `request_state` and ask the rest."""
        row = None
        for start, count in self._questions:
            words = query_with_retry(self.link, partial(self._modbus.collect, start, count))
            row = self._readings.take(start, words)
        if row is None:
            raise ProtocolError(
                "the controller's registers hold no temperatures", where=self._where, expected="numbers"
            )
        auxiliary_c = {number: row[f"aux_{number}_temp_c"] for number in self.auxiliary}
        return ChamberState(row[AIR_C], row[SET_POINT_C], auxiliary_c)

    def alarms(self) -> list[str]:
        """Read the state of every alarm."""
        alarms = []
        for number, register in self._alarm_registers.items():
            (state,) = self._modbus.read(register, 1)
            if words := self._alarm_words.get(state, f"state {state}"):
                alarms.append(f"alarm {number}: {words}")
        return alarms

    def _ramp(self, k_per_min: float | None) -> None:
        """Rate first, mode last: no ramp ever begins at an old rate."""
        rate_register, unit_register, mode_register = self._ramp_registers
        per_minute, off, on = self._ramp_words
        if k_per_min is not None:
            self._modbus.write(rate_register, self._encoded(k_per_min))
            self._modbus.write(unit_register, [per_minute])
        self._modbus.write(mode_register, [off if k_per_min is None else on])

    def _set_point(self, temp_c: float) -> None:
        self._modbus.write(self._set_point_register, self._encoded(temp_c))

    def _demanded_c(self) -> float:
        return self._decoded(self._modbus.read(self._set_point_register, self._width))

    def _switch(self, on: bool) -> None:
        self._modbus.write(self._switch_register, [self._on if on else self._off])

    def _is_running(self) -> bool:
        return self._modbus.read(self._switched_register, 1)[0] != self._off

    def in_step(self) -> bool:
        """Read the limits of an F4's set point, two registers, or an F4T's mode, one: no poll reads as many."""
        if self._width == 1:
            return self._modbus.in_step(self._limits_register, 2)
        return self._modbus.in_step(self._switch_register, 1)

    def _send_stop(self) -> None:
        self._modbus.send_write(self._switch_register, self._off)

    def _way_to_rest(self) -> Iterable[Callable[[], None]]:
        return (self._confirm_stop, lambda: self._set_point(self.safe_set_point_c), lambda: self._ramp(None))

    def _confirm_stop(self) -> None:
        """Take the answer to the stop; stop again if it is missed, having met that to an earlier question."""
        try:
            self._modbus.settle()
        except TROUBLES:
            self._switch(False)

    def _seen(self, error: DeviceSilent) -> str:
        """Return what came of an answer: the master has taken it from the link."""
        return error.found if "bytes" in error.found else ""


class F4Chamber(WatlowChamber):
    """Chamber with an F4: conditioning is switched by a digital output, as chamber makers wire it."""

    model = "F4"
    _width = 1
    _set_point_register, _limits_register = F4.SET_POINT, F4.SET_POINT_LOW
    _ramp_registers, _ramp_words = (F4.RAMP_RATE, F4.RAMP_UNIT, F4.RAMP_MODE), (0, 0, 2)
    _off, _on = 0, 1
    _alarm_registers, _alarm_words = F4.ALARMS, {0: "", 1: "high", 2: "low"}

    def __init__(self, config: F4Config, connection: Connection) -> None:
        readings = F4Readings()
        super().__init__(config, connection, "rtu", F4_WORDS, readings)
        self._decimals = readings.decimals
        inputs = (1, *(number for number in self.auxiliary if number in F4.INPUTS))
        self._questions: tuple[tuple[int, int], ...] = (
            *((F4.INPUTS[number], 1) for number in inputs),
            (F4.SET_POINT, 1),
        )
        self._switch_register = F4.OUTPUT_1 + F4.OUTPUT_STEP * (config.start_channel - 1)
        self._switched_register = self._switch_register

    def _introduce(self) -> dict[str, str]:
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
        places = self._decimals[1]
        step, most = scaled(1, places), scaled(0x7FFF, places)
        return ChamberCapabilities(step, (step, most), tuple(number for number in F4.INPUTS if number > 1))

    def _encoded(self, value: float) -> Sequence[int]:
        return [unscaled(value, self._decimals[1])]

    def _decoded(self, words: Sequence[int]) -> float:
        return scaled(words[0], self._decimals[1])


class F4TChamber(WatlowChamber):
    """Chamber with an F4T, control loop 1: conditioning is switched by the loop's control mode."""

    model = "F4T"
    _check = (
        "check which device the bench file names for this port, its Modbus address, and the unit of its Modbus "
        "channel: Menu, Settings, Network, Modbus, Display Units: C"
    )
    _questions = ((F4T.AIR, 2), (F4T.ACTIVE_SET_POINT, 2))
    _width = 2
    _set_point_register, _limits_register = F4T.SET_POINT, F4T.SET_POINT_LOW
    _ramp_registers = (F4T.RAMP_RATE, F4T.RAMP_SCALE, F4T.RAMP_ACTION)
    _ramp_words = (F4T.PER_MINUTE, F4T.RAMP_OFF, F4T.RAMP_BOTH)
    _switch_register, _switched_register = F4T.MODE, F4T.ACTIVE_MODE
    _off, _on = F4T.OFF, F4T.AUTO
    _alarm_registers, _alarm_words = F4T.ALARM_REGISTERS, F4T.ALARM_WORDS

    def __init__(self, config: F4TConfig, connection: Connection) -> None:
        super().__init__(config, connection, config.framing, F4T_WORDS, F4TReadings())

    def _introduce(self) -> dict[str, str]:
        """Read the loop's mode, its limits and the Modbus channel's unit; ProtocolError if they make no sense."""
        (mode,) = self._modbus.read(F4T.MODE, 1)
        limits = self.limits()
        if mode not in (F4T.AUTO, F4T.MANUAL, F4T.OFF) or not limits.min_temp_c < limits.max_temp_c:
            raise ProtocolError(
                "not an F4T",
                found=f"mode {mode}, set point {limits.min_temp_c:g} .. {limits.max_temp_c:g}",
                expected="mode 10, 54 or 62 and a range of set points",
            )
        register = F4T.UNITS[self._framing]
        (unit,) = self._modbus.read(register, 1)
        if unit != F4T.CELSIUS:
            name = " (degrees Fahrenheit)" if unit == F4T.FAHRENHEIT else ""
            raise ProtocolError(
                "not an F4T in degrees Celsius",
                found=f"register {register} = {unit}{name}",
                expected=f"{F4T.CELSIUS} (degrees Celsius)",
            )
        return {"control mode": {F4T.AUTO: "auto", F4T.MANUAL: "manual", F4T.OFF: "off"}[mode]}

    def capabilities(self) -> ChamberCapabilities:
        """Values are float32; the thermometer behind them resolves about 0.01 K."""
        return ChamberCapabilities(0.01, (0.001, 99_999.0), ())

    def _encoded(self, value: float) -> Sequence[int]:
        return float_words(value)

    def _decoded(self, words: Sequence[int]) -> float:
        return words_float(words)
