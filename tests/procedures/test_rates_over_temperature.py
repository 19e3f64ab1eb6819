"""Rates in turn over temperature: what the table and the chamber are told, and when."""

import contextlib
from types import SimpleNamespace

import numpy as np
import pytest

from bench.control.history import History
from drivers.base.errors import ConfigurationError
from procedures.rates_over_temperature import PROCEDURE


class Bench:
    """A bench whose air follows every ramp exactly, or stops at `stuck_c`; it writes down what it is told."""

    def __init__(self, stuck_c=-90.0):
        self.now_s, self.air, self.target, self.ramp, self.stuck_c = 0.0, 25.0, 25.0, 5.0, stuck_c
        self.told, self.invalid = [], []
        self.judge = SimpleNamespace(name="fog_1")
        self.table = SimpleNamespace(
            mounting_text="", engage=lambda: None, spin=self.spin, stop=lambda: self.spin(0.0)
        )
        self.history = History(("air_temp_c",))
        self.chamber = SimpleNamespace(
            history=self.history, go_to=self.go_to, start=lambda: self.wait(0.0), stop=lambda: None
        )

    def tell(self, what):
        self.told.append((self.now_s, what))

    def spin(self, rate_dps):
        self.tell(rate_dps)
        self.wait(5.0)

    def go_to(self, target, ramp=5.0):
        self.target, self.ramp = target, ramp
        self.tell(f"air {target:g}")

    def wait(self, duration_s, doing=""):
        most = self.ramp * duration_s / 60.0
        self.air = max(self.air + float(np.clip(self.target - self.air, -most, most)), self.stuck_c)
        self.now_s += duration_s
        self.history.append(self.now_s, self.air)

    def phase(self, name):
        self.tell(name)

    def ask(self, question, **act):
        assert act["mounting"] == "axis_up"
        self.wait(100.0)  # the unit is on while it is mounted: that counts as warming up

    def step(self, code, title):
        return contextlib.nullcontext()

    def invalidate(self, text, code, **facts):
        self.invalid.append(code)

    @property
    def rates(self):
        return [(at, what) for at, what in self.told if isinstance(what, float)]


def made(stuck_c=-90.0, **settings):
    bench, p = Bench(stuck_c), PROCEDURE.parse({"warm_up_min": 10.0, "dwell_min": 5.0, **settings})
    PROCEDURE.run(bench, p)
    return bench, p


def test_rates_follow_in_turn_through_both_ends_and_back():
    bench, p = made(max_rate_dps=30.0, rates_per_sign=2, ramp_k_per_min=5.0)
    rates = bench.rates
    turn = [0.0, 15.0, 30.0, 0.0, -15.0, -30.0]
    assert [rate for _, rate in rates[:-1]] == np.resize(turn, len(rates) - 1).tolist()
    assert rates[0][0] == pytest.approx(600.0) and rates[-1][1] == 0.0
    assert set(np.diff([at for at, _ in rates])) == {65.0}
    names = [what for _, what in bench.told if not isinstance(what, float)]
    assert names == [
        "warm_up", "air 25", "rates", "ramp_cold", "air -40", "dwell_cold", "ramp_hot", "air 60", "dwell_hot",
        "ramp_room", "air 25", "close",
    ]  # fmt: skip
    at = {what: at for at, what in bench.told}
    # 65 K and 100 K and 35 K at 5 K/min less the last kelvin, each to the end of a rate of 65 s
    for begin, end, most_s in (
        ("ramp_cold", "dwell_cold", 768.0),
        ("dwell_cold", "ramp_hot", 300.0),
        ("ramp_hot", "dwell_hot", 1188.0),
        ("dwell_hot", "ramp_room", 300.0),
        ("ramp_room", "close", 408.0),
    ):
        assert most_s <= at[end] - at[begin] < most_s + 65.0
    assert bench.now_s == pytest.approx(PROCEDURE.expected_duration_s(p), abs=200.0)
    assert bench.invalid == []


def test_at_room_temperature_alone_the_air_stays():
    bench, p = made(over_temperature=False, sequences=3)
    assert len(bench.rates) == 3 * 4 + 1
    assert not [what for _, what in bench.told if str(what).startswith("ramp")]
    assert bench.now_s == pytest.approx(PROCEDURE.expected_duration_s(p), abs=10.0)
    demands = PROCEDURE.demands(p)
    assert (demands.min_temp_c, demands.max_temp_c, demands.max_ramp_k_per_min) == (25.0, 25.0, 0.0)


def test_air_that_stalls_makes_the_run_invalid_once_and_the_rates_go_on():
    bench, _ = made(stuck_c=0.0, ramp_k_per_min=3.0)
    assert bench.invalid == ["ramp_stalled"]
    at = {what: at for at, what in bench.told}
    assert at["dwell_cold"] - at["ramp_cold"] == pytest.approx(2.0 * 60.0 * 65.0 / 3.0 + 3600.0, abs=66.0)


def test_limits_are_asked_for_what_the_run_does_and_ends_that_cross_are_refused():
    demands = PROCEDURE.demands(PROCEDURE.parse({"low_c": 30.0, "ramp_k_per_min": 7.0, "max_rate_dps": 50.0}))
    assert (demands.min_temp_c, demands.max_temp_c) == (25.0, 60.0)
    assert (demands.max_ramp_k_per_min, demands.max_rate_dps) == (7.0, 50.0)
    demands = PROCEDURE.demands(PROCEDURE.parse({"high_c": 10.0}))
    assert (demands.min_temp_c, demands.max_temp_c) == (-40.0, 25.0)
    with pytest.raises(ConfigurationError, match="low_c 60 degC must be below high_c 60 degC"):
        PROCEDURE.parse({"low_c": 60.0})
