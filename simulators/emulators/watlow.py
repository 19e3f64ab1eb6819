"""Chambers with a Watlow F4 or F4T controller in bytes: a Modbus device whose registers are the plant.

Registers: `drivers.watlow`. A frame whose check fails, or for another device, is not answered; a register
that the controller does not have is refused with exception 2, a value out of range with 3.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pymodbus.pdu import ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
    ReadInputRegistersRequest,
    ReadInputRegistersResponse,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterRequest,
    WriteSingleRegisterResponse,
)

from drivers.base.errors import ProtocolError
from drivers.kit.modbus import (
    BUSY,
    ILLEGAL_ADDRESS,
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    Frames,
    Framing,
    float_words,
    to_signed,
    words_float,
)
from drivers.watlow import F4Config, F4TConfig
from drivers.watlow.registers import F4, F4T, scaled, unscaled
from simulators.faults import DeviceFault, Fault, WireShape
from simulators.interfaces import Installation, Reply
from simulators.plant.lab_chamber import LabChamber

_GAP_S = {"rtu": 0.02, "tcp": 0.5}
"""A longer pause ends a frame, whole or not; on TCP that is a server's patience with half a request."""
_BITS = 10
_END_PROFILE, _PAUSE, _TERMINATE = 16566, 146, 148
_KEY_1, _PRESS_KEY_1, _UP, _DOWN = 6844, 6850, 1456, 1457
_OUTPUT_1, _ON = 33718, 63
_ESPEC_WIRING = {16568: 62, 16536: 1540, 11490: 1667, 11504: 138, 11528: 61}
"""No profile; loop 1 is a temperature; of the limit controller in slot 5: safe, no failure, no error
(ChamberConnectLibrary)."""
_INPUT_1_MEASURES = 608
"""Of an F4: 0 for a temperature (ChamberConnectLibrary)."""


