"""The fitted equation of a ring laser gyro as one file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.compensation import FittedCompensation
from bench.analysis.rlg._rows import RampRun
from bench.analysis.rlg._variables import candidate_matrix
from drivers.base.arrays import Array


@dataclass(frozen=True, repr=False)
class RlgCompensation(FittedCompensation):
    """B = intercept + sum of coefficient * variable, in deg/h; temperatures in degC, rates in degC/min.

    `temp_range_c` and `rate_range` are what the training runs covered; beyond them the equation is a guess.
    """

    KIND = "ring laser drift"
    WHAT = "drift of a ring laser gyro"
    SHAPES: ClassVar = {
        "variables": ("k",),
        "coefficients": ("k",),
        "temp_range_c": (2,),
        "rate_range": (2,),
    }

    variables: tuple[str, ...]
    coefficients: tuple[float, ...]
    intercept_dph: float
    temp_range_c: tuple[float, float]
    rate_range: tuple[float, float]
    statistics: Mapping[str, float] = field(default_factory=dict)

    def drift_dph(self, run: RampRun) -> Array:
        """Return the bias on every row of a run of the same unit; UnitMismatch for another unit's."""
        self.require_unit(run.unit_id)
        drift = np.full(len(run.time_s), self.intercept_dph)
        if self.variables:
            drift += candidate_matrix([run], self.variables) @ np.array(self.coefficients)
        return drift

    def outside(self, run: RampRun) -> NDArray[np.bool_]:
        """Return which rows lie outside what the training runs covered."""
        low, high = self.temp_range_c
        slow, fast = self.rate_range
        return (run.case_c < low) | (run.case_c > high) | (run.case_rate < slow) | (run.case_rate > fast)

    def equation(self) -> str:
        """Return the equation as text."""
        terms = [
            f"{'-' if value < 0 else '+'} {abs(value):.6g}·{name}"
            for name, value in zip(self.variables, self.coefficients, strict=True)
        ]
        return " ".join([f"B = {self.intercept_dph:.6g}", *terms])

    @classmethod
    def _restored(cls, state: dict[str, Any], metadata: dict[str, Any]) -> Self:
        # until 0.1 files had `training_runs` for `runs`
        return super()._restored(state, metadata | {"runs": state.get("training_runs") or metadata["runs"]})
