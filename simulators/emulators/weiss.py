"""The bytes of a Weiss or Vötsch chamber: SimServ and ASCII-2 requests told apart, carried out and answered."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from drivers.weiss import WeissConfig
from drivers.weiss.ascii2 import encode_values
from drivers.weiss.configuration import Configuration, Setting, encode_configuration
from drivers.weiss.simserv import (
    NOT_AVAILABLE,
    NOT_READABLE,
    OK,
    SEPARATOR,
    UNKNOWN_COMMAND,
    WRONG_PARAMETERS,
    Number,
    encode_simserv_reply,
)
from simulators.emulators._weiss_controller import MESSAGE_READS, OUTPUT_NAMES, VARIABLE_READS, Controller
from simulators.faults import DeviceFault, Fault
from simulators.interfaces import Installation, Reply
from simulators.plant.lab_chamber import LabChamber

_INDEXED_READS = (
    Number.CHAMBER_INFO,
    Number.GET_MEASURED,
    Number.GET_DIGITAL_OUT,
    Number.GET_DIGITAL_OUT_NAME,
    *MESSAGE_READS,
    *VARIABLE_READS,
)
_WRITES = (Number.SET_SET_POINT, Number.SET_GRADIENT_UP, Number.SET_GRADIENT_DOWN, Number.SET_DIGITAL_OUT)
_ARGUMENTS: Mapping[int, int] = {
    **{int(number): 0 for number in Number},
    **{int(number): 1 for number in _INDEXED_READS},
    **{int(number): 2 for number in _WRITES},
}
"""Arguments of each command after the chamber index; further ones are passed over, as basil's to 10012."""


