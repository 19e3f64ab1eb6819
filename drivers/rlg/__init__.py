"""Ring-laser gyro with two temperature sensors on a serial port: our own reference frame, codec and driver.

No maker's protocol: this is the smallest frame that carries what a temperature test of a ring laser needs.
Big-endian, 15 bytes, sent `rate_hz` times a second, unasked:

    0   EB 90   sync
    2   i32     angle turned since the last frame, 0.001 arcsec; saturates
    6   i16     T1, case, 0.01 degC
    8   i16     T2, cavity block, 0.01 degC
    10  u16     frame counter
    12  u8      status: bit 0 discharge on and mode locked, bit 1 dither running; both set when valid
    13  u16     CRC-16 of bytes 2 to 12, polynomial 1021, initial value FFFF (CRC-16/IBM-3740)
"""

from drivers.rlg._codec import (
    COUNTER_MODULO,
    GOOD,
    LENGTH,
    LSB_ARCSEC,
    SYNC,
    TEMP_LSB_C,
    RlgDecoder,
    encode_frames,
)
from drivers.rlg._driver import RlgGyro
from drivers.rlg._kind import Rlg2t

__all__ = [
    "COUNTER_MODULO",
    "GOOD",
    "LENGTH",
    "LSB_ARCSEC",
    "SYNC",
    "TEMP_LSB_C",
    "Rlg2t",
    "RlgDecoder",
    "RlgGyro",
    "encode_frames",
]
