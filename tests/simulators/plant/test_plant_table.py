"""The table axis against closed forms of its profile and a numerical integration of its servo."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from simulators.plant.table import Swing, TableAxis, TableParameters

PLAIN = TableParameters(ripple_once_ppm=0.0, ripple_twice_ppm=0.0, encoder_error_arcsec=0.0)
W = 2.0 * math.pi * PLAIN.servo_bandwidth_hz
A = PLAIN.max_acceleration_dps2


def ready(parameters: TableParameters = PLAIN) -> TableAxis:
    table = TableAxis(parameters)
    table.servo(0.0, True)
    return table


def test_rate_is_reached_after_rate_over_acceleration_plus_the_lag() -> None:
    table = ready()
    table.demand_rate(1.0, 100.0)
    ramp_s = 100.0 / A
    # on the ramp, behind by the servo's 2/w once its transient is gone
    assert table.rate_dps(1.0 + 0.9 * ramp_s) == pytest.approx(A * (0.9 * ramp_s - 2.0 / W), rel=1e-3)
    assert table.rate_dps(1.0 + ramp_s) < 100.0
    assert table.rate_dps(1.0 + ramp_s + 20.0 / W) == pytest.approx(100.0, rel=1e-6)
    assert not table.settled(1.0 + ramp_s)
    assert table.settled(1.0 + ramp_s + 21.0 / W)


def test_angle_after_spin_up_is_the_integral_of_the_profile() -> None:
    table = ready()
    table.demand_rate(0.0, -20.0)
    t = 3600.0
    expected = -20.0 * (t - 0.5 * 20.0 / A - 2.0 / W)
    assert table.total_angle_deg(t) == pytest.approx(expected, abs=1e-8)
    assert table.angle_deg(t) == pytest.approx(expected % 360.0, abs=1e-8)


def test_servo_equals_numerical_integration_of_its_equation() -> None:
    table = ready()
    table.demand_rate(0.0, 150.0)
    table.demand_rate(0.3, -60.0)
    table.demand_angle(1.1, 12.0)
    follows_its_reference(table)


def follows_its_reference(table: TableAxis) -> None:
    """The servo from 0 to 4 s is the numerical solution of w^2/(s + w)^2 on the axis' reference."""

    def equation(t: float, y: np.ndarray) -> list[float]:
        angle, _ = table._reference(t)
        return [y[1], W * W * (angle - y[0]) - 2.0 * W * y[1]]

    times = np.linspace(0.0, 4.0, 401)
    solved = solve_ivp(equation, (0.0, 4.0), [0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-9, max_step=0.01)
    np.testing.assert_allclose(table.total_angles_deg(times), solved.y[0], atol=1e-5)
    np.testing.assert_allclose([table.rate_dps(t) for t in times], solved.y[1], atol=1e-3)
    slopes = [(table.rate_dps(t + 1e-6) - table.rate_dps(t)) * 1e6 for t in times]
    np.testing.assert_allclose([table.acceleration_dps2(t) for t in times], slopes, atol=0.05)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from(["rate", "angle"]), st.floats(-500.0, 500.0), st.floats(0.01, 5.0)),
        min_size=1,
        max_size=6,
    )
)
def test_any_sequence_of_demands_is_smooth_within_limits_and_arrives(
    demands: list[tuple[str, float, float]],
) -> None:
    table = ready()
    now = 0.0
    for kind, value, wait in demands:
        before = table.total_angle_deg(now), table.rate_dps(now)
        (table.demand_rate if kind == "rate" else table.demand_angle)(now, value)
        assert table.total_angle_deg(now) == pytest.approx(before[0], abs=1e-6)
        assert table.rate_dps(now) == pytest.approx(before[1], abs=1e-6)
        now += wait
    times = np.linspace(0.0, now + 30.0, 2000)
    rates = np.array([table.rate_dps(t) for t in times])
    assert np.abs(rates).max() <= PLAIN.max_rate_dps * (1.0 + 1e-9)
    assert np.abs(np.diff(rates)).max() <= A * (times[1] - times[0]) * (1.0 + 1e-6) + 1e-9
    kind, value, _ = demands[-1]
    if kind == "rate":
        assert table.rate_dps(times[-1]) == pytest.approx(value, abs=1e-9)
    else:
        assert abs(math.remainder(table.angle_deg(times[-1]) - value, 360.0)) < 1e-6
        assert table.rate_dps(times[-1]) == 0.0


