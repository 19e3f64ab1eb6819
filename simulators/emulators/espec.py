"""An ESPEC chamber with a P-300 or SCP-220 controller in bytes: constant mode, remote programs, alarms.

Source: ChamberConnectLibrary (MIT), all of whose queries are answered, or refused in its words: what a chamber
without humidity and product control has not, stored programs, timers. Not documented there and ours: the ROM
versions' texts, what follows a remote program (here: its end is held), the code of the alarm, and a heater that
always reports 0 %.
"""

from __future__ import annotations

import datetime
import math
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
_START = datetime.datetime(2026, 1, 1)
"""The controller's date at lab time 0."""
_ANSWERS: Mapping[str, str] = {
    "TYPE?": "T,S2,160.0",
    "KEYPROTECT?": "OFF",
    "MASK?": "00000000",
    "TIMER ON?": "0",
    "TIMER USE?": "0",
    "SET?": "REF9",
    "RELAY?": "0",
    "%?": "1,0.0",
    "CONSTANT SET?,REF": "AUTO",
    "CONSTANT SET?,RELAY": "0",
    "PRGM USE?,RAM": "0",
    "SYSTEM SET?,PTCOPT": "OFF",
    "IPSET?": "192.168.1.20,255.255.255.0,192.168.1.1",
    **dict.fromkeys(("PRGM MON?", "PRGM SET?"), "NA:CONT NOT READY-2"),
    **dict.fromkeys(
        ("HUMI?", "CONSTANT SET?,HUMI", "CONSTANT SET?,PTC", "MON PTC?", "TEMP PTC?", "SET PTC?", "PTC?"),
        "NA:CONT NOT READY-1",
    ),
}
"""Answers that never change."""
_STORED = ("PRGM USE?", "PRGM DATA?", "PRGM DATA PTC?", "TIMER LIST?")
"""Queries for programs and timers, of which there are none."""


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
        self._tells_detail = rom.startswith("P300")
        self._prefix = "" if address is None else f"{address},"
        self._limits = (lower_c, upper_c)
        self._latency_s = latency_s
        self._mode = "STANDBY"
        self._program = (0.0, 0, 0.0, math.inf)
        """Of the remote program: start in degC, minutes, end in degC, lab time in s at which it ends."""
        self._constant_c = plant.set_point_c(0.0)
        self._alarms: list[int] = []
        self._refusals: list[str] = []
        self._input = b""
        self._free_at_s = 0.0

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take bytes the bench wrote (any chunking); an empty line is not answered."""
        *lines, unfinished = (self._input + data).split(END)
        self._input = unfinished[-_LIMIT:]
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
        if "?" in text:
            return self._query(text.upper(), now_s)
        if self._refusals:
            return f"NA:{self._refusals.pop()}"
        refusal = self._command(text.upper().replace(" ", "").replace("RUNPRGM", "RUN PRGM"), now_s)
        return f"NA:{refusal}" if refusal else "OK:" + text.replace(", ", ",")

    def _query(self, text: str, now_s: float) -> str:
        name, _, option = text.partition("?")
        if option.strip(" ,") == "DETAIL" and name in ("MODE", "MON") and not self._tells_detail:
            return "NA:CONT NOT READY-3"
        if name == "RUN PRGM" or name == "RUN PRGM MON":
            return self._remote_program(name, now_s) if self._mode == "RUN" else "NA:CONT NOT READY-2"
        if text.startswith(_STORED) and text not in _ANSWERS:
            return "NA:DATA NOT READY"
        lower, upper = self._limits
        match text:
            case "TEMP?":
                air, set_point = self._plant.air_temp_c(now_s), self._plant.set_point_c(now_s)
                return f"{air:.1f},{set_point:.1f},{upper:.1f},{lower:.1f}"
            case "MODE?":
                return self._mode
            case "MODE?,DETAIL":
                return self._detailed_mode(now_s)
            case "MON?" | "MON?,DETAIL":
                mode = self._detailed_mode(now_s) if option else self._mode
                return f"{self._plant.air_temp_c(now_s):.1f},,{mode},{len(self._alarms)}"
            case "CONSTANT SET?,TEMP":
                return f"{self._constant_c:.1f},ON"
            case "REF?":
                return "1,ON1" if self._mode in ("CONSTANT", "RUN") else "1,OFF1"
            case "SRQ?":
                return f"0{int(bool(self._alarms))}000000"
            case "DATE?":
                return f"{self._clock(now_s):%y.%m/%d}"
            case "TIME?":
                return f"{self._clock(now_s):%H:%M:%S}"
            case "ALARM?":
                return ",".join(str(number) for number in (len(self._alarms), *self._alarms))
            case "ROM?" | "ROM?,DISP":
                return self._rom
        return _ANSWERS.get(text, "NA:CMD ERR")

    def _clock(self, now_s: float) -> datetime.datetime:
        return _START + datetime.timedelta(seconds=now_s)

    def _detailed_mode(self, now_s: float) -> str:
        if self._mode != "RUN":
            return self._mode
        return "RMT RUN END HOLD" if now_s >= self._program[3] else "RMT RUN"

    def _remote_program(self, name: str, now_s: float) -> str:
        start_c, minutes, end_c, end_s = self._program
        if name == "RUN PRGM":
            return f"TEMP{start_c:.1f} GOTEMP{end_c:.1f} TIME{minutes // 60}:{minutes % 60:02d} REF9"
        left = math.ceil(max(0.0, end_s - now_s) / 60.0)
        return f"1,{self._plant.set_point_c(now_s):.1f},{left // 60}:{left % 60:02d},0"

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
        self._program = (start_c, minutes, end_c, now_s + 60.0 * minutes)
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
