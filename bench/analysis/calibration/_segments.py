"""The covariance of a schedule as a chain of segments, each computed once (scattering form).

A Kalman filter over any stretch maps P to Ga + Phi (I + P Th)^-1 P Phi^T: closed-loop transition Phi, information
Th, noise Ga (Redheffer's star product composes two stretches). The parameters are constants, so Phi is I + [D; 0]
with D (6, 30) and Ga lives in the navigation states (6, 6): composing costs one 6 x 6 inverse. The posterior
covariance of the parameters is the parameter block of (I + Th)^-1. States are scaled by their prior sigma.

In a rest all the parameters do is a constant input u = B p (6). So the rest is first filtered with the states
(x, u), which knows no attitude and is done once for all rests, and then u is written as B p at each attitude.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.analysis.calibration._conventions import PARAMETERS, STATES, Task
from bench.analysis.calibration._model import (
    forcing,
    measurement_times,
    process_noise,
    propagators,
    rest_inputs,
    turn_transitions,
)
from bench.analysis.calibration._schedule import Move, Profile, Schedule
from drivers.base.arrays import Array

_ONE = np.eye(6)


@dataclass(frozen=True, eq=False)
class Segment:
    """One stretch or a batch of them: D (..., 6, k), Th (..., k, k), Ga (..., 6, 6), prior-scaled.

    k is 30, and 12 while a rest is filtered (see above).
    """

    change: Array
    information: Array
    noise: Array

    def map(self, way: Callable[[Array], Array]) -> Segment:
        """Return the segment of the three parts changed alike."""
        return Segment(way(self.change), way(self.information), way(self.noise))

    def __getitem__(self, at: Any) -> Segment:
        """Take from a batch."""
        return self.map(lambda part: np.asarray(part[at]))


def compose(first: Segment, then: Segment) -> Segment:
    """Return the stretch `first` followed by `then`; batches broadcast."""
    # S = (I + Ga1 Th2)^-1 Phi1 = I + [E; 0] is in all three parts: Th2 S, Phi2 S and, by its gain, the noise
    fed_back = first.noise @ then.information[..., :6, :]
    gain = np.linalg.inv(fed_back[..., :6] + _ONE)
    through = gain @ (first.change - fed_back)
    onward = then.information[..., :6] @ through
    onward += then.information
    information = first.change.swapaxes(-1, -2) @ onward[..., :6, :]
    information += onward
    information += first.information
    half = then.change[..., :6]
    change = half @ through
    change += through
    change += then.change
    moved = half + _ONE
    noise = moved @ (gain @ first.noise) @ moved.swapaxes(-1, -2)
    noise += then.noise
    return Segment(change, information, noise)


def dwell_segments(task: Task, attitudes: Array, dwell_s: float) -> Segment:
    """Return rests at C (n, 3, 3), a velocity measurement at the end of every second, as a batch (n,)."""
    scale = task.prior_sigma
    rest = _rest(task, dwell_s)
    b = forcing(attitudes, *rest_inputs(task.site, attitudes)) / scale[:6, None] * scale[PARAMETERS]
    states = np.zeros((len(b), 12, STATES))
    states[:, :6, :6] = _ONE
    states[:, 6:, 6:] = b
    information = states.swapaxes(-1, -2) @ (rest.information @ states)
    return Segment(rest.change @ states, information, np.broadcast_to(rest.noise, (len(b), 6, 6)))


def _rest(task: Task, dwell_s: float) -> Segment:
    """Return a rest as a stretch of the twelve states x and u, both in units of the prior sigma of x."""
    times = measurement_times(dwell_s)
    scale = task.prior_sigma[:6]
    moved = np.concatenate(propagators(task.site, times[:1]), axis=-1)[0] / scale[:, None] * np.tile(scale, 2)
    noise = process_noise(task.site, task.noise, times[0]) / np.outer(scale, scale)
    seen = np.zeros((12, 12))
    seen[range(3, 6), range(3, 6)] = (scale[3:] / task.noise.velocity_mps) ** 2
    predicted = Segment(moved - np.eye(6, 12), np.zeros((12, 12)), noise)
    power = compose(predicted, Segment(np.zeros((6, 12)), seen, np.zeros((6, 6))))
    result, count = None, len(times)
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
    scale = task.prior_sigma
    rows = turn_transitions(task.site, attitudes, moves, rate_dps, profile)
    times = np.array([abs(move.angle_deg) / rate_dps for move in moves])
    noise = process_noise(task.site, task.noise, times) / np.outer(scale[:6], scale[:6])
    change = rows / scale[:6, None] * scale - np.eye(6, STATES)
    return Segment(change, np.zeros((len(moves), STATES, STATES)), noise)


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
    whole = np.broadcast_to(np.eye(STATES), before.shape).copy()
    whole[..., :6, :] += segment.change
    after = whole @ before @ whole.swapaxes(-1, -2)
    after[..., :6, :6] += segment.noise
    return np.asarray((after + after.swapaxes(-1, -2)) / 2.0)


def schedule_segments(task: Task, schedule: Schedule) -> Segment:
    """Return, as a batch (positions,), the first dwell and every turn with the dwell after it."""
    attitudes = schedule.attitudes()
    rests = dwell_segments(task, attitudes, schedule.dwell_s)
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
    return Segment(segment.change, information, segment.noise)


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
        np.concatenate([part.change for part in parts]),
        np.concatenate([part.information for part in parts]),
        np.concatenate([part.noise for part in parts]),
    )
