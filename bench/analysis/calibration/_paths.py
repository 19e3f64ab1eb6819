"""Paths on the graph of a table and their stretches; batches in cuts that stay in the cache."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bench.analysis.calibration._graph import Graph
from bench.analysis.calibration._segments import Segment, compose, fold

_CHUNK = 2048


@dataclass(frozen=True)
class Path:
    """A home node and the moves from it."""

    home: int
    moves: tuple[int, ...]


def stretch_of(graph: Graph, start: int, moves: Sequence[int], *, rest: bool) -> Segment:
    """Return the stretch of moves from a node; `rest`: the dwell at the node comes first."""
    nodes = graph.walk(start, tuple(moves))
    at = graph.node_attitude[nodes]
    batch = graph.segments[at[:-1], list(moves)] if len(moves) else None
    first = graph.rests[at[0]]
    if batch is None:
        return first
    return compose(first, fold(batch)) if rest else fold(batch)


def whole(graph: Graph, path: Path) -> Segment:
    """Return the stretch of a path, its first dwell included."""
    return stretch_of(graph, path.home, path.moves, rest=True)


def cuts(count: int) -> list[slice]:
    """Return slices that part `count` rows."""
    return [slice(at, at + _CHUNK) for at in range(0, count, _CHUNK)]
