"""The 90 deg grid as a graph for one table: nodes are attitude and gimbals, edges are turns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.calibration._conventions import Task, signed_permutations
from bench.analysis.calibration._schedule import Move, Schedule, turn_matrices
from bench.analysis.calibration._segments import (
    Segment,
    compose,
    dwell_segments,
    fold,
    informed,
    turn_segments,
)
from bench.analysis.calibration._table import Gimbals, Table, mountings, turned
from drivers.base.arrays import Array

QUARTERS = (90,)
_CHUNK = 2048
"""Rows of a batch that are worked on at once: they stay in the cache."""
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Graph:
    """`moves` (m): what an edge turns, six for quarter turns alone. `attitudes` (24, 3, 3), `node_attitude` (n,)
    index of each node's attitude, `edges` (n, m): the node that each move leads to, -1 where the table cannot;
    `rests` (24,) and `segments` (24, m) in batch, `firsts` (24,) the rests that a run begins with; `distance`
    (n, n) in turns.
    """

    moves: tuple[Move, ...]
    table: Table
    pattern: Schedule
    attitudes: Array
    node_attitude: Integers
    edges: Integers
    rests: Segment
    firsts: Segment
    segments: Segment
    distance: Integers

    def schedule(self, home: int, moves: tuple[int, ...], name: str) -> Schedule:
        """Return the schedule from a home node and move numbers."""
        return self.pattern.with_(
            name=name,
            home=self.attitudes[self.node_attitude[home]],
            moves=tuple(self.moves[move] for move in moves),
        )

    def walk(self, home: int, moves: tuple[int, ...]) -> list[int]:
        """Return the nodes visited, home first."""
        nodes = [home]
        for move in moves:
            nodes.append(int(self.edges[nodes[-1], move]))
        return nodes


def grid_attitudes() -> Array:
    """Return the 24 attitudes whose body axes point along directions, shape (24, 3, 3), the identity first."""
    return np.array([matrix for matrix in signed_permutations() if np.linalg.det(matrix) > 0.0])


def build_graph(
    task: Task,
    table: Table,
    pattern: Schedule,
    angles_deg: Sequence[int] = QUARTERS,
    outer: str | None = None,
) -> Graph:
    """Return the graph of turns by +-`angles_deg`; `pattern` gives dwell, rate and profile. Takes 0.1 s or so.

    `outer`: where the outer axis of a two-axis table points, if that is known.
    """
    attitudes = grid_attitudes()
    moves = tuple(Move(axis, sign * angle) for axis in range(3) for angle in angles_deg for sign in (1, -1))
    after = _moved(attitudes, moves)
    nodes, edges = _nodes(table, attitudes, after, moves, outer)
    rests = dwell_segments(task, attitudes, pattern.dwell_s)
    turns = turn_segments(
        task, np.repeat(attitudes, len(moves), axis=0), moves * 24, pattern.rate_dps, pattern.profile
    )
    both = compose(turns, rests[after.ravel()])
    segments = both.map(lambda part: part.reshape(24, len(moves), *part.shape[1:]))
    return Graph(
        moves,
        table,
        pattern,
        attitudes,
        nodes,
        edges,
        rests,
        informed(rests, task),
        segments,
        _distances(edges),
    )


def _moved(attitudes: Array, moves: Sequence[Move]) -> Integers:
    index = {tuple(np.rint(attitude).astype(int).ravel()): at for at, attitude in enumerate(attitudes)}
    after = np.empty((24, len(moves)), dtype=np.int64)
    for number, turn in enumerate(turn_matrices(moves)):
        for at, attitude in enumerate(attitudes):
            after[at, number] = index[tuple(np.rint(attitude @ turn).astype(int).ravel())]
    return after


def _nodes(
    table: Table, attitudes: Array, after: Integers, moves: Sequence[Move], outer: str | None
) -> tuple[Integers, Integers]:
    """Return the attitude of every node and the edges; a turn that two gimbals can make is two nodes' choice:
    the first is taken that keeps the mounting, so each move leads to one node.
    """
    if table == "by-hand":
        return np.arange(24), after
    keys = [(at, way) for at, attitude in enumerate(attitudes) for way in mountings(table, attitude, outer)]
    index: dict[tuple[int, Gimbals], int] = {key: number for number, key in enumerate(keys)}
    edges = np.full((len(keys), len(moves)), -1, dtype=np.int64)
    for number, (at, way) in enumerate(keys):
        for at_move, move in enumerate(moves):
            left = turned(table, way, attitudes[at], move.axis)
            if left:
                # after an even number of quarters a middle axis lies along its line again
                kept = left[0] if move.angle_deg // 90 % 2 else way
                edges[number, at_move] = index[int(after[at, at_move]), kept]
    return np.array([at for at, _ in keys]), edges


def _distances(edges: Integers) -> Integers:
    count = len(edges)
    distance = np.full((count, count), count, dtype=np.int64)
    for start in range(count):
        reached, steps = {start}, 0
        ring = reached
        while ring:
            distance[start, list(ring)] = steps
            ring = {int(to) for node in ring for to in edges[node] if to >= 0} - reached
            reached = reached | ring
            steps += 1
    return distance


@dataclass(frozen=True)
class Path:
    """A home node and the moves from it."""

    home: int
    moves: tuple[int, ...]


def stretch_of(graph: Graph, start: int, moves: Sequence[int], *, rest: bool) -> Segment:
    """Return the stretch of moves from a node; `rest`: the dwell at the node comes first."""
    at = graph.node_attitude[graph.walk(start, tuple(moves))]
    if not moves:
        return graph.firsts[at[0]] if rest else graph.rests[at[0]]
    whole = fold(graph.segments[at[:-1], list(moves)])
    return compose(graph.firsts[at[0]], whole) if rest else whole


def cuts(count: int) -> list[slice]:
    """Return slices that part `count` rows."""
    return [slice(at, at + _CHUNK) for at in range(0, count, _CHUNK)]
