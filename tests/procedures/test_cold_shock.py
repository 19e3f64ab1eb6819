"""The cold shock's arithmetic against closed forms: shock rate, equilibrium, the search for east."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.control.history import History
from bench.control.procedure import find_procedure
from bench.record.benchfile import BenchSection
from procedures._cold_shock import (
    ColdShockParameters,
    bias_steady,
    shock_rate_k_per_min,
    temperature_steady,
    verify_shock,
    wait_for_equilibrium,
)
from procedures.zero_bias_cold_shock import ZeroBiasParameters, find_east


@settings(max_examples=40, deadline=None)
@given(rate=st.floats(2.0, 29.0), span=st.floats(40.0, 90.0), soak_s=st.integers(120, 900))
def test_a_linear_ramp_has_its_own_rate(rate, span, soak_s):
    time_s = np.arange(0.0, 60.0 * span / rate + soak_s)
    air_c = 25.0 - np.minimum(rate / 60.0 * time_s, span)
    mean, steepest = shock_rate_k_per_min(time_s, air_c)
    assert mean == pytest.approx(rate, rel=1e-6)
    assert steepest == pytest.approx(min(rate, span), rel=1e-6)


@pytest.mark.parametrize("tau_s", [90.0, 180.0, 400.0])
def test_an_exponential_fall_has_the_rates_of_its_formula(tau_s):
    time_s = np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, int(12 * tau_s)))
    time_s -= time_s[0]
    air_c = -45.0 + 70.0 * np.exp(-time_s / tau_s)
    mean, steepest = shock_rate_k_per_min(time_s, air_c)
    # 10 % is fallen at tau ln(1/0.9), 90 % at tau ln(10): between them 0.8 of the span in tau ln 9.
    assert mean == pytest.approx(60.0 * 0.8 * 70.0 / (tau_s * math.log(9.0)), rel=0.01)
    assert steepest == pytest.approx(70.0 * (1.0 - math.exp(-60.0 / tau_s)), rel=0.01)


def test_no_fall_has_no_rate():
    time_s = np.arange(100.0)
    assert shock_rate_k_per_min(time_s, np.full(100, 20.0)) == (0.0, 0.0)
    assert shock_rate_k_per_min(time_s, 20.0 + time_s) == (0.0, 0.0)


class Record:
    """What a procedure needs of a bench to measure."""

    def __init__(self, air):
        self.chamber = SimpleNamespace(history=air)
        self.rows, self.reasons = {}, []

    def measure(self, name, value, unit, *, low=None, high=None, gyro=None, basis=None):
        self.rows[name] = value
        return (low is None or value >= low) and (high is None or value <= high)

    def invalidate(self, text, code, **facts):
        self.reasons.append(text)


@pytest.mark.parametrize(
    ("rate", "bottom", "arrived", "reasons"),
    [
        (12.0, -45.0, True, []),
        (
            9.5,
            -45.0,
            True,
            ["shock rate 9.50 K/min between 10 and 90 % (steepest 60 s 9.50 K/min), required 10 K/min"],
        ),
        (12.0, -38.0, False, ["air reached -38.0 degC, asked for -45 and required -40 degC"]),
        (12.0, -42.0, False, ["air reached -42.0 degC, asked for -45 and required -40 degC"]),
    ],
)
def test_a_shock_that_misses_its_criterion_is_invalid_with_the_figure(rate, bottom, arrived, reasons):
    air = History(("air_temp_c",))
    for second in range(100, 1400):
        air.append(second, max(bottom, 25.0 - rate / 60.0 * max(0, second - 200)))
    bench = Record(air)
    verify_shock(bench, 150.0, ColdShockParameters(), arrived)
    assert bench.reasons == reasons
    assert bench.rows["shock_rate_10_90"] == pytest.approx(rate, rel=1e-6)
    assert bench.rows["shock_lowest_air"] == bottom


def gyro_with(seconds, rate_dps, temp_c):
    """A station whose history has a row of 100 samples a second."""
    history = History(("samples", "rate_dps", "temp_c"))
    for k in range(seconds):
        history.append(k + 1.0, 100, rate_dps(k), temp_c(k))
    return SimpleNamespace(update=lambda: history)


@pytest.mark.parametrize(
    ("drift_k_per_10min", "seconds", "steady"),
    [
        (0.0, 2000, True),
        (0.09, 2000, True),
        (-0.09, 2000, True),
        (0.12, 2000, False),
        (-0.12, 2000, False),
        (0.0, 600, False),
    ],
)
def test_temperature_is_steady_when_it_drifts_less_than_the_limit(drift_k_per_10min, seconds, steady):
    gyro = gyro_with(seconds, lambda k: 0.0, lambda k: 30.0 + drift_k_per_10min * k / 600.0)
    assert temperature_steady(gyro, float(seconds), 0.1) is steady


def test_a_unit_that_sends_no_temperature_is_no_reason_to_wait_for_hours():
    assert temperature_steady(gyro_with(2000, lambda k: 0.0, lambda k: np.nan), 2000.0, 0.1)
    assert not temperature_steady(gyro_with(500, lambda k: 0.0, lambda k: np.nan), 500.0, 0.1)
    gone = gyro_with(2000, lambda k: 0.0, lambda k: 25.0 if k < 1000 else np.nan)
    assert not temperature_steady(gone, 2000.0, 0.1)


def test_bias_is_steady_for_white_noise_and_not_for_a_drift_or_a_short_record():
    noise = np.random.default_rng(3).normal(0.0, 0.2, (200, 1900))
    verdicts = [bias_steady(gyro_with(1900, lambda k, n=n: n[k], lambda k: 0.0), 1900.0) for n in noise]
    # Range of three means within 3 sqrt(2) standard errors: 3.0 sigma of any pair, 99.2 % of the time.
    assert np.mean(verdicts) > 0.95
    step = 0.2 / math.sqrt(600.0)  # standard error of a 10 min mean

    def drifting(k):
        return noise[0, k] + 8.0 * step * k / 600.0

    assert bias_steady(gyro_with(1900, drifting, lambda k: 0.0), 1900.0) is False
    assert bias_steady(gyro_with(1500, lambda k: noise[0, k], lambda k: 0.0), 1500.0) is False


def test_equilibrium_is_judged_by_whichever_gyro_is_judged_by_now():
    """The first one is silent from the beginning: an hour of the second one is enough."""
    silent = gyro_with(0, lambda k: 0.0, lambda k: 0.0)
    noise = np.random.default_rng(5).normal(0.0, 0.2, 3600)
    speaking = gyro_with(3600, lambda k: noise[k], lambda k: 30.0)
    judges, reasons = [silent, silent, speaking], []

    class Waiting:
        now_s = 3600.0
        phase = staticmethod(lambda name: None)
        invalidate = staticmethod(reasons.append)
        judge = property(lambda self: judges.pop(0))

        def wait_until(self, reached, **_):
            return any(reached() for _ in range(3))

    wait_for_equilibrium(Waiting(), ColdShockParameters(), phase="equilibrium")
    assert judges == [] and reasons == []


class EarthBench:
    """A table on the Earth: the axis at azimuth (table angle + error) sees the Earth rate's horizontal part."""

    def __init__(self, latitude_deg, error_deg, bias_dph, drift_dph_per_s):
        self.file = SimpleNamespace(bench=BenchSection(name="b", latitude_deg=latitude_deg))
        self.table = self.judge = self
        self.name = "fog_1"
        self.now_s, self.angle = 0.0, 0.0
        self.turned = {}
        self.error_deg, self.bias, self.drift = error_deg, bias_dph, drift_dph_per_s
        self.pointed, self.rows, self.reasons, self.notes = [], {}, [], []
        self.noise_dph, self.random = 0.0, np.random.default_rng(4)

    def phase(self, name):
        assert name == "axis_east"

    def point(self, angle_deg):
        self.angle = angle_deg
        self.pointed.append(angle_deg)

    def wait(self, duration_s, doing):
        self.turned[self.now_s, self.now_s + duration_s] = self.angle
        self.now_s += duration_s

    def output_dph(self, time_s, angle_deg=None):
        north_dph = math.degrees(7.292115e-5) * 3600.0 * math.cos(math.radians(self.file.bench.latitude_deg))
        azimuth = math.radians((self.angle if angle_deg is None else angle_deg) + self.error_deg)
        return self.bias + self.drift * time_s + north_dph * math.cos(azimuth)

    def mean_rate_dps(self, start_s, end_s):
        middle = 0.5 * (start_s + end_s)
        angle = next(angle for (first, last), angle in self.turned.items() if first <= middle <= last)
        noise = (
            self.random.normal(0.0, self.noise_dph / math.sqrt(end_s - start_s)) if self.noise_dph else 0.0
        )
        return (self.output_dph(middle, angle) + noise) / 3600.0

    def note(self, text):
        self.notes.append(text)

    measure = Record.measure
    invalidate = Record.invalidate


