"""The diagnosis end to end: on made-up runs, on cases of the exam, and what it must not say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import (
    Model,
    Term,
    closed_model,
    diagnose,
    model_text,
    parse_model,
    read_model,
)
from bench.analysis.gap._close import shrinkage
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._score import wilson
from drivers.base.errors import ConfigurationError
from tests.analysis.gap.conftest import effect, made_run, stimulus


def _runs(seed: int, extra: float, names: tuple[str, ...]) -> list[GapRun]:
    """Runs whose bias follows the cube of temperature; the noise is white."""
    rng = np.random.default_rng(seed)
    runs = []
    for name in names:
        s = stimulus(6000)
        runs.append(made_run(name, s, rng, extra * (s.warm_k / 50.0) ** 3))
    return runs


def test_cause_parameters_and_shrinkage(nominal: Model) -> None:
    found = diagnose(_runs(1, 0.4, ("a", "b", "c")), nominal)
    assert found.verdict == "explained"
    (cause,) = found.causes
    assert cause.name == "bias_cubic"
    (value,), (sigma,) = cause.term.values, cause.term.sigmas
    assert abs(value - 0.4) < max(4.0 * sigma, 0.03)
    closed = closed_model(found)
    shrunk = shrinkage(found.model, closed, _runs(2, 0.4, ("d", "e")), found.rate.floor)
    assert shrunk.share > 0.97
    assert shrunk.low < 1.0
    assert closed.fitted_on == {name: f"sum of {name}" for name in "abc"}
    with pytest.raises(ConfigurationError, match="cannot judge"):
        shrinkage(found.model, closed, _runs(1, 0.4, ("a",)), found.rate.floor)


def test_no_gap_where_there_is_none(nominal: Model) -> None:
    found = diagnose(_runs(3, 0.0, ("a", "b")), nominal)
    assert found.verdict == "no gap"
    assert not found.causes
    assert found.rate.null_probability > 0.5
    assert min(place.p_value for place in found.rate.places) > 0.01


def test_nothing_is_sure_even_where_nothing_is_left(nominal: Model) -> None:
    """Of 448 claims of the exams 25 left out something of which nothing had been seen: so much doubt remains."""
    low, high = wilson(25, 448)
    for seed, cubic in ((1, 0.4), (7, 0.8), (3, 0.0)):
        found = diagnose(_runs(seed, cubic, ("a", "b")), nominal)
        assert found.verdict == ("explained" if cubic else "no gap")
        assert low < found.rate.unknown_probability < high
        assert all(cause.probability < 1.0 - low for cause in found.causes)


def test_wrong_nominal_parameter_is_no_effect(nominal: Model) -> None:
    """A scale factor 15 ppm off, within its prior, is corrected and not called an effect."""
    rng = np.random.default_rng(4)
    runs = []
    for rate in ("+20", "-20"):
        for k in range(2):
            s = stimulus(4000, rate_dps=float(rate), cold=False)
            steps = s.angle_deg[0] + np.cumsum(np.repeat([0.0, *[float(rate)] * 3999, 0.0], 1)[:4001])
            s = type(s)(s.time_s, s.t_in_c, s.t_out_c, steps, s.elevation_deg, s.latitude_deg)
            runs.append(made_run(f"{rate} {k}", s, rng, 15e-6 * s.input_rate_dph, condition=rate))
    found = diagnose(runs, nominal)
    assert found.verdict == "no gap"
    scale = next(term for term in found.model.terms if term.name == "scale_factor")
    assert scale.values[0] == pytest.approx(15.0, abs=5.0 * scale.sigmas[0] + 1.0)


def test_one_run_is_diagnosed_with_a_warning(nominal: Model) -> None:
    found = diagnose(_runs(5, 0.6, ("a",)), nominal)
    assert "bias_cubic" in {cause.name for cause in found.causes}
    assert any("no repeated runs" in warning for warning in found.rate.warnings)


def test_constant_stimulus_is_said_to_show_nothing(nominal: Model) -> None:
    rng = np.random.default_rng(6)
    s = stimulus(3000, cold=False)
    # two sensors; equal readings would mean that there is one only
    runs = [made_run(name, replace(s, t_out_c=s.t_out_c + 0.2), rng) for name in "ab"]
    found = diagnose(runs, nominal)
    assert found.verdict == "nothing to identify"
    assert any("temperature hardly changes" in warning for warning in found.rate.warnings)
    assert {"shupe", "acceleration_sensitivity", "azimuth_error"} <= set(found.rate.unidentifiable)


def test_model_file_reads_back_exactly(nominal: Model, term: Term, tmp_path: Path) -> None:
    model = Model("nominal+shupe", (*nominal.terms, term), nominal.noise, {"run 1": "ab12"})
    path = tmp_path / "model.toml"
    path.write_text(model_text(model), encoding="utf-8")
    again = read_model(path)
    assert [(t.name, t.values, t.sigmas, dict(t.variant.shape)) for t in again.terms] == [
        (t.name, t.values, t.sigmas, dict(t.variant.shape)) for t in model.terms
    ]
    assert (again.noise, again.fitted_on, again.name) == (model.noise, model.fitted_on, model.name)
    s = stimulus(500)
    assert (again.predict(s) == model.predict(s)).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("format = 1", "format = 2"), "version"),
        (('"scale_factor"', '"scale_fctor"'), "catalogue lacks"),
        (("sf_ppm = 0.0", "sf_ppm = 1e9"), "out of bounds"),
        (("arw_deg_per_sqrt_h = 0.004", "arw_deg_per_sqrt_h = 0.0"), "noise"),
        (("[noise]", "[noise"), "not TOML"),
    ],
)
def test_mistakes_in_a_model_file_are_named(nominal: Model, change: tuple[str, str], message: str) -> None:
    text = model_text(nominal)
    assert change[0] in text
    with pytest.raises(ConfigurationError, match=message):
        parse_model(text.replace(*change), "a model")


def test_prediction_of_a_term_is_its_columns(nominal: Model, term: Term) -> None:
    s = stimulus(500)
    model = Model("m", (term,), nominal.noise)
    expected = s.input_rate_dph + term.values[0] * effect("shupe").columns(s, term.variant.shape)[0]
    expected = expected + term.values[1] * effect("shupe").columns(s, term.variant.shape)[1]
    assert model.predict(s) == pytest.approx(expected)


def test_a_clock_off_by_a_sample_is_aligned_and_reported(nominal: Model) -> None:
    """Steps of rate with the output one second late: aligned, named, and no effect is invented."""
    rng = np.random.default_rng(11)
    rates = np.repeat([0.0, 10.0, -10.0, 30.0, -30.0, 0.0] * 2, 300)
    angle = np.concatenate(([5.0], 5.0 + np.cumsum(rates)))
    runs = []
    for name in "ab":
        s = stimulus(len(rates), cold=False)
        s = replace(s, angle_deg=angle)
        run = made_run(name, s, rng)
        runs.append(replace(run, output_dph=np.concatenate((run.output_dph[:1], run.output_dph[:-1]))))
    found = diagnose(runs, nominal)
    assert found.verdict == "no gap"
    assert sum("1 s late" in warning for warning in found.rate.warnings) == 2


def test_an_effect_outside_the_catalogue_is_described_by_what_it_follows(nominal: Model) -> None:
    """A resonance at -10 degC, 4 K wide: no cause is named, the curve over T_in has its peak there."""
    rng = np.random.default_rng(12)
    runs = []
    for name in "abc":
        s = stimulus(8000)
        runs.append(made_run(name, s, rng, 1.0 * np.exp(-0.5 * ((s.warm_k + 35.0) / 4.0) ** 2)))
    found = diagnose(runs, nominal)
    assert found.verdict == "unknown"
    assert not found.causes
    (part,) = found.rate.unknown_parts
    assert part.follows == "T_in"
    assert part.at[int(np.argmax(np.abs(part.curve)))] == pytest.approx(-10.0, abs=5.0)


def _crossing_dph(warm_k: np.ndarray, at_k: float) -> np.ndarray:
    """The dispersion of a spurious mode that a gyro's own crosses at a temperature, 2.5 K wide."""
    x = (warm_k - at_k) / 2.5
    return np.asarray(0.4 * 2.0 * x / (1.0 + x**2))


