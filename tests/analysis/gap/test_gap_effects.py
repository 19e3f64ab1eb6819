"""Effects against closed forms and integrals done another way."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from drivers.base.constants import EARTH_RATE_DPH, earth_rate_north_dph, earth_rate_up_dph
from simulators.effects import CATALOGUE, Effect, Stimulus, catalogue
from simulators.effects._stimulus import play
from tests.analysis.gap.conftest import effect, stimulus


def test_every_effect_has_finite_columns_of_its_shape() -> None:
    s = stimulus(600, rate_dps=7.0)
    for each in CATALOGUE:
        if not isinstance(each, Effect):
            continue
        for variant in each.variants():
            columns = variant.columns(s)
            assert columns.shape == (len(each.parameters), 600), each.name
            assert np.isfinite(columns).all(), each.name


def test_names_are_unique_and_described() -> None:
    names = [each.name for each in CATALOGUE]
    assert len(set(names)) == len(names) == len(catalogue())
    assert all(each.source and each.meaning.endswith(".") for each in CATALOGUE)


def test_input_rate_is_the_earth_rates_projection() -> None:
    # 39.10 deg: vertical 9.4860 deg/h, horizontal 11.6726 deg/h
    up, level = stimulus(300), stimulus(300, elevation_deg=0.0)
    assert up.input_rate_dph[5] == pytest.approx(9.4860, abs=2e-4)
    north = Stimulus(
        level.time_s, level.t_in_c, level.t_out_c, np.zeros(301), level.elevation_deg, level.latitude_deg
    )
    assert north.input_rate_dph[5] == pytest.approx(11.6726, abs=2e-4)


def test_harmonics_are_means_over_the_sample() -> None:
    s = stimulus(300, rate_dps=77.0)
    fine = np.radians(2.0 * (s.angle_deg[:-1, None] + 77.0 * (np.arange(2000) + 0.5) / 2000.0))
    assert s.harmonic(2)[0] == pytest.approx(np.cos(fine).mean(axis=1), abs=1e-6)
    assert s.harmonic(2)[1] == pytest.approx(np.sin(fine).mean(axis=1), abs=1e-6)


def test_azimuth_column_is_the_derivative_of_the_projection() -> None:
    s = stimulus(300, elevation_deg=0.0)
    turned = Stimulus(s.time_s, s.t_in_c, s.t_out_c, s.angle_deg + 0.01, s.elevation_deg, s.latitude_deg)
    slope = (turned.input_rate_dph - s.input_rate_dph) / 0.01
    assert effect("azimuth_error").columns(s, {})[0] == pytest.approx(slope, rel=1e-3)


def test_wobble_is_the_mean_of_rate_times_cosine() -> None:
    s = stimulus(300, rate_dps=20.0)
    fine = np.radians(s.angle_deg[:-1, None] + 20.0 * (np.arange(2000) + 0.5) / 2000.0)
    mean = 1e-6 * 20.0 * 3600.0 * np.cos(fine).mean(axis=1)
    assert effect("table_wobble_once").columns(s, {})[0] == pytest.approx(mean, abs=1e-6)


def test_a_bias_bends_as_the_square_or_ever_more_on_one_side() -> None:
    """Of one curvature at 25 degC; with a growth it is e^growth times as large 50 K further."""
    n = 4_000
    warm = stimulus(n)
    t_in_c = np.linspace(-40.0, 85.0, n)
    s = Stimulus(warm.time_s, t_in_c, t_in_c, warm.angle_deg, warm.elevation_deg, 39.1)
    x = s.warm_k / 50.0
    bend = {
        growth: effect("bias_quadratic").columns(s, {"lag_s": 0.0, "growth": growth})[0]
        for growth in (0.0, 3.0, -3.0)
    }
    assert bend[0.0] == pytest.approx(x**2)
    step_k = (125.0 / (n - 1)) / 50.0
    second = {growth: np.diff(values, 2) / step_k**2 for growth, values in bend.items()}
    inner = slice(60, -60)  # at the ends temperatures are smoothed over fewer samples
    for growth, values in second.items():
        assert values[inner] == pytest.approx(2.0 * np.exp(growth * x[1:-1][inner]), rel=1e-3)
    assert effect("bias_quadratic").columns(s, {"lag_s": 0.0})[0] == pytest.approx(bend[0.0])


def test_lag_answers_a_step_exponentially() -> None:
    s = stimulus(400)
    step = np.where(np.arange(400) < 10, 0.0, 1.0)
    answer = s.lagged(step, 50.0)
    assert answer[109] == pytest.approx(1.0 - math.exp(-100.0 / 50.0), abs=1e-12)
    assert s.lagged(np.full(400, 7.0), 50.0) == pytest.approx(np.full(400, 7.0))


def test_play_stands_still_inside_its_width_and_follows_outside() -> None:
    n = 4000
    s = stimulus(n)
    up_down = np.interp(np.arange(n), [0, n // 2, n - 1], [25.0, 65.0, 25.0])
    s = Stimulus(s.time_s, up_down, up_down, s.angle_deg, s.elevation_deg, 39.1)
    followed = effect("hysteresis").columns(s, {"half_width_k": 8.0})[0] + s.warm_k
    assert followed[n // 4] == pytest.approx(s.warm_k[n // 4] - 8.0, abs=0.3)
    # 10 K down from the peak is less than the play of 16 K
    turned = n // 2 + n // 8
    assert followed[turned] == pytest.approx(followed[n // 2], abs=0.3)
    assert followed[-1] == pytest.approx(s.warm_k[-1] + 8.0, abs=0.6)


def test_relays_about_a_temperature_are_a_flat_curve_of_a_play() -> None:
    """Against 4,000 relays of one width (Preisach), their middles spread as sech^2 about 5 degC."""
    n, half_k, centre_c, curl = 6_000, 9.0, 5.0, 1.6
    flat_k = 50.0 / curl
    turns = np.interp(np.arange(n), np.linspace(0, n - 1, 7), [25.0, -38.0, 60.0, -10.0, 20.0, 2.0, 40.0])
    warm = stimulus(n)
    s = Stimulus(warm.time_s, turns, turns, warm.angle_deg, warm.elevation_deg, 39.1)
    middles = centre_c + flat_k * np.arctanh((np.arange(4_000) + 0.5) / 2_000 - 1.0)
    t_in_c = s.warm_k + 25.0
    up = middles < t_in_c[0]
    relays = np.empty(n)
    for at, now_c in enumerate(t_in_c):
        up = np.where(now_c > middles + half_k, True, np.where(now_c < middles - half_k, False, up))
        relays[at] = flat_k * (2.0 * up.mean() - 1.0)
    shape = {"half_width_k": half_k, "spread": 0.0, "curl": curl, "centre_c": centre_c}
    whole = effect("hysteresis").columns(s, {**shape, "static": 1.0})[0]
    loops = effect("hysteresis").columns(s, {**shape, "static": 0.0})[0]
    assert whole == pytest.approx(relays, abs=0.25)
    assert np.abs(loops).max() > 5.0
    assert whole - loops == pytest.approx(flat_k * np.tanh((t_in_c - centre_c) / flat_k))


def test_loops_are_the_mean_of_bent_plays_of_five_widths_at_every_sample() -> None:
    n, half_k, centre_c, curl = 6_000, 7.0, 0.0, 1.6
    flat_k = 50.0 / curl
    warm = stimulus(n)
    turns = np.interp(np.arange(n), np.linspace(0, n - 1, 6), [25.0, -38.0, 60.0, -10.0, 20.0, -40.0])
    s = Stimulus(warm.time_s, turns, turns, warm.angle_deg, warm.elevation_deg, 39.1)
    plays = [play(s.warm_k, half_k * (1.0 + 0.6 * part)) for part in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    bent = [flat_k * np.tanh((each + 25.0 - centre_c) / flat_k) for each in (*plays, s.warm_k)]
    shape = {"half_width_k": half_k, "spread": 0.6, "curl": curl, "centre_c": centre_c, "static": 0.0}
    loops = effect("hysteresis").columns(s, shape)[0]
    assert np.abs(loops).max() > 5.0
    assert loops == pytest.approx(np.mean(bent[:5], axis=0) - bent[5], abs=0.1)


def test_a_curl_too_small_to_see_leaves_a_play_and_a_straight_line() -> None:
    n = 2_000
    t_in_c = 25.0 + 40.0 * np.sin(np.arange(n) / 150.0)
    warm = stimulus(n)
    s = Stimulus(warm.time_s, t_in_c, t_in_c, warm.angle_deg, warm.elevation_deg, 39.1)
    shape = {"half_width_k": 6.0, "spread": 0.8, "curl": 2e-4, "centre_c": 25.0}
    for static in (0.0, 1.0):
        bent = effect("hysteresis").columns(s, {**shape, "static": static})[0]
        straight = effect("hysteresis").columns(s, {**shape, "static": static, "curl": 0.0})[0]
        assert bent == pytest.approx(straight, abs=1e-4)
    assert straight == pytest.approx(s.warm_k, abs=6.0 * 1.8 + 1e-9)


def test_what_is_late_as_a_whole_is_what_it_follows_less_what_passes() -> None:
    n, lag_s = 3_000, 700.0
    t_in_c = np.where(np.arange(n) < 600, 20.0, -10.0)
    s = Stimulus(np.arange(1.0, n + 1.0), t_in_c, t_in_c, np.zeros(n + 1), np.zeros(n), 39.1)
    whole, passing = (
        effect("thermal_lag").columns(s, {"lag_s": lag_s, "growth": 0.0, "static": static})[0]
        for static in (1.0, 0.0)
    )
    body_k = -5.0 - 30.0 * (1.0 - np.exp(-np.maximum(np.arange(n) - 599.0, 0.0) / lag_s))
    assert whole == pytest.approx(body_k, abs=0.7)  # the record's temperatures are smoothed over a minute
    assert whole + passing == pytest.approx(s.warm_k)


def test_creep_has_five_lags_and_its_place_between_thermometer_and_case() -> None:
    """The case alone steps by -20 K: five exponentials of a body 0.4 of the way to it, by hand."""
    n, lag_s, spread = 6_000, 900.0, 1.2
    t_out_c = np.where(np.arange(n) < 500, 25.0, 5.0)
    s = Stimulus(np.arange(1.0, n + 1.0), np.full(n, 25.0), t_out_c, np.zeros(n + 1), np.zeros(n), 39.1)
    shape = {"lag_s": lag_s, "growth": 0.0, "spread": spread, "toward_case": 0.4}
    since_s = np.maximum(np.arange(n) - 499.0, 0.0)
    lags_s = lag_s * np.exp(spread * np.array([-1.0, -0.5, 0.0, 0.5, 1.0]))
    body_k = np.where(since_s > 0.0, -8.0, 0.0)
    left_k = body_k * np.exp(-since_s / lags_s[:, None]).mean(axis=0)
    passing, whole = (
        effect("relaxation").columns(s, {**shape, "static": static})[0] for static in (0.0, 1.0)
    )
    settled = np.abs(np.arange(n) - 500) > 60  # the record's temperatures are smoothed over a minute
    assert passing[settled] == pytest.approx(left_k[settled], abs=0.1)
    assert whole == pytest.approx(body_k - left_k, abs=0.1)
    narrow = effect("relaxation").columns(s, {**shape, "static": 0.0, "spread": 1e-3})[0]
    single = effect("relaxation").columns(s, {**shape, "static": 0.0, "spread": 0.0})[0]
    assert narrow == pytest.approx(single, abs=1e-4)
    assert np.abs(passing - single).max() > 0.5


def test_what_is_late_between_thermometer_and_case_is_a_late_rate_of_change() -> None:
    """T less its first-order follower is the lag times the follower of dT/dt: `shupe` has the same columns."""
    s, lag_s = stimulus(9_000), 800.0
    late = effect("thermal_lag").columns(s, {"lag_s": lag_s, "toward_case": 0.6})[0]
    warming, gradient = effect("shupe").columns(s, {"lag_s": lag_s})
    assert late == pytest.approx(
        lag_s / 60.0 * (warming - 0.6 * gradient), abs=0.02 * float(np.abs(late).max())
    )


def test_stress_of_a_temperature_difference_relaxes_by_its_share() -> None:
    """Standard linear solid after a step of 8 K: 1.5 of it at once, 1 of it in the end."""
    n, lag_s = 6_000, 500.0
    t_out_c = np.where(np.arange(n) < 500, 25.0, 17.0)
    s = Stimulus(np.arange(1.0, n + 1.0), np.full(n, 25.0), t_out_c, np.zeros(n + 1), np.zeros(n), 39.1)
    stress = effect("gradient").columns(s, {"lag_s": lag_s, "share": -0.5})[0]
    since_s = np.arange(n) - 499.0
    expected = np.where(since_s > 0, 8.0 + 4.0 * np.exp(-np.maximum(since_s, 0.0) / lag_s), 0.0)
    assert np.delete(stress, slice(400, 600)) == pytest.approx(np.delete(expected, slice(400, 600)), abs=0.3)
    assert stress[-1] == pytest.approx(8.0, abs=0.01)


@pytest.mark.parametrize(("upright", "across"), [(0.0, 0.0), (1.0, 1.0)])
def test_a_field_along_an_axis_of_the_body_and_across_it(upright: float, across: float) -> None:
    """A field that dips against the body's directions, turned by hand: about up, then to four elevations."""
    elevation, turned = (each.ravel() for each in np.meshgrid([90.0, 45.0, 0.0, -90.0], [0.0, 70.0, 200.0]))
    n = len(turned)
    warm = np.full(n, 25.0)
    edges = np.append(turned, turned[-1])
    s = Stimulus(np.arange(1.0, n + 1.0), warm, warm, edges, elevation, 39.1)
    heading = np.radians(0.5 * (edges[1:] + edges[:-1]))
    fading = np.sinc(np.diff(edges) / 360.0)  # of what turns in a sample
    north, west, up, level = effect("heading_sensitivity").columns(s, {"upright": upright, "across": across})
    field = np.array([0.4, 0.0, -0.9])  # north, west, up
    e, zero = np.radians(elevation), np.zeros(n)
    ahead = np.stack((np.cos(heading) * fading, -np.sin(heading) * fading, zero))
    above = np.stack((zero, zero, np.ones(n)))
    if across:
        assert field @ (ahead * np.sin(e) - above * np.cos(e)) == pytest.approx(0.4 * north + 0.9 * level)
        beside = np.stack((np.sin(heading) * fading, np.cos(heading) * fading, zero))
        assert field @ beside == pytest.approx(0.4 * west)
    else:
        assert field @ (ahead * np.cos(e) + above * np.sin(e)) == pytest.approx(0.4 * north - 0.9 * up)


