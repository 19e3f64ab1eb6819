"""What follows attitude and motion: misaligned axes, gravity, vibration, the direction of the unit."""

from __future__ import annotations

import math

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import earth_rate_north_dph, earth_rate_up_dph
from simulators.effects._effect import (
    DPH,
    PPM,
    Curve,
    Effect,
    Formula,
    Input,
    Parameter,
    Shape,
    SlowRates,
    Unit,
)
from simulators.effects._stimulus import Stimulus

_DEG = Unit("deg")


def _angle(name: str) -> Parameter:
    return Parameter(name, -10.0, 10.0, _DEG)


def _azimuth(s: Stimulus, _: Shape) -> Array:
    level = earth_rate_north_dph(s.latitude_deg) * np.cos(np.radians(s.elevation_deg))
    return np.asarray(-math.radians(1.0) * level * s.harmonic(1)[1])


def _tilt(s: Stimulus, _: Shape) -> Array:
    """Earth rate on an axis that leans with the whole table: (turn x axis) . Earth rate for a turn of 1 deg.

    Turned about north, an axis to the side of it rises; turned about east, one to the north rises and one that
    points up leans to the south. The table's own rate stays along its axis.
    """
    elevation = np.radians(s.elevation_deg)
    vertical = earth_rate_up_dph(s.latitude_deg)
    cosine, sine = s.harmonic(1) * np.cos(elevation)
    leaned = -earth_rate_north_dph(s.latitude_deg) * np.sin(elevation)
    return np.asarray(math.radians(1.0) * np.stack((vertical * sine, vertical * cosine + leaned)))


def _misalignment(s: Stimulus, shape: Shape) -> Array:
    """Sensitive axis leaning in its frame: an upright one picks up level Earth rate, a level one the table's.

    With `carried` 1 the case is tilted and what leans in it goes along: what is above a level axis is behind one
    that points up, ahead of one that points down. With 0 it is mounted anew, and leans ahead whenever it stands.
    What is beside the axis turns a level one, too, or (`aside` 0) was taken out there when it was mounted.
    It stays a unit vector: of a lean towards (|up|, level) only what is square to the axis turns it.
    """
    up, level = np.sin(np.radians(s.elevation_deg)), np.cos(np.radians(s.elevation_deg))
    cosine, sine = s.harmonic(1) * earth_rate_north_dph(s.latitude_deg)
    vertical = earth_rate_up_dph(s.latitude_deg) + 3600.0 * s.table_rate_dps
    if shape.get("carried", 0.0):
        return np.asarray(math.radians(1.0) * np.stack((level * vertical - up * cosine, sine)))
    along = level * np.abs(up) + up * level
    turned = (np.abs(up) - along * level) * cosine + (level - along * up) * vertical
    beside = sine if shape.get("aside", 0.0) else np.abs(up) * sine
    return np.asarray(math.radians(1.0) * np.stack((turned, beside)))


ALIGNMENT_EFFECTS = (
    Effect(
        "azimuth_error",
        (_angle("azimuth_deg"),),
        _azimuth,
        Input.ANGLE | Input.ATTITUDE,
        "table angle with the axis level",
        "Earth-rate projection",
        "The axis does not point where the table's angle says: Earth rate enters differently.",
    ),
    Effect(
        "table_tilt",
        (_angle("about_north_deg"), _angle("about_east_deg")),
        _tilt,
        Input.ANGLE | Input.ATTITUDE,
        "table angle with the axis level, and the axis level against upright",
        "Earth-rate projection; IEEE Std 952, test-table alignment",
        "The table's axis is not plumb: the unit leans with it and sees Earth rate otherwise in every direction.",
    ),
    Effect(
        "axis_misalignment",
        (_angle("lean_deg_cos"), _angle("lean_deg_sin")),
        _misalignment,
        Input.ANGLE | Input.ATTITUDE | Input.TABLE_RATE,
        "table angle with the axis upright",
        "IEEE Std 952, input-axis misalignment",
        "The sensitive axis leans against its mounting and picks up other components of rate.",
        tuple(
            {"carried": carried, "aside": aside} for carried, aside in ((0.0, 0.0), (0.0, 1.0), (1.0, 1.0))
        ),
        whole=("carried", "aside"),
    ),
)


def _pair(name: str, bound: float, unit: Unit) -> tuple[Parameter, ...]:
    return tuple(Parameter(f"{name}_{part}", -bound, bound, unit) for part in ("cos", "sin"))


