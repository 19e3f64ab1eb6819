"""What a chamber controller knows and does: set point, ramps, outputs and messages. No bytes here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from drivers.weiss.simserv import ChamberStatus, Number
from simulators.plant.lab_chamber import LabChamber

_START_BIT = 1
_ALARM, _WARNING = 1, 2
DOOR_TEXT = "Door open"
OUTPUT_NAMES: Mapping[int, str] = {
    **dict.fromkeys(range(32), "unused"),
    **dict.fromkeys((*range(8, 16), 17, 20, 21), "Option"),
    **{index: f"Custom Out{index - 1}" for index in range(2, 6)},
    **{index: f"Custom Out{index - 17}" for index in range(22, 26)},
    **{1: "Start", 6: "Cond.protect", 7: "Clarificat.", 16: "No GreenMode"},
}
"""Digital outputs as a dynamic configuration prints them."""

MESSAGE_READS = (Number.MESSAGE_TYPE, Number.MESSAGE_TEXT, Number.MESSAGE_ACTIVE)
VARIABLE_READS = (
    Number.GET_SET_POINT,
    Number.GET_ACTUAL,
    Number.GET_INPUT_MINIMUM,
    Number.GET_INPUT_MAXIMUM,
    Number.GET_UNIT,
    Number.GET_NAME,
    Number.GET_GRADIENT_UP,
    Number.GET_GRADIENT_DOWN,
)


@dataclass
class _Message:
    kind: int
    text: str
    active: bool = True


class Controller:
    """The state behind both protocols; `start_channel` is the SimServ index of the Start output."""

    def __init__(
        self,
        plant: LabChamber,
        *,
        auxiliary: Sequence[int],
        start_channel: int,
        limits_c: tuple[float, float],
        info: tuple[str, ...],
    ) -> None:
        self.plant = plant
        self.auxiliary = tuple(auxiliary)
        self.limits_c = limits_c
        self.digital = ["0"] * len(OUTPUT_NAMES)
        self._info = info
        self._first_channel = start_channel - _START_BIT
        self._set_point_c: float | None = None
        self._gradients = {"up": 0.0, "down": 0.0}
        self._messages: list[_Message] = []

    def raise_alarm(self, text: str, now_s: float) -> None:
        """Put an active alarm into the message list; conditioning stops."""
        self._messages.append(_Message(_ALARM, text))
        self._demand(now_s)

    def open_door(self, is_open: bool) -> None:
        """Show a warning while the door is open; it stops nothing."""
        self._messages = [message for message in self._messages if message.text != DOOR_TEXT]
        if is_open:
            self._messages.append(_Message(_WARNING, DOOR_TEXT))

    def allows(self, set_point_c: float) -> bool:
        """Return whether a set point lies within the input limits."""
        return self.limits_c[0] <= set_point_c <= self.limits_c[1]

    def set_point_c(self, now_s: float) -> float:
        """Return the set point in force; that of a stopped chamber is the one last told, from then on."""
        if self._running or self._set_point_c is None:
            return self.plant.set_point_c(now_s)
        return self._set_point_c

    def set_all(self, set_point_c: float, digital: str, now_s: float) -> None:
        """Take an allowed set point and the digital outputs from the first one on; outputs left out are 0."""
        self._set_point_c = set_point_c
        self.digital = list(digital.ljust(len(self.digital), "0"))
        self._demand(now_s)

    def set_gradients(self, up_k_per_min: float, down_k_per_min: float, now_s: float) -> None:
        """Take both ramps, 0 = as fast as the chamber can."""
        self._gradients = {"up": up_k_per_min, "down": down_k_per_min}
        self._demand(now_s)

    def write(self, number: int, index: int, values: list[float], now_s: float) -> bool:
        """Carry out a SimServ command that changes something; False if index or value is not allowed."""
        output = index - self._first_channel
        match number:
            case Number.RESET_ERRORS:
                for message in self._messages:
                    message.active = False
            case Number.SET_SET_POINT if index == 1 and self.allows(values[1]):
                self._set_point_c = values[1]
            case Number.SET_GRADIENT_UP if index == 1 and values[1] >= 0.0:
                self._gradients["up"] = values[1]
            case Number.SET_GRADIENT_DOWN if index == 1 and values[1] >= 0.0:
                self._gradients["down"] = values[1]
            case Number.SET_DIGITAL_OUT if 0 <= output < len(self.digital) and values[1] in (0.0, 1.0):
                self.digital[output] = str(int(values[1]))
            case _:
                return False
        self._demand(now_s)
        return True

    def read(self, number: int, index: int, now_s: float) -> object:
        """Return the value asked for, None if there is none of that index."""
        if number in VARIABLE_READS:
            return self._read_temperature(number, now_s) if index == 1 else None
        if number in MESSAGE_READS:
            if not 1 <= index <= len(self._messages):
                return None
            message = self._messages[index - 1]
            return {Number.MESSAGE_TYPE: message.kind, Number.MESSAGE_TEXT: message.text}.get(
                Number(number), int(message.active)
            )
        output = index - self._first_channel
        match number:
            case Number.CHAMBER_INFO if 1 <= index <= len(self._info):
                return self._info[index - 1]
            case Number.CHAMBER_STATUS:
                return int(self._status())
            case Number.GET_VARIABLE_COUNT:
                return 1
            case Number.GET_MEASURED if index in self.auxiliary:
                return f"{self.plant.auxiliary_c(index, now_s):.4f}"
            case Number.GET_DIGITAL_OUT if 0 <= output < len(self.digital):
                return self.digital[output]
            case Number.GET_DIGITAL_OUT_NAME if 0 <= output < len(self.digital):
                return OUTPUT_NAMES[output]
            case Number.MESSAGE_COUNT:
                return len(self._messages)
        return None

    def _read_temperature(self, number: int, now_s: float) -> object:
        values: Mapping[int, object] = {
            Number.GET_ACTUAL: f"{self.plant.air_temp_c(now_s):.4f}",
            Number.GET_SET_POINT: f"{self.set_point_c(now_s):.4f}",
            Number.GET_INPUT_MINIMUM: self.limits_c[0],
            Number.GET_INPUT_MAXIMUM: self.limits_c[1],
            Number.GET_GRADIENT_UP: self._gradients["up"],
            Number.GET_GRADIENT_DOWN: self._gradients["down"],
            Number.GET_UNIT: "°C",
            Number.GET_NAME: "Temperature",
        }
        return values[number]

    def _status(self) -> ChamberStatus:
        status = ChamberStatus.AVAILABLE
        if self._running:
            status |= ChamberStatus.RUNNING
        if self._active(_ALARM):
            status |= ChamberStatus.ALARM
        if self._active(_WARNING):
            status |= ChamberStatus.WARNING
        return status

    def _active(self, kind: int) -> bool:
        return any(message.active and message.kind == kind for message in self._messages)

    @property
    def _running(self) -> bool:
        return self.digital[_START_BIT] == "1" and not self._active(_ALARM)

    def _demand(self, now_s: float) -> None:
        if self._set_point_c is None:
            self._set_point_c = self.plant.set_point_c(now_s)
        self.plant.demand(
            now_s,
            set_point_c=self._set_point_c,
            ramp_up=self._gradients["up"],
            ramp_down=self._gradients["down"],
            running=self._running,
        )
