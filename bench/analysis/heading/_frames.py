"""Inertial frame, sidereal angle, and how a platform's misalignment shows in latitude and longitude.

Axes i: z along the Earth's pole; the sidereal angle is longitude plus the Earth's turn, so that the local
meridian lies at that angle from x. The misalignment phi turns the true direction into the computed one,
u_computed = u + phi x u, errors are computed minus true; the platform's own physical turn and drift are -phi
and -eps. Angles in arcsec and drifts in deg/h, which makes one deg/h one arcsec a second.
"""

from __future__ import annotations

import math

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import EARTH_ECCENTRICITY_SQUARED, EARTH_RATE_RAD_S

_UNIX_J2000_S = 946728000.0


def sidereal_rad(time_s: Array, zero_deg: float) -> Array:
    """Return the sidereal angle of the local meridian, rad, not wrapped, for times of any shape.

    `zero_deg` is the angle at time 0: longitude alone when nothing but the phase between runs of one clock
    counts, or `earth_rotation_deg` of the clock's zero plus the longitude.
    """
    return math.radians(zero_deg) + EARTH_RATE_RAD_S * np.asarray(time_s, dtype=np.float64)


def earth_rotation_deg(epoch_s: float) -> float:
    """Return the Earth rotation angle, deg in [0, 360), at `epoch_s` s since 1970 (UTC taken as UT1).

    IERS Conventions 2010, equation 5.15; UT1 - UTC of up to 0.9 s is 0.004 deg.
    """
    days = (epoch_s - _UNIX_J2000_S) / 86400.0
    return 360.0 * ((0.7790572732640 + 1.00273781191135448 * days) % 1.0)


def gravitation_latitude_deg(geodetic_deg: Array | float) -> Array:
    """Return the latitude of the gravitation's direction at points on the WGS 84 ellipsoid, any shape.

    It lies midway between geodetic and geocentric latitude (J2 makes half of the flattening). A platform that
    integrates in inertial axes obeys the error equations in it: integrated with J2 at 20 .. 75 deg, a window of
    a sidereal day finds the drift to 0.05 % of the misalignment a day; with either other latitude, to 0.5 %.
    """
    geodetic = np.radians(geodetic_deg)
    geocentric = np.arctan2((1.0 - EARTH_ECCENTRICITY_SQUARED) * np.sin(geodetic), np.cos(geodetic))
    return np.asarray(0.5 * np.degrees(geodetic + geocentric), dtype=np.float64)


def position_rows(angle_rad: Array, latitude_deg: float) -> tuple[Array, Array]:
    """Return (north, east), each (n, 3): position error in arcsec per arcsec of misalignment on i axes.

    dL = phi_x sin - phi_y cos; cos L dlambda = phi_z cos L - sin L (phi_x cos + phi_y sin). The east error is
    used instead of the longitude error, for equal noise and no pole.
    """
    sine, cosine = np.sin(angle_rad), np.cos(angle_rad)
    up, level = math.sin(math.radians(latitude_deg)), math.cos(math.radians(latitude_deg))
    north = np.stack([sine, -cosine, np.zeros_like(sine)], axis=-1)
    east = np.stack([-up * cosine, -up * sine, np.full_like(sine, level)], axis=-1)
    return north, east


def position_error(phi_as: Array, angle_rad: Array, latitude_deg: float) -> tuple[Array, Array]:
    """Return (north, east) errors in arcsec, shape (n,), of misalignments `phi_as`, shape (n, 3)."""
    north, east = position_rows(angle_rad, latitude_deg)
    return np.sum(north * phi_as, axis=-1), np.sum(east * phi_as, axis=-1)


def wrap_deg(angle_deg: Array | float) -> Array:
    """Return angles brought into [-180, 180)."""
    return np.asarray((np.asarray(angle_deg) + 180.0) % 360.0 - 180.0, dtype=np.float64)
