"""The KVH gyro as the bench finds it by name."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from drivers.kit.config import GyroConfig, key
from drivers.kit.kinds import Columns, Connection, GyroKind, Probe
from drivers.kvh._decode import KvhDecoder
from drivers.kvh._driver import KvhGyro
from drivers.kvh.format import Format, rate_dps

_SENT_AS: dict[str, Any] = {"rotation": "delta", "temp_units": "C_100"}
"""A delta angle leaves nothing of the rotation out between samples; hundredths are the best resolution."""


class KvhConfig(GyroConfig):
    """`[[gyro]]` of a KVH gyro."""

    frame_format: Format | None = key(default=None, description="'A', 'B' or 'C'; left out: 'A'")

    @property
    def sends(self) -> Format:
        """The format that the unit is told to send."""
        return self.frame_format or "A"


def _open(config: KvhConfig, connection: Connection) -> KvhGyro:
    link = connection.link(config.port, config.baudrate)
    return KvhGyro(link, rate_hz=config.rate_hz, frame_format=config.sends, axes=config.axes, **_SENT_AS)


def _decoder(config: KvhConfig) -> KvhDecoder:
    return KvhDecoder(
        nominal_rate_hz=config.rate_hz,
        frame_format=config.sends,
        axes=config.axes,
        rotation_units="RAD",
        **_SENT_AS,
    )


def _rates(config: KvhConfig, columns: Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    return {
        axis: rate_dps(columns[f"rot_{axis}"], _SENT_AS["rotation"], "RAD", sample_rate_hz)
        for axis in config.axes
    }


def _probes() -> list[Probe]:
    return [
        Probe(10, keys={"frame_format": form, "axis": "x", "axes": "xyz"}, name=form)
        for form in ("A", "B", "C")
    ]


Kvh1750 = GyroKind(_open, _decoder, _rates, KvhConfig, probes=_probes)