def test_warming_rate_is_in_kelvin_a_minute() -> None:
    s = stimulus(2000)
    ramp = 25.0 - 0.05 * np.arange(2000.0)
    s = Stimulus(s.time_s, ramp, ramp, s.angle_deg, s.elevation_deg, 39.1)
    assert s.warming_k_per_min[500:1500] == pytest.approx(np.full(1000, -3.0))


def test_time_offset_is_a_shift_of_the_samples() -> None:
    # rate grows by 0.2 deg/s a second: 1 ms late means 0.2e-3 deg/s more, 0.72 deg/h
    s = stimulus(600)
    angle = 0.1 * np.arange(601.0) ** 2
    s = Stimulus(s.time_s, s.t_in_c, s.t_out_c, angle, s.elevation_deg, 0.0)
    for side in (-1.0, 0.0, 1.0):
        column = effect("time_offset").columns(s, {"side": side})[0]
        assert column[10:-10] == pytest.approx(np.full(580, 0.72), rel=1e-6)


def test_a_smooth_rate_is_shifted_at_the_samples_own_edges() -> None:
    """A swing of 12 samples, against the closed form: rate at the end less rate at the start of each."""
    n, period = 240, 12.0
    turn = 2.0 * np.pi * np.arange(n + 1.0) / period
    angle_deg = 30.0 * np.sin(turn)
    still = stimulus(n, cold=False)
    s = Stimulus(still.time_s, still.t_in_c, still.t_out_c, angle_deg, still.elevation_deg, 39.1)
    edges_dps = 30.0 * 2.0 * np.pi / period * np.cos(turn)
    exact = 1e-3 * 3600.0 * np.diff(edges_dps)
    column = effect("time_offset").columns(s, {"side": 0.0})[0]
    # at a crest the edge's value never goes beyond its neighbours
    crests = np.maximum(np.abs(np.cos(turn[:-1])), np.abs(np.cos(turn[1:]))) > 0.999
    inside = slice(3, -3)
    off = np.abs(column - exact)[inside] / np.abs(exact).max()
    assert off[~crests[inside]].max() < 0.005
    assert off.max() < 0.1


