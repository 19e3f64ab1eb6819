"""Where a campaign's runs take place: on the bench file's devices, or on emulated labs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from bench.lab.emulated import EmulatedLab, Plant, save_truth
from bench.record.benchfile import BenchFile


@dataclass(frozen=True)
class Placed:
    """A bench that is ready for one run; `perform` does an operator's act in an emulated lab."""

    file: BenchFile
    perform: Callable[[dict[str, Any]], dict[str, Any]] | None = None
    emulated: dict[str, Any] | None = None
    before_close: Callable[[Path], None] | None = None


class Place(Protocol):
    """Gives every run its bench."""

    @property
    def plant(self) -> Plant | None:
        """What is emulated; None for devices."""
        ...

    def open(self, number: int) -> AbstractContextManager[Placed]:
        """Return the bench for run `number`, counted from 0."""
        ...


class RealPlace:
    """The bench file's own devices."""

    plant: Plant | None = None

    def __init__(self, file: BenchFile) -> None:
        self._file = file

    @contextmanager
    def open(self, number: int) -> Iterator[Placed]:
        """Return the bench itself."""
        yield Placed(self._file)


class EmulatedPlace:
    """A fresh emulated lab in virtual time for every run.

    Every run has a seed of its own, counted from the plant's, so that a campaign gives the same bytes however it
    was interrupted and however many of its runs go on side by side.
    """

    def __init__(self, file: BenchFile, plant: Plant) -> None:
        self._file = file
        self.plant = plant

    @contextmanager
    def open(self, number: int) -> Iterator[Placed]:
        """Start the lab of run `number`."""
        plant = self.plant.model_copy(update={"seed": self.plant.seed + number})
        with EmulatedLab(self._file, plant) as lab:
            yield Placed(
                lab.file,
                lab.perform,
                plant.told(self._file),
                lambda folder: save_truth(lab, folder),
            )
