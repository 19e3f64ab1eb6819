"""The STIM300 as the bench finds it by name: configured by us, read by the frame description `stim300`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal

from drivers.frames import FrameDecoder, FrameFamily, FramesConfig, family_of, kind_as_described, load_family
from drivers.kit.config import GyroConfig, Mistake
from drivers.kit.kinds import Connection
from drivers.stim300._driver import Stim300Gyro
from drivers.stim300.commands import DATAGRAMS, OUTPUTS, RATES

_MESSAGE = "rate_temp"


def family(settings: Mapping[str, str] | None = None) -> FrameFamily:
    """Return the unit's datagrams as `settings` of the description make them."""
    return load_family("stim300", settings)


class Stim300Config(GyroConfig):
    """`[[gyro]]` of a STIM300; `settings` are those of the frame description `stim300`."""

    reads: ClassVar[frozenset[str]] = frozenset({"settings"})

    @property
    def message(self) -> str:
        """The datagram that the unit is told to send."""
        return self.frame_format or _MESSAGE

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


def _open(config: Stim300Config, connection: Connection) -> Stim300Gyro:
    link = connection.link(config.port, config.baudrate)
    decoder = FrameDecoder(family(config.settings), rate_hz=config.rate_hz, axes=config.axes)
    return Stim300Gyro(
        link,
        decoder,
        rate_hz=config.rate_hz,
        message=config.message,
        length=family().form(config.message).shortest,
        baudrate=config.baudrate,
        outputs={name: words for name, words in config.settings.items() if name in OUTPUTS},
    )


Stim300 = kind_as_described(Stim300Config, lambda config: config.described, _open)
