"""Navigation of a record at rest and in turns, and the transition of its error, a second at a time.

Two samples a step (Savage's two-speed form): coning in the attitude, rotation and sculling in the velocity. The
term 1/6 theta x (theta x V) is needed: without it an error-free IMU drifts by mm/s over a schedule. True velocity
is zero, so Coriolis is left out here and in the error model. Attitude is a product of turns, hence associative:
it is found by a prefix product over blocks, no loop over samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.analysis.calibration._conventions import KA_ELEMENTS, Site, rotation, unpack
from bench.analysis.calibration._model import propagators
from bench.analysis.common.attitude import cross_matrix, running_rotation
from drivers.base.arrays import Array
from drivers.base.errors import RecordError

INTERVAL_S = 1.0
EXTRA = 7
"""Lever arms of accelerometers x and y (6), accelerometer lag (1)."""


@dataclass(frozen=True, eq=False)
class Increments:
    """Increments over consecutive samples of `period_s`: rad and m/s, (n, 3) each."""

    period_s: float
    angle_rad: Array
    velocity_mps: Array

    def sums(self, samples: int, count: int) -> tuple[Array, Array]:
        """Return angle and velocity over each of the first `count` stretches of `samples`, (count, 3) each."""
        angle, velocity = (
            values[: count * samples].reshape(count, samples, 3).sum(axis=1)
            for values in (self.angle_rad, self.velocity_mps)
        )
        return angle, velocity


@dataclass(frozen=True, eq=False)
class Track:
    """A navigated record by intervals of `interval_s`: velocity at their ends (m, 3), C at their ends (m, 3, 3),
    navigation rows of the error transition (m, 6, 37), and mean turn rate, rad/s (m,).
    """

    interval_s: float
    velocity: Array
    attitude: Array
    transition: Array
    rate: Array


def compensate(data: Increments, parameters: Array) -> Increments:
    """Return increments with 24 parameters, lever arms and lag (31,) taken out, SI."""
    eps, nabla, kg, ka, k2 = unpack(parameters[:24])
    period = data.period_s
    angle = (data.angle_rad - eps * period) @ np.linalg.inv(np.eye(3) + kg).T
    lever, lag = parameters[24:30].reshape(2, 3), parameters[30]
    velocity = data.velocity_mps - nabla * period
    invert = np.linalg.inv(np.eye(3) + ka).T
    if np.any(lever) or lag:
        motion = _lever_rows(angle / period, period)
        velocity[:, :2] -= np.einsum("nij,ij->ni", motion[:, :2], lever) * period
        velocity -= lag * np.cross(angle / period, velocity)
    force = velocity @ invert
    for _ in range(2):
        force = (velocity - k2 * force**2 / period) @ invert
    return Increments(period, angle, force)


def align(data: Increments, duration_s: float) -> Array:
    """Return C (3, 3) at the first sample of a record that starts at rest, on a base that may rock.

    In axes that are the unit's at first and turn by the mean rate of its gyros, specific force is up. If the base
    has rocked, that rate is not the Earth's: up turns there, and the velocity gained is a parabola in time. That
    turn and the mean rate together are east = Earth rate x up.

    RecordError if it shows no Earth rate or no gravity, or if it turns meanwhile.
    """
    pairs = max(2, round(0.5 * duration_s / data.period_s))
    coned, sculled = _pairs(data, pairs)
    time_s = 2.0 * data.period_s * np.arange(pairs + 1)
    mean = coned.mean(axis=0) / (2.0 * data.period_s)
    rate = float(np.linalg.norm(mean))
    turned = running_rotation(coned)[:-1]
    if rate > 0.0:
        # what a pair of samples gains lies along the middle of it
        middle_rad = np.asarray(-rate * (time_s[:-1] + data.period_s), dtype=np.float64)
        turned = rotation(mean / rate, middle_rad) @ turned
    gained = np.einsum("nij,nj->ni", turned, sculled)
    velocity = np.concatenate([np.zeros((1, 3)), np.cumsum(gained, axis=0)])
    _, force, turning = np.linalg.lstsq(np.vander(time_s, 3, increasing=True), velocity, rcond=None)[0]
    up = force / np.linalg.norm(force)
    east = np.cross(mean, up) + 2.0 * (turning - up * (turning @ up)) / np.linalg.norm(force)
    if not 9.0 < np.linalg.norm(force) < 10.6 or np.linalg.norm(east) < 1e-6 or rate > 1e-3:
        raise RecordError(
            "the record does not start at rest, or its units are wrong",
            where=f"first {duration_s:g} s",
            found=f"{np.linalg.norm(force):.4g} m/s^2, {np.degrees(rate):.4g} deg/s",
            expected="9.8 m/s^2 and the Earth's 0.0042 deg/s",
            remedy="start recording with the table at rest; check scale factors and axes in the configuration",
        )
    east /= np.linalg.norm(east)
    return np.array([east, np.cross(up, east), up])


def _pairs(data: Increments, count: int) -> tuple[Array, Array]:
    """Return what the first `count` pairs of samples turn by, coning removed, and gain in axes of their start."""
    w = data.angle_rad[: 2 * count].reshape(count, 2, 3)
    v = data.velocity_mps[: 2 * count].reshape(count, 2, 3)
    theta, total = w.sum(axis=1), v.sum(axis=1)
    turned = np.cross(theta, total)
    sculled = total + turned / 2.0 + np.cross(theta, turned) / 6.0
    sculled += 2.0 / 3.0 * (np.cross(w[:, 0], v[:, 1]) + np.cross(v[:, 0], w[:, 1]))
    return theta + 2.0 / 3.0 * np.cross(w[:, 0], w[:, 1]), sculled


def navigate(data: Increments, attitude: Array, site: Site) -> Track:
    """Return the track of a record from C (3, 3) at zero velocity; a part of a second at the end is left out."""
    step = 2.0 * data.period_s
    a_second = max(1, round(INTERVAL_S / step))
    count = len(data.angle_rad) // (2 * a_second) * a_second
    coned, sculled = _pairs(data, count)
    theta, total = (
        values[: 2 * count].reshape(count, 2, 3).sum(axis=1) for values in (data.angle_rad, data.velocity_mps)
    )

    earth = site.earth_rate_rad_s
    rate = float(np.linalg.norm(earth))
    times = step * np.arange(count + 1, dtype=np.float64)
    inertial = attitude @ running_rotation(coned)
    c = rotation(earth / rate, -rate * times) @ inertial
    half = rotation(earth / rate, np.array([-rate * step / 2.0]))[0]
    gained = np.einsum("ij,njk,nk->ni", half, c[:-1], sculled, optimize=True)
    gained[:, 2] -= site.gravity_mps2 * step
    velocity = np.cumsum(gained, axis=0)[a_second - 1 :: a_second]
    shape = (count // a_second, a_second, 3)
    middle = ((c[:-1] + c[1:]) / 2.0).reshape(*shape, 3)
    transition = _transitions(
        middle, (theta / step).reshape(shape), (total / step).reshape(shape), step, site
    )
    mean = theta.reshape(shape).sum(axis=1) / (a_second * step)
    return Track(a_second * step, velocity, c[a_second::a_second], transition, np.linalg.norm(mean, axis=1))


def _transitions(c: Array, w: Array, f: Array, step: float, site: Site) -> Array:
    """Return navigation rows (m, 6, 37) from C (m, l, 3, 3), rate and force (m, l, 3) amid each step."""
    count, length = w.shape[:2]
    whole, _ = propagators(site, np.array([length * step]))
    left, _ = propagators(site, step * (length - 0.5 - np.arange(length)))
    rows = np.zeros((count, 6, 30 + EXTRA))
    rows[:, :, :6] = whole[0]
    gyro = np.concatenate([np.ones((count, length, 1)), w], axis=-1)
    for part, weight in ((slice(0, 3), left[:, :3, :3]), (slice(3, 6), left[:, 3:, :3])):
        moved = -step * np.einsum("lij,mljk->mlik", weight, c)
        found = np.swapaxes(moved.reshape(count, length, 9), 1, 2) @ gyro
        block = np.swapaxes(found.reshape(count, 3, 3, 4), 2, 3).reshape(count, 3, 12)
        rows[:, part, 6:9], rows[:, part, 12:21] = block[:, :, :3], block[:, :, 3:]
    force = np.concatenate([np.ones((count, length, 1)), f, f**2], axis=-1)
    found = (np.swapaxes(c.reshape(count, length, 9), 1, 2) @ force * step).reshape(count, 3, 3, 7)
    rows[:, 3:, 9:12] = found[..., 0]
    for at, (row, column) in enumerate(KA_ELEMENTS):
        rows[:, 3:, 21 + at] = found[:, :, row, 1 + column]
    for axis in range(3):
        rows[:, 3:, 27 + axis] = found[:, :, axis, 4 + axis]
    lever = _lever_rows(w.reshape(-1, 3), step).reshape(count, length, 3, 3)
    moved = np.einsum("mlpi,mlij->mpij", c[..., :2], lever[:, :, :2]) * step
    rows[:, 3:, 30:36] = moved.reshape(count, 3, 6)
    rows[:, 3:, 36] = np.einsum("mlpi,mli->mp", c, np.cross(w, f)) * step
    return rows


def _lever_rows(rate: Array, period_s: float) -> Array:
    """Return [w' x] + [w x]^2, shape (n, 3, 3), of rates (n, 3) at a constant period."""
    skew = cross_matrix(rate)
    return np.asarray(cross_matrix(np.gradient(rate, period_s, axis=0)) + skew @ skew)
