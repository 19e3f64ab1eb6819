"""Block means and what is read off them; gaps held, stretches found."""

from __future__ import annotations

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


def hold(values: Array, known: NDArray[np.bool_] | None = None) -> Array:
    """Replace values (n, ...) that are not known, default not finite, by the last one known before.

    At the start the first known one stands in.
    """
    known = np.isfinite(values) if known is None else known
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.asarray(values[np.where(last >= 0, last, int(np.argmax(known)))])


def stretches(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return (start, stop) of every stretch in which `mask` (n,) is true, shape (k, 2)."""
    edges = np.diff(np.concatenate(([False], mask, [False])).astype(np.int8))
    return np.flatnonzero(edges).reshape(-1, 2)
