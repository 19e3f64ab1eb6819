"""The patent's fit: the integrated residual rate, a Fourier series in the rotation angle, coefficients matched.

    theta_x = sum x_c cos n psi + x_s sin n psi, theta_y likewise;
    integral of wbar_x = sum A_x cos n psi + B_x sin n psi, wbar_y likewise.

For n = 1 the matching equations have rank 2 of 4: x1 and y2 are seen only as y2 - x1, x2 and y1 only as y1 +
x2 (the free part of `bench.analysis.whirl._gauge`); here they are the ones of smallest norm, and other gauges are
added after. Order 2 holds the body lines -1, 2 and 3. It cannot hold a constant tilt of the unit against the
spin axis (line +1) nor line -2. Start of the integral and drift are a constant and a ramp in angle, both
fitted with the series.
"""

from __future__ import annotations

import numpy as np

from bench.analysis.whirl._kinematics import harmonic_matrix
from bench.analysis.whirl._residual import residual_increments
from bench.analysis.whirl._types import Complex, TurnRecord
from drivers.base.arrays import Array

_EVERY_S = 0.1
"""Spacing of the integral's values that are fitted."""


def fit_integral(
    record: TurnRecord, order: int = 2, *, body_rate_dph: complex = 0j, angle_rad: Array | None = None
) -> Array:
    """Return the series of the integrated residual rate at the measured angle: (order, 4), A_x, A_y, B_x, B_y.

    `angle_rad`, (n + 1,): another angle to fit at, such as the nominal w t. The record has at least a full turn
    and no holes: an integral has no way across them (the direct fit has). In rotation one way the constant tilt
    and drift make a ramp in angle, which is not corrected.
    """
    increments = residual_increments(record, body_rate_dph)
    step = max(1, round(_EVERY_S / record.period_s))
    integral = np.concatenate(([0j], np.cumsum(increments)))[::step]
    angle = (record.angle_rad if angle_rad is None else angle_rad)[::step]
    harmonics = [n for n in range(-order, order + 1) if n]
    columns = [np.ones(len(angle)), angle - angle.mean(), *(np.exp(1j * n * angle) for n in harmonics)]
    design = np.stack(columns, axis=1).astype(np.complex128)
    values = np.linalg.solve(design.conj().T @ design, design.conj().T @ integral)
    found = dict(zip(harmonics, values[2:], strict=True))
    cosine = np.array([found[n] + found[-n] for n in range(1, order + 1)])
    sine = np.array([1j * (found[n] - found[-n]) for n in range(1, order + 1)])
    return np.stack([cosine.real, cosine.imag, sine.real, sine.imag], axis=1)


def match_coefficients(series_arcsec: Array) -> Array:
    """Return the patent's unknowns (order, 4): x cosine, x sine, y cosine, y sine of each harmonic, arcsec.

    Solved by the pseudo-inverse, which for the first harmonic leaves the free part at its smallest norm;
    harmonics from 2 on have one solution.
    """
    coefficients = []
    for n, (ax, ay, bx, by) in enumerate(series_arcsec, start=1):
        # Cosine and sine coefficients of wbar_x and wbar_y in units of w, from those of their integrals.
        rates = np.array([n * bx, -n * ax, n * by, -n * ay])
        coefficients.append(np.linalg.pinv(harmonic_matrix(n)) @ rates)
    return np.stack(coefficients)


def body_lines(coefficients_arcsec: Array) -> tuple[tuple[float, ...], Complex]:
    """Return the lines m = n + 1 and their amplitudes (l,) of coefficients as `match_coefficients` gives them.

    Line 0, the free part, is left out.
    """
    lines: list[float] = []
    amplitudes: list[complex] = []
    for n, (xc, xs, yc, ys) in enumerate(coefficients_arcsec, start=1):
        cosine, sine = yc + 1j * xc, ys + 1j * xs
        for sign in (-1, 1):
            if sign * n + 1:
                lines.append(float(sign * n + 1))
                amplitudes.append(complex(0.5 * (cosine - 1j * sign * sine)))
    return tuple(lines), np.array(amplitudes)
