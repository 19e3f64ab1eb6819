"""The platform INS as the bench finds it by name."""

from __future__ import annotations

from drivers.base.clock import Clock
from drivers.kit.instruments import PlatformKind, Settings
from drivers.kit.link import Link, Tap
from drivers.platform._codec import PlatformDecoder
from drivers.platform._driver import PlatformIns


def _open(settings: Settings, clock: Clock, tap: Tap) -> PlatformIns:
    link = Link(settings["port"], clock, name=settings["name"], tap=tap, baudrate=settings["baudrate"])
    return PlatformIns(link, period_s=settings["period_s"])


def _decoder(settings: Settings) -> PlatformDecoder:
    return PlatformDecoder(settings["period_s"])


PINS = PlatformKind(
    open=_open,
    decoder=_decoder,
    columns=("latitude_deg", "longitude_deg", "temp_c", "cabinet_temp_c"),
)
"""Settings used: `name`, `port`, `baudrate`, `period_s`."""
