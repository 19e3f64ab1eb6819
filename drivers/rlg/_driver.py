"""Driver of the two-temperature ring laser: it sends by itself and can only be listened to."""

from __future__ import annotations

from drivers.errors import ConfigurationError, DeviceSilent, WrongDevice
from drivers.instruments import Identity
from drivers.link import Link
from drivers.rlg._codec import LENGTH, RlgDecoder

_LISTEN_S = 5.0
_BITS = 10  # A byte on a line set to 8N1.


class RlgGyro:
    """A ring laser on a serial port (`drivers.instruments.Gyro`), sending `rate_hz` frames a second."""

    def __init__(self, link: Link, *, rate_hz: float, baudrate: int) -> None:
        """Raise ConfigurationError for a frame rate that the line cannot carry."""
        self.link = link
        self._rate_hz = rate_hz
        if LENGTH * _BITS * rate_hz > baudrate:
            raise ConfigurationError(
                "the line cannot carry that many frames",
                where=f"{link.name} ({link.url})",
                found=f"{rate_hz:g} Hz at {baudrate} Bd",
                expected=f"at most {baudrate / (LENGTH * _BITS):.0f} Hz",
                remedy="correct rate_hz or baudrate in the bench file",
            )

    def identify(self) -> Identity:
        """Listen for two sound frames, at most 5 s and two frame times.

        Raises DeviceSilent when nothing came, WrongDevice when what came are not frames of ours.
        """
        decoder, heard = RlgDecoder(self._rate_hz), b""
        limit_s = _LISTEN_S + 2.0 / self._rate_hz
        deadline_s = self.link.clock.now() + limit_s
        while decoder.counts.frames < 2 and (left_s := deadline_s - self.link.clock.now()) > 0.0:
            data = self.link.read_some(left_s)
            heard = (heard + data)[:60]
            decoder.feed(data)
        if not heard:
            raise DeviceSilent(
                f"no byte within {limit_s:g} s",
                where=f"{self.link.name} ({self.link.url})",
                found="nothing",
                expected="frames of a ring-laser gyro, EB 90 ...",
                remedy="check power, cable and port",
            )
        if decoder.counts.frames < 2:
            raise WrongDevice(
                "what sends on this port is not the two-temperature ring laser",
                where=f"{self.link.name} ({self.link.url})",
                found=heard.hex(" "),
                expected=f"frames of {LENGTH} bytes that begin with eb 90 and carry their CRC",
                remedy="check the baud rate, and that the bench file names the right port and driver",
            )
        return Identity("gyrobench", "two-temperature ring laser", details={"frame bytes": str(LENGTH)})

    def start(self) -> None:
        """Take everything on the line for the stream; the unit streams by itself."""
        self.link.streaming = True
        self.link.discard()

    def stop(self) -> None:
        """Nothing: the unit cannot be told to be quiet, and what it sends goes on to the link's tap."""

    def close(self) -> None:
        """Let go of the port."""
        self.link.close()
