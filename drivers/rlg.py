"""Ring-laser gyro with two temperature sensors on a serial port: our own reference frame.

No maker's protocol: the smallest frame that carries what a temperature test of a ring laser needs. Its bytes are
the frame description `rlg2t`; here are the driver's name in a bench file and the bench's name of its one axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from drivers.frames import Frames
from drivers.kit.instruments import GyroKind, Settings

_Columns = Mapping[str, NDArray[Any]]


def described(settings: Settings) -> dict[str, Any]:
    """Return the settings of a described gyro that sends the same."""
    return {**settings, "description": "rlg2t", "frame_format": None, "axes": "x", "axis": "x"}


def _rates(settings: Settings, columns: _Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    return {settings["axis"]: Frames.rates(described(settings), columns, sample_rate_hz)["x"]}


def _temperatures(settings: Settings, columns: _Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    assert Frames.temperatures is not None
    return Frames.temperatures(described(settings), columns, sample_rate_hz)


Rlg2t = GyroKind(
    open=lambda settings, clock, tap: Frames.open(described(settings), clock, tap),
    decoder=lambda settings: Frames.decoder(described(settings)),
    rates=_rates,
    temperatures=_temperatures,
)
"""Settings used: `name`, `port`, `baudrate`, `rate_hz`, `axis`."""
