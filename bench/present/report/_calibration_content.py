"""What a calibration's report is made of: a scheme, perhaps with what a record of it gave."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from drivers.base.arrays import Array

if TYPE_CHECKING:
    from bench.analysis.calibration import (
        BiasWander,
        CalibrationRun,
        Estimate,
        Evaluation,
        Inflation,
        RecordNoise,
    )
    from bench.analysis.common.uncertainty import Budget

_SIGMAS = {
    True: "The sigmas are with the noise that the record shows.",
    False: "Every sigma here is with the noise that was told, and wrong accordingly.",
}


def calibration_model() -> ModuleType:
    """Return the package of what is shown."""
    from bench.analysis import calibration  # scipy behind it is slow to import

    return calibration


@dataclass(frozen=True, eq=False)
class CalibrationContent:
    """What a scheme sees, and with `estimate` what a calibration by it gave.

    `truth` (24,), SI, where the IMU is emulated; `wander` if the filter was told that the biases wander,
    `noise` what the record shows of its noise, `corrected` if the estimate is with that. `budgets`: of the
    parameters. `inflation`: of noise for navigation. Arrays in printed units: by state, shape (30,), by
    parameter (24,), or by position (positions, 30).
    """

    evaluation: Evaluation
    estimate: Estimate | None = None
    truth: Array | None = None
    created_utc: str = ""
    run: CalibrationRun | None = None
    wander: BiasWander | None = None
    noise: RecordNoise | None = None
    corrected: bool = False
    budgets: Mapping[str, Budget] = field(default_factory=dict)
    inflation: Inflation | None = None

    @cached_property
    def prior(self) -> Array:
        """Sigma before, by state."""
        return np.asarray(self.evaluation.task.prior_sigma / calibration_model().UNIT_SIZE)

    @cached_property
    def target(self) -> Array:
        """Sigma wanted, by state; NaN for attitude and velocity."""
        targets = np.concatenate([np.full(6, np.nan), self.evaluation.task.target_sigma])
        return np.asarray(targets / calibration_model().UNIT_SIZE)

    @cached_property
    def sigma(self) -> Array:
        """Sigma reached, by state."""
        sigma = self.evaluation.sigma.copy()
        if self.estimate is not None:
            sigma[calibration_model().PARAMETERS] = self.estimate.sigma
        return np.asarray(sigma / calibration_model().UNIT_SIZE)

    @cached_property
    def course(self) -> Array:
        """Sigma after each dwell, by position and state."""
        course = self.evaluation.course.copy()
        if self.estimate is not None and len(self.estimate.course) == len(course):
            course[:, calibration_model().PARAMETERS] = self.estimate.course
        return np.asarray(course / calibration_model().UNIT_SIZE)

    @cached_property
    def values(self) -> dict[str, Array]:
        """The estimate and the truth as far as they are known, by parameter."""
        size = calibration_model().UNIT_SIZE[calibration_model().PARAMETERS]
        known = {"Estimate": self.estimate and self.estimate.parameters, "Truth": self.truth}
        return {name: values / size for name, values in known.items() if values is not None}

    @cached_property
    def z(self) -> Array | None:
        """Errors over sigma, by parameter; None without estimate and truth."""
        if len(self.values) < 2:
            return None
        return np.asarray((self.values["Estimate"] - self.values["Truth"]) / self.sigma[6:])

    @property
    def poorly_seen(self) -> list[str]:
        """The combinations of states that the scheme hardly tells apart."""
        return [str(combination) for combination in self.evaluation.combinations]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to mind about the scheme, or about the calibration by it."""
        if self.estimate is None:
            return self.evaluation.warnings
        alarms = () if self.noise is None else self.noise.alarms
        return (
            *alarms,
            *([_SIGMAS[self.corrected]] if alarms else []),
            *calibration_model().missed_targets(self.estimate.sigma, self.evaluation.task),
            *self.evaluation.cautions,
        )
