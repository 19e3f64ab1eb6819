"""A unit that is a model: causal effects against the catalogue's columns on its temperatures."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from bench.emulated import Plant, load_plant
from bench.gap import Model, Noise, Term, model_text
from drivers.errors import ConfigurationError
from simulators.effects import Effect, Stimulus, Variant, catalogue
from simulators.plant.lab_plant import LabPlant, PlantConfig, UnitConfig, unit_model
from simulators.plant.modelled_unit import CAUSAL, ModelledErrors, ModelledTerm, modelled
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


BIAS = [name for name in CAUSAL if not name.startswith("scale_factor")]


@pytest.mark.parametrize("name", BIAS)
def test_a_causal_effect_is_the_catalogues_column(name: str) -> None:
    effect = catalogue()[name]
    assert isinstance(effect, Effect)
    shape = dict(effect.shapes[-1])
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
    with pytest.raises(ConfigurationError, match="table_wobble_once"):
        _shocked((ModelledTerm("table_wobble_once", (1.0, 1.0), {}),))


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
