"""Keysight (Agilent, HP) data loggers 34970A, 34972A, DAQ970A, DAQ973A: temperatures by a scan list.

SCPI over RS-232 (34970A: 57600 baud as delivered) or TCP port 5025. Source: Agilent 34970A/34972A Command
Reference and the examples of the 34970A User's Guide, chapter 7 (CONF:TEMP TC,J,(@...), ROUT:SCAN, READ?); a
sensor that is open reads +9.90000000E+37.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from drivers.base.errors import DeviceRefused
from drivers.kit.config import LoggerConfig, Mistake, NumberedTexts, key
from drivers.kit.instruments import Rest
from drivers.kit.kinds import Connection, Exchange, MeterKind, Probe, Transcript
from drivers.kit.matching import polled
from drivers.kit.scpi import ScpiMeter, channel_list, numbers, query_exchanges

_OPEN = 1e36
"""What is beyond this is no temperature: the instrument's 9.9E+37."""
_PROBE = r"^(TC,[BEJKNRST]|F?RTD,(85|91)|THER,(2252|5000|10000))$"
_PROBE_TEXT = "a probe as CONF:TEMP names it: 'TC,K', 'RTD,85', 'FRTD,85' (4 wires), 'THER,5000', ..."


class DaqConfig(LoggerConfig):
    """`[[logger]]` of a 34970A or one of its family; channels are numbered slot and channel: 101, 203."""

    baudrate: int = key(
        default=57_600, ge=1200, le=115_200, description="the baud rate, 57600 as a 34970A is delivered"
    )
    probe: str = key(default="TC,K", pattern=_PROBE, description=_PROBE_TEXT)
    probes: NumberedTexts = key(
        default_factory=dict, description="channel = its probe, where that is another than `probe`"
    )

    @classmethod
    def mistakes(cls, given: Mapping[str, Any]) -> Iterator[Mistake]:
        """Yield channels that such an instrument does not have, and probes of channels that are not scanned."""
        yield from super().mistakes(given)
        sensors, probes = given.get("sensors"), given.get("probes")
        channels = [str(number) for number in sensors] if isinstance(sensors, dict) else []
        for channel in channels:
            if not (channel.isdecimal() and 1 <= int(channel) // 100 <= 3 and 1 <= int(channel) % 100 <= 60):
                yield Mistake(f"sensors.{channel}", channel, "slot and channel, 101 to 360")
        for channel, probe in probes.items() if isinstance(probes, dict) else ():
            if str(channel) not in channels:
                yield Mistake(
                    f"probes.{channel}", str(channel), f"a channel of sensors ({', '.join(channels)})"
                )
            elif not re.fullmatch(_PROBE, str(probe)):
                yield Mistake(f"probes.{channel}", repr(probe), _PROBE_TEXT)

    def probe_of(self, channel: int) -> str:
        """The probe on a channel."""
        return self.probes.get(channel, self.probe)


class DaqLogger(ScpiMeter):
    """One instrument (`drivers.kit.instruments.Meter`)."""

    _product = "a Keysight 34970A, 34972A, DAQ970A or DAQ973A"
    _models = ("34970A", "34972A", "DAQ970A", "DAQ973A")

    def __init__(self, config: DaqConfig, connection: Connection) -> None:
        super().__init__(connection.link(config.port, config.baudrate))
        self.config = config
        self.channels = sorted(config.sensors)
        self.columns = _columns(config)

    def prepare(self) -> None:
        """Set probes, degC, readings without units and times, and the scan list; read the unit back."""
        self._clear_errors()
        for channel in self.channels:
            self._tell(f"CONF:TEMP {self.config.probe_of(channel)},(@{channel})")
        channels = channel_list(self.channels)
        self._tell(f"UNIT:TEMP C,{channels}")
        self._tell("\n".join(f"FORM:READ:{part} OFF" for part in ("UNIT", "TIME", "CHAN", "ALAR")))
        self._tell(f"ROUT:SCAN {channels}")
        units = self._query(
            f"UNIT:TEMP? {channels}", lambda reply: [word.strip() for word in reply.split(",")]
        )
        if units != ["C"] * len(self.channels):
            raise DeviceRefused(
                "the logger does not read degrees Celsius",
                where=self._where,
                found=", ".join(units),
                expected="C on every channel",
                remedy="check that its modules measure temperatures",
            )

    def _poll(self) -> Sequence[str]:
        return ("READ?",)

    def _take_readings(self) -> Mapping[str, float]:
        return self._read(lambda reply: _readings(reply, self.columns))

    def alarms(self) -> list[str]:
        """Return nothing: an open sensor is a gap in its readings, which the bench watches."""
        return []

    def make_safe(self) -> None:
        """Nothing: it only reads."""

    def read_rest(self) -> Rest:
        """At rest: it only reads."""
        return Rest(True)

    def _send_stop(self) -> None:
        """Nothing: it only reads."""


def _columns(config: DaqConfig) -> tuple[str, ...]:
    return tuple(f"aux_{channel}_temp_c" for channel in sorted(config.sensors))


def _readings(reply: str, columns: tuple[str, ...]) -> dict[str, float]:
    temps_c = numbers(reply, len(columns))
    return {
        name: temp_c if abs(temp_c) < _OPEN else math.nan
        for name, temp_c in zip(columns, temps_c, strict=True)
    }


def decode_transcript(exchanges: Iterable[Exchange], config: DaqConfig) -> Transcript:
    """Return one row an answered scan and counts; never raises on bytes."""
    columns = _columns(config)
    return polled(
        query_exchanges(exchanges),
        lambda request: request.rpartition("\n")[2] == "READ?",
        lambda reply: _readings(reply, columns),
        columns,
    )


Daq = MeterKind(
    DaqLogger,
    decode_transcript,
    DaqConfig,
    probes=lambda: [
        Probe(34, {"name": "logger", "sensors": {101: ""}}, baudrate=baud) for baud in (57_600, 9600)
    ],
)
