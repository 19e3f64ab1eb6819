"""Small parts of the diagnosis against numbers worked out by hand: bridges, channels of a log, forms to learn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from bench.analysis.gap import Noise
from bench.analysis.gap._bridge import bridge
from bench.analysis.gap._cells import BANDS
from bench.analysis.gap._channel_data import ChannelSeries, _angle, _late_fraction, _rate, _stepped
from bench.analysis.gap._channel_run import RunSource
from bench.analysis.gap._close import _interval
from bench.analysis.gap._data import Group
from bench.analysis.gap._evidence import reduced
from bench.analysis.gap._fit import Floor
from bench.analysis.gap._learned_forms import candidates_for
from bench.analysis.gap._rehearsal import log_gaps
from bench.analysis.gap._rows import Steps
from bench.analysis.gap._stochastic import _starts
from bench.analysis.gap._where import REGIMES, phase_map
from bench.record.benchfile import load_bench_file
from bench.record.events.run import AngleDemand, RateDemand
from bench.record.recording import Arrivals
from bench.record.recording._events import Line
from simulators.effects import ChannelInputs
from tests.analysis.gap.conftest import made_run, stimulus
from tests.safety.test_takeover import DEMO

WALKING = Noise(0.01, 0.0, 0.5)


@pytest.mark.parametrize("gap", [(40, 41), (30, 38), (10, 35)])
def test_a_gap_is_filled_alike_forwards_and_backwards(gap: tuple[int, int]) -> None:
    """Neither white noise nor a random walk has a direction of time."""
    missing = np.zeros(60, np.bool_)
    missing[slice(*gap)] = True
    values = np.cumsum(np.random.default_rng(3).normal(size=60))
    forwards = bridge(missing, 1.0, WALKING).over(values[None])[0]
    backwards = bridge(missing[::-1].copy(), 1.0, WALKING).over(values[None, ::-1])[0]
    assert forwards == pytest.approx(backwards[::-1], abs=1e-9)


def test_a_sample_missing_between_two_levels_lies_half_way() -> None:
    missing = np.zeros(41, np.bool_)
    missing[20] = True
    values = np.where(np.arange(41) < 20, 0.0, 8.0)
    assert bridge(missing, 1.0, WALKING).over(values[None])[0, 20] == pytest.approx(4.0, abs=1e-9)


def test_a_gyro_is_as_coarse_as_the_worse_of_its_noise_and_its_drift() -> None:
    """In units of 0.02 deg/sqrt(h) and 0.1 deg/h, and never finer than one."""
    assert [Noise(0.001, 0.01).coarseness, Noise(0.02, 0.1).coarseness] == [1.0, 1.0]
    assert [Noise(0.04, 0.1).coarseness, Noise(0.01, 0.3).coarseness] == pytest.approx([2.0, 3.0])


def air(values: Sequence[float], phase: Sequence[str]) -> ChannelSeries:
    time_s = 10.0 * np.arange(len(values))
    inputs = ChannelInputs(time_s, np.zeros(len(values)), 0.0, 10.0)
    return ChannelSeries(
        "chamber_air",
        "run",
        inputs,
        np.asarray(values, np.float64),
        np.array(phase),
        np.ones(len(values), np.bool_),
        0.1,
    )


def test_the_gap_of_a_channel_is_that_of_its_means_over_100_s() -> None:
    """The run is 2 K above the nominal rehearsal, 1 K above the closed one, and this 0.5 K above its repeat."""
    phase = ["soak"] * 20 + ["shock"] * 30
    level = np.linspace(20.0, -30.0, 50)
    logs = [[air(level + off, phase)] for off in (2.0, 0.0, 1.0, 0.5)]
    (gap,) = log_gaps(*logs).channels
    assert gap.part == "chamber_air" and gap.unit == "K"
    assert (gap.rms_nominal, gap.rms_closed, gap.rms_floor) == pytest.approx((2.0, 1.0, 0.5))
    assert gap.share == pytest.approx(1.0 - (1.0 - 0.25) / (4.0 - 0.25))


def test_hundred_seconds_without_a_value_in_any_log_do_not_count() -> None:
    phase = ["soak"] * 30
    logs = [[air(np.full(30, off), phase)] for off in (2.0, 0.0, 1.0, 0.5)]
    logs[2][0].values[10:20] = math.nan
    logs[0][0].values[10:20] = 99.0
    (gap,) = log_gaps(*logs).channels
    assert (gap.rms_nominal, gap.rms_closed, gap.rms_floor) == pytest.approx((2.0, 1.0, 0.5))


@dataclass
class Turned:
    """A run of a table that is polled every `poll_s` and does what it is told after a second."""

    demands: tuple[tuple[float, Any], ...]
    poll_s: float
    end_s: float
    error: float = 0.0
    tables: tuple[str, ...] = ("turntable",)
    checksum: str = "sum"

    def __post_init__(self) -> None:
        bench = load_bench_file(DEMO).model_dump(mode="json")
        self.manifest = SimpleNamespace(run_id="run", bench=bench, units={})
        self.lines = [Line(time_s, event) for time_s, event in (*self.demands, (self.end_s, None))]

    def turntable(self, columns: object, start_s: float = 0.0, end_s: float | None = None) -> dict[str, Any]:
        time_s = np.arange(0.0, self.end_s + 1e-9, self.poll_s)
        rate, angle = np.zeros(len(time_s)), np.zeros(len(time_s))
        for at_s, event in self.demands:
            told = time_s >= at_s + 1.0
            rate = np.where(told, getattr(event, "rate_dps", 0.0) + self.error, rate)
            angle = np.where(told, getattr(event, "angle_deg", 0.0) + self.error, angle)
        kept = (time_s >= start_s) & (time_s < (math.inf if end_s is None else end_s))
        rows = {"time_ns": np.rint(time_s * 1e9).astype(np.int64), "angle_deg": angle, "rate_dps": rate}
        return {name: column[kept] for name, column in rows.items()}

    def phase_at(self, times_s: np.ndarray) -> np.ndarray:
        return np.full(len(times_s), "run")


def axis() -> str:
    return load_bench_file(DEMO).table.all_axes[-1].name


@pytest.mark.parametrize(("poll_s", "rows"), [(1.0, 35), (1.9, 16), (2.2, 0), (4.0, 0)])
def test_a_steady_rate_is_taken_from_sixteen_readings_on(poll_s: float, rows: int) -> None:
    """Three readings after it is steady, and the last one, are left out: 40 s have 40, 21, 18 and 10 of them."""
    run = Turned(((0.0, RateDemand("table", axis(), 10.0)),), poll_s, 40.0, error=0.02)
    found = _rate(RunSource(run, ""))  # type: ignore[arg-type]
    if not rows:
        assert found == "no rate was demanded of the table and held for half a minute"
    else:
        assert isinstance(found, ChannelSeries) and len(found.values) >= rows
        assert found.values == pytest.approx(np.full(len(found.values), 10.02))
        assert found.inputs.drive.tolist() == [10.0] * len(found.values)
        assert found.inputs.period_s == pytest.approx(poll_s)


@pytest.mark.parametrize(("held_s", "known"), [(29.0, False), (60.0, True)])
def test_an_angle_is_taken_where_it_was_held_for_half_a_minute(held_s: float, known: bool) -> None:
    first = AngleDemand("table", axis(), 90.0)
    start_s = 100.0
    run = Turned(((start_s, first),), 1.0, start_s + held_s, error=0.001)
    run.lines.append(Line(start_s + held_s, RateDemand("table", axis(), 0.0)))
    found = _angle(RunSource(run, ""))  # type: ignore[arg-type]
    if known:
        assert isinstance(found, ChannelSeries)
        assert found.values == pytest.approx(np.full(len(found.values), 3.6), abs=1e-6)  # arcsec
        assert set(found.inputs.angle_deg.tolist()) == {90.0}
    else:
        assert found == "no angle was demanded of the table and held for half a minute"


def test_means_of_equal_steps_have_their_middles() -> None:
    """Steps of ten seconds, the last unfinished one left out, one without a value between its neighbours."""
    time_s = 5.0 + np.arange(45.0)
    values = np.floor((time_s - 5.0) / 10.0)
    values[20:30] = math.nan
    middle_s, means = _stepped(time_s, values)
    assert middle_s.tolist() == [10.0, 20.0, 30.0, 40.0]
    assert means.tolist() == [0.0, 1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("turned_deg", "rate_dps", "asked"), [(0.5, 0.0, False), (2.0, 0.0, True), (0.0, 5.0, True)]
)
def test_a_bias_over_the_tables_angle_is_learned_where_it_changes(
    turned_deg: float, rate_dps: float, asked: bool
) -> None:
    """A run that is pointed from place to place turns at no rate and shows it all the same."""
    still = stimulus(400, rate_dps=rate_dps)
    angle = still.angle_deg + np.where(np.arange(401) < 200, 0.0, turned_deg)
    slow = np.interp(
        np.arange(401.0), [0.0, 100.0, 300.0, 400.0], [10.0, 10.0, 10.0 + turned_deg, 10.0 + turned_deg]
    )
    run = made_run("r", replace(still, angle_deg=angle if rate_dps else slow), np.random.default_rng(1))
    names = {own.variant.effect.name for own in candidates_for([run])}
    assert ("learned: bias over table angle" in names) is asked
    assert ("learned: bias over rate" in names) is (rate_dps > 0.0)


@pytest.mark.parametrize("regime", REGIMES)
def test_intervals_of_a_regime_ascend(regime: Any) -> None:
    assert list(regime.edges) == sorted(set(regime.edges)) and not any(edge is False for edge in regime.edges)


@pytest.mark.parametrize(("late_ms", "share"), [(49.5, 0.0), (50.5, 0.25)])
def test_a_frame_is_late_by_more_than_fifty_milliseconds(late_ms: float, share: float) -> None:
    count = np.arange(5)
    seen = Arrivals(count, 0.1 * count, 0.1)
    assert _late_fraction(seen, np.array([0.0, 0.0, late_ms, 0.0, 0.0])) == share


def test_a_table_at_a_steady_rate_grows_by_the_same_angle_in_every_step() -> None:
    """7 deg/s, four rows a second or so at times that jitter, a second without any of them in the middle."""
    rng = np.random.default_rng(5)
    time_s = 0.25 * np.arange(400.0) + rng.uniform(0.0, 0.1, 400)
    kept = (time_s < 50.0) | (time_s > 51.5)
    steps = Steps.of(time_s[kept], np.ones(int(kept.sum()), dtype=bool))
    angle_deg, rate_dps = steps.angles(7.0 * time_s[kept])
    whole = np.flatnonzero(steps.whole)
    assert len(whole) > 60
    assert np.diff(angle_deg)[whole] == pytest.approx(np.full(len(whole), 7.0 * steps.period_s), rel=1e-9)
    assert rate_dps is not None
    assert rate_dps[whole] == pytest.approx(np.full(len(whole), 7.0), rel=1e-6)


def test_of_a_map_of_phases_the_shares_are_those_of_the_excess_that_is_clear() -> None:
    rng = np.random.default_rng(1)
    run = made_run("r", stimulus(4000), rng)
    group = Group("shock", ("0",), ((run,),))
    floor = Floor(np.ones(len(BANDS)), np.zeros(len(BANDS)), from_repeats=True)
    signs = rng.choice([-1.0, 1.0], size=(1, 3999))
    still = phase_map([group], [signs], floor, Noise(0.004))
    assert [place.share for place in still] == [0.0] * len(still)
    moved = phase_map([group], [3.0 * signs], floor, Noise(0.004))
    assert sum(place.share for place in moved) == pytest.approx(1.0)
    seconds = {"room": 1000, "shock": 3000}
    fast = {place.part: place.share for place in moved if place.band == BANDS[-1]}
    assert fast["shock"] / fast["room"] == pytest.approx(seconds["shock"] / seconds["room"], rel=0.1)


def test_the_interval_of_a_shrinkage_by_hand() -> None:
    """Two cells of a band, 2 coefficients each: 62 gone, 4 left beyond noise; a floor known to half of it."""
    floor = Floor(np.ones(len(BANDS)), np.full(len(BANDS), 0.5), from_repeats=True)
    share, low, high = _interval(
        np.array([30.0, 40.0]),
        np.array([3.0, 5.0]),
        np.array([25.0, 36.0]),
        np.array([2.0, 2.0]),
        np.array([1, 1]),
        floor,
    )
    sigma_left = math.sqrt((2 * 2 + 4 * 1) + (2 * 2 + 4 * 3) + (4 * 0.5) ** 2)
    sigma_gone = 2.0 * math.sqrt(25.0 + 36.0)
    half = norm.ppf(0.975) * math.hypot(4 / 66 * sigma_gone, 62 / 66 * sigma_left) / 66
    assert (share, low) == pytest.approx((62 / 66, 62 / 66 - half), rel=1e-3)
    assert high == pytest.approx(min(62 / 66 + half, 1.0), rel=1e-3)


def test_quantisation_is_looked_for_from_its_own_size_or_from_what_white_noise_would_hide() -> None:
    """0.24 arcsec: 60 times 0.004 deg/sqrt(h)."""
    assert _starts(Noise(0.004), "quantum_arcsec") == pytest.approx([0.144, 0.48, 1.44])
    assert _starts(Noise(0.004, quantum_arcsec=0.3), "quantum_arcsec") == pytest.approx([0.6, 0.6, 1.44])


@pytest.mark.parametrize("nominal", [0, 1, 2])
def test_nominal_columns_are_fitted_out_with_their_priors(nominal: int) -> None:
    """Against least squares with a row for each prior."""
    rng = np.random.default_rng(nominal)
    rows, sigmas = rng.normal(size=(30, 1 + nominal + 3)), np.array([0.3, 2.0])[:nominal]
    found = reduced(rows.T @ rows, sigmas)
    outer = [0, *range(1 + nominal, rows.shape[1])]
    whole = np.vstack([rows, np.zeros((nominal, rows.shape[1]))])
    whole[30:, 1 : 1 + nominal] = np.diag(1.0 / sigmas)
    inner = whole[:, 1 : 1 + nominal]
    left = whole[:, outer] - inner @ np.linalg.lstsq(inner, whole[:, outer], rcond=None)[0]
    assert found == pytest.approx(left.T @ left, rel=1e-9)
