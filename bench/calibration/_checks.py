"""Is this record what it is taken for? Checks before a number is printed, each named with its consequence."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bench.calibration._conventions import DPH_RAD_S, EARTH_RATE_RAD_S, EPS, Array, Task
from bench.calibration._navigation import Increments, Track
from bench.calibration._schedule import Schedule
from drivers.errors import RecordError

_TURN_TOLERANCE_DEG = 3.0
_TILT_TOLERANCE_DEG = 2.0
_FULL_SCALE = 0.999


def require_whole(data: Increments, range_dps: float | None) -> None:
    """Raise RecordError for samples that are no numbers or, where the gyro's range is known, at its end."""
    for name, values in (("gyro", data.angle_rad), ("accelerometer", data.velocity_mps)):
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(bad):
            raise RecordError(
                f"the {name} record has gaps",
                where=f"{bad[0] * data.period_s:.2f} s",
                found=f"{len(bad)} samples that are no numbers",
                expected="an unbroken record: a lost increment of a turn cannot be made up",
                remedy="run the schedule again",
            )
    if range_dps is None:
        return
    rate = np.abs(np.degrees(data.angle_rad)) / data.period_s
    for axis, clipped in zip("xyz", np.sum(rate >= _FULL_SCALE * range_dps, axis=0), strict=True):
        if clipped:
            raise RecordError(
                f"gyro {axis} is saturated",
                found=f"{clipped} samples at the end of its range of {range_dps:g} deg/s",
                expected="turns within the range: a clipped turn looks like a scale factor error",
                remedy="turn the table more slowly",
            )


def require_latitude(data: Increments, duration_s: float, task: Task) -> None:
    """Raise RecordError if Earth rate and gravity at the start do not fit the latitude, or each other's axes."""
    count = max(1, round(duration_s / data.period_s))
    rate = data.angle_rad[:count].mean(axis=0) / data.period_s
    force = data.velocity_mps[:count].mean(axis=0)
    up = force / np.linalg.norm(force)
    size = float(np.linalg.norm(rate))
    doubt = 5.0 * float(np.linalg.norm(task.prior_sigma[EPS]))
    expected = EARTH_RATE_RAD_S * math.sin(math.radians(task.site.latitude_deg))
    if abs(rate @ up - expected) > doubt or abs(size - EARTH_RATE_RAD_S) > doubt:
        up_dph = rate @ up / DPH_RAD_S
        seen = math.degrees(math.asin(float(np.clip(rate @ up / EARTH_RATE_RAD_S, -1.0, 1.0))))
        raise RecordError(
            "gyros and accelerometers do not show the Earth as it turns at this latitude",
            where=f"first {duration_s:g} s",
            found=f"{up_dph:.2f} deg/h about up, as at latitude {seen:.1f} deg, of {size / DPH_RAD_S:.2f} deg/h",
            expected=f"{expected / DPH_RAD_S:.2f} deg/h within {doubt / DPH_RAD_S:.2f}, latitude "
            f"{task.site.latitude_deg:g} deg",
            remedy="check the latitude, and that axes are neither swapped nor of wrong sign",
        )


def require_axes(data: Increments, track: Track, resting: NDArray[np.bool_]) -> None:
    """Raise RecordError unless gyros and accelerometers agree at every rest about which way is up."""
    a_second = round(track.interval_s / data.period_s)
    count = len(resting)
    force = data.velocity_mps[: count * a_second].reshape(count, a_second, 3).sum(axis=1)
    up = np.einsum("ni,ni->n", track.attitude[:, 2], force) / np.linalg.norm(force, axis=1)
    tilt = np.degrees(np.arccos(np.clip(up, -1.0, 1.0)))
    bad = np.flatnonzero(resting & (tilt > _TILT_TOLERANCE_DEG))
    if len(bad):
        raise RecordError(
            "gyros and accelerometers disagree about the turns",
            where=f"rest at {bad[0] * track.interval_s:.0f} s",
            found=f"up by the gyros is {tilt[bad[0]]:.1f} deg away from up by the accelerometers",
            expected=f"less than {_TILT_TOLERANCE_DEG:g} deg",
            remedy="an axis is swapped, left-handed or wrongly scaled, or increments of a turn were lost",
        )


def require_schedule(track: Track, resting: NDArray[np.bool_], schedule: Schedule) -> None:
    """Raise RecordError naming the first position that is missing, or that the table did not reach."""
    ends = np.flatnonzero(resting & ~np.append(resting[1:], False))
    attitudes = track.attitude[ends]
    wanted = schedule.attitudes()
    for number in range(min(len(ends), len(wanted)) - 1):
        turn = attitudes[number].T @ attitudes[number + 1]
        error = _angle_deg((wanted[number].T @ wanted[number + 1]).T @ turn)
        if error > _TURN_TOLERANCE_DEG:
            raise RecordError(
                f"turn {number + 1} ({schedule.moves[number]}) is not the scheme's",
                where=f"before the rest that ends at {(ends[number + 1] + 1) * track.interval_s:.0f} s",
                found=f"a turn of {_angle_deg(turn):.1f} deg, {error:.1f} deg away from it",
                expected=f"{schedule.moves[number]} within {_TURN_TOLERANCE_DEG:g} deg",
                remedy="the table stopped short, a position is missing, or the scheme is another one",
            )
    if len(ends) != len(wanted):
        raise RecordError(
            "the record does not hold the scheme's positions",
            found=f"{len(ends)} rests",
            expected=f"{len(wanted)} ({schedule.name})",
            remedy="a position is missing or the record was cut; run the schedule again",
        )


def _angle_deg(turn: Array) -> float:
    return math.degrees(math.acos(float(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0))))
