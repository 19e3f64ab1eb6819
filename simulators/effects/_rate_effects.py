"""Effects that rate, table angle, attitude and time drive."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import earth_rate_north_dph, earth_rate_up_dph
from simulators.effects._effect import Effect, Parameter
from simulators.effects._stimulus import Stimulus

Shape = Mapping[str, float]
_AT_DPS = 100.0
_SIDES: tuple[Shape, ...] = tuple({"side": side} for side in (0.0, 0.5, -0.5, 1.0, -1.0))


def _scale_factor(s: Stimulus, _: Shape) -> Array:
    return 1e-6 * s.input_rate_dph[None, :]


def _nonlinearity(s: Stimulus, _: Shape) -> Array:
    return np.asarray(1e-6 * (s.input_rate_dph * (s.axis_rate_dps / _AT_DPS) ** 2)[None, :])


def _asymmetry(s: Stimulus, _: Shape) -> Array:
    return np.asarray(0.5e-6 * np.abs(s.input_rate_dph)[None, :])


def _level_earth_dph(s: Stimulus) -> float:
    return earth_rate_north_dph(s.latitude_deg)


def _azimuth(s: Stimulus, _: Shape) -> Array:
    level = _level_earth_dph(s) * np.cos(np.radians(s.elevation_deg))
    return np.asarray(-math.radians(1.0) * level * s.harmonic(1)[1])[None, :]


def _tilt(s: Stimulus, _: Shape) -> Array:
    """Earth rate on an axis that leans with the whole table: (turn x axis) . Earth rate for a turn of 1 deg.

    Turned about north, an axis to the side of it rises; turned about east, one to the north rises and one that
    points up leans to the south. The table's own rate stays along its axis.
    """
    elevation = np.radians(s.elevation_deg)
    vertical = earth_rate_up_dph(s.latitude_deg)
    cosine, sine = s.harmonic(1) * np.cos(elevation)
    leaned = -_level_earth_dph(s) * np.sin(elevation)
    return np.asarray(math.radians(1.0) * np.stack((vertical * sine, vertical * cosine + leaned)))


def _rectification(s: Stimulus, _: Shape) -> Array:
    return np.asarray((s.table_rate_dps / _AT_DPS) ** 2)[None, :]


def _misalignment(s: Stimulus, _: Shape) -> Array:
    """Sensitive axis leaning in its frame: an upright one picks up level Earth rate, a level one the table's."""
    upright, level = np.sin(np.radians(s.elevation_deg)), np.cos(np.radians(s.elevation_deg))
    cosine, sine = s.harmonic(1) * _level_earth_dph(s) * np.abs(upright)
    vertical = earth_rate_up_dph(s.latitude_deg) + 3600.0 * s.table_rate_dps
    return np.asarray(math.radians(1.0) * np.stack((cosine + level * vertical, sine)))


def _heading(s: Stimulus, _: Shape) -> Array:
    return s.harmonic(1)


def _ripple(order: int, s: Stimulus) -> Array:
    """Mean over each sample of rate times cos and sin of the angle: exact differences of sin and -cos."""
    angle = np.radians(order * s.angle_deg)
    swing = np.stack((np.diff(np.sin(angle)), -np.diff(np.cos(angle))))
    per_rate = math.degrees(1.0) / order / s.period_s * 3600.0
    return np.asarray(1e-6 * per_rate * swing * np.sin(np.radians(s.elevation_deg)))


def _wobble(order: int, s: Stimulus) -> Array:
    """A ripple with its first odd overtone: bearings and encoders seldom give a pure sine."""
    return np.concatenate((_ripple(order, s), _ripple(3 * order, s)))


def _change(s: Stimulus, shape: Shape) -> Array:
    """Return rate at the end less rate at the start of each sample.

    Side 0.5 has changes of rate begin at samples' edges, -0.5 has them end there, 0 is between; a step right at
    an edge moves into the sample before if samples are late (side 1), into the one after if early (side -1).
    """
    rate, side = s.input_rate_dph, min(max(shape["side"], -1.0), 1.0)
    forward, backward = _edge_values(rate), _edge_values(rate[::-1])[::-1]
    late = np.append(rate, rate[-1])
    early = np.insert(rate, 0, rate[0])
    edges = (early, backward, forward, late)
    weights = np.array([np.interp(side, (-1.0, -0.5, 0.5, 1.0), row) for row in np.eye(4)])
    return np.diff(np.einsum("i,ij->j", weights, np.stack(edges)))


def _edge_values(means: Array) -> Array:
    """Return values at the edges (n + 1,) of a signal linear in each sample from its means (n,), left to right.

    A value that overshoots the neighbouring samples is cut: there the slope changes inside the sample.
    """
    edges = np.append(means[:1], means)
    value = float(means[0])
    moving = np.flatnonzero(means[1:] != means[:-1])
    for k in np.unique(np.concatenate((moving, moving + 1)).clip(0, len(means) - 2)).tolist():
        here, following = float(means[k]), float(means[k + 1])
        if k and means[k - 1] == here:
            value = here
        value = min(max(2.0 * here - value, min(here, following)), max(here, following))
        edges[k + 1] = value
    return edges


def _time_offset(s: Stimulus, shape: Shape) -> Array:
    return np.asarray(1e-3 / s.period_s * _change(s, shape)[None, :])


