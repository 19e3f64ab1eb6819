"""The KVH gyro as the bench finds it by name: found among its own binary output, configured, left to stream."""

from __future__ import annotations

import contextlib
import re
from typing import Any

from numpy.typing import NDArray

from drivers.base.errors import BenchError, DeviceRefused, DeviceSilent, WrongDevice
from drivers.kit.config import GyroConfig, key
from drivers.kit.conversation import TRIES, ConversingGyro
from drivers.kit.instruments import Identity
from drivers.kit.kinds import Columns, Connection, GyroKind, Probe
from drivers.kvh.commands import SETTINGS
from drivers.kvh.format import Format, KvhDecoder, rate_dps

_REFUSAL = rb"(?:INVALID|USAGE|ERROR)[ -~]*(?=[\r\n])"
_HEADER = re.compile(rb"\xfe\x81\xff[\x55-\x57]")


class KvhConfig(GyroConfig):
    """`[[gyro]]` of a KVH gyro; `rate_hz` is one of the unit's data rates."""

    frame_format: Format | None = key(default=None, description="'A', 'B' or 'C'; left out: 'A'")

    @property
    def sends(self) -> Format:
        """The format that the unit is told to send."""
        return self.frame_format or "A"


class KvhGyro(ConversingGyro):
    """A KVH DSP-1750, DSP-1760 or 1775 on an RS-422 port (921600 8N1 as delivered).

    Rotation is sent as delta angle in radians, which leaves nothing of it out between samples; temperatures in
    hundredths, the best resolution. `identify` and `stop` leave it in configuration mode, where it is quiet.
    """

    what = "a KVH gyro"

    def __init__(self, config: KvhConfig, connection: Connection) -> None:
        """Raise ConfigurationError for what no such unit can be set to."""
        super().__init__(connection.link(config.port, config.baudrate))
        self._demands = {
            "MSYNC": "IMU",
            "DR": f"{config.rate_hz:g}",
            "OUTPUTFMT": config.sends,
            "ROTFMT": "DELTA",
            "ROTUNITS": "RAD",
            "TEMPUNITS": "C_100",
        }
        for name, value in self._demands.items():
            if value not in SETTINGS[name]:
                raise self._unusable(f"{name},{value}", "one of " + ", ".join(SETTINGS[name]))

    def identify(self) -> Identity:
        """Enter configuration mode and ask for serial number, software and data rate.

        Raises DeviceSilent (nothing on the line, or a gyro that streams and does not listen), WrongDevice
        (something else answers), DeviceRefused (the answer is a refusal).
        """
        self._configuration_mode()
        told = {name: self._query(name) for name in ("IS", "WS", "DR", "OUTPUTFMT")}
        if not told["IS"]:
            raise WrongDevice(
                "the serial number is empty",
                where=self.link.where,
                found="IS,",
                expected="IS,<serial number> (KVH 56-0298, section 8.20)",
                remedy="check that the bench file names the right port",
            )
        return Identity("KVH", "DSP-1750/1760/1775", told["IS"], told["WS"], told)

    def start(self) -> None:
        """Set rate, format and units, each confirmed by its echo, then stream.

        Raises DeviceRefused with the unit's words, DeviceSilent or WrongDevice.
        """
        self._configuration_mode()
        for name, value in self._demands.items():
            self._ask(f"={name},{value}", rf"{name}, *{value}")
        self._ask("=CONFIG,0", "CONFIG, *0")
        super().start()

    def stop(self) -> None:
        """Stop the stream by entering configuration mode."""
        self._configuration_mode()

    def streams(self, data: bytes) -> bool:
        """Whether a header of a data message is in it."""
        return _HEADER.search(data) is not None

    def _configuration_mode(self) -> None:
        """Enter configuration mode from whatever state; a first command may meet half a line in the unit."""
        self.link.streaming = False
        self._asked("=CONFIG,1", "CONFIG, *1", (DeviceSilent, DeviceRefused))

    def _query(self, name: str) -> str:
        """Ask what changes nothing in the unit; again if a bit flipped on the way there or back."""
        troubles = (DeviceSilent, DeviceRefused, WrongDevice)
        return self._asked(f"?{name}", rf"{name}, *([ -~]*)", troubles).strip()

    def _asked(self, command: str, expected: str, troubles: tuple[type[BenchError], ...]) -> str:
        """Ask as `_ask` does, again when any of `troubles` is met, a few times at most."""
        for _ in range(TRIES - 1):
            with contextlib.suppress(*troubles):
                return self._ask(command, expected)
        return self._ask(command, expected)

    def _ask(self, command: str, expected: str) -> str:
        """Send a line; return group 1 of the line that matches `expected` ("" without one).

        Bytes of messages under way may stand before the reply, without a line end between.
        """
        # With =ECHO on the unit repeats the command first: that one has the "=" or "?" before it.
        pattern = rb"(?<![=?])" + expected.encode("ascii") + rb"(?=[\r\n])"
        self.link.discard()
        self.link.write(command.encode("ascii") + b"\r\n")
        seen = self._read_until(re.compile(pattern + rb"|" + _REFUSAL))
        if match := re.search(pattern, seen):
            return match[1].decode("ascii") if match.re.groups else ""
        if refusal := re.search(_REFUSAL, seen):
            remedy = "check the unit's software version, and that its baud rate carries the data rate"
            raise self._refused(command, refusal[0], command[1:], remedy)
        raise self._unanswered(command, seen, command[1:])


def _decoder(config: KvhConfig) -> KvhDecoder:
    return KvhDecoder(nominal_rate_hz=config.rate_hz, frame_format=config.sends, axes=config.axes)


def _rates(config: KvhConfig, columns: Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    return {axis: rate_dps(columns[f"rot_{axis}"], "delta", "RAD", sample_rate_hz) for axis in config.axes}


def _probes() -> list[Probe]:
    return [
        Probe(10, keys={"frame_format": form, "axis": "x", "axes": "xyz"}, name=form)
        for form in ("A", "B", "C")
    ]


Kvh1750 = GyroKind(KvhGyro, _decoder, _rates, KvhConfig, probes=_probes)
