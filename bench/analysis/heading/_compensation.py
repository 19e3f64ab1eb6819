"""The compensation of a platform's heading effect as one file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Self

import numpy as np

from bench.analysis.common.compensation import FittedCompensation, provenance
from bench.analysis.heading._compensator import HeadingCompensator
from bench.analysis.heading._lagged import MOST_UNEXPLAINED, Evidence, LaggedModel, regressors
from bench.analysis.heading._second import SecondSensor, second_terms
from bench.analysis.heading._temperature import ReferenceTemperature
from drivers.base.errors import ConfigurationError

_SAME = ("form", "tau_s", "reference_heading_deg", "latitude_deg", "headings", "hours")
"""Numbers of the model that have the same name in the file."""


@dataclass(frozen=True, eq=False, repr=False)
class HeadingCompensation(FittedCompensation):
    """A fitted heading effect of one platform."""

    KIND = "gyrobench heading compensation"
    WHAT = "heading effect"
    SHAPES: ClassVar = {
        "model.gain": (3, "terms"),
        "model.sigma": (3, "terms"),
        "model.terms": ("terms",),
        "model.largest": ("terms",),
        "model.swing": (3, 4),
        "model.reference.coefficients": ("harmonics",),
    }

    POSITIVE = ("model.tau_s",)

    model: LaggedModel

    @classmethod
    def from_fit(cls, model: LaggedModel, unit_id: str, runs: Mapping[str, str]) -> Self:
        """Attach unit, runs, software and date to a fitted model; ConfigurationError where it explains little."""
        if model.evidence.cause == "unexplained":
            raise ConfigurationError(
                "the measured temperature explains too little of this platform's heading effect",
                found=f"{100.0 * model.evidence.other_share:.0f} % of it goes with heading, not temperature",
                expected=f"at most {100.0 * MOST_UNEXPLAINED:.0f} %",
                remedy="measure the temperature where the drift comes from, or look for friction and magnetic "
                "fields; compensating with this one could add error",
            )
        return cls(unit_id, model, **provenance(runs))

    def stream(
        self, unit_id: str, latitude_deg: float | None = None, *, force_unit: bool = False
    ) -> HeadingCompensator:
        """Return what corrects `unit_id` sample by sample; UnitMismatch for another unit."""
        self.require_unit(unit_id, force=force_unit)
        return HeadingCompensator(self.model, latitude_deg)

    def _described(self) -> dict[str, Any]:
        model = self.model
        same = {name: getattr(model, name) for name in _SAME}
        return {**same, "tau_sigma_s": model.tau_sigma_s, "evidence": asdict(model.evidence)}

    def _arrays(self) -> dict[str, Any]:
        return {
            "gain_dph_per_k": self.model.gain,
            "sigma_dph_per_k": self.model.sigma,
            "reference": asdict(self.model.reference),
            "largest": self.model.largest,
            "swing": self.model.swing,
            **({"second": asdict(self.model.second)} if self.model.second else {}),
        }

    def _trial(self) -> Any:
        model = self.model
        rows = regressors(np.zeros(2), np.zeros(2), 1.0, model.reference, model.tau_s, model.form)
        if model.second is not None:
            change = model.second.change(np.zeros(2), np.zeros(2), np.zeros(2))
            rows = np.concatenate([rows, second_terms(change, np.zeros(2), 1.0 / model.second.tau_s)], axis=1)
        return rows @ model.gain.T

    @classmethod
    def _restored(cls, state: dict[str, Any], metadata: dict[str, Any]) -> Self:
        second = state.get("second")  # not in files until 0.1
        if second is not None:
            second = SecondSensor(**{**second, "reference": ReferenceTemperature(**second["reference"])})
        model = LaggedModel(
            gain=state["gain_dph_per_k"],
            sigma=state["sigma_dph_per_k"],
            reference=ReferenceTemperature(**state["reference"]),
            evidence=Evidence(**state["evidence"]),
            **{name: state[name] for name in (*_SAME, "largest", "swing")},
            tau_sigma_s=float(state.get("tau_sigma_s", 0.0)),  # likewise
            second=second,
        )
        return cls(str(state.get("unit_id", "")), model, **metadata)  # files until 0.1 said no unit
