"""The far end of a pseudo-terminal, for tests that look at the bytes themselves."""

from __future__ import annotations

import array
import fcntl
import os
import select
import termios


def read_exactly(fd: int, count: int) -> bytes:
    """Return the next `count` bytes, or what had come after 10 s.

    The kernel passes what one end wrote to the other in its own time and in pieces of its own choice: a single
    read right after a write may see nothing or a part of it.
    """
    got = b""
    while len(got) < count and select.select([fd], [], [], 10.0)[0]:
        got += os.read(fd, count - len(got))
    return got


def write_through(fd: int, far_fd: int, data: bytes) -> None:
    """Write and wait until all of it lies at the far end, up to 10 s: for readers on a clock of their own."""
    os.write(fd, data)
    waiting = array.array("i", [0])
    for _ in range(10_000):
        fcntl.ioctl(far_fd, termios.FIONREAD, waiting)
        if waiting[0] >= len(data):
            return
        select.select([], [], [], 0.001)
    raise AssertionError(f"{waiting[0]} of {len(data)} bytes came through the terminal in 10 s")
