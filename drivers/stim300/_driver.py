"""The driver: out of its stream into Service Mode, set rate and datagram, and back."""

from __future__ import annotations

import re

from drivers.errors import BenchError, ConfigurationError, DeviceRefused, DeviceSilent, WrongDevice
from drivers.frames import FrameDecoder
from drivers.instruments import Identity
from drivers.link import Link
from drivers.stim300._commands import (
    BANNER,
    DATAGRAMS,
    ENTER,
    LEAVE,
    LEFT,
    RATES,
    SETTINGS,
    bits_per_s,
)

_REPLY_S = 2.0
_TRIES = 3
_SEEN = 16384  # Bytes in which to look for a reply; the longest listing has 3 kB.
_PROMPT = rb"\r\n?>"
_REFUSAL = re.compile(rb"(?<=[\r\n])E00\d [ -~]*")
_ENTERED = re.compile(rb"(?:" + BANNER.encode() + rb"|E00\d ).*?" + _PROMPT, re.DOTALL)


class Stim300Gyro:
    """A STIM300 on an RS-422 port, 8N1 (`drivers.instruments.Gyro`).

    `rate_hz` is one of the unit's sample rates, `message` one of `DATAGRAMS`, of `length` bytes. The unit is set
    to angular rate without delay and to datagrams without CR LF. Nothing is saved: after a power-on it is as it
    was. `identify` and `stop` leave it in Service Mode, where it is quiet.
    """

    def __init__(
        self, link: Link, decoder: FrameDecoder, *, rate_hz: float, message: str, length: int, baudrate: int
    ) -> None:
        """Raise ConfigurationError for what no such unit can be set to."""
        self.link = link
        self._decoder = decoder
        if rate_hz not in RATES:
            raise self._unusable(f"rate_hz = {rate_hz:g}", "one of " + ", ".join(map(str, RATES)))
        if message not in DATAGRAMS:
            raise self._unusable(f"frame_format = {message!r}", "one of " + ", ".join(DATAGRAMS))
        if bits_per_s(length, rate_hz) > baudrate:
            raise self._unusable(
                f"{rate_hz:g} Hz of {length} bytes at {baudrate} Bd",
                f"{bits_per_s(length, rate_hz):.0f} Bd or more (TS1524, equation 12)",
            )
        self._demands = {
            f"m {RATES[int(rate_hz)]}": rf"SAMPLE RATE \[samples/s\] = {rate_hz:.0f}\s",
            f"d {DATAGRAMS[message]},0": r"DATAGRAM = RATE[^\r\n]*\s+DATAGRAM TERMINATION = NONE\s",
            "u g,0": r"GYRO OUTPUT UNIT = [^\r\n]*ANGULAR RATE\s",
        }

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
                where=self._where(),
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
        seen = self._read(left)
        if not left.search(seen):
            raise self._unanswered("x N", seen)
        self.link.streaming = True
        self.link.discard()

    def stop(self) -> None:
        """Stop the stream by entering Service Mode."""
        self._service_mode()

    def close(self) -> None:
        """Close the port."""
        self.link.close()

    def decoder(self) -> FrameDecoder:
        """Return the decoder of what `start` makes the unit send."""
        return self._decoder

    def _service_mode(self) -> None:
        """Enter Service Mode from whatever state; in it already, the unit does not know the word."""
        self.link.streaming = False
        seen = b""
        for _ in range(_TRIES):
            self.link.discard()
            self.link.write(ENTER)
            seen = self._read(_ENTERED)
            if _ENTERED.search(seen):
                return
        raise self._unanswered("SERVICEMODE", seen)

    def _ask(self, command: str, expected: str) -> str:
        """Send a line that may be sent twice; return group 1 of what matches `expected` ("" without one).

        It is sent again, twice at most, when the answer is none: a bit that flipped on the way there or back.
        """
        pattern = re.compile(expected.encode("ascii"))
        answered = re.compile(_PROMPT)
        seen, error = b"", None
        for _ in range(_TRIES):
            self.link.discard()
            self.link.write(command.encode("ascii") + b"\r")
            seen = self._read(answered)
            error = _REFUSAL.search(seen)
            if error is None and (match := pattern.search(seen)):
                return match[1].decode("latin-1") if pattern.groups else ""
        if error is not None:
            raise DeviceRefused(
                f"the gyro refused {command}",
                where=self._where(),
                found=error[0].decode("ascii"),
                expected=expected,
                remedy="check that this version of the unit has the rate and the datagram",
            )
        raise self._unanswered(command, seen)

    def _read(self, wanted: re.Pattern[bytes]) -> bytes:
        """Return what comes until `wanted` is in it, at most for the time of a reply."""
        deadline_s = self.link.clock.now() + _REPLY_S
        seen = b""
        while (left_s := deadline_s - self.link.clock.now()) > 0.0:
            seen = (seen + self.link.read_some(left_s))[-_SEEN:]
            if wanted.search(seen):
                break
        return seen

    def _where(self) -> str:
        return f"{self.link.name} ({self.link.url})"

    def _unanswered(self, command: str, seen: bytes) -> BenchError:
        if not seen:
            return DeviceSilent(
                f"no answer to {command} within {_REPLY_S:g} s",
                where=self._where(),
                found="nothing on the line",
                expected="a STIM300",
                remedy="check power, cable and both RS-422 pairs",
            )
        if len(self._decoder.feed(seen)):
            return DeviceSilent(
                f"the gyro streams but does not answer {command}",
                where=self._where(),
                found=f"datagrams, {len(seen)} bytes in {_REPLY_S:g} s",
                expected="the listing that ends in a prompt",
                remedy="check the RS-422 pair from the bench to the gyro; driver = 'frames' only listens",
            )
        return WrongDevice(
            f"something answers {command}, but not as a STIM300 does",
            where=self._where(),
            found=repr(seen[-60:]),
            expected="its answer and a prompt",
            remedy="check port and baud rate in the bench file",
        )

    def _unusable(self, found: str, expected: str) -> ConfigurationError:
        return ConfigurationError(
            "a STIM300 cannot be set so",
            where=self._where(),
            found=found,
            expected=expected,
            remedy="correct the gyro's entry in the bench file",
        )
