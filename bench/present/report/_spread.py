"""Labels moved apart so that they do not overlap, each as little as possible."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np


def spread(wanted: Sequence[float], sizes: Sequence[float], low: float, high: float) -> list[float]:
    """Return centres for labels of `sizes` at `wanted` centres, in any order, within `low` .. `high`.

    Minimises the sum of squared moves while keeping the order (isotonic regression, then clipping). Labels that
    together are longer than the range overrun its high end.
    """
    if not wanted:
        return []
    order = np.argsort(wanted, kind="stable")
    length = np.asarray(sizes)[order]
    ahead = np.cumsum(length) - length
    starts = np.array(_isotonic(np.asarray(wanted)[order] - length / 2.0 - ahead))
    centres = np.empty(len(order))
    centres[order] = np.maximum(low, np.minimum(starts, high - length.sum())) + ahead + length / 2.0
    return [float(centre) for centre in centres]


def _isotonic(values: Iterable[float]) -> list[float]:
    """Return the rising sequence nearest to `values` by least squares: pool adjacent violators.

    scipy has it, too, but comes with an extra; a report of a run is written without it.
    """
    pools: list[tuple[float, int]] = []
    for value in values:
        total, count = float(value), 1
        while pools and pools[-1][0] / pools[-1][1] >= total / count:
            before, members = pools.pop()
            total, count = total + before, count + members
        pools.append((total, count))
    return [total / count for total, count in pools for _ in range(count)]
