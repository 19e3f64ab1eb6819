"""A run with rotation as the whirl fits take it, and the errors of this package."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array
from drivers.base.errors import BenchError

Complex = NDArray[np.complex128]
ARCSEC_PER_DEG = 3600.0
"""deg/h and arcsec/s are the same number."""


class NotObservable(BenchError):
    """A quantity that this rotation does not show."""


class UnfitRotation(BenchError):
    """A recording that cannot carry a whirl fit: too little rotation, wrong sign, saturated, damaged."""


@dataclass(frozen=True)
class Finding:
    """Something about a recording that does not stop a fit: what it is and what follows from it."""

    code: Literal[
        "rotation",
        "clock_drift",
        "clock_unknown",
        "latency_unknown",
        "angle",
        "gaps",
        "level",
        "line",
        "change",
        "sense",
        "repeat",
        "base",
    ]
    text: str


@dataclass(frozen=True, eq=False)
class TurnRecord:
    """Rates and table angle of one run; n samples, one every `period_s` without holes.

    `rate_dps`: (n, 3), mean rate of the gyros x, y, z over each interval. `angle_rad`: (n + 1,), measured table
    angle at the edges of the intervals, turns counted, counter-clockwise positive about z. `usable`: bool (n,),
    False where a sample is missing or invalid (its rates are then not looked at). `time_s`: (n + 1,), edges.
    """

    run_id: str
    unit_id: str
    period_s: float
    time_s: Array
    rate_dps: Array
    angle_rad: Array
    usable: NDArray[np.bool_]
    latitude_deg: float

    @property
    def middle_rad(self) -> Array:
        """Angle in the middle of each interval, (n,); the half sample matters (w dt / 2 of every tilt)."""
        return np.asarray(0.5 * (self.angle_rad[1:] + self.angle_rad[:-1]))

    @property
    def turns(self) -> float:
        """Full turns covered, counting both senses."""
        return float(np.abs(np.diff(self.angle_rad)).sum() / (2.0 * np.pi))