class WeissEmulator:
    """One temperature chamber with auxiliary sensors as measured values.

    `auxiliary`: numbers of the sensors the plant has. `start_channel`: SimServ index of the Start output, 1 as on
    newer controllers, 2 on some. A set point outside the limits is refused; conditioning does not run while an
    alarm is active. `values_with_set`: ASCII-2's E has as many numbers as the answer to I, and the set point
    alone stops the conditioning, as a VT 4002 is spoken to (ondrejh/VT4002). Every line gets one reply,
    `latency_s` after it was taken up, one line after the other; lines for another ASCII-2 address get none.
    """

    def __init__(
        self,
        plant: LabChamber,
        *,
        address: int = 1,
        auxiliary: Sequence[int] = (1,),
        start_channel: int = 1,
        min_temp_c: float = -72.0,
        max_temp_c: float = 182.0,
        model: str = "VT3 7060",
        year: int = 2019,
        serial_number: str = "64636625",
        latency_s: float = 0.020,
        values_with_set: bool = False,
    ) -> None:
        self._address = address
        self._values_with_set = values_with_set
        self._latency_s = latency_s
        self._controller = Controller(
            plant,
            auxiliary=auxiliary,
            start_channel=start_channel,
            limits_c=(min_temp_c, max_temp_c),
            info=(model, f"{year % 100:02d}", serial_number),
        )
        self._configuration = _configuration(
            auxiliary, Setting(min_temp_c, max_temp_c, "Temperature"), values_with_set=values_with_set
        )
        self._input = bytearray()
        self._free_at_s = 0.0
        self._refusals = 0

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take bytes the bench wrote (any chunking); CR ends a line, LF and empty lines are not answered."""
        self._input += data.replace(b"\n", b"")
        *lines, unfinished = bytes(self._input).split(b"\r")
        self._input = bytearray(unfinished)
        replies = []
        for line in filter(None, lines):
            answer = self._answer(line.decode("latin-1"), now_s)
            if answer is not None:
                self._free_at_s = max(self._free_at_s, now_s) + self._latency_s
                replies.append(Reply(self._free_at_s, answer))
        return replies

    @property
    def faults(self) -> Mapping[str, DeviceFault]:
        """`alarm`: an alarm of `text`. `refuse`: the next `count` demands are refused: system not available."""
        return {"alarm": self._alarm, "refuse": self._refuse}

    def _alarm(self, fault: Fault, now_s: float) -> None:
        self.raise_alarm(fault.text or "Temperature limiter", now_s)

    def _refuse(self, fault: Fault, now_s: float) -> None:
        self._refusals = fault.count

    def _refuses(self) -> bool:
        refuses = self._refusals > 0
        self._refusals -= refuses
        return refuses

    def raise_alarm(self, text: str, now_s: float) -> None:
        """Put an alarm into the message list at lab time `now_s`; conditioning stops until a reset (17012)."""
        self._controller.raise_alarm(text, now_s)

    def open_door(self, is_open: bool) -> None:
        """Open or close the chamber's door: a warning "Door open" stands as long as it is open."""
        self._controller.open_door(is_open)

    def _answer(self, line: str, now_s: float) -> bytes | None:
        if line.split(SEPARATOR, 1)[0].isdecimal():
            return encode_simserv_reply(*self._simserv(line.split(SEPARATOR), now_s))
        if not line.startswith("$") or not line[1:3].isdecimal():
            return f"'{line}' is an unknown command.\r".encode("latin-1")
        if int(line[1:3]) != self._address:
            return None
        return self._ascii2(line, now_s)

    def _ascii2(self, line: str, now_s: float) -> bytes:
        command, *arguments = line[3:].split() or [""]
        if command == "I" and not arguments:
            return self._ascii2_values(now_s)
        if command == "?" and not arguments:
            return encode_configuration(self._configuration, self._address)
        if command in ("E", "U") and self._refuses():
            return b"\r"
        if command == "E":
            return b"0\r" if self._ascii2_set(arguments, now_s) else b"\r"
        if command == "U":
            return b"0\r" if self._ascii2_gradients(arguments, now_s) else b"\r"
        return f"'{line}' is an unknown command.\r".encode("latin-1")

    def _ascii2_values(self, now_s: float) -> bytes:
        plant = self._controller.plant
        auxiliary = [plant.auxiliary_c(number, now_s) for number in self._controller.auxiliary]
        numbers = [self._controller.set_point_c(now_s), plant.air_temp_c(now_s), *auxiliary]
        return encode_values(numbers, "".join(self._controller.digital))

    def _ascii2_set(self, arguments: list[str], now_s: float) -> bool:
        if self._values_with_set and len(arguments) == 1:
            arguments = [*arguments * len(self._configuration.set_fields), ""]
        if len(arguments) != len(self._configuration.set_fields) + 1:
            return False
        set_point_c, digital = _finite(arguments[0]), arguments[-1]
        if not self._controller.allows(set_point_c):
            return False
        if not set(digital) <= set("01") or len(digital) > len(self._controller.digital):
            return False
        self._controller.set_all(set_point_c, digital, now_s)
        return True

    def _ascii2_gradients(self, arguments: list[str], now_s: float) -> bool:
        values = [_finite(argument) for argument in arguments]
        if len(values) != 4 or not all(value >= 0.0 for value in values):
            return False
        up, down, humidity_up, humidity_down = values
        if up * down or humidity_up * humidity_down:
            return False
        self._controller.set_gradients(up, down, now_s)
        return True

    def _simserv(self, fields: list[str], now_s: float) -> tuple[int, *tuple[object, ...]]:
        """Return status and fields of the reply to a request, given as its fields."""
        number, arguments = int(fields[0][:6]), fields[1:]
        if number not in _ARGUMENTS:
            return (UNKNOWN_COMMAND,)
        if len(arguments) <= _ARGUMENTS[number]:
            return (WRONG_PARAMETERS,)
        if arguments[0] != "1":
            return (NOT_AVAILABLE,)
        values = [_finite(argument) for argument in arguments[1 : _ARGUMENTS[number] + 1]]
        if not all(map(math.isfinite, values)):
            return (WRONG_PARAMETERS,)
        index = int(values[0]) if values else 0
        if number == Number.RESET_ERRORS or len(values) == 2:
            if self._refuses():
                return (NOT_AVAILABLE,)
            return (OK,) if self._controller.write(number, index, values, now_s) else (WRONG_PARAMETERS,)
        answer = self._controller.read(number, index, now_s)
        return (NOT_READABLE,) if answer is None else (OK, answer)


def _configuration(auxiliary: Sequence[int], temperature: Setting, *, values_with_set: bool) -> Configuration:
    measured = {f"MV{number:02d}": f"T.sensor {number}" for number in auxiliary}
    return Configuration(
        set_fields=("CV01", "SV01", *measured) if values_with_set else ("CV01",),
        read_fields=("CV01", "CV01", *measured),
        digital_count=len(OUTPUT_NAMES),
        settings={"CV01": temperature},
        digital_names=OUTPUT_NAMES,
        measured_names=measured,
    )


def _finite(text: str) -> float:
    """Return a number, NaN if `text` is none."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def emulator(config: WeissConfig, plant: LabChamber, installed: Installation) -> WeissEmulator:
    """Make the emulator of a bench file's chamber."""
    return WeissEmulator(
        plant,
        address=config.bus_address,
        auxiliary=tuple(config.auxiliary),
        start_channel=config.start_channel,
    )