def _ripple(order: int, s: Stimulus) -> Array:
    """Mean over each sample of rate times cos and sin of the angle: exact differences of sin and -cos."""
    angle = np.radians(order * s.angle_deg)
    swing = np.stack((np.diff(np.sin(angle)), -np.diff(np.cos(angle))))
    per_rate = math.degrees(1.0) / order / s.period_s * 3600.0
    return np.asarray(1e-6 * per_rate * swing * np.sin(np.radians(s.elevation_deg)))


def _wobble(order: int) -> Formula:
    """A ripple with its first odd overtone: bearings and encoders seldom give a pure sine."""
    return lambda s, _: np.concatenate((_ripple(order, s), _ripple(3 * order, s)))


def _strongest_orders(rates: SlowRates) -> list[Shape]:
    """Return the multiples of a turn by which the output varies most while the table turns."""
    from scipy.ndimage import uniform_filter1d  # here: a lab starts without scipy (decision 0021)

    strength = np.zeros(len(_ORDERS))
    for s, rest in rates.records:
        use = (np.abs(s.axis_rate_dps) > _TURNING_DPS) & ~np.isnan(rest)
        if use.sum() < _LEAST_SAMPLES:
            continue
        fast = np.where(use, np.nan_to_num(rest), 0.0)
        fast = np.where(use, fast - uniform_filter1d(fast, 61), 0.0)
        noise = (1.4826 * float(np.median(np.abs(fast[use])))) ** 2
        for place, order in enumerate(_ORDERS):
            waves = _ripple(order, s) * use
            size = (waves**2).sum(axis=1)
            seen = size > 1e-9 * float(size.max(initial=0.0))
            strength[place] += float(((waves @ fast)[seen] ** 2 / size[seen]).sum()) / max(noise, 1e-12)
    best = np.argsort(-strength)[:_MOST_ORDERS]
    return [{"order": float(_ORDERS[place])} for place in best if strength[place] > _CLEAR]


def _field(s: Stimulus, shape: Shape) -> Array:
    """Return a direction of the unit: north, west, up; and level.

    With `upright` 0 that of its axis, with `across` 1 one across it, which goes down as the axis rises. What a
    field has beside its level part is along an axis that stands, and across one that lies.
    """
    up, level = np.sin(np.radians(s.elevation_deg)), np.cos(np.radians(s.elevation_deg))
    across, upright = shape.get("across", 0.0), shape.get("upright", 1.0)
    cosine, sine = (upright + (1.0 - upright) * level) * s.harmonic(1)
    return np.stack((cosine * (up if across else 1.0), sine, up, level))


def _dips(values: Array, covariance: Array) -> bool:
    """Return whether what stands up, or level across, may be no more than ten times what follows the heading.

    That is a dip of 84 deg. What hardly follows the heading is a sensitivity to gravity. On a table whose axis
    never changes its attitude nothing tells what stands from a bias, so that its best fit may be anything: what
    counts is the fit with the prior that it is no more than that.
    """
    most = _STEEPEST * math.hypot(values[0], values[1])
    standing = np.linalg.solve(covariance[2:, 2:] + most**2 * np.eye(2), values[2:]) * most**2
    return math.hypot(*standing.tolist()) <= most