def _clock_skew(s: Stimulus, shape: Shape) -> Array:
    since = (s.time_s - s.time_s[0]) / s.period_s
    return np.asarray(1e-6 * (since * _change(s, shape))[None, :])


def _acceleration(s: Stimulus, _: Shape) -> Array:
    elevation = np.radians(s.elevation_deg)
    return np.stack((np.sin(elevation), np.cos(elevation)))


def _acceleration_squared(s: Stimulus, _: Shape) -> Array:
    return np.asarray(np.sin(np.radians(s.elevation_deg)) ** 2)[None, :]


def _ramp(s: Stimulus, _: Shape) -> Array:
    return np.asarray(s.time_s / 3600.0)[None, :]


def _pair(name: str, bound: float) -> tuple[Parameter, ...]:
    return (Parameter(f"{name}_cos", -bound, bound), Parameter(f"{name}_sin", -bound, bound))


RATE_EFFECTS = (
    Effect(
        "scale_factor",
        (Parameter("sf_ppm", -1e5, 1e5),),
        _scale_factor,
        "rate",
        "IEEE Std 952, scale factor",
        "Scale factor differs from the model's.",
    ),
    Effect(
        "scale_factor_nonlinearity",
        (Parameter("sf_ppm_at_100dps", -1e5, 1e5),),
        _nonlinearity,
        "cube of rate",
        "IEEE Std 952, scale-factor nonlinearity",
        "Scale factor changes with the square of rate.",
    ),
    Effect(
        "scale_factor_asymmetry",
        (Parameter("asymmetry_ppm", -1e5, 1e5),),
        _asymmetry,
        "magnitude of rate",
        "IEEE Std 952, scale-factor asymmetry",
        "Scale factors of positive and negative rates differ.",
    ),
    Effect(
        "azimuth_error",
        (Parameter("azimuth_deg", -10.0, 10.0),),
        _azimuth,
        "table angle with the axis level",
        "Earth-rate projection",
        "The axis does not point where the table's angle says: Earth rate enters differently.",
    ),
    Effect(
        "table_tilt",
        (Parameter("about_north_deg", -10.0, 10.0), Parameter("about_east_deg", -10.0, 10.0)),
        _tilt,
        "table angle with the axis level, and the axis level against upright",
        "Earth-rate projection; IEEE Std 952, test-table alignment",
        "The table's axis is not plumb: the unit leans with it and sees Earth rate otherwise in every direction.",
    ),
    Effect(
        "axis_misalignment",
        _pair("lean_deg", 10.0),
        _misalignment,
        "table angle with the axis upright",
        "IEEE Std 952, input-axis misalignment",
        "The sensitive axis leans against its mounting and picks up other components of rate.",
    ),
    Effect(
        "heading_sensitivity",
        _pair("bias_dph", 100.0),
        _heading,
        "table angle",
        "magnetic sensitivity, IEEE Std 952",
        "Bias depends on the direction in which the unit points, as in a magnetic field.",
    ),
    Effect(
        "table_wobble_once",
        (*_pair("ripple_ppm", 1e5), *_pair("overtone_ppm", 1e5)),
        lambda s, _: _wobble(1, s),
        "once a turn, proportional to rate",
        "table axis wobble and eccentric encoder",
        "The table's rate varies once a turn beside its telemetry.",
    ),
    Effect(
        "table_wobble_twice",
        (*_pair("ripple_ppm", 1e5), *_pair("overtone_ppm", 1e5)),
        lambda s, _: _wobble(2, s),
        "twice a turn, proportional to rate",
        "oval encoder disc, bearing",
        "The table's rate varies twice a turn beside its telemetry.",
    ),
    Effect(
        "time_offset",
        (Parameter("offset_ms", -2000.0, 2000.0),),
        _time_offset,
        "change of rate",
        "sample time and table telemetry on different clocks",
        "The gyro's samples are early or late against the table's telemetry.",
        _SIDES,
    ),
    Effect(
        "clock_skew",
        (Parameter("skew_ppm", -1e4, 1e4),),
        _clock_skew,
        "change of rate, growing with time",
        "clocks of different rate",
        "The gyro's clock runs fast or slow against the bench's.",
        _SIDES,
    ),
    Effect(
        "acceleration_sensitivity",
        (Parameter("bias_dph_per_g_axial", -100.0, 100.0), Parameter("bias_dph_per_g_cross", -100.0, 100.0)),
        _acceleration,
        "attitude against gravity",
        "IEEE Std 952, acceleration sensitivity",
        "Bias depends on the direction of gravity.",
    ),
    Effect(
        "acceleration_squared",
        (Parameter("bias_dph_per_g2", -100.0, 100.0),),
        _acceleration_squared,
        "attitude against gravity, squared",
        "IEEE Std 952, acceleration-squared sensitivity",
        "Bias depends on the square of gravity along the axis.",
    ),
    Effect(
        "vibration_rectification",
        (Parameter("bias_dph_at_100dps", -1000.0, 1000.0),),
        _rectification,
        "square of the table's rate",
        "IEEE Std 952, vibration rectification; bearing vibration grows with speed, its power with the square",
        "Bias shifts while the table turns, by the power of its vibration.",
    ),
    Effect(
        "bias_ramp",
        (Parameter("bias_dph_per_h", -100.0, 100.0),),
        _ramp,
        "time in the run",
        "IEEE Std 952, rate ramp",
        "Bias drifts steadily with time.",
    ),
)
