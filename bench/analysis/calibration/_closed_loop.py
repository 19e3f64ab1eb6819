"""The estimator for errors too large to stay linear: a filter that feeds every update back at once (MEMS).

A gyro that cannot feel the Earth finds no north: the heading is taken from the nominal home, only levelling is
done. The noise assumed is inflated, since bias wander and nonlinearity of such sensors are not modelled: sigma is
cautious, and the innovations say how much. Passes start from the last estimate with the prior about it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from bench.analysis.calibration._checks import require_whole
from bench.analysis.calibration._conventions import DV, PARAMETERS, PHI, STATES, Noise, Task, cross_matrix
from bench.analysis.calibration._estimator import Estimate
from bench.analysis.calibration._model import process_noise
from bench.analysis.calibration._navigation import INTERVAL_S, Increments, compensate, navigate
from drivers.base.arrays import Array
from drivers.base.errors import RecordError

INFLATION = 5.0
VELOCITY_MPS = 0.02


def estimate_closed_loop(
    data: Increments, task: Task, home: Array, *, passes: int = 3, rest_rate_dps: float = 1.0
) -> Estimate:
    """Return the parameters of a record that starts at rest near the attitude `home` (3, 3).

    `rest_rate_dps`: departure from the mean rate of the first second that counts as a turn; it must exceed noise
    and bias wander. RecordError if nothing turns, or nothing rests.
    """
    require_whole(data, None)
    noise = task.noise
    noise = Noise(noise.arw_deg_per_sqrt_h * INFLATION, noise.vrw_ug_per_sqrt_hz * INFLATION, VELOCITY_MPS)
    task = replace(task, noise=noise)
    pieces = _pieces(data)
    mean = np.array([piece.angle_rad.mean(axis=0) for piece in pieces]) / data.period_s
    resting = np.linalg.norm(mean - mean[0], axis=1) < math.radians(rest_rate_dps)
    resting[1:] &= resting[:-1].copy()
    if resting.all() or np.sum(resting) < 3:
        raise RecordError(
            "the record is no calibration",
            found=f"{int(resting.sum())} of {len(resting)} seconds at rest",
            expected="rests with turns between them",
        )
    current = np.zeros(31)
    for _ in range(passes):
        before = current[:24].copy()
        current, covariance, course, rms = _pass(pieces, resting, current, task, home)
    sigma = np.sqrt(np.diag(covariance)[PARAMETERS])
    return Estimate(
        parameters=current[:24],
        sigma=sigma,
        covariance=covariance[PARAMETERS, PARAMETERS],
        lever_m=np.zeros((2, 3)),
        lag_s=0.0,
        course=course,
        innovation_rms=rms,
        last_step=(current[:24] - before) / sigma,
    )


def level(data: Increments, home: Array) -> Array:
    """Return C (3, 3) with up from the accelerometers and the heading of `home`."""
    force = data.velocity_mps.sum(axis=0)
    up = force / np.linalg.norm(force)
    north = home[1] - (home[1] @ up) * up
    if np.linalg.norm(north) < 0.5:
        raise RecordError(
            "the record does not start near the home attitude",
            found=f"up along body ({up[0]:.2f}, {up[1]:.2f}, {up[2]:.2f})",
            expected=f"({home[2, 0]:.2f}, {home[2, 1]:.2f}, {home[2, 2]:.2f})",
        )
    north /= np.linalg.norm(north)
    return np.array([np.cross(north, up), north, up])


def _pieces(data: Increments) -> list[Increments]:
    length = 2 * max(1, round(INTERVAL_S / (2.0 * data.period_s)))
    count = len(data.angle_rad) // length
    return [
        Increments(data.period_s, data.angle_rad[at : at + length], data.velocity_mps[at : at + length])
        for at in range(0, count * length, length)
    ]


def _pass(
    pieces: list[Increments],
    resting: np.ndarray[tuple[int], np.dtype[np.bool_]],
    start: Array,
    task: Task,
    home: Array,
) -> tuple[Array, Array, Array, float]:
    """Return parameters (31,), covariance (30, 30), sigma after each rest (rests, 24), innovations' rms."""
    current = start.copy()
    c = level(compensate(pieces[0], current), home)
    velocity = np.zeros(3)
    p = np.diag(task.prior_sigma**2)
    r = np.eye(3) * task.noise.velocity_mps**2
    course, innovations = [], []
    for number, piece in enumerate(pieces):
        track = navigate(compensate(piece, current), c, task.site)
        row = track.transition[0, :, :STATES]
        c, velocity = track.attitude[0], velocity + track.velocity[0]
        through = row @ p
        p[6:, :6], p[:6, 6:] = through[:, 6:].T, through[:, 6:]
        p[:6, :6] = through @ row.T + process_noise(task.site, task.noise, track.interval_s)
        if not resting[number]:
            continue
        root = np.linalg.cholesky(p[DV, DV] + r)
        white = np.linalg.solve(root, np.column_stack([velocity, p[DV]]))
        innovations.append(white[:, 0])
        p = p - white[:, 1:].T @ white[:, 1:]
        x = white[:, 1:].T @ white[:, 0]
        c = _corrected(c, x[PHI])
        velocity = velocity - x[DV]
        current[:24] += x[PARAMETERS]
        if number + 1 == len(pieces) or not resting[number + 1]:
            course.append(np.sqrt(np.diag(p)[PARAMETERS]))
    return current, p, np.array(course), float(np.sqrt(np.mean(np.square(innovations))))


def _corrected(c: Array, phi: Array) -> Array:
    """Return C from the computed (I - [phi x]) C, orthonormal."""
    left, _, right = np.linalg.svd((np.eye(3) + cross_matrix(phi)) @ c)
    return np.asarray(left @ right)
