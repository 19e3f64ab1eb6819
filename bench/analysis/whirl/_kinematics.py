"""Kinematics of whirl: frames, the rate that a whirl makes, body lines, and what of it gyros can see.

b is the mechanism's body, s the perfect rotating frame, s' the true frame of the gyros. psi is the rotation
angle, counter-clockwise positive about +z, w = psi' is signed. With the small tilt (alpha, beta, 0) in s, the
patent's theta_y = alpha and theta_x = beta, everything is one complex equation:

    Th = theta_y + j theta_x,  wbar = wbar_x + j wbar_y:   wbar = Th' + j w Th,   wbar exp(j psi) = d/dt Th_b,

Th_b = Th exp(j psi) being the tilt in body axes: sum a_m exp(j m psi). Gyros give the increments of Th_b
whatever psi(t) is; its constant a_0, a fixed tilt of the spin axis in the body, makes no angular rate and is
free. Source: equations (5), (7), (8) of the patent on whirl compensation of a rotating INS, checked with
matrices.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bench.analysis.common.attitude import rotations
from bench.analysis.whirl._types import Complex
from drivers.base.arrays import Array


def body_tilt(angle_rad: Array, lines: Sequence[float], amplitudes: Complex) -> Complex:
    """Return the tilt in body axes, sum a_m exp(j m psi), complex (n,), in the unit of `amplitudes`."""
    tilt = np.zeros(len(angle_rad), np.complex128)
    for line, amplitude in zip(lines, amplitudes, strict=True):
        tilt += amplitude * np.exp(1j * line * angle_rad)
    return tilt


def body_to_rotating(angle_rad: Array) -> Array:
    """Return C_b^s, float64 (n, 3, 3), at rotation angles (n,) (the patent's (5))."""
    sin, cos = np.sin(angle_rad), np.cos(angle_rad)
    matrix = np.zeros((len(angle_rad), 3, 3))
    matrix[:, 0, 0] = matrix[:, 1, 1] = cos
    matrix[:, 0, 1], matrix[:, 1, 0], matrix[:, 2, 2] = sin, -sin, 1.0
    return matrix


def body_to_true(angle_rad: Array, tilt_rad: Complex) -> Array:
    """Return C_b^s' = C_b^s exp(-[th_b x]), float64 (n, 3, 3), for tilts in body axes, complex (n,) in rad."""
    vector = np.stack([tilt_rad.real, tilt_rad.imag, np.zeros(len(tilt_rad))], axis=1)
    return np.asarray(body_to_rotating(angle_rad) @ rotations(-vector))


def harmonic_matrix(harmonic: int) -> Array:
    """Return the 4 x 4 matrix from the patent's unknowns to its rate equations for harmonic n, in units of w.

    Unknowns: cosine and sine coefficients of theta_x, then of theta_y; rows: cosine and sine coefficients of
    wbar_x, then of wbar_y. For n = 1 it has rank 2 (singular values 2, 2, 0, 0): matching the first harmonic
    has no unique solution.
    """
    n = float(harmonic)
    return np.array([[-1.0, 0.0, 0.0, n], [0.0, -1.0, -n, 0.0], [0.0, n, 1.0, 0.0], [-n, 0.0, 0.0, 1.0]])
