"""Heat that is commanded, doors and radiation: against equations of balance integrated by scipy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bench.analysis.gap import read_model
from drivers.base.errors import ConfigurationError
from simulators.effects import ChannelEffect, ChannelInputs, catalogue, simulate
from simulators.plant.modelled_channels import check_channels

CASE = {
    "air_to_case_conductance": (0.6,),
    "case_heat_capacity": (300.0,),
    "fixture_heat": (120.0, 0.4),
    "self_heating_power": (1.5,),
}
EFFECTS = [each for each in catalogue().values() if isinstance(each, ChannelEffect)]
STEP_S, COUNT = 10.0, 400
T = STEP_S * np.arange(COUNT)
AIR = 20.0 + 2.0 * np.sin(T / 900.0)
HEAT = np.where((T > 300.0) & (T < 1500.0), 18.0, 0.0)
DOOR = np.clip((T - 2000.0) / 100.0, 0.0, 1.0) * (T < 2600.0)


def balance(
    share: float = 1.0, mass: tuple[float, float] | None = None, opening: float = 0.0, area_m2: float = 0.0
) -> np.ndarray:
    """Temperature of the case by the balances of heat, inputs linear between samples, by Radau's method."""

    def at(values: np.ndarray) -> Callable[[float], float]:
        return lambda t: float(np.interp(t, T, values))

    air, heat, door = at(AIR), at(HEAT), at(DOOR)

    def rates(t: float, state: np.ndarray) -> list[float]:
        case, fixture, heater = state
        given = share * heat(t)
        into = given if mass is None else mass[1] * (heater - case)
        radiated = 5.670374419e-8 * area_m2 * ((air(t) + 273.15) ** 4 - (case + 273.15) ** 4)
        flow = (0.6 + opening * door(t)) * (air(t) - case) + 0.4 * (fixture - case) + 1.5 + into + radiated
        warming = 0.0 if mass is None else (given - into) / mass[0]
        return [flow / 300.0, 0.4 * (case - fixture) / 120.0, warming]

    found = solve_ivp(
        rates, (0.0, T[-1]), [25.0] * 3, method="Radau", t_eval=T, rtol=1e-8, atol=1e-8, max_step=STEP_S
    )
    return np.asarray(found.y[0])


def simulated(**changes: tuple[float, ...]) -> np.ndarray:
    inputs = ChannelInputs(T, AIR, 25.0, STEP_S, heat_w=HEAT, door=DOOR)
    return simulate("case_temperature", inputs, CASE | changes, EFFECTS)


@pytest.mark.parametrize(
    ("changes", "expected", "within_k"),
    [
        ({}, {}, 1e-4),
        ({"heater_gain": (-20.0,)}, {"share": 0.8}, 1e-4),
        ({"heater_heat_capacity": (90.0, 1.2)}, {"mass": (90.0, 1.2)}, 1e-4),
        ({"opening_conductance": (8.0,)}, {"opening": 8.0}, 5e-3),
        ({"thermal_radiation": (0.02,)}, {"area_m2": 0.02}, 5e-3),
        (
            {
                "opening_conductance": (-0.5,),
                "heater_heat_capacity": (90.0, 1.2),
                "thermal_radiation": (0.02,),
            },
            {"opening": -0.5, "mass": (90.0, 1.2), "area_m2": 0.02},
            5e-3,
        ),
    ],
)
def test_a_heated_and_opened_case_follows_the_balance_of_heat(changes, expected, within_k):
    assert simulated(**changes) == pytest.approx(balance(**expected), abs=within_k)


def test_neutral_values_are_no_effect_and_without_a_heater_there_is_no_heat():
    neutral = {
        effect.name: effect.neutral
        for effect in EFFECTS
        if effect.channel == "case_temperature" and not effect.needed
    }
    without = {name: values for name, values in neutral.items() if name != "self_heating_power"}
    assert simulated(**without) == pytest.approx(simulated())
    bare = ChannelInputs(T, AIR, 25.0, STEP_S)
    given = CASE | {
        "heater_gain": (50.0,),
        "heater_heat_capacity": (90.0, 1.2),
        "opening_conductance": (8.0,),
    }
    assert simulate("case_temperature", bare, given, EFFECTS) == pytest.approx(
        simulate("case_temperature", bare, CASE, EFFECTS)
    )
    acts = [effect for effect in EFFECTS if effect.acts is not None]
    assert {effect.name for effect in acts} == {
        "heater_gain", "heater_heat_capacity", "opening_conductance", "thermal_radiation",
    }  # fmt: skip
    heated = ChannelInputs(T, AIR, 25.0, STEP_S, heat_w=HEAT, door=DOOR)
    assert all(effect.acts(heated) and not effect.acts(bare) for effect in acts)


def test_what_no_device_of_the_lab_does_is_refused_by_name_in_a_rehearsal(tmp_path: Path):
    file = tmp_path / "closed.toml"
    file.write_text(
        'format = 1\n[noise]\narw_deg_per_sqrt_h = 0.01\n[[effect]]\nname = "opening_conductance"\n'
        "parameters = { opening_w_per_k = 8.0 }\nsigma = { opening_w_per_k = 0.1 }\n"
    )
    values = {term.name: term.values for term in read_model(file).channel_terms}
    with pytest.raises(ConfigurationError, match="an emulated lab cannot have an effect") as refused:
        check_channels(CASE | values)
    assert refused.value.found == "opening_conductance"
