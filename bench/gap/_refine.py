"""The second look: effects that matter between their grid's points, the others at their best points only."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product

from bench.gap._evidence import SetPosterior
from bench.gap._generic import PREFIX
from simulators.effects import Variant

_KEPT = 3
"""Grid points of each effect that are kept for the second look."""
_PARTS = (-0.5, -0.25, 0.0, 0.25, 0.5)
"""Steps between neighbouring grid points at which an effect is looked at again."""
_MOST = 27


def best_of_each(posterior: SetPosterior) -> list[int]:
    """Return the candidates worth keeping: of each effect those in its best sets."""
    highest: dict[int, float] = {}
    for members, value in posterior.log_evidence.items():
        for each in members:
            highest[each] = max(value, highest.get(each, value))
    by_effect: dict[str, list[int]] = {}
    for each in sorted(highest, key=lambda index: -highest[index]):
        by_effect.setdefault(posterior.candidates[each].effect, []).append(each)
    return sorted(index for each in by_effect.values() for index in each[:_KEPT])


def members_of_note(posterior: SetPosterior, sets: Iterable[frozenset[int]]) -> list[int]:
    """Return the catalogue's members of some sets, in order of appearance."""
    members = dict.fromkeys(each for one in sets for each in sorted(one))
    return [each for each in members if not posterior.candidates[each].effect.startswith(PREFIX)]


def between_grid_points(variants: Sequence[Variant]) -> list[Variant]:
    """Return variants around each of `variants`, up to half a grid step away in every shape parameter."""
    fresh: dict[tuple[str, tuple[float, ...]], Variant] = {}
    for variant in variants:
        grids = {key: sorted({float(shape[key]) for shape in variant.effect.shapes}) for key in variant.shape}
        choices = [_around(float(variant.shape[key]), grid) for key, grid in grids.items()]
        if len(grids) > 2:
            choices = [each[::2] for each in choices]
        for values in list(product(*choices))[:_MOST]:
            shape = dict(zip(grids, values, strict=True))
            if shape != dict(variant.shape):
                fresh[variant.effect.name, values] = Variant(variant.effect, shape)
    return list(fresh.values())


def _around(value: float, grid: Sequence[float]) -> list[float]:
    if len(grid) == 1:
        return [value]
    at = grid.index(value)
    below = value - grid[at - 1] if at else 0.0
    above = grid[at + 1] - value if at + 1 < len(grid) else 0.5 * (value - grid[at - 1])
    return [
        value + part * (above if part > 0.0 else below)
        for part in _PARTS
        if part == 0.0 or (above if part > 0 else below) > 0.0
    ]
