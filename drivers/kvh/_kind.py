"""The KVH gyro as the bench finds it by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from drivers.base.clock import Clock
from drivers.kit.instruments import GyroKind, Settings
from drivers.kit.link import Link, Tap
from drivers.kvh._decode import KvhDecoder
from drivers.kvh._driver import KvhGyro
from drivers.kvh._format import rate_dps

_SENT_AS: dict[str, Any] = {"rotation": "delta", "temp_units": "C_100"}
"""A delta angle leaves nothing of the rotation out between samples; hundredths are the best resolution."""


def _open(settings: Settings, clock: Clock, tap: Tap) -> KvhGyro:
    link = Link(settings["port"], clock, name=settings["name"], tap=tap, baudrate=settings["baudrate"])
    return KvhGyro(
        link,
        rate_hz=settings["rate_hz"],
        frame_format=settings.get("frame_format") or "A",
        axes=settings["axes"],
        **_SENT_AS,
    )


def _decoder(settings: Settings) -> KvhDecoder:
    return KvhDecoder(
        nominal_rate_hz=settings["rate_hz"],
        frame_format=settings.get("frame_format") or "A",
        axes=settings["axes"],
        rotation_units="RAD",
        **_SENT_AS,
    )


def _rates(
    settings: Settings, columns: Mapping[str, NDArray[Any]], sample_rate_hz: float
) -> dict[str, NDArray[Any]]:
    return {
        axis: rate_dps(columns[f"rot_{axis}"], _SENT_AS["rotation"], "RAD", sample_rate_hz)
        for axis in settings["axes"]
    }


Kvh1750 = GyroKind(open=_open, decoder=_decoder, rates=_rates)
"""Settings used: `name`, `port`, `baudrate`, `frame_format`, `rate_hz`, `axes`."""