def test_array_and_scalar_angles_agree() -> None:
    table = ready(TableParameters())
    table.demand_rate(0.5, 40.0)
    table.demand_angle(3.0, 10.0)
    times = np.linspace(0.0, 10.0, 1001)
    expected = [table.total_angle_deg(t) for t in times]
    np.testing.assert_allclose(table.total_angles_deg(times), expected, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("start", "target", "moved"), [(350.0, 10.0, 20.0), (10.0, 350.0, -20.0), (0.0, 179.0, 179.0)]
)
def test_position_mode_takes_the_shortest_path(start: float, target: float, moved: float) -> None:
    table = ready()
    table.demand_angle(0.0, start)
    at = table.total_angle_deg(60.0)
    table.demand_angle(60.0, target)
    assert table.total_angle_deg(120.0) - at == pytest.approx(moved, abs=1e-6)


def test_position_move_takes_the_time_optimal_profile() -> None:
    table = ready(replace(PLAIN, max_rate_dps=50.0))
    table.demand_angle(0.0, 90.0)
    # trapezoid: 90/50 s at the rate limit and 50/200 s for the two ramps
    end = 90.0 / 50.0 + 50.0 / A
    assert not table.settled(end)
    assert table.settled(end + 21.0 / W)
    assert table.rate_dps(0.5 * end) == pytest.approx(50.0, rel=1e-6)


def test_a_turn_keeps_the_rate_limit_it_is_given() -> None:
    table = ready()
    table.demand_angle(0.0, 90.0, 20.0)
    end = 90.0 / 20.0 + 20.0 / A
    assert not table.settled(end)
    assert table.settled(end + 21.0 / W)
    assert max(table.rate_dps(t) for t in np.linspace(0.0, end, 500)) == pytest.approx(20.0, rel=1e-6)
    assert table.total_angle_deg(end + 2.0) == pytest.approx(90.0, abs=1e-6)


def test_a_turn_from_a_faster_spin_does_not_jump() -> None:
    table = ready()
    table.demand_rate(0.0, 100.0)
    table.demand_angle(10.0, 0.0, 20.0)
    times = np.linspace(9.9, 40.0, 6000)
    rates = np.array([table.rate_dps(t) for t in times])
    assert np.abs(np.diff(rates)).max() <= A * (times[1] - times[0]) * (1.0 + 1e-6)
    assert rates[-1] == 0.0
    assert abs(math.remainder(table.angle_deg(times[-1]), 360.0)) < 1e-6


def test_open_servo_coasts_to_rest_and_ignores_demands() -> None:
    table = ready()
    table.demand_rate(0.0, 100.0)
    table.servo(10.0, False)
    table.demand_rate(10.0, 300.0)
    coast_s = 100.0 / PLAIN.coast_deceleration_dps2
    assert 0.0 < table.rate_dps(10.0 + 0.8 * coast_s) < 100.0
    assert table.rate_dps(10.0 + coast_s + 2.0) == 0.0
    before, after = table.total_angle_deg(10.0 + coast_s + 2.0), table.total_angle_deg(10.0)
    assert before - after == pytest.approx(0.5 * 100.0 * coast_s + 100.0 * 2.0 / W, rel=1e-6)


def test_closing_a_closed_servo_changes_nothing() -> None:
    table = ready()
    table.demand_rate(0.0, 30.0)
    table.servo(5.0, True)
    assert table.rate_dps(20.0) == pytest.approx(30.0)


def test_ripple_is_periodic_in_angle_with_its_amplitude() -> None:
    table = ready(TableParameters(ripple_once_ppm=50.0, ripple_twice_ppm=0.0))
    table.demand_rate(0.0, 20.0)
    times = np.arange(100.0, 136.0, 0.01)
    rates = np.array([table.rate_dps(t) for t in times])
    assert rates.max() / 20.0 - 1.0 == pytest.approx(50e-6, rel=1e-3)
    assert rates.mean() == pytest.approx(20.0, rel=1e-7)
    numeric = np.diff(table.total_angles_deg(times)) / 0.01
    np.testing.assert_allclose(numeric, 0.5 * (rates[1:] + rates[:-1]), rtol=2e-7)


def test_a_growing_swing_after_a_move_is_the_answer_of_the_servo() -> None:
    table = ready()
    table.demand_angle(0.0, 3.0)
    rest, centre = table.rest(0.1)
    assert (rest, centre) == pytest.approx((2.0 * math.sqrt(3.0 / A), 3.0))
    table.demand_swing(
        0.1, [(1.5, Swing(0.0, 4.0, 2.0, 0.4)), (0.0, Swing(6.0, 0.0, 1.0, 0.4 + 6.0 * math.pi))]
    )
    assert table.rest(0.1) == (rest, centre) and table.rest(rest + 0.3) == (rest + 0.3, centre)
    follows_its_reference(table)
    # steady: |H| = 1 / (1 + (f/f0)^2) about the angle it was sent to, with a lag of 2 atan(f/f0)
    size, lag = 6.0 / (1.0 + 0.2**2), 2.0 * math.atan(0.2)
    for t in (8.0, 8.2, 8.7):
        expected = 3.0 + size * math.sin(2.0 * math.pi * (t - rest - 1.5) + 0.4 - lag)
        assert table.total_angle_deg(t) == pytest.approx(expected, abs=1e-9)
    assert len(table.total_angles_deg(np.linspace(8.0, 9.0, 5))) == 5


