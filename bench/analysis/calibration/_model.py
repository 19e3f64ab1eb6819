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
_NODES_A_QUARTER = 20
"""Gauss nodes for 90 deg: smooth turns are exact to 1e-12 (16 nodes leave 1e-10, 12 leave 7e-8)."""


def specific_force_matrix(site: Site) -> Array:
    """Return [f^n x], shape (3, 3), of the specific force at rest."""
    return cross_matrix(np.array([0.0, 0.0, site.gravity_mps2]))


def forcing(attitude: Array, rate_rad_s: Array, force_mps2: Array) -> Array:
    """Return B, shape (n, 6, 24), from C (n, 3, 3), body rate and specific force in b, (n, 3) each."""
    b = np.zeros((len(attitude), 6, 24))
    b[:, :3, 0:3] = -attitude
    b[:, 3:, 3:6] = attitude
    for column in range(3):
        at = 6 + 3 * column
        b[:, :3, at : at + 3] = -attitude * rate_rad_s[:, column, None, None]
    for at, (row, column) in enumerate(KA_ELEMENTS):
        b[:, 3:, 15 + at] = attitude[:, :, row] * force_mps2[:, column, None]
    b[:, 3:, 21:24] = attitude * (force_mps2**2)[:, None, :]
    return b


def rest_inputs(site: Site, attitude: Array) -> tuple[Array, Array]:
    """Return body rate in rad/s and specific force in m/s^2, (n, 3) each, at rest at C (n, 3, 3)."""
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
    """Return the navigation rows of the transition over turns from C (n, 3, 3), one move each: (n, 6, 30)."""
    found = np.empty((len(moves), 6, STATES))
    for number, move in enumerate(moves):
        duration = abs(move.angle_deg) / rate_dps
        nodes, weights = np.polynomial.legendre.leggauss(_NODES_A_QUARTER * max(1, abs(move.angle_deg) // 90))
        time, weights = duration * (nodes + 1.0) / 2.0, weights * duration / 2.0
        axis = np.eye(3)[move.axis]
        angle, rate = turn_angle(profile, math.radians(move.angle_deg), duration, time)
        c = attitude[number] @ rotation(axis, angle)
        rest, force = rest_inputs(site, c)
        to_end, _ = propagators(site, duration - time)
        b = forcing(c, rest + rate[:, None] * axis, force)
        whole, _ = propagators(site, np.array([duration]))
        found[number, :, :6] = whole[0]
        found[number, :, 6:] = np.einsum("n,nij,njk->ik", weights, to_end, b)
    return found


def process_noise(site: Site, noise: Noise, time_s: float) -> Array:
    """Return the covariance, (6, 6), that white noise adds to (phi, dv) in `time_s`; isotropic, so C cancels."""
    force = specific_force_matrix(site)
    q = np.zeros((6, 6))
    q[:3, :3] = noise.arw**2 * time_s * np.eye(3)
    q[3:, 3:] = noise.vrw**2 * time_s * np.eye(3) + noise.arw**2 * time_s**3 / 3.0 * force @ force.T
    q[3:, :3] = noise.arw**2 * time_s**2 / 2.0 * force
    q[:3, 3:] = q[3:, :3].T
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
