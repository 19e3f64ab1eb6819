"""Block means and what is read off them."""

from __future__ import annotations

import numpy as np

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