@settings(max_examples=60, deadline=None)
@given(
    latitude=st.floats(-65.0, 65.0),
    error=st.floats(-1.9, 1.9),
    bias=st.floats(-20.0, 20.0),
    drift=st.floats(-1e-3, 1e-3),
    azimuth=st.sampled_from([90.0, 89.3, 91.0]),
)
def test_east_is_found_whatever_bias_and_drift(latitude, error, bias, drift, azimuth):
    bench = EarthBench(latitude, error, bias, drift)
    true_error = azimuth + error - 90.0
    find_east(bench, ZeroBiasParameters(azimuth_deg=azimuth, east_tolerance_deg=5.0))
    assert bench.rows["azimuth_error"] == pytest.approx(true_error, abs=1e-4)
    bench.drift = 0.0
    assert bench.output_dph(0.0) == pytest.approx(bias, abs=1e-4)
    assert bench.pointed[:4] == [azimuth, azimuth + 180.0, azimuth + 180.0, azimuth]
    assert bench.reasons == []


@pytest.mark.parametrize("error", [2.5, -2.5])
def test_a_mounting_beyond_tolerance_makes_the_run_invalid_with_the_angle(error):
    bench = EarthBench(39.1, error, 1.0, 0.0)
    find_east(bench, ZeroBiasParameters())
    assert bench.reasons == [f"the axis is {error:+.2f} deg off east, accepted are 2 deg: mount it again"]


