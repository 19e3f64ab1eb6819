"""Two looks at a unit turned over between them: what stays is bias, what changes sign is what it measured."""

from __future__ import annotations

import math
from dataclasses import dataclass

from bench.analysis.look._channels import ACCELEROMETER, GYRO
from bench.analysis.look._look import AxisLook, Look
from drivers.base.constants import EARTH_RATE_DPH, STANDARD_GRAVITY_MPS2
from drivers.base.errors import ConfigurationError

_UPRIGHT = 0.9
"""Part of gravity from which on an axis counts as turned from up to down."""


@dataclass(frozen=True)
class HalfDifference:
    """One axis in both positions, in its unit: `bias` is half the sum, `half_difference` half the difference.

    `sigma`, of both, comes from the noise of each record; a bias that changed between the two is in
    `half_difference` unseen. `earth_rate`: what a gyro should show there by the latitude, None where that is
    not known or the accelerometers do not say that its axis was turned over.
    """

    name: str
    unit: str
    bias: float
    half_difference: float
    sigma: float
    earth_rate: float | None


def half_differences(first: Look, second: Look, latitude_deg: float | None) -> tuple[HalfDifference, ...]:
    """Return bias and half difference (first less second) of every axis in both logs.

    ConfigurationError if they share none.
    """
    others = {axis.channel.name: axis for axis in second.axes}
    pairs = [(axis, others[axis.channel.name]) for axis in first.axes if axis.channel.name in others]
    pairs = [(one, other) for one, other in pairs if one.channel.base_unit == other.channel.base_unit]
    if not pairs:
        raise ConfigurationError(
            "the two logs share no axis",
            where=f"{first.log.name}, {second.log.name}",
            found=", ".join(others),
            expected=", ".join(axis.channel.name for axis in first.axes),
        )
    upright = {
        one.channel.axis: _half(one, other) / STANDARD_GRAVITY_MPS2
        for one, other in pairs
        if one.channel.kind == ACCELEROMETER and one.channel.unit
    }
    found = []
    for one, other in pairs:
        up, earth = upright.get(one.channel.axis, 0.0), None
        if one.channel.kind == GYRO and one.channel.unit and latitude_deg is not None and abs(up) > _UPRIGHT:
            earth = math.copysign(
                EARTH_RATE_DPH / 3600.0 * math.sin(math.radians(latitude_deg)), up * latitude_deg
            )
        bias = 0.5 * (one.figures.mean + other.figures.mean)
        sigma = 0.5 * math.hypot(one.figures.mean_sigma, other.figures.mean_sigma)
        found.append(
            HalfDifference(one.channel.name, one.channel.base_unit, bias, _half(one, other), sigma, earth)
        )
    return tuple(found)


def _half(one: AxisLook, other: AxisLook) -> float:
    return 0.5 * (one.figures.mean - other.figures.mean)
