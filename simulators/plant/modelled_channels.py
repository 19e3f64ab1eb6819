"""Channels of a lab that follow a model: chamber air, heat flow into a unit, temperature sensor, table, clock.

What a model says of a channel replaces the lab's own physics of that channel, tick by tick; a channel that the
model is silent about keeps the lab's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.effects import (
    CHANNEL_UNITS,
    AppliedBySecond,
    Channel,
    ChannelEffect,
    ChannelInputs,
    Demand,
    Values,
    applied,
    catalogue,
)
from simulators.effects.chamber import AirBySecond
from simulators.effects.heat import CASE_HEAT, GYRO_HEAT, heat_of, reading_of
from simulators.effects.table import ahead_deg, missed_dps, reading_error_arcsec, ripple_ppm
from simulators.plant.chamber import ChamberAir, ChamberDemand
from simulators.plant.model import Readings, UnitModel
from simulators.plant.noise import NoiseSource
from simulators.plant.table import TableAxis, TableParameters
from simulators.plant.thermal import AIR, Link, build_network, tick_matrix

_LAB: tuple[Channel, ...] = ("chamber_air", "table_angle", "table_rate")
"""Those that are the lab's and not one unit's."""
_APPLIED: tuple[Channel, ...] = ("chamber_air", "case_temperature", "gyro_temperature", "table_angle")
"""Those that an effect of another package can change by its `apply`.

A table's rate is also what the gyro turns through: that takes its integral over time, which an `apply` does not
give. Arrivals come from the emulator and its line, not from the plant.
"""


def _emulated() -> dict[str, ChannelEffect]:
    """Return the effects of channels that a lab can have, by name."""
    return {
        name: effect
        for name, effect in catalogue().items()
        if isinstance(effect, ChannelEffect)
        and effect.emulated_by != "nothing"
        and effect.channel in (CHANNEL_UNITS if effect.apply is None else _APPLIED)
    }


def says_of(values: Values, *channels: Channel) -> bool:
    """Return whether a model says anything of some channels."""
    return bool(values) and any(_emulated()[name].channel in channels for name in values)


def check_channels(values: Values) -> None:
    """Raise ConfigurationError for effects that no lab can have, and for heat that is not complete."""
    if not values:
        return
    known = _emulated()
    without = sorted(set(values) - set(known))
    if without:
        raise ConfigurationError(
            "an emulated lab cannot have an effect of the model",
            where="[gap_model]",
            found=", ".join(without),
            expected="any of " + ", ".join(known),
            remedy="take the effect out of the model file; its other effects can be rehearsed without it",
        )
    heat_of(CASE_HEAT, values)
    heat_of(GYRO_HEAT, values)


def lab_channels(models: Mapping[str, Values]) -> dict[str, tuple[float, ...]]:
    """Return the lab's own effects from the models of its units; ConfigurationError where two models differ."""
    result: dict[str, tuple[float, ...]] = {}
    for unit, channels in models.items():
        for name, effect in _emulated().items():
            if name not in channels or effect.channel not in _LAB:
                continue
            if result.setdefault(name, tuple(channels[name])) != tuple(channels[name]):
                raise ConfigurationError(
                    "two models want two different labs",
                    where=f"[gap_model] {unit}",
                    found=f"{name} = {channels[name]}",
                    expected=f"{result[name]}, as in another unit's model: there is one chamber and one table",
                )
    return result


class ModelledAir(ChamberAir):
    """Air that follows a model of the chamber: a set point within what it manages, late, with overshoot."""

    def follow(self, values: Values) -> ModelledAir:
        """Take the model's values; to be called once, before the first tick."""
        self._model = AirBySecond(values, self.air_c)
        self._plain_c = self.air_c
        self._effects = AppliedBySecond("chamber_air", values, _emulated().values())
        self._demands: tuple[Demand, ...] = ()
        return self

    def apply(self, demand: ChamberDemand) -> None:
        """Put a demand in force; a controller that was off starts at the present air temperature."""
        if demand.running and not self.demand.running:
            self._model.restart(self._plain_c)
        super().apply(demand)
        ramp = (
            demand.ramp_up_k_per_min if demand.set_point_c > self.set_point_c else demand.ramp_down_k_per_min
        )
        self._demands += (Demand(demand.time_s, demand.set_point_c, ramp / 60.0 or math.inf),)

    def tick(self) -> None:
        """Advance by 1 s; a chamber that is off drifts to the room."""
        before = self.set_point_c
        if self.demand.running:
            self._move_set_point()
            self._plain_c = self._model.step(self.set_point_c, self.set_point_c - before)
        else:
            self._plain_c += (self.room_temp_c - self._plain_c) * self.parameters.liner_to_room_per_s
        self.air_c = self._effects.step(self.demand.set_point_c, self._plain_c, self._demands)
        self._unit_air_c += (self.air_c - self._unit_air_c) * self._unit_gain

    def _move_set_point(self) -> None:
        gap = self.demand.set_point_c - self.set_point_c
        most = self._model.fastest_k_per_min(self.set_point_c, self.demand.set_point_c) * self.strength
        asked = self.demand.ramp_up_k_per_min if gap > 0.0 else self.demand.ramp_down_k_per_min
        step = min(asked or math.inf, most) / 60.0
        self.set_point_c += math.copysign(min(step, abs(gap)), gap)


