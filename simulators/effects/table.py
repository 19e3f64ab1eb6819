"""The table: where it stops, what its encoder reads, and how steadily it turns."""

from __future__ import annotations

import math

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._channel import ChannelEffect, ChannelInputs, Values
from simulators.effects._effect import PPM, Parameter, Unit

_ARCSEC = Unit("arcsec")


def _ppm(name: str) -> tuple[Parameter, Parameter]:
    return Parameter(f"{name}_ppm_cos", -1e5, 1e5, PPM), Parameter(f"{name}_ppm_sin", -1e5, 1e5, PPM)


TABLE_POSITION_OFFSET = ChannelEffect(
    "table_position_offset",
    "table_angle",
    (Parameter("offset_arcsec", -36000.0, 36000.0, _ARCSEC),),
    (0.0,),
    "nothing: constant",
    "ISO 230-2, positioning deviation",
    "The table stops beside the angle that it was sent to.",
)
TABLE_POSITION_CREEP = ChannelEffect(
    "table_position_creep",
    "table_angle",
    (Parameter("creep_arcsec_per_h", -1e5, 1e5, _ARCSEC.per("h")),),
    (0.0,),
    "time since the table was sent there",
    "servo drift",
    "The table creeps from its position.",
)
TABLE_ENCODER_ECCENTRICITY = ChannelEffect(
    "table_encoder_eccentricity",
    "table_angle",
    (Parameter("arcsec_cos", -3600.0, 3600.0, _ARCSEC), Parameter("arcsec_sin", -3600.0, 3600.0, _ARCSEC)),
    (0.0, 0.0),
    "table angle, once a turn",
    "eccentric encoder disc",
    "What the table is off by changes once a turn.",
)
TABLE_RATE_ERROR = ChannelEffect(
    "table_rate_error",
    "table_rate",
    (Parameter("error_ppm", -1e5, 1e5, PPM), Parameter("offset_mdps", -1000.0, 1000.0, Unit("mdeg/s"))),
    (0.0, 0.0),
    "demanded rate",
    "IEEE Std 517, rate accuracy",
    "The table turns faster or slower than it is told to.",
)
TABLE_RATE_RIPPLE_ONCE = ChannelEffect(
    "table_rate_ripple_once",
    "table_rate",
    _ppm("ripple"),
    (0.0, 0.0),
    "table angle, once a turn",
    "IEEE Std 517, rate stability within a turn",
    "The table's rate varies once a turn.",
)
TABLE_RATE_RIPPLE_TWICE = ChannelEffect(
    "table_rate_ripple_twice",
    "table_rate",
    _ppm("ripple"),
    (0.0, 0.0),
    "table angle, twice a turn",
    "IEEE Std 517, rate stability within a turn",
    "The table's rate varies twice a turn.",
)
TABLE_EFFECTS = (
    TABLE_POSITION_OFFSET,
    TABLE_POSITION_CREEP,
    TABLE_ENCODER_ECCENTRICITY,
    TABLE_RATE_ERROR,
    TABLE_RATE_RIPPLE_ONCE,
    TABLE_RATE_RIPPLE_TWICE,
)


def reading_error_arcsec(values: Values, angle_deg: Array, since_h: Array | float) -> Array:
    """Return what a held table's reading is off the angle it was sent to, since so many hours ago."""
    (offset,) = TABLE_POSITION_OFFSET.of(values)
    (creep,) = TABLE_POSITION_CREEP.of(values)
    cosine, sine = TABLE_ENCODER_ECCENTRICITY.of(values)
    turn = np.radians(angle_deg)
    return np.asarray(offset + creep * since_h + cosine * (np.cos(turn) - 1.0) + sine * np.sin(turn))


def table_angle(inputs: ChannelInputs, values: Values) -> Array:
    """Held positions: what is off the demanded angle, arcsec."""
    return inputs.drive + reading_error_arcsec(values, inputs.angle_deg, _since_change_s(inputs) / 3600.0)


def ripple_ppm(values: Values, angle_deg: Array) -> Array:
    """Return how much faster the table turns at angles than on average."""
    once, twice = TABLE_RATE_RIPPLE_ONCE.of(values), TABLE_RATE_RIPPLE_TWICE.of(values)
    turn = np.radians(angle_deg)
    ripple = once[0] * np.cos(turn) + once[1] * np.sin(turn)
    return np.asarray(ripple + (twice[0] * np.cos(2.0 * turn) + twice[1] * np.sin(2.0 * turn)))


def ahead_deg(values: Values, angle_deg: Array) -> Array:
    """Return by how much the ripple, integrated over the angle, puts the table ahead."""
    once, twice = TABLE_RATE_RIPPLE_ONCE.of(values), TABLE_RATE_RIPPLE_TWICE.of(values)
    turn = np.radians(angle_deg)
    swing = once[0] * np.sin(turn) + once[1] * (1.0 - np.cos(turn))
    swing += 0.5 * (twice[0] * np.sin(2.0 * turn) + twice[1] * (1.0 - np.cos(2.0 * turn)))
    return np.asarray(math.degrees(1e-6) * swing)


def missed_dps(values: Values, rate_dps: float) -> float:
    """Return what the table's mean rate is off the rate demanded."""
    error_ppm, offset_mdps = TABLE_RATE_ERROR.of(values)
    return 1e-6 * error_ppm * rate_dps + 1e-3 * offset_mdps


def table_rate(inputs: ChannelInputs, values: Values) -> Array:
    """Steady rates, deg/s."""
    error_ppm, offset_mdps = TABLE_RATE_ERROR.of(values)
    ripple = ripple_ppm(values, inputs.angle_deg)
    return np.asarray(inputs.drive * (1.0 + 1e-6 * (error_ppm + ripple)) + 1e-3 * offset_mdps)


def _since_change_s(inputs: ChannelInputs) -> Array:
    """Return time since the demand last changed, (n,): `demands` say when."""
    starts = np.array([demand.time_s for demand in inputs.demands] or [inputs.time_s[0]])
    latest = np.maximum(np.searchsorted(starts, inputs.time_s, side="right") - 1, 0)
    return np.asarray(inputs.time_s - starts[latest])
