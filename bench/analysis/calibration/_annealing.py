"""Annealing by re-routing: every path between the ends of a window is evaluated, one is drawn by its merit."""

from __future__ import annotations

import math

import numpy as np

from bench.analysis.calibration._graph import Graph, Integers, Path, stretch_of
from bench.analysis.calibration._segments import compose, scaled_variances
from drivers.base.arrays import Array

_WINDOW = (2, 3, 4, 5)
_WAYS = 6**5
_START_HEAT, _END_HEAT = 0.02, 0.0005


def anneal(
    graph: Graph, weight: Array, start: Path, steps: int, rng: np.random.Generator
) -> tuple[Path, float, int]:
    """Return the best path met, its cost, and how many were evaluated."""
    path, best, least, evaluated = start, start, math.inf, 0
    for step in range(steps):
        heat = _START_HEAT * (_END_HEAT / _START_HEAT) ** (step / max(1, steps - 1))
        if rng.random() < 0.3:
            # A closed path may begin at any of its positions.
            by = int(rng.integers(len(path.moves)))
            home = graph.walk(path.home, path.moves)[by]
            path = Path(home, (*path.moves[by:], *path.moves[:by]))
        start_at, ways = _rerouted(graph, path, rng)
        cost = _cost(graph, path, start_at, ways, weight)
        evaluated += len(ways)
        chance = np.exp(-(cost - cost.min()) / heat)
        drawn = int(rng.choice(len(cost), p=chance / chance.sum()))
        end_at = start_at + ways.shape[1]
        path = Path(path.home, (*path.moves[:start_at], *ways[drawn].tolist(), *path.moves[end_at:]))
        if cost[drawn] < least:
            best, least = path, float(cost[drawn])
    return best, least, evaluated


def _rerouted(graph: Graph, path: Path, rng: np.random.Generator) -> tuple[int, Integers]:
    """Return where a window begins, and all ways through it: moves (n, length) in place of those there."""
    # with m moves a window of l turns has up to m^l ways: as many as five quarter turns give, at most
    longest = max(2, int(math.log(_WAYS) / math.log(len(graph.moves))))
    length = min(int(rng.choice(_WINDOW)), longest, len(path.moves))
    start = int(rng.integers(len(path.moves) - length + 1))
    nodes = graph.walk(path.home, path.moves)
    ways = _ways(graph, nodes[start], nodes[start + length], length)
    return start, np.array(ways)


def _ways(graph: Graph, start: int, end: int, length: int) -> list[tuple[int, ...]]:
    ways: list[tuple[tuple[int, ...], int]] = [((), start)] if graph.distance[start, end] <= length else []
    for left in range(length - 1, -1, -1):
        ways = [
            ((*moves, move), int(to))
            for moves, node in ways
            for move, to in enumerate(graph.edges[node])
            if to >= 0 and graph.distance[to, end] <= left
        ]
    return [moves for moves, _ in ways]


def _cost(graph: Graph, path: Path, start: int, ways: Integers, weight: Array) -> Array:
    """Return worst plus a tenth of the rms ratio, shape (n,): the tenth leads where the worst is flat."""
    count, length = ways.shape
    nodes = graph.walk(path.home, path.moves)
    before = stretch_of(graph, path.home, path.moves[:start], rest=True)
    node = np.full(count, nodes[start])
    stretch = before.map(lambda part: np.broadcast_to(part, (count, *part.shape)))
    for moves in ways.T:
        stretch = compose(stretch, graph.segments[graph.node_attitude[node], moves])
        node = graph.edges[node, moves]
    rest = path.moves[start + length :]
    if rest:
        stretch = compose(stretch, stretch_of(graph, nodes[start + length], rest, rest=False))
    ratio = scaled_variances(stretch.information) * weight
    return np.asarray(np.sqrt(ratio.max(axis=1)) + 0.1 * np.sqrt(ratio.mean(axis=1)))
