"""What a test will resolve: against closed forms, and against units that another simulation has tested."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import gyrobench
from bench.analysis.common.allan import allan_deviation
from bench.analysis.common.allan_noise import NoiseCoefficients
from bench.analysis.common.bench_errors import BenchErrors
from bench.analysis.common.drawn_noise import noise_samples
from bench.analysis.figures import Foretold
from bench.analysis.figures._foretold import foretell
from bench.control.procedure import Procedure, find_procedure
from bench.present.cli._app import app
from bench.record.events.run import Interval
from bench.record.figure_limits import Limit
from benchmarks.metrology import BENCH, GRADES, LATITUDE_DEG, certificate, measured
from drivers.base.errors import ConfigurationError
from procedures._by_noise import AtRest
from procedures._standard_plan import Plan, StandardTestParameters

DEMO = "examples/demo.toml"
EXACT = BenchErrors([certificate(row.quantity, 1e-12, "normal") for row in BENCH])


@pytest.mark.parametrize(
    ("coefficients", "tau_s", "deviation"),
    [
        ((1e-5, 0.0, 0.0, 0.0, 0.0), (4.0, 64.0), lambda h: math.sqrt(3.0) * 1e-5 / h),
        ((0.0, 0.02, 0.0, 0.0, 0.0), (4.0, 64.0), lambda h: 0.02 / math.sqrt(h)),
        ((0.0, 0.0, 0.3, 0.0, 0.0), (64.0, 512.0), lambda h: 0.3 * math.sqrt(2.0 * math.log(2.0) / math.pi)),
        ((0.0, 0.0, 0.0, 0.5, 0.0), (64.0, 512.0), lambda h: 0.5 * math.sqrt(h / 3.0)),
        ((0.0, 0.0, 0.0, 0.0, 0.7), (64.0, 512.0), lambda h: 0.7 * h / math.sqrt(2.0)),
    ],
)
def test_drawn_noise_has_the_allan_deviation_of_its_coefficient(coefficients, tau_s, deviation):
    """IEEE Std 952, annex C: one term at a time, at 2 Hz."""
    squares = []
    for seed in range(8):
        allan = allan_deviation(noise_samples(NoiseCoefficients(*coefficients), 1 << 16, 2.0, seed), 2.0)
        squares.append(np.interp(tau_s, allan.tau_s, allan.deviation) ** 2)
    expected = [deviation(tau / 3600.0) for tau in tau_s]
    assert np.sqrt(np.mean(squares, axis=0)) == pytest.approx(expected, rel=0.06)


def test_drawn_noise_differs_by_seed_and_is_the_same_for_the_same():
    noise = NoiseCoefficients(1e-5, 0.01, 0.1, 0.1, 0.0)
    first = noise_samples(noise, 1000, 1.0, 1)
    assert np.array_equal(first, noise_samples(noise, 1000, 1.0, 1))
    assert abs(np.corrcoef(first, noise_samples(noise, 1000, 1.0, 2))[0, 1]) < 0.2


def test_of_white_noise_it_is_what_the_formulas_say():
    """A bias of 2 h: 1.96 N / sqrt(2); a slope over +-10 deg/s; an input shown by three dwells."""
    n, hour = 0.01, 3600.0

    def intervals(at_rest_dph):
        assert len(at_rest_dph) in (0, 6 * 3600)
        rows = [Interval("noise", 0.0, 6 * hour), Interval("bias", 6 * hour, 8 * hour, cycle=0)]
        rows += [
            Interval("misalignment", (8 + k) * hour, (9 + k) * hour, rate_dps=rate, roll_deg=roll)
            for k, (rate, roll) in enumerate(((10.0, 0.0), (-10.0, 0.0), (10.0, 180.0), (-10.0, 180.0)))
        ]
        for step, size in enumerate((0.01, 0.08)):
            rows += [
                Interval("threshold", (12 + 3 * step + k) * hour, (13 + 3 * step + k) * hour, step=step,
                         input_dph=-size * (k == 1))
                for k in range(3)
            ]  # fmt: skip
        return rows

    outlook = foretell(intervals, NoiseCoefficients(0.0, n, 0.0, 0.0, 0.0), LATITUDE_DEG, EXACT)
    found = {each.name: each for each in outlook.figures}
    assert outlook.duration_s == 18 * hour
    assert found["bias"].resolves == pytest.approx(1.96 * n / math.sqrt(2.0), rel=0.1)
    slope = n / (10.0 * math.sqrt(2.0)) / 3600.0  # of two dwells at +-10 deg/s, an hour each
    raised = math.degrees((1.96 + 0.67) * slope)  # half of it, and the median size of what noise adds
    assert found["input-axis elevation, unit in its fixture"].resolves == pytest.approx(raised, rel=0.35)
    along = found["input-axis misalignment, component along the table"]
    assert (along.unit, along.resolves) == ("deg", pytest.approx(raised / math.sqrt(2.0), rel=0.35))
    # an error of sqrt(1.5) N: of 0.01 deg/h nothing is shown, of 0.08 all but always
    assert found["threshold"].resolves == pytest.approx(0.08, rel=1e-3)
    missing = {name: each.reason for name, each in found.items() if each.resolves is None}
    across = "input-axis misalignment, component across the table"
    assert set(missing) == {
        "warm-up time", "resolution", "scale factor", "temperature sensitivity", across,
    }  # fmt: skip
    assert "90 and 270 deg" in missing[across]
    assert "no interval of resolution" in missing["resolution"]
    assert "quantisation" not in found and found["resolution"].shown() == {
        "resolution": missing["resolution"]
    }
    assert along.shown() == {along.name: f"{along.text} deg"}


@pytest.mark.parametrize("grade", [GRADES[0], GRADES[1]], ids=["mems", "fog"])
def test_units_that_were_tested_resolve_what_was_foretold(grade):
    """The perfect units of `benchmarks.metrology`, whose noise and outputs are drawn by other code."""
    p = StandardTestParameters(grade=grade.name.lower())
    outlook = foretell(
        lambda rest: Plan.of(p).after({"unit": AtRest.of_means(rest)}).intervals(),
        grade.noise,
        LATITUDE_DEG,
        BenchErrors(BENCH),
    )
    tested = [measured(grade, seed, True)[0] for seed in range(25)]
    for each in outlook.figures:
        if each.name in ("bias", "input-axis elevation, unit in its fixture"):
            continue  # there the azimuth is by certificate, and the fixture has an error to be seen
        halves = [
            item.bound if item.bound is not None else 0.5 * (item.high - item.low)
            for item in (figures.get(each.name) for figures in tested)
            if item is not None and item.low is not None
        ]
        assert len(halves) > 12, each.name
        # a repeatability of two has one degree of freedom: its bounds scatter by half
        rel = 0.8 if each.name == "scale-factor repeatability" else 0.45
        assert each.resolves == pytest.approx(np.median(halves), rel=rel), each.name


def test_east_is_known_as_well_as_the_noise_lets_it_be():
    """(w + w - e - e) / 4 of four dwells of T: N / sqrt(T) / 2 over the Earth's horizontal rate."""
    n, dwell_s = 0.02, 900.0

    def intervals(at_rest_dph):
        rows = [Interval("axis_east", k * 910.0, k * 910.0 + dwell_s) for k in range(4)]
        return [*rows, Interval("noise", 4000.0, 26000.0), Interval("bias", 26000.0, 62000.0, cycle=0)]

    noise = NoiseCoefficients(0.0, n, 0.0, 0.0, 0.0)
    (bias,) = (f for f in foretell(intervals, noise, LATITUDE_DEG, EXACT).figures if f.name == "bias")
    # near east the bias hangs on the azimuth by the Earth's horizontal rate: that drops out
    of_east, own = 0.5 * n / math.sqrt(0.25), n / math.sqrt(10.0)
    assert bias.resolves == pytest.approx(1.96 * math.hypot(of_east, own), rel=0.1)


