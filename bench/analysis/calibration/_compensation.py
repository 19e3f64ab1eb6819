"""A calibration as a file that corrects the unit's output: one .gyrocomp of kind `imu-calibration`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np

from bench.analysis.calibration._conventions import PARAMETER_NAMES, PARAMETERS, STATE_UNITS, UNIT_SIZE
from bench.analysis.calibration._estimator import Estimate
from bench.analysis.calibration._navigation import Increments, compensate
from bench.analysis.common.state_file import read_compensation, versions, write_state
from drivers.base.arrays import Array
from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError, RecordError

FORMAT = 1
KIND = "imu-calibration"
MODEL = "gyro w~ = (I + K_g) w + eps; accelerometer f~ = (I + K_a) f + nabla + K_2 (f * f)"
GAUGE = "K_a lower triangular: x along accelerometer x, y in the plane of accelerometers x and y"


@dataclass(frozen=True, eq=False)
class ImuCompensation:
    """The calibration of one unit and its papers. SI: `parameters`, `sigma` (24,), `covariance` (24, 24),
    `lever_m` (2, 3) and `lag_s`. `runs`: run id -> checksum of its recording. `declared`: what the scheme
    could not see and other doubts.
    """

    unit_id: str
    parameters: Array
    sigma: Array
    covariance: Array
    lever_m: Array
    lag_s: float
    scheme: str
    innovation_rms: float
    runs: Mapping[str, str] = field(default_factory=dict)
    declared: tuple[str, ...] = ()
    software: Mapping[str, str] = field(default_factory=dict)
    created_utc: str = ""

    @classmethod
    def from_estimate(
        cls,
        found: Estimate,
        *,
        unit_id: str,
        scheme: str,
        runs: Mapping[str, str] | None = None,
        declared: tuple[str, ...] = (),
    ) -> Self:
        """Put the papers to an estimate."""
        return cls(
            unit_id=unit_id,
            parameters=found.parameters,
            sigma=found.sigma,
            covariance=found.covariance,
            lever_m=found.lever_m,
            lag_s=found.lag_s,
            scheme=scheme,
            innovation_rms=found.innovation_rms,
            runs=dict(runs or {}),
            declared=declared,
            software=versions(),
            created_utc=utc_now(),
        )

    def apply(
        self,
        unit_id: str,
        period_s: float,
        rate_dps: Array,
        force_mps2: Array,
        *,
        force_unit: bool = False,
    ) -> tuple[Array, Array]:
        """Return corrected rates (deg/s) and specific forces (m/s^2), (n, 3) each, of consecutive samples.

        Samples are means over `period_s`, axes x, y, z; the corrected axes are those of the gauge. RecordError
        for samples that are no numbers, ConfigurationError for another unit unless `force_unit` is set.
        """
        if unit_id != self.unit_id and not force_unit:
            raise ConfigurationError(
                "this calibration is of another unit",
                where=f"calibration of unit {self.unit_id}",
                found=f"unit {unit_id}",
                expected=f"unit {self.unit_id}",
                remedy="use this unit's own calibration: on another unit the errors grow instead of shrink",
            )
        rate, force = np.asarray(rate_dps, dtype=np.float64), np.asarray(force_mps2, dtype=np.float64)
        if rate.ndim != 2 or rate.shape[1] != 3 or rate.shape != force.shape:
            raise RecordError(
                "samples of another shape", found=f"{rate.shape} and {force.shape}", expected="(n, 3) both"
            )
        if not (np.isfinite(rate).all() and np.isfinite(force).all()):
            raise RecordError("samples that are no numbers", expected="an unbroken stretch")
        moved = Increments(period_s, np.radians(rate) * period_s, force * period_s)
        every = np.concatenate([self.parameters, self.lever_m.ravel(), [self.lag_s]])
        clean = compensate(moved, every)
        return np.degrees(clean.angle_rad) / period_s, clean.velocity_mps / period_s

    def describe(self) -> dict[str, Any]:
        """Return the papers as JSON-able values, parameters in printed units."""
        units, sizes = STATE_UNITS[PARAMETERS], UNIT_SIZE[PARAMETERS]
        return {
            "format": FORMAT,
            "kind": KIND,
            "unit_id": self.unit_id,
            "model": MODEL,
            "gauge": GAUGE,
            "scheme": self.scheme,
            "parameters": {
                name: {"value": float(value / size), "sigma": float(sigma / size), "unit": unit}
                for name, value, sigma, unit, size in zip(
                    PARAMETER_NAMES, self.parameters, self.sigma, units, sizes, strict=True
                )
            },
            "lever_arm_m": self.lever_m.tolist(),
            "accelerometer_lag_s": self.lag_s,
            "innovation_rms": self.innovation_rms,
            "runs": dict(self.runs),
            "declared": list(self.declared),
            "software": dict(self.software),
            "created_utc": self.created_utc,
        }

    def save(self, path: Path) -> None:
        """Write the file; it holds no pickle and appears whole or not at all."""
        exact = {"parameters_si": self.parameters, "sigma_si": self.sigma, "covariance_si": self.covariance}
        write_state(path, {**self.describe(), **exact})

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file; RecordError if it is damaged, of another kind or format."""
        saved = read_compensation(path, KIND, FORMAT)
        return cls(
            unit_id=saved["unit_id"],
            parameters=saved["parameters_si"],
            sigma=saved["sigma_si"],
            covariance=saved["covariance_si"],
            lever_m=np.array(saved["lever_arm_m"], dtype=np.float64),
            lag_s=float(saved["accelerometer_lag_s"]),
            scheme=saved["scheme"],
            innovation_rms=float(saved["innovation_rms"]),
            runs=saved["runs"],
            declared=tuple(saved["declared"]),
            software=saved["software"],
            created_utc=saved["created_utc"],
        )
