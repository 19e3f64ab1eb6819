"""The second look: effects that matter between their grid's points, the others at their best points only.

Shapes (lags, thresholds) of a set's effects move together with all amplitudes by Gauss-Newton steps on the
whitened data, with difference quotients: the separable least squares of Golub and Pereyra (SIAM J. Numer. Anal.
10, 1973).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from bench.analysis.gap._evidence import SetPosterior
from bench.analysis.gap._generic import FreeCurve
from drivers.base.arrays import Array
from simulators.effects import Variant

_KEPT = 3
"""Grid points of each effect that are kept for the second look."""
_STEPS = 12
_LEAST_GAIN, _GAIN = 0.05, 0.5
"""Chi-square that a step has to gain to be made, and to be followed by another. A small gain beside effects that
do nearly the same is a large one without them; none at all says nothing of where a shape is.
"""
_QUOTIENT = 0.05
"""Part of the distance between grid points over which a slope is taken."""
_SHORTER = (1.0, 0.3, 0.1, 0.03)
Gram = Callable[[Sequence[Variant]], Array]
"""Weighted products of [data, nominal columns, variants' columns], nominal columns projected out."""


def best_of_each(posterior: SetPosterior) -> list[int]:
    """Return the candidates worth keeping: of each effect those in its best sets."""
    highest: dict[int, float] = {}
    for members, value in posterior.log_evidence.items():
        for member in members:
            highest[member] = max(value, highest.get(member, value))
    by_effect: dict[str, list[int]] = {}
    for each in sorted(highest, key=lambda index: -highest[index]):
        by_effect.setdefault(posterior.candidates[each].effect, []).append(each)
    return sorted(index for each in by_effect.values() for index in each[:_KEPT])


def sets_of_note(posterior: SetPosterior, within: float, most: int) -> list[frozenset[int]]:
    """Return the best sets with catalogue effects, at their best shapes: `most` without free curves, one with.

    Their evidence is close to that of the best of their kind.
    """
    best = posterior.best_variants()
    known = [names for names in best if names - posterior.curves]
    ranked = sorted(known, key=lambda names: -posterior.log_evidence[best[names]])
    curved = [names for names in ranked if names & posterior.curves]
    result = []
    for own, count in (([names for names in ranked if names not in curved], most), (curved, 1)):
        result += [
            best[names]
            for names in own[:count]
            if posterior.log_evidence[best[names]] > posterior.log_evidence[best[own[0]]] - within
        ]
    return result


def between_grid_points(variants: Sequence[Variant], gram: Gram) -> list[Variant]:
    """Return the variants of one set moved to where their shapes fit best together."""
    now = list(variants)
    system = gram(now)
    cost = _left(system, range(1, len(system)))
    for _ in range(_STEPS):
        moves = _moves(now, gram)
        if not moves:
            break
        for part in _SHORTER:
            moved = [_moved(each, move, part) for each, move in zip(now, moves, strict=True)]
            system = gram(moved)
            left = _left(system, range(1, len(system)))
            if left < cost - _LEAST_GAIN:
                break
        else:
            break
        gained, cost, now = cost - left, left, moved
        if gained < _GAIN:
            break
    return now


def _moves(now: Sequence[Variant], gram: Gram) -> list[Mapping[str, float]]:
    """Return the Gauss-Newton step of every shape of every variant; nothing where none has a shape."""
    steps = [_spacing(each) for each in now]
    keys = [(k, key) for k, step in enumerate(steps) for key in step]
    if not keys:
        return []
    shifted = [
        _moved(now[k], {key: sign * _QUOTIENT * steps[k][key]}, 1.0)
        for k, key in keys
        for sign in (-1.0, 1.0)
    ]
    system = gram([*now, *shifted])
    sizes = [len(each.effect.parameters) for each in now]
    starts = np.cumsum([1, *sizes])
    values = _solved(system, range(1, int(starts[-1])))
    # columns of slopes: (columns at + less columns at -) times the amplitudes
    combine = np.zeros((int(starts[-1]) + len(keys), len(system)))
    combine[: int(starts[-1]), : int(starts[-1])] = np.eye(int(starts[-1]))
    at = int(starts[-1])
    for index, (k, key) in enumerate(keys):
        own = values[int(starts[k]) - 1 : int(starts[k]) - 1 + sizes[k]]
        width = float(shifted[2 * index + 1].shape[key]) - float(shifted[2 * index].shape[key])
        combine[int(starts[-1]) + index, at : at + sizes[k]] = -own / max(width, 1e-12)
        combine[int(starts[-1]) + index, at + sizes[k] : at + 2 * sizes[k]] = own / max(width, 1e-12)
        at += 2 * sizes[k]
    limits = [_limits(now[k], key, steps[k][key]) for k, key in keys]
    low = np.array([-np.inf] * (int(starts[-1]) - 1) + [low for low, _ in limits])
    high = np.array([np.inf] * (int(starts[-1]) - 1) + [high for _, high in limits])
    found = _solved_within(combine @ system @ combine.T, low, high)[int(starts[-1]) - 1 :]
    result: list[dict[str, float]] = [{} for _ in now]
    for (k, key), move in zip(keys, found.tolist(), strict=True):
        result[k][key] = move
    return list(result)


def _limits(variant: Variant, key: str, step: float) -> tuple[float, float]:
    """Return how far a shape may move down and up at once: by its grid's spacing, inside the grid."""
    grid, at = variant.effect.grids[key], float(variant.shape[key])
    return max(-step, grid[0] - at), min(step, grid[-1] - at)


def _spacing(variant: Variant) -> dict[str, float]:
    """Return the distance between grid points about a variant, for every shape that moves; a curve's do not."""
    result: dict[str, float] = {}
    if isinstance(variant.effect, FreeCurve) and not variant.effect.local:
        return result
    for key in variant.effect.moving:
        grid = variant.effect.grids[key]
        near = int(np.argmin(np.abs(np.array(grid) - float(variant.shape[key]))))
        result[key] = grid[min(near + 1, len(grid) - 1)] - grid[max(near - 1, 0)]
        result[key] *= 0.5 if 0 < near < len(grid) - 1 else 1.0
    return result


def _moved(variant: Variant, move: Mapping[str, float], part: float) -> Variant:
    """Return a variant with its shapes moved by a part of a step, inside the grid."""
    shape = {key: float(value) for key, value in variant.shape.items()}
    for key, step in move.items():
        grid = variant.effect.grids[key]
        shape[key] = min(max(shape[key] + part * step, grid[0]), grid[-1])
    return Variant(variant.effect, shape)


def _solved(system: Array, at: Sequence[int]) -> Array:
    inner = system[np.ix_(at, at)]
    scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    normal = inner / np.outer(scale, scale) + 1e-6 * np.eye(len(scale))
    return np.asarray(np.linalg.solve(normal, system[np.array(at), 0] / scale) / scale)


def _solved_within(system: Array, low: Array, high: Array) -> Array:
    """Return the values between two bounds that leave least, (k,); `system` (1 + k, 1 + k) has the data first.

    Bounded-variable least squares (Stark and Parker, Comput. Stat. 10, 1995) of a root of the products. What
    rounding leaves of a column that does nothing stays 0.
    """
    from scipy.optimize import lsq_linear

    squares = np.diag(system)[1:]
    free = (low < high) & (squares > 0.0)
    values = np.zeros(len(squares))
    scale = np.sqrt(squares[free])
    at = 1 + np.flatnonzero(free)
    powers, ways = np.linalg.eigh(system[np.ix_(at, at)] / np.outer(scale, scale))
    root = np.sqrt(np.maximum(powers, 0.0) + 1e-6)
    target = ways.T @ (system[at, 0] / scale) / root
    inside = lsq_linear(root[:, None] * ways.T, target, (low[free] * scale, high[free] * scale), "bvls")
    values[free] = np.clip(inside.x / scale, low[free], high[free])
    return values


def _left(system: Array, at: Sequence[int]) -> float:
    return float(system[0, 0] - system[0, np.array(at)] @ _solved(system, at))
