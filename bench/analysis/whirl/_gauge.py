"""The free part of a whirl, named: a constant tilt in body axes that no gyro can see, and ways to fix it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from bench.analysis.whirl._types import Complex

Gauge = Literal["mean", "start"]
FREE_PART = (
    "free: the constant tilt a_0 of the spin axis in body axes (the first harmonic that turns backwards in "
    "rotating axes). It makes no angular rate, so no gyro run can give it; the oscillation is removed "
    "whatever it is set to"
)
MEANING: dict[Gauge, str] = {
    "mean": "mean spin axis: the body's z axis is the mean of the wobbling axis, the mean tilt over a "
    "turn is zero; "
    "carrier roll and pitch are those of this axis and differ from those of the case by its boresight",
    "start": "frames coincide at angle zero: carrier roll and pitch are those that the unit would give if it "
    "were locked at table angle zero",
}


def gauge_tilt(gauge: Gauge, lines: Sequence[float], amplitudes_arcsec: Complex) -> complex:
    """Return the body tilt a_0 in arcsec (real part about x, imaginary part about y) that a gauge stands for."""
    # whole lines repeat every turn; another has no value at angle zero that would hold for the next
    whole = [value for line, value in zip(lines, amplitudes_arcsec, strict=True) if float(line).is_integer()]
    return -complex(sum(whole)) if gauge == "start" else 0j
