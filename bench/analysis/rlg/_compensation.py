"""A fitted equation with what is needed to trust, refuse and trace it, as one file of kind `ring laser drift`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.state_file import read_compensation, write_state
from bench.analysis.rlg._rows import RampRun
from bench.analysis.rlg._variables import candidate_matrix
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

FORMAT = 1
KIND = "ring laser drift"


@dataclass(frozen=True)
class RlgCompensation:
    """B = intercept + sum of coefficient * variable, in deg/h; temperatures in degC, rates in degC/min.

    `temp_range_c` and `rate_range` are what the training runs covered; beyond them the equation is a guess.
    """

    unit_id: str
    variables: tuple[str, ...]
    coefficients: tuple[float, ...]
    intercept_dph: float
    temp_range_c: tuple[float, float]
    rate_range: tuple[float, float]
    training_runs: Mapping[str, str]
    statistics: Mapping[str, float] = field(default_factory=dict)
    software: Mapping[str, str] = field(default_factory=dict)

    def drift_dph(self, run: RampRun) -> Array:
        """Return the bias on every row of a run of the same unit; ConfigurationError for another unit's."""
        if run.unit_id != self.unit_id:
            raise ConfigurationError(
                "a compensation of another gyro",
                where=f"run {run.run_id}",
                found=f"unit {run.unit_id}",
                expected=f"unit {self.unit_id}, which the equation was fitted on",
                remedy="fit this unit on its own runs",
            )
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

    def save(self, path: Path) -> None:
        """Write the file; it holds no pickle and appears whole or not at all."""
        write_state(path, {"format": FORMAT, "kind": KIND, **asdict(self)})

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file; RecordError if it is damaged, of another kind or format."""
        saved = read_compensation(path, KIND, FORMAT)
        lists = ("variables", "coefficients", "temp_range_c", "rate_range")
        values = {item.name: saved[item.name] for item in fields(cls)}
        return cls(**{**values, **{name: tuple(saved[name]) for name in lists}})


def training_ranges(runs: Sequence[RampRun]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ranges of case temperature and of its rate that `runs` cover."""
    temps = np.concatenate([run.case_c for run in runs])
    rates = np.concatenate([run.case_rate for run in runs])
    return (float(temps.min()), float(temps.max())), (float(rates.min()), float(rates.max()))
