"""The SBG Ellipse as the bench finds it by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.instruments import GyroKind, Settings
from drivers.link import Tap
from drivers.sbg._decode import SbgDecoder
from drivers.sbg._driver import SbgGyro
from drivers.slcan import open_can


def _open(settings: Settings, clock: Clock, tap: Tap) -> SbgGyro:
    bus, link = open_can(
        settings["interface"], settings["channel"], settings["bitrate"], clock, settings["name"], tap=tap
    )
    return SbgGyro(bus, link, rate_hz=settings["rate_hz"], axes=settings["axes"])


def _decoder(settings: Settings) -> SbgDecoder:
    return SbgDecoder(settings["rate_hz"], settings["axes"])


def _rates(
    settings: Settings, columns: Mapping[str, NDArray[Any]], sample_rate_hz: float
) -> dict[str, NDArray[Any]]:
    """Return the rates as sent: the unit measures rate, so that the true sample rate does not enter."""
    return {axis: columns[f"rate_{axis}_dps"] for axis in settings["axes"]}


SbgEllipse = GyroKind(open=_open, decoder=_decoder, rates=_rates)
"""Settings used: `name`, `interface`, `channel`, `bitrate`, `rate_hz`, `axes`."""
