"""A unit that is a model: causal effects against the catalogue's columns on its temperatures."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import Model, Noise, Term, model_text
from bench.lab.emulated import Plant, load_plant
from drivers.base.errors import ConfigurationError
from simulators.effects import Effect, Stimulus, Variant, catalogue
from simulators.plant.lab_plant import LabPlant, PlantConfig, UnitConfig, unit_model
from simulators.plant.modelled_unit import ModelledErrors, ModelledTerm, modelled
from simulators.plant.mounting import Mount
from simulators.plant.noise import NoiseParameters, NoiseSource
from simulators.plant.table import TableAxis, TableParameters
from simulators.plant.unit import GyroUnit

QUIET = NoiseParameters(0.0, 0.0, 0.0)


def _shocked(terms: tuple[ModelledTerm, ...]) -> dict[str, np.ndarray]:
    """Truth of a unit in 6000 s with a shock to -40 degC."""
    model = modelled(unit_model(UnitConfig("u")), ModelledErrors(terms, QUIET), (1,))
    unit = GyroUnit(model, Mount("axis_up"), TableAxis(TableParameters()), 39.1, NoiseSource(1, "unit u"))
    unit.start(25.0)
    for air in np.interp(np.arange(6000.0), [0, 1200, 1500, 3600, 3900], [25.0, 25.0, -40.0, -40.0, 25.0]):
        unit.tick(float(air))
    return dict(unit.truth())


def _column(name: str, shape: dict[str, float], truth: dict[str, np.ndarray]) -> np.ndarray:
    """Return the catalogue's columns, the first parameter 1, the others 0.5."""
    effect = catalogue()[name]
    assert isinstance(effect, Effect)
    n = len(truth["sensor_temp_c"])
    s = Stimulus(
        np.arange(1.0, n + 1.0),
        truth["sensor_temp_c"],
        truth["case_temp_c"],
        np.zeros(n + 1),
        np.full(n, 90.0),
        39.1,
    )
    weights = np.array([1.0, *[0.5] * (len(effect.parameters) - 1)])
    return np.asarray(weights @ Variant(effect, shape).columns(s))


OF_TEMPERATURE_OR_TIME = (
    "bias_linear",
    "bias_quadratic",
    "bias_cubic",
    "shupe",
    "shupe_cross",
    "cold_stress",
)
OF_TEMPERATURE_OR_TIME += (
    "gradient",
    "thermal_lag",
    "relaxation",
    "hysteresis",
    "mode_hop",
    "warm_up",
    "bias_ramp",
)


@pytest.mark.parametrize("name", OF_TEMPERATURE_OR_TIME)
@pytest.mark.parametrize("also", [{}, {"loop_k": 4.0, "lag_s": 120.0}])
def test_a_causal_effect_is_the_catalogues_column(name: str, also: dict[str, float]) -> None:
    effect = catalogue()[name]
    assert isinstance(effect, Effect)
    shape = dict(effect.shapes[-1])
    shape |= {key: value for key, value in also.items() if key in shape}
    values = (1.0, *[0.5] * (len(effect.parameters) - 1))
    truth = _shocked((ModelledTerm(name, values, shape),))
    expected = _column(name, shape, truth)
    expected, found = expected - expected.mean(), truth["bias_dph"] - truth["bias_dph"].mean()
    assert np.std(found) > 0.0
    assert np.std(found - expected) < 0.08 * np.std(expected)


def test_scale_factor_follows_temperature() -> None:
    truth = _shocked(
        (ModelledTerm("scale_factor_temperature", (2.0,), {}), ModelledTerm("scale_factor", (5.0,), {}))
    )
    assert truth["sf_error_ppm"] == pytest.approx(5.0 + 2.0 * (truth["sensor_temp_c"] - 25.0), abs=0.2)


def test_an_effect_without_a_causal_form_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="time_offset"):
        _shocked((ModelledTerm("time_offset", (1.0,), {"side": 0.0}),))


def test_a_plant_file_names_a_units_model(tmp_path: Path) -> None:
    shupe = catalogue()["shupe"]
    assert isinstance(shupe, Effect)
    term = Term(Variant(shupe, {"lag_s": 180.0}), (0.125, -0.25), (0.01, 0.01))
    (tmp_path / "closed.toml").write_text(
        model_text(Model("closed", (term,), Noise(0.004))), encoding="utf-8"
    )
    (tmp_path / "plant.toml").write_text('[gap_model]\nU1 = "closed.toml"\n', encoding="utf-8")
    errors = load_plant(tmp_path / "plant.toml").errors_of("U1")
    assert errors is not None
    assert errors["terms"] == [{"effect": "shupe", "values": [0.125, -0.25], "shape": {"lag_s": 180.0}}]
    assert Plant().errors_of("U1") is None
    restored = ModelledErrors.from_json(errors)
    assert asdict(restored.noise) == {
        "arw_deg_per_sqrt_h": 0.004,
        "bias_instability_dph": 0.0,
        "quantum_arcsec": 0.0,
    }
    plant = LabPlant(PlantConfig(units=(UnitConfig("U1", errors=restored),)))
    plant.advance(10.0)
    assert plant.true_drift("U1")["bias_dph"] == pytest.approx(np.zeros(11), abs=0.05)


