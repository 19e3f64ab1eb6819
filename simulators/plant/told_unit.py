"""A unit without table and chamber: it is told what it turns through and how warm the air about it is."""

from __future__ import annotations

import math

import numpy as np

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.effects import Causal, Effect, effect_named
from simulators.interfaces import GyroSignal
from simulators.plant.lab_plant import PlantConfig, UnitConfig, unit_model
from simulators.plant.mounting import Mount
from simulators.plant.noise import NoiseSource
from simulators.plant.table import TableAxis
from simulators.plant.unit import GyroUnit


class ToldUnit(GyroUnit):
    """A unit of a lab, with that lab's noise, switched on at 0 s at the room's temperature.

    ConfigurationError for an IMU, and for a fitted model with effects of the table's angle or of attitude.
    """

    def __init__(self, config: UnitConfig, lab: PlantConfig) -> None:
        _check(config)
        source = NoiseSource(lab.seed, f"unit {config.name}")
        mount = Mount("axis_up", axis=config.axis)
        super().__init__(unit_model(config, lab.seed), mount, TableAxis(lab.table), lab.latitude_deg, source)
        self._turned_rad = np.empty((3, 0))
        self._taken = 0
        self.start(lab.room_temp_c)

    def measure_told(
        self, rates_dps: tuple[float, ...], air_temp_c: float, count: int, period_s: float
    ) -> GyroSignal:
        """Return the next `count` samples at even rates of its axes, in the order of `axes`, in inertial space.

        The air is that of the seconds that begin in them.
        """
        end_s = (self._taken + count) * period_s
        while self._ticks - 1 < end_s - 1e-9:
            self.tick(air_temp_c)
        self._turned_rad = np.zeros((3, count))
        for axis, rate_dps in zip(self._own, rates_dps, strict=True):
            self._turned_rad[axis] = math.radians(rate_dps) * period_s
        signal = self.measure(self._taken * period_s, count, period_s)
        self._taken += count
        return signal

    def _turned(self, edges_s: Array, middle_s: Array, period_s: float) -> Array:
        return self._turned_rad


def _check(config: UnitConfig) -> None:
    if config.model in ("imu", "imu_full"):
        raise ConfigurationError(
            "an IMU cannot be simulated without its table",
            where=config.name,
            found=f"model {config.model}",
            expected="fog_mid, fog_nav, mems, ins_triad or rlg",
            remedy="name another model for the unit in the plant file's [models]",
        )
    terms = () if config.errors is None else config.errors.terms
    effects = {term.effect: effect_named(term.effect, term.shape) for term in terms}
    turning = [
        name
        for name, effect in effects.items()
        if isinstance(effect, Effect) and effect.causal is Causal.SAMPLE
    ]
    if turning:
        raise ConfigurationError(
            "a unit without its table cannot have effects of the table's angle or of attitude",
            where=config.name,
            found=", ".join(turning),
            expected="effects of temperatures, time and rate",
            remedy="take these effects out of the model file that [gap_model] names",
        )