class WatlowEmulator(ABC):
    """The controller's Modbus side and what both models share; the registers are the model's own."""

    def __init__(
        self,
        plant: LabChamber,
        *,
        framing: Framing,
        device: int = 1,
        baudrate: int = 19200,
        min_temp_c: float = -73.0,
        max_temp_c: float = 190.0,
        latency_s: float = 0.010,
    ) -> None:
        self._plant = plant
        self._frames = Frames(framing, server=True)
        self._device = device
        self._byte_s = _BITS / baudrate if framing == "rtu" else 0.0
        self._limits_c = (min_temp_c, max_temp_c)
        self._latency_s = latency_s
        self._set_point_c = plant.set_point_c(0.0)
        self._running = False
        self._ramp_on = False
        self._ramp_k_per_min = 0.0
        self._alarm = False
        self._refusals: list[int] = []
        self._input = b""
        self._heard_s = 0.0

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take bytes the bench wrote, any chunking. A pause ends a frame, whole or not."""
        rtu = self._frames.framing == "rtu"
        if now_s - self._heard_s > _GAP_S[self._frames.framing]:
            self._input = b""
        self._heard_s = now_s
        self._input += data
        replies = []
        while self._input:
            try:
                found = self._frames.split(self._input)
            except ProtocolError:
                self._input = b""
                break
            if found is None:
                break
            request, used = found
            self._input = self._input[used:]
            if request.dev_id == self._device or not rtu:
                answer = self._answer(request, now_s)
                answer.dev_id, answer.transaction_id = request.dev_id, request.transaction_id
                frame = self._frames.build(answer)
                taken_s = self._byte_s * (used + len(frame))
                replies.append(Reply(now_s + self._latency_s + taken_s, frame))
        return replies

    @property
    def wire(self) -> WireShape:
        """A reply; on RTU it ends in its CRC."""
        return WireShape(check_bytes=2 if self._frames.framing == "rtu" else 0)

    @property
    def faults(self) -> Mapping[str, DeviceFault]:
        """`alarm`: alarm 1 is high, and conditioning stops. `refuse`: `count` writes get exception 6, busy."""
        return {"alarm": self._raise_alarm, "refuse": self._refuse}

    @abstractmethod
    def read(self, register: int, now_s: float) -> int | None:
        """Return a register, None if there is none of that number."""

    @abstractmethod
    def write(self, register: int, words: Sequence[int], now_s: float) -> int:
        """Write registers; return 0 or an exception code."""

    def _raise_alarm(self, fault: Fault, now_s: float) -> None:
        self._alarm = True
        self._demand(now_s)

    def _refuse(self, fault: Fault, now_s: float) -> None:
        self._refusals = [BUSY] * fault.count

    def _answer(self, request: ModbusPDU, now_s: float) -> ModbusPDU:
        if request.function_code & 0x7F not in (3, 4, 6, 16):
            return ExceptionResponse(request.function_code & 0x7F, ILLEGAL_FUNCTION)
        if isinstance(request, ExceptionResponse):
            return request
        if isinstance(request, ReadHoldingRegistersRequest):
            words = [self.read(request.address + at, now_s) for at in range(request.count)]
            if any(word is None for word in words):
                return ExceptionResponse(request.function_code, ILLEGAL_ADDRESS)
            # pymodbus derives the request for input registers from the one for holding registers
            held = not isinstance(request, ReadInputRegistersRequest)
            kind = ReadHoldingRegistersResponse if held else ReadInputRegistersResponse
            return kind(registers=[word for word in words if word is not None])
        code = self._refusals.pop() if self._refusals else 0
        code = code or self.write(request.address, request.registers, now_s)
        if code:
            return ExceptionResponse(request.function_code, code)
        if isinstance(request, WriteSingleRegisterRequest):
            return WriteSingleRegisterResponse(address=request.address, registers=request.registers)
        return WriteMultipleRegistersResponse(address=request.address, count=len(request.registers))

    def _take_set_point(self, set_point_c: float, now_s: float) -> int:
        low, high = self._limits_c
        if not low <= set_point_c <= high:
            return ILLEGAL_VALUE
        self._set_point_c = set_point_c
        return self._demand(now_s)

    def _demand(self, now_s: float) -> int:
        ramp = self._ramp_k_per_min if self._ramp_on else 0.0
        running = self._running and not self._alarm
        self._plant.demand(
            now_s, set_point_c=self._set_point_c, ramp_up=ramp, ramp_down=ramp, running=running
        )
        return 0


class F4Emulator(WatlowEmulator):
    """An F4 with one decimal place; inputs 2 and 3 are the plant's auxiliary sensors 2 and 3.

    `start_output`: digital output that starts the chamber.
    """

    def __init__(self, plant: LabChamber, *, start_output: int = 1, **settings: Any) -> None:
        super().__init__(plant, framing="rtu", **settings)
        self._start_register = F4.OUTPUT_1 + F4.OUTPUT_STEP * (start_output - 1)
        self._outputs = {F4.OUTPUT_1 + F4.OUTPUT_STEP * at: 0 for at in range(8)}
        self._ramp_mode = 0
        self._ramp_per_hour = False
        self._rate = 0.0

    def read(self, register: int, now_s: float) -> int | None:
        """Return a register, None if there is none of that number."""
        for number, place in F4.INPUTS.items():
            if register == place:
                plant = self._plant
                value = plant.air_temp_c(now_s) if number == 1 else plant.auxiliary_c(number, now_s)
                return unscaled(value, 1)
        if register in F4.DECIMALS.values() or register == F4.CELSIUS:
            return 1
        low, high = self._limits_c
        fixed = {
            F4.PROFILE: F4.NO_PROFILE,
            _INPUT_1_MEASURES: 0,
            F4.SET_POINT: unscaled(self._set_point_c, 1),
            F4.SET_POINT_LOW: unscaled(low, 1),
            F4.SET_POINT_HIGH: unscaled(high, 1),
            F4.RAMP_MODE: self._ramp_mode,
            F4.RAMP_RATE: unscaled(self._rate, 1),
            F4.RAMP_UNIT: int(self._ramp_per_hour),
            F4.ALARMS[1]: int(self._alarm),
            F4.ALARMS[2]: 0,
        }
        return fixed.get(register, self._outputs.get(register))

    def write(self, register: int, words: Sequence[int], now_s: float) -> int:
        """Write one register; return 0 or an exception code."""
        (word,) = words if len(words) == 1 else (-1,)
        if word < 0:
            return ILLEGAL_ADDRESS
        if register == F4.SET_POINT:
            return self._take_set_point(scaled(word, 1), now_s)
        if register == F4.END_PROFILE:
            return 0 if word == 1 else ILLEGAL_VALUE
        if register == F4.RAMP_RATE:
            if to_signed(word) < 0:
                return ILLEGAL_VALUE
            self._rate = scaled(word, 1)
        elif register in (F4.RAMP_MODE, F4.RAMP_UNIT):
            if word > (2 if register == F4.RAMP_MODE else 1):
                return ILLEGAL_VALUE
            if register == F4.RAMP_MODE:
                self._ramp_mode = word
            else:
                self._ramp_per_hour = bool(word)
        elif register in self._outputs:
            self._outputs[register] = int(bool(word))
            self._running = bool(self._outputs[self._start_register])
        else:
            return ILLEGAL_ADDRESS
        self._ramp_on = self._ramp_mode > 0
        self._ramp_k_per_min = self._rate / 60.0 if self._ramp_per_hour else self._rate
        return self._demand(now_s)


class F4TEmulator(WatlowEmulator):
    """An F4T, control loop 1, in degrees Celsius on both of its Modbus channels; switched off by its mode.

    Beside it what ESPEC's chambers have and its library asks for: no profile runs, key 1 toggles conditioning,
    output 1 of module 1 tells that it runs, and a limit controller in slot 5 is content.
    """

    def __init__(self, plant: LabChamber, *, framing: Framing = "tcp", **settings: Any) -> None:
        super().__init__(plant, framing=framing, **settings)
        self._words = {
            F4T.RAMP_ACTION: F4T.RAMP_OFF,
            F4T.RAMP_SCALE: F4T.PER_MINUTE,
            **dict.fromkeys(F4T.UNITS.values(), F4T.CELSIUS),
            **_ESPEC_WIRING,
        }

    def read(self, register: int, now_s: float) -> int | None:
        """Return a register, None if there is none of that number; both halves of a float are its own."""
        low, high = self._limits_c
        floats: Mapping[int, Callable[[float], float]] = {
            F4T.AIR: self._plant.air_temp_c,
            F4T.ACTIVE_SET_POINT: self._plant.set_point_c,
            F4T.SET_POINT: lambda now_s: self._set_point_c,
            F4T.SET_POINT_LOW: lambda now_s: low,
            F4T.SET_POINT_HIGH: lambda now_s: high,
            F4T.RAMP_RATE: lambda now_s: self._ramp_k_per_min,
        }
        for start, value in floats.items():
            if register - start in (0, 1):
                return float_words(value(now_s))[register - start]
        if register in (F4T.MODE, F4T.ACTIVE_MODE):
            off = register == F4T.ACTIVE_MODE and self._alarm
            return F4T.AUTO if self._running and not off else F4T.OFF
        if register in (_KEY_1, _OUTPUT_1):
            return _ON if self._running and not self._alarm else F4T.OFF
        if register in F4T.ALARM_REGISTERS.values():
            return 37 if self._alarm and register == F4T.ALARM_REGISTERS[1] else 61
        return self._words.get(register)

    def write(self, register: int, words: Sequence[int], now_s: float) -> int:
        """Write a value; return 0 or an exception code."""
        if register in (F4T.SET_POINT, F4T.RAMP_RATE) and len(words) == 2:
            value = words_float(words)
            if register == F4T.SET_POINT:
                return self._take_set_point(value, now_s)
            if not 0.0 <= value <= 99_999.0:
                return ILLEGAL_VALUE
            self._ramp_k_per_min = value
            return self._demand(now_s)
        allowed = {
            F4T.MODE: (F4T.AUTO, F4T.OFF),
            F4T.RAMP_ACTION: (F4T.RAMP_OFF, 88, 85, F4T.RAMP_BOTH),
            F4T.RAMP_SCALE: (F4T.PER_MINUTE,),
            _PRESS_KEY_1: (_UP, _DOWN),
            _END_PROFILE: (_PAUSE, _TERMINATE),
        }
        if register not in allowed or len(words) != 1:
            return ILLEGAL_ADDRESS
        if words[0] not in allowed[register]:
            return ILLEGAL_VALUE
        if register == F4T.MODE:
            self._running = words[0] == F4T.AUTO
        elif register == _PRESS_KEY_1:
            self._running ^= words[0] == _DOWN
        elif register != _END_PROFILE:
            self._words[register] = words[0]
            self._ramp_on = self._words[F4T.RAMP_ACTION] in (85, F4T.RAMP_BOTH)
        return self._demand(now_s)


def f4(config: F4Config, plant: LabChamber, installed: Installation) -> F4Emulator:
    """Make the emulator of a bench file's chamber with an F4."""
    return F4Emulator(
        plant, start_output=config.start_channel, device=config.device, baudrate=config.baudrate
    )


def f4t(config: F4TConfig, plant: LabChamber, installed: Installation) -> F4TEmulator:
    """Make the emulator of a bench file's chamber with an F4T."""
    return F4TEmulator(plant, framing=config.framing, device=config.device, baudrate=config.baudrate)
