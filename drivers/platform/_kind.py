"""The platform INS as the bench finds it by name."""

from __future__ import annotations

from drivers.kit.config import PlatformConfig
from drivers.kit.kinds import Connection, PlatformKind
from drivers.platform._driver import PlatformIns
from drivers.platform.codec import PlatformDecoder


def _open(config: PlatformConfig, connection: Connection) -> PlatformIns:
    return PlatformIns(connection.link(config.port, config.baudrate), period_s=config.period_s)


PINS = PlatformKind(
    _open,
    decoder=lambda config: PlatformDecoder(config.period_s),
    columns=("latitude_deg", "longitude_deg", "temp_c", "cabinet_temp_c"),
    config=PlatformConfig,
)
