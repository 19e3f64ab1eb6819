"""Room on the disk, looked at before anything moves: a run that fills it is lost where it matters."""

from __future__ import annotations

import shutil
from pathlib import Path

from bench.record.benchfile import BenchFile
from drivers.base.errors import LimitExceeded

_BYTES_A_SAMPLE = 60
"""Raw frame, its place in time and its row of the decoded table, generously; a rehearsal knows better."""
_BYTES_A_SECOND = 1000
"""Telemetry of table and chamber, and the panel's history."""


def estimated_bytes(duration_s: float, file: BenchFile) -> int:
    """Return about what this long a record takes: every sample of every unit, raw and decoded."""
    samples_per_s = sum(gyro.rate_hz for gyro in file.gyro)
    return round(duration_s * (samples_per_s * _BYTES_A_SAMPLE + _BYTES_A_SECOND))


def free_bytes(folder: Path) -> int:
    """Return how many bytes are free where a folder is or will be."""
    place = folder.absolute()
    while not place.exists():
        place = place.parent
    return shutil.disk_usage(place).free


def check_disk(needed: int, folder: Path, what: str, option: str) -> None:
    """Raise LimitExceeded if fewer than `needed` bytes are free where `folder` is or will be.

    `what` ("the campaign", "the run") does not fit; `option` of the command line names another folder.
    """
    free = free_bytes(folder)
    if needed > free:
        raise LimitExceeded(
            f"{what} does not fit on the disk",
            where=str(folder),
            found=f"{free / 1e6:,.0f} MB free",
            expected=f"about {needed / 1e6:,.0f} MB",
            remedy=f"free space, or name a folder on another disk with {option}",
        )
