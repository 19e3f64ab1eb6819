"""Processes that we start and the pipes to them, where only sockets can be waited for as well.

POSIX waits for the pipes themselves. Elsewhere a thread moves the bytes between a pipe and a pair of sockets: no
port stays open that another program could find. Untried on Windows itself; the tests run it elsewhere.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import IO, Any

from drivers.base.system import SELECTS_FILES
from drivers.base.windows import end_process, hold_process

_BLOCK = 65536
_END_S = 5.0


def of_its_own(descriptors: Sequence[int] = ()) -> dict[str, Any]:
    """Return options of `subprocess.Popen` for a process that Ctrl-C and a closed terminal do not reach.

    It inherits `descriptors`; on Windows none, and its words reach the terminal only if that lets it write there.
    """
    if hasattr(os, "setsid"):
        return {"start_new_session": True, "pass_fds": descriptors}
    flags = (getattr(subprocess, name, 0) for name in ("CREATE_NEW_PROCESS_GROUP", "CREATE_NO_WINDOW"))
    return {"creationflags": sum(flags)}


def end_of_its_own(pid: int) -> None:
    """End such a process and, on POSIX, all that it has started; ProcessLookupError if there is none.

    On Windows those that it has started end by themselves when it is no more.
    """
    if hasattr(os, "killpg"):
        os.killpg(pid, signal.SIGKILL)
    else:
        end_process(hold_process(pid), _END_S)


def pumped_in(file: IO[bytes]) -> socket.socket:
    """Return a socket that has what comes out of an unbuffered file, which is closed at its end."""

    def pump(far: socket.socket) -> None:
        while data := file.read(_BLOCK):
            far.sendall(data)

    return _pumped(file, pump)


def pumped_out(file: IO[bytes]) -> socket.socket:
    """Return a socket whose bytes go to an unbuffered file, which is closed after the last of them."""

    def pump(far: socket.socket) -> None:
        while data := far.recv(_BLOCK):
            view = memoryview(data)
            while view:
                view = view[file.write(view) :]

    return _pumped(file, pump)


def _pumped(file: IO[bytes], pump: Callable[[socket.socket], None]) -> socket.socket:
    near, far = socket.socketpair()

    def work() -> None:
        with suppress(OSError):  # one side is gone, which the other one meets as its end
            pump(far)
        far.close()
        with suppress(OSError):
            file.close()

    threading.Thread(target=work, name="moves bytes of a pipe", daemon=True).start()
    return near


class Pipes:
    """A process's standard input and output. What it says can be waited for; nothing written keeps us waiting.

    But `first`, which is written whole.
    """

    def __init__(self, process: subprocess.Popen[bytes], first: bytes) -> None:
        assert process.stdin is not None and process.stdout is not None
        self._ends: tuple[IO[bytes] | socket.socket, ...] = (process.stdin, process.stdout)
        self._read: Callable[[int], bytes]
        self._write: Callable[[bytes], int]
        if SELECTS_FILES:
            descriptor, self._source = process.stdin.fileno(), process.stdout.fileno()
            self._read, self._write = partial(os.read, self._source), partial(os.write, descriptor)
            self.write(first)
            os.set_blocking(descriptor, False)
            return
        sink, source = self._ends = pumped_out(process.stdin), pumped_in(process.stdout)
        self._read, self._write, self._source = source.recv, sink.send, source.fileno()
        with suppress(ConnectionError):
            sink.sendall(first)
        sink.setblocking(False)

    def fileno(self) -> int:
        """Return the descriptor to select on."""
        return self._source

    def read(self) -> bytes:
        """Return what it has said, at its end nothing."""
        return self._read(_BLOCK)

    def write(self, data: bytes) -> None:
        """Write what fits; to a process that reads no more, or has ended, nothing."""
        with suppress(ConnectionError, BlockingIOError):
            self._write(data)

    def close(self) -> None:
        """Say that there is no more. The process's output is closed with it, or when it ends."""
        for end in self._ends:
            end.close()
