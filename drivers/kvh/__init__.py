"""KVH DSP-1750, DSP-1760 and 1775 fibre-optic gyros on RS-422: codec and driver."""

from drivers.kvh._commands import FACTORY, SETTINGS
from drivers.kvh._decode import KvhDecoder
from drivers.kvh._driver import KvhGyro
from drivers.kvh._encode import encode_bit, encode_frames
from drivers.kvh._format import (
    ALL_VALID,
    AXES,
    COUNTER_MODULO,
    CRC,
    RATES_HZ,
    Format,
    FrameLayout,
    Rotation,
    RotationUnits,
    TempUnits,
    layout,
    rate_dps,
    temperature_field,
    valid_mask,
)
from drivers.kvh._kind import Kvh1750, KvhConfig

__all__ = [
    "ALL_VALID",
    "AXES",
    "COUNTER_MODULO",
    "CRC",
    "FACTORY",
    "RATES_HZ",
    "SETTINGS",
    "Format",
    "FrameLayout",
    "Kvh1750",
    "KvhConfig",
    "KvhDecoder",
    "KvhGyro",
    "Rotation",
    "RotationUnits",
    "TempUnits",
    "encode_bit",
    "encode_frames",
    "layout",
    "rate_dps",
    "temperature_field",
    "valid_mask",
]
