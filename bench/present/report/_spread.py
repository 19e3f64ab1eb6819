"""Labels moved apart so that they do not overlap, each as little as possible."""

from __future__ import annotations

from collections.abc import Sequence


def spread(wanted: Sequence[float], sizes: Sequence[float], low: float, high: float) -> list[float]:
    """Return centres for labels of `sizes` at `wanted` centres, in any order, within `low` .. `high`.

    Minimises the sum of squared moves while keeping the order (isotonic regression by pooling adjacent
    violators, then clipping). Labels that together are longer than the range overrun its high end.
    """
    order = sorted(range(len(wanted)), key=lambda index: wanted[index])
    starts, ahead = [], 0.0
    for index in order:
        starts.append(wanted[index] - sizes[index] / 2.0 - ahead)
        ahead += sizes[index]
    pools: list[tuple[float, int]] = []
    for start in starts:
        pool = (start, 1)
        while pools and pools[-1][0] > pool[0]:
            mean, members = pools.pop()
            total = members + pool[1]
            pool = ((mean * members + pool[0] * pool[1]) / total, total)
        pools.append(pool)
    centres = [0.0] * len(order)
    position, ahead = iter(order), 0.0
    for mean, members in pools:
        start = max(low, min(mean, high - sum(sizes)))
        for _ in range(members):
            index = next(position)
            centres[index] = start + ahead + sizes[index] / 2.0
            ahead += sizes[index]
    return centres
