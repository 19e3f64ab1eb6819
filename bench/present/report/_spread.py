"""Labels moved apart so that they do not overlap, each as little as possible."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def spread(wanted: Sequence[float], sizes: Sequence[float], low: float, high: float) -> list[float]:
    """Return centres for labels of `sizes` at `wanted` centres, in any order, within `low` .. `high`.

    Minimises the sum of squared moves while keeping the order (isotonic regression, then clipping). Labels that
    together are longer than the range overrun its high end.
    """
    if not wanted:
        return []
    from scipy.optimize import isotonic_regression  # slow to import

    order = np.argsort(wanted, kind="stable")
    length = np.asarray(sizes)[order]
    ahead = np.cumsum(length) - length
    starts = isotonic_regression(np.asarray(wanted)[order] - length / 2.0 - ahead).x
    centres = np.empty(len(order))
    centres[order] = np.maximum(low, np.minimum(starts, high - length.sum())) + ahead + length / 2.0
    return [float(centre) for centre in centres]