def test_a_leaning_axis_stays_a_unit_vector() -> None:
    """At any elevation: the column against the exact rotation of a unit vector, by finite differences."""
    lean = 1e-6
    for elevation_deg in (-90.0, 0.0, 20.0, 45.0, 90.0):
        s = stimulus(100, rate_dps=3.0, elevation_deg=elevation_deg, cold=False)
        up, level = np.sin(np.radians(elevation_deg)), np.cos(np.radians(elevation_deg))
        axis = np.array([level + lean * abs(up), up + lean * level])
        axis /= np.linalg.norm(axis)
        along = s.harmonic(1)[0] * earth_rate_north_dph(39.1)
        vertical = earth_rate_up_dph(39.1) + 3600.0 * s.table_rate_dps
        change = (axis[0] - level) * along + (axis[1] - up) * vertical
        column = effect("axis_misalignment").columns(s, {})[0]
        assert column == pytest.approx(math.radians(1.0) * change / lean, rel=1e-4, abs=1e-4)


def test_a_lean_that_is_carried_along_is_that_of_a_rigid_case() -> None:
    """The case and the axis that leans in it, turned together by matrices: about the trunnion, then the table."""
    lean = 1e-4
    earth = np.array([earth_rate_north_dph(39.1), 0.0, earth_rate_up_dph(39.1)])  # north, west, up
    for elevation_deg in (-90.0, -30.0, 0.0, 45.0, 90.0, 135.0):
        s = stimulus(100, rate_dps=0.0, elevation_deg=elevation_deg, cold=False)
        s = replace(s, angle_deg=37.0 + 0.0 * s.angle_deg)
        # a level axis points along the table's zero: above it is up, to its right is east
        tilt = Rotation.from_euler("y", -elevation_deg, degrees=True)
        turn = Rotation.from_euler("z", 37.0, degrees=True)
        columns = effect("axis_misalignment").columns(s, {"carried": 1.0})
        for column, to in zip(
            columns, (np.array([0.0, 0.0, lean]), np.array([0.0, -lean, 0.0])), strict=True
        ):
            change = earth @ turn.apply(tilt.apply(np.array([1.0, 0.0, 0.0]) + to))
            change -= earth @ turn.apply(tilt.apply(np.array([1.0, 0.0, 0.0])))
            assert column == pytest.approx(math.radians(1.0) * change / lean, rel=1e-6, abs=1e-9)
        # mounted anew, with what is beside the axis as in a case that is tilted: above it as it was
        anew, turned = effect("axis_misalignment").columns(s, {"carried": 0.0, "aside": 1.0})
        assert turned == pytest.approx(columns[1])
        assert anew == pytest.approx(effect("axis_misalignment").columns(s, {"carried": 0.0})[0])
    # a level axis on a table that turns: what is above it picks up the table's rate
    level = stimulus(100, rate_dps=3.0, elevation_deg=0.0, cold=False)
    picked = effect("axis_misalignment").columns(level, {"carried": 1.0})[0]
    assert picked == pytest.approx(math.radians(1.0) * (earth[2] + 3.0 * 3600.0), rel=1e-9)


