"""A fitted equation with what is needed to trust, refuse and trace it, as one JSON file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.rlg._rows import RampRun
from bench.rlg._variables import candidate_matrix
from bench.state_file import save_file
from drivers.errors import ConfigurationError, RecordError
from drivers.files import SETTINGS_BYTES, parse_json, read_bounded

FORMAT = "gyrobench-rlg-compensation-1"
Array = NDArray[np.float64]


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
        """Write the file: readable JSON that carries the SHA-256 of its own content."""
        content = _plain(self)
        save_file(path, json.dumps({"format": FORMAT, "sha256": _digest(content), **content}, indent=2))

    @classmethod
    def load(cls, path: Path) -> RlgCompensation:
        """Read a file; RecordError if it is none or was changed."""
        try:
            data: dict[str, Any] = parse_json(read_bounded(path, SETTINGS_BYTES))
            kind, digest = data.pop("format"), data.pop("sha256")
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise RecordError("not a compensation file", where=str(path), found=str(error)) from error
        if kind != FORMAT or digest != _digest(data):
            raise RecordError(
                "the compensation file is of another kind, or was changed after it was written",
                where=str(path),
                found=f"format {kind}, checksum {'right' if digest == _digest(data) else 'wrong'}",
                expected=f"{FORMAT} with its own checksum",
                remedy="fit again, or use the file as it was written",
            )
        pairs = {name: tuple(data[name]) for name in ("temp_range_c", "rate_range")}
        lists = {name: tuple(data[name]) for name in ("variables", "coefficients")}
        return cls(**{**data, **pairs, **lists})


def training_ranges(runs: Sequence[RampRun]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ranges of case temperature and of its rate that `runs` cover."""
    temps = np.concatenate([run.case_c for run in runs])
    rates = np.concatenate([run.case_rate for run in runs])
    return (float(temps.min()), float(temps.max())), (float(rates.min()), float(rates.max()))


def _plain(compensation: RlgCompensation) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(json.dumps(asdict(compensation)))
    return data


def _digest(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
