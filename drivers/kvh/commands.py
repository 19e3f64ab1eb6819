"""The settings of a KVH gyro and the words for them (KVH 56-0298 Rev B, sections 7 and 8)."""

from __future__ import annotations

from drivers.kvh.format import RATES_HZ

SETTINGS: dict[str, tuple[str, ...]] = {
    "DR": tuple(str(rate) for rate in RATES_HZ),
    "BAUD": ("9600", "19200", "38400", "57600", "115200", "460800", "576000", "921600", "4147200"),
    "OUTPUTFMT": ("A", "B", "C"),
    "ROTFMT": ("DELTA", "RATE", "RESET"),
    "ROTUNITS": ("DEG", "RAD"),
    "TEMPUNITS": ("C", "C_100", "F", "F_100"),
    "MSYNC": ("EXT", "IMU"),
    "ECHO": ("0", "1"),
}
"""Setting -> the values that `=SETTING,value` takes. The reply is the command without its `=`."""

FACTORY: dict[str, str] = {
    "DR": "1000",
    "BAUD": "921600",
    "OUTPUTFMT": "A",
    "ROTFMT": "DELTA",
    "ROTUNITS": "RAD",
    "TEMPUNITS": "C",
    "MSYNC": "IMU",
    "ECHO": "0",
}
"""Settings as delivered; `=RSTCFG` restores all of them but the baud rate."""
