"""The STIM300 as the bench finds it by name: out of its stream into Service Mode, set rate and datagram, back."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

from drivers.base.errors import WrongDevice
from drivers.frames import FrameDecoder, FrameFamily, FramesConfig, family_of, kind_as_described, load_family
from drivers.kit.config import GyroConfig, Mistake
from drivers.kit.conversation import TRIES, ConversingGyro
from drivers.kit.instruments import Identity
from drivers.kit.kinds import Connection
from drivers.stim300.commands import (
    BANNER,
    DATAGRAMS,
    ENTER,
    LEAVE,
    LEFT,
    OUTPUTS,
    RATES,
    SETTINGS,
    bits_per_s,
)

_PROMPT = rb"\r\n?>"
_ANSWER = "its answer and a prompt"
_REFUSAL = re.compile(rb"(?<=[\r\n])E00\d [ -~]*")
_ENTERED = re.compile(rb"(?:" + BANNER.encode() + rb"|E00\d ).*?" + _PROMPT, re.DOTALL)


def family(settings: Mapping[str, str] | None = None) -> FrameFamily:
    """Return the unit's datagrams as `settings` of the description make them."""
    return load_family("stim300", settings)


class Stim300Config(GyroConfig):
    """`[[gyro]]` of a STIM300; `settings` are those of the frame description `stim300`."""

    reads: ClassVar[frozenset[str]] = frozenset({"settings", "pulse_interval_s"})

    @property
    def message(self) -> str:
        """The datagram that the unit is told to send."""
        return self.frame_format or "rate_temp"

    @property
    def technology(self) -> Literal["fog", "rlg", "mems"]:
        """A MEMS unit, as soon as more than one of its axes is used."""
        return "mems" if len(self.axes) > 1 else "fog"

    @property
    def described(self) -> FramesConfig:
        """The configuration of a described gyro that sends the same."""
        return FramesConfig(**{**vars(self), "description": "stim300", "frame_format": self.message})

    @classmethod
    def with_files(cls, given: Mapping[str, Any], folder: Path) -> tuple[dict[str, Any], list[Mistake]]:
        """Refuse settings that the description does not have."""
        settings = given.get("settings")
        if isinstance(settings, dict) and all(isinstance(words, str) for words in settings.values()):
            family_of("stim300", settings)
        return dict(given), []

    @classmethod
    def mistakes(cls, given: Mapping[str, Any]) -> Iterator[Mistake]:
        """Yield a message or a rate that the unit does not have."""
        yield from super().mistakes(given)
        message = given.get("frame_format")
        if message is not None and message not in DATAGRAMS:
            yield Mistake("frame_format", repr(message), "one of " + ", ".join(DATAGRAMS))
        if given.get("rate_hz") not in RATES:
            found = given.get("rate_hz", "nothing")
            yield Mistake("rate_hz", str(found), "one of " + ", ".join(map(str, RATES)))


