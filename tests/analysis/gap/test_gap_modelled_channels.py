"""A lab whose channels follow a model: tick by tick against the catalogue's formulas and against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import Model, Noise, model_text
from bench.analysis.gap._model_file import ChannelTerm
from bench.lab.emulated import lab_config, load_plant
from bench.record.benchfile import load_bench_file
from drivers.base.errors import ConfigurationError
from simulators.effects import (
    Channel,
    ChannelEffect,
    ChannelInputs,
    Demand,
    Parameter,
    Unit,
    catalogue,
    simulate,
)
from simulators.plant.chamber import ChamberParameters
from simulators.plant.lab_plant import LabPlant, PlantConfig, UnitConfig
from simulators.plant.modelled_unit import ModelledErrors
from simulators.plant.noise import NoiseParameters

QUIET = NoiseParameters(0.0, 0.0, 0.0)
EFFECTS = [each for each in catalogue().values() if isinstance(each, ChannelEffect)]
HEAT = {
    "air_to_case_conductance": (1.65,),
    "case_heat_capacity": (850.0,),
    "fixture_heat": (470.0, 0.7),
    "self_heating_power": (2.0,),
    "case_to_gyro_conductance": (0.25,),
    "gyro_heat_capacity": (105.0,),
    "gyro_core_heat": (35.0, 0.12),
}
CHAMBER = {
    "chamber_ramp": (8.0, 3.0, 6.0),
    "chamber_overshoot": (18.0, 260.0),
    "chamber_response": (20.0,),
    "chamber_offset": (0.4,),
}
SENSOR = {
    "temperature_sensor_offset": (0.7,),
    "temperature_sensor_gain": (3.0,),
    "temperature_sensor_lag": (40.0,),
}

PROFILE = ((0.0, 25.0), (600.0, -40.0), (4000.0, 25.0))


def _lab(channels: dict[str, tuple[float, ...]]) -> LabPlant:
    unit = UnitConfig("u", errors=ModelledErrors((), QUIET, channels=channels))
    return LabPlant(PlantConfig(units=(unit,), chamber=ChamberParameters(air_noise_k=0.0)))


def _shocked(channels: dict[str, tuple[float, ...]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Air, case and gyro temperature at every second of a shock asked for at 10 K/min."""
    lab = _lab(channels)
    for start, target in PROFILE:
        lab.advance(start)
        lab.chamber.demand(start, set_point_c=target, ramp_up=10.0, ramp_down=10.0, running=True)
    lab.advance(7000.0)
    truth = lab.true_drift("u")
    return lab.chamber.record()["air_temp_c"], truth["case_temp_c"], truth["sensor_temp_c"]


def test_every_channel_follows_the_catalogues_formula() -> None:
    values = HEAT | CHAMBER | SENSOR
    air, case, inside = _shocked(values)
    time_s = np.arange(float(len(air)))
    demands = tuple(
        Demand(start, target, 10.0 / 60.0) for start, target in ((0.0, 25.0), (600.0, -40.0), (4000.0, 25.0))
    )
    asked = ChannelInputs(time_s, np.full(len(air), 25.0), 25.0, 1.0, demands)
    assert air[10:] == pytest.approx(simulate("chamber_air", asked, values, EFFECTS)[10:], abs=0.25)
    around = ChannelInputs(time_s, air, 25.0, 1.0)
    assert case == pytest.approx(simulate("case_temperature", around, values, EFFECTS), abs=0.1)
    # sensor and reading begin apart by the sensor's own error
    seen = ChannelInputs(time_s, case, 25.0 + 0.7, 1.0)
    assert inside[10:] == pytest.approx(simulate("gyro_temperature", seen, values, EFFECTS)[10:], abs=0.1)


def test_a_chamber_ramps_as_fast_as_its_model_lets_it() -> None:
    air, _, _ = _shocked({"chamber_ramp": (6.0, 6.0, 4.0)})
    down = np.flatnonzero(air <= -39.999)[0] - 600.0
    up = np.flatnonzero(air[4000:] >= 24.999)[0]
    assert down == pytest.approx(65.0 / 6.0 * 60.0, abs=3.0)
    assert up == pytest.approx(65.0 / 4.0 * 60.0, abs=3.0)


