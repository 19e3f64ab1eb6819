"""A platform INS that sends position and temperatures over a serial line: codec and driver."""

from drivers.kit.kinds import PlatformKind
from drivers.platform._driver import BAUDRATE, PinsConfig, PlatformIns
from drivers.platform.codec import FORCE, PlatformDecoder

PINS = PlatformKind(
    PlatformIns,
    decoder=lambda config: PlatformDecoder(config.period_s, accelerometers=config.accelerometers),
    columns=("latitude_deg", "longitude_deg", "temp_c", "cabinet_temp_c", *FORCE),
    config=PinsConfig,
)

__all__ = ["BAUDRATE", "PINS"]
