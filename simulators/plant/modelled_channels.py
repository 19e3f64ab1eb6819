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
from simulators.effects import CATALOGUE, REFERENCE_C, ChannelEffect
from simulators.plant.chamber import ChamberAir, ChamberDemand
from simulators.plant.effect import UnitModel
from simulators.plant.noise import NoiseSource
from simulators.plant.table import TableParameters
from simulators.plant.thermal import AIR, Link, build_network, tick_matrix
from simulators.plant.wobble import EncodedTable, EncoderParameters

Channels = Mapping[str, tuple[float, ...]]
"""Effect of a channel to the values of its parameters."""
_EFFECTS = {each.name: each for each in CATALOGUE if isinstance(each, ChannelEffect)}
CHAMBER = ("chamber_ramp", "chamber_overshoot", "chamber_response", "chamber_offset")
CASE = ("air_to_case_conductance", "case_heat_capacity", "fixture_heat", "self_heating_power")
BODY = ("case_to_gyro_conductance", "gyro_heat_capacity", "gyro_core_heat", "gyro_heating_power")
SENSOR = ("temperature_sensor_offset", "temperature_sensor_gain", "temperature_sensor_lag")
ANGLE = ("table_position_offset", "table_position_creep", "table_encoder_eccentricity")
RATE = ("table_rate_error", "table_rate_ripple_once", "table_rate_ripple_twice")
CLOCK = ("sample_clock_skew",)
EMULATED = (*CHAMBER, *CASE, *BODY, *SENSOR, *ANGLE, *RATE, *CLOCK)
"""Effects of channels that a lab can have."""
OF_TABLE = (*ANGLE, *RATE)
OF_LAB = (*CHAMBER, *OF_TABLE)
"""Those that are the lab's and not one unit's."""


def check_channels(channels: Channels) -> None:
    """Raise ConfigurationError for effects that no lab can have, and for heat that is not complete."""
    without = sorted(set(channels) - set(EMULATED))
    if without:
        raise ConfigurationError(
            "an emulated lab cannot have an effect of the model",
            where="[gap_model]",
            found=", ".join(without),
            expected="any of " + ", ".join(EMULATED),
            remedy="take the effect out of the model file; its other effects can be rehearsed without it",
        )
    for group in (CASE, BODY):
        needed = {name for name in group if _EFFECTS[name].needed}
        some = needed & set(channels)
        if some and some != needed:
            raise ConfigurationError(
                "a model's heat is not complete",
                where="[gap_model]",
                found=", ".join(sorted(some)),
                expected=", ".join(sorted(needed)),
            )


def lab_channels(models: Mapping[str, Channels]) -> dict[str, tuple[float, ...]]:
    """Return the lab's own effects from the models of its units; ConfigurationError where two models differ."""
    result: dict[str, tuple[float, ...]] = {}
    for unit, channels in models.items():
        for name in OF_LAB:
            if name not in channels:
                continue
            if result.setdefault(name, tuple(channels[name])) != tuple(channels[name]):
                raise ConfigurationError(
                    "two models want two different labs",
                    where=f"[gap_model] {unit}",
                    found=f"{name} = {channels[name]}",
                    expected=f"{result[name]}, as in another unit's model: there is one chamber and one table",
                )
    return result


def _values(channels: Channels, name: str) -> tuple[float, ...]:
    return tuple(channels.get(name, _EFFECTS[name].neutral))


class ModelledAir(ChamberAir):
    """Air that follows a model of the chamber: a set point within what it manages, late, with overshoot."""

    def follow(self, channels: Channels) -> ModelledAir:
        """Take the model's values; to be called once, before the first tick."""
        self._most = _values(channels, "chamber_ramp")
        self._overshoot_s, self._settling_s = _values(channels, "chamber_overshoot")
        (self._lag_s,) = _values(channels, "chamber_response")
        (self._offset_k,) = _values(channels, "chamber_offset")
        self._late_c = self.air_c
        self._ahead = [0.0, 0.0]
        return self

    def apply(self, demand: ChamberDemand) -> None:
        """Put a demand in force; a controller that was off starts at the present air temperature."""
        if demand.running and not self.demand.running:
            self._late_c = self.air_c - self._offset_k
        super().apply(demand)

    def tick(self) -> None:
        """Advance by 1 s; a chamber that is off drifts to the room."""
        before = self.set_point_c
        if self.demand.running:
            self._move_set_point()
            ramp = self.set_point_c - before
            self._late_c += (self.set_point_c - self._late_c) * _gain(self._lag_s)
            self._ahead[0] += (ramp - self._ahead[0]) * _gain(self._settling_s)
            self._ahead[1] += (self._ahead[0] - self._ahead[1]) * _gain(self._settling_s)
            beyond = self._overshoot_s * (self._ahead[1] - self._ahead[0])
            self.air_c = self._late_c + beyond + self._offset_k
        else:
            self.air_c += (self.room_temp_c - self.air_c) * self.parameters.liner_to_room_per_s
        self._unit_air_c += (self.air_c - self._unit_air_c) * self._unit_gain

    def _move_set_point(self) -> None:
        gap = self.demand.set_point_c - self.set_point_c
        warm, cold, heating = self._most
        cooling = cold + (warm - cold) * (self.set_point_c + 40.0) / 65.0
        most = max(heating if gap > 0.0 else cooling, 0.01) * self.strength
        asked = self.demand.ramp_up_k_per_min if gap > 0.0 else self.demand.ramp_down_k_per_min
        step = min(asked or math.inf, most) / 60.0
        self.set_point_c += math.copysign(min(step, abs(gap)), gap)


