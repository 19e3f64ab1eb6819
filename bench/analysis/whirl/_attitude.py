"""Carrier attitude from gyros and rotation angle, and how much of it oscillates.

The unit's own attitude is the strapdown integral of its rates; the carrier's is that times C_b^s'. Without a
whirl compensation C_b^s is used instead, and the carrier seems to tilt by the whirl's body tilt.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from bench.analysis.common.attitude import rotations, running_rotation
from bench.analysis.common.statistics import hold
from bench.analysis.whirl._kinematics import body_to_rotating
from bench.analysis.whirl._types import Complex, TurnRecord
from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_PER_RAD, EARTH_RATE_DPH

LOCKED_LINES = tuple(float(line) for line in range(-6, 7) if line)
WINDOW_TURNS = 2.0


@dataclass(frozen=True)
class Oscillation:
    """Rms an axis, arcsec: `total` about a moving mean of two turns, `locked` to the rotation angle."""

    total_arcsec: float
    locked_arcsec: float


def unit_attitude(record: TurnRecord, heading_deg: float) -> Array:
    """Return C_s'^n at the edges of the samples, float64 (n + 1, 3, 3), n = east, north, up, of a unit at rest.

    Strapdown integral from a level start, the body's y axis at `heading_deg` clockwise from north; the Earth
    turns under it. Samples that are not usable hold the rate before them. Levelling errors t turn the result
    slowly (t times Earth rate).
    """
    rate = np.radians(hold(record.rate_dps, record.usable))
    level = rotations(np.array([[0.0, 0.0, -np.radians(heading_deg)]]))[0]
    start = level @ body_to_rotating(record.angle_rad[:1])[0].T
    inertial = start @ running_rotation(rate * record.period_s)
    latitude = np.radians(record.latitude_deg)
    earth = np.radians(EARTH_RATE_DPH / 3600.0) * np.array([0.0, np.cos(latitude), np.sin(latitude)])
    since = record.time_s - record.time_s[0]
    return np.asarray(rotations(-since[:, None] * earth) @ inertial)


def carrier_tilt(attitude: Array) -> Complex:
    """Return the tilt of carrier attitudes C_b^n (n, 3, 3) against the first, arcsec, about x_b + j y_b."""
    vector = Rotation.from_matrix(attitude[0].T @ attitude).as_rotvec()
    return np.asarray((vector[:, 0] + 1j * vector[:, 1]) * ARCSEC_PER_RAD)


def locked_tilt(record: TurnRecord, heading_deg: float) -> Complex:
    """Return the tilt of a carrier whose mechanism stands still, less its straight line, arcsec, (n + 1,)."""
    tilt = carrier_tilt(uncompensated(unit_attitude(record, heading_deg), record.angle_rad))
    since = record.time_s - record.time_s[0]
    line = np.column_stack([np.ones(len(since)), since]).astype(np.complex128)
    return np.asarray(tilt - line @ np.linalg.lstsq(line, tilt, rcond=None)[0])


def uncompensated(attitude: Array, angle_rad: Array) -> Array:
    """Return the carrier attitude C_b^n = C_s'^n C_b^s that ignores whirl, float64 (n, 3, 3)."""
    return np.asarray(attitude @ body_to_rotating(angle_rad))


def remove_slow(tilt: Complex, time_s: Array, angle_rad: Array) -> tuple[Complex, slice]:
    """Return a tilt minus its moving mean over the time of two turns, complex (m,), and where it lies in the
    record.

    The mean is centred; half a window at each end is left out.
    """
    rate = float(np.abs(np.diff(angle_rad)).sum()) / float(time_s[-1] - time_s[0])
    step = float(time_s[-1] - time_s[0]) / (len(time_s) - 1)
    half = max(1, round(WINDOW_TURNS * np.pi / rate / step))
    if 2 * half + 1 >= len(tilt):
        return tilt - tilt.mean(), slice(0, len(tilt))
    total = np.concatenate(([0j], np.cumsum(tilt)))
    window = 2 * half + 1
    # the two ends of a window that covers whole turns are the same angle: half weight each
    mean = (total[window:] - total[:-window] - 0.5 * (tilt[2 * half :] + tilt[: len(tilt) - 2 * half])) / (
        2 * half
    )
    where = slice(half, len(tilt) - half)
    return tilt[where] - mean, where


def oscillation(tilt: Complex, time_s: Array, angle_rad: Array) -> Oscillation:
    """Return how much a carrier tilt (n,) oscillates: in all, and locked to the rotation angle."""
    moving, where = remove_slow(tilt, time_s, angle_rad)
    design = np.stack([np.exp(1j * line * angle_rad[where]) for line in (0.0, *LOCKED_LINES)], axis=1)
    values = np.linalg.solve(design.conj().T @ design, design.conj().T @ moving)
    return Oscillation(
        float(np.sqrt((np.abs(moving) ** 2).mean() / 2.0)),
        float(np.sqrt((np.abs(values[1:]) ** 2).sum() / 2.0)),
    )


def tilt_spectrum(tilt: Complex, angle_rad: Array, lines: Array) -> Array:
    """Return the amplitude of a tilt (n,) at each of `lines` (l,), turns a turn of the table, arcsec."""
    flat = tilt - tilt.mean()
    weight = np.hanning(len(flat) + 2)[1:-1]
    flat = flat * weight / weight.sum()
    return np.array([abs(np.vdot(np.exp(1j * line * angle_rad), flat)) for line in lines])
