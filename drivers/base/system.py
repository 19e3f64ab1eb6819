"""What operating systems differ in: flags of files, syncing to the disk, processors."""

from __future__ import annotations

import os
from pathlib import Path


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


def processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
