"""How long to dwell and how often to repeat, by what a unit's output at rest has just shown.

Nothing is assumed of the noise: the very difference that a test will take is taken of the record at rest, at
every place where it fits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

_SHORTEST_S, _LONGEST_S = 60.0, 7200.0
_FEWEST_WINDOWS = 8
"""A dwell is at most this part of the record: a difference of three then fits well twice side by side."""
_MOST_REPEATS = 40


@dataclass(frozen=True)
class AtRest:
    """A unit's output at rest: valid samples of each second, (n,), and their sum, deg/h (n,)."""

    samples: NDArray[np.float64]
    sums_dph: NDArray[np.float64]

    @classmethod
    def of_means(cls, means_dph: ArrayLike) -> AtRest:
        """Return a record of 1 s means, NaN where there is none."""
        means = np.asarray(means_dph, dtype=np.float64)
        known = np.isfinite(means)
        return cls(known.astype(np.float64), np.where(known, means, 0.0))

    @classmethod
    def of_pieces(cls, pieces: Sequence[AtRest]) -> AtRest:
        """Return pieces of a record that follow each other as one."""
        parts = ([getattr(piece, name) for piece in pieces] for name in ("samples", "sums_dph"))
        return cls(*(np.concatenate(part) for part in parts))

    def difference_dph(self, dwell_s: float, gap_s: float) -> float:
        """Return the standard deviation of B - (A + C) / 2, means over three dwells `gap_s` apart.

        A steady drift drops out. NaN where the record is too short for one.
        """
        length, pitch = round(dwell_s), round(dwell_s + gap_s)
        places = len(self.samples) - (2 * pitch + length) + 1
        if places < 1:
            return math.nan

        def of_dwells(each_second: NDArray[np.float64]) -> NDArray[np.float64]:
            """Return the sums over the three dwells at every place, (3, places)."""
            total = np.concatenate(([0.0], np.cumsum(each_second)))
            begins = (0, pitch, 2 * pitch)
            return np.array([total[a + length : a + length + places] - total[a : a + places] for a in begins])

        samples, sums = of_dwells(self.samples), of_dwells(self.sums_dph)
        whole = (samples > 0.5 * np.median(samples)).all(axis=0)
        if not whole.any():
            return math.nan
        first, middle, last = sums[:, whole] / samples[:, whole]
        return float(np.sqrt(np.mean((middle - 0.5 * (first + last)) ** 2)))


@dataclass(frozen=True)
class Schedule:
    """An input put in `repeats` times, each between two dwells without it: zero, input, zero, input, zero.

    `error_dph`: standard error of the answer, by the record at rest.
    """

    dwell_s: float
    repeats: int
    error_dph: float
    gap_s: float

    @property
    def duration_s(self) -> float:
        """Time of all dwells, and of the moves between them."""
        return (2 * self.repeats + 1) * (self.dwell_s + self.gap_s)


def repeated(repeats: int) -> float:
    """Return the variance of an alternation over that of a single difference, for errors without memory.

    The mean of k inputs less the mean of the zeros on both sides of each: (4 k - 1) / (2 k^2) of a dwell's
    variance, which is 3/2 for one.
    """
    return (4.0 * repeats - 1.0) / (3.0 * repeats**2)


def dwells_s(record: AtRest) -> Iterator[float]:
    """Yield dwells in steps of 2^(1/2), as long as the record can tell."""
    dwell_s = _SHORTEST_S
    while dwell_s <= min(_LONGEST_S, len(record.samples) / _FEWEST_WINDOWS):
        yield float(round(dwell_s))
        dwell_s *= math.sqrt(2.0)


def schedules(records: Sequence[AtRest], gap_s: float) -> list[Schedule]:
    """Return every schedule that the records can tell of; the error is that of the noisiest unit."""
    found: list[Schedule] = []
    if not records:
        return found
    for dwell_s in dwells_s(min(records, key=lambda record: len(record.samples))):
        single = max(record.difference_dph(dwell_s, gap_s) for record in records)
        if math.isfinite(single):
            found += [
                Schedule(dwell_s, repeats, single * math.sqrt(repeated(repeats)), gap_s)
                for repeats in range(1, _MOST_REPEATS + 1)
            ]
    return found


def shortest(among: Sequence[Schedule], error_dph: float) -> Schedule | None:
    """Return the schedule that takes least time for a standard error; None if none has it."""
    good = [schedule for schedule in among if schedule.error_dph <= error_dph]
    return min(good, key=lambda schedule: schedule.duration_s, default=None)


def finest(among: Sequence[Schedule], most_s: float) -> Schedule | None:
    """Return the schedule with the least standard error that fits into a time; None if none fits."""
    good = [schedule for schedule in among if schedule.duration_s <= most_s]
    return min(good, key=lambda schedule: schedule.error_dph, default=None)