def test_a_procedure_without_intervals_and_a_unit_without_noise_are_refused():
    plain = find_procedure("known-state")
    with pytest.raises(ConfigurationError, match="cannot be foretold") as refused:
        gyrobench.foretell(plain, DEMO, {"angle_random_walk": 0.01})
    assert isinstance(plain, Procedure) and refused.value.where == "known-state"
    with pytest.raises(ConfigurationError, match="noise of the unit is not known"):
        gyrobench.foretell("standard-test", DEMO, {})
    with pytest.raises(ConfigurationError, match="no such coefficient") as refused:
        gyrobench.foretell("standard-test", DEMO, {"arw": 0.01})
    assert refused.value.found == "arw=0.01" and "angle_random_walk" in refused.value.expected
    for none in ("little", math.nan, math.inf):
        with pytest.raises(ConfigurationError, match="no number"):
            gyrobench.foretell("standard-test", DEMO, {"angle_random_walk": none})
    with pytest.raises(ConfigurationError, match="measures nothing"):
        gyrobench.foretell(replace(plain, intervals=lambda p, rest: []), DEMO, {"angle_random_walk": 0.01})
    words = ["foretell", "standard-test", "--bench", DEMO, "--noise", "rate_ramp=1", "--like", "runs/one"]
    refused = CliRunner().invoke(app, words)
    assert refused.exit_code == 2 and "not both" in refused.output


