"""What is missing as an FMU: run by FMPy, held against closed forms and the columns of the diagnosis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bench.analysis.gap import Model, Noise, Term, take_own, write_missing_fmu
from drivers.base.errors import ConfigurationError
from simulators.effects import Effect, Stimulus, Variant, catalogue, effect_named, learned_shape

fmpy = pytest.importorskip("fmpy", reason="an FMU needs the extra fmu, which is not installed here")
validation = pytest.importorskip("fmpy.validation", reason="an FMU needs the extra fmu")
pytest.importorskip("pythonfmu", reason="writing an FMU needs the extra fmu, which is not installed here")

SECONDS = 3000
TIME = np.arange(SECONDS + 1.0)
T_IN = 25.0 - 30.0 * np.sin(np.pi * TIME / SECONDS) ** 2
T_OUT = 25.0 - 34.0 * np.sin(np.pi * TIME / SECONDS + 0.05) ** 2
EARTH_UP_DPH, EARTH_NORTH_DPH = 15.041067 * np.sin(np.radians(48.0)), 15.041067 * np.cos(np.radians(48.0))


def term(name: str, *values: float, **shape: float) -> Term:
    effect = effect_named(name, shape)
    assert isinstance(effect, Effect)
    return Term(Variant(effect, dict(effect.shapes[0]) | shape), values, (1.0,) * len(values))


def model(*terms: Term) -> Model:
    return Model("closed", terms, Noise(0.02))


def written(tmp_path: Path, *terms: Term, nominal: Model | None = None) -> Path:
    file = tmp_path / "missing.fmu"
    write_missing_fmu(model(*terms), nominal or model(), [], file)
    assert validation.validate_fmu(str(file)) == []
    return file


def inputs_of(file: Path) -> list[str]:
    variables = fmpy.read_model_description(str(file)).modelVariables
    return [variable.name for variable in variables if variable.causality == "input"]


def run(file: Path, step_s: float = 1.0, start: dict[str, float] | None = None, **inputs: NDArray) -> NDArray:
    """Return `missing_dph` of the steps."""
    signals = np.zeros(len(TIME), dtype=[(name, np.float64) for name in ("time", *inputs)])
    for name, values in {"time": TIME, **inputs}.items():
        signals[name] = values
    made = fmpy.simulate_fmu(
        str(file), stop_time=float(SECONDS), output_interval=step_s, input=signals, start_values=start or {},
        output=["missing_dph"],
    )  # fmt: skip
    return np.asarray(made["missing_dph"][1:])


def test_temperature_rate_and_both_in_closed_form(tmp_path: Path) -> None:
    file = written(
        tmp_path,
        term("bias_linear", 40.0),
        term("scale_factor_temperature", 2.0),
        term("saturation", 1.0, limit_dps=15.0),
    )
    assert inputs_of(file) == ["rate_dps", "t_in_c"]
    rate_dps = 10.0 + 10.0 * TIME / SECONDS
    warm_k = (T_IN - 25.0)[:-1]
    expected = 0.8 * warm_k + 2e-6 * warm_k * 3600.0 * rate_dps[:-1]
    expected -= 3600.0 * np.maximum(rate_dps[:-1] - 15.0, 0.0)
    assert run(file, rate_dps=rate_dps, t_in_c=T_IN) == pytest.approx(
        expected, rel=1e-9, abs=0.05
    )  # a corner of 1e-6


def test_what_the_nominal_has_is_not_missing(tmp_path: Path) -> None:
    nominal = model(term("bias_linear", 15.0), term("warm_up", 3.0, time_constant_s=600.0))
    file = written(tmp_path, term("bias_linear", 40.0), nominal=nominal)
    expected = 0.5 * (T_IN - 25.0)[:-1] - 3.0 * np.exp(-TIME[:-1] / 600.0)
    assert run(file, t_in_c=T_IN) == pytest.approx(expected, rel=1e-9, abs=1e-9)


NODES_K = np.arange(-33.0, 3.0, 3.0)
MEMORY = {
    "shupe": term("shupe", 1.0, 0.5, lag_s=180.0),
    "hysteresis": term("hysteresis", 1.0, **dict(catalogue()["hysteresis"].shapes[1])),  # type: ignore[union-attr]
    "hop": term("mode_hop", 1.0, at_c=5.0, lag_s=60.0, width_k=2.5, loop_k=3.0, toward_case=0.8),
    "learned": term("learned: bias over T_in", *np.sqrt(np.arange(11.0)), **learned_shape(NODES_K)),
}


@pytest.mark.parametrize("name", MEMORY)
@pytest.mark.parametrize("step_s", [1.0, 0.5, 4.0])
def test_what_remembers_is_the_column_of_the_diagnosis(tmp_path: Path, name: str, step_s: float) -> None:
    """The diagnosis smooths over a minute about each second and an FMU knows the past only: within 8 % rms."""
    file = written(tmp_path, MEMORY[name])
    given = {
        key: value for key, value in {"t_in_c": T_IN, "t_out_c": T_OUT}.items() if key in inputs_of(file)
    }
    found = np.interp(
        TIME[1:], step_s * np.arange(1, 1 + round(SECONDS / step_s)), run(file, step_s, **given)
    )
    column = model(MEMORY[name]).predict(stimulus()) - stimulus().input_rate_dph
    found, column = found - found.mean(), column - column.mean()
    assert np.std(column) > 0.0
    assert np.std(found - column) < 0.08 * np.std(column)


def stimulus() -> Stimulus:
    return Stimulus(TIME[1:], T_IN[1:], T_OUT[1:], np.zeros(SECONDS + 1), np.full(SECONDS, 90.0), 48.0)


def test_noise_of_recorded_temperatures_is_smoothed_on_demand(tmp_path: Path) -> None:
    file = written(tmp_path, term("shupe", 1.0, 0.0, lag_s=0.0))
    noisy = T_IN + 0.01 * np.random.default_rng(5).standard_normal(len(T_IN))
    truth = np.gradient(T_IN, TIME / 60.0)[:-1]
    given = {"t_in_c": noisy, "t_out_c": T_OUT}
    plain, smooth = run(file, **given) - truth, run(file, start={"smoothing_s": 60.0}, **given) - truth
    assert np.std(plain) == pytest.approx(60.0 * 0.01 * np.sqrt(2.0), rel=0.1)
    assert np.std(smooth[100:]) < 0.1


def test_an_effect_of_angle_has_the_table_as_its_input(tmp_path: Path) -> None:
    """A level axis off its azimuth by a little: Earth's rate changes by its sine."""
    file = written(tmp_path, term("azimuth_error", 0.1))
    assert inputs_of(file) == ["table_rate_dps", "table_angle_deg", "elevation_deg"]
    level = {"elevation_deg": np.zeros(len(TIME)), "table_rate_dps": np.full(len(TIME), 2.0)}
    angle = 2.0 * (TIME + 0.5)
    found = run(file, start={"latitude_deg": 48.0}, table_angle_deg=angle, **level)
    expected = -EARTH_NORTH_DPH * np.radians(0.1) * np.sin(np.radians(angle[:-1]))
    assert np.abs(np.abs(found) - np.abs(expected)).max() < 1e-4 * EARTH_NORTH_DPH


