"""Calibration of an IMU that was turned by hand: gravity at every rest, and what turns between them add up to.

D. Tedaldi, A. Pretto, E. Menegatti, "A robust and easy to implement method for IMU calibration without external
equipments", ICRA 2014: no table says how the unit was turned. At rest the corrected specific force is as large as
gravity; from one rest to the next the integrated rates turn its direction. A turn of a known angle, as on a plain
turning table, gives the scale factor about an axis that gravity does not see turn (F. Ferraris, U. Grimaldi,
M. Parvis, "Procedure for effortless in-field calibration of three-axial rate gyro and accelerometers", 1995).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.calibration._compensation import ImuCompensation
from bench.analysis.calibration._conventions import (
    EPS,
    KA,
    KA_ELEMENTS,
    KG,
    NABLA,
    PARAMETER_NAMES,
    PARAMETERS,
)
from bench.analysis.common.attitude import whole_rotation
from bench.analysis.common.statistics import stretches
from drivers.base.arrays import Array
from drivers.base.constants import EARTH_RATE_RAD_S
from drivers.base.errors import RecordError

_MARGIN_S, _SHORTEST_S = 0.25, 0.5
"""Left out at both ends of a rest, and the least that must remain of it."""
_WINDOW_S, _QUIET = 0.5, (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 40.0)
"""Time over which scatter is taken, and how many times that of the quietest a rest may have."""
_FEWEST_RESTS = 10
"""The nine parameters of the accelerometers and one to see whether they fit."""
_APART_DEG = 5.0
"""Angle between two attitudes that count as two."""
_PRIOR_PART = 0.05
"""1 sigma of a scale factor's error, or of a misalignment in rad, before anything was seen."""
_SEEN = 0.5
"""Part of that up to which the record has told the parameter."""
_FLOOR_MPS2, _FLOOR_RAD = 2e-3, 1e-3
"""How well a rest by hand gives gravity's size and, over a turn, its direction, beside the noise."""
_NEAR_TURN = 0.15
"""Part by which a turn may differ from the angle that was told and be one of that angle."""
_TURN_SIGMA_DEG = 0.5


@dataclass(frozen=True, eq=False)
class HandRecord:
    """An IMU's samples at one rate: `rate_dps` and `force_mps2`, (n, 3) each, NaN where one is missing.

    `saturated` (n,): samples with a gyro at the end of its range.
    """

    unit_id: str
    period_s: float
    rate_dps: Array
    force_mps2: Array
    saturated: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class HandCalibration:
    """What a record turned by hand gives. `rms` are (before, after): of the specific force less gravity at rest,
    m/s^2, and of the angle between gravity as turned and as seen, deg; `angle_rms_deg` that of turns of a told
    angle (NaN without). `left_out`: turns with a gyro at the end of its range or a gap.
    """

    compensation: ImuCompensation
    rests: int
    turns: int
    left_out: int
    gravity_rms_mps2: tuple[float, float]
    direction_rms_deg: tuple[float, float]
    angle_rms_deg: tuple[float, float]


