"""What an emulated unit really did, written beside its run: nothing but comparisons needs it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from drivers.base.arrays import ARCHIVE_DAMAGE, array_of, read_archive
from drivers.base.errors import RecordError


def truth_file(gyro: str) -> str:
    """Return the name of the file of a unit's truth."""
    return f"truth_{gyro}.npz"


def read_truth(path: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of a truth file by name, empty without one.

    RecordError if it is damaged or unpacks to more than 256 MiB.
    """
    if not path.exists():
        return {}
    try:
        return {name.removesuffix(".npy"): array_of(data) for name, data in read_archive(path).items()}
    except ARCHIVE_DAMAGE as error:
        raise RecordError(
            "this is not a readable file of arrays",
            where=str(path),
            found=f"{type(error).__name__}: {error}",
            expected="a zip of .npy arrays of numbers",
            remedy="copy the file again; a truth file may also be deleted, nothing but comparisons needs it",
        ) from error