def test_a_swing_that_changes_and_ends_has_no_step_in_angle_and_rate() -> None:
    table = ready()
    table.demand_swing(0.0, [(1.0, Swing(0.0, 5.0, 1.0, 0.0)), (0.0, Swing(5.0, 0.0, 1.0, 2.0 * math.pi))])
    for change_s, demand in (
        (1.6, lambda at: table.demand_swing(at, [(0.0, Swing(1.0, 0.0, 3.0, 0.2))])),
        (2.3, lambda at: table.demand_rate(at, 40.0)),
    ):
        before = table.total_angle_deg(change_s), table.rate_dps(change_s)
        demand(change_s)
        assert (table.total_angle_deg(change_s), table.rate_dps(change_s)) == pytest.approx(before, abs=1e-9)
    assert table.rate_dps(9.0) == pytest.approx(40.0)
    table.servo(9.0, False)
    table.demand_swing(9.0, [(0.0, Swing(1.0, 0.0, 3.0, 0.2))])
    assert table.rate_dps(30.0) == 0.0


def test_states_are_followed_and_braked_from_where_they_end() -> None:
    table = ready()
    for k in range(400):
        t = 0.01 * k
        sine, cosine = math.sin(2.0 * t), math.cos(2.0 * t)
        table.demand_states(t, (360.0 + 5.0 * sine, 10.0 * cosine, -20.0 * sine), 0.015)
    # the servo lags by 2/w; between vectors the reference is their parabola
    assert table.total_angle_deg(3.99) == pytest.approx(5.0 * math.sin(2.0 * (3.99 - 2.0 / W)), abs=0.03)
    held, rate = 3.99 + 0.015, 10.0 * math.cos(7.98) - 20.0 * math.sin(7.98) * 0.015
    assert table.settled(held + abs(rate) / A + 21.0 / W) and not table.settled(held)
    assert table.total_angle_deg(9.0) == pytest.approx(
        5.0 * math.sin(2.0 * held) + rate * abs(rate) / (2.0 * A), abs=1e-4
    )


@pytest.mark.parametrize("shortest", [True, False])
def test_states_far_away_are_travelled_to_within_the_limits(shortest: bool) -> None:
    table = ready()
    for k in range(700):
        table.demand_states(0.01 * k, (300.0, 0.0, 0.0), 0.02, 50.0, 100.0, shortest=shortest)
        assert abs(table.rate_dps(0.01 * k + 0.01)) <= 50.0 + 1e-9
    # at 100 deg/s2 to 50 deg/s, and back
    for k in range(100, 550 if not shortest else 100, 50):
        assert table.rate_dps(0.01 * k) == pytest.approx(50.0)
    assert table.total_angle_deg(9.0) == pytest.approx(-60.0 if shortest else 300.0, abs=1e-6)


def test_a_way_to_states_far_away_ends_with_their_hold() -> None:
    table = ready()
    table.demand_states(0.0, (120.0, 0.0, 0.0), 0.5, 50.0, 20.0)
    # half a second at 20 deg/s2, and as long to brake
    assert table.total_angle_deg(5.0) == pytest.approx(20.0 * 0.5**2, abs=1e-9)


def test_states_without_an_end_are_held_up_to_the_rate_limit() -> None:
    table = ready()
    table.demand_states(0.0, (0.0, 10.0, 5.0), math.inf, 30.0)
    assert table.rate_dps(2.0) == pytest.approx(10.0 + 5.0 * (2.0 - 2.0 / W), rel=1e-9)
    assert table.rate_dps(100.0) == pytest.approx(30.0)
    table.demand_states(100.0, (table.total_angle_deg(100.0), 12.0, 0.0), math.inf)
    assert table.rate_dps(1000.0) == pytest.approx(12.0) and table.settled(1000.0)


def test_an_axis_that_stands_still_has_its_angle_twice() -> None:
    table = ready()
    times = np.linspace(5.0, 6.0, 100)
    assert table.total_angles_deg(times).tolist() == [0.0, 0.0]
    table.demand_angle(7.0, 1.0)
    arrived, _ = table.rest(7.0)
    assert len(table.total_angles_deg(arrived + times - 5.0)) == 100  # its transient is 40 / w long
    assert table.total_angles_deg(arrived + 41.0 / W + times - 5.0) == pytest.approx([1.0, 1.0])
    table.demand_rate(20.0, 1.0)
    assert len(table.total_angles_deg(times + 25.0)) == 100