def calibrate_by_hand(
    record: HandRecord,
    *,
    gravity_mps2: float,
    turn_deg: float | None = None,
    runs: dict[str, str] | None = None,
) -> HandCalibration:
    """Return biases, scale factors and misalignments of gyros and accelerometers; K_2 is not seen and stays zero.

    `turn_deg`: the angle of those turns that are about as large. RecordError for fewer than ten rests, and for
    attitudes that do not tell the accelerometers' parameters apart.
    """
    windows = _windows(record, gravity_mps2)
    means, spread, rates = _rests(record, windows)
    if len(means) < _FEWEST_RESTS:
        raise RecordError(
            "too few rests to calibrate by",
            where=record.unit_id,
            found=f"{len(means)} of {_SHORTEST_S + 2.0 * _MARGIN_S:g} s or more",
            expected=f"at least {_FEWEST_RESTS}, in as many attitudes",
            remedy="turn the unit, hold it still for some seconds, and again, with each side up in turn",
        )
    _require_attitudes(means, record.unit_id)
    heavy, heavy_covariance = _accelerometers(means, spread, gravity_mps2)
    forces = _forces(heavy, means)
    eps = np.radians(rates.mean(axis=0))
    moves, left_out = _moves(record, windows)
    turning, turning_covariance, angles = _gyros(moves, forces, eps, turn_deg)
    parameters = np.zeros(24)
    first = PARAMETERS.start
    places = {name: np.arange(part.start, part.stop) - first for name, part in _PARTS.items()}
    parameters[places["eps"]], parameters[places["kg"]] = eps, turning
    parameters[places["nabla"]], parameters[places["ka"]] = heavy[:3], heavy[3:]
    covariance = np.zeros((24, 24))
    # of Earth's rate at each rest nobody knows which part an axis feels
    earth = EARTH_RATE_RAD_S / math.sqrt(3.0 * len(rates))
    scatter = np.radians(rates.std(axis=0, ddof=1)) / math.sqrt(len(rates))
    covariance[places["eps"], places["eps"]] = np.hypot(scatter, earth) ** 2
    covariance[np.ix_(places["kg"], places["kg"])] = turning_covariance
    own = np.concatenate((places["nabla"], places["ka"]))
    covariance[np.ix_(own, own)] = heavy_covariance
    sigma = np.sqrt(np.diag(covariance))
    prior = np.full(24, _PRIOR_PART)
    prior[places["nabla"]] *= gravity_mps2
    doubtful = [*places["nabla"], *places["kg"], *places["ka"]]
    unseen = [PARAMETER_NAMES[k] for k in doubtful if sigma[k] > _SEEN * prior[k]]
    declared = [f"not seen: {', '.join(unseen)}"] if unseen else []
    declared += ["turned by hand: K2 is not seen"]
    before, after = (
        float(np.sqrt(np.mean((np.linalg.norm(own, axis=1) - gravity_mps2) ** 2))) for own in (means, forces)
    )
    directions = tuple(
        _direction_rms_deg(moves, own, eps, kg) for own, kg in ((means, np.zeros(9)), (forces, turning))
    )
    compensation = ImuCompensation(
        record.unit_id,
        parameters=parameters,
        sigma=sigma,
        covariance=covariance,
        lever_m=np.zeros((2, 3)),
        lag_s=0.0,
        scheme="turned by hand",
        innovation_rms=after / max(before, 1e-12),
        declared=tuple(declared),
        runs=runs or {},
    )
    return HandCalibration(
        compensation,
        len(means),
        len(moves),
        left_out,
        (before, after),
        (directions[0], directions[1]),
        angles,
    )


_PARTS = {"eps": EPS, "nabla": NABLA, "kg": KG, "ka": KA}


@dataclass(frozen=True, eq=False)
class _Move:
    """A turn from one rest to the next: their numbers, and the rates in rad/s (k, 3) of all of it."""

    start: int
    stop: int
    period_s: float
    rate_rad_s: Array


def _windows(record: HandRecord, gravity_mps2: float) -> list[slice]:
    """Return the samples of the rests, without their ends.

    A hand holds still less well than a table. How much a rest may scatter is chosen as Tedaldi does: by how well
    the specific forces of the rests found fit gravity.
    """
    scatter = _scatter(record)
    found: list[tuple[float, list[slice]]] = []
    fewer: list[slice] = []
    for times in _QUIET:
        windows = _still(record, scatter < times)
        if len(windows) < _FEWEST_RESTS:
            fewer = max(fewer, windows, key=len)
            continue
        means, spread, _ = _rests(record, windows)
        left = (
            np.linalg.norm(_forces(_accelerometers(means, spread, gravity_mps2)[0], means), axis=1)
            - gravity_mps2
        )
        found.append((float((left**2).sum()) / (len(windows) - _FEWEST_RESTS + 1), windows))
    return min(found, key=lambda own: own[0])[1] if found else fewer


