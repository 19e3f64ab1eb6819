"""Threshold, resolution and input-axis misalignment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.base.errors import ConfigurationError


@dataclass(frozen=True)
class RateStep:
    """A small input: the change of rate that was put in, and the change of output it made, deg/h."""

    input_dph: float
    output_dph: float

    @property
    def ratio(self) -> float:
        """Output over input."""
        return self.output_dph / self.input_dph


def threshold(steps: Sequence[RateStep], *, share: float = 0.5) -> float:
    """Return the smallest input from rest, deg/h, that gives at least `share` of the expected output.

    IEEE Std 647 and 952, threshold; GJB 2426A. All larger inputs must pass too; ConfigurationError when none
    does.
    """
    found = math.inf
    for step in sorted(steps, key=lambda step: -abs(step.input_dph)):
        if step.ratio < share:
            break
        found = abs(step.input_dph)
    if math.isinf(found):
        raise ConfigurationError(
            "no input gave its output: the threshold is above all of them",
            where="standard test",
            found=", ".join(f"{step.input_dph:g} deg/h gave {100 * step.ratio:.0f} %" for step in steps)
            or "none",
            expected=f"at least {100 * share:.0f} %",
            remedy="put in larger rates, or average longer",
        )
    return found


def resolution(steps: Sequence[RateStep], *, share: float = 0.5) -> float:
    """Return the smallest change of a rate far from zero, deg/h, that gives `share` of the expected output.

    IEEE Std 647 and 952, resolution: as the threshold, at an input larger than it.
    """
    return threshold(steps, share=share)


def input_axis_misalignment(output_dps: Sequence[float], rate_dps: float) -> float:
    """Return the angle in deg between input axis and its reference from outputs at two cross positions.

    The table turns at `rate_dps` about an axis normal to the reference, the unit at two positions 90 deg apart
    about its reference axis; each output over the rate is the sine of one component (IEEE Std 952).
    """
    parts = [value / rate_dps for value in output_dps]
    return math.degrees(math.asin(min(1.0, math.hypot(*parts))))
