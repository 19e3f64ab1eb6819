"""The commands of an slcan adapter that are not frames (LAWICEL CAN232/CANUSB manual)."""

from __future__ import annotations

from drivers.errors import ConfigurationError

OPEN = b"O\r"
CLOSE = b"C\r"
BITRATE_COMMANDS = {
    10_000: b"S0\r",
    20_000: b"S1\r",
    50_000: b"S2\r",
    100_000: b"S3\r",
    125_000: b"S4\r",
    250_000: b"S5\r",
    500_000: b"S6\r",
    800_000: b"S7\r",
    1_000_000: b"S8\r",
}
"""Bit rate in bit/s -> command. S7 is 800 kbit/s in the manual and in Linux (python-can 4.6 calls it 750)."""


def bitrate_command(bitrate: int, where: str) -> bytes:
    """Return the command for `bitrate` in bit/s; ConfigurationError for one that slcan does not define."""
    command = BITRATE_COMMANDS.get(bitrate)
    if command is None:
        raise ConfigurationError(
            "this bit rate cannot be set on an slcan adapter",
            where=where,
            found=f"{bitrate} bit/s",
            expected=", ".join(str(rate) for rate in BITRATE_COMMANDS) + " bit/s",
            remedy="set `bitrate` to that of the bus",
        )
    return command