def test_an_asymmetry_counts_the_magnitude_within_samples_in_which_the_rate_turns() -> None:
    """A swing with 4 s to a quarter, against the integral of its magnitude on a grid 1,000 times finer."""
    n, peak_dps, omega = 400, 9.0, 2.0 * math.pi / 16.0
    edges_s = np.arange(n + 1.0) + 0.37
    angle_deg = -peak_dps / omega * np.cos(omega * edges_s)
    at_edges = peak_dps * np.sin(omega * edges_s)
    warm = np.full(n, 25.0)
    s = Stimulus(edges_s[1:], warm, warm, angle_deg, np.full(n, 90.0), 0.0, edge_rate_dps=at_edges)
    fine_s = edges_s[0] + (np.arange(n * 1000) + 0.5) / 1000.0
    expected = np.abs(3600.0 * peak_dps * np.sin(omega * fine_s)).reshape(n, 1000).mean(axis=1)
    assert s.mean_speed_dph == pytest.approx(expected, abs=1e-3 * 3600.0 * peak_dps)
    assert np.abs(np.abs(s.input_rate_dph) - expected).max() > 0.02 * 3600.0 * peak_dps
    column = effect("scale_factor_asymmetry").columns(s, {})[0]
    assert column == pytest.approx(0.5e-6 * s.mean_speed_dph)
    # where the edges are not known nothing says how the rate turns
    assert replace(s, edge_rate_dps=None).mean_speed_dph == pytest.approx(np.abs(s.input_rate_dph))


