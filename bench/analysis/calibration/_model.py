"""The linear model of velocity at rest: F, transitions over dwells and turns in closed form, H, process noise.

    phi' = -w_ie x phi - C (eps + K_g w)          dv' = f^n x phi + C (nabla + K_a f + K_2 (f * f))

With x = (phi, dv), x' = A x + B(t) p: A (6, 6) does not depend on the attitude, p are the 24 parameters. So
x(T) = E(T) x(0) + int E(T - t) B(t) dt p with E = exp(A t) in closed form (Rodrigues). At rest B is constant and
the integral is closed too; over a turn it is a Gauss quadrature of a smooth function. True velocity is zero, so
there are no Coriolis terms and no position.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bench.analysis.calibration._conventions import DV, KA_ELEMENTS, STATES, Noise, Site, rotation
from bench.analysis.calibration._schedule import Move, Profile, Schedule
from bench.analysis.common.attitude import cross_matrix
from drivers.base.arrays import Array

MEASUREMENT_INTERVAL_S = 1.0
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(20)
"""For 90 deg: smooth turns are exact to 1e-12 (16 nodes leave 1e-10, 12 leave 7e-8)."""
_KNOTS: Array = np.arange(7.0) * (2.0 * math.pi / 7.0)
"""Angles, rad, that tell a trigonometric polynomial of degree 3."""


def specific_force_matrix(site: Site) -> Array:
    """Return [f^n x], shape (3, 3), of the specific force at rest."""
    return cross_matrix(np.array([0.0, 0.0, site.gravity_mps2]))


def forcing(attitude: Array, rate_rad_s: Array, force_mps2: Array) -> Array:
    """Return B, shape (..., 6, 24), from C (..., 3, 3), body rate and specific force in b, (..., 3) each."""
    b = np.zeros((*attitude.shape[:-2], 6, 24))
    b[..., :3, 0:3] = -attitude
    b[..., 3:, 3:6] = attitude
    b[..., :3, 6:15] = -by_column(attitude, rate_rad_s)
    rows, columns = np.transpose(KA_ELEMENTS)
    b[..., 3:, 15:21] = attitude[..., rows] * force_mps2[..., None, columns]
    b[..., 3:, 21:24] = attitude * (force_mps2**2)[..., None, :]
    return b


def by_column(attitude: Array, vector: Array) -> Array:
    """Return d(C K v) / dK, shape (..., i, 9), from C (..., i, 3) and v (..., 3), K (3, 3) column by column."""
    return np.asarray((attitude[..., None, :] * vector[..., None, :, None]).reshape(*attitude.shape[:-1], 9))


def rest_inputs(site: Site, attitude: Array) -> tuple[Array, Array]:
    """Return body rate in rad/s and specific force in m/s^2, (..., 3) each, at rest at C (..., 3, 3)."""
    gravity = np.array([0.0, 0.0, site.gravity_mps2])
    return np.asarray(site.earth_rate_rad_s @ attitude), np.asarray(gravity @ attitude)


def propagators(site: Site, time_s: Array) -> tuple[Array, Array]:
    """Return E = exp(A t) and its integral J from 0 to t, (n, 6, 6) each, for times (n,)."""
    earth = site.earth_rate_rad_s
    rate = float(np.linalg.norm(earth))
    skew = cross_matrix(earth / rate)
    square, one, t = skew @ skew, np.eye(3), np.asarray(time_s, dtype=float)[:, None, None]
    sine, cosine = np.sin(rate * t), np.cos(rate * t)
    turn = one - sine * skew + (1.0 - cosine) * square
    once = t * one - (1.0 - cosine) / rate * skew + (t - sine / rate) * square
    twice = (
        t**2 / 2.0 * one - (t - sine / rate) / rate * skew + (t**2 / 2.0 - (1.0 - cosine) / rate**2) * square
    )
    force = specific_force_matrix(site)
    e, j = np.zeros((len(t), 6, 6)), np.zeros((len(t), 6, 6))
    e[:, :3, :3], e[:, 3:, :3], e[:, 3:, 3:] = turn, force @ once, one
    j[:, :3, :3], j[:, 3:, :3], j[:, 3:, 3:] = once, force @ twice, t * one
    return e, j


def dwell_transitions(site: Site, attitude: Array, time_s: Array) -> Array:
    """Return the navigation rows of the transition, shape (n, m, 6, 30): rest at C (n, 3, 3) for times (m,)."""
    e, j = propagators(site, time_s)
    b = forcing(attitude, *rest_inputs(site, attitude))
    return np.concatenate(
        [np.broadcast_to(e, (len(attitude), *e.shape)), np.einsum("mij,njk->nmik", j, b)], axis=-1
    )


def turn_angle(profile: Profile, angle_rad: float, duration_s: float, time_s: Array) -> tuple[Array, Array]:
    """Return angle in rad and rate in rad/s, (n,) each, at times (n,) of a turn."""
    s = time_s / duration_s
    if profile == "constant":
        return angle_rad * s, np.full_like(s, angle_rad / duration_s)
    angle = angle_rad * (s - np.sin(2.0 * math.pi * s) / (2.0 * math.pi))
    return angle, angle_rad / duration_s * (1.0 - np.cos(2.0 * math.pi * s))


def turn_transitions(
    site: Site, attitude: Array, moves: Sequence[Move], rate_dps: float, profile: Profile
) -> Array:
    """Return the navigation rows of the transition over turns from C (n, 3, 3), one move each: (n, 6, 30).

    In the angle turned B is a trigonometric polynomial of degree 3 (K_2: C f^2), plus the rate times one of
    degree 1. So B at `_KNOTS`, angles around the circle, tells it at every angle, and what each of them weighs
    follows from the size of the turn alone.
    """
    sizes = np.array([abs(move.angle_deg) for move in moves], dtype=int)
    axes = np.eye(3)[np.array([move.axis for move in moves], dtype=int)]
    axes *= np.sign([move.angle_deg for move in moves])[:, None]
    c = attitude[:, None] @ rotation(axes[:, None], _KNOTS)
    b = forcing(c, *rest_inputs(site, c))
    found = np.empty((len(moves), 6, STATES))
    for size in np.unique(sizes).tolist():
        of_size = sizes == size
        whole, at_rest, turning = _over_turn(site, math.radians(size), size / rate_dps, profile)
        driven = _summed(at_rest, b[of_size])
        driven[..., 6:15] -= by_column(_summed(turning, c[of_size]), axes[of_size])
        found[of_size, :, :6], found[of_size, :, 6:] = whole, driven
    return found


def _over_turn(
    site: Site, angle_rad: float, duration_s: float, profile: Profile
) -> tuple[Array, Array, Array]:
    """Return E(T), (6, 6), and int E(T - t) l(t) dt, (k, 6, 6), and int E(T - t) l(t) rate dt, (k, 6, 3).

    l is 1 at one of the k knots and 0 at the others: the Dirichlet kernel of degree 3. One Gauss quadrature for
    each quarter of the turn.
    """
    panels = max(1, round(2.0 * angle_rad / math.pi))
    time = duration_s / panels * (np.arange(panels)[:, None] + (_NODES + 1.0) / 2.0).ravel()
    angle, rate = turn_angle(profile, angle_rad, duration_s, time)
    degrees = np.arange(1, 4)[:, None, None]
    kernel = (1.0 + 2.0 * np.cos(degrees * (_KNOTS[:, None] - angle)).sum(axis=0)) / len(_KNOTS)
    kernel *= duration_s / panels / 2.0 * np.tile(_WEIGHTS, panels)
    whole, *to_end = propagators(site, duration_s - np.concatenate(([0.0], time)))[0]
    steps = np.reshape(to_end, (-1, 36))
    at_rest, turning = ((part @ steps).reshape(-1, 6, 6) for part in (kernel, kernel * rate))
    return whole, at_rest, turning[..., :3]


def _summed(weights: Array, parts: Array) -> Array:
    """Return the sum over k of weights (k, 6, i) times parts (n, k, i, j): (n, 6, j)."""
    count, knots, columns, width = parts.shape
    left = np.swapaxes(weights, 0, 1).reshape(6, knots * columns)
    return np.asarray(left @ parts.reshape(count, knots * columns, width))


def process_noise(site: Site, noise: Noise, time_s: float | Array) -> Array:
    """Return the covariance, (..., 6, 6), that white noise adds to (phi, dv) in times (...).

    It is isotropic, so C cancels.
    """
    force, one, t = specific_force_matrix(site), np.eye(3), np.asarray(time_s)[..., None, None]
    angle = noise.arw**2 * t
    across = angle * t / 2.0 * force
    q = np.empty((*np.shape(time_s), 6, 6))
    q[..., :3, :3] = angle * one
    q[..., 3:, 3:] = noise.vrw**2 * t * one + angle * t**2 / 3.0 * (force @ force.T)
    q[..., 3:, :3], q[..., :3, 3:] = across, -across
    return q


def measurement_times(dwell_s: float) -> Array:
    """Return when velocity is measured in a dwell, s from its start: every second, the last at its end."""
    count = max(1, round(dwell_s / MEASUREMENT_INTERVAL_S))
    return np.asarray(dwell_s * np.arange(1, count + 1) / count)


def chain(rows: Array, before: Array) -> Array:
    """Return navigation rows (..., 6, 30) of a transition that comes after one with rows `before` (6, 30)."""
    after = rows[..., :6] @ before
    after[..., 6:] += rows[..., 6:]
    return np.asarray(after)


def observability_matrix(site: Site, schedule: Schedule) -> Array:
    """Return Q, shape (3 m, 30): the velocities at all m measurement times as functions of the first state."""
    attitudes = schedule.attitudes()
    turns = turn_transitions(site, attitudes[:-1], schedule.moves, schedule.rate_dps, schedule.profile)
    dwells = dwell_transitions(site, attitudes, measurement_times(schedule.dwell_s))
    reached = np.eye(6, STATES)
    blocks = [reached[None, DV]]
    for number, dwell in enumerate(dwells):
        rows = chain(dwell, reached)
        blocks.append(rows[:, DV])
        reached = rows[-1]
        if number < len(turns):
            reached = chain(turns[number], reached)
    return np.concatenate(blocks).reshape(-1, STATES)
