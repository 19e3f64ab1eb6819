"""Units of foreign logs, with a factor and an offset: "ms", "0.0305 deg/s", "0.00294 degC + 36.53"."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from drivers.base.constants import STANDARD_GRAVITY_MPS2, ZERO_CELSIUS_K
from drivers.base.errors import ConfigurationError

RATE, FORCE, TEMPERATURE, TIME, ANGLE = "rate", "specific force", "temperature", "time", "angle"
POWER, OPENING = "power", "opening"
BASE_UNITS = {
    RATE: "deg/s", FORCE: "m/s^2", TEMPERATURE: "degC", TIME: "s", ANGLE: "deg", POWER: "W", OPENING: "fraction",
}  # fmt: skip
_G = STANDARD_GRAVITY_MPS2
_FACTORS = {
    RATE: {
        "deg/s": 1.0, "deg/h": 1 / 3600, "rad/s": math.degrees(1.0), "rad/h": math.degrees(1.0) / 3600,
        "dps": 1.0, "mdps": 1e-3, "dph": 1 / 3600, "mrad/s": math.degrees(1e-3), "arcsec/s": 1 / 3600, "rpm": 6.0,
    },
    FORCE: {"m/s^2": 1.0, "g": _G, "mg": 1e-3 * _G, "ug": 1e-6 * _G},
    TEMPERATURE: {"degC": 1.0, "K": 1.0, "degF": 5 / 9, "mdegC": 1e-3},
    TIME: {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    ANGLE: {"deg": 1.0, "rad": math.degrees(1.0)},
    POWER: {"W": 1.0, "mW": 1e-3, "kW": 1e3},
    OPENING: {"fraction": 1.0, "%": 0.01},
}  # fmt: skip
_OFFSETS = {"K": -ZERO_CELSIUS_K, "degF": -160.0 / 9.0}
_INCREMENTS = {
    RATE: {"deg": 1.0, "rad": math.degrees(1.0), "arcsec": 1 / 3600, "urad": math.degrees(1e-6)},
    FORCE: {"m/s": 1.0, "g*s": _G, "mg*s": 1e-3 * _G, "ug*s": 1e-6 * _G},
}
_SPELT = {"°": "deg", "º": "deg", "²": "^2", "³": "^3", "⁻": "-", "¹": "1", "·": ".", "µ": "u", "μ": "u"}
_ALIASES = {
    "m/s2": "m/s^2", "m/s/s": "m/s^2", "m/sec^2": "m/s^2", "deg/sec": "deg/s", "rad/sec": "rad/s",
    "deg/hr": "deg/h", "rads/s": "rad/s", "gs": "g",
    "c": "degc", "celsius": "degc", "f": "degf", "kelvin": "k", "sec": "s", "seconds": "s",
    "msec": "ms", "usec": "us", "hr": "h",
}  # fmt: skip
_SPELLINGS = (
    (re.compile(r"(?<=[a-z])[ .*]?s(?:ec)?(?:\^-|-\^?)1$", re.I), "/s"),
    (re.compile(r"(?<=[a-z])[ .*]?s(?:ec)?(?:\^-|-\^?)2$", re.I), "/s^2"),
    (re.compile(r" ?/ ?"), "/"),
    (re.compile(r"\bdegrees?/", re.I), "deg/"),
    (re.compile(r"/second\b", re.I), "/s"),
)
"""Other ways to write units: "rad s^-1", "m.s-2", "degrees/second"."""
_NUMBER = r"\d+\.?\d*(?:e[-+]?\d+)?"
_TEXT = re.compile(
    rf"([-+]?{_NUMBER})?\s*([^\d\s]\S*?)(/sample|\s+total)?\.?(?:\s+([-+])\s*({_NUMBER}))?", re.I
)


class Scale(NamedTuple):
    """Values in the bench's unit are `factor` * value + `offset`; `per_sample`: times the sample rate, too.

    `counted`: their change from row to row is, by the time between the rows.
    """

    factor: float
    offset: float = 0.0
    per_sample: bool = False
    counted: bool = False


def scale_of(quantity: str, text: str) -> Scale | None:
    """Return what makes the bench's unit of values in a unit, None if it is none of that quantity.

    `text` is "UNIT", "FACTOR UNIT" for counts, "... + OFFSET" or "... - OFFSET" (in that unit) where the
    counts' zero is another one, "UNIT/sample" for increments, "UNIT total" for what is counted up since power-on.
    """
    plain_text = "".join(_SPELT.get(letter, letter) for letter in text.strip().strip("[]()"))
    for written, meant in _SPELLINGS:
        plain_text = written.sub(meant, plain_text)
    match = _TEXT.fullmatch(plain_text)
    if match is None:
        return None
    factor, plain, increment, sign, offset = match.groups()
    known = _INCREMENTS.get(quantity, {}) if increment else _FACTORS[quantity]
    lower = _ALIASES.get(plain.lower(), plain.lower())
    unit = next((name for name in known if name.lower() == lower), "")
    if not unit:
        return None
    shift = float(f"{sign}{offset}") * known[unit] if offset else 0.0
    counted = bool(increment) and increment != "/sample"
    return Scale(
        float(factor or 1.0) * known[unit],
        shift + _OFFSETS.get(unit, 0.0),
        bool(increment) and not counted,
        counted,
    )


def unit_error(quantity: str, text: str, where: str, remedy: str = "") -> ConfigurationError:
    """Return the error for a unit that is not one of that quantity."""
    increments = [f"{name}{kind}" for kind in ("/sample", " total") for name in _INCREMENTS.get(quantity, ())]
    return ConfigurationError(
        "a column's unit is not known",
        where=where,
        found=text or "none",
        expected=", ".join([*_FACTORS[quantity], *increments])
        + f"; for counts a factor: 0.03 {BASE_UNITS[quantity]}",
        remedy=remedy,
    )
