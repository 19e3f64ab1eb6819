"""Locks on files that the kernel gives back when whoever has them ends, however it ends.

Linux: fcntl(2), "open file description locks"; a child process that inherits the descriptor keeps the lock.
Windows: a byte far beyond the content, by `msvcrt.locking`; a child does not keep it. Untried on Windows itself.
"""

from __future__ import annotations

import os
import struct
from importlib import import_module
from typing import Any

_FLOCK = struct.Struct("hhqqi4x")
"""struct flock of Linux on 64 bits: type, whence, start, length, pid (0 with open file description locks)."""
_FAR = 1 << 30
"""Windows keeps others from reading what is locked: the content stays free."""


def _known(module: str) -> Any:
    try:
        return import_module(module)
    except ModuleNotFoundError:
        return None


_fcntl: Any = _known("fcntl")
_msvcrt: Any = None if _fcntl else _known("msvcrt")
INHERITED = _fcntl is not None
"""Whether a child process that inherits the descriptor keeps the lock."""


def take_lock(descriptor: int, *, wait: bool = False) -> None:
    """Lock a file that is open for writing; BlockingIOError if somebody else has it and we do not `wait`."""
    if _fcntl is not None:
        command = _fcntl.F_OFD_SETLKW if wait else _fcntl.F_OFD_SETLK
        _fcntl.fcntl(descriptor, command, _FLOCK.pack(_fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0))
        return
    while True:
        try:
            _far_byte(descriptor, _msvcrt.LK_LOCK if wait else _msvcrt.LK_NBLCK)
        except OSError as error:
            if not wait:
                raise BlockingIOError(error.errno, "somebody else has the lock") from error
        else:
            return  # LK_LOCK gives up after ten seconds: again


def release_lock(descriptor: int) -> None:
    """Give a lock back."""
    if _fcntl is not None:
        _fcntl.fcntl(descriptor, _fcntl.F_OFD_SETLK, _FLOCK.pack(_fcntl.F_UNLCK, os.SEEK_SET, 0, 0, 0))
    else:
        _far_byte(descriptor, _msvcrt.LK_UNLCK)


def is_locked(descriptor: int) -> bool:
    """Return whether somebody else has the lock; POSIX asks without taking it."""
    if _fcntl is not None:
        asked = _FLOCK.pack(_fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
        found = _fcntl.fcntl(descriptor, _fcntl.F_OFD_GETLK, asked)
        return bool(_FLOCK.unpack(found)[0] != _fcntl.F_UNLCK)
    try:
        take_lock(descriptor)
    except BlockingIOError:
        return True
    release_lock(descriptor)
    return False


def _far_byte(descriptor: int, mode: int) -> None:
    here = os.lseek(descriptor, 0, os.SEEK_CUR)
    try:
        os.lseek(descriptor, _FAR, os.SEEK_SET)
        _msvcrt.locking(descriptor, mode, 1)
    finally:
        os.lseek(descriptor, here, os.SEEK_SET)