@given(first=st.floats(0.1, 40.0), last=st.floats(0.1, 40.0))
def test_the_mean_magnitude_of_a_rate_that_reverses_steadily(first: float, last: float) -> None:
    """Two triangles under a straight line: (a^2 + b^2) / (2 (a + b)) for a rate from a to -b."""
    edges = np.array([first, -last])
    angle_deg = np.array([0.0, edges.mean()])
    warm, up = np.full(1, 25.0), np.full(1, 90.0)
    s = Stimulus(np.ones(1), warm, warm, angle_deg, up, 0.0, edge_rate_dps=edges)
    expected = (first**2 + last**2) / (2.0 * (first + last))
    assert s.mean_speed_dph[0] / 3600.0 == pytest.approx(expected, rel=0.02, abs=0.01)


@given(first=st.floats(-40.0, 40.0), last=st.floats(-40.0, 40.0), bulge=st.floats(-150.0, 150.0))
@example(first=0.0, last=1.0, bulge=-2.0)
@example(first=2.0, last=1.0, bulge=-12.0)
def test_the_mean_magnitude_of_a_rate_that_is_a_parabola_in_its_sample(
    first: float, last: float, bulge: float
) -> None:
    """Against the mean of 20,000 points; the Earth turns, too: 9.486 deg/h about the vertical at 39.1 deg."""
    inside = (np.arange(20_000) + 0.5) / 20_000
    rate_dps = first + (last - first) * inside + bulge * inside * (1.0 - inside)
    edges, warm, up = np.array([first, last]), np.full(1, 25.0), np.full(1, 90.0)
    angle_deg = np.array([0.0, 0.5 * (first + last) + bulge / 6.0])
    s = Stimulus(np.ones(1), warm, warm, angle_deg, up, 39.1, edge_rate_dps=edges)
    expected = np.abs(rate_dps + 9.486 / 3600.0).mean()
    assert s.mean_speed_dph[0] / 3600.0 == pytest.approx(expected, rel=0.01, abs=0.05)


