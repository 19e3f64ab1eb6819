"""Gyros that stream, and those that take text commands on the same line: what their drivers share."""

from __future__ import annotations

import re

from drivers.base.errors import BenchError, ConfigurationError, DeviceRefused, DeviceSilent, WrongDevice
from drivers.kit.link import Link

TRIES = 3
"""How often a command that may be sent twice is sent: a bit may flip on the way there or back."""


class StreamingGyro:
    """A unit that streams by itself (`drivers.kit.instruments.Gyro`) and takes no command."""

    def __init__(self, link: Link) -> None:
        self.link = link

    def start(self) -> None:
        """Take everything on the line for the stream."""
        self.link.streaming = True
        self.link.discard()

    def stop(self) -> None:
        """Nothing: the unit cannot be told to be quiet, and what it sends goes on to the link's tap."""

    def close(self) -> None:
        """Let go of the port."""
        self.link.close()


class ConversingGyro(StreamingGyro):
    """Reads replies out of a stream, and says in the same words what went wrong.

    `what`: the unit with its article, "a STIM300". `reply_s`: how long an answer may take. `seen`: bytes in which
    a reply is looked for; what came before cannot be part of it.
    """

    what = "a gyro"
    reply_s = 1.0
    seen = 4096

    def streams(self, data: bytes) -> bool:
        """Whether `data` has messages of such a unit in it."""
        raise NotImplementedError

    def _read_until(self, wanted: re.Pattern[bytes]) -> bytes:
        """Return what comes until `wanted` is in it, at most for the time of a reply."""
        deadline_s = self.link.clock.now() + self.reply_s
        data = b""
        while (left_s := deadline_s - self.link.clock.now()) > 0.0:
            data = (data + self.link.read_some(left_s))[-self.seen :]
            if wanted.search(data):
                break
        return data

    def _refused(self, command: str, reply: bytes, expected: str, remedy: str) -> DeviceRefused:
        return DeviceRefused(
            f"the gyro refused {command}",
            where=self.link.where,
            found=reply.decode("ascii"),
            expected=expected,
            remedy=remedy,
        )

    def _unanswered(self, command: str, data: bytes, expected: str) -> BenchError:
        """Return what it means that `data` came and not what was expected."""
        if not data:
            return DeviceSilent(
                f"no answer to {command} within {self.reply_s:g} s",
                where=self.link.where,
                found="nothing on the line",
                expected=self.what,
                remedy=f"check power, cable and both RS-422 pairs{self.link.set_alike}",
            )
        if self.streams(data):
            return DeviceSilent(
                f"the gyro streams but does not answer {command}",
                where=self.link.where,
                found=f"its messages, {len(data)} bytes in {self.reply_s:g} s",
                expected=expected,
                remedy="check the RS-422 pair from the bench to the gyro; driver = 'frames' only listens"
                + self.link.set_alike,
            )
        return WrongDevice(
            f"something answers {command}, but not as {self.what} does",
            where=self.link.where,
            found=repr(data[-60:]),
            expected=expected,
            remedy=f"check the port in the bench file{self.link.set_alike}",
        )

    def _unusable(self, found: str, expected: str) -> ConfigurationError:
        return ConfigurationError(
            f"{self.what} cannot be set so",
            where=self.link.where,
            found=found,
            expected=expected,
            remedy="correct the gyro's entry in the bench file",
        )
