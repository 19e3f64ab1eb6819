"""A calibration as a file that corrects the unit's output: one .gyrocomp of kind `imu-calibration`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from bench.analysis.calibration._conventions import PARAMETER_NAMES, PARAMETERS, STATE_UNITS, UNIT_SIZE
from bench.analysis.calibration._navigation import Increments, compensate
from bench.analysis.common.compensation import FittedCompensation
from drivers.base.arrays import Array
from drivers.base.errors import RecordError

MODEL = "gyro w~ = (I + K_g) w + eps; accelerometer f~ = (I + K_a) f + nabla + K_2 (f * f)"
GAUGE = "K_a lower triangular: x along accelerometer x, y in the plane of accelerometers x and y"


@dataclass(frozen=True, eq=False, repr=False)
class ImuCompensation(FittedCompensation):
    """The calibration of one unit. SI: `parameters`, `sigma` (24,), `covariance` (24, 24), `lever_m` (2, 3) and
    `lag_s`. `declared`: what the scheme could not see and other doubts.
    """

    KIND = "imu-calibration"
    WHAT = "calibration of an IMU"
    SHAPES: ClassVar = {"parameters": (24,), "sigma": (24,), "covariance": (24, 24), "lever_m": (2, 3)}
    NAMES: ClassVar = {
        "parameters": "parameters_si",
        "sigma": "sigma_si",
        "covariance": "covariance_si",
        "lever_m": "lever_arm_m",
        "lag_s": "accelerometer_lag_s",
    }

    parameters: Array
    sigma: Array
    covariance: Array
    lever_m: Array
    lag_s: float
    scheme: str
    innovation_rms: float
    declared: tuple[str, ...] = ()

    def apply(
        self, unit_id: str, period_s: float, rate_dps: Array, force_mps2: Array, *, force_unit: bool = False
    ) -> tuple[Array, Array]:
        """Return corrected rates (deg/s) and specific forces (m/s^2), (n, 3) each, of consecutive samples.

        Samples are means over `period_s`, axes x, y, z; the corrected axes are those of the gauge. RecordError
        for samples that are no numbers, UnitMismatch for another unit unless `force_unit` is set.
        """
        self.require_unit(unit_id, force=force_unit)
        rate, force = np.asarray(rate_dps, dtype=np.float64), np.asarray(force_mps2, dtype=np.float64)
        if rate.ndim != 2 or rate.shape[1] != 3 or rate.shape != force.shape:
            raise RecordError(
                "samples of another shape", found=f"{rate.shape} and {force.shape}", expected="(n, 3) both"
            )
        if not (np.isfinite(rate).all() and np.isfinite(force).all()):
            raise RecordError("samples that are no numbers", expected="an unbroken stretch")
        clean = self._compensated(Increments(period_s, np.radians(rate) * period_s, force * period_s))
        return np.degrees(clean.angle_rad) / period_s, clean.velocity_mps / period_s

    def _compensated(self, moved: Increments) -> Increments:
        return compensate(moved, np.concatenate([self.parameters, self.lever_m.ravel(), [self.lag_s]]))

    def _trial(self) -> Any:
        clean = self._compensated(Increments(1.0, np.zeros((3, 3)), np.ones((3, 3))))
        return clean.angle_rad, clean.velocity_mps

    def _described(self) -> dict[str, Any]:
        """Return parameters in printed units."""
        units, sizes = STATE_UNITS[PARAMETERS], UNIT_SIZE[PARAMETERS]
        return {
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
        }

    def _arrays(self) -> dict[str, Any]:
        return {self.NAMES[name]: getattr(self, name) for name in ("parameters", "sigma", "covariance")}