def test_about_rest_the_earths_rate_says_where_a_sample_turns() -> None:
    """A table that swings by a hundredth of the Earth's rate turns nothing: the input keeps its sign."""
    n = 40
    edges_dps = 1e-4 * np.sin(np.arange(n + 1.0))
    angle_deg = np.concatenate(([0.0], np.cumsum(0.5 * (edges_dps[1:] + edges_dps[:-1]))))
    warm = np.full(n, 25.0)
    s = Stimulus(
        np.arange(1.0, n + 1.0), warm, warm, angle_deg, np.full(n, 90.0), 39.1, edge_rate_dps=edges_dps
    )
    assert s.mean_speed_dph == pytest.approx(s.input_rate_dph, rel=1e-12)


def test_a_plant_has_the_same_asymmetry_at_opposite_rates() -> None:
    variant = effect("scale_factor_asymmetry").variants()[0]
    rates_dph = np.array([-7.2e4, -3.0, 3.0, 7.2e4])
    assert variant.response_dph([40.0], rates_dph) == pytest.approx(20.0e-6 * np.abs(rates_dph))


def test_what_is_late_and_bent_is_the_difference_of_two_exponentials() -> None:
    """A body 300 s late after a step of 30 K, its bias exponential in temperature: by hand, second by second."""
    n, lag_s, growth = 3_000, 300.0, -1.7
    t_in_c = np.where(np.arange(n) < 600, 20.0, -10.0)
    s = Stimulus(np.arange(1.0, n + 1.0), t_in_c, t_in_c, np.zeros(n + 1), np.zeros(n), 39.1)
    column = effect("thermal_lag").columns(s, {"lag_s": lag_s, "growth": growth})[0]
    body_k = -5.0 - 30.0 * (1.0 - np.exp(-np.maximum(np.arange(n) - 599.0, 0.0) / lag_s))
    inside_k = t_in_c - 25.0
    expected = 50.0 / growth * (np.exp(growth * inside_k / 50.0) - np.exp(growth * body_k / 50.0))
    settled = np.abs(np.arange(n) - 600) > 60  # the thermometer's reading is smoothed over a minute
    assert column[settled] == pytest.approx(expected[settled], abs=0.02 * np.abs(expected).max())
    straight = effect("thermal_lag").columns(s, {"lag_s": lag_s})[0]
    nearly = effect("thermal_lag").columns(s, {"lag_s": lag_s, "growth": 1e-3})[0]
    assert nearly == pytest.approx(straight, abs=1e-3 * np.abs(straight).max())
    assert np.abs(column - straight).max() > 0.2 * np.abs(straight).max()


