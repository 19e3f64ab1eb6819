"""A platform INS that sends position and temperatures over a serial line: codec and driver."""

from drivers.kit.config import PlatformConfig
from drivers.kit.kinds import PlatformKind
from drivers.platform._driver import BAUDRATE, PlatformIns
from drivers.platform.codec import PlatformDecoder

PINS = PlatformKind(
    PlatformIns,
    decoder=lambda config: PlatformDecoder(config.period_s),
    columns=("latitude_deg", "longitude_deg", "temp_c", "cabinet_temp_c"),
    config=PlatformConfig,
)

__all__ = ["BAUDRATE", "PINS"]