def _measured(
    term: ModelledTerm, rate_dps: float, *, level: bool = False, seconds: int = 240, period_s: float = 1.0
) -> np.ndarray:
    """Return what a noiseless unit at 25 degC measures, deg/h, after 20 s of turning from 0."""
    model = modelled(unit_model(UnitConfig("u")), ModelledErrors((term,), QUIET), (1,))
    table = TableAxis(TableParameters())
    mount = Mount("axis_horizontal" if level else "axis_up")
    unit = GyroUnit(model, mount, table, 39.1, NoiseSource(1, "unit u"))
    unit.start(25.0)
    table.servo(0.0, True)
    table.demand_rate(0.0, rate_dps)
    for _ in range(seconds + 21):
        unit.tick(25.0)
    count = round(seconds / period_s)
    # in pieces of unequal length: the bits must not depend on it
    cut = count // 3
    parts = [unit.measure(20.0, cut, period_s), unit.measure(20.0 + cut * period_s, count - cut, period_s)]
    whole = np.concatenate([part.angle_increment_rad[:, 0] for part in parts])
    return np.degrees(whole) * 3600.0 / period_s


EARTH_UP, EARTH_NORTH = 9.4860, 11.6726


@pytest.mark.parametrize(
    ("name", "values", "shape", "rate_dps", "expected"),
    [
        ("saturation", (1.0,), {"limit_dps": 71.0}, 90.0, 71.0 * 3600.0),
        ("saturation", (1.0,), {"limit_dps": 71.0}, -60.0, -60.0 * 3600.0 + EARTH_UP),
        ("dead_zone", (1.0,), {"band_dph": 12.0}, 0.0, 0.0),
        ("dead_zone", (1.0,), {"band_dph": 8.0}, 0.0, EARTH_UP),
        ("lock_in", (1.0,), {"lock_dph": 80.0}, 0.03, math.sqrt((108.0 + EARTH_UP) ** 2 - 80.0**2)),
        ("vibration_rectification", (3.0,), {}, 50.0, 180000.0 + EARTH_UP + 0.75),
        ("acceleration_sensitivity", (0.5, 0.0), {}, 0.0, EARTH_UP + 0.5),
    ],
)
def test_a_plant_answers_a_rate_as_its_model_says(
    name: str, values: tuple[float, ...], shape: dict[str, float], rate_dps: float, expected: float
) -> None:
    found = _measured(ModelledTerm(name, values, shape), rate_dps)
    assert found[100:].mean() == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize(
    ("name", "values", "at_0_deg"),
    [
        # about east, an axis to the north rises: sin 1 deg of the vertical Earth rate
        ("table_tilt", (0.0, 1.0), EARTH_NORTH + EARTH_UP * math.radians(1.0)),
        ("heading_sensitivity", (0.3, 0.7, 0.4, 0.2), EARTH_NORTH + 0.3 + 0.2),
        ("axis_misalignment", (1.0, 0.0), EARTH_NORTH + EARTH_UP * math.radians(1.0)),
    ],
)
def test_a_plant_at_rest_leans_as_its_model_says(
    name: str, values: tuple[float, ...], at_0_deg: float
) -> None:
    found = _measured(ModelledTerm(name, values, {}), 0.0, level=True)
    assert found == pytest.approx(np.full(len(found), at_0_deg), abs=2e-3)


def test_a_plants_line_has_its_amplitude_and_frequency() -> None:
    found = _measured(ModelledTerm("vibration_or_mains_line", (5.0, 0.35), {}), 0.0, period_s=0.1)
    size = np.abs(np.fft.rfft(found - found.mean())) / (0.5 * len(found))
    assert np.argmax(size) == round(0.35 * 240)
    # the mean over 0.1 s takes sin(x) / x of it
    assert size.max() == pytest.approx(5.0 * np.sinc(0.35 * 0.1), rel=1e-3)


def test_a_plants_impulses_have_their_rate_and_size() -> None:
    term = ModelledTerm("impulses", (180.0, 4.0), {})
    found = _measured(term, 0.0, seconds=7200, period_s=0.5)
    angle = (found - EARTH_UP) * 0.5
    hits = np.abs(angle) > 1.0
    assert np.abs(angle[hits]) == pytest.approx(np.full(hits.sum(), 4.0), abs=0.01)
    assert 280 < hits.sum() < 440  # Poisson about 360
    assert 0.4 < (angle[hits] > 0.0).mean() < 0.6


def test_a_parameter_that_the_runs_do_not_bound_is_said_so() -> None:
    shupe = catalogue()["shupe"]
    assert isinstance(shupe, Effect)
    width = shupe.parameters[1].high - shupe.parameters[1].low
    term = Term(Variant(shupe, {}), (0.25, 0.0), (0.01, 2.0 * width))
    assert term.fitted(1.0, "+-") == (
        "bias_dph_per_k_per_min = 0.25 +- 0.01, gradient_dph_per_k_per_min not to be seen in these runs"
    )
    assert "not to be seen" not in term.fitted(3.0, "+-")  # a coarser gyro's bounds are wider