def test_a_lab_without_terms_for_a_channel_keeps_its_own() -> None:
    for ours, theirs in zip(_shocked({}), _shocked({"table_rate_error": (5.0, 0.0)}), strict=True):
        assert np.array_equal(ours, theirs)


def test_a_table_misses_its_rate_and_ripples_as_its_model_says() -> None:
    lab = _lab(
        {
            "table_rate_error": (120.0, 0.4),
            "table_rate_ripple_once": (300.0, -200.0),
        }
    )
    table = lab.table
    table.servo(0.0, True)
    table.demand_rate(1.0, 6.0)
    times = np.arange(100.0, 160.0, 0.25)  # one turn
    rates = np.array([table.rate_dps(each) for each in times.tolist()])
    turn = np.radians([table.angle_deg(each) for each in times.tolist()])
    basis = np.stack((np.ones(len(turn)), np.cos(turn), np.sin(turn)), axis=1)
    mean, cosine, sine = np.linalg.lstsq(basis, rates, rcond=None)[0]
    assert mean == pytest.approx(6.0 * (1.0 + 120e-6) + 0.4e-3, abs=2e-6)
    assert (cosine / mean, sine / mean) == pytest.approx((300e-6, -200e-6), abs=2e-6)
    # the angle is the integral of the rate
    angles = table.total_angles_deg(times)
    slope = np.gradient(angles, 0.25)[1:-1]
    assert slope == pytest.approx(rates[1:-1], abs=1e-5)


def test_a_table_stops_beside_its_angle_and_creeps() -> None:
    table = _lab({"table_position_offset": (9.0,), "table_position_creep": (36.0,)}).table
    table.servo(0.0, True)
    table.demand_angle(200.0, 90.0)
    off = 3600.0 * (table.angle_deg(1000.0) - 90.0)
    later = 3600.0 * (table.angle_deg(1000.0 + 1800.0) - 90.0)
    assert later - off == pytest.approx(18.0, abs=0.01)
    assert off == pytest.approx(9.0 + 36.0 * 790.0 / 3600.0, abs=0.2)


def _theirs(
    name: str, channel: Channel, apply: Callable[[ChannelInputs, np.ndarray, tuple[float, ...]], np.ndarray]
) -> ChannelEffect:
    return ChannelEffect(
        name, channel, (Parameter("size", -10.0, 10.0, Unit("K")),), (0.0,), "", "", "", apply
    )


def _draught(inputs: ChannelInputs, signal: np.ndarray, values: tuple[float, ...]) -> np.ndarray:
    """What the air was off its target a minute ago, in part."""
    off = np.concatenate((np.zeros(60), signal - inputs.drive))[: len(signal)]
    return signal + values[0] * off


def _stuck(inputs: ChannelInputs, signal: np.ndarray, values: tuple[float, ...]) -> np.ndarray:
    since = inputs.time_s - inputs.demands[-1].time_s
    return signal + values[0] * (since > 10.0)


THEIRS = {
    "acme_draught": _theirs("acme_draught", "chamber_air", _draught),
    "acme_case": _theirs(
        "acme_case", "case_temperature", lambda inputs, s, v: s + v[0] * (inputs.drive < 0.0)
    ),
    "acme_sensor": _theirs("acme_sensor", "gyro_temperature", lambda inputs, s, v: s + v[0] * inputs.drive),
    "acme_stuck": _theirs("acme_stuck", "table_angle", _stuck),
    "acme_belt": _theirs("acme_belt", "table_rate", lambda inputs, s, v: s + v[0]),
}


