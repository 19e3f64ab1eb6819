"""The tap: a process that passes bytes between the ports of a lab and those a bench opens, and writes them down.

Started as `python _wire.py LOG PORT...`; prints the ports for the bench in the same order, as JSON, and ends
with its input. A port is a terminal or `socket://host:port`. Nothing of the project is used, nothing installed.

A record of the log: monotonic time of the host in ns, port, direction (0: lab to bench, 1: back), length, bytes.
"""

from __future__ import annotations

import json
import os
import pty
import select
import socket
import struct
import sys
import termios
import time
import tty
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

RECORD = struct.Struct("<qBBI")
_BLOCK = 1 << 16


@dataclass(frozen=True)
class Heard:
    """Bytes that passed: when (s, monotonic time of the host), which way, and what."""

    time_s: float
    sent: bool
    data: bytes


def read_log(path: Path, count: int, start: int = 0) -> list[list[Heard]]:
    """Return what passed so far at each of `count` ports, from byte `start` of the log on."""
    with path.open("rb") as file:
        file.seek(start)
        content, at = file.read(), 0
    ports: list[list[Heard]] = [[] for _ in range(count)]
    while at + RECORD.size <= len(content):
        time_ns, port, sent, length = RECORD.unpack_from(content, at)
        at += RECORD.size + length
        if at > len(content):
            break
        ports[port].append(Heard(time_ns / 1e9, bool(sent), content[at - length : at]))
    return ports


class _Port:
    """One port of the lab, and what stands in its place for the bench."""

    def __init__(self, number: int, url: str) -> None:
        self.number, self.url = number, url
        self.lab = self.bench = self.listening = -1
        if url.startswith("socket://"):
            self._listener = socket.create_server(("127.0.0.1", 0))
            self.listening = self._listener.fileno()
            self.name = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"
            return
        self.lab = os.open(url, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self.lab)
        self.bench, self._kept = pty.openpty()  # our own end stays open: a bench may come and go
        tty.setraw(self._kept)
        os.set_blocking(self.bench, False)
        self.name = os.ttyname(self._kept)

    def accept(self) -> None:
        """Take the next bench at a socket, in place of the one before."""
        self.leave()
        guest, _ = self._listener.accept()
        host, _, port = self.url.removeprefix("socket://").rpartition(":")
        self.bench, self.lab = guest.detach(), socket.create_connection((host, int(port))).detach()

    def leave(self) -> None:
        """Close both ends of a socket; a terminal stays."""
        if self.listening >= 0:
            for descriptor in (self.bench, self.lab):
                if descriptor >= 0:
                    os.close(descriptor)
            self.bench = self.lab = -1

    def forget(self) -> None:
        """Drop what lies unread at a terminal: a device without a host sends into the air."""
        if self.listening < 0:
            termios.tcflush(self._kept, termios.TCIFLUSH)


def _pass_on(port: _Port, log: int, *, sent: bool) -> None:
    source, sink = (port.bench, port.lab) if sent else (port.lab, port.bench)
    try:
        data = os.read(source, _BLOCK)
    except OSError:
        data = b""
    if not data:
        port.leave()
        return
    taken = 0
    while taken < len(data):
        try:
            taken += os.write(sink, data[taken:])
        except BlockingIOError:
            port.forget()  # nobody reads
            break
        except OSError:
            port.leave()
            break
    if taken:
        head = RECORD.pack(time.monotonic_ns(), port.number, sent, taken)
        os.write(log, head + data[:taken])


def main() -> None:
    """Pass bytes on until standard input ends."""
    log = os.open(sys.argv[1], os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    ports = [_Port(number, url) for number, url in enumerate(sys.argv[2:])]
    sys.stdout.write(json.dumps([port.name for port in ports]) + "\n")
    sys.stdout.flush()
    while True:
        waiting: dict[int, tuple[_Port | None, str]] = {0: (None, "")}
        for port in ports:
            ends = ((port.listening, "accept"), (port.bench, "sent"), (port.lab, "received"))
            waiting |= {end: (port, what) for end, what in ends if end >= 0}
        for descriptor in select.select(list(waiting), [], [])[0]:
            found, what = waiting[descriptor]
            if found is None:
                return
            if what == "accept":
                with suppress(OSError):
                    found.accept()
            elif descriptor in (found.bench, found.lab):
                _pass_on(found, log, sent=what == "sent")


if __name__ == "__main__":
    main()