@pytest.mark.parametrize("cubic_dph", [0.0, 0.6])
def test_modes_that_cross_are_no_step_of_the_bias(nominal: Model, cubic_dph: float) -> None:
    """The place is told to a kelvin, and what is known beside it is named."""
    rng = np.random.default_rng(17)
    runs = []
    for name in "abc":
        s = stimulus(8000)
        extra = _crossing_dph(s.warm_k, -22.0) + cubic_dph * (s.warm_k / 50.0) ** 3
        runs.append(made_run(name, s, rng, extra))
    found = diagnose(runs, nominal)
    assert [cause.name for cause in found.causes] == (["bias_cubic"] if cubic_dph else [])
    assert found.rate.unknown_probability > 0.9
    (part,) = found.rate.unknown_parts
    assert part.follows == "T_in"
    ends = [part.at[int(np.argmin(part.curve))], part.at[int(np.argmax(part.curve))]]
    assert ends == pytest.approx([3.0 - 2.5, 3.0 + 2.5], abs=1.0)


def test_a_slow_line_is_described_by_its_frequency(nominal: Model) -> None:
    """Slower than a minute it is no vibration and no mains: something is switched."""
    rng = np.random.default_rng(13)
    runs = []
    for name in "abc":
        s = stimulus(6000)
        runs.append(made_run(name, s, rng, 0.1 * np.sin(2.0 * np.pi * s.time_s / 65.0 + len(runs))))
    found = diagnose(runs, nominal)
    assert found.verdict == "unknown"
    (part,) = found.rate.unknown_parts
    assert part.frequency_hz == pytest.approx(1.0 / 65.0, rel=0.03)
    assert "not bound" in part.sentence


def test_a_straight_dependence_outside_the_catalogue_is_no_lag(nominal: Model) -> None:
    """Scale factor proportional to T_in - T_out, hardly above the noise: a straight curve costs one parameter."""
    rng = np.random.default_rng(22)
    runs = []
    for rate in (20.0, -20.0):
        for name in "ab":
            s = stimulus(8000, rate_dps=rate)
            extra = 0.02e-6 * s.input_rate_dph * s.gradient_k
            runs.append(made_run(f"{rate:+g} {name}", s, rng, extra, condition=f"{rate:+g}"))
    found = diagnose(runs, nominal)
    assert found.verdict == "unknown"
    (part,) = found.rate.unknown_parts
    assert part.follows == "T_in - T_out"
    assert part.unit == "ppm of rate"
    assert not found.causes
