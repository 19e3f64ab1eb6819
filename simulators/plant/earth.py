"""Earth rate, and its projection on the axes of a unit that sits on a vertical table axis.

Sign convention of the whole plant. The table axis points up and its angle is counter-clockwise positive seen
from above (right-handed about up), so a unit with its axis up reads +20 deg/s at a table rate of +20 deg/s. A
horizontal sensitive axis points `scale angle = table angle + mount azimuth error` from north on that same scale;
its azimuth in the navigator's sense (clockwise) is minus the scale angle. The Earth-rate projection
w_ie cos(latitude) cos(scale angle) is the same for either sense; 90 and 270 deg are the east-west line.
"""

from __future__ import annotations

import math

EARTH_RATE_DPH = 15.041067
"""Inertial rotation rate of the Earth (WGS 84: 7.292115e-5 rad/s)."""


def gravity_mps2(latitude_deg: float, height_m: float = 0.0) -> float:
    """Return normal gravity in m/s2: Somigliana's formula for WGS 84, free-air gradient 3.086e-6 1/s2."""
    s = math.sin(math.radians(latitude_deg)) ** 2
    surface = 9.7803253359 * (1.0 + 0.00193185265241 * s) / math.sqrt(1.0 - 0.00669437999014 * s)
    return surface - 3.086e-6 * height_m


def vertical_rate_dph(latitude_deg: float) -> float:
    """Return the upward component of Earth rate in deg/h: w_ie sin(latitude)."""
    return EARTH_RATE_DPH * math.sin(math.radians(latitude_deg))


def horizontal_rate_dph(latitude_deg: float) -> float:
    """Return the northward component of Earth rate in deg/h: w_ie cos(latitude)."""
    return EARTH_RATE_DPH * math.cos(math.radians(latitude_deg))


def projection_dph(latitude_deg: float, scale_angle_deg: float, elevation_deg: float = 0.0) -> float:
    """Return Earth rate in deg/h along an axis `scale_angle_deg` from north, raised by `elevation_deg`."""
    elevation = math.radians(elevation_deg)
    horizontal = horizontal_rate_dph(latitude_deg) * math.cos(math.radians(scale_angle_deg))
    return math.cos(elevation) * horizontal + math.sin(elevation) * vertical_rate_dph(latitude_deg)
