"""An ESPEC chamber with a P-300 or SCP-220 controller in bytes: constant mode, remote programs, alarms.

Source: ChamberConnectLibrary (MIT). Not documented there and ours: the ROM versions' texts, what follows a
remote program (here: its end is held), and the code of the alarm.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from drivers.espec import EspecConfig
from drivers.espec.codec import END, encode_line
from simulators.faults import DeviceFault, Fault
from simulators.interfaces import Installation, Reply
from simulators.plant.lab_chamber import LabChamber

_LIMIT = 256
_PROGRAM = re.compile(r"RUN PRGM,TEMP(-?[\d.]+)TIME(\d+):(\d+)GOTEMP(-?[\d.]+)")
_SET = re.compile(r"TEMP,S(-?\d+(?:\.\d+)?)")


class EspecEmulator:
    """One temperature chamber. `address`: on RS-485; commands without it, or with another one, get no answer.

    Every line gets one reply, `latency_s` after it was taken up, one line after the other.
    """

    def __init__(
        self,
        plant: LabChamber,
        *,
        rom: str = "P300 V4.20",
        address: int | None = None,
        upper_c: float = 155.0,
        lower_c: float = -75.0,
        latency_s: float = 0.050,
    ) -> None:
        self._plant = plant
        self._rom = rom
        self._prefix = "" if address is None else f"{address},"
        self._limits = (lower_c, upper_c)
        self._latency_s = latency_s
        self._mode = "STANDBY"
        self._constant_c = plant.set_point_c(0.0)
        self._alarms: list[int] = []
        self._refusals: list[str] = []
        self._input = b""
        self._free_at_s = 0.0

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take bytes the bench wrote (any chunking); an empty line is not answered."""
        *lines, rest = (self._input + data).split(END)
        self._input = rest[-_LIMIT:]
        replies = []
        for line in lines:
            text = line.decode("latin-1").strip()
            if text and text.startswith(self._prefix):
                self._free_at_s = max(self._free_at_s, now_s) + self._latency_s
                answer = self._answer(text.removeprefix(self._prefix), now_s)
                replies.append(Reply(self._free_at_s, encode_line(answer)))
        return replies

    @property
    def faults(self) -> Mapping[str, DeviceFault]:
        """`alarm`: alarm code `count`, and conditioning stops. `refuse`: `count` commands are answered
        NA:`text`."""
        return {"alarm": self._alarm, "refuse": self._refuse}

    def _alarm(self, fault: Fault, now_s: float) -> None:
        self._alarms.append(fault.count)
        self._demand("STANDBY", self._constant_c, 0.0, now_s)

    def _refuse(self, fault: Fault, now_s: float) -> None:
        self._refusals = [fault.text or "CHB NOT READY"] * fault.count

    def _answer(self, text: str, now_s: float) -> str:
        if text.endswith("?"):
            return self._query(text, now_s)
        if self._refusals:
            return f"NA:{self._refusals.pop()}"
        refusal = self._command(text.upper().replace(" ", "").replace("RUNPRGM", "RUN PRGM"), now_s)
        return f"NA:{refusal}" if refusal else "OK:" + text.replace(", ", ",")

    def _query(self, text: str, now_s: float) -> str:
        lower, upper = self._limits
        match text.upper():
            case "TEMP?":
                air, set_point = self._plant.air_temp_c(now_s), self._plant.set_point_c(now_s)
                return f"{air:.1f},{set_point:.1f},{upper:.1f},{lower:.1f}"
            case "MODE?":
                return self._mode
            case "MON?":
                return f"{self._plant.air_temp_c(now_s):.1f},,{self._mode},{len(self._alarms)}"
            case "ALARM?":
                return ",".join(str(number) for number in (len(self._alarms), *self._alarms))
            case "TYPE?":
                return "T,S2,160.0"
            case "ROM?":
                return self._rom
        return "NA:CMD ERR"

    def _command(self, text: str, now_s: float) -> str:
        """Carry out a command without its spaces; return why not, empty if it was."""
        if text in ("MODE,STANDBY", "MODE,OFF"):
            self._demand(text.removeprefix("MODE,"), self._constant_c, 0.0, now_s)
            return ""
        if text == "MODE,CONSTANT":
            return "CHB NOT READY" if self._alarms else self._demand("CONSTANT", self._constant_c, 0.0, now_s)
        if found := _SET.fullmatch(text):
            return self._set(float(found[1]), now_s)
        if found := _PROGRAM.fullmatch(text):
            return self._run(float(found[1]), 60 * int(found[2]) + int(found[3]), float(found[4]), now_s)
        return "CMD ERR" if text.split(",")[0] not in ("TEMP", "MODE", "RUN PRGM") else "PARA ERR"

    def _set(self, set_point_c: float, now_s: float) -> str:
        if not self._allows(set_point_c):
            return "DATA OUT OF RANGE"
        self._constant_c = set_point_c
        if self._mode == "RUN":
            return ""
        return self._demand(self._mode, set_point_c, 0.0, now_s)

    def _run(self, start_c: float, minutes: int, end_c: float, now_s: float) -> str:
        if not (self._allows(start_c) and self._allows(end_c) and minutes):
            return "DATA OUT OF RANGE"
        if self._alarms:
            return "CHB NOT READY"
        return self._demand("RUN", end_c, abs(end_c - start_c) / minutes, now_s)

    def _allows(self, set_point_c: float) -> bool:
        return self._limits[0] <= set_point_c <= self._limits[1]

    def _demand(self, mode: str, set_point_c: float, ramp: float, now_s: float) -> str:
        self._mode = mode
        running = mode in ("CONSTANT", "RUN")
        self._plant.demand(now_s, set_point_c=set_point_c, ramp_up=ramp, ramp_down=ramp, running=running)
        return ""


def p300(config: EspecConfig, plant: LabChamber, installed: Installation) -> EspecEmulator:
    """Make the emulator of a bench file's chamber with a P-300."""
    return EspecEmulator(plant, address=config.address)


def scp220(config: EspecConfig, plant: LabChamber, installed: Installation) -> EspecEmulator:
    """Make the emulator of a bench file's chamber with an SCP-220."""
    return EspecEmulator(plant, rom="SCP-220 V2.10", address=config.address)
