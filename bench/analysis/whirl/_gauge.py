"""The free part of a whirl, named: a constant tilt in body axes that no gyro can see, and ways to fix it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from bench.analysis.whirl._types import Complex
from drivers.base.errors import ConfigurationError

Gauge = Literal["mean", "start", "external"]
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
    "external": "set from outside: carrier roll and pitch are those of the level or optical cube that gave "
    "the two constants",
}


def gauge_tilt(
    gauge: Gauge, lines: Sequence[float], amplitudes_arcsec: Complex, external_arcsec: complex | None = None
) -> complex:
    """Return the body tilt a_0 in arcsec (real part about x, imaginary part about y) that a gauge stands for.

    ConfigurationError for an unknown gauge, and for "external" without its two constants, or constants
    without it.
    """
    if gauge not in MEANING:
        raise ConfigurationError("no such gauge", found=str(gauge), expected=" or ".join(MEANING))
    if (gauge == "external") != (external_arcsec is not None):
        raise ConfigurationError(
            "the external gauge and its two constants go together",
            found=f"gauge {gauge}, constants {external_arcsec}",
            expected="gauge external with the tilt that a level or an optical cube gave, or neither",
        )
    if external_arcsec is not None:
        return complex(external_arcsec)
    # whole lines repeat every turn; another has no value at angle zero that would hold for the next
    whole = [value for line, value in zip(lines, amplitudes_arcsec, strict=True) if float(line).is_integer()]
    return -complex(sum(whole)) if gauge == "start" else 0j
