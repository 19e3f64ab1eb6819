"""Odd recorders: thermometers, tables, counters and clocks against closed forms, effects against their limits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.gap_exam import _recorders_bench as bench
from benchmarks.gap_exam._files import read_arrays, read_seal
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._make import draw_unit, make_case, plan, prepare_folder
from benchmarks.gap_exam._recorders import RECORDERS, SHEET, counted, rows
from benchmarks.gap_exam._recorders_effects import LATITUDE_DEG, line_hz
from benchmarks.gap_exam._recorders_lab import Lab, Thermometer, draw_lab, row_edges
from benchmarks.gap_exam._signals import drawn

PLAIN = Thermometer(0.1, 10.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def unit():
    return draw_unit(RECORDERS, 5, {})


@pytest.fixture(scope="module")
def stages(unit):
    return RECORDERS.campaign(unit)


def lab_with(unit, **habits) -> Lab:
    tidy = {
        "inside": PLAIN, "outside": PLAIN, "angle": "resolver", "resolver_deg": 0.0,
        "wrapped": False, "motion": "trapezoid", "tail_deg": 0.0, "cycle_deg": 0.0, "output": "rounded",
        "word_dph": 1e-3, "sampled": False, "lost": 0, "stale": 0, "tick_s": 0.0, "off_ppm": 0.0,
    }  # fmt: skip
    return replace(draw_lab(unit), **{**tidy, **habits})


def run(lab, angle_deg, *, rows_s=0.5, step_s=0.1, coil_c=25.0, elevation_deg=90.0):
    """A run whose table has the angle given at the fine edges (m + 1,)."""
    m = len(angle_deg) - 1
    coil, case = np.broadcast_to(coil_c, m).astype(float), np.full(m, 25.0)
    edges = 2.0 * rows_s + np.arange(math.floor(m * step_s / rows_s) - 3) * rows_s
    every = np.ones(len(edges) - 1, bool)
    return bench.Recorded(
        "XX", "made", "up", 0, 0, step_s, angle_deg, np.broadcast_to(elevation_deg, m).astype(float),
        {"coil": coil, "case": case}, coil, case, edges, every, every, (("all", 0.0),),
        lab=lab, told_deg=angle_deg, fan=np.zeros(m),
    )  # fmt: skip


def turned(rate_dps, m=3000, step_s=0.1):
    return np.concatenate(([0.0], np.cumsum(np.broadcast_to(rate_dps, m)) * step_s))


def signal(unit, stage, name, size=1.0):
    return RECORDERS.effects[name].signal(unit, stage, size)


# thermometers -------------------------------------------------------------------------------------------------


def test_readings_are_codes_held_between_readings():
    at = 3.0 + np.arange(600) * 0.5
    felt = 20.0 + np.arange(4000) * 0.1 * 0.01
    read = Thermometer(0.0625, 30.0, 0.0, 0.02, held=2).read(felt, 0.1, at, drawn(1, "t"))
    np.testing.assert_allclose(read / 0.0625, np.round(read / 0.0625), atol=1e-9)
    changes = at[1:][np.diff(read) != 0.0] - at[0]
    assert len(changes) > 5
    np.testing.assert_allclose(changes / 30.0, np.round(changes / 30.0), atol=1e-9)
    assert changes[0] >= 60.0
    assert np.abs(read - np.interp(at, np.arange(4000) * 0.1, felt)).max() < 0.6 + 0.04 + 0.1


def test_an_average_over_a_minute_is_half_a_minute_late_on_a_ramp():
    at = 200.0 + np.arange(200.0)
    felt = 0.02 * (np.arange(5000) + 0.5) * 0.1
    read = Thermometer(1e-6, 1.0, 60.0, 0.0).read(felt, 0.1, at, drawn(1, "t"))
    np.testing.assert_allclose(read, 0.02 * (at - 30.0), atol=1e-5)


def test_a_dithering_code_has_the_mean_of_what_it_feels():
    at = np.arange(1.0, 9001.0)
    read = Thermometer(0.5, 1.0, 0.0, 0.0, dithers=True).read(np.full(9100, 21.65), 1.0, at, drawn(1, "t"))
    assert set(np.unique(read)) == {21.5, 22.0}
    assert read.mean() == pytest.approx(21.65, abs=0.01)


# heat ---------------------------------------------------------------------------------------------------------


def test_bodies_settle_where_no_heat_is_left_over_and_follow_the_equations(unit):
    still = bench.warmed_c(unit, np.full(500, 10.0), np.ones(500))
    np.testing.assert_allclose(still, bench.settled_c(unit, 10.0)[:, None] * np.ones((1, 500)), atol=1e-9)
    air = np.concatenate((np.full(1, 10.0), np.full(2999, 40.0)))
    own = bench.warmed_c(unit, air, np.full(3000, 0.7))
    flows = bench.exchange_per_s(unit)
    flows = flows * np.array([1.0, 1.0, 1.0, 0.7])

    def slope(_, now):
        others = flows[:, :3] @ now + flows[:, 3] * 40.0 - flows.sum(axis=1) * now
        return others + np.array([0.0, 0.0, bench.board_heat_k_per_s(unit)])

    times = np.arange(3000) * bench.HEAT_S
    exact = solve_ivp(slope, (0.0, times[-1]), own[:, 1], t_eval=times[:-1], rtol=1e-8, atol=1e-8).y
    np.testing.assert_allclose(own[:, 1:], exact, atol=0.1)


# table --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("motion", ["trapezoid", "s_curve", "first_order"])
def test_a_table_turns_through_the_angle_of_its_rates_however_it_accelerates(unit, motion):
    lab = lab_with(unit, motion=motion, dps2=10.0, smooth_s=0.6)
    edges = np.arange(6001) * 0.05
    angle = bench.moved_deg(lab, [(20.0, 30.0), (80.0, 0.0)], edges, 7.0, drawn(1, "m"))
    assert angle[-1] - 7.0 == pytest.approx(30.0 * 60.0, abs=1e-6)
    rate = np.diff(angle) / 0.05
    np.testing.assert_allclose(rate[(edges[1:] > 30.0) & (edges[1:] < 79.0)], 30.0, atol=2e-5)
    steepest = np.abs(np.diff(rate)).max() / 0.05
    assert steepest <= (10.0 if motion != "first_order" else 30.0 / 0.6) * 1.001


def test_a_stop_is_short_by_its_tail_and_creeps_there(unit):
    lab = lab_with(unit, tail_deg=3e-3, tail_s=20.0, dps2=20.0)
    edges = np.arange(6001) * 0.05
    rates = [(20.0, 30.0), (180.0, 0.0)]
    short = bench.moved_deg(lab, rates, edges, 0.0, drawn(1, "m")) - 30.0 * 160.0
    at = [np.searchsorted(edges, time) for time in (190.0, 210.0, 230.0)]
    assert short[at[0]] == pytest.approx(-3e-3 * math.exp(-8.5 / 20.0), rel=0.05)
    np.testing.assert_allclose(short[at[1:]] / short[at[:-1]], math.exp(-1.0), rtol=1e-3)


def test_what_is_read_for_the_angle_has_the_steps_of_its_reading(unit):
    true = 10.0 + turned(0.0123456)
    step_deg = 12.0 / 3600.0
    read = bench.read_angle_deg(run(lab_with(unit, resolver_deg=step_deg), true))
    np.testing.assert_allclose(read / step_deg, np.round(read / step_deg), atol=1e-6)
    stage = run(lab_with(unit, angle="rate"), true)
    np.testing.assert_allclose(np.diff(bench.read_angle_deg(stage)) / 0.5, 0.012, atol=1e-12)
    told = replace(run(lab_with(unit, angle="command"), true), told_deg=turned(0.01))
    np.testing.assert_allclose(np.diff(bench.read_angle_deg(told)) / 0.5, 0.01, atol=1e-12)
    whole = bench.read_angle_deg(run(lab_with(unit), turned(40.0)))
    wrapped = bench.read_angle_deg(run(lab_with(unit, wrapped=True), turned(40.0)))
    assert wrapped.max() < 360.0
    np.testing.assert_allclose(np.unwrap(wrapped, period=360.0) - wrapped[0], whole - whole[0], atol=1e-8)


# rows ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("tick_s", "off_ppm"), [(0.0, 0.0), (0.001, 300.0), (0.1, 0.0)])
def test_stamps_stand_on_ticks_at_the_rate_of_rows(unit, tick_s, off_ppm):
    edges = row_edges(lab_with(unit, tick_s=tick_s, off_ppm=off_ppm), 5.0, 600.0, 0.377)
    assert np.diff(edges).mean() == pytest.approx(0.2 * (1.0 + 1e-6 * off_ppm), rel=1e-5)
    assert np.abs(np.diff(edges) - 0.2).max() < max(1.01 * tick_s * (off_ppm != 0.0), 1e-9)
    assert edges[-1] < 600.0 - 0.2
    if tick_s:
        np.testing.assert_allclose(edges / tick_s, np.round(edges / tick_s), atol=1e-6)


def test_moves_of_a_lab_that_logs_commands_are_blank_and_steady_rates_are_not():
    told = turned(np.repeat((0.0, 20.0, 0.0), 1000))
    edges = np.arange(599) * 0.5
    counts = bench.blanked(told, 0.1, np.array([]), edges, True)
    middle = edges[:-1] + 0.25
    for at in (100.0, 200.0):
        assert not counts[(middle > at - 0.4) & (middle < at + 14.0)].any()
    assert counts[(middle > 116.0) & (middle < 198.0)].all()
    mounted = bench.blanked(told, 0.1, np.array([50.0]), edges, False)
    assert not mounted[(middle > 40.5) & (middle < 69.5)].any()
    assert mounted[(middle < 39.5) | (middle > 70.5)].all()


def test_points_behind_the_filter_are_not_late_and_lose_what_a_triangle_loses(unit):
    stage = run(lab_with(unit, sampled=True), turned(0.0, 12000, 0.025), rows_s=0.1, step_s=0.025)
    middle = 0.5 * (stage.edges_s[1:] + stage.edges_s[:-1])
    np.testing.assert_allclose(stage.in_rows(3.0 * stage.time_s), 3.0 * middle, atol=1e-9)
    wave = stage.in_rows(np.sin(2.0 * math.pi * stage.time_s))
    expected = np.sinc(0.1 * bench.FILTER_ROWS) ** 2 * np.sin(2.0 * math.pi * middle)
    np.testing.assert_allclose(wave, expected, atol=0.01)
    # a ramp of 20 deg/s2 is summed to its angle within some arcsec
    ramp = np.interp(stage.time_s, (100.03, 104.11), (0.0, 80.0))
    means = super(bench.Recorded, stage).in_rows(ramp)
    assert abs(np.sum(stage.in_rows(ramp) - means)) * 0.1 < 8.0 / 3600.0


def test_words_and_counts_are_whole_and_a_count_loses_no_angle(unit):
    stage = run(lab_with(unit, word_dph=6.0), turned(0.0))
    output = rows(unit, stage, np.zeros(len(stage.edges_s) - 1), drawn(1, "log"))
    np.testing.assert_allclose(output / 6.0, np.round(output / 6.0), atol=1e-9)
    rate, gaps = np.full(500, 7.3), np.full(500, 0.05)
    counts = counted(rate, gaps, 1.0) * gaps
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert np.abs(np.cumsum(counts) - np.cumsum(rate * gaps)).max() <= 1.0


@pytest.mark.parametrize("sampled", [False, True])
def test_noise_a_second_is_that_of_the_data_sheet_with_either_way_to_sample(unit, sampled):
    stage = run(lab_with(unit, sampled=sampled), turned(0.0, 80000, 0.05), rows_s=0.1, step_s=0.05)
    output = rows(unit, stage, np.zeros(len(stage.edges_s) - 1), drawn(3, "log"))
    means = output[: len(output) // 10 * 10].reshape(-1, 10).mean(axis=1)
    assert math.sqrt(0.5 * np.mean(np.diff(means) ** 2)) == pytest.approx(
        60.0 * SHEET.arw_deg_per_sqrt_h, rel=0.04
    )


# effects ------------------------------------------------------------------------------------------------------


def test_bias_follows_temperature_its_rate_or_its_turns_as_named(unit):
    m = 60000
    hot = run(lab_with(unit), turned(0.0, m), coil_c=65.0)
    np.testing.assert_allclose(signal(unit, hot, "leakage", 9.0), 9.0, rtol=1e-9)
    np.testing.assert_allclose(
        signal(unit, run(lab_with(unit), turned(0.0)), "leakage", 9.0), 0.0, atol=1e-12
    )
    up = run(lab_with(unit), turned(0.0, m), coil_c=25.0 + 2.0 / 600.0 * np.arange(m))
    down = run(lab_with(unit), turned(0.0, m), coil_c=25.0 - 2.0 / 600.0 * np.arange(m))
    knee = 1.0 + 2.0 * unit.draw["form"]
    wave = signal(unit, up, "coil_rate", 3.0)
    assert wave[m // 2] == pytest.approx(3.0 * knee * math.asinh(2.0 / knee), rel=1e-3)
    np.testing.assert_allclose(signal(unit, down, "coil_rate", 3.0), -wave, atol=1e-9)
    late = signal(unit, up, "late_coupler", 10.0)[-1]
    lag_min = 6.0 + 12.0 * unit.draw["a"]
    assert late == pytest.approx(-2.0 * lag_min * (0.3 / 2.5 + 0.4 + 0.3 * 2.5), rel=0.03)


def test_friction_has_no_rate_in_it_and_another_side_on_the_way_back(unit):
    there = np.concatenate((np.linspace(0.0, 50.0, 10000), np.linspace(50.0, 0.0, 10000)))
    slow = signal(
        unit, run(lab_with(unit), turned(0.0, 40000), coil_c=np.repeat(there, 2)), "splice_friction"
    )
    fast = signal(unit, run(lab_with(unit), turned(0.0, 20000), coil_c=there), "splice_friction")
    np.testing.assert_allclose(slow[::2], fast, atol=0.05)
    assert fast[9000] == pytest.approx(-1.0, abs=0.01)
    assert fast[19000] == pytest.approx(1.0, abs=0.01)


def test_effects_of_rate_have_their_parity_and_a_dead_band_its_ends(unit):
    forth, back = (run(lab_with(unit), turned(rate)) for rate in (30.0, -30.0))
    even = signal(unit, forth, "feedback_asymmetry", 100.0)
    np.testing.assert_allclose(even, 100e-6 * 3600.0 * 30.0, rtol=1e-6)
    np.testing.assert_allclose(signal(unit, back, "feedback_asymmetry", 100.0), even, rtol=1e-9)
    for rate_dps, left in ((0.0, 0.0), (1.0, 1.0)):
        stage = run(lab_with(unit), turned(rate_dps))
        sensed = sensed_dph(stage, LATITUDE_DEG)
        heard = sensed + signal(unit, stage, "dead_band", 60.0)
        np.testing.assert_allclose(heard, left * sensed, atol=0.02 if left else 0.2)
    warm = run(lab_with(unit), turned(10.0), coil_c=26.0)
    shift = signal(unit, warm, "wavelength", 25.0) / sensed_dph(warm, LATITUDE_DEG)
    np.testing.assert_allclose(shift, 1e-6, rtol=0.02)


def test_gravity_is_odd_and_a_line_has_one_frequency(unit):
    up, down, level = (run(lab_with(unit), turned(0.0), elevation_deg=e) for e in (90.0, -90.0, 0.0))
    np.testing.assert_allclose(signal(unit, up, "coil_sag", 4.0), 4.0, rtol=1e-9)
    np.testing.assert_allclose(signal(unit, down, "coil_sag", 4.0), -4.0, rtol=1e-9)
    np.testing.assert_allclose(signal(unit, level, "coil_sag", 4.0), 0.0, atol=1e-9)
    line = signal(unit, run(lab_with(unit), turned(0.0, 30000)), "supply_line", 5.0)
    power = np.abs(np.fft.rfft(line * np.hanning(len(line))))
    assert np.argmax(power) / 3000.0 == pytest.approx(line_hz(unit), abs=1.0 / 3000.0)
    assert np.abs(line).max() == pytest.approx(5.0, rel=1e-3)


# cases --------------------------------------------------------------------------------------------------------


def test_a_campaign_has_at_most_27_runs_and_a_profile_never_shown(stages):
    assert 25 <= len(stages) <= 27
    assert {stage.profile for stage in stages if stage.held_out and stage.repeat == 0} == {"mission"}
    for stage in stages:
        assert np.median(np.diff(stage.edges_s)) >= stage.step_s - 2e-3
        assert stage.edges_s[-1] < stage.steps * stage.step_s
        assert stage.kept.mean() > 0.99


def test_a_perfect_gyro_differs_from_its_table_by_noise_alone_in_every_laboratory():
    apart = []
    for seed in range(6):
        made = draw_unit(RECORDERS, seed, {})
        stage = next(stage for stage in RECORDERS.campaign(made) if stage.code == "RT")
        true = stage.in_rows(sensed_dph(stage, LATITUDE_DEG))
        output = rows(made, stage, true, drawn(seed, "log"))
        read = bench.read_angle_deg(stage)
        told = 3600.0 * np.diff(np.unwrap(read, period=360.0)) / np.diff(stage.edges_s)
        left = np.where(stage.valid, output - told, 0.0)[20:]
        whole = max(round(4.0 / np.median(np.diff(stage.edges_s))), 1)
        means = left[: len(left) // whole * whole].reshape(-1, whole).mean(axis=1)
        steady = np.abs(means - np.median(means))
        assert np.median(steady) < 2.0 * 0.6745 * 60.0 * SHEET.arw_deg_per_sqrt_h / 2.0
        apart.append(stage.habits)
    assert len({(lab.angle, lab.motion, lab.output, lab.rows_hz) for lab in apart}) > 3


def test_a_case_made_twice_is_the_same(tmp_path):
    what = next(case for case in plan(RECORDERS, 7, 12) if case.kind == "pair")
    for name in ("one", "two"):
        prepare_folder(RECORDERS, tmp_path / name)
        make_case(RECORDERS, tmp_path / name, what)
    one, two = (tmp_path / name for name in ("one", "two"))
    logs = sorted(path.name for path in (one / "cases" / what.name).iterdir())
    assert len(logs) > 20
    for name in logs:
        assert (one / "cases" / what.name / name).read_bytes() == (
            two / "cases" / what.name / name
        ).read_bytes()
    seal = read_seal(one / "sealed" / f"{what.name}.json")
    assert seal == read_seal(two / "sealed" / f"{what.name}.json")
    assert set(seal.snr) == {name for name, _ in what.effects}
    for name, ratio in what.effects:
        assert seal.snr[name] == pytest.approx(ratio, rel=0.05)
    assert (
        read_arrays(one / "sealed" / f"{what.name}.npz").keys()
        == read_arrays(two / "sealed" / f"{what.name}.npz").keys()
    )
