"""Block means and what is read off them; gaps held, stretches found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

BLOCK_S = 100


def block_means(values: Array, count: int = BLOCK_S) -> Array:
    """Means of consecutive blocks of `count` samples, (n,) -> (n // count,); NaN where half of one is missing."""
    blocks = values[: len(values) // count * count].reshape(-1, count)
    finite = np.isfinite(blocks)
    number = finite.sum(axis=1)
    mean = np.where(finite, blocks, 0.0).sum(axis=1) / np.maximum(number, 1)
    return np.where(number > count // 2, mean, np.nan)


def bias_stability(values: Array, count: int = BLOCK_S) -> float:
    """Sample standard deviation (ddof 1) of the block means of `count` samples, in the unit of the input.

    GJB 2426A's bias stability for 100 s blocks of 1 s means. ConfigurationError with fewer than two blocks.
    """
    means = block_means(values, count)
    means = means[np.isfinite(means)]
    if len(means) < 2:
        raise ConfigurationError(
            "the record is too short for a bias stability",
            where="evaluation",
            found=f"{len(means)} blocks of {count} samples",
            expected="at least 2",
            remedy="evaluate a longer run",
        )
    return float(np.std(means, ddof=1))


class Improved(Protocol):
    """A run before and after: the improvement in %, and the one that subtracting the true drift would give."""

    @property
    def improvement_pct(self) -> float | None:
        """Less spread than before, %."""

    @property
    def oracle_pct(self) -> float | None:
        """The same for the true drift, %."""


def attained(rows: Sequence[Improved]) -> tuple[float | None, float | None]:
    """Return (mean attainable improvement, share of it attained), both in %, over the runs that know both.

    The share is that of the means: a run on which little can be attained weighs little.
    """
    both = [
        (row.oracle_pct, row.improvement_pct)
        for row in rows
        if row.oracle_pct is not None and row.improvement_pct is not None
    ]
    if not both:
        return None, None
    limit, reached = (sum(column) / len(both) for column in zip(*both, strict=True))
    return limit, 100.0 * reached / limit if limit > 0.0 else None


@dataclass(frozen=True)
class Apart:
    """A comparison before and after, split where the model says of itself that it is out of its range.

    `outside`, `count`: how many samples are outside, and how many there are. `inside_before` and so on: spread of
    the block means of either part, in the unit of the values; None for a part of fewer than two blocks.
    """

    outside: int
    count: int
    inside_before: float | None
    inside_after: float | None
    outside_before: float | None
    outside_after: float | None


def apart(
    before: Array,
    after: Array,
    outside: NDArray[np.bool_],
    *,
    block: int = BLOCK_S,
    spread: Callable[[Array], float] = lambda means: float(np.std(means, ddof=1)),
) -> Apart:
    """Split `before` and `after` (n,) by `outside` (n,); a block with any sample outside is outside."""
    blocks = len(outside) // block
    beyond = outside[: blocks * block].reshape(-1, block).any(axis=1)
    found: list[float | None] = []
    for part in (~beyond, beyond):
        for values in (before, after):
            means = block_means(values, block)[part]
            means = means[np.isfinite(means)]
            found.append(spread(means) if len(means) > 1 else None)
    return Apart(int(outside.sum()), len(outside), *found)


def hold(values: Array, known: NDArray[np.bool_] | None = None) -> Array:
    """Replace values (n, ...) that are not known, default not finite, by the last one known before.

    At the start the first known one stands in.
    """
    known = np.isfinite(values) if known is None else known
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.asarray(values[np.where(last >= 0, last, int(np.argmax(known)))])


def on_grid(place: NDArray[np.int64], values: Array) -> Array:
    """Return values (m, ...) at their places (m,) on an even grid, (last place + 1, ...), NaN elsewhere."""
    even = np.full((int(place[-1]) + 1, *values.shape[1:]), np.nan)
    even[place] = values
    return even


def stretches(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return (start, stop) of every stretch in which `mask` (n,) is true, shape (k, 2)."""
    edges = np.diff(np.concatenate(([False], mask, [False])).astype(np.int8))
    return np.flatnonzero(edges).reshape(-1, 2)
