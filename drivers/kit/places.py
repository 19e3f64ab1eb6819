"""Where a device may be: a serial line, a socket, a VISA resource."""

from __future__ import annotations

import re
from urllib.parse import urlsplit

from drivers.base.errors import ConfigurationError

VISA_RESOURCE = r"(?i:USB|GPIB|TCPIP|VXI|PXI)\d*::.+"
"""What VISA resources look like; serial ones (ASRL) are no such: the bench opens those itself."""
VISA_EXAMPLE = "USB0::0x2A8D::0x1002::MY12345::INSTR"
"""A VISA resource, to show what one looks like."""


def is_visa(place: str) -> bool:
    """Return whether `place` is a VISA resource."""
    return re.fullmatch(VISA_RESOURCE, place) is not None


def check_place(url: str, name: str, *, visa: bool = True) -> None:
    """Refuse what no port is: pyserial has addresses that write files (`spy://...?file=`). ConfigurationError.

    `visa`: whether the device answers lines with a question mark and nothing else, so that VISA serves for it.
    """
    scheme, separator, _ = url.partition("://")
    if (separator and scheme.lower() != "socket") or (is_visa(url) and not visa):
        at_visa = "; VISA serves supplies and loggers only"
        if visa:
            at_visa = f", or a VISA resource such as '{VISA_EXAMPLE}'"
        raise ConfigurationError(
            "the port cannot be used",
            where=name,
            found=url,
            expected=f"a serial device such as '/dev/ttyUSB0', or 'socket://host:port'{at_visa}",
        )


def is_serial(url: str) -> bool:
    """Return whether a port is a serial line, with a baud rate and a format to set."""
    return "://" not in url and not is_visa(url)


def socket_address(place: str) -> tuple[str, int]:
    """Return host and port of `socket://host:port`, an IPv6 host in brackets; ValueError for anything else."""
    parts = urlsplit(place)
    if not parts.hostname or not parts.port or parts.path.strip("/") or parts.query:
        raise ValueError("not a host and a port, and nothing else")
    return parts.hostname, parts.port
