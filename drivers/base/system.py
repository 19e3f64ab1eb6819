"""What operating systems differ in: flags of files, syncing to the disk, processors, waiting for descriptors."""

from __future__ import annotations

import os
import select
import socket
from contextlib import suppress
from pathlib import Path
from typing import Any

SELECTS_FILES = hasattr(select, "poll")
"""Whether any descriptor can be waited for; Windows waits for sockets only."""
_LOWEST_PRIORITY = 19
READABLE, WRITABLE = 1, 4
"""POLLIN and POLLOUT of `select.poll`, where there is one and where there is none."""


def open_flags(*names: str) -> int:
    """Return those of the flags of `os.open` that this system has: Windows knows no O_NONBLOCK and no O_CLOEXEC.

    No descriptor is inherited, and bytes are bytes: without O_BINARY Windows changes the ends of lines.
    """
    found = 0
    for name in (*names, "O_CLOEXEC", "O_NOINHERIT", "O_BINARY"):
        found |= getattr(os, name, 0)
    return found


def sync_data(descriptor: int) -> None:
    """Wait until the content of a file is on the disk; raises OSError."""
    if hasattr(os, "fdatasync"):
        os.fdatasync(descriptor)
    else:
        os.fsync(descriptor)


def sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk; Windows cannot open folders and has none."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    descriptor = os.open(folder, open_flags("O_RDONLY", "O_DIRECTORY"))
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def state_folder() -> Path:
    """Return `$XDG_STATE_HOME/gyrobench` (default `~/.local/state/gyrobench`): leases, and the bench's key."""
    base = os.environ.get("XDG_STATE_HOME", "")
    return (Path(base) if base.startswith("/") else Path.home() / ".local" / "state") / "gyrobench"


def is_pseudo_terminal(path: str) -> bool:
    """Return whether a port is a terminal with a program at its other end, as Linux names them."""
    return str(Path(path).resolve()).startswith("/dev/pts/")


def processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def give_way(pid: int = 0, *, group: bool = False) -> None:
    """Give a process, this one for 0, or its process group the lowest priority, where the system knows how."""
    if hasattr(os, "setpriority"):
        with suppress(OSError):  # it has ended already
            os.setpriority(os.PRIO_PGRP if group else os.PRIO_PROCESS, pid, _LOWEST_PRIORITY)


class _SelectPoll:
    """`select.poll` by `select.select`, for systems without it; errors show as readable."""

    def __init__(self) -> None:
        self._wanted: dict[int, int] = {}

    def register(self, descriptor: int, events: int) -> None:
        self._wanted[descriptor] = events

    def unregister(self, descriptor: int) -> None:
        del self._wanted[descriptor]

    def poll(self, timeout_ms: float | None = None) -> list[tuple[int, int]]:
        reading = [descriptor for descriptor, events in self._wanted.items() if events & READABLE]
        writing = [descriptor for descriptor, events in self._wanted.items() if events & WRITABLE]
        timeout_s = None if timeout_ms is None else timeout_ms / 1e3
        readable, writable, _ = select.select(reading, writing, [], timeout_s)
        return [(found, READABLE) for found in readable] + [(found, WRITABLE) for found in writable]


def poller() -> Any:
    """Return an object like `select.poll()`: `register`, `unregister`, `poll(ms)` or `poll()`."""
    return select.poll() if SELECTS_FILES else _SelectPoll()


class Wake:
    """Something to wait for beside ports, which another thread or a signal handler makes readable."""

    def __init__(self) -> None:
        self._ends: tuple[socket.socket, socket.socket] | None = None
        if SELECTS_FILES:
            self._read, self._write = os.pipe()
            os.set_blocking(self._read, False)
            os.set_blocking(self._write, False)
            return
        self._ends = socket.socketpair()
        for end in self._ends:
            end.setblocking(False)

    def fileno(self) -> int:
        """Return the descriptor to select on."""
        return self._read if self._ends is None else self._ends[0].fileno()

    def wake(self) -> None:
        """Make it readable; one that is full is readable already."""
        with suppress(BlockingIOError):
            if self._ends is None:
                os.write(self._write, b"!")
            else:
                self._ends[1].send(b"!")

    def clear(self) -> None:
        """Make it unreadable again."""
        with suppress(BlockingIOError):
            if self._ends is None:
                os.read(self._read, 4096)
            else:
                self._ends[0].recv(4096)

    def close(self) -> None:
        """Release it."""
        if self._ends is None:
            os.close(self._read)
            os.close(self._write)
            return
        for end in self._ends:
            end.close()