def with_heat(unit: UnitModel, values: Values) -> UnitModel:
    """Return the unit with its case's or its own sensor's temperature as a model has it.

    Every modelled body, the mass behind it and the sensor's lag are states behind the unit's own; the rows of the
    two readings are exchanged for theirs. A body feels what is around it as it is at the end of the tick.
    """
    if not says_of(values, "case_temperature", "gyro_temperature"):
        return unit
    of_case, of_gyro = heat_of(CASE_HEAT, values), heat_of(GYRO_HEAT, values)
    states = unit.step.shape[1] - 2
    total = states + 2 * (of_case is not None) + 2 * (of_gyro is not None) + 1
    wide = np.zeros((len(unit.step), total + 2))
    wide[:, :states], wide[:, -2:] = unit.step[:, :states], unit.step[:, -2:]
    unity = np.eye(total + 2)
    outputs = {name: wide[states + index] for index, name in enumerate(unit.outputs)}
    case, inside = outputs["case_temp_c"], outputs["sensor_temp_c"]
    added: list[Array] = []
    if of_case is not None:
        added += _body(unity, states, unity[total], of_case)
        case = added[0]
    if of_gyro is not None:
        rows = _body(unity, states + len(added), case, of_gyro)
        added += rows
        inside = rows[0]
    gain, part, offset_k = reading_of(values)
    inside = gain * inside + (1.0 - gain) * unity[states + len(added)]
    added.append(inside)
    outputs["case_temp_c"] = case
    outputs["sensor_temp_c"] = (1.0 + part) * inside + offset_k * unity[total + 1]
    step = np.vstack((wide[:states], *added, *(outputs[name] for name in unit.outputs)))
    return replace(unit, step=np.ascontiguousarray(step), readings=_readings(values))


def _readings(values: Values) -> Readings:
    """Return what the effects of other packages make of the readings of case and gyro."""
    effects = _emulated().values()
    of_case = AppliedBySecond("case_temperature", values, effects)
    of_gyro = AppliedBySecond("gyro_temperature", values, effects)

    def read(air_temp_c: float, sensor_temp_c: float, case_temp_c: float) -> tuple[float, float]:
        case_temp_c = of_case.step(air_temp_c, case_temp_c)
        return of_gyro.step(case_temp_c, sensor_temp_c), case_temp_c

    return read


def _body(unity: Array, first: int, around: Array, heat: tuple[float, ...]) -> list[Array]:
    """Return the rows of a body's two states, which are `first` and the next, in exchange with a row `around`."""
    conductance, capacity, inner_capacity, inner_conductance, power_w = heat
    network = build_network(
        {"body": capacity, "inner": inner_capacity},
        [Link(AIR, "body", conductance), Link("body", "inner", inner_conductance)],
        {"body": power_w},
    )
    step = tick_matrix(network, np.zeros((0, 2)), np.zeros((0, 2)))
    return [
        row[0] * unity[first] + row[1] * unity[first + 1] + row[2] * around + row[3] * unity[-1]
        for row in step
    ]


class ModelledTable(TableAxis):
    """A table that misses its rate, ripples and reads its angle wrongly as a model has it; else it is perfect."""

    def __init__(self, parameters: TableParameters, source: NoiseSource, values: Values) -> None:
        ideal = replace(parameters, ripple_once_ppm=0.0, ripple_twice_ppm=0.0, encoder_error_arcsec=0.0)
        super().__init__(ideal, source)
        self._values = values
        self._effects = [effect for name, effect in _emulated().items() if name in values]

    def demand_rate(self, now_s: float, rate_dps: float, acceleration_limit_dps2: float = math.inf) -> None:
        """Go to a rate that is off the one demanded, unless that is rest."""
        missed = missed_dps(self._values, rate_dps)
        super().demand_rate(now_s, rate_dps + missed if rate_dps else 0.0, acceleration_limit_dps2)

    def angle_deg(self, now_s: float) -> float:
        """Return the encoder's angle in [0, 360)."""
        held_s = now_s if self._pieces[-1].rate else min(self._starts[-1], now_s)
        angle = np.array([self.total_angle_deg(now_s)])
        error = reading_error_arcsec(self._values, angle, (now_s - held_s) / 3600.0)
        demands = (Demand(held_s, 0.0, math.inf),)
        inputs = ChannelInputs(np.array([now_s]), np.zeros(1), float(error[0]), 1.0, demands, angle)
        error = applied("table_angle", inputs, error, self._values, self._effects)
        return (super().angle_deg(now_s) + float(error[0]) / 3600.0) % 360.0

    def rate_dps(self, now_s: float) -> float:
        """Return the axis rate."""
        ripple = ripple_ppm(self._values, np.asarray(super().total_angle_deg(now_s)))
        return float(super().rate_dps(now_s) * (1.0 + 1e-6 * ripple))

    def total_angle_deg(self, now_s: float) -> float:
        """Return the axis angle, turns counted."""
        angle = super().total_angle_deg(now_s)
        return float(angle + ahead_deg(self._values, np.asarray(angle)))

    def total_angles_deg(self, times_s: Array) -> Array:
        """Return the axis angle at ascending times (see `TableAxis`)."""
        angles = super().total_angles_deg(times_s)
        return np.asarray(angles + ahead_deg(self._values, angles))
