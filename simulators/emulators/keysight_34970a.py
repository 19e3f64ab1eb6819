"""A Keysight 34970A with a multiplexer in every slot, in bytes: probes, scan list, READ?.

Source: Agilent 34970A/34972A Command Reference and User's Guide. A scan takes 20 ms a channel (1 PLC at 50 Hz); a
sensor reads what it is glued to in the lab. Ours: a resolution of 1 mK and the serial number.
"""

from __future__ import annotations

from collections.abc import Mapping

from drivers.base.constants import ZERO_CELSIUS_K
from drivers.keysight_34970a import DaqConfig
from simulators.emulators.scpi import MISSING, UNDEFINED, Refusal, ScpiEmulator, switch
from simulators.faults import DeviceFault, Fault
from simulators.interfaces import Installation, Reply
from simulators.plant.lab_chamber import LabChamber

_OPEN = 9.9e37
_PER_CHANNEL_S = 0.020
_PROBES = ("TC", "TCOUPLE", "RTD", "FRTD", "THER", "THERMISTOR")
_UNITS = ("C", "F", "K")


class DaqEmulator(ScpiEmulator):
    """One instrument; a channel that was not configured for temperatures reads 0 V."""

    words = (
        *(
            "CONFigure",
            "TEMPerature",
            "UNIT",
            "FORMat",
            "READing",
            "TIME",
            "CHANnel",
            "ALARm",
            "ROUTe",
            "SCAN",
        ),
        *("READ", "SIZE", "INITiate", "FETCh", "ABORt", "SENSe", "FUNCtion"),
    )

    def __init__(self, plant: LabChamber, latency_s: float = 0.010) -> None:
        super().__init__("HEWLETT-PACKARD,34970A,0,13-2-2", latency_s)
        self._plant = plant
        self._probes: dict[int, str] = {}
        self._units: dict[int, str] = {}
        self._scan: list[int] = []
        self._open: set[int] = set()
        self._reads = False

    @property
    def faults(self) -> Mapping[str, DeviceFault]:
        """`refuse`, and `open_sensor`: the sensor of channel `count` breaks."""
        return {**super().faults, "open_sensor": self._break}

    def _break(self, fault: Fault, now_s: float) -> None:
        self._open.add(fault.count)

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take bytes the bench wrote; the answer to READ? comes when the scan is over."""
        self._reads = False
        replies = super().receive(data, now_s)
        if not self._reads:
            return replies
        return [Reply(reply.at_s + _PER_CHANNEL_S * len(self._scan), reply.data) for reply in replies]

    def query(self, header: str, arguments: list[str], channels: list[int], now_s: float) -> str:
        """Answer a query."""
        match header:
            case "READ?":
                if not self._scan:
                    raise Refusal('+309,"Scan list is empty"')
                self._reads = True
                return ",".join(f"{self._reading(channel, now_s):+.8E}" for channel in self._scan)
            case "ROUT:SCAN?":
                text = f"(@{','.join(map(str, self._scan))})"
                return f"#{len(str(len(text)))}{len(text)}{text}"
            case "ROUT:SCAN:SIZE?":
                return f"+{len(self._scan)}"
            case "UNIT:TEMP?":
                return ",".join(self._units.get(channel, "C") for channel in channels or self._scan)
        raise Refusal(UNDEFINED)

    def command(self, header: str, arguments: list[str], channels: list[int], now_s: float) -> None:
        """Carry out a command."""
        for channel in channels:
            if not (1 <= channel // 100 <= 3 and 1 <= channel % 100 <= 20):
                raise Refusal('-222,"Data out of range"')
        match header:
            case "CONF:TEMP":
                if len(arguments) < 2 or arguments[0].upper() not in _PROBES:
                    raise Refusal('-224,"Illegal parameter value"')
                self._probes |= dict.fromkeys(channels, ",".join(arguments[:2]))
                self._scan = list(channels)
            case "UNIT:TEMP":
                unit = arguments[0].upper() if arguments else ""
                if unit not in _UNITS:
                    raise Refusal('-224,"Illegal parameter value"' if unit else MISSING)
                self._units |= dict.fromkeys(channels or self._probes, unit)
            case "ROUT:SCAN":
                self._scan = list(channels)
            case "FORM:READ:UNIT" | "FORM:READ:TIME" | "FORM:READ:CHAN" | "FORM:READ:ALAR":
                if switch(arguments):
                    raise Refusal('-241,"Hardware missing"')
            case _:
                raise Refusal(UNDEFINED)

    def _reading(self, channel: int, now_s: float) -> float:
        if channel in self._open:
            return _OPEN
        if channel not in self._probes:
            return 0.0
        temp_c = round(self._plant.auxiliary_c(channel, now_s), 3)
        return {"C": temp_c, "F": 1.8 * temp_c + 32.0, "K": temp_c + ZERO_CELSIUS_K}[
            self._units.get(channel, "C")
        ]


def emulator(config: DaqConfig, plant: LabChamber, installed: Installation) -> DaqEmulator:
    """Make the emulator of a bench file's logger."""
    return DaqEmulator(plant)
