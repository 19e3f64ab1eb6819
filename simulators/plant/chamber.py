"""The chamber's air: ramp generator, PI controller, refrigeration limits, liner, and the air at the unit.

Set point -> PI with conditional anti-windup -> heat flow in K/s of air, limited by the heater and by a
refrigeration that weakens towards its floor -> air, which also exchanges heat with the liner and walls. The unit
sees the air through a lag and with slow noise. One tick is one cycle of the controller, 1 s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from simulators.plant.noise import NoiseSource, TickNoise


@dataclass(frozen=True)
class ChamberParameters:
    """Nominal values: a liquid-nitrogen class chamber that holds 12 K/min down to -45 degC."""

    kp_per_s: float = 0.10
    ki_per_s2: float = 6e-4
    heating_k_per_s: float = 0.95
    cooling_at_25_k_per_s: float = 2.0
    cooling_floor_c: float = -78.0
    air_to_liner_per_s: float = 0.010
    liner_to_air_per_s: float = 0.010 / 9.0
    liner_to_room_per_s: float = 2e-5
    unit_lag_s: float = 25.0
    air_noise_k: float = 0.05
    air_noise_time_s: float = 60.0


WEAK_CHAMBER = ChamberParameters(cooling_at_25_k_per_s=1.3, air_to_liner_per_s=0.012)
"""A mechanically cooled chamber with a heavier load: cannot hold 10 K/min over the whole shock."""


@dataclass(frozen=True)
class ChamberDemand:
    """What the controller was told: ramps in K/min, 0 = as fast as the chamber can."""

    time_s: float
    set_point_c: float
    ramp_up_k_per_min: float
    ramp_down_k_per_min: float
    running: bool


class ChamberAir:
    """Air, liner and controller; `tick` moves them by one second under the demand in force."""

    def __init__(self, parameters: ChamberParameters, room_temp_c: float, noise: NoiseSource) -> None:
        self.parameters = parameters
        self.room_temp_c = room_temp_c
        self.air_c = room_temp_c
        self.set_point_c = room_temp_c
        self.strength = 1.0
        """What is left of the heater's and the refrigeration's power."""
        self.demand = ChamberDemand(0.0, room_temp_c, 0.0, 0.0, False)
        self._liner_c = room_temp_c
        self._unit_air_c = room_temp_c
        self._integral = 0.0
        self._unit_gain = 1.0 - math.exp(-1.0 / parameters.unit_lag_s) if parameters.unit_lag_s else 1.0
        self._noise = TickNoise(noise, (parameters.air_noise_time_s,), parameters.air_noise_k)

    def unit_air_c(self, tick: int) -> float:
        """Return the air temperature around the units at `tick`."""
        return self._unit_air_c + self._noise.value(tick)

    def tick(self) -> None:
        """Advance by 1 s."""
        p = self.parameters
        flow = self._controlled_flow() if self.demand.running else 0.0
        air, liner = self.air_c, self._liner_c
        self.air_c = air + flow - p.air_to_liner_per_s * (air - liner)
        self._liner_c = (
            liner + p.liner_to_air_per_s * (air - liner) + p.liner_to_room_per_s * (self.room_temp_c - liner)
        )
        self._unit_air_c += (self.air_c - self._unit_air_c) * self._unit_gain

    def apply(self, demand: ChamberDemand) -> None:
        """Put a demand in force; a controller that was off starts its ramp at the present air temperature."""
        if demand.running and not self.demand.running:
            self.set_point_c = self.air_c
            self._integral = 0.0
        if not demand.running:
            self.set_point_c = demand.set_point_c
        self.demand = demand

    def _controlled_flow(self) -> float:
        """Return the heat flow in K/s of air: PI, limited; the integral rests while the limit holds it back."""
        p = self.parameters
        self._move_set_point()
        error = self.set_point_c - self.air_c
        wanted = p.kp_per_s * error + self._integral
        reach = (self.air_c - p.cooling_floor_c) / (25.0 - p.cooling_floor_c)
        strongest = -p.cooling_at_25_k_per_s * self.strength * max(0.0, reach)
        flow = min(max(wanted, strongest), p.heating_k_per_s * self.strength)
        if flow == wanted or (flow - wanted) * error > 0.0:
            self._integral += p.ki_per_s2 * error
        return flow

    def _move_set_point(self) -> None:
        gap = self.demand.set_point_c - self.set_point_c
        ramp = self.demand.ramp_up_k_per_min if gap > 0.0 else self.demand.ramp_down_k_per_min
        step = ramp / 60.0
        if step == 0.0 or abs(gap) <= step:
            self.set_point_c = self.demand.set_point_c
        else:
            self.set_point_c += math.copysign(step, gap)
