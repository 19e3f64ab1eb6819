"""Where a bench reaches the clock of a lab that has a process of its own, on this machine only."""

from __future__ import annotations

import hmac
import secrets
import shutil
import socket
import tempfile
from contextlib import suppress
from pathlib import Path

from drivers.base.errors import ConfigurationError

_SAID_S = 2.0
"""How long whoever connects may take to say the lab's word."""


class Door:
    """A Unix socket in a folder of this user's: half the cost of a turn over TCP, and closed to other users.

    Where there are none (Windows) it is TCP on loopback, for those who say the word in the URL: no other program
    drives a lab by accident.
    """

    def __init__(self) -> None:
        self._folder: Path | None = None
        self._word = b""
        if hasattr(socket, "AF_UNIX"):
            self._folder = Path(tempfile.mkdtemp(prefix="gyrobench-"))
            self._listener = _listener_at(self._folder / "clock")
            self.url = f"virtual://{self._folder}/clock"
        else:
            word = secrets.token_hex(16)
            self._word = word.encode() + b"\n"
            self._listener = socket.create_server(("127.0.0.1", 0))
            self.url = f"virtual://127.0.0.1:{self._listener.getsockname()[1]}/{word}"

    def fileno(self) -> int:
        """Return the descriptor to select on."""
        return self._listener.fileno()

    def accept(self) -> socket.socket | None:
        """Return the connection of a bench, None for somebody who does not know the word."""
        connection, _ = self._listener.accept()
        if self._word:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.settimeout(_SAID_S)
            if not hmac.compare_digest(_said(connection, len(self._word)), self._word):
                connection.close()
                return None
            connection.settimeout(None)
        return connection

    def close(self) -> None:
        """Let nobody in any more."""
        self._listener.close()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)


def _said(connection: socket.socket, count: int) -> bytes:
    said = b""
    with suppress(OSError):
        while len(said) < count and (data := connection.recv(count - len(said))):
            said += data
    return said


def _listener_at(path: Path) -> socket.socket:
    listener = socket.socket(socket.AF_UNIX)
    try:
        listener.bind(str(path))
    except OSError as error:
        listener.close()
        raise ConfigurationError(
            "the lab's clock has no place to be reached at",
            where=str(path),
            found=str(error),
            expected="a folder for temporary files with a name of less than 80 characters",
            remedy="set TMPDIR to another one",
        ) from error
    listener.listen()
    return listener