def _scatter(record: HandRecord) -> Array:
    """Return the scatter of a second about each sample over that of the quietest, the largest of all axes, (n,).

    Infinite where a sample is missing.
    """
    from scipy.ndimage import uniform_filter1d  # here: procedures load without scipy (decision 0021)

    width = max(round(_WINDOW_S / record.period_s), 4)
    values = np.concatenate((record.force_mps2, record.rate_dps), axis=1)
    missing = np.isnan(values).any(axis=1)
    filled = np.where(np.isnan(values), 0.0, values - np.nanmean(values, axis=0))
    mean = uniform_filter1d(filled, width, axis=0, mode="nearest")
    sigma = np.sqrt(np.maximum(uniform_filter1d(filled**2, width, axis=0, mode="nearest") - mean**2, 0.0))
    whole = uniform_filter1d(missing.astype(np.float64), width, mode="nearest") < 0.5 / width
    quiet = np.maximum(np.quantile(sigma[whole], 0.05, axis=0), 1e-12) if whole.any() else np.ones(6)
    return np.where(whole, (sigma / quiet).max(axis=1), np.inf)


def _still(record: HandRecord, still: NDArray[np.bool_]) -> list[slice]:
    """Return stretches that are still, their ends left out, those too short left out."""
    margin, shortest = round(_MARGIN_S / record.period_s), round(_SHORTEST_S / record.period_s)
    return [
        slice(low + margin, high - margin)
        for low, high in stretches(still).tolist()
        if high - low - 2 * margin >= shortest
    ]


def _rests(record: HandRecord, windows: Sequence[slice]) -> tuple[Array, Array, Array]:
    """Return mean specific force (k, 3) in m/s^2, 1 sigma of its size (k,), and mean rates (k, 3) in deg/s."""
    if not windows:
        return np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3))
    force = np.array([record.force_mps2[own].mean(axis=0) for own in windows])
    rate = np.array([record.rate_dps[own].mean(axis=0) for own in windows])
    spread = np.array(
        [record.force_mps2[own].std(axis=0).max() / math.sqrt(own.stop - own.start) for own in windows]
    )
    return force, np.hypot(spread, _FLOOR_MPS2), rate


def _require_attitudes(means: Array, where: str) -> None:
    directions = means / np.linalg.norm(means, axis=1, keepdims=True)
    apart: list[Array] = []
    for own in directions:
        if all(
            math.degrees(math.acos(min(max(float(own @ other), -1.0), 1.0))) > _APART_DEG for other in apart
        ):
            apart.append(own)
    if len(apart) < _FEWEST_RESTS - 1:
        raise RecordError(
            "too few attitudes to calibrate by",
            where=where,
            found=f"{len(apart)} that are {_APART_DEG:g} deg apart in {len(means)} rests",
            expected=f"at least {_FEWEST_RESTS - 1}",
            remedy="hold the unit with each of its sides up, and askew",
        )


def _lower(elements: Array) -> Array:
    matrix = np.zeros((3, 3))
    for value, (row, column) in zip(elements.tolist(), KA_ELEMENTS, strict=True):
        matrix[row, column] = value
    return matrix


def _forces(heavy: Array, means: Array) -> Array:
    """Return corrected specific forces (k, 3) by bias (3,) and K_a's six elements."""
    return np.asarray((means - heavy[:3]) @ np.linalg.inv(np.eye(3) + _lower(heavy[3:])).T)


def _accelerometers(means: Array, spread: Array, gravity_mps2: float) -> tuple[Array, Array]:
    """Return biases in m/s^2 and K_a's elements, (9,), and their covariance."""
    prior = np.concatenate((np.full(3, _PRIOR_PART * gravity_mps2), np.full(6, _PRIOR_PART)))

    def off(at: Array) -> Array:
        size = np.linalg.norm(_forces(at, means), axis=1)
        return np.concatenate(((size - gravity_mps2) / spread, at / prior))

    return _fitted(off, np.zeros(9), len(means))


