"""Heat: a case in air, heated or opened, a gyro in its case, masses behind them, the gyro's thermometer."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.effects._channel import ChannelEffect, ChannelInputs, Values
from simulators.effects._effect import Parameter, Unit
from simulators.effects._heat_node import Body, Heater, node_temperature
from simulators.effects._stimulus import REFERENCE_C, follower, gain

_K, _S, _W, _J = Unit("K"), Unit("s"), Unit("W"), Unit("J")
_HEAT = "lumped heat balance of a body in air (Incropera, Fundamentals of Heat and Mass Transfer, ch. 5)"


def _masses(*factors: tuple[float, float]) -> Callable[[Values], tuple[tuple[float, ...], ...]]:
    """Return what makes a mass' J/K and W/K of the case's own, by factors."""

    def starts(values: Values) -> tuple[tuple[float, ...], ...]:
        (w_per_k,), (j_per_k,) = AIR_TO_CASE_CONDUCTANCE.of(values), CASE_HEAT_CAPACITY.of(values)
        return tuple((j * j_per_k, w * w_per_k) for j, w in factors)

    return starts


AIR_TO_CASE_CONDUCTANCE = ChannelEffect(
    "air_to_case_conductance",
    "case_temperature",
    (Parameter("conductance_w_per_k", 1e-3, 1e3, _W.per("K")),),
    (1.0,),
    "air less case temperature",
    _HEAT,
    "Heat passes between air and case better or worse: air speed, mounting, cover.",
    needed=True,
)
CASE_HEAT_CAPACITY = ChannelEffect(
    "case_heat_capacity",
    "case_temperature",
    (Parameter("case_j_per_k", 1.0, 1e6, _J.per("K")),),
    (1.0,),
    "rate of change of the air's temperature",
    _HEAT,
    "The case holds more or less heat.",
    needed=True,
    known=True,
)
FIXTURE_HEAT = ChannelEffect(
    "fixture_heat",
    "case_temperature",
    (
        Parameter("fixture_j_per_k", 1.0, 1e6, _J.per("K")),
        Parameter("fixture_w_per_k", 1e-4, 1e3, _W.per("K")),
    ),
    (1.0, 1.0),
    "rate of change of the case's temperature, late",
    _HEAT,
    "What the case is mounted on, or what is inside, takes up more or less heat.",
    needed=True,
    starts=_masses((1.0, 1.0), (0.3, 3.0), (3.0, 1.0)),
)
SELF_HEATING_POWER = ChannelEffect(
    "self_heating_power",
    "case_temperature",
    (Parameter("power_w", -1e3, 1e3, _W),),
    (0.0,),
    "nothing: constant rise over the air",
    _HEAT,
    "The unit turns more or less power into heat.",
)
HEATER_GAIN = ChannelEffect(
    "heater_gain",
    "case_temperature",
    (Parameter("gain_percent", -100.0, 1000.0, Unit("%")),),
    (0.0,),
    "heat commanded",
    "calibration of a heater: electrical power against the command",
    "The heater gives more or less heat than it is told to.",
    acts=lambda inputs: bool(inputs.heat_w.any()),
    emulated_by="nothing",
)
HEATER_HEAT_CAPACITY = ChannelEffect(
    "heater_heat_capacity",
    "case_temperature",
    (Parameter("heater_j_per_k", 0.0, 1e6, _J.per("K")), Parameter("heater_w_per_k", 1e-4, 1e3, _W.per("K"))),
    (0.0, 1.0),
    "heat commanded, late",
    _HEAT,
    "The heater has a mass of its own: its heat comes late, and goes on when it is switched off.",
    starts=_masses((0.05, 3.0), (0.3, 3.0), (1.0, 3.0), (1.0, 1.0)),
    acts=lambda inputs: bool(inputs.heat_w.any()),
    emulated_by="nothing",
)
OPENING_CONDUCTANCE = ChannelEffect(
    "opening_conductance",
    "case_temperature",
    (Parameter("opening_w_per_k", -1e3, 1e3, _W.per("K")),),
    (0.0,),
    "air less case temperature while a door, lid or flap is open",
    _HEAT,
    "More or less heat passes to the air while it is open, in proportion to the opening.",
    starts=lambda values: tuple((k * AIR_TO_CASE_CONDUCTANCE.of(values)[0],) for k in (1.0, 10.0)),
    acts=lambda inputs: bool(inputs.door.any()),
    emulated_by="nothing",
)
THERMAL_RADIATION = ChannelEffect(
    "thermal_radiation",
    "case_temperature",
    (Parameter("emissive_area_m2", 0.0, 100.0, Unit("m^2")),),
    (0.0,),
    "fourth powers of absolute temperatures of air and case",
    "Stefan-Boltzmann law (Incropera, ch. 1): emissivity times area, surroundings as warm as the air",
    "The case radiates: it loses more heat the hotter it is.",
    # without a heater the case is about as warm as the air: radiation is then no other than a conductance
    acts=lambda inputs: bool(inputs.heat_w.any()),
    emulated_by="nothing",
)
CASE_TO_GYRO_CONDUCTANCE = ChannelEffect(
    "case_to_gyro_conductance",
    "gyro_temperature",
    (Parameter("conductance_w_per_k", 1e-3, 1e3, _W.per("K")),),
    (1.0,),
    "case less gyro temperature",
    _HEAT,
    "Heat passes between case and gyro better or worse.",
    needed=True,
)
GYRO_HEAT_CAPACITY = ChannelEffect(
    "gyro_heat_capacity",
    "gyro_temperature",
    (Parameter("gyro_j_per_k", 1.0, 1e6, _J.per("K")),),
    (1.0,),
    "rate of change of the case's temperature",
    _HEAT,
    "The gyro holds more or less heat where its sensor is.",
    needed=True,
    known=True,
)
GYRO_CORE_HEAT = ChannelEffect(
    "gyro_core_heat",
    "gyro_temperature",
    (Parameter("core_j_per_k", 1.0, 1e6, _J.per("K")), Parameter("core_w_per_k", 1e-4, 1e3, _W.per("K"))),
    (1.0, 1.0),
    "rate of change of the gyro's temperature, late",
    _HEAT,
    "The gyro's core takes up more or less heat.",
    needed=True,
)
GYRO_HEATING_POWER = ChannelEffect(
    "gyro_heating_power",
    "gyro_temperature",
    (Parameter("power_w", -1e3, 1e3, _W),),
    (0.0,),
    "nothing: constant rise over the case",
    _HEAT,
    "The gyro turns more or less power into heat.",
)
TEMPERATURE_SENSOR_OFFSET = ChannelEffect(
    "temperature_sensor_offset",
    "gyro_temperature",
    (Parameter("offset_k", -20.0, 20.0, _K),),
    (0.0,),
    "nothing: constant",
    "sensor's data sheet, accuracy",
    "The gyro's temperature sensor reads too high or too low.",
)
TEMPERATURE_SENSOR_GAIN = ChannelEffect(
    "temperature_sensor_gain",
    "gyro_temperature",
    (Parameter("gain_percent", -50.0, 50.0, Unit("%")),),
    (0.0,),
    "temperature above 25 degC",
    "sensor's data sheet, gain",
    "The gyro's temperature sensor reads differences too large or too small.",
)
TEMPERATURE_SENSOR_LAG = ChannelEffect(
    "temperature_sensor_lag",
    "gyro_temperature",
    (Parameter("lag_s", 0.0, 3600.0, _S),),
    (0.0,),
    "rate of change of temperature",
    "sensor's data sheet, response time",
    "The gyro's temperature sensor follows late.",
    starts=((60.0,),),
)
CASE_HEAT = (AIR_TO_CASE_CONDUCTANCE, CASE_HEAT_CAPACITY, FIXTURE_HEAT, SELF_HEATING_POWER)
COMMANDED_HEAT = (HEATER_GAIN, HEATER_HEAT_CAPACITY, OPENING_CONDUCTANCE, THERMAL_RADIATION)
GYRO_HEAT = (CASE_TO_GYRO_CONDUCTANCE, GYRO_HEAT_CAPACITY, GYRO_CORE_HEAT, GYRO_HEATING_POWER)
TEMPERATURE_SENSOR = (TEMPERATURE_SENSOR_OFFSET, TEMPERATURE_SENSOR_GAIN, TEMPERATURE_SENSOR_LAG)


def case_temperature(inputs: ChannelInputs, values: Values) -> Array:
    """Temperature of the case in the recorded air, with the heat that it was given and its door open or shut."""
    (gain_percent,) = HEATER_GAIN.of(values)
    (opening_w_per_k,) = OPENING_CONDUCTANCE.of(values)
    (emissive_area_m2,) = THERMAL_RADIATION.of(values)
    mass = HEATER_HEAT_CAPACITY.of(values)
    heater = Heater(1.0 + 0.01 * gain_percent, mass[0], mass[1], opening_w_per_k, emissive_area_m2)
    return node_temperature(inputs, Body(*_body(CASE_HEAT, values)), inputs.start, heater)


def gyro_temperature(inputs: ChannelInputs, values: Values) -> Array:
    """What the gyro's sensor reads in the recorded case."""
    (offset_k,) = TEMPERATURE_SENSOR_OFFSET.of(values)
    (gain_percent,) = TEMPERATURE_SENSOR_GAIN.of(values)
    (lag_s,) = TEMPERATURE_SENSOR_LAG.of(values)
    start = (inputs.start - offset_k + 0.01 * gain_percent * REFERENCE_C) / (1.0 + 0.01 * gain_percent)
    inside = node_temperature(inputs, Body(*_body(GYRO_HEAT, values)), start)
    late = follower(inside, lag_s, inputs.period_s, start)
    return late + 0.01 * gain_percent * (late - REFERENCE_C) + offset_k


