"""The calibration model once more, the slow and plain way: 33 states, F as a matrix, RK4, a KF step a second."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.calibration import Schedule, Task
from drivers.base.arrays import Array

EARTH = 7.292115e-5
STEP_S = 0.05
KEPT = [*range(21), 21, 22, 23, 25, 26, 29, *range(30, 33)]
"""The 30 states of the 33: accelerometer elements xy, xz, yz are conventions."""


def skew(v: Array) -> Array:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def turn_about(axis: int, angle: float) -> Array:
    k = skew(np.eye(3)[axis])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


def f_matrix(task: Task, c: Array, spin: Array) -> Array:
    """phi 0:3, dv 3:6, eps 6:9, nabla 9:12, K_g by column 12:21, all of K_a by column 21:30, K_2 30:33."""
    latitude = math.radians(task.site.latitude_deg)
    earth = EARTH * np.array([0.0, math.cos(latitude), math.sin(latitude)])
    up = np.array([0.0, 0.0, task.site.gravity_mps2])
    w, f = c.T @ earth + spin, c.T @ up
    matrix = np.zeros((33, 33))
    matrix[:3, :3], matrix[3:6, :3] = -skew(earth), skew(up)
    matrix[:3, 6:9], matrix[3:6, 9:12] = -c, c
    for column in range(3):
        matrix[:3, 12 + 3 * column : 15 + 3 * column] = -c * w[column]
        matrix[3:6, 21 + 3 * column : 24 + 3 * column] = c * f[column]
    matrix[3:6, 30:33] = c * f**2
    return matrix


def turn_matrix(task: Task, c: Array, schedule: Schedule, number: int) -> Array:
    move = schedule.moves[number]
    total, duration = math.radians(move.angle_deg), abs(move.angle_deg) / schedule.rate_dps

    def at(time: float) -> Array:
        s = time / duration
        if schedule.profile == "constant":
            angle, rate = total * s, total / duration
        else:
            angle = total * (s - math.sin(2 * math.pi * s) / (2 * math.pi))
            rate = total / duration * (1 - math.cos(2 * math.pi * s))
        return f_matrix(task, c @ turn_about(move.axis, angle), rate * np.eye(3)[move.axis])

    steps = round(duration / STEP_S)
    h = duration / steps
    phi = np.eye(33)
    for step in range(steps):
        first, middle, last = at(step * h), at((step + 0.5) * h), at((step + 1) * h)
        k1 = first @ phi
        k2 = middle @ (phi + h / 2 * k1)
        k3 = middle @ (phi + h / 2 * k2)
        k4 = last @ (phi + h * k3)
        phi = phi + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return phi


def second(task: Task, c: Array) -> Array:
    f = f_matrix(task, c, np.zeros(3))
    return np.eye(33) + f + f @ f / 2 + f @ f @ f / 6 + f @ f @ f @ f / 24


def q_matrix(task: Task, schedule: Schedule) -> Array:
    """(m, 33), whole seconds of dwell only."""
    phi, rows = np.eye(33), [np.eye(33)[3:6]]
    for number, c in enumerate(schedule.attitudes()):
        step = second(task, c)
        for _ in range(round(schedule.dwell_s)):
            phi = step @ phi
            rows.append(phi[3:6])
        if number < len(schedule.moves):
            phi = turn_matrix(task, c, schedule, number) @ phi
    return np.concatenate(rows)


def kalman(task: Task, schedule: Schedule, keep: list[int] = KEPT) -> Array:
    """Posterior sigma, SI, of the 30 states at the end, by the covariance filter, a step a second."""
    return np.sqrt(np.diag(kalman_covariance(task, schedule, keep))) * task.prior_sigma


def kalman_covariance(
    task: Task, schedule: Schedule, keep: list[int] = KEPT, start: Array | None = None
) -> Array:
    """Covariance (30, 30) at the end in units of prior sigma, from `start` (the prior)."""
    scale = task.prior_sigma
    p = np.eye(30) if start is None else start
    g = skew(np.array([0.0, 0.0, task.site.gravity_mps2]))

    def noise(time: float) -> Array:
        n, a = task.noise.arw**2, task.noise.vrw**2
        q = np.zeros((30, 30))
        q[:3, :3] = n * time * np.eye(3)
        q[3:6, :3] = n * time**2 / 2 * g
        q[:3, 3:6] = q[3:6, :3].T
        q[3:6, 3:6] = a * time * np.eye(3) + n * time**3 / 3 * g @ g.T
        return q / np.outer(scale, scale)

    def scaled(phi: Array) -> Array:
        return phi[np.ix_(keep, keep)] / scale[:, None] * scale

    every = noise(1.0)
    r = (task.noise.velocity_mps / scale[3]) ** 2
    for number, c in enumerate(schedule.attitudes()):
        step = scaled(second(task, c))
        for _ in range(round(schedule.dwell_s)):
            p = step @ p @ step.T + every
            gain = p[:, 3:6] @ np.linalg.inv(p[3:6, 3:6] + r * np.eye(3))
            p = p - gain @ p[3:6]
            p = (p + p.T) / 2
        if number < len(schedule.moves):
            move = schedule.moves[number]
            step = scaled(turn_matrix(task, c, schedule, number))
            p = step @ p @ step.T + noise(abs(move.angle_deg) / schedule.rate_dps)
    return p


def null_space_degree(q: Array, column: int) -> float:
    """The definition: the largest |xi q_i| over unit xi orthogonal to the other columns."""
    others = np.delete(q, column, axis=1)
    left, singular, _ = np.linalg.svd(others, full_matrices=True)
    basis = left[:, int(np.sum(singular > 1e-10 * singular[0])) :]
    return float(np.linalg.norm(basis.T @ q[:, column]))


@pytest.fixture(scope="session")
def plain() -> SimpleNamespace:
    return SimpleNamespace(
        q_matrix=q_matrix,
        kalman=kalman,
        covariance=kalman_covariance,
        null_space_degree=null_space_degree,
        skew=skew,
        second=second,
        turn_about=turn_about,
        turn_matrix=turn_matrix,
        kept=KEPT,
    )