def _fitted(off: Callable[[Array], Array], start: Array, rows: int) -> tuple[Array, Array]:
    """Return the least squares solution, and its covariance, larger where more is left than told."""
    from scipy.optimize import least_squares  # here: as above

    found = least_squares(off, start, x_scale="jac")
    left = found.fun[:rows]
    scale = max(1.0, float(left @ left) / max(rows - len(start), 1))
    return found.x, scale * np.linalg.inv(found.jac.T @ found.jac)


def _moves(record: HandRecord, windows: Sequence[slice]) -> tuple[list[_Move], int]:
    """Return the turns between neighbouring rests, and how many cannot be integrated."""
    moves, left_out = [], 0
    for number in range(len(windows) - 1):
        low = (windows[number].start + windows[number].stop) // 2
        high = (windows[number + 1].start + windows[number + 1].stop) // 2
        rates = record.rate_dps[low:high]
        if np.isfinite(rates).all() and not record.saturated[low:high].any():
            moves.append(_Move(number, number + 1, record.period_s, np.radians(rates)))
        else:
            left_out += 1
    return moves, left_out


def _true_rates(move: _Move, eps: Array, kg: Array) -> Array:
    """Return a turn's rates, rad/s (k, 3), corrected by biases and K_g's elements, column by column."""
    matrix = np.eye(3) + kg.reshape(3, 3).T
    return np.asarray((move.rate_rad_s - eps) @ np.linalg.inv(matrix).T)


def _turned(move: _Move, direction: Array, eps: Array, kg: Array) -> Array:
    """Return where a direction that stands still is in the unit's axes after a turn, (3,)."""
    whole = whole_rotation(_true_rates(move, eps, kg) * move.period_s)
    return np.asarray(direction @ whole)


def _gyros(
    moves: Sequence[_Move], forces: Array, eps: Array, turn_deg: float | None
) -> tuple[Array, Array, tuple[float, float]]:
    """Return K_g's elements (9,), their covariance, and the rms of told angles before and after in deg."""
    up = forces / np.linalg.norm(forces, axis=1, keepdims=True)
    told = [] if turn_deg is None else [
        move for move in moves if abs(_angle_deg(move, eps, np.zeros(9)) / turn_deg - 1.0) < _NEAR_TURN
    ]  # fmt: skip

    def angles(kg: Array) -> Array:
        return np.array([_angle_deg(move, eps, kg) - float(turn_deg or 0.0) for move in told])

    def off(kg: Array) -> Array:
        directions = [(_turned(move, up[move.start], eps, kg) - up[move.stop]) / _FLOOR_RAD for move in moves]
        return np.concatenate((*directions, angles(kg) / _TURN_SIGMA_DEG, kg / _PRIOR_PART))

    found, covariance = _fitted(off, np.zeros(9), 3 * len(moves) + len(told))
    rms = [float(np.sqrt(np.mean(angles(kg) ** 2))) if told else math.nan for kg in (np.zeros(9), found)]
    return found, covariance, (rms[0], rms[1])


def _angle_deg(move: _Move, eps: Array, kg: Array) -> float:
    """Return by how much a turn about one axis turned."""
    return math.degrees(float(np.linalg.norm(_true_rates(move, eps, kg).sum(axis=0)) * move.period_s))


def _direction_rms_deg(moves: Sequence[_Move], forces: Array, eps: Array, kg: Array) -> float:
    up = forces / np.linalg.norm(forces, axis=1, keepdims=True)
    off = [np.linalg.norm(_turned(move, up[move.start], eps, kg) - up[move.stop]) for move in moves]
    return math.degrees(float(np.sqrt(np.mean(np.square(off))))) if off else math.nan
