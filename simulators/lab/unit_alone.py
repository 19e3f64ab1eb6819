"""One unit of an emulated lab by itself, simulated step by step on true inputs: what an FMU of it executes."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from drivers.base.errors import ConfigurationError
from simulators.config import LabConfig
from simulators.lab._build import plant_config
from simulators.plant.told_unit import ToldUnit

_WHOLE = 1e-6
"""How far a step may be off a whole number of samples, in samples."""
_ROUNDING_S = 1e-9


class UnitAlone:
    """The only unit of a lab (`LabConfig` as JSON values), by sample.

    Inputs hold during a step: the true rate of each axis in inertial space, deg/s, and the air about the unit,
    degC, of the seconds that begin in it. Outputs: the mean rate over the step as the unit measures it, deg/s,
    and the readings of its own sensor and of one on its case, degC. A step is a whole number of samples.
    """

    parameters: Mapping[str, tuple[float, str]] = {}
    any_step = False

    def __init__(self, lab: Mapping[str, Any], folder: Path) -> None:
        config = LabConfig.from_line(json.dumps(lab).encode())
        plant, gyro = plant_config(config), config.gyros[0].config
        self._unit = ToldUnit(plant.units[0], plant)
        self._samples = 0
        self.step_s = 1.0 / gyro.rate_hz
        axes = [f"_{axis}" for axis in self._unit.axes] if len(self._unit.axes) > 1 else [""]
        self._rates = [f"rate{axis}_dps" for axis in axes]
        self._measured = [f"output{axis}_dps" for axis in axes]
        room_c = plant.room_temp_c
        self.inputs: Mapping[str, tuple[float, str]] = {
            **dict.fromkeys(self._rates, (0.0, "true rate in inertial space, mean of the step, deg/s")),
            "air_temp_c": (room_c, "air about the unit, of the second that begins, degC"),
        }
        self.outputs: Mapping[str, tuple[float, str]] = {
            **dict.fromkeys(self._measured, (0.0, "rate as measured, mean of the step, deg/s")),
            "temp_c": (room_c, "reading of the unit's own temperature sensor, degC"),
            "case_temp_c": (room_c, "reading of the sensor on its case, degC"),
        }

    def step(self, time_s: float, step_s: float, values: Mapping[str, float]) -> Mapping[str, float]:
        """Return the outputs of the next step; ConfigurationError for one of no whole number of samples."""
        count = round(step_s / self.step_s)
        if count < 1 or abs(step_s / self.step_s - count) > _WHOLE * count:
            raise ConfigurationError(
                "the step is not a whole number of the unit's samples",
                where="the FMU",
                found=f"a step of {step_s:g} s",
                expected=f"{self.step_s:g} s, or a multiple of it",
            )
        rates = tuple(values[name] for name in self._rates)
        signal = self._unit.measure_told(rates, values["air_temp_c"], count, self.step_s)
        turned = signal.angle_increment_rad.sum(axis=0) / (count * self.step_s)
        measured = dict(zip(self._measured, map(math.degrees, turned.tolist()), strict=True))
        self._samples += count
        case_c = self._unit.case_reading_c(self._samples * self.step_s + _ROUNDING_S)
        return {**measured, "temp_c": float(signal.temp_c[-1]), "case_temp_c": case_c}
