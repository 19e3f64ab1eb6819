"""Which run makes parameters known best: against least squares by hand and against a diagnosis."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import designs_for, diagnose, foretell, parse_model, read_model
from bench.analysis.gap._columns import usual_variant
from bench.present.cli.gap import _foretell as command
from bench.record.benchfile import load_bench_file
from drivers.base.errors import ConfigurationError
from simulators.effects import catalogue

ROOT = Path(__file__).parents[3]
BENCH = ROOT / "examples" / "demo.toml"
ON_ITS_BENCH = ROOT / "examples" / "nominal" / "fog_on_its_bench.toml"
WHITE = """
format = 1
name = "white noise alone"
[noise]
arw_deg_per_sqrt_h = 0.01
bias_instability_dph = 0.0
[[effect]]
name = "scale_factor"
parameters = { sf_ppm = 0.0 }
sigma = { sf_ppm = 50.0 }
[[effect]]
name = "bias_linear"
parameters = { bias_dph_per_50k = 0.0 }
sigma = { bias_dph_per_50k = 0.5 }
"""
SIGMA_DPH = 0.6
"""Of a 1 s mean: 60 times the angle random walk."""
OF = ("scale_factor_temperature", "scale_factor_quadratic")
KEY = "scale_factor_temperature.sf_ppm_per_k"
QUADRATIC = "scale_factor_quadratic.sf_ppm_per_50k2"


@pytest.fixture(scope="module")
def designs():
    ramps = ("rates-over-temperature", "scale-factor-cold-shock")
    return [each for each in designs_for(load_bench_file(BENCH)) if each.procedure in ramps]


def by_hand(runs, model, names):
    """Sigmas by least squares with the nominal model's parameters and a mean of each run beside, white noise."""
    rows = []
    for run in runs:
        known = np.isfinite(run.output_dph)
        nominal = model.columns(run.stimulus) * np.array([s for t in model.terms for s in t.sigmas])[:, None]
        own = np.concatenate([usual_variant(catalogue()[name]).columns(run.stimulus) for name in names])
        columns = np.concatenate((own, nominal))[:, known]
        rows.append((columns - columns.mean(axis=1, keepdims=True)) / SIGMA_DPH)
    gram = sum(each @ each.T for each in rows)
    count = sum(len(catalogue()[name].parameters) for name in names)
    gram[range(count, len(gram)), range(count, len(gram))] += 1.0
    return np.sqrt(np.diag(np.linalg.inv(gram)))[:count]


def test_sigmas_are_those_of_least_squares(designs):
    model = parse_model(WHITE, "white")
    now, *after = foretell(model, OF, [], designs)
    assert now.design is None and list(now.sigmas.values()) == [500.0, 5e4]
    assert now.units[QUADRATIC] == "ppm/(50K)^2"
    for each in after:
        if "room temperature" in each.design.text:
            assert each.sigmas[QUADRATIC] > 100.0
            continue
        expected = by_hand(each.design.runs(), model, OF)
        assert list(each.sigmas.values()) == pytest.approx(expected, rel=0.1), each.design.text


def test_runs_come_by_the_hours_that_make_them_as_good_as_the_best(designs):
    _, *after = foretell(parse_model(WHITE, "white"), OF, [], designs)
    best = min(after, key=lambda each: each.hours / each.design.hours)
    assert best.hours == pytest.approx(best.design.hours, rel=1e-9)
    assert [each.hours for each in after] == sorted(each.hours for each in after)
    assert after[0].design.procedure == "rates-over-temperature" and after[0].hours < 0.7 * best.hours
    # one parameter alone: its variance times the hours
    _, *single = foretell(parse_model(WHITE, "white"), OF[:1], [], designs)
    sharpest = min(each.sigmas[KEY] for each in single)
    for each in single:
        assert each.hours == pytest.approx(each.design.hours * (each.sigmas[KEY] / sharpest) ** 2, rel=1e-6)


def test_what_a_run_is_foretold_to_give_a_diagnosis_of_it_gives(designs):
    """A ramp with rates of a unit whose scale factor bends; the run once more has half the variance."""
    model, effect = parse_model(WHITE, "white"), catalogue()["scale_factor_quadratic"]
    design = next(each for each in designs if "10 K/min" in each.text)
    (foretold,) = (each for each in foretell(model, OF[1:], [], [design]) if each.design)
    (bare,) = design.runs()
    noise = SIGMA_DPH * np.random.default_rng(4).standard_normal(len(bare.stimulus))
    bent = bare.stimulus.input_rate_dph + 300.0 * effect.variants()[0].columns(bare.stimulus)[0] + noise
    run = replace(bare, output_dph=np.where(np.isfinite(bare.output_dph), bent, np.nan))
    (cause,) = diagnose([run], model).rate.causes
    assert cause.name == "scale_factor_quadratic"
    (term,) = cause.terms
    (sigma,) = foretold.sigmas.values()
    assert term.values[0] == pytest.approx(300.0, abs=4.0 * sigma)
    _, again = foretell(model, OF[1:], [run], [design])
    assert again.sigmas[QUADRATIC] == pytest.approx(sigma / math.sqrt(2.0), rel=0.05)


def test_the_command_and_what_it_refuses(capsys):
    command.foretell("scale_factor_temperature", ON_ITS_BENCH, bench=BENCH, as_json=True)
    printed = json.loads(capsys.readouterr().out)
    assert printed["sigma"] == {KEY: 2.0} and printed["units"] == {KEY: "ppm/K"}
    assert printed["runs"][0]["sigma"][KEY] < 0.01 and printed["runs"][0]["settings"]
    command.foretell("scale_factor_temperature", ON_ITS_BENCH, bench=BENCH)
    assert "1 sigma of each parameter" in capsys.readouterr().out
    with pytest.raises(ConfigurationError, match="no such gyro"):
        command.foretell("scale_factor_temperature", ON_ITS_BENCH, bench=BENCH, gyro="fog_9")
    model = read_model(ON_ITS_BENCH)
    with pytest.raises(ConfigurationError, match=r"no such effect\. Found: sf_temp"):
        foretell(model, ["sf_temp"], [], [])
    with pytest.raises(ConfigurationError, match="no effect whose parameters"):
        foretell(model, [], [], [])
