"""The two-temperature ring laser as the bench finds it by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.instruments import GyroKind, Settings
from drivers.link import Link, Tap
from drivers.rlg._codec import RlgDecoder
from drivers.rlg._driver import RlgGyro


def _open(settings: Settings, clock: Clock, tap: Tap) -> RlgGyro:
    link = Link(settings["port"], clock, name=settings["name"], tap=tap, baudrate=settings["baudrate"])
    return RlgGyro(link, rate_hz=settings["rate_hz"], baudrate=settings["baudrate"])


def _decoder(settings: Settings) -> RlgDecoder:
    return RlgDecoder(settings["rate_hz"])


def _rates(
    settings: Settings, columns: Mapping[str, NDArray[Any]], sample_rate_hz: float
) -> dict[str, NDArray[Any]]:
    return {settings["axis"]: columns["increment_arcsec"] * (sample_rate_hz / 3600.0)}


def _temperatures(
    settings: Settings, columns: Mapping[str, NDArray[Any]], sample_rate_hz: float
) -> dict[str, NDArray[Any]]:
    return {"case_temp_c": columns["case_temp_c"]}


Rlg2t = GyroKind(open=_open, decoder=_decoder, rates=_rates, temperatures=_temperatures)
"""Settings used: `name`, `port`, `baudrate`, `rate_hz`, `axis`."""
