"""Driver of a gyro that streams what its description says: listened to, and checked to be what it should."""

from __future__ import annotations

from drivers.base.errors import ConfigurationError, DeviceSilent, WrongDevice
from drivers.frames._decode import FrameDecoder, reader_of
from drivers.frames._load import FrameFamily
from drivers.kit.instruments import Identity
from drivers.kit.link import Link

_LISTEN_S = 5.0
_ENOUGH = 2
_KEPT = 8192
"""Bytes kept to say what was heard instead."""


def bits_a_byte(family: FrameFamily) -> int:
    """Return the bits on the line for each byte: start, data, parity, stop."""
    link = family.description.link
    return 1 + link.bytesize + (link.parity != "N") + link.stopbits


class FrameGyro:
    """A gyro on a serial port (`drivers.kit.instruments.Gyro`) that sends `rate_hz` frames a second, unasked."""

    def __init__(self, link: Link, family: FrameFamily, decoder: FrameDecoder, *, baudrate: int) -> None:
        """Raise ConfigurationError for a frame rate that the line cannot carry."""
        self.link = link
        self._family = family
        self._decoder = decoder
        length = min(form.shortest for form in family.forms if form.measures)
        most_hz = baudrate / (length * bits_a_byte(family))
        if decoder.nominal_rate_hz > most_hz:
            raise ConfigurationError(
                "the line cannot carry that many frames",
                where=link.where,
                found=f"{decoder.nominal_rate_hz:g} Hz of {length} bytes at {baudrate} Bd",
                expected=f"at most {most_hz:.0f} Hz",
                remedy="correct rate_hz or baudrate in the bench file",
            )

    def identify(self) -> Identity:
        """Listen for two sound frames with rates, at most 5 s and two frame times.

        Raises DeviceSilent when nothing came, WrongDevice when what came are not such frames.
        """
        description, decoder, heard, frames = self._family.description, self._decoder, b"", 0
        limit_s = _LISTEN_S + _ENOUGH / decoder.nominal_rate_hz
        deadline_s = self.link.clock.now() + limit_s
        while frames < _ENOUGH and (left_s := deadline_s - self.link.clock.now()) > 0.0:
            data = self.link.read_some(left_s)
            heard = (heard + data)[:_KEPT]
            frames += len(decoder.feed(data))
        where = self.link.where
        if not heard:
            raise DeviceSilent(
                f"no byte within {limit_s:g} s",
                where=where,
                found="nothing",
                expected=f"frames of {description.title}",
                remedy="check power, cable and port",
            )
        if frames < _ENOUGH:
            everything = reader_of(self._family)
            everything.feed(heard)
            others = ", ".join(name for name, n in everything.by_form.items() if n)
            raise WrongDevice(
                f"what sends on this port is not {description.title}"
                + (f" with the message {decoder.expected}" if others else ""),
                where=where,
                found=f"messages {others}" if others else heard[:60].hex(" "),
                expected=_beginnings(self._family),
                remedy="check the baud rate, and port, description and frame_format in the bench file",
            )
        messages = ", ".join(name for name, n in decoder.by_message.items() if n)
        return Identity(
            description.maker, description.model or description.title, details={"messages": messages}
        )

    def start(self) -> None:
        """Take everything on the line for the stream; the unit streams by itself."""
        self.link.streaming = True
        self.link.discard()

    def stop(self) -> None:
        """Nothing: the unit cannot be told to be quiet, and what it sends goes on to the link's tap."""

    def close(self) -> None:
        """Let go of the port."""
        self.link.close()


def _beginnings(family: FrameFamily) -> str:
    forms = [form for form in family.forms if form.measures]
    heads = ", ".join(sorted({sync.hex(" ") for form in forms for sync in form.syncs})[:6])
    return f"frames that begin with {heads} and carry a right check"