class Stim300Gyro(ConversingGyro):
    """A STIM300 on an RS-422 port, 8N1 (`drivers.kit.instruments.Gyro`).

    The unit is set to outputs without delay (angular rate and acceleration unless the settings choose otherwise)
    and to datagrams without CR LF. Nothing is saved: after a power-on it is as it was. `identify` and `stop`
    leave it in Service Mode, where it is quiet.
    """

    what = "a STIM300"
    reply_s = 2.0
    seen = 16384  # The longest listing has 3 kB.

    def __init__(self, config: Stim300Config, connection: Connection) -> None:
        """Raise ConfigurationError for a rate that the line cannot carry."""
        super().__init__(connection.link(config.port, config.baudrate))
        rate_hz, message, length = config.rate_hz, config.message, family().form(config.message).shortest
        self._decoder = FrameDecoder(family(config.settings), rate_hz=rate_hz, axes=config.axes)
        if bits_per_s(length, rate_hz) > config.baudrate:
            raise self._unusable(
                f"{rate_hz:g} Hz of {length} bytes at {config.baudrate} Bd",
                f"{bits_per_s(length, rate_hz):.0f} Bd or more (TS1524, equation 12)",
            )
        self._demands = {
            f"m {RATES[int(rate_hz)]}": rf"SAMPLE RATE \[samples/s\] = {rate_hz:.0f}\s",
            f"d {DATAGRAMS[message]},0": r"DATAGRAM = RATE[^\r\n]*\s+DATAGRAM TERMINATION = NONE\s",
        }
        chosen = {"gyro_output": "rate", **config.settings}
        content = message.replace("all", "acc_incl")
        for name, part in (("accelerometer_output", "acc"), ("inclinometer_output", "incl")):
            if part in content.split("_"):
                chosen.setdefault(name, "acceleration")
        for name, (sensor, title, units) in OUTPUTS.items():
            if name in chosen:
                code, words = units[chosen[name]]
                self._demands[f"u {sensor},{code}"] = rf"{title} OUTPUT UNIT = \[[^\]\r\n]*\] \S+ {words}\s"

    def identify(self) -> Identity:
        """Enter Service Mode and ask for serial number, product, part number and firmware.

        Raises DeviceSilent (nothing on the line, or a unit that streams and does not listen), WrongDevice
        (something else answers), DeviceRefused (the answer is an error).
        """
        self._service_mode()
        told = {
            words: self._ask(f"i {key}", rf"{words} = ([^\r\n]*?)\s*[\r\n]")
            for key, words in SETTINGS.items()
        }
        if not told["PRODUCT"].startswith("STIM3"):
            raise WrongDevice(
                "the unit is not a STIM300",
                where=self.link.where,
                found=told["PRODUCT"],
                expected="STIM300",
                remedy="check that the bench file names the right port and driver",
            )
        return Identity("Sensonor", told["PRODUCT"], told["SERIAL NUMBER"], told["FW CONFIG"], told)

    def start(self) -> None:
        """Set rate, datagram and unit of measurement, each confirmed by the unit, then stream.

        Raises DeviceRefused with the unit's words, DeviceSilent or WrongDevice.
        """
        self._service_mode()
        for command, expected in self._demands.items():
            self._ask(command, expected)
        self.link.discard()
        self.link.write(LEAVE)
        left = re.compile(LEFT.encode() + rb"[.]?\s*[\r\n]")
        seen = self._read_until(left)
        if not left.search(seen):
            raise self._unanswered("x N", seen, _ANSWER)
        super().start()

    def stop(self) -> None:
        """Stop the stream by entering Service Mode."""
        self._service_mode()

    def streams(self, data: bytes) -> bool:
        """Whether a datagram is in it."""
        return len(self._decoder.feed(data)) > 0

    def _service_mode(self) -> None:
        """Enter Service Mode from whatever state; in it already, the unit does not know the word."""
        self.link.streaming = False
        seen = b""
        for _ in range(TRIES):
            self.link.discard()
            self.link.write(ENTER)
            seen = self._read_until(_ENTERED)
            if _ENTERED.search(seen):
                return
        raise self._unanswered("SERVICEMODE", seen, _ANSWER)

    def _ask(self, command: str, expected: str) -> str:
        """Send a line that may be sent twice; return group 1 of what matches `expected` ("" without one).

        It is sent again, twice at most, when the answer is none: a bit that flipped on the way there or back.
        """
        pattern = re.compile(expected.encode("ascii"))
        answered = re.compile(_PROMPT)
        seen, error = b"", None
        for _ in range(TRIES):
            self.link.discard()
            self.link.write(command.encode("ascii") + b"\r")
            seen = self._read_until(answered)
            error = _REFUSAL.search(seen)
            if error is None and (match := pattern.search(seen)):
                return match[1].decode("latin-1") if pattern.groups else ""
        if error is not None:
            remedy = "check that this version of the unit has the rate and the datagram"
            raise self._refused(command, error[0], expected, remedy)
        raise self._unanswered(command, seen, _ANSWER)


Stim300 = kind_as_described(Stim300Config, lambda config: config.described, Stim300Gyro)
