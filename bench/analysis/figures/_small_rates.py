"""Threshold and resolution."""

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
    """Return the smallest input, deg/h, that gives at least `share` of the expected output.

    IEEE Std 647 and 952, GJB 2426A: the threshold for inputs from rest, the resolution for changes of a rate far
    from zero. All larger inputs must pass too; ConfigurationError when none
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
