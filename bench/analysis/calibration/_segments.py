"""The covariance of a schedule as a chain of segments, each computed once (scattering form).

A Kalman filter over any stretch maps P to Ga + Phi (I + P Th)^-1 P Phi^T: closed-loop transition Phi, information
Th, noise Ga (Redheffer's star product composes two stretches). The parameters are constants, so Phi is [X; 0 I]
with X (6, 30) and Ga lives in the navigation states (6, 6): composing costs one 6 x 6 inverse. The posterior
covariance of the parameters is the parameter block of (I + Th)^-1. States are scaled by their prior sigma.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.analysis.calibration._conventions import PARAMETERS, STATES, Task
from bench.analysis.calibration._model import (
    dwell_transitions,
    measurement_times,
    process_noise,
    turn_transitions,
)
from bench.analysis.calibration._schedule import Move, Profile, Schedule
from drivers.base.arrays import Array


@dataclass(frozen=True, eq=False)
class Segment:
    """One stretch or a batch of them: X (..., 6, 30), Th (..., 30, 30), Ga (..., 6, 6), prior-scaled."""

    transition: Array
    information: Array
    noise: Array

    def map(self, change: Callable[[Array], Array]) -> Segment:
        """Return the segment of the three parts changed alike."""
        return Segment(change(self.transition), change(self.information), change(self.noise))

    def __getitem__(self, at: Any) -> Segment:
        """Take from a batch."""
        return self.map(lambda part: np.asarray(part[at]))


def compose(first: Segment, then: Segment) -> Segment:
    """Return the stretch `first` followed by `then`; batches broadcast."""
    gain = np.linalg.inv(np.eye(6) + first.noise @ then.information[..., :6, :6])
    seen = first.noise @ then.information[..., :6, 6:]
    through = np.broadcast_to(first.transition, (*seen.shape[:-2], 6, STATES)).copy()
    through[..., 6:] -= seen
    through = gain @ through
    onward = then.information[..., :, :6] @ through
    onward[..., 6:] += then.information[..., :, 6:]
    information = first.information + np.swapaxes(first.transition, -1, -2) @ onward[..., :6, :]
    information[..., 6:, :] += onward[..., 6:, :]
    transition = then.transition[..., :6] @ through
    transition[..., 6:] += then.transition[..., 6:]
    half = then.transition[..., :6]
    noise = then.noise + half @ gain @ first.noise @ np.swapaxes(half, -1, -2)
    return Segment(transition, information, noise)


def dwell_segments(task: Task, attitudes: Array, dwell_s: float) -> Segment:
    """Return rests at C (n, 3, 3), a velocity measurement at the end of every second, as a batch (n,)."""
    times = measurement_times(dwell_s)
    step = dwell_transitions(task.site, attitudes, times[:1])[:, 0]
    one = _stretch(task, step, times[0], measured=True)
    result, power, count = None, one, len(times)
    while count:
        if count & 1:
            result = power if result is None else compose(result, power)
        count >>= 1
        if count:
            power = compose(power, power)
    assert result is not None
    return result


def turn_segments(
    task: Task, attitudes: Array, moves: Sequence[Move], rate_dps: float, profile: Profile
) -> Segment:
    """Return turns from C (n, 3, 3), one move each, nothing measured on the way, as a batch (n,)."""
    rows = turn_transitions(task.site, attitudes, moves, rate_dps, profile)
    noise = [process_noise(task.site, task.noise, abs(move.angle_deg) / rate_dps) for move in moves]
    plain = _stretch(task, rows, 0.0, measured=False)
    scale = task.prior_sigma[:6]
    return Segment(plain.transition, plain.information, np.array(noise) / np.outer(scale, scale))


def posterior_sigma(information: Array, task: Task) -> Array:
    """Return posterior sigma of the 24 parameters, SI, shape (..., 24), from Th (..., 30, 30)."""
    return np.asarray(np.sqrt(scaled_variances(information)) * task.prior_sigma[PARAMETERS])


def scaled_variances(information: Array) -> Array:
    """Return posterior over prior variance of the 24 parameters, shape (..., 24)."""
    posterior = np.linalg.inv(np.eye(STATES) + information)
    return np.diagonal(posterior, axis1=-2, axis2=-1)[..., PARAMETERS]


def covariance(segment: Segment) -> Array:
    """Return the scaled posterior covariance, (..., 30, 30), of the state at the end, prior I."""
    before = np.linalg.inv(np.eye(STATES) + segment.information)
    whole = np.zeros((*segment.transition.shape[:-2], STATES, STATES))
    whole[..., :6, :] = segment.transition
    whole[..., 6:, 6:] = np.eye(STATES - 6)
    after = whole @ before @ np.swapaxes(whole, -1, -2)
    after[..., :6, :6] += segment.noise
    return np.asarray((after + np.swapaxes(after, -1, -2)) / 2.0)


def schedule_segments(task: Task, schedule: Schedule) -> Segment:
    """Return, as a batch (positions,), the first dwell and every turn with the dwell after it."""
    attitudes = schedule.attitudes()
    unique, back = np.unique(np.round(attitudes, 6), axis=0, return_inverse=True)
    rests = dwell_segments(task, unique, schedule.dwell_s)[back.ravel()]
    first = informed(rests[:1], task)
    if not schedule.moves:
        return first
    turns = turn_segments(task, attitudes[:-1], schedule.moves, schedule.rate_dps, schedule.profile)
    return join([first, compose(turns, rests[1:])])


def informed(segment: Segment, task: Task) -> Segment:
    """Return a stretch, or a batch, that begins a run: what is known of the parameters before it is in it."""
    if task.known is None:
        return segment
    information = segment.information.copy()
    information[..., PARAMETERS, PARAMETERS] += task.known
    return Segment(segment.transition, information, segment.noise)


def chain_segments(segments: Segment) -> list[Segment]:
    """Return the stretches from the start to the end of each segment of a batch."""
    reached = [segments[0]]
    for number in range(1, len(segments.noise)):
        reached.append(compose(reached[-1], segments[number]))
    return reached


def fold(segments: Segment) -> Segment:
    """Return the whole stretch of a batch, composed in pairs: log2 n batched steps."""
    while (count := len(segments.noise)) > 1:
        odd = segments[-1:] if count % 2 else None
        pairs = compose(segments[0 : count - 1 : 2], segments[1:count:2])
        segments = pairs if odd is None else join([pairs, odd])
    return segments[0]


def join(parts: Sequence[Segment]) -> Segment:
    """Return batches as one batch."""
    return Segment(
        np.concatenate([part.transition for part in parts]),
        np.concatenate([part.information for part in parts]),
        np.concatenate([part.noise for part in parts]),
    )


def _stretch(task: Task, rows: Array, time_s: float, *, measured: bool) -> Segment:
    """Return predict, then (if measured) update, for navigation rows (n, 6, 30) in SI."""
    scale = task.prior_sigma
    transition = rows / scale[:6, None] * scale
    noise = process_noise(task.site, task.noise, time_s) / np.outer(scale[:6], scale[:6])
    count = len(rows)
    predicted = Segment(transition, np.zeros((count, STATES, STATES)), np.broadcast_to(noise, (count, 6, 6)))
    if not measured:
        return predicted
    seen = np.zeros((count, STATES, STATES))
    seen[:, range(3, 6), range(3, 6)] = (scale[3:6] / task.noise.velocity_mps) ** 2
    still = Segment(np.broadcast_to(np.eye(6, STATES), (count, 6, STATES)), seen, np.zeros((count, 6, 6)))
    return compose(predicted, still)