_STEEPEST = 10.0
_ORDERS = tuple(order for order in range(4, 37) if order != 6)
"""Multiples of a turn that a wobble, with its overtone, does not have."""
_TURNING_DPS, _LEAST_SAMPLES = 1.0, 128
_MOST_ORDERS, _CLEAR = 3, 25.0
_RIPPLES = (*_pair("ripple_ppm", 1e5, PPM), *_pair("overtone_ppm", 1e5, PPM))
_WOBBLE_INPUTS = Input.ANGLE | Input.TABLE_RATE | Input.ATTITUDE | Input.TURN
TABLE_ANGLE_EFFECTS = (
    Effect(
        "heading_sensitivity",
        (
            *_pair("bias_dph", 100.0, DPH),
            *(Parameter(f"bias_dph_{way}", -100.0, 100.0, DPH, optional=True) for way in ("up", "level")),
        ),
        _field,
        Input.ANGLE | Input.ATTITUDE,
        "table angle and attitude",
        "magnetic sensitivity, IEEE Std 952",
        "Bias depends on the direction in which the unit points, as in a magnetic field.",
        tuple(
            {"upright": upright, "across": across} for upright, across in ((1.0, 0.0), (0.0, 0.0), (1.0, 1.0))
        ),
        whole=("across",),
        curve=Curve(Input.ANGLE),
        possible=_dips,
    ),
    Effect(
        "table_wobble_once",
        _RIPPLES,
        _wobble(1),
        _WOBBLE_INPUTS,
        "once a turn, proportional to rate",
        "table axis wobble and eccentric encoder",
        "The table's rate varies once a turn beside its telemetry.",
        curve=Curve(Input.ANGLE, of_rate=True),
    ),
    Effect(
        "table_wobble_twice",
        _RIPPLES,
        _wobble(2),
        _WOBBLE_INPUTS,
        "twice a turn, proportional to rate",
        "oval encoder disc, bearing",
        "The table's rate varies twice a turn beside its telemetry.",
        curve=Curve(Input.ANGLE, of_rate=True),
    ),
    Effect(
        "table_rate_ripple",
        _RIPPLES,
        lambda s, shape: np.concatenate([_ripple(part * round(shape["order"]), s) for part in (1, 2)]),
        _WOBBLE_INPUTS,
        "many times a turn, proportional to rate",
        "motor poles, gear teeth, errors of an encoder's subdivision",
        "The table's rate varies many times a turn beside its telemetry.",
        ({"order": 12.0},),
        propose=_strongest_orders,
        whole=("order",),
        curve=Curve(Input.ANGLE, of_rate=True),
    ),
)


_AT_DPS = 100.0


def _acceleration(s: Stimulus, _: Shape) -> Array:
    elevation = np.radians(s.elevation_deg)
    return np.stack((np.sin(elevation), np.cos(elevation)))


def _across(s: Stimulus, _: Shape) -> Array:
    """Return the specific force along the two other axes, (2, n); zero where nothing measured it."""
    return np.zeros((2, len(s))) if s.force_g is None else s.force_g[1:]


def _other_rates(s: Stimulus, _: Shape) -> Array:
    """Return what a lean of 1 deg towards each of the two other axes picks up, (2, n)."""
    return np.zeros((2, len(s))) if s.cross_rate_dph is None else math.radians(1.0) * s.cross_rate_dph


def _towards(name: str, bound: float, unit: Unit) -> tuple[Parameter, ...]:
    return tuple(Parameter(f"{name}_{which}", -bound, bound, unit) for which in ("next", "after_next"))


ACCELERATION_EFFECTS = (
    Effect(
        "acceleration_sensitivity",
        tuple(Parameter(f"bias_dph_per_g_{way}", -100.0, 100.0, DPH.per("g")) for way in ("axial", "cross")),
        _acceleration,
        Input.ATTITUDE,
        "attitude against gravity",
        "IEEE Std 952, acceleration sensitivity",
        "Bias depends on the direction of gravity.",
    ),
    Effect(
        "cross_acceleration_sensitivity",
        _towards("bias_dph_per_g", 100.0, DPH.per("g")),
        _across,
        Input.OTHER_AXES,
        "specific force along the two other axes, as the unit's accelerometers measure it",
        "IEEE Std 952, acceleration sensitivity",
        "Bias depends on the specific force across the axis: on which of its sides the unit lies.",
    ),
    Effect(
        "cross_axis_sensitivity",
        _towards("lean_deg", 10.0, _DEG),
        _other_rates,
        Input.OTHER_AXES,
        "rates about the two other axes, as the unit's gyros measure them",
        "IEEE Std 952, input-axis misalignment",
        "The sensitive axis leans towards the unit's other axes and picks up their rates.",
    ),
    Effect(
        "acceleration_squared",
        (Parameter("bias_dph_per_g2", -100.0, 100.0, DPH.per("g^2")),),
        lambda s, _: np.asarray(np.sin(np.radians(s.elevation_deg)) ** 2),
        Input.ATTITUDE,
        "attitude against gravity, squared",
        "IEEE Std 952, acceleration-squared sensitivity",
        "Bias depends on the square of gravity along the axis.",
    ),
    Effect(
        "vibration_rectification",
        (Parameter("bias_dph_at_100dps", -1000.0, 1000.0, DPH),),
        lambda s, _: np.asarray((s.table_rate_dps / _AT_DPS) ** 2),
        Input.TABLE_RATE,
        "square of the table's rate",
        "IEEE Std 952, vibration rectification; bearing vibration grows with speed, its power with the square",
        "Bias shifts while the table turns, by the power of its vibration.",
    ),
)