OWN = """
import numpy as np
from simulators.effects import DPH, Effect, Input, Parameter

def kink(s, shape):
    return np.maximum(s.warm_k + 5.0, 0.0)

MINE = Effect("my_kink", (Parameter("kink_dph_per_k", -9.0, 9.0, DPH.per("K")),), kink, Input.T_IN, "T_in", "own",
              "Bias grows above 20 degC.")
"""


def test_an_effect_of_ones_own_file_goes_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("simulators.effects._catalogue._FROM_FILES", {})
    own = tmp_path / "mine.py"
    own.write_text(OWN, encoding="utf-8")
    take_own(own)
    file = written(tmp_path, term("my_kink", 2.0))
    own.unlink()
    monkeypatch.setattr("simulators.effects._catalogue._FROM_FILES", {})  # as in another process
    assert run(file, t_in_c=T_IN) == pytest.approx(2.0 * np.maximum(T_IN[:-1] - 20.0, 0.0), abs=1e-9)


def test_what_no_fmu_can_have_is_refused_in_words(tmp_path: Path) -> None:
    for terms, words in (
        ((), "nothing is missing"),
        ((term("time_offset", 1.0, side=0.0), term("clock_skew", 1.0)), "time_offset, clock_skew"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            write_missing_fmu(model(*terms), model(), [], tmp_path / "missing.fmu")
    assert list(tmp_path.iterdir()) == []