def _gain(time_s: float) -> float:
    return 1.0 - math.exp(-1.0 / time_s) if time_s > 0.0 else 1.0


def with_heat(unit: UnitModel, channels: Channels) -> UnitModel:
    """Return the unit with its case's or its own sensor's temperature as a model has it.

    Every modelled body, the mass behind it and the sensor's lag are states behind the unit's own; the rows of the
    two readings are exchanged for theirs. A body feels what is around it as it is at the end of the tick.
    """
    if not any(name in channels for name in (*CASE, *BODY, *SENSOR)):
        return unit
    states = unit.step.shape[1] - 2
    has_case, has_body = "case_heat_capacity" in channels, "gyro_heat_capacity" in channels
    total = states + 2 * has_case + 2 * has_body + 1
    wide = np.zeros((len(unit.step), total + 2))
    wide[:, :states], wide[:, -2:] = unit.step[:, :states], unit.step[:, -2:]
    unity = np.eye(total + 2)
    outputs = {name: wide[states + index] for index, name in enumerate(unit.outputs)}
    case, inside = outputs["case_temp_c"], outputs["sensor_temp_c"]
    added: list[Array] = []
    if has_case:
        added += _body(unity, states, unity[total], _heat(channels, CASE))
        case = added[0]
    if has_body:
        rows = _body(unity, states + len(added), case, _heat(channels, BODY))
        added += rows
        inside = rows[0]
    (offset_k,) = _values(channels, "temperature_sensor_offset")
    (gain_percent,) = _values(channels, "temperature_sensor_gain")
    late = _gain(_values(channels, "temperature_sensor_lag")[0])
    inside = late * inside + (1.0 - late) * unity[states + len(added)]
    added.append(inside)
    part = 0.01 * gain_percent
    outputs["case_temp_c"] = case
    outputs["sensor_temp_c"] = (1.0 + part) * inside + (offset_k - part * REFERENCE_C) * unity[total + 1]
    step = np.vstack((wide[:states], *added, *(outputs[name] for name in unit.outputs)))
    return replace(unit, step=np.ascontiguousarray(step))


def _heat(channels: Channels, names: tuple[str, ...]) -> tuple[float, ...]:
    """Return conductance, capacity, inner capacity, inner conductance and power of a body, W/K, J/K, W."""
    return tuple(value for name in names for value in _values(channels, name))


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


class ModelledTable(EncodedTable):
    """A table that misses its rate, ripples and reads its angle wrongly as a model has it; else it is perfect."""

    def __init__(
        self, parameters: TableParameters, encoder: EncoderParameters, source: NoiseSource, channels: Channels
    ) -> None:
        ideal = replace(parameters, ripple_once_ppm=0.0, ripple_twice_ppm=0.0, encoder_error_arcsec=0.0)
        super().__init__(ideal, encoder, source)
        self._rate_error_ppm, self._rate_offset_mdps = _values(channels, "table_rate_error")
        self._once = _values(channels, "table_rate_ripple_once")
        self._twice = _values(channels, "table_rate_ripple_twice")
        (self._offset_arcsec,) = _values(channels, "table_position_offset")
        (self._creep_arcsec_per_h,) = _values(channels, "table_position_creep")
        self._eccentricity = _values(channels, "table_encoder_eccentricity")

    def demand_rate(self, now_s: float, rate_dps: float, acceleration_limit_dps2: float = math.inf) -> None:
        """Go to a rate that is off the one demanded, unless that is rest."""
        missed = 1e-6 * self._rate_error_ppm * rate_dps + 1e-3 * self._rate_offset_mdps
        super().demand_rate(now_s, rate_dps + missed if rate_dps else 0.0, acceleration_limit_dps2)

    def angle_deg(self, now_s: float) -> float:
        """Return the encoder's angle in [0, 360)."""
        turn = math.radians(self.total_angle_deg(now_s))
        cosine, sine = self._eccentricity
        error = self._offset_arcsec + cosine * (math.cos(turn) - 1.0) + sine * math.sin(turn)
        since_h = max(now_s - self._starts[-1], 0.0) / 3600.0
        if not self._pieces[-1].rate:
            error += self._creep_arcsec_per_h * since_h
        return (super().angle_deg(now_s) + error / 3600.0) % 360.0

    def rate_dps(self, now_s: float) -> float:
        """Return the axis rate."""
        turn = math.radians(super().total_angle_deg(now_s))
        ripple = self._once[0] * math.cos(turn) + self._once[1] * math.sin(turn)
        ripple += self._twice[0] * math.cos(2.0 * turn) + self._twice[1] * math.sin(2.0 * turn)
        return super().rate_dps(now_s) * (1.0 + 1e-6 * ripple)

    def total_angle_deg(self, now_s: float) -> float:
        """Return the axis angle, turns counted."""
        return float(self._rippled(np.array([super().total_angle_deg(now_s)]))[0])

    def total_angles_deg(self, times_s: Array) -> Array:
        """Return the axis angle at ascending times (see `TableAxis`)."""
        return self._rippled(super().total_angles_deg(times_s))

    def _rippled(self, angle_deg: Array) -> Array:
        """Return the angles with the integral of the rate's ripple over the angle."""
        turn = np.radians(angle_deg)
        swing = self._once[0] * np.sin(turn) + self._once[1] * (1.0 - np.cos(turn))
        swing += 0.5 * (self._twice[0] * np.sin(2.0 * turn) + self._twice[1] * (1.0 - np.cos(2.0 * turn)))
        return np.asarray(angle_deg + math.degrees(1e-6) * swing)
