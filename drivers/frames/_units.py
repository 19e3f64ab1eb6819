"""The units a field may be in, and what takes them to the bench's own."""

from __future__ import annotations

import math

from drivers.base.constants import STANDARD_GRAVITY_MPS2, ZERO_CELSIUS_K

_DEG = 180.0 / math.pi

UNITS: dict[str, tuple[str, float, float]] = {
    "deg/s": ("rate", 1.0, 0.0),
    "deg/h": ("rate", 1.0 / 3600.0, 0.0),
    "rad/s": ("rate", _DEG, 0.0),
    "mdeg/s": ("rate", 1e-3, 0.0),
    "arcsec/s": ("rate", 1.0 / 3600.0, 0.0),
    "deg": ("angle", 1.0, 0.0),
    "arcsec": ("angle", 1.0 / 3600.0, 0.0),
    "rad": ("angle", _DEG, 0.0),
    "m/s2": ("acceleration", 1.0, 0.0),
    "g": ("acceleration", STANDARD_GRAVITY_MPS2, 0.0),
    "mg": ("acceleration", STANDARD_GRAVITY_MPS2 * 1e-3, 0.0),
    "ft/s2": ("acceleration", 0.3048, 0.0),
    "m/s": ("velocity", 1.0, 0.0),
    "g*s": ("velocity", STANDARD_GRAVITY_MPS2, 0.0),
    "ft/s": ("velocity", 0.3048, 0.0),
    "degC": ("temperature", 1.0, 0.0),
    "K": ("temperature", 1.0, -ZERO_CELSIUS_K),
    "degF": ("temperature", 5.0 / 9.0, -160.0 / 9.0),
    "s": ("time", 1.0, 0.0),
    "ms": ("time", 1e-3, 0.0),
    "us": ("time", 1e-6, 0.0),
    "Pa": ("pressure", 1.0, 0.0),
    "hPa": ("pressure", 100.0, 0.0),
    "kPa": ("pressure", 1e3, 0.0),
    "uT": ("magnetic field", 1.0, 0.0),
    "gauss": ("magnetic field", 100.0, 0.0),
    "V": ("voltage", 1.0, 0.0),
    "A": ("current", 1.0, 0.0),
    "Hz": ("frequency", 1.0, 0.0),
    "%": ("ratio", 0.01, 0.0),
    "1": ("number", 1.0, 0.0),
}
"""Unit -> (quantity, factor, constant): value * factor + constant is in deg/s, deg, m/s2, m/s, degC, s, Pa ..."""

QUANTITY_OF_ROLE = {
    "rate": "rate",
    "delta_angle": "angle",
    "cumulative_angle": "angle",
    "accel": "acceleration",
    "delta_velocity": "velocity",
    "temp": "temperature",
    "case_temp": "temperature",
    "since_pulse": "time",
}
"""Role -> the quantity that its unit must measure."""


def factor(unit: str) -> float:
    """Return what takes `unit` to the bench's unit of its quantity."""
    return UNITS[unit][1]


def constant(unit: str) -> float:
    """Return what is added after `factor`: other than 0 for temperatures only."""
    return UNITS[unit][2]
