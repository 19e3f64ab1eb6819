"""Where the unit rests and where it turns, found from gyros and accelerometers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.statistics import stretches
from drivers.base.arrays import Array

_WINDOW_S, _FEWEST = 0.5, 8
_SHAKEN = 3.0
"""Times the quiet windows' scatter from which on a window is not at rest."""
_LEVEL_DPS = 0.5
"""Rate off the level at rest that is turning, at least; half the scatter of a coarser gyro's samples."""
_LAG_S = 0.05
_SWUNG, _STEPS, _STEP_WINDOWS = 2.0, 4.0, 200
"""Scatter over that of samples 50 ms apart from which on a window swings; steps of the grid that it must have."""
_SHORTEST = 2
"""Windows of the shortest stretch that is told."""
_ONSET = 3.0
"""Times the scatter of samples by which the level changes where a turn begins or ends; in a drift it does not."""


@dataclass(frozen=True)
class Turn:
    """A stretch in which the unit turns: s from the first row, axis that turns most, its mean rate and angle.

    In the gyros' units (deg/s and deg where these are known).
    """

    start_s: float
    stop_s: float
    axis: str
    rate: float
    angle: float


@dataclass(frozen=True, eq=False)
class Motion:
    """`rest`, shape (n,): samples taken for rest. Stretches (start, stop) of it in s, turns, and s of shaking.

    `judged`: without gyros and three accelerometers nothing is known, and everything counts as rest. `by_gyros`
    False: told by accelerometers alone, which see rests and not how the unit turns between them.
    """

    rest: NDArray[np.bool_]
    rests_s: tuple[tuple[float, float], ...]
    turns: tuple[Turn, ...]
    shaken_s: float
    judged: bool = True
    by_gyros: bool = True


def motion_of(
    gyros: Sequence[Array], axes: Sequence[str], heavy: Sequence[Array], count: int, per_s: float, dps: bool
) -> Motion:
    """Tell rest from turning by windows of half a second.

    `gyros` and `heavy` (accelerometers), each (n,), on one grid; `dps`: the gyros' unit is known. A window
    rests if it scatters no more than the quietest fifth by three times and its mean is near the level of the
    slowest quiet windows: of a log that turns at one rate all the time, that rate is taken for the bias. Without
    gyros a window of three accelerometers rests if it is as quiet and its mean is that of a neighbour.
    """
    length = max(_FEWEST, round(_WINDOW_S * per_s))
    windows = count // length
    if (not gyros and len(heavy) < 3) or windows < 4:
        return Motion(np.ones(count, np.bool_), (), (), 0.0, judged=False)
    blocks = [values[: windows * length].reshape(windows, length) for values in (*gyros, *heavy)]
    mean, scatter, middle = (
        np.stack([of(block, axis=1) for block in blocks], axis=1) for of in (np.mean, np.std, np.median)
    )
    whole = np.isfinite(scatter).all(axis=1)
    if whole.sum() < 4:
        return Motion(np.ones(count, np.bool_), (), (), 0.0, judged=False)
    usual = np.maximum(np.nanmedian(scatter, axis=0) * 1e-3, np.nanquantile(scatter, 0.2, axis=0))
    quiet = (scatter <= _SHAKEN * np.maximum(usual, 1e-15)).all(axis=1)
    if not gyros:
        return _by_accelerometers(middle, quiet, whole, np.maximum(usual, 1e-15), count, length, per_s)
    mean, scatter, middle = (part[:, : len(gyros)] for part in (mean, scatter, middle))
    quiet &= ~_swung(blocks[: len(gyros)], scatter, max(1, round(_LAG_S * per_s))).any(axis=1)
    if not quiet.any():
        return Motion(np.zeros(count, np.bool_), (), (), 0.0)
    noise = np.median(scatter[quiet], axis=0)
    size = np.sqrt((middle**2).sum(axis=1))
    level = np.median(middle[quiet & (size <= np.quantile(size[quiet], 0.25))], axis=0)
    # A gyro whose unit is not known tells turning by its own scatter only.
    edge = np.maximum(0.5 * noise, _LEVEL_DPS) if dps else np.maximum(3.0 * noise, 1e-12)
    turning = np.asarray((np.abs(mean - level) > edge).any(axis=1), np.bool_)
    onset = (np.abs(np.diff(middle, axis=0)) > _ONSET * noise).any(axis=1)
    for start, stop in stretches(turning):
        turning[start:stop] = any(onset[max(border - 2, 0) : border + 2].any() for border in (start, stop))
    rest = np.asarray(quiet & ~turning, np.bool_)
    for start, stop in stretches(~rest & ~turning):
        rest[start:stop] = stop - start == 1  # a single window that scatters has an outlier in it
    seconds = length / per_s
    turns = []
    for start, stop in _long(turning):
        angles = (mean[start:stop] - level).sum(axis=0) * seconds
        most = int(np.argmax(np.abs(angles)))
        rate = float(angles[most]) / ((stop - start) * seconds)
        turns.append(Turn(start * seconds, stop * seconds, axes[most], rate, float(angles[most])))
    rests = tuple((start * seconds, stop * seconds) for start, stop in _long(rest))
    mask = np.full(count, rest.all())
    mask[: windows * length] = np.repeat(rest, length)
    shaken = ~rest & ~turning & np.isfinite(mean).all(axis=1)  # neither in a gap
    return Motion(mask, rests, tuple(turns), float(shaken.sum() * seconds))


def _by_accelerometers(
    middle: Array, quiet: NDArray[np.bool_], whole: NDArray[np.bool_], usual: Array, count: int, length: int,
    per_s: float,
) -> Motion:  # fmt: skip
    """Return the rests of windows with medians `middle` (windows, 3), told which are quiet and which complete."""
    same = (np.abs(np.diff(middle, axis=0)) <= _SHAKEN * usual).all(axis=1)
    rest = quiet & (np.append(same, False) | np.insert(same, 0, False))
    for start, stop in stretches(~rest):
        inside = start > 0 and stop < len(rest) and stop - start == 1  # one with an outlier in it
        rest[start] |= inside and bool((np.abs(middle[stop] - middle[start - 1]) <= _SHAKEN * usual).all())
    seconds = length / per_s
    rests = tuple((start * seconds, stop * seconds) for start, stop in _long(rest))
    mask = np.full(count, rest.all())
    mask[: len(rest) * length] = np.repeat(rest, length)
    return Motion(mask, rests, (), float((~rest & whole).sum() * seconds), by_gyros=False)


def _swung(blocks: Sequence[Array], scatter: Array, lag: int) -> NDArray[np.bool_]:
    """Return windows (windows, gyros) that vary by far more than from sample to sample: swings, not noise.

    Windows that scatter by few steps of the gyro's grid tell nothing.
    """
    rough = np.stack([np.sqrt(0.5 * ((b[:, lag:] - b[:, :-lag]) ** 2).mean(axis=1)) for b in blocks], axis=1)
    step = np.array([_step(block) for block in blocks])
    return np.asarray((scatter > _SWUNG * rough) & (scatter > _STEPS * step), np.bool_)


def _step(values: Array) -> float:
    apart = np.diff(np.unique(values[:_STEP_WINDOWS]))
    return float(apart[apart > 0.0].min(initial=np.inf)) if len(apart) else 0.0


def _long(mask: NDArray[np.bool_]) -> list[list[int]]:
    return [run for run in stretches(mask).tolist() if run[1] - run[0] >= _SHORTEST]
