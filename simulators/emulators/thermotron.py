"""A Thermotron chamber with an 8200, 8800 or 3800 controller in bytes: run manual mode, stop, manual ramp.

Sources: `drivers.thermotron.codec`. Each controller answers the queries that public programs ask of it: an 8800
those of its manual's two readers, a 3800 those of pymeasure and of a class on TCP, whose set point is loaded by
RUNM. Not public, and ours: the numbers of error codes, which a refused query is answered with too; the
names of an 8200 and a 3800 (that of a 3800 has 23 characters, as that class reads), versions; that a ramp of 0
is refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from drivers.thermotron import ThermotronConfig
from drivers.thermotron.codec import ALARM_BITS, CHANNELS, CONTROLLERS, RUNNING_CODE, STOP_CODES, Name
from simulators.faults import DeviceFault, Fault
from simulators.interfaces import Installation, Reply
from simulators.plant.lab_chamber import LabChamber

UNKNOWN, OUT_OF_RANGE, NOT_NOW = 2, 3, 4
"""Error codes."""
_LIMIT = 256
_END = re.compile(rb"\r\n|\r|\n")
_NUMBER = r"(-?\d+(?:\.\d*)?)"
_HIGH_PROCESS_ALARM = 1 << next(bit for bit, words in ALARM_BITS.items() if words == "high process alarm")
_POWER_UP, _STOPPED, _PROCESS_ALARM, _OPEN_DOOR = 0, 5, 7, 26
_QUERIES: Mapping[Name, str] = {
    "8800": r"IDEN|VRSN|PVAR\d+|SETP1|FVAL1|MRMP1|DEVN1|MODE|STAT|SCOD|ALRM\d|DOOR|TMPS|OPTN|CMST|PAL[HL]1"
    r"|DTYP\d+|CCNF\d|CHST|IERR|THTL1|LGHT",
    "8200": r"IDEN|PVAR\d+|SETP1|MRMP1|DEVN1|STAT",
    "3800": r"IDEN|VRSN|PVAR1|SETP1|MODE|SCOD",
}
_COMMANDS: Mapping[Name, str] = {
    "8800": "RUNM|STOP|HOLD|RESM|INIT|SETP|MRMP|CMST",
    "8200": "RUNM|STOP|HOLD|RESM|SETP|MRMP",
    "3800": "RUNM|STOP|INIT|SETP",
}


class ThermotronEmulator:
    """One temperature chamber. `address`: on RS-485; what is not for it gets no answer.

    A line ends as its writer ended it: CR, LF or both. Every line gets one answer, `latency_s` after it was taken
    up; commands none unless it `acknowledges`. `fahrenheit`, `product_control`: settings at the panel of an 8800.
    """

    def __init__(
        self,
        plant: LabChamber,
        *,
        controller: Name = "8800",
        address: int | None = None,
        lower_c: float = -75.0,
        upper_c: float = 180.0,
        acknowledges: bool = True,
        fahrenheit: bool = False,
        product_control: bool = False,
        latency_s: float = 0.030,
    ) -> None:
        self._plant = plant
        self._controller = controller
        self._prefix = b"" if address is None else b"\xff#" + bytes([address])
        self._limits = (lower_c, upper_c)
        self._acknowledges = acknowledges
        self._fahrenheit, self._product_control = fahrenheit, product_control
        self._latency_s = latency_s
        self._loads_on_run = CONTROLLERS[controller].loads_on_run
        self._set_point_c = self._loaded_c = plant.set_point_c(0.0)
        self._ramp_k_per_min = 100.0
        self._running = self._held = False
        self._stop_code = _POWER_UP
        self._alarm_bits = 0
        self._door_open = False
        self._error = 0
        self._refusals = 0
        self._input = b""
        self._free_at_s = 0.0

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take bytes the bench wrote (any chunking); an empty line is not answered."""
        self._input += data
        replies, start = [], 0
        for end in _END.finditer(self._input):
            line = self._input[start : end.start()]
            start = end.end()
            if not line.startswith(self._prefix) or not line:
                continue
            answer = self._answer(line[len(self._prefix) :].decode("latin-1").strip().upper(), now_s)
            if answer:
                self._free_at_s = max(self._free_at_s, now_s) + self._latency_s
                replies.append(Reply(self._free_at_s, self._prefix + answer.encode() + end[0]))
        self._input = self._input[start:][-_LIMIT:]
        return replies

    @property
    def faults(self) -> Mapping[str, DeviceFault]:
        """`alarm`: it stops with stop code `count` (1: process alarm). `refuse`: `count` commands get a code."""
        return {"alarm": self._alarm, "refuse": self._refuse}

    def open_door(self, is_open: bool, now_s: float) -> None:
        """Open or close the door: an open one stops the chamber."""
        self._door_open = is_open
        if is_open:
            self._stop(_OPEN_DOOR, now_s)

    def _alarm(self, fault: Fault, now_s: float) -> None:
        code = fault.count if fault.count != RUNNING_CODE and fault.count in STOP_CODES else _PROCESS_ALARM
        self._alarm_bits |= _HIGH_PROCESS_ALARM * (code == _PROCESS_ALARM)
        self._stop(code, now_s)

    def _refuse(self, fault: Fault, now_s: float) -> None:
        self._refusals = fault.count

    def _answer(self, text: str, now_s: float) -> str:
        """Return the answer to a line, empty for none."""
        if text.endswith("?"):
            if re.fullmatch(_QUERIES[self._controller], text[:-1]):
                return self._query(text[:-1], now_s)
            return self._refused(UNKNOWN)
        if self._refusals:
            self._refusals -= 1
            return self._refused(NOT_NOW)
        code = self._command(text, now_s) if text[:4] in _COMMANDS[self._controller].split("|") else UNKNOWN
        return self._refused(code) if code or self._acknowledges else ""

    def _refused(self, code: int) -> str:
        self._error = code or self._error
        return str(code)

    def _query(self, name: str, now_s: float) -> str:
        if name[:4] in ("PVAR", "DTYP", "ALRM", "CCNF"):
            return self._of_channel(name[:4], int(name[4:]), now_s)
        lower, upper = self._limits
        answers: Mapping[str, Callable[[], str]] = {
            "IDEN": lambda: f"{self._controller} Chamber Controller",
            "VRSN": lambda: "1.00",
            "SETP1": lambda: f"{self._shown_c(now_s):.3f}",
            "FVAL1": lambda: f"{self._set_point_c:.3f}",
            "MRMP1": lambda: f"{self._ramp_k_per_min:.3f}",
            "DEVN1": lambda: f"{self._plant.air_temp_c(now_s) - self._shown_c(now_s):.3f}",
            "MODE": lambda: "16" if self._running else "2",
            "STAT": lambda: str((32 if self._held else 16) * self._running),
            "SCOD": lambda: str(RUNNING_CODE if self._running else self._stop_code),
            "DOOR": lambda: str(int(not self._door_open)),
            "TMPS": lambda: str(int(self._fahrenheit)),
            "OPTN": lambda: str(int(self._product_control)),
            "CMST": lambda: str(int(self._acknowledges)),
            "PALH1": lambda: f"{upper:.3f}",
            "PALL1": lambda: f"{lower:.3f}",
            "CHST": lambda: str(0x101),
            "IERR": self._last_error,
            "THTL1": lambda: "0",
            "LGHT": lambda: "0",
        }
        return answers[name]()

    def _of_channel(self, name: str, channel: int, now_s: float) -> str:
        """Return the answer of channel 1, the air, or of a sensor, 0 of one that is not configured."""
        there = channel == 1 or channel in CHANNELS
        if name == "PVAR":
            if not there:
                return self._refused(OUT_OF_RANGE)
            plant = self._plant
            return f"{plant.air_temp_c(now_s) if channel == 1 else plant.auxiliary_c(channel, now_s):.3f}"
        if name == "ALRM":
            return str(self._alarm_bits if channel == 1 else 0)
        return str((1 if name == "DTYP" else 2) * there)

    def _shown_c(self, now_s: float) -> float:
        return self._loaded_c if self._loads_on_run else self._plant.set_point_c(now_s)

    def _last_error(self) -> str:
        error, self._error = self._error, 0
        return str(error)

    def _command(self, text: str, now_s: float) -> int:
        """Carry out a command; return 0 or an error code."""
        if text in ("STOP", "INIT"):
            if text == "STOP":
                self._stop(_STOPPED, now_s)
            return 0
        if text in ("HOLD", "RESM"):
            self._held = text == "HOLD" and self._running
            return 0 if self._running else NOT_NOW
        if text == "RUNM":
            return self._run(now_s)
        if found := re.fullmatch(rf"SETP1,{_NUMBER}", text):
            return self._set(float(found[1]), now_s)
        if found := re.fullmatch(rf"MRMP1,{_NUMBER}", text):
            if not 0.0 < float(found[1]) <= 1000.0:
                return OUT_OF_RANGE
            self._ramp_k_per_min = float(found[1])
            return self._demand(now_s)
        if text in ("CMST0", "CMST1"):
            self._acknowledges = text == "CMST1"
            return 0
        return OUT_OF_RANGE

    def _run(self, now_s: float) -> int:
        if self._door_open or self._alarm_bits:
            return NOT_NOW
        if self._running and not self._loads_on_run:
            return NOT_NOW
        self._running, self._held = True, False
        self._loaded_c = self._set_point_c
        return self._demand(now_s)

    def _set(self, set_point_c: float, now_s: float) -> int:
        if not self._limits[0] <= set_point_c <= self._limits[1]:
            return OUT_OF_RANGE
        self._set_point_c = set_point_c
        if self._loads_on_run:
            return 0
        self._loaded_c = set_point_c
        return self._demand(now_s)

    def _stop(self, code: int, now_s: float) -> None:
        if self._running:
            self._stop_code = code
        self._running = self._held = False
        self._demand(now_s)

    def _demand(self, now_s: float) -> int:
        ramp = self._ramp_k_per_min if CONTROLLERS[self._controller].ramps else 0.0
        self._plant.demand(
            now_s, set_point_c=self._loaded_c, ramp_up=ramp, ramp_down=ramp, running=self._running
        )
        return 0


def emulator(config: ThermotronConfig, plant: LabChamber, installed: Installation) -> ThermotronEmulator:
    """Make the emulator of a bench file's chamber with one of the controllers."""
    return ThermotronEmulator(
        plant, controller=config.controller, address=config.address, acknowledges=config.acknowledges
    )
