"""Are the six axes the ones they are taken for? Gyros against accelerometers, and both against the turns made.

Over a turn with gyro increments r (body axes, turned angle) the direction of up must go from u to R(r)^T u. Of
the 48 ways to exchange and reverse three axes only the right one does so at every turn of a scheme that moves all
three; the turns' axes then tell whether it is the gyros, the accelerometers, or the whole unit.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from bench.analysis.calibration._conventions import AXES, rotation, signed_permutations
from bench.analysis.calibration._navigation import Increments, Track
from bench.analysis.calibration._schedule import Schedule
from drivers.base.arrays import Array
from drivers.base.errors import RecordError

_ANGLE_DEG = 5.0
_CONSEQUENCE = "the estimate would put the exchange into scale factors and angles, and diverge"


def require_axis_order(
    data: Increments, track: Track, resting: NDArray[np.bool_], schedule: Schedule | None, latitude_deg: float
) -> None:
    """Raise RecordError naming how gyro or accelerometer axes are exchanged or reversed, if they are.

    A record that no exchange explains is left to the checks that follow.
    """
    turns, ups = _turns_and_ups(data, track, resting)
    if not len(turns) or _misfit_deg(np.eye(3), turns, ups) < _ANGLE_DEG:
        if schedule is not None and len(turns) == len(schedule.moves):
            _require_mounting(turns, ups, schedule)
        return
    fits = [exchange for exchange in _exchanges() if _misfit_deg(exchange, turns, ups) < _ANGLE_DEG]
    if len(fits) != 1:
        return
    where, matrix = _culprit(fits[0], turns, schedule)
    if where == "accelerometers":
        # Turns do not tell up from down; Earth rate does.
        first = int(np.argmin(resting)) * round(track.interval_s / data.period_s)
        vertical = float(data.angle_rad[:first].mean(axis=0) @ (matrix @ ups[0]))
        matrix = matrix if vertical * latitude_deg > 0.0 else -matrix
    kind = "reversed" if np.count_nonzero(np.diag(matrix)) == 3 else "exchanged"
    hand = " (left-handed)" if np.linalg.det(matrix) < 0 else ""
    raise RecordError(
        f"the axes of the {where} are {kind}{hand}",
        where="first turns of the record",
        found=", ".join(_described(matrix, at) for at in range(3)),
        expected="x, y, z of gyros and accelerometers right-handed and the same",
        remedy=f"correct axes and signs in the frame description or the wiring; {_CONSEQUENCE}",
    )


def _culprit(exchange: Array, turns: Array, schedule: Schedule | None) -> tuple[str, Array]:
    """Return whose axes are to blame and how true axes arrive; without the scheme's turns the gyros are named."""
    if schedule is not None and len(turns) == len(schedule.moves):
        if _like(turns, schedule):
            return "accelerometers", exchange.T
        if not _like(turns @ exchange.T, schedule):
            whole = [axes for axes in _exchanges() if _like(turns @ axes.T, schedule)]
            if whole:
                return "gyros and accelerometers", whole[0]
    return "gyros", exchange


def _require_mounting(turns: Array, ups: Array, schedule: Schedule) -> None:
    """Raise RecordError if the whole unit sits another way than the scheme has it."""
    if _like(turns, schedule):
        return
    wanted = _wanted(schedule)
    sizes = np.abs(np.linalg.norm(turns, axis=1) - np.linalg.norm(wanted, axis=1))
    if np.degrees(sizes.max()) > _ANGLE_DEG:
        return  # a turn that is missing or short has its own words
    for exchange in _exchanges():
        if np.degrees(np.linalg.norm(turns @ exchange.T - wanted, axis=1).max()) < _ANGLE_DEG:
            up = ups[0]
            axis = int(np.argmax(np.abs(up)))
            raise RecordError(
                "the unit is mounted another way than the scheme has it"
                if np.linalg.det(exchange) > 0
                else "the unit's axes are left-handed",
                where="all turns of the record",
                found=", ".join(_described(exchange, at) for at in range(3))
                + f"; {'+' if up[axis] > 0 else '-'}{AXES[axis]} up at the start",
                expected=f"{schedule.up_axes()[0]} up at the start and turns {schedule.moves[0]}, ...",
                remedy="mount it as the procedure said, or correct axes and signs in the frame description",
            )


def _turns_and_ups(data: Increments, track: Track, resting: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return rotation vectors (n, 3) of the turns between rests, and up in b (n + 1, 3) at the rests."""
    count = len(resting)
    angle, force = data.sums(round(track.interval_s / data.period_s), count)
    edges = np.flatnonzero(np.diff(resting.astype(int)))
    turns, ups, begin = [], [], 0
    for start, end in itertools.pairwise([*edges[0::1], count - 1]):
        if resting[start] and not resting[start + 1]:
            turns.append(angle[start + 1 : end + 1].sum(axis=0))
            ups.append(force[begin : start + 1].mean(axis=0))
        else:
            begin = start + 1
    ups.append(force[begin:].mean(axis=0))
    up = np.array(ups[: len(turns) + 1])
    return np.array(turns).reshape(-1, 3), up / np.linalg.norm(up, axis=1)[:, None]


def _exchanges() -> list[Array]:
    """Return the 48 signed permutations, the identity left out."""
    return [matrix.T for matrix in signed_permutations() if not np.array_equal(matrix, np.eye(3))]


def _misfit_deg(exchange: Array, turns: Array, ups: Array) -> float:
    """Return the largest angle between up after a turn and where the gyros, exchanged, take it."""
    worst = 0.0
    for turn, before, after in zip(turns @ exchange.T, ups[:-1], ups[1:], strict=True):
        size = float(np.linalg.norm(turn))
        if size < 1e-3:
            continue
        moved = rotation(turn / size, np.array([size]))[0].T @ before
        worst = max(worst, math.degrees(math.acos(float(np.clip(moved @ after, -1.0, 1.0)))))
    return worst


def _wanted(schedule: Schedule) -> Array:
    wanted = np.zeros((len(schedule.moves), 3))
    for row, move in zip(wanted, schedule.moves, strict=True):
        row[move.axis] = math.radians(move.angle_deg)
    return wanted


def _like(turns: Array, schedule: Schedule) -> bool:
    return bool(np.degrees(np.linalg.norm(turns - _wanted(schedule), axis=1).max()) < _ANGLE_DEG)


def _described(matrix: Array, row: int) -> str:
    column = int(np.argmax(np.abs(matrix[row])))
    return f"{AXES[row]} arrives as {'-' if matrix[row, column] < 0 else ''}{AXES[column]}"
