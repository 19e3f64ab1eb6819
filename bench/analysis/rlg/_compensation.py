"""The fitted drift of a ring laser gyro as one file: an equation, a smooth form, or the mean of both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.compensation import FittedCompensation
from bench.analysis.rlg._rows import RampRun
from bench.analysis.rlg._smooth import Promise, SmoothForm
from bench.analysis.rlg._variables import candidate_matrix
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError


@dataclass(frozen=True, repr=False)
class RlgCompensation(FittedCompensation):
    """B = (1 - share) (intercept + sum of coefficient * variable) + share * smooth form, in deg/h.

    Temperatures in degC, rates in degC/min. `temp_range_c` and `rate_range` are what the training runs covered;
    beyond them any form is a guess. `smooth`: the form, which also tells intervals where `smooth_share` is 0;
    None of one run.
    """

    KIND = "ring laser drift"
    WHAT = "drift of a ring laser gyro"
    FORMAT = 2
    OLDER = (1,)
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
    smooth: SmoothForm | None = None
    smooth_share: float = 0.0

    def drift_dph(self, run: RampRun) -> Array:
        """Return the bias on every row of a run of the same unit; UnitMismatch for another unit's."""
        self.require_unit(run.unit_id)
        drift = np.full(len(run.time_s), self.intercept_dph)
        if self.variables:
            drift += candidate_matrix([run], self.variables) @ np.array(self.coefficients)
        if self.smooth is None or self.smooth_share == 0.0:
            return drift
        return (1.0 - self.smooth_share) * drift + self.smooth_share * self.smooth.drift_dph(run)

    def half_width_dph(self, run: RampRun) -> Array:
        """Return the half width about `drift_dph` that holds 95 % of a further run's rows, (n,).

        Its offset since power-on and its noise included. ConfigurationError for a file fitted on one run.
        """
        return self._form().half_width_dph(run, self.drift_dph(run))

    def promise(self, run: RampRun) -> Promise:
        """Return the improvement to expect on a further run through the temperatures of `run`.

        Its bias is not read. ConfigurationError for a file fitted on one run.
        """
        return self._form().promise(run, self.drift_dph(run))

    def outside(self, run: RampRun) -> NDArray[np.bool_]:
        """Return which rows lie outside what the training runs covered."""
        low, high = self.temp_range_c
        slow, fast = self.rate_range
        return (run.case_c < low) | (run.case_c > high) | (run.case_rate < slow) | (run.case_rate > fast)

    def equation(self) -> str:
        """Return the equation as text; with `smooth_share` above 0 it is not all of the compensation."""
        terms = [
            f"{'-' if value < 0 else '+'} {abs(value):.6g}·{name}"
            for name, value in zip(self.variables, self.coefficients, strict=True)
        ]
        return " ".join([f"B = {self.intercept_dph:.6g}", *terms])

    @property
    def file_format(self) -> int:
        """1 for an equation alone, which earlier versions read."""
        return 1 if self.smooth is None else 2

    def _form(self) -> SmoothForm:
        if self.smooth is None:
            raise ConfigurationError(
                "this compensation has no interval: nothing is known of how far runs lie apart",
                where=f"compensation of unit {self.unit_id}",
                found=f"an equation fitted on {len(self.runs)} runs",
                expected="a file of this version, fitted on two runs or more",
                remedy="record another run and fit both",
            )
        return self.smooth

    def _described(self) -> dict[str, Any]:
        described = super()._described()
        form, share = described.pop("smooth"), described.pop("smooth_share")
        return described if form is None else described | {"smooth_share": share}

    def _arrays(self) -> dict[str, Any]:
        return {} if self.smooth is None else {"smooth": self.smooth.to_state()}

    def _trial(self) -> Any:
        if self.smooth is None:
            return 0.0
        low, high = self.temp_range_c
        case, rate = np.linspace(low, high, 3), np.zeros(3)
        times = 100.0 * np.arange(3.0)
        run = RampRun("", self.unit_id, times, case, case, rate, rate, rate, np.zeros(3, np.int64))
        return self.smooth.drift_dph(run)

    @classmethod
    def _restored(cls, state: dict[str, Any], metadata: dict[str, Any]) -> Self:
        smooth = None if state["format"] == 1 else SmoothForm.from_state(state["smooth"])
        share = 0.0 if smooth is None else float(state["smooth_share"])
        if not 0.0 <= share <= 1.0:
            raise ValueError("a share of the smooth form that is none")
        # until 0.1 files had `training_runs` for `runs`
        runs = state.get("training_runs") or metadata["runs"]
        whole = state | {"smooth": smooth, "smooth_share": share}
        return super()._restored(whole, metadata | {"runs": runs})
