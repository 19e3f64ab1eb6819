"""The STIM300 as the bench finds it by name: configured by us, read by the frame description `stim300`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from drivers.base.clock import Clock
from drivers.frames import FrameDecoder, FrameFamily, Frames, load_family
from drivers.kit.instruments import GyroKind, Settings
from drivers.kit.link import Link, Tap
from drivers.stim300._commands import DATAGRAMS, OUTPUTS
from drivers.stim300._driver import Stim300Gyro

_MESSAGE = "rate_temp"
_Columns = Mapping[str, NDArray[Any]]


def family(settings: Mapping[str, str] | None = None) -> FrameFamily:
    """Return the unit's datagrams as `settings` of the description make them."""
    return load_family("stim300", settings)


def described(settings: Settings) -> dict[str, Any]:
    """Return the settings of a described gyro that sends the same."""
    return {**settings, "description": "stim300", "frame_format": settings.get("frame_format") or _MESSAGE}


def _open(settings: Settings, clock: Clock, tap: Tap) -> Stim300Gyro:
    message = described(settings)["frame_format"]
    link = Link(settings["port"], clock, name=settings["name"], tap=tap, baudrate=settings["baudrate"])
    chosen = settings.get("settings") or {}
    decoder = FrameDecoder(family(chosen), rate_hz=settings["rate_hz"], axes=settings["axes"])
    length = family().form(message).shortest if message in DATAGRAMS else 0
    return Stim300Gyro(
        link,
        decoder,
        rate_hz=settings["rate_hz"],
        message=message,
        length=length,
        baudrate=settings["baudrate"],
        outputs={name: words for name, words in chosen.items() if name in OUTPUTS},
    )


def _rates(settings: Settings, columns: _Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    return Frames.rates(described(settings), columns, sample_rate_hz)


def _accelerations(settings: Settings, columns: _Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    assert Frames.accelerations is not None
    return Frames.accelerations(described(settings), columns, sample_rate_hz)


def _temperatures(settings: Settings, columns: _Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    assert Frames.temperatures is not None
    return Frames.temperatures(described(settings), columns, sample_rate_hz)


Stim300 = GyroKind(
    open=_open,
    decoder=lambda settings: Frames.decoder(described(settings)),
    rates=_rates,
    accelerations=_accelerations,
    temperatures=_temperatures,
)
"""Settings used: `name`, `port`, `baudrate`, `rate_hz`, `axes`, `axis`, `settings`, `frame_format`."""
