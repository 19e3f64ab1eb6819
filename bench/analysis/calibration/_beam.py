"""A beam over the grid's graph: all schedules grow together, the best of every attitude and home are kept."""

from __future__ import annotations

import numpy as np

from bench.analysis.calibration._graph import Graph, Integers, Path, cuts
from bench.analysis.calibration._segments import compose, join, scaled_variances
from drivers.base.arrays import Array

_POWER = 6.0
"""Of the mean that guides: near the worst, yet alive while one state still stands at its prior."""


def grow_beam(graph: Graph, weight: Array, turns: int, width: int) -> tuple[list[Path], int]:
    """Return closed paths, best first, and how many were evaluated. One home for each possible up axis."""
    homes = _homes(graph)
    home, node, evaluated = homes, homes, 0
    history = np.empty((len(homes), 0), dtype=np.int64)
    stretch = graph.firsts[graph.node_attitude[homes]]
    guide = np.zeros(len(homes))
    for turn in range(turns):
        row, move = np.nonzero(graph.edges[node] >= 0)
        to = graph.edges[node[row], move]
        kept = graph.distance[to, home[row]] <= turns - turn - 1
        row, move, to = row[kept], move[kept], to[kept]
        if not len(row):
            return [], evaluated
        attitude = graph.node_attitude[node[row]]
        stretch = join(
            [compose(stretch[row[cut]], graph.segments[attitude[cut], move[cut]]) for cut in cuts(len(row))]
        )
        parts = [scaled_variances(stretch.information[cut]) for cut in cuts(len(row))]
        guide = np.mean((np.concatenate(parts) * weight) ** (_POWER / 2.0), axis=1) ** (1.0 / _POWER)
        evaluated += len(row)
        chosen = _best_each(guide, graph.node_attitude[to] * len(graph.edges) + home[row], width)
        stretch, guide = stretch[chosen], guide[chosen]
        history = np.concatenate([history[row[chosen]], move[chosen, None]], axis=1)
        home, node = home[row[chosen]], to[chosen]
    worst = np.sqrt((scaled_variances(stretch.information) * weight).max(axis=1))
    order = np.argsort(worst)
    return [Path(int(home[at]), tuple(int(move) for move in history[at])) for at in order], evaluated


def _homes(graph: Graph) -> Integers:
    """Return one node for each up axis and each way of mounting; heading matters little and signs less."""
    seen: dict[tuple[object, ...], int] = {}
    for node, at in enumerate(graph.node_attitude):
        up = int(np.argmax(np.abs(graph.attitudes[at][2])))
        possible = tuple(
            sorted({move.axis for number, move in enumerate(graph.moves) if graph.edges[node, number] >= 0})
        )
        seen.setdefault((up, possible), node)
    return np.array(list(seen.values()))


def _best_each(score: Array, group: Integers, count: int) -> Integers:
    """Return the indices of the `count` lowest scores of every group; equal scores of a group count once."""
    order = np.lexsort((score, group))
    same = (np.diff(group[order], prepend=-1) == 0) & (np.diff(score[order], prepend=np.inf) < 1e-12)
    order = order[~same]
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    rank = np.arange(len(order)) - np.repeat(starts, np.diff([*starts, len(order)]))
    return np.asarray(order[rank < count])
