"""A compensation: a fitted model with what is needed to trust, refuse, apply and trace it; one .gyrocomp file.

The correction is W = (F/K_ref - b) / (1 + dK 1e-6) with the drift (b, dK) counted from the reference state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.compensation import FittedCompensation, provenance
from bench.analysis.thermal._features import prepare
from bench.analysis.thermal._registry import restore_model
from bench.analysis.thermal._regression import TARGETS, common_step, in_reference
from bench.analysis.thermal._selection import ModelScore
from bench.analysis.thermal._stream import FEATURES, CompensationStream, Flag, Interval, Limits
from bench.analysis.thermal._types import FeatureRun, ThermalModel, ThermalRun
from bench.analysis.thermal._width import PredictionWidth
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

UNITS = {"t_in": "degC", "t_out": "degC", "dt_60": "degC/min", "gradient": "degC"}
_NO_TARGETS: dict[str, Any] = dict.fromkeys(TARGETS)
MARGIN = 0.25
"""The outputs are cut to the training targets' interval, widened on each side by this part of it."""


@dataclass(frozen=True)
class TrainingRun:
    """A run the model learnt from: its id, the checksum of its recording, the targets it carried."""

    run_id: str
    checksum: str
    targets: tuple[str, ...]


@dataclass(frozen=True)
class Corrected:
    """A corrected series, arrays of shape (n,): the rate (deg/s), the drift taken off it, a `Flag` per sample."""

    time_s: Array
    rate_dps: Array
    bias_dph: Array
    sf_error_ppm: Array
    flags: NDArray[np.uint8]


@dataclass(frozen=True, repr=False)
class Compensation(FittedCompensation):
    """A fitted thermal model of one unit.

    `step_s`: the model's step. `reference_temp_c`: T_in at which the drift is zero. `k_ref`: the scale factor
    there, output units per deg/s. `scores`: the models considered, best first. `width`: of prediction intervals;
    None where too few runs were left out to know it.
    """

    KIND = None
    WHAT = "thermal drift"
    POSITIVE = ("step_s",)

    model: ThermalModel
    step_s: int
    limits: Limits
    reference_temp_c: float
    k_ref: float
    training_runs: tuple[TrainingRun, ...]
    validation_runs: tuple[TrainingRun, ...] = ()
    scores: tuple[ModelScore, ...] = ()
    width: PredictionWidth | None = None

    @classmethod
    def from_fit(
        cls,
        model: ThermalModel,
        train: Sequence[FeatureRun],
        validation: Sequence[FeatureRun] = (),
        *,
        scores: Sequence[ModelScore] = (),
        k_ref: float = 1.0,
        width: PredictionWidth | None = None,
    ) -> Self:
        """Attach unit, runs, limits, software and date to a model fitted on `train`.

        ConfigurationError for runs of several units or steps.
        """
        step_s = common_step(train)
        return cls(
            unit_id=train[0].unit_id,
            model=model,
            step_s=round(step_s),
            limits=_limits(train),
            reference_temp_c=float(np.median([_reference_temp_c(run) for run in train])),
            k_ref=k_ref,
            training_runs=tuple(map(_paper, train)),
            validation_runs=tuple(map(_paper, validation)),
            scores=tuple(scores),
            width=width,
            **provenance({run.run_id: run.checksum for run in train}, "torch"),
        )

    def _described(self) -> dict[str, Any]:
        """Return inputs and outputs with their units and valid ranges, runs, scores."""
        return {
            "model": self.model.name,
            "inputs": {
                name: {"unit": UNITS[name], "valid_range": list(self.limits.inputs[name])}
                for name in FEATURES
            },
            "outputs": {
                "bias_dph": {"unit": "deg/h", "limits": list(self.limits.bias_dph)},
                "sf_error_ppm": {"unit": "ppm", "limits": list(self.limits.sf_error_ppm)},
            },
            "step_s": self.step_s,
            "reference_temp_c": self.reference_temp_c,
            "k_ref": self.k_ref,
            "trained_from_s": self.limits.trained_from_s,
            "training_runs": [asdict(run) for run in self.training_runs],
            "validation_runs": [asdict(run) for run in self.validation_runs],
            "scores": [score.to_state() for score in self.scores],
        }

    def _arrays(self) -> dict[str, Any]:
        width = {} if self.width is None else {"width": self.width.to_state()}
        return {"state": self.model.to_state(), **width}

    def _trial(self) -> Any:
        bias_dph, sf_error_ppm = self.model.stepper().step(
            self.reference_temp_c, self.reference_temp_c, 0.0, 0.0
        )
        return bias_dph, sf_error_ppm, 1.0 / self.k_ref

    @classmethod
    def _restored(cls, state: dict[str, Any], metadata: dict[str, Any]) -> Self:
        inputs = {name: _interval(state["inputs"][name]["valid_range"]) for name in FEATURES}
        bias, sf = (_interval(state["outputs"][name]["limits"]) for name in TARGETS)
        training = tuple(map(_read_paper, state["training_runs"]))
        metadata["runs"] = {run.run_id: run.checksum for run in training}
        model = restore_model(state["model"], state["state"])
        return cls(
            unit_id=state["unit_id"],
            model=model,
            step_s=state["step_s"],
            limits=Limits(inputs, bias, sf, state["trained_from_s"]),
            reference_temp_c=state["reference_temp_c"],
            k_ref=state["k_ref"],
            training_runs=training,
            validation_runs=tuple(map(_read_paper, state["validation_runs"])),
            scores=tuple(
                ModelScore(**{**score, "parts": tuple(score.get("parts", ()))}) for score in state["scores"]
            ),
            width=PredictionWidth.from_state(state["width"]) if "width" in state else None,
            **metadata,
        )

    def stream(self, unit_id: str, *, force_unit: bool = False) -> CompensationStream:
        """Return a corrector for a live stream of `unit_id`; UnitMismatch as in `apply`."""
        self.require_unit(unit_id, force=force_unit)
        return CompensationStream(self.model.stepper, self.step_s, self.limits, self.k_ref, self._half_widths)

    def half_widths(self, features: FeatureRun) -> Array | None:
        """Return half widths of the 95 % interval of bias (deg/h) and scale-factor error (ppm), (n, 2).

        They are for means of 100 s as measured, noise included; None for a compensation that has none.
        """
        return None if self.width is None else self._half_widths(_inputs(features))

    def _half_widths(self, inputs: Array) -> Array:
        if self.width is None:
            return np.full((*inputs.shape[:-1], 2), np.nan)
        return self.width.half_widths(inputs, self.limits.inputs)

    def drift(self, run: ThermalRun, *, force_unit: bool = False) -> tuple[Array, Array, NDArray[np.uint8]]:
        """Return bias (deg/h), scale-factor error (ppm) and flags at every second of a run, shape (n,) each.

        Before the first second with both temperatures the drift is zero and flagged NO_DRIFT. UnitMismatch
        unless the run is of this compensation's unit or `force_unit` is set.
        """
        self.require_unit(run.unit_id, force=force_unit)
        present = np.isfinite(run.gyro_temp_c) & np.isfinite(run.case_temp_c)
        flags = np.where(present, 0, int(Flag.MISSING)).astype(np.uint8)
        flags[run.time_s < self.limits.trained_from_s] |= np.uint8(Flag.EARLY)
        both = np.zeros((run.time_s.size, 2))
        start = int(np.argmax(present)) if present.any() else present.size
        flags[:start] |= np.uint8(Flag.NO_DRIFT)
        if start < present.size:
            flags[start] |= np.uint8(Flag.RESTARTED)
            names = ("time_s", "gyro_temp_c", "case_temp_c")
            seen = replace(run, **{name: getattr(run, name)[start:] for name in names}, **_NO_TARGETS)
            features = prepare(seen, step_s=self.step_s)
            prediction = self.model.predict(features)
            steps, clamped = self.limits.clamp(
                np.column_stack([prediction.bias_dph, prediction.sf_error_ppm])
            )
            step_flags = clamped | self.limits.flags(_inputs(features))
            index = np.arange(present.size - start) // self.step_s
            both[start:], flags[start:] = steps[index], flags[start:] | step_flags[index]
        return both[:, 0].copy(), both[:, 1].copy(), flags

    def apply(
        self,
        unit_id: str,
        time_s: Array,
        gyro_temp_c: Array,
        case_temp_c: Array,
        rate: Array,
        *,
        force_unit: bool = False,
    ) -> Corrected:
        """Correct a series of 1 s means, shape (n,): temperatures in degC, output in k_ref units per deg/s.

        The whole series at once, equal to pushing it through `stream` second by second. NaN marks seconds
        without data. UnitMismatch unless `unit_id` is this compensation's unit or `force_unit` is set;
        RecordError if the series is not on a 1 s grid.
        """
        run = ThermalRun("series", unit_id, time_s, gyro_temp_c, case_temp_c, None, None, (0.0, 0.0))
        bias_dph, sf_error_ppm, flags = self.drift(run, force_unit=force_unit)
        flags[~np.isfinite(rate)] |= np.uint8(Flag.MISSING)
        corrected = (rate / self.k_ref - bias_dph / 3600.0) / (1.0 + sf_error_ppm * 1e-6)
        return Corrected(time_s, corrected, bias_dph, sf_error_ppm, flags)


