"""Constants of the Earth and of units, each written once, with its source."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

EARTH_RATE_RAD_S = 7.292115e-5
"""Rotation rate of the Earth against the stars, WGS 84 (NIMA TR8350.2, table 3.1)."""
EARTH_RATE_DPH = 15.041067
"""The same in deg/h, rounded to eight digits as rate records have always used it (unrounded: 15.0410669)."""
SIDEREAL_DAY_S = 2.0 * math.pi / EARTH_RATE_RAD_S
EARTH_MU_M3PS2 = 3.986004418e14
"""Gravitational constant times mass of the Earth, WGS 84."""
EARTH_AXIS_M = 6378137.0
"""Semi-major axis of the Earth's ellipsoid, WGS 84."""
EARTH_ECCENTRICITY_SQUARED = 6.69437999014e-3
"""Of the Earth's ellipsoid, WGS 84."""
SCHULER_RAD_S = math.sqrt(EARTH_MU_M3PS2 / EARTH_AXIS_M**3)
"""Schuler frequency at the equator."""
STANDARD_GRAVITY_MPS2 = 9.80665
"""Unit g of data sheets (CGPM 1901)."""
EQUATOR_GRAVITY_MPS2 = 9.7803267715
"""Normal gravity at the equator (GRS 80): unit g of the strapdown literature's ug."""
UG_MPS2 = EQUATOR_GRAVITY_MPS2 * 1e-6
ZERO_CELSIUS_K = 273.15
ARCSEC_RAD = math.radians(1.0) / 3600.0
"""One arcsecond; also one deg/h in rad/s, as an hour has as many seconds as a degree has arcseconds."""
ARCSEC_PER_RAD = math.degrees(3600.0)
DPH_PER_DPS = 3600.0
DIRECTIONS: Mapping[str, tuple[int, int, int]] = MappingProxyType(
    {
        "east": (1, 0, 0),
        "west": (-1, 0, 0),
        "north": (0, 1, 0),
        "south": (0, -1, 0),
        "up": (0, 0, 1),
        "down": (0, 0, -1),
    }
)
"""Unit vectors in east, north, up."""


def earth_rate_north_dph(latitude_deg: float) -> float:
    """Return the northward component of the Earth's rate in deg/h."""
    return EARTH_RATE_DPH * math.cos(math.radians(latitude_deg))


def earth_rate_up_dph(latitude_deg: float) -> float:
    """Return the upward component of the Earth's rate in deg/h."""
    return EARTH_RATE_DPH * math.sin(math.radians(latitude_deg))


def gravity_mps2(latitude_deg: float, height_m: float = 0.0) -> float:
    """Return normal gravity: Somigliana's formula for WGS 84, free-air gradient 3.086e-6 1/s2."""
    s = math.sin(math.radians(latitude_deg)) ** 2
    surface = 9.7803253359 * (1.0 + 0.00193185265241 * s) / math.sqrt(1.0 - EARTH_ECCENTRICITY_SQUARED * s)
    return surface - 3.086e-6 * height_m
