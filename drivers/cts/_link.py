"""How commands and answers go over the line: in frames, or bare, where the first letter tells the length."""

from __future__ import annotations

from drivers.base.errors import ProtocolError
from drivers.cts.codec import ETX, REPLY_BYTES, decode_frame, encode_frame
from drivers.kit.link import Link

REPLY_TIMEOUT_S = 2.0
_END = bytes([ETX])


class CtsLine:
    """One chamber's line. `address`: 1 to 32, in frames only."""

    def __init__(self, link: Link, *, framed: bool, address: int) -> None:
        self._link = link
        self._framed, self._address = framed, address

    def write(self, text: str) -> None:
        """Send a command or query and wait for nothing."""
        self._link.write(encode_frame(self._address, text) if self._framed else text.encode("ascii"))

    def read(self, timeout_s: float = REPLY_TIMEOUT_S) -> str:
        """Return the data of the next answer; ProtocolError for a damaged one or another address'."""
        if self._framed:
            address, text = decode_frame(self._link.read_until(_END, timeout_s))
            if address != self._address:
                raise ProtocolError(
                    "an answer of another address", found=str(address), expected=str(self._address)
                )
            return text
        first = self._link.read_exactly(1, timeout_s).decode("latin-1")
        if first not in REPLY_BYTES:
            raise ProtocolError(
                "not the beginning of an answer",
                found=repr(first),
                expected="one of " + " ".join(REPLY_BYTES),
            )
        return first + self._link.read_exactly(REPLY_BYTES[first] - 1, timeout_s).decode("latin-1")
