"""The estimator: a Kalman filter on the velocity of a table at rest, passed over the record until it settles.

Each pass takes the estimate so far out of the data, aligns and navigates anew, and filters what is left, from
the prior about the estimate so far. The first pass leaves errors of second order, the third none.
Options: bias wander as six Markov states, lever arms of accelerometers x and y, accelerometer lag. Of biases that
wander the mean over the record is estimated: whatever wanders how, that is what the record shows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bench.analysis.calibration._axes_check import require_axis_order
from bench.analysis.calibration._checks import require_axes, require_latitude, require_schedule, require_whole
from bench.analysis.calibration._conventions import PARAMETERS, Task
from bench.analysis.calibration._model import process_noise
from bench.analysis.calibration._navigation import Increments, Track, align, compensate, navigate
from bench.analysis.calibration._schedule import Schedule
from bench.analysis.common.statistics import stretches
from drivers.base.arrays import Array
from drivers.base.errors import RecordError

_WANDER, _MEAN = slice(37, 43), slice(43, 49)
"""Markov biases, and their means over the record, beside the 37 states of a track."""


@dataclass(frozen=True)
class BiasWander:
    """Stationary Markov biases beside the constant ones: sigma of gyro and accelerometer, correlation time."""

    gyro_rad_s: float
    accelerometer_mps2: float
    time_s: float


@dataclass(frozen=True)
class Options:
    """What is estimated beside the 24 parameters, and how."""

    passes: int = 3
    alignment_s: float = 60.0
    wander: BiasWander | None = None
    lever_arms: bool = False
    lever_sigma_m: float = 0.1
    lag_sigma_s: float = 0.01
    gyro_range_dps: float | None = None
    rest_rate_rad_s: float = math.radians(0.02)
    """An interval whose mean rate exceeds this is a turn."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """The result. SI: `parameters`, `sigma` (24,); `lever_m` (2, 3) and `lag_s` are zero unless estimated.

    Biases are means over the record. `covariance` (24, 24); `course`, `course_parameters` (positions, 24): sigma
    and estimate at the end of each rest, `course_s` (positions,): when that is; `innovation_rms`: of whitened
    innovations, 1 when the noise assumed is the noise there was; the noise told may be far from that without harm
    (`record_noise` judges).
    """

    parameters: Array
    sigma: Array
    covariance: Array
    lever_m: Array
    lag_s: float
    course: Array
    innovation_rms: float
    course_parameters: Array
    course_s: Array


@dataclass
class Filtered:
    """What a filter leaves: state (49,) and covariance at the end, whitened innovations, their likelihood.

    `course`: time, error of the parameters left and its sigma, (24,) each, at the end of each rest.
    """

    state: Array
    covariance: Array
    course: list[tuple[float, Array, Array]] = field(default_factory=list)
    innovations: list[Array] = field(default_factory=list)
    log_likelihood: float = 0.0


def estimate(
    data: Increments, task: Task, options: Options = Options(), schedule: Schedule | None = None
) -> Estimate:
    """Return the parameters of a record that starts at rest.

    `schedule`: the record must hold its turns and positions. RecordError if the record cannot be used: gaps,
    saturation, no rest at its start, another latitude, axes that do not fit, a position that is missing.
    """
    require_whole(data, options.gyro_range_dps)
    current = np.zeros(31)
    sigma = prior_sigma(task, options)
    for number in range(options.passes):
        clean = compensate(data, current)
        track = navigate(clean, align(clean, options.alignment_s), task.site)
        if number == 0:
            resting = rest_intervals(track, options)
            require_axis_order(clean, track, resting, schedule, task.site.latitude_deg)
            if schedule is not None:
                require_schedule(track, resting, schedule, task)
            require_axes(clean, track, resting, task)
            require_latitude(clean, track, resting, task)
        found = filter_track(track, current, sigma, task, options)
        # What is left is an error of what was taken out of the data before.
        before, current = current, current + found.state[6:37] * (sigma[6:37] > 0.0)
    left, covariance = _with_means(found.state, found.covariance, 1.0)
    at_s, course_left, course = (np.array(part) for part in zip(*found.course, strict=True))
    return Estimate(
        parameters=before[:24] + left,
        sigma=np.sqrt(np.diag(covariance)),
        covariance=covariance,
        lever_m=current[24:30].reshape(2, 3),
        lag_s=float(current[30]),
        course=course,
        innovation_rms=float(np.sqrt(np.mean(np.square(found.innovations)))),
        course_parameters=before[:24] + course_left,
        course_s=at_s,
    )


def _with_means(state: Array, covariance: Array, share: float) -> tuple[Array, Array]:
    """Return the error of the parameters (24,) and its covariance, biases as means over the `share` so far."""
    whole = np.eye(24, len(state), PARAMETERS.start)
    whole[:6, _MEAN] = np.eye(6) / share
    return whole @ state, whole @ covariance @ whole.T


def prior_sigma(task: Task, options: Options) -> Array:
    """Return prior sigma of the 30 states, lever arms (6), lag (1), Markov biases (6); 0 pins a state."""
    extra = np.zeros(7)
    if options.lever_arms:
        extra[:6], extra[6] = options.lever_sigma_m, options.lag_sigma_s
    wander = np.zeros(6)
    if options.wander is not None:
        wander[:3], wander[3:] = options.wander.gyro_rad_s, options.wander.accelerometer_mps2
    return np.concatenate([task.prior_sigma, extra, wander])


def filter_track(track: Track, current: Array, sigma: Array, task: Task, options: Options) -> Filtered:
    """Run the filter over a track, prior-scaled. Pinned states stay in the result with zero variance.

    `sigma` (43,): see `prior_sigma`. Means of biases that wander are six states more, which nothing measures.
    """
    from scipy.linalg.lapack import dpotrf, dtrtrs  # here: procedures load without scipy (decision 0021)

    all_sigma = np.concatenate([sigma, sigma[_WANDER]])
    used = np.flatnonzero(all_sigma > 0.0)
    scale = all_sigma[used]
    rows = np.concatenate(
        [track.transition, track.transition[:, :, 6:12], np.zeros((len(track.rate), 6, 6))], -1
    )
    rows = rows[:, :, used] / scale[:6, None] * scale
    mean = np.zeros(len(all_sigma))
    mean[6:37] = -current
    x = (mean[used]) / scale
    wander, means = (slice(*np.searchsorted(used, (part.start, part.stop))) for part in (_WANDER, _MEAN))
    wanders = wander.start < wander.stop
    p = np.eye(len(used))
    p[means] = 0.0
    variance = np.einsum("ii->i", p)
    keep = math.exp(-track.interval_s / options.wander.time_s) if options.wander is not None else 1.0
    decay, driven = np.ones(len(used) - 6), np.zeros(len(used) - 6)
    own = slice(wander.start - 6, wander.stop - 6)
    decay[own], driven[own] = keep, 1.0 - keep**2
    both = decay * decay[:, None]
    q = process_noise(task.site, task.noise, track.interval_s) / np.outer(scale[:6], scale[:6])
    r = np.eye(3) * (task.noise.velocity_mps / scale[3]) ** 2
    resting = rest_intervals(track, options)
    measured = track.velocity / scale[3:6]
    found = Filtered(np.zeros(len(all_sigma)), np.zeros((len(all_sigma), len(all_sigma))))
    beside = np.empty((3, 1 + len(used)), order="F")
    for number, row in enumerate(rows):
        if wanders:
            p[means] += p[wander] / len(rows)
            p[:, means] += p[:, wander] / len(rows)
            x[means] += x[wander] / len(rows)
        through = row @ p
        p[:6, 6:] = through[:, 6:] * decay
        p[6:, :6] = p[:6, 6:].T
        p[:6, :6] = through @ row.T + q
        x[:6] = row @ x
        if wanders:
            p[6:, 6:] *= both
            variance[6:] += driven
            x[6:] *= decay
        if resting[number]:
            root, failed = dpotrf(p[3:6, 3:6] + r, lower=1)
            if failed:
                raise np.linalg.LinAlgError("the covariance of the velocity is not positive definite")
            beside[:, 0] = measured[number] - x[3:6]
            beside[:, 1:] = p[3:6]
            white, _ = dtrtrs(root, beside, lower=1)
            gain, off = white[:, 1:], white[:, 0]
            found.innovations.append(off)
            found.log_likelihood -= 0.5 * float(off @ off) + math.log(root[0, 0] * root[1, 1] * root[2, 2])
            p -= gain.T @ gain
            x += off @ gain
        last = number + 1 == len(rows)
        if last or (resting[number] and not resting[number + 1]):
            found.state[used] = x * scale
            found.covariance[np.ix_(used, used)] = p * np.outer(scale, scale)
            if resting[number]:
                left, covariance = _with_means(found.state, found.covariance, (number + 1) / len(rows))
                found.course.append(((number + 1) * track.interval_s, left, np.sqrt(np.diag(covariance))))
    return found


def rest_intervals(track: Track, options: Options) -> NDArray[np.bool_]:
    """Return which intervals of a track are rest, shape (m,); a turn that begins in one shows in its mean.

    RecordError unless the record starts at rest and rests at least twice.
    """
    resting = track.rate <= options.rest_rate_rad_s
    rests = len(stretches(resting))
    if rests < 2 or not resting[0]:
        raise RecordError(
            "the record is no calibration",
            found=f"{rests} rest{'s' if rests != 1 else ''} of the table",
            expected="a record that starts at rest and holds a rest after every turn",
            remedy="" if rests < 2 else "a base that rocks by more than 0.02 deg/s looks like a turn",
        )
    return resting
