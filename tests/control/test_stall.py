"""Air that stands away from its set point is told once; air on its way, however slow its ramp, is not."""

import pytest

from bench.control.chamber_station import WINDOW_S, StallDetector


def told(air_at, set_point_c, ramp_k_per_min=None, hours=4.0):
    """Return when and what was told of air that follows `air_at(s)`, looked at every 10 s."""
    detector = StallDetector()
    detector.demand(0.0, set_point_c, ramp_k_per_min)
    detector.run(0.0, True)
    return [
        (time_s, str(stall))
        for time_s in range(0, int(3600 * hours), 10)
        if detector.due(time_s) and (stall := detector.look(air_at(time_s), air_at(time_s - WINDOW_S)))
    ]


def ramp(start_c, end_c, k_per_min, lag_s=0.0):
    sign = 1.0 if end_c > start_c else -1.0
    return lambda s: start_c + sign * min(abs(end_c - start_c), max(s - lag_s, 0.0) * k_per_min / 60.0)


@pytest.mark.parametrize("k_per_min", [0.01, 0.1, 1.0, 12.0])
def test_air_on_its_ramp_is_on_its_way(k_per_min):
    assert told(ramp(25.0, -45.0, k_per_min, lag_s=60.0), -45.0, k_per_min, hours=130) == []


def test_a_slow_chamber_told_no_ramp_is_on_its_way():
    assert told(ramp(25.0, -45.0, 0.3), -45.0) == []


def test_air_that_never_moves_is_told_after_a_quarter_of_an_hour():
    ((time_s, text),) = told(lambda s: 25.0, -45.0)
    assert time_s == WINDOW_S
    assert text.startswith("the air stands at 25.0 degC, 70.0 K from its set point -45 degC, and came 0.0 K")


def test_a_chamber_that_cannot_reach_its_set_point_is_told_once_with_where_it_stands():
    ((time_s, text),) = told(lambda s: 25.0 - 60.0 * (1.0 - 2.0 ** (-s / 600.0)), -45.0)
    # 15 min nearer by 60 * 2^(-s/600) * (2^1.5 - 1) < 1.5 K: s > 3715 s
    assert time_s == 3720
    assert "-34.2 degC, 10.8 K from" in text


def test_air_that_drifts_off_during_a_soak_is_told():
    ((time_s, _),) = told(lambda s: -45.0 if s < 7200 else -45.0 + (s - 7200) / 600.0, -45.0)
    assert 7200 + 1200 <= time_s <= 7200 + 1220  # 2 K off


def test_a_chamber_that_was_stopped_or_told_anew_is_not_judged_by_the_old_demand():
    detector = StallDetector()
    detector.demand(0.0, -45.0, None)
    assert not detector.due(10_000.0)  # never started
    detector.run(100.0, True)
    assert detector.due(100.0 + WINDOW_S)
    detector.demand(500.0, 25.0, None)
    assert not detector.due(100.0 + WINDOW_S)
    detector.run(600.0, False)
    assert not detector.due(10_000.0)
