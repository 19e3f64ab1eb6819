"""Recordings of others, and statements on them beside what is known."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks._fetched import fetched


@dataclass(frozen=True)
class Said:
    """One statement: what is known, by whom, what was said, and whether it is right."""

    known: str
    by: str
    said: str
    right: bool


@dataclass(frozen=True)
class Recording:
    """A recording: file in the data folder, or `repo@commit:path` with the SHA-256 of what is to be fetched."""

    name: str
    place: str
    licence: str
    check: Callable[[Path], Iterator[Said]]
    sha256: str = ""

    def path(self, data: Path, cache: Path) -> Path:
        """Return the file, fetched if it is public; OSError if it cannot be had."""
        if not self.sha256:
            return data / self.place
        return fetched(self.place, self.sha256, cache)
