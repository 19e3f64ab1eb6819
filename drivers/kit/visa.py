"""Instruments at a VISA resource (USBTMC, GPIB, VXI-11, HiSLIP): messages there, a byte stream here.

PyVISA speaks to them by the VISA library that is installed, or by PyVISA-py; its variable PYVISA_LIBRARY chooses.
A message-based device sends only what it was asked for, so a thread writes each line and reads one message behind
a line with a question mark (IEEE Std 488.2: a query ends in `?`; what one program message asks is answered in one
response message).
"""

from __future__ import annotations

import contextlib
import socket
import threading
from typing import Any

from drivers.kit.sockets import NearEnd

_BLOCK = 65536
_END = b"\n"
_ANSWER_MS, _OPEN_MS = 3000, 5000


class VisaPort(NearEnd):
    """A message-based instrument as a descriptor to read and write lines on.

    A query that is not answered within 3 s gives nothing, and the device is cleared; what else fails closes the
    descriptor. Raises OSError when the resource cannot be opened.
    """

    def __init__(self, place: str) -> None:
        try:
            import pyvisa
        except ImportError as error:
            raise OSError(f"{error}: pip install 'gyrobench[visa]'") from error
        self._error: type[Exception] = pyvisa.errors.Error
        self._silent = pyvisa.constants.StatusCode.error_timeout
        try:
            manager = pyvisa.ResourceManager()
            resource: Any = manager.open_resource(place, open_timeout=_OPEN_MS)
            resource.timeout = _ANSWER_MS
            if not resource.session:  # VI_NULL: a library may return that and raise nothing
                raise OSError("there is no such resource")
        except (self._error, OSError, ValueError) as error:
            raise OSError(f"VISA: {error}") from error
        self._resource = resource
        if place.upper().endswith("::SOCKET"):  # there only a character ends a message
            resource.read_termination = _END.decode()
        self._near, self._far = socket.socketpair()
        self._near.setblocking(False)
        threading.Thread(target=self._exchange, name=f"speaks to {place}", daemon=True).start()

    def _exchange(self) -> None:
        """Write lines and read what they ask for until either side is closed."""
        unread = b""
        with contextlib.suppress(OSError, self._error), contextlib.closing(self._far):
            while block := self._far.recv(_BLOCK):
                *lines, unread = (unread + block).split(_END)
                for line in filter(bytes.strip, lines):
                    self._resource.write_raw(line + _END)
                    if b"?" in line:
                        self._far.sendall(self._answer())
        with contextlib.suppress(OSError, self._error):
            self._resource.close()

    def _answer(self) -> bytes:
        try:
            answer: bytes = self._resource.read_raw()
        except self._error as error:
            if getattr(error, "error_code", None) != self._silent:
                raise
            with contextlib.suppress(self._error, NotImplementedError):
                self._resource.clear()
            return b""
        return answer if answer.endswith(_END) else answer + _END
