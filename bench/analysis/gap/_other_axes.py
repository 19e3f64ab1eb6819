"""What the other axes of an IMU tell of the one under test: attitude, specific force, rates, moves."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.statistics import on_grid, stretches
from bench.analysis.gap._data import interpolated
from bench.analysis.gap._rows import Steps
from bench.analysis.look import Motion, level_steps, motion_of
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS, STANDARD_GRAVITY_MPS2, earth_rate_north_dph

AXES = "xyz"
_LEAST_TURN_DEG = 1.0
"""Change of attitude between two rests from which on the unit was moved between them."""
_SAME_STEPS = 64
"""Steps by which two axes may tell one tilt apart."""
_LEAST_ATTITUDES = 6
"""Attitudes from which on a bias that depends on them is more than as many biases: twice the parameters."""
_MOST_MOVING = 0.5
_FEW = 1.4
"""Times the rms of what nobody knows that is allowed for: rests are few, and noise is none of steps."""
_GRAVITY = 0.1
"""Part by which the specific force at rest may differ from gravity and tell the attitude."""


@dataclass(frozen=True, eq=False)
class OtherAxes:
    """Of n steps: specific force (3, n) in g and rates of the other gyros (2, n) in deg/h, own axis first, None
    where they were not measured; elevation of the axis (n,) by the force, None where that is not gravity.

    `moving` (n,): steps in which somebody moved the unit. `unknown_dph`: rms of the part of Earth's rate that
    nobody knows, another one in each rest, and `rest_s` how long one lasts. `apart_dph` (n,): where
    nothing can be compared between rests, the mean of each less that of all. `remarks` say so.
    """

    force_g: Array | None
    cross_rate_dph: Array | None
    elevation_deg: Array | None
    moving: NDArray[np.bool_]
    remarks: tuple[str, ...]
    unknown_dph: float = 0.0
    rest_s: float = 0.0
    apart_dph: Array | float = 0.0


def other_axes(
    columns: Mapping[str, Array], steps: Steps, axis: str, *, latitude_deg: float, guided: bool
) -> OtherAxes:
    """Return what a log's columns (m,) tell of an axis: `accelerometer_x`, ... in m/s^2, `rate_x`, ... in deg/s.

    `guided`: a table's angle or rate, a simulation or a column of elevation says how the unit moved. If nothing
    does, rests are found in the rows, each has one attitude, and what lies between them is moving.
    """
    ahead = AXES[AXES.index(axis) :] + AXES[: AXES.index(axis)]
    forces = _means(columns, [f"accelerometer_{each}" for each in ahead], steps)
    rates = _means(columns, [f"rate_{each}" for each in ahead[1:]], steps)
    force_g = None if forces is None else forces / STANDARD_GRAVITY_MPS2
    cross_dph = None if rates is None else DPH_PER_DPS * rates
    still = OtherAxes(force_g, cross_dph, None, np.zeros(steps.count, np.bool_), ())
    if guided:
        return still
    still = replace(still, cross_rate_dph=None)  # what turns it by hand turns the axis itself as well
    output_dph = DPH_PER_DPS * steps.means(columns["output"])
    motion, place = _motion(columns, steps, axis, heavy=force_g is not None)
    if not motion.judged:
        return still
    if force_g is None:
        return _by_gyros(still, output_dph, motion, steps)
    rests = _rests(motion, place, steps)
    if not rests.any():
        return replace(still, remarks=("nothing in it rests: its attitude is not known",))
    return _by_forces(still, force_g, output_dph, rests, steps, latitude_deg)


def _by_gyros(still: OtherAxes, output_dph: Array, motion: Motion, steps: Steps) -> OtherAxes:
    """Return what gyros alone tell: in which steps the unit turns; how it lies after that nobody knows."""
    middle_s = steps.edges_s[:-1] + 0.5 * steps.period_s
    moving = np.zeros(steps.count, np.bool_)
    for turn in motion.turns:
        moving |= (middle_s > turn.start_s - steps.period_s) & (middle_s < turn.stop_s + steps.period_s)
    if not moving.any():
        return still
    if moving.mean() > _MOST_MOVING:
        return replace(
            still, remarks=("it turns most of the time, as its gyros say, and nothing says by what",)
        )
    times = len(motion.turns)
    remark = (
        f"turned {times} time{'s' if times > 1 else ''}, as its gyros say, and nothing says by what: the turns "
        "are left out; how it lies after them is not known: a bias for each rest"
    )
    parts = [(low, high) for low, high in stretches(~moving).tolist()]
    return replace(still, moving=moving, remarks=(remark,), apart_dph=_apart(output_dph, parts))


def _by_forces(
    still: OtherAxes,
    force_g: Array,
    output_dph: Array,
    rests: NDArray[np.bool_],
    steps: Steps,
    latitude_deg: float,
) -> OtherAxes:
    """Return what the accelerometers tell of a unit that nothing else says how it lies."""
    tilts = _tilts(force_g, steps, rests)
    parts = _cut_at(stretches(rests), [place for place, _ in tilts])
    levels = np.stack([force_g[:, low:high].mean(axis=1) for low, high in parts], axis=1)
    size = np.linalg.norm(levels, axis=0)
    if np.abs(size - 1.0).max() > _GRAVITY:
        remark = (
            f"the specific force at rest is {size.min():.3g} to {size.max():.3g} g, not gravity: its attitude is "
            "not known"
        )
        return replace(still, remarks=(remark,))
    level = levels / size
    turned_deg = np.degrees(np.arccos(np.clip((level[:, 1:] * level[:, :-1]).sum(axis=0), -1.0, 1.0)))
    elevations = np.degrees(np.arcsin(level[0]))
    starts = [low for low, _ in parts]
    owner = np.maximum(np.searchsorted(starts, np.arange(steps.count), side="right") - 1, 0)
    told = tuple(
        f"its accelerometers step at {at * steps.period_s:.0f} s: it tilted by {deg:.2g} deg"
        for at, deg in tilts
    )
    found = replace(still, force_g=levels[:, owner], elevation_deg=elevations[owner], remarks=told)
    moves = turned_deg[turned_deg >= _LEAST_TURN_DEG]
    if not len(moves):
        return found
    remark = (
        f"moved {len(moves)} time{'s' if len(moves) > 1 else ''}, by up to {moves.max():.0f} deg, as its "
        "accelerometers say: the moves are left out; where its axes point after them is not known, nor which "
        "part of Earth's level rate they feel"
    )
    level_part = math.sqrt(0.5 * float((np.cos(np.radians(elevations)) ** 2).mean()))
    unknown_dph = _FEW * earth_rate_north_dph(latitude_deg) * level_part
    if len(moves) + 1 < _LEAST_ATTITUDES:
        remark += f"; {len(moves) + 1} attitudes are too few to tell what depends on attitude: a bias each"
        return replace(
            still, force_g=None, moving=~rests, remarks=(remark, *told), apart_dph=_apart(output_dph, parts)
        )
    rest_s = float(rests.sum()) * steps.period_s / len(parts)
    return replace(found, moving=~rests, remarks=(remark, *told), unknown_dph=unknown_dph, rest_s=rest_s)


def _apart(output_dph: Array, parts: Sequence[tuple[int, int]]) -> Array:
    """Return the mean of an output (n,) over each of its rests, less that over all of them; zero elsewhere."""
    rests = np.concatenate([output_dph[low:high] for low, high in parts])
    result = np.zeros(len(output_dph))
    for low, high in parts:
        result[low:high] = np.nanmean(output_dph[low:high]) - np.nanmean(rests)
    return result


def _tilts(force_g: Array, steps: Steps, rests: NDArray[np.bool_]) -> list[tuple[int, float]]:
    """Return steps of the specific force (3, n) within the longest rest, in order: where, and the tilt in deg."""
    found: list[tuple[int, float]] = []
    for own in force_g:
        for at_s, size_g in level_steps(own, rests, 1.0 / steps.period_s):
            found.append((round(at_s / steps.period_s), math.degrees(abs(size_g))))
    found.sort(key=lambda tilt: -tilt[1])
    kept: list[tuple[int, float]] = []
    for at, deg in found:  # the same tilt steps in two axes
        if deg < _LEAST_TURN_DEG and all(abs(at - other) > _SAME_STEPS for other, _ in kept):
            kept.append((at, deg))
    return sorted(kept)


def _cut_at(parts: NDArray[np.int64], places: Sequence[int]) -> list[tuple[int, int]]:
    """Return stretches (k, 2) cut at places within them."""
    result = []
    for low, high in parts.tolist():
        edges = [low, *(place for place in sorted(places) if low < place < high), high]
        result += list(pairwise(edges))
    return result


def _means(columns: Mapping[str, Array], names: Sequence[str], steps: Steps) -> Array | None:
    """Return means of columns by step, (len(names), n), single gaps bridged; None where one has no values."""
    if any(name not in columns for name in names):
        return None
    means = np.stack([interpolated(steps.means(columns[name])) for name in names])
    return None if np.isnan(means).any() else means


def _motion(
    columns: Mapping[str, Array], steps: Steps, axis: str, *, heavy: bool
) -> tuple[Motion, NDArray[np.int64]]:
    """Return rests and turns found in the rows, and the place of each row on their grid."""
    gyros = {name: columns.get(f"rate_{name}") for name in AXES} | {axis: columns["output"]}
    named = {name: values for name, values in gyros.items() if values is not None}
    place = np.rint((steps.time_s - steps.time_s[0]) / steps.usual_s).astype(np.int64)
    forces = [on_grid(place, columns[f"accelerometer_{each}"]) for each in AXES] if heavy else []
    rates = [on_grid(place, values) for values in named.values()]
    return motion_of(rates, list(named), forces, len(rates[0]), 1.0 / steps.usual_s, dps=True), place


def _rests(motion: Motion, place: NDArray[np.int64], steps: Steps) -> NDArray[np.bool_]:
    """Return in which steps (n,) the unit rests, none beside a move: it may hold its first or its last rows."""
    own = steps.owner >= 0
    moved = np.zeros(steps.count)
    np.add.at(moved, steps.owner[own], ~motion.rest[place[own]])
    rests = moved == 0.0
    for low, high in stretches(rests).tolist():
        rests[low] &= low == 0
        rests[high - 1] &= high == steps.count
    return np.asarray(rests)