def _inputs(run: FeatureRun) -> Array:
    return np.column_stack([getattr(run, name) for name in FEATURES])


def _limits(train: Sequence[FeatureRun]) -> Limits:
    rows = np.concatenate([_inputs(run)[run.weight > 0] for run in train])
    inputs = {
        name: (float(low), float(high))
        for name, low, high in zip(FEATURES, rows.min(axis=0), rows.max(axis=0), strict=True)
    }
    trained_from_s = min(float(run.time_s[run.weight > 0][0]) for run in train if (run.weight > 0).any())
    bias, sf = (_output_interval(train, name) for name in TARGETS)
    return Limits(inputs, bias, sf, trained_from_s)


def _output_interval(train: Sequence[FeatureRun], target: str) -> Interval:
    parts = [getattr(run, target)[run.weight > 0] for run in train if getattr(run, target) is not None]
    values = np.concatenate([np.empty(0), *parts])
    if not values.size:
        return 0.0, 0.0
    margin = MARGIN * float(np.ptp(values))
    return float(values.min()) - margin, float(values.max()) + margin


def _reference_temp_c(run: FeatureRun) -> float:
    window = in_reference(run)
    if not window.any():
        raise ConfigurationError(
            "a training run has no reference window",
            where=f"run {run.run_id}",
            found=f"window {run.reference[0]:g}..{run.reference[1]:g} s",
            expected="equilibrium at room temperature before the shock",
            remedy="leave the run out",
        )
    return float(run.t_in[window].mean())


def _paper(run: FeatureRun) -> TrainingRun:
    return TrainingRun(
        run.run_id, run.checksum, tuple(name for name in TARGETS if getattr(run, name) is not None)
    )


def _read_paper(saved: dict[str, Any]) -> TrainingRun:
    return TrainingRun(saved["run_id"], saved["checksum"], tuple(saved["targets"]))


def _interval(pair: Sequence[float]) -> Interval:
    low, high = pair
    return float(low), float(high)