@pytest.mark.parametrize(
    ("low", "high", "tells"),
    [
        (None, 0.4, True), (None, 0.2, False), (-0.4, None, True), (-0.2, None, False),
        (-0.4, 0.4, True), (-0.2, 0.2, False), (9.6, 10.4, True), (9.8, 10.2, False), (-0.3, 0.3, True),
    ],
)  # fmt: skip
def test_a_limit_narrower_than_what_is_resolved_cannot_be_told(low, high, tells):
    assert Foretold("bias", "deg/h", 0.3).tells(Limit(unit="deg/h", low=low, high=high)) is tells
    assert not Foretold("bias", "deg/h", None, "why").tells(Limit(unit="deg/h", low=low, high=high))


def test_limits_that_cannot_be_told_are_marked(tmp_path):
    path = tmp_path / "limits.toml"
    path.write_text(
        '[limits."bias"]\nunit = "deg/h"\nlow = -5\nhigh = 5\n'
        '[limits."scale-factor nonlinearity"]\nunit = "ppm"\nhigh = 10\n'
        '[limits."my-test.error"]\nunit = "ppm"\nhigh = 10\n'
    )
    words = ["foretell", "standard-test", "--bench", DEMO, "--grade", "mems", "--limits", str(path)]
    words += ["--noise", "angle_random_walk=0.2", "--temperatures", "false"]
    said = json.loads(CliRunner().invoke(app, [*words, "--json"]).stdout.splitlines()[-1])
    assert {f["name"]: f["tells"] for f in said["figures"] if f["tells"] is not None} == {
        "bias": True, "scale-factor nonlinearity": False,
    }  # fmt: skip
    shown = CliRunner().invoke(app, words).output
    assert shown.count("cannot be told") == 1 and "my-test.error: no figure of this test" in shown


def test_the_command_says_what_the_function_does():
    words = ["foretell", "standard-test", "--bench", DEMO, "--grade", "mems", "--power-cycles", "1"]
    words += ["--noise", "angle_random_walk=0.2", "--noise", "bias_instability=4"]
    result = CliRunner().invoke(app, [*words, "--json"])
    assert result.exit_code == 0, result.output
    said = json.loads(result.stdout.splitlines()[-1])
    noise = {"angle_random_walk": 0.2, "bias_instability": 4.0}
    outlook = gyrobench.foretell("standard-test", DEMO, noise, grade="mems", power_cycles=1)
    assert said["duration_s"] == outlook.duration_s and said["noise"]["bias_instability_dph"] == 4.0
    assert said["figures"] == [
        {"name": f.name, "unit": f.unit, "resolves": f.resolves, "reason": f.reason, "tells": None}
        for f in outlook.figures
    ]
    shown = CliRunner().invoke(app, words).output
    assert "what it will resolve" in shown and "bias instability" in shown and "expected:" in shown
