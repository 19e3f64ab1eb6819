"""Whirl as an effect of the catalogue: what a bearing's wobble adds to the rate of a level gyro on the table.

A tilt sum a_m exp(j m psi) in body axes gives the x gyro the real part of sum j m w a_m exp(j (m - 1) psi). It is
the linear view of `simulators.plant.wobble`, for diagnosis; the plant itself moves the unit by rotation matrices.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from simulators.effects import Effect, Parameter, Stimulus

LINES = (-2, -1, 1, 2, 3)
_LARGEST_ARCSEC = 600.0


def _columns(stimulus: Stimulus, _: Mapping[str, float]) -> NDArray[np.float64]:
    """Return deg/h (the same as arcsec/s) for 1 arcsec about x and y of each line, float64 (2 * lines, n)."""
    angle = np.radians(stimulus.angle_deg)
    middle = 0.5 * (angle[1:] + angle[:-1])
    level = np.cos(np.radians(stimulus.elevation_deg)) / stimulus.period_s
    columns = []
    for line in LINES:
        # exact differences of the body tilt over each sample, seen by the gyro at the sample's middle angle
        moved = np.diff(np.exp(1j * line * angle)) * np.exp(-1j * middle) * level
        columns += [moved.real, -moved.imag]
    return np.stack(columns)


WHIRL = Effect(
    "whirl",
    tuple(
        Parameter(f"line_{line}_{axis}_arcsec".replace("-", "minus_"), -_LARGEST_ARCSEC, _LARGEST_ARCSEC)
        for line in LINES
        for axis in "xy"
    ),
    _columns,
    "table angle and rate, gyro level",
    "patent on whirl compensation of a rotating INS, equation (8)",
    "The bearing tips the unit as it turns, and a level gyro senses the tipping.",
)
