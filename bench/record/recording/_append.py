"""A file that only grows: buffered in memory, written in blocks, its failures told as RecordError."""

from __future__ import annotations

import os
from pathlib import Path

from drivers.base.errors import RecordError


class AppendFile:
    """An append-only file in a run folder; a failed write keeps what is on disk and what is still pending."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.pending = bytearray()
        self.unsynced = False
        try:
            self._fd = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise record_error(path, error) from error

    @property
    def closed(self) -> bool:
        """Whether the file has been closed."""
        return self._fd < 0

    def write(self) -> None:
        """Hand everything pending to the operating system; raises RecordError (disk full, folder gone)."""
        if not self.pending:
            return
        written = 0
        try:
            while written < len(self.pending):
                with memoryview(self.pending) as view:
                    written += os.write(self._fd, view[written:])
            if os.fstat(self._fd).st_nlink == 0:
                raise FileNotFoundError(2, "the file was deleted while it was being written")
        except OSError as error:
            raise record_error(self.path, error) from error
        finally:
            self.unsynced |= written > 0
            del self.pending[:written]

    def sync(self) -> None:
        """Wait until what was written is on the disk; raises OSError. May be called from another thread."""
        self.unsynced = False
        try:
            os.fdatasync(self._fd)
        except OSError:
            self.unsynced = True
            raise

    def close(self) -> None:
        """Close the descriptor without writing; harmless when closed already."""
        if not self.closed:
            os.close(self._fd)
            self._fd = -1


def record_error(path: Path, error: OSError) -> RecordError:
    """Return the RecordError that tells the operator about `error` at `path`."""
    return RecordError(
        "the run cannot be recorded any further",
        where=str(path),
        found=error.strerror or str(error),
        expected="a run folder that can be written, with space on its disk",
        remedy="free space or name another folder; what was recorded so far can be read",
    )
