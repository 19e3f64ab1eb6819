"""The estimator: a Kalman filter on the velocity of a table at rest, passed over the record until it settles.

Each pass takes the estimate so far out of the data, aligns and navigates anew, and filters what is left, from
the prior about the estimate so far. The first pass leaves errors of second order, the third none.
Options: bias wander as six Markov states, lever arms of accelerometers x and y, accelerometer lag.
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

_CORE = 30


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

    `covariance` (24, 24); `course` (positions, 24): sigma at the end of each rest; `innovation_rms`: of whitened
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


@dataclass
class Filtered:
    """State and covariance at the end, sigma at the end of each rest, whitened innovations, their likelihood."""

    state: Array
    covariance: Array
    course: list[Array] = field(default_factory=list)
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
                require_schedule(track, resting, schedule)
            require_axes(clean, track, resting)
            require_latitude(clean, track, resting, task)
        found = filter_track(track, current, sigma, task, options)
        current = current + found.state[6:37] * (sigma[6:37] > 0.0)
    covariance = found.covariance[PARAMETERS, PARAMETERS]
    return Estimate(
        parameters=current[:24],
        sigma=np.sqrt(np.diag(covariance)),
        covariance=covariance,
        lever_m=current[24:30].reshape(2, 3),
        lag_s=float(current[30]),
        course=np.array(found.course),
        innovation_rms=float(np.sqrt(np.mean(np.square(found.innovations)))),
    )


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
    """Run the filter over a track, prior-scaled. Pinned states stay in the result with zero variance."""
    used = np.flatnonzero(sigma > 0.0)
    scale = sigma[used]
    rows = np.concatenate([track.transition, track.transition[:, :, 6:12]], axis=-1)
    rows = rows[:, :, used] / scale[:6, None] * scale
    mean = np.zeros(43)
    mean[6:37] = -current
    x = (mean[used]) / scale
    p = np.eye(len(used))
    markov = used >= 37
    keep = math.exp(-track.interval_s / options.wander.time_s) if options.wander is not None else 1.0
    decay = np.where(markov, keep, 1.0)[6:]
    driven = np.where(markov, 1.0 - keep**2, 0.0)[6:]
    q = process_noise(task.site, task.noise, track.interval_s) / np.outer(scale[:6], scale[:6])
    r = np.eye(3) * (task.noise.velocity_mps / scale[3]) ** 2
    resting = rest_intervals(track, options)
    measured = track.velocity / scale[3:6]
    found = Filtered(np.zeros(43), np.zeros((43, 43)))
    wandering = bool(markov.any())
    for number, row in enumerate(rows):
        through = row @ p
        p[6:, :6] = (through[:, 6:] * decay).T
        p[:6, 6:] = p[6:, :6].T
        p[:6, :6] = through @ row.T + q
        x[:6] = row @ x
        if wandering:
            p[6:, 6:] = p[6:, 6:] * decay * decay[:, None]
            p[range(6, len(p)), range(6, len(p))] += driven
            x[6:] *= decay
        if resting[number]:
            root = np.linalg.cholesky(p[3:6, 3:6] + r)
            white = np.linalg.solve(root, np.column_stack([measured[number] - x[3:6], p[3:6]]))
            found.innovations.append(white[:, 0])
            found.log_likelihood -= 0.5 * float(white[:, 0] @ white[:, 0]) + float(
                np.log(np.diag(root)).sum()
            )
            p = p - white[:, 1:].T @ white[:, 1:]
            x = x + white[:, 1:].T @ white[:, 0]
            if number + 1 == len(rows) or not resting[number + 1]:
                at = np.searchsorted(used, np.arange(6, _CORE))
                found.course.append(np.sqrt(np.diag(p)[at]) * scale[at])
    found.state[used] = x * scale
    # What the prior was about is added back by the caller through `current`: the state is an error left.
    found.covariance[np.ix_(used, used)] = p * np.outer(scale, scale)
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
        )
    return resting