def test_a_gyro_too_noisy_to_tell_east_turns_no_table_and_blames_no_mounting():
    bench = EarthBench(39.1, 0.5, 1.0, 0.0)
    bench.noise_dph = 40.0  # deg/h of one second: 0.67 deg/sqrt(h)
    find_east(bench, ZeroBiasParameters())
    # Two standard deviations of (two west - two east) / 4, means of 480 s, over the horizontal Earth rate.
    expected = math.degrees(2.0 * 40.0 / math.sqrt(480.0) / 2.0 / (15.041067 * math.cos(math.radians(39.1))))
    assert bench.rows["azimuth_error_2_sigma"] == pytest.approx(expected, rel=0.5)
    assert bench.reasons == [] and bench.pointed[-1] == 90.0
    assert bench.notes[0].startswith("fog_1 cannot tell east") and "east_dwell_s = " in bench.notes[0]


def test_the_doubt_of_east_is_that_of_many_repetitions():
    found, doubts = [], []
    for seed in range(200):
        bench = EarthBench(39.1, 0.5, 1.0, 1e-4)
        bench.noise_dph, bench.random = 4.0, np.random.default_rng(seed)
        find_east(bench, ZeroBiasParameters())
        found.append(bench.rows["azimuth_error"])
        doubts.append(bench.rows["azimuth_error_2_sigma"])
    assert np.sqrt(np.mean(np.square(doubts))) == pytest.approx(2.0 * np.std(found), rel=0.2)


def test_without_an_output_east_stays_where_it_was_said_to_be_and_the_run_is_invalid():
    bench = EarthBench(39.1, 0.0, math.nan, 0.0)
    find_east(bench, ZeroBiasParameters(azimuth_deg=91.0))
    assert bench.pointed[-1] == 91.0
    assert bench.reasons == ["east was not found: fog_1 had no valid output at one of the four positions"]


@pytest.mark.parametrize("name", ["zero-bias-cold-shock", "scale-factor-cold-shock"])
def test_a_procedure_says_the_extremes_of_what_it_will_demand(name):
    procedure = find_procedure(name)
    values = {"cold_c": -50, "room_c": 22, "ramp_k_per_min": 14}
    if name.startswith("scale"):
        values["rate_dps"] = 17
    demands = procedure.demands(procedure.parse(values))
    assert (demands.min_temp_c, demands.max_temp_c, demands.max_ramp_k_per_min) == (-50.0, 22.0, 14.0)
    assert demands.max_rate_dps == (17.0 if name.startswith("scale") else 0.0)
    assert procedure.source.startswith("CN115855016B")
