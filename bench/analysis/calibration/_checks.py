"""Is this record what it is taken for? Checks before a number is printed, each named with its consequence."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bench.analysis.calibration._conventions import DPH_RAD_S, EPS, KG, Task
from bench.analysis.calibration._navigation import Increments, Track
from bench.analysis.calibration._schedule import Schedule
from bench.analysis.common.statistics import stretches
from drivers.base.arrays import Array
from drivers.base.constants import EARTH_RATE_RAD_S
from drivers.base.errors import RecordError

_TURN_TOLERANCE_DEG = 3.0
_TILT_TOLERANCE_DEG = 2.0
_FULL_SCALE = 0.999
_NOISY, _STUCK = 100, 8
_LEAST_REST = 10
"""Seconds of rest from which a rest counts for the latitude."""


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
    for name, values in (("gyro", data.angle_rad), ("accelerometer", data.velocity_mps)):
        _require_unclipped(name, values, data.period_s)
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


def _require_unclipped(name: str, values: Array, period_s: float) -> None:
    """Raise RecordError if a noisy channel stays exactly at its largest or smallest value for a while.

    A unit at the end of its range sends one number again and again. Channels without noise are passed over.
    """
    for axis, channel in zip("xyz", values.T, strict=True):
        if len(np.unique(channel[: min(len(channel), 500)])) < _NOISY:
            continue
        for end in (channel.max(), channel.min()):
            at_end = channel == end
            runs = stretches(at_end)
            first, after = runs[np.argmax(np.diff(runs))]
            if after - first >= _STUCK:
                raise RecordError(
                    f"{name} {axis} is saturated",
                    where=f"{first * period_s:.2f} s",
                    found=f"{int(at_end.sum())} samples at exactly its {'largest' if end > 0 else 'smallest'} "
                    f"value, {after - first} of them in a row",
                    expected="readings within the range: a clipped turn looks like a scale factor error",
                    remedy="turn the table more slowly, or set a larger range on the unit",
                )


def require_latitude(data: Increments, track: Track, resting: NDArray[np.bool_], task: Task) -> None:
    """Raise RecordError if Earth rate at the rests does not fit the latitude.

    At every rest the rate about up is w_ie sin(latitude) + eps . u, u up in body axes: rests with up along
    several axes tell the latitude from the gyro biases. What the data leave open is allowed: 5 sigma of the fit.
    """
    angle, force = data.sums(round(track.interval_s / data.period_s), len(resting))
    rate = angle / track.interval_s
    rests = [(start + 1, end - 1) for start, end in stretches(resting) if end - start >= _LEAST_REST]
    if len(rests) < 2:
        return
    up = np.array([force[start:end].mean(axis=0) for start, end in rests])
    up /= np.linalg.norm(up, axis=1)[:, None]
    seen = np.array([rate[start:end].mean(axis=0) for start, end in rests])
    length = np.array([(end - start) * track.interval_s for start, end in rests])
    latitude = math.radians(task.site.latitude_deg)
    expected = EARTH_RATE_RAD_S * math.sin(latitude)
    sigma = task.noise.arw / np.sqrt(length)
    design = np.column_stack([np.ones(len(rests)), up])
    # the prior of the biases keeps the fit sane where the rests do not separate them from the latitude
    prior = np.diag(1.0 / np.concatenate([[np.inf], task.prior_sigma[EPS]]))
    whole = np.vstack([design / sigma[:, None], prior])
    right = np.concatenate([(np.einsum("ni,ni->n", up, seen) - expected) / sigma, np.zeros(4)])
    found, *_ = np.linalg.lstsq(whole, right, rcond=None)
    doubt = math.sqrt(float(np.linalg.pinv(whole.T @ whole)[0, 0]))
    # Of a unit not yet calibrated: scale factors, and angles, which show at every rest in another way.
    scale, crooked = float(task.prior_sigma[KG][0]), float(task.prior_sigma[KG].max())
    allowed = 5.0 * (doubt + math.hypot(scale, crooked / math.sqrt(len(rests))) * EARTH_RATE_RAD_S)
    if abs(found[0]) > allowed:
        sine = float(np.clip((expected + found[0]) / EARTH_RATE_RAD_S, -1.0, 1.0))
        margin = math.degrees(allowed / EARTH_RATE_RAD_S / max(math.cos(latitude), 0.05))
        raise RecordError(
            "the gyros do not show the Earth as it turns at this latitude",
            where=f"{len(rests)} rests",
            found=f"{(expected + found[0]) / DPH_RAD_S:.3f} deg/h about up, as at latitude "
            f"{math.degrees(math.asin(sine)):.2f} deg",
            expected=f"latitude {task.site.latitude_deg:g} deg within {margin:.2f} deg",
            remedy="correct latitude_deg in the bench file: 0.1 deg shifts a gyro scale factor by several ppm; "
            "the other hemisphere may also be accelerometers that all read down as positive; a unit with larger "
            "errors than told needs --prior-scale",
        )


def require_axes(data: Increments, track: Track, resting: NDArray[np.bool_], task: Task) -> None:
    """Raise RecordError unless gyros and accelerometers agree at every rest about which way is up."""
    tolerance_deg = _tolerance_deg(_TILT_TOLERANCE_DEG, task, len(stretches(resting)))
    _, force = data.sums(round(track.interval_s / data.period_s), len(resting))
    up = np.einsum("ni,ni->n", track.attitude[:, 2], force) / np.linalg.norm(force, axis=1)
    tilt = np.degrees(np.arccos(np.clip(up, -1.0, 1.0)))
    bad = np.flatnonzero(resting & (tilt > tolerance_deg))
    if len(bad):
        raise RecordError(
            "gyros and accelerometers disagree about the turns",
            where=f"rest at {bad[0] * track.interval_s:.0f} s",
            found=f"up by the gyros is {tilt[bad[0]]:.1f} deg away from up by the accelerometers",
            expected=f"less than {tolerance_deg:.2g} deg",
            remedy="an axis is swapped, left-handed or wrongly scaled, or increments of a turn were lost; a unit "
            "with larger errors than told needs --prior-scale",
        )


def require_schedule(track: Track, resting: NDArray[np.bool_], schedule: Schedule, task: Task) -> None:
    """Raise RecordError naming the first position that is missing, or that the table did not reach."""
    tolerance_deg = _tolerance_deg(_TURN_TOLERANCE_DEG, task, 1)
    ends = np.flatnonzero(resting & ~np.append(resting[1:], False))
    attitudes = track.attitude[ends]
    wanted = schedule.attitudes()
    for number in range(min(len(ends), len(wanted)) - 1):
        turn = attitudes[number].T @ attitudes[number + 1]
        error = _angle_deg((wanted[number].T @ wanted[number + 1]).T @ turn)
        if error > tolerance_deg:
            raise RecordError(
                f"turn {number + 1} ({schedule.moves[number]}) is not the scheme's",
                where=f"before the rest that ends at {(ends[number + 1] + 1) * track.interval_s:.0f} s",
                found=f"a turn of {_angle_deg(turn):.1f} deg, {error:.1f} deg away from it",
                expected=f"{schedule.moves[number]} within {tolerance_deg:.2g} deg",
                remedy="the table stopped short, a position is missing, or the scheme is another one",
            )
    if len(ends) != len(wanted):
        raise RecordError(
            "the record does not hold the scheme's positions",
            found=f"{len(ends)} rests",
            expected=f"{len(wanted)} ({schedule.name})",
            remedy="a position is missing or the record was cut; run the schedule again",
        )


def _tolerance_deg(least_deg: float, task: Task, turns: int) -> float:
    """Return what is allowed after turns of a unit whose gyros lie as crooked as the task says, 5 sigma."""
    crooked = float(task.prior_sigma[KG].max())
    return max(least_deg, math.degrees(5.0 * crooked * math.pi / 2.0 * math.sqrt(turns)))


def _angle_deg(turn: Array) -> float:
    return math.degrees(math.acos(float(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0))))
