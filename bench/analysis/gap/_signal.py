"""The one path of a diagnosis, and what each kind of signal does differently on it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, Generic, TypeVar

from bench.analysis.gap._findings import Finding
from bench.analysis.gap._model_file import Model

Recording = TypeVar("Recording")
Prepared = TypeVar("Prepared")
Sets = TypeVar("Sets")
FindingT = TypeVar("FindingT", bound=Finding[Any])


class Signal(ABC, Generic[Recording, Prepared, Sets, FindingT]):
    """A kind of signal in which simulation and bench can part: rate, a channel beside it, a position.

    The steps are the same for all; what is nuisance, how noise is made white, which effects are candidates and
    what a held-out run can judge differ.
    """

    def find(self, runs: Sequence[Recording], model: Model, held_out: Sequence[Recording] = ()) -> FindingT:
        """Return where runs part from a model, which effects explain it, and how far that holds on other runs."""
        data = self.prepare(runs, model)
        sets = self.which(data)
        finding = self.finding(data, sets)
        return self.judged(finding, data, sets, held_out) if held_out else finding

    @abstractmethod
    def prepare(self, runs: Sequence[Recording], model: Model) -> Prepared:
        """Check the runs, take out what is nuisance, make noise white and cut it into cells."""

    @abstractmethod
    def which(self, data: Prepared) -> Sets:
        """Fit sets of candidate effects, the empty one among them, and weigh them."""

    @abstractmethod
    def finding(self, data: Prepared, sets: Sets) -> FindingT:
        """Say where the gap is before and after the best set, and name its effects as causes."""

    @abstractmethod
    def judged(
        self, finding: FindingT, data: Prepared, sets: Sets, held_out: Sequence[Recording]
    ) -> FindingT:
        """Add how far the gap shrinks on runs that took no part in choice and fit."""