def test_a_sensitivity_to_warming_may_grow_as_arrhenius_has_it() -> None:
    s = stimulus(9_000)
    straight = effect("shupe_cross").columns(s, {"lag_s": 0.0})[0]
    for growth in (-2.5, 2.5):
        bent = effect("shupe_cross").columns(s, {"lag_s": 0.0, "growth": growth})[0]
        far = np.abs(s.warm_k) > 0.1
        exponent = growth * s.warm_k[far] / 50.0
        assert bent[far] == pytest.approx(np.expm1(exponent) / exponent * straight[far])
    assert effect("shupe_cross").columns(s, {"lag_s": 0.0, "growth": 0.0})[0] == pytest.approx(straight)


def test_no_lag_from_a_minute_to_an_hour_and_a_half_lies_between_the_grids() -> None:
    lags_s = [[shape["lag_s"] for shape in effect(name).shapes] for name in ("thermal_lag", "relaxation")]
    assert min(lags_s[0]) <= 60.0 and max(lags_s[0]) == min(lags_s[1]) and max(lags_s[1]) >= 5400.0


def test_a_scale_factor_that_comes_late_has_all_of_it_or_what_passes() -> None:
    """After a step of T_in at the middle the late part comes as 1 - exp(-t / lag)."""
    n, lag_s = 6_000, 500.0
    t_in_c = np.where(np.arange(n) < n // 2, 25.0, 35.0)
    s = Stimulus(np.arange(1.0, n + 1.0), t_in_c, t_in_c, 20.0 * np.arange(n + 1.0), np.full(n, 90.0), 39.1)
    late = effect("scale_factor_lag")
    came_k = 10.0 * (1.0 - np.exp(-np.maximum(np.arange(n) - n // 2, 0.0) / lag_s))
    for static, expected_k in ((1.0, came_k), (0.0, t_in_c - 25.0 - came_k)):
        ppm_k = late.columns(s, {"lag_s": lag_s, "static": static})[0] / (1e-6 * s.input_rate_dph)
        assert np.abs(ppm_k - expected_k)[np.abs(np.arange(n) - n // 2) > 60].max() < 0.05
    assert late.columns(s, {"lag_s": lag_s})[0] == pytest.approx(
        late.columns(s, {"lag_s": lag_s, "static": 0.0})[0]
    )


def test_earth_rate_constant() -> None:
    assert pytest.approx(math.degrees(7.292115e-5) * 3600.0, rel=1e-7) == EARTH_RATE_DPH


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=70),
    st.floats(0.0, 20.0),
)
def test_a_play_follows_only_when_pushed(values: list[float], half_width: float) -> None:
    """The definition one sample after the other (Visintin, Differential Models of Hysteresis, 1994, ch. III)."""
    follower, expected = values[0], []
    for value in values:
        if value - half_width > follower:
            follower = value - half_width
        elif value + half_width < follower:
            follower = value + half_width
        expected.append(follower)
    assert play(np.array(values), half_width).tolist() == pytest.approx(expected, abs=1e-12)
