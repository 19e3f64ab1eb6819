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
_SHORTEST = 2
"""Windows of the shortest stretch that is told."""
_ONSET = 6.0
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
    """`rest`, shape (n,): samples at rest. Stretches (start, stop) at rest in s, and turns; shaken for the rest.

    `judged`: without gyros nothing is known, and everything counts as rest.
    """

    rest: NDArray[np.bool_]
    rests_s: tuple[tuple[float, float], ...]
    turns: tuple[Turn, ...]
    shaken_s: float
    judged: bool = True


def motion_of(
    gyros: Sequence[Array], axes: Sequence[str], heavy: Sequence[Array], count: int, per_s: float, dps: bool
) -> Motion:
    """Tell rest from turning by windows of half a second.

    `gyros` and `heavy` (accelerometers), each (n,), on one grid; `dps`: the gyros' unit is known. A window rests
    if it scatters no more than the quietest fifth by three times and its mean is near the level of the slowest
    quiet windows: of a log that turns at one rate all the time, that rate is taken for the bias.
    """
    length = max(_FEWEST, round(_WINDOW_S * per_s))
    windows = count // length
    if not gyros or windows < 4:
        return Motion(np.ones(count, np.bool_), (), (), 0.0, judged=False)
    mean, scatter, middle = _windows(gyros, length, windows)
    quiet = _quiet(scatter)
    if heavy:
        quiet &= _quiet(_windows(heavy, length, windows)[1])
    if not quiet.any():
        quiet = scatter.sum(axis=1) <= np.nanquantile(scatter.sum(axis=1), 0.2)
    noise = np.median(scatter[quiet], axis=0)
    size = np.sqrt((middle**2).sum(axis=1))
    slow = quiet & (size <= np.quantile(size[quiet], 0.25))
    level = np.median(middle[slow], axis=0)
    # A gyro whose unit is not known tells turning by its own scatter only.
    edge = np.maximum(0.5 * noise, _LEVEL_DPS) if dps else np.maximum(3.0 * noise, 1e-12)
    turning = np.asarray((np.abs(mean - level) > edge).any(axis=1), np.bool_)
    onset = np.asarray((np.abs(np.diff(middle, axis=0)) > _ONSET * noise).any(axis=1), np.bool_)
    for start, stop in stretches(turning):
        ends = [onset[max(edge - 2, 0) : edge + 2].any() for edge in (start, stop)]
        turning[start:stop] = any(ends)
    rest = quiet & ~turning
    for start, stop in stretches(~rest & ~turning):
        rest[start:stop] = stop - start == 1  # a single window that scatters has an outlier in it
    seconds = length / per_s
    turns = []
    for start, stop in stretches(turning):
        if stop - start >= _SHORTEST:
            angles = (mean[start:stop] - level).sum(axis=0) * seconds
            most = int(np.argmax(np.abs(angles)))
            angle = float(angles[most])
            length_s = float(stop - start) * seconds
            turns.append(
                Turn(float(start) * seconds, float(stop) * seconds, axes[most], angle / length_s, angle)
            )
    rests = [
        (float(start) * seconds, float(stop) * seconds)
        for start, stop in stretches(rest)
        if stop - start >= _SHORTEST
    ]
    mask = np.zeros(count, np.bool_)
    mask[: windows * length] = np.repeat(rest, length)
    if rest.all():
        mask[:] = True
    return Motion(mask, tuple(rests), tuple(turns), float((~rest & ~turning).sum() * seconds))


def _windows(columns: Sequence[Array], length: int, windows: int) -> tuple[Array, Array, Array]:
    """Return mean, standard deviation and median of every window, (windows, columns) each; NaN over a gap."""
    blocks = [values[: windows * length].reshape(windows, length) for values in columns]
    mean, scatter, middle = (
        np.stack([of(block, axis=1) for block in blocks], axis=1) for of in (np.mean, np.std, np.median)
    )
    return mean, scatter, middle


def _quiet(scatter: Array) -> NDArray[np.bool_]:
    floor = np.nanquantile(scatter, 0.2, axis=0)
    usual = np.maximum(np.nanmedian(scatter, axis=0) * 1e-3, floor)
    return np.asarray((scatter <= _SHAKEN * np.maximum(usual, 1e-15)).all(axis=1))
