"""The values that cross the fitting room: a run on a uniform grid, and what a model is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from drivers.base.arrays import Array


@dataclass(frozen=True)
class ThermalRun:
    """One run (or one +, -, 0 scale-factor group) of one unit, resampled to 1 s means, all arrays shape (n,).

    `gyro_temp_c` is the gyro's own sensor (T_in), `case_temp_c` the sensor on its case (T_out). A bias run has
    `bias_dph` (output minus the Earth-rate projection, deg/h), a scale-factor group `sf_error_ppm`; the other is
    None. NaN marks seconds without data. `reference` is the (start, end) in s of the equilibrium window before
    the shock at room temperature. `true_*` exist on emulated runs only and are never used by a fit. `remarks` say
    what was left out.
    """

    run_id: str
    unit_id: str
    time_s: Array
    gyro_temp_c: Array
    case_temp_c: Array
    bias_dph: Array | None
    sf_error_ppm: Array | None
    reference: tuple[float, float]
    checksum: str = ""
    phases: Sequence[tuple[float, str]] = ()
    true_bias_dph: Array | None = None
    true_sf_error_ppm: Array | None = None
    remarks: tuple[str, ...] = ()
    meta: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class FeatureRun:
    """A run prepared for models on a coarser uniform grid (`step_s`, 10 s by default), all arrays shape (n,).

    `t_in`, `t_out`: 100 s trailing means of the two temperatures. `dt_60`: change of `t_in` over 60 s, 100 s
    trailing mean, degC/min. `gradient`: t_in - t_out. Targets are 100 s centred means, anchored (reference
    window mean removed); None where the run does not carry that target. `weight`: 0 where a target is not to be
    used.
    """

    run_id: str
    unit_id: str
    step_s: float
    time_s: Array
    t_in: Array
    t_out: Array
    dt_60: Array
    gradient: Array
    bias_dph: Array | None
    sf_error_ppm: Array | None
    weight: Array
    reference: tuple[float, float]
    checksum: str = ""


@dataclass(frozen=True)
class Prediction:
    """Drift of bias (deg/h) and scale-factor error (ppm) against the reference state, shape (n,) each."""

    bias_dph: Array
    sf_error_ppm: Array


class Stepper(Protocol):
    """A model running on a stream: one call per `step_s`, state kept inside."""

    def step(self, t_in: float, t_out: float, dt_60: float, gradient: float) -> tuple[float, float]:
        """Return (bias_dph, sf_error_ppm) for this step; the first call warms the state up on its own input."""
        ...


class ThermalModel(Protocol):
    """A causal model of bias and scale-factor drift from the two temperatures.

    `fit` uses the training runs for everything it learns (normalisation included) and the validation run only to
    choose (hyper-parameters, epoch). `predict` is causal: outputs up to step k do not depend on inputs after k.
    `to_state` gives JSON-able scalars/strings/lists and numpy arrays (no pickle); `from_state` restores.
    """

    name: str

    def fit(self, train: Sequence[FeatureRun], validation: Sequence[FeatureRun]) -> None:
        """Learn from `train`, choose by `validation`."""
        ...

    def predict(self, run: FeatureRun) -> Prediction:
        """Return the drift over a whole run."""
        ...

    def stepper(self) -> Stepper:
        """Return a fresh streaming form; equal to `predict` to 1e-5 of the normalised range."""
        ...

    def to_state(self) -> dict[str, Any]:
        """Return everything needed to restore the model."""
        ...