@pytest.fixture
def theirs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Effects of channels that another package brings."""
    known = catalogue() | THEIRS
    monkeypatch.setattr("simulators.plant.modelled_channels.catalogue", lambda: known)


def test_anothers_effects_change_air_and_readings_by_what_they_have_seen(theirs: None) -> None:
    plain, read = _shock(HEAT), _shock(HEAT | {"acme_case": (0.5,), "acme_sensor": (0.01,)})
    cold = plain["air_temp_c"] < 0.0
    assert 100 < cold.sum() < len(cold) - 100
    np.testing.assert_allclose(read["case_temp_c"], plain["case_temp_c"] + 0.5 * cold, atol=0.011)
    expected = plain["sensor_temp_c"] + 0.01 * read["case_temp_c"]
    np.testing.assert_allclose(read["sensor_temp_c"], expected, atol=0.011)
    at_once, late = (
        _shock(each)["air_temp_c"] for each in ({"chamber_offset": (0.0,)}, {"acme_draught": (0.2,)})
    )
    off = np.concatenate((np.zeros(61), at_once[1:] + 30.0))[: len(late)]
    np.testing.assert_allclose(late, at_once + 0.2 * off, atol=1e-9)


def _shock(channels: dict[str, tuple[float, ...]]) -> dict[str, np.ndarray]:
    lab = _lab(channels)
    lab.chamber.demand(0.0, set_point_c=-30.0, ramp_up=5.0, ramp_down=5.0, running=True)
    lab.advance(1500.0)
    return {**lab.true_drift("u"), **lab.chamber.record()}


def test_anothers_effect_of_the_table_changes_its_reading_while_it_is_held(theirs: None) -> None:
    lab = _lab({"acme_stuck": (7.2,)})
    lab.table.servo(0.0, True)
    lab.table.demand_angle(0.0, 90.0)
    lab.advance(100.0)
    assert lab.table.angle_deg(100.0) == pytest.approx(90.0 + 7.2 / 3600.0, abs=1e-9)


def test_anothers_effect_of_what_the_plant_cannot_change_is_refused_by_name(theirs: None) -> None:
    with pytest.raises(ConfigurationError, match="acme_belt"):
        _lab({"acme_belt": (1.0,)})


@pytest.mark.parametrize(
    ("channels", "message"),
    [
        ({"acme_draught": (1.0,)}, "acme_draught"),
        ({"air_to_case_conductance": (1.0,)}, "not complete"),
    ],
)
def test_what_a_lab_cannot_have_is_refused_by_name(
    channels: dict[str, tuple[float, ...]], message: str
) -> None:
    with pytest.raises(ConfigurationError, match=message):
        _lab(channels)


def test_two_models_cannot_want_two_chambers() -> None:
    units = tuple(
        UnitConfig(name, errors=ModelledErrors((), QUIET, channels={"chamber_offset": (offset,)}))
        for name, offset in (("a", 0.1), ("b", 0.2))
    )
    with pytest.raises(ConfigurationError, match="two different labs"):
        LabPlant(PlantConfig(units=units))


def test_an_imu_takes_no_model_and_says_so() -> None:
    with pytest.raises(ConfigurationError, match="single-axis"):
        LabPlant(PlantConfig(units=(UnitConfig("i", model="imu", errors=ModelledErrors((), QUIET)),)))


def test_a_model_file_brings_its_channels_into_the_lab(tmp_path: Path) -> None:
    skew, ramp = catalogue()["sample_clock_skew"], catalogue()["chamber_ramp"]
    assert isinstance(skew, ChannelEffect)
    assert isinstance(ramp, ChannelEffect)
    terms = (ChannelTerm(skew, (140.0,), (1.0,)), ChannelTerm(ramp, (8.0, 3.0, 6.0), (1.0, 1.0, 1.0)))
    model = Model("closed", (), Noise(0.004), channel_terms=terms)
    (tmp_path / "closed.toml").write_text(model_text(model), encoding="utf-8")
    file = load_bench_file(Path(__file__).parents[3] / "examples" / "demo.toml")
    gyro = file.gyro[0]
    (tmp_path / "plant.toml").write_text(f'[gap_model]\n{gyro.unit} = "closed.toml"\n', encoding="utf-8")
    told, *_ = lab_config(file, load_plant(tmp_path / "plant.toml")).gyros
    assert told.clock_error_ppm == 140.0
    errors = ModelledErrors.from_json(told.errors or {})
    assert errors.channels == {"sample_clock_skew": (140.0,), "chamber_ramp": (8.0, 3.0, 6.0)}
    assert math.isclose(sum(errors.channels["chamber_ramp"]), 17.0)
