"""Where emulated labs' processes come from: one of its own each, or a fork of one that has loaded everything."""

from __future__ import annotations

import os
import select
import signal
import socket
import struct
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from typing import IO, Self

from drivers.base.errors import BenchError
from simulators.config import LabConfig

_PID = struct.Struct("!i")


@dataclass
class LabProcess:
    """A lab's process as whoever started it sees it: it has ended when its standard output has.

    `popen` is how a process of its own was started, None for a child of the prefork server.
    """

    pid: int
    stdin: IO[bytes]
    stdout: IO[bytes]
    popen: subprocess.Popen[bytes] | None = None

    def wait(self, timeout: float | None = None) -> None:
        """Wait until it has ended; subprocess.TimeoutExpired if it has not within `timeout` s."""
        if self.popen is not None:
            self.popen.wait(timeout)
            return
        while select.select([self.stdout], [], [], timeout)[0]:
            if not os.read(self.stdout.fileno(), 65536):
                return
        raise subprocess.TimeoutExpired("simulators.lab", timeout or 0.0)

    def kill(self) -> None:
        """End it at once."""
        with suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)


def start_lab() -> LabProcess:
    """Start a lab's process."""
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "simulators.lab"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,  # Ctrl-C is for the bench: the lab lives until the bench lets go of it
    )
    assert process.stdin is not None and process.stdout is not None
    return LabProcess(process.pid, process.stdin, process.stdout, process)


class PreforkServer:
    """A process that has loaded the lab once and forks labs from then on; a context manager.

    For whoever needs many labs after one another: a fork is ready in some hundredths of a second, a new process
    in about one. `like` is the configuration (`bench.lab.emulated.lab_config`) of the labs to come: what such a
    lab loads is loaded before the first fork, not in every one.
    """

    def __init__(self, like: LabConfig | None = None) -> None:
        self._socket, far = socket.socketpair()
        with far:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", "simulators.lab", "--prefork", str(far.fileno())],
                stdin=subprocess.PIPE,
                pass_fds=[far.fileno()],
                start_new_session=True,
            )
        assert self._process.stdin is not None
        with suppress(BrokenPipeError), self._process.stdin as stdin:
            stdin.write(b"" if like is None else like.to_line() + b"\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()  # the prefork server ends, and the labs with their own control channels
        self._process.wait()

    def start_lab(self) -> LabProcess:
        """Fork a lab's process."""
        channel_read, channel_write = os.pipe()
        answer_read, answer_write = os.pipe()
        try:
            socket.send_fds(self._socket, [b"+"], [channel_read, answer_write])
            pid = self._socket.recv(_PID.size)
        except OSError:
            pid = b""
        finally:
            os.close(channel_read)
            os.close(answer_write)
        if len(pid) != _PID.size:
            os.close(channel_write)
            os.close(answer_read)
            raise BenchError(
                "the prefork server of emulated labs has ended", remedy="its own output says why"
            )
        number = _PID.unpack(pid)[0]
        return LabProcess(number, os.fdopen(channel_write, "wb"), os.fdopen(answer_read, "rb"))