def _body(effects: Sequence[ChannelEffect], values: Values) -> tuple[float, ...]:
    """Return conductance, capacity, inner capacity, inner conductance and power of a body, W/K, J/K, W."""
    return tuple(value for effect in effects for value in effect.of(values))


def heat_of(effects: Sequence[ChannelEffect], values: Values) -> tuple[float, ...] | None:
    """Return a body's heat as `_body` does, None where the values say nothing of it.

    ConfigurationError where they say only a part of it.
    """
    needed = {effect.name for effect in effects if effect.needed}
    some = needed & set(values)
    if some and some != needed:
        raise ConfigurationError(
            "a model's heat is not complete",
            where="[gap_model]",
            found=", ".join(sorted(some)),
            expected=", ".join(sorted(needed)),
        )
    return _body(effects, values) if some else None


def reading_of(values: Values) -> tuple[float, float, float]:
    """Return what the gyro's sensor makes of a temperature: gain a second, 1 + part times it, offset in K."""
    (gain_percent,), (offset_k,) = TEMPERATURE_SENSOR_GAIN.of(values), TEMPERATURE_SENSOR_OFFSET.of(values)
    part = 0.01 * gain_percent
    return gain(*TEMPERATURE_SENSOR_LAG.of(values)), part, offset_k - part * REFERENCE_C
