"""Power supplies in bytes: a Keysight E36312A (channel lists) and a Rohde & Schwarz HMP4040 (a selected output).

Sources: E36300 Series Programming Guide; HMP Series SCPI Programmers Manual. Ours: that an output which a
protection has switched off stays off until that is cleared, and the serial numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.keysight_e36300 import E36300Config
from drivers.rs_hmp import HmpConfig
from simulators.emulators.scpi import UNDEFINED, Refusal, ScpiEmulator, number, switch
from simulators.faults import DeviceFault, Fault
from simulators.interfaces import Installation
from simulators.plant.load import Load

_WORDS = (
    "SOURce",
    "VOLTage",
    "CURRent",
    "OUTPut",
    "STATe",
    "MEASure",
    "SCALar",
    "DC",
    "PROTection",
    "TRIPped",
    "CLEar",
)
_OPTIONAL = {"SOUR", "SCAL", "DC"}


@dataclass
class _Output:
    load: Load
    most_v: float
    most_a: float
    voltage_v: float = 0.0
    limit_a: float = 0.1
    on: bool = False
    tripped: str = ""

    def apply(self, now_s: float) -> None:
        self.load.supply(now_s, self.voltage_v, self.limit_a, self.on)

    def drawn(self) -> tuple[float, float]:
        return self.load.drawn(self.voltage_v, self.limit_a, self.on)


class _SupplyEmulator(ScpiEmulator):
    """What both have in common: outputs with loads, and protections that trip."""

    words: tuple[str, ...] = _WORDS

    def __init__(self, identity: str, latency_s: float, outputs: dict[int, _Output]) -> None:
        super().__init__(identity, latency_s)
        self.outputs = outputs

    @property
    def faults(self) -> Mapping[str, DeviceFault]:
        """`refuse`, and `alarm`: overcurrent protection switches output `count` off."""
        return {**super().faults, "alarm": self._trip}

    def _trip(self, fault: Fault, now_s: float) -> None:
        output = self.outputs[fault.count]
        output.on, output.tripped = False, "CURR"
        output.apply(now_s)

    def _output(self, channel: int) -> _Output:
        if channel not in self.outputs:
            raise Refusal('-222,"Data out of range"')
        return self.outputs[channel]

    def _header(self, text: str) -> str:
        header = super()._header(text)
        mark = "?" if header.endswith("?") else ""
        return ":".join(word for word in header.rstrip("?").split(":") if word not in _OPTIONAL) + mark

    def _set(self, header: str, output: _Output, arguments: list[str], now_s: float) -> None:
        if header == "VOLT":
            output.voltage_v = number(arguments, 0.0, output.most_v)
        elif header == "CURR":
            output.limit_a = number(arguments, 0.0, output.most_a)
        else:
            raise Refusal(UNDEFINED)
        output.apply(now_s)


class E36300Emulator(_SupplyEmulator):
    """A Keysight E36312A: 6 V 5 A, 25 V 1 A, 25 V 1 A; without a channel list the first output is meant."""

    def query(self, header: str, arguments: list[str], channels: list[int], now_s: float) -> str:
        """Answer for every channel of the list, separated by commas."""
        return ",".join(self._answer(header, self._output(channel)) for channel in channels or [1])

    def _answer(self, header: str, output: _Output) -> str:
        match header:
            case "VOLT?":
                return f"{output.voltage_v:+.8E}"
            case "CURR?":
                return f"{output.limit_a:+.8E}"
            case "OUTP?" | "OUTP:STAT?":
                return str(int(output.on))
            case "MEAS:VOLT?" | "MEAS?":
                return f"{output.drawn()[0]:+.8E}"
            case "MEAS:CURR?":
                return f"{output.drawn()[1]:+.8E}"
            case "VOLT:PROT:TRIP?":
                return str(int(output.tripped == "VOLT"))
            case "CURR:PROT:TRIP?":
                return str(int(output.tripped == "CURR"))
        raise Refusal(UNDEFINED)

    def command(self, header: str, arguments: list[str], channels: list[int], now_s: float) -> None:
        """Carry out a command on every channel of the list."""
        for channel in channels or [1]:
            output = self._output(channel)
            if header in ("OUTP", "OUTP:STAT"):
                output.on = switch(arguments) and not output.tripped
                output.apply(now_s)
            elif header == "OUTP:PROT:CLE":
                output.tripped = ""
            else:
                self._set(header, output, arguments, now_s)


class HmpEmulator(_SupplyEmulator):
    """A Rohde & Schwarz HMP4040, 32 V 10 A each: `INST:NSEL` says which output is meant."""

    words = (*_WORDS, "INSTrument", "NSELect", "SELect", "GENeral", "FUSE")
    no_error = '0,"No error"'

    def __init__(self, identity: str, latency_s: float, outputs: dict[int, _Output]) -> None:
        super().__init__(identity, latency_s, outputs)
        self._selected = 1
        self._active = dict.fromkeys(outputs, False)
        self._general = False

    def _trip(self, fault: Fault, now_s: float) -> None:
        super()._trip(fault, now_s)
        self._active[fault.count] = False

    def query(self, header: str, arguments: list[str], channels: list[int], now_s: float) -> str:
        """Answer for the selected output."""
        output = self.outputs[self._selected]
        match header:
            case "INST:NSEL?":
                return str(self._selected)
            case "VOLT?":
                return f"{output.voltage_v:.3f}"
            case "CURR?":
                return f"{output.limit_a:.4f}"
            case "OUTP:SEL?":
                return str(int(self._active[self._selected]))
            case "OUTP:GEN?":
                return str(int(self._general))
            case "MEAS:VOLT?":
                return f"{output.drawn()[0]:.3f}"
            case "MEAS:CURR?":
                return f"{output.drawn()[1]:.4f}"
            case "VOLT:PROT:TRIP?":
                return str(int(output.tripped == "VOLT"))
            case "FUSE:TRIP?":
                return str(int(output.tripped == "CURR"))
        raise Refusal(UNDEFINED)

    def command(self, header: str, arguments: list[str], channels: list[int], now_s: float) -> None:
        """Carry out a command on the selected output."""
        match header:
            case "INST:NSEL":
                wanted = int(number(arguments, 1, max(self.outputs)))
                self._output(wanted)
                self._selected = wanted
            case "OUTP:SEL":
                self._active[self._selected] = switch(arguments)
                if self._active[self._selected]:
                    self.outputs[self._selected].tripped = ""
                self._apply(now_s)
            case "OUTP:GEN":
                self._general = switch(arguments)
                self._apply(now_s)
            case _:
                self._set(header, self.outputs[self._selected], arguments, now_s)

    def _apply(self, now_s: float) -> None:
        for channel, output in self.outputs.items():
            output.on = self._general and self._active[channel]
            output.apply(now_s)


def e36300(config: E36300Config, plant: Mapping[int, Load], installed: Installation) -> E36300Emulator:
    """Make the emulator of a bench file's E36300; the plant has the load of each output that feeds units."""
    ranges = {1: (6.18, 5.15), 2: (25.75, 1.03), 3: (25.75, 1.03)}
    outputs = {channel: _Output(plant.get(channel) or _NOTHING, *most) for channel, most in ranges.items()}
    return E36300Emulator("Keysight Technologies,E36312A,MY59001234,2.1.1-1.1.4-1.13", 0.010, outputs)


def hmp(config: HmpConfig, plant: Mapping[int, Load], installed: Installation) -> HmpEmulator:
    """Make the emulator of a bench file's HMP; the plant has the load of each output that feeds units."""
    outputs = {channel: _Output(plant.get(channel) or _NOTHING, 32.05, 10.01) for channel in (1, 2, 3, 4)}
    return HmpEmulator("ROHDE&SCHWARZ,HMP4040,101234,HW50020001/SW2.62", 0.020, outputs)


def _switch_nothing(unit: str, on: bool, time_s: float) -> None:
    """An output that feeds nothing."""


_NOTHING = Load((), _switch_nothing)
