"""Limits as data: what is refused before it is sent, what ends a run, and what a bench file may say of it."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bench.control.limits import Reach, between, breaks, check_ramp, check_rules, check_telemetry
from bench.control.ways import check_stops
from bench.record.benchfile import (
    Band,
    ForbiddenState,
    LimitsSection,
    bench_file_from,
    bench_file_text,
    load_bench_file,
)
from drivers.base.errors import ConfigurationError, LimitExceeded
from drivers.kit.config import AxisConfig

BENCH = """
[bench]
name = "b"
latitude_deg = 40.0
[table]
driver = "acutrol3000"
port = "/dev/ttyT0"
[chamber]
driver = "weiss"
port = "/dev/ttyC0"
door_message = "door"
[[gyro]]
name = "fog_1"
driver = "kvh1750"
unit = "F1"
axis = "x"
port = "/dev/ttyG0"
[[limits.forbid]]
name = "spin with the door open"
rate_dps = { above = 0.1 }
door = "open"
[[limits.forbid]]
name = "spin in the cold"
rate_dps = { above = 5.0 }
air_temp_c = { below = -40.0 }
"""


def written(tmp_path, text):
    path = tmp_path / "lab.toml"
    path.write_text(text)
    return load_bench_file(path)


def test_rules_are_read_and_written_back_alike(tmp_path):
    file = written(tmp_path, BENCH)
    assert [rule.text for rule in file.limits.forbid] == [
        "rate_dps above 0.1, door open",
        "rate_dps above 5, air_temp_c below -40",
    ]
    assert written(tmp_path, bench_file_text(file)).model_dump() == file.model_dump()
    assert bench_file_from(file.model_dump(mode="json")).model_dump() == file.model_dump()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('door_message = "door"\n', ""), ["limits.forbid[0].door", "chamber.door_message"]),
        (('door = "open"', 'dor = "open"'), ["limits.forbid[0].dor", "door"]),
        (('door = "open"', 'door = "ajar"'), ["limits.forbid[0].door", "'open' or 'closed'"]),
        (("{ above = 5.0 }", "{ }"), ["limits.forbid[1].rate_dps", "above = number"]),
        (("{ above = 5.0 }", "{ above = nan }"), ["limits.forbid[1].rate_dps.above"]),
        (("{ above = 5.0 }", '"__import__(1)"'), ["limits.forbid[1].rate_dps"]),
        (('rate_dps = { above = 0.1 }\ndoor = "open"\n', ""), ["limits.forbid[0]"]),
    ],
)
def test_a_rule_that_cannot_be_used_is_named(tmp_path, change, words):
    with pytest.raises(ConfigurationError) as refused:
        written(tmp_path, BENCH.replace(*change))
    assert all(word in str(refused.value) for word in words), refused.value


def reach(rate=0.0, angle=0.0, air=20.0, set_point=20.0, aux=(), door=False):
    def interval(value):
        return value if isinstance(value, tuple) else (value, value)

    return Reach(
        interval(rate), interval(angle), interval(air), interval(set_point), tuple(map(interval, aux)), door
    )


COLD = ForbiddenState(name="c", rate_dps=Band(above=5.0), air_temp_c=Band(below=-40.0))


@pytest.mark.parametrize(
    ("state", "broken"),
    [
        (reach(rate=6.0, air=-41.0), True),
        (reach(rate=5.0, air=-41.0), False),
        (reach(rate=6.0, air=-40.0), False),
        (reach(rate=6.0, air=(-50.0, 20.0)), True),
        (reach(rate=(0.0, 6.0), air=(-40.0, 20.0)), False),
        (reach(rate=math.nan, air=-50.0), False),
    ],
)
def test_a_rule_breaks_only_if_all_of_it_can_be_true(state, broken):
    assert breaks(COLD, state) is broken


def test_any_auxiliary_sensor_and_the_door_count():
    rule = ForbiddenState(name="a", aux_temp_c=Band(above=60.0, below=80.0), door="open")
    assert breaks(rule, reach(aux=(20.0, 70.0), door=True))
    assert not breaks(rule, reach(aux=(20.0, 70.0), door=False))
    assert not breaks(rule, reach(aux=(20.0, 85.0), door=True))
    assert not breaks(rule, reach(aux=(), door=True))


@given(
    low=st.floats(-100, 100),
    width=st.floats(0, 50),
    at=st.floats(0, 1),
    above=st.one_of(st.none(), st.floats(-100, 100)),
    below=st.floats(-100, 100),
)
def test_an_interval_breaks_a_rule_whenever_a_value_in_it_does(low, width, at, above, below):
    """What is refused before a command covers everything that telemetry could find after it."""
    rule = ForbiddenState(name="r", air_temp_c=Band(above=above, below=below))
    value = min(low + at * width, low + width)
    if breaks(rule, reach(air=value)):
        assert breaks(rule, reach(air=between(low, low + width)))


@pytest.mark.parametrize(
    ("low", "high", "angle", "beyond"),
    [
        (-170.0, 170.0, 0.0, False),
        (-170.0, 170.0, 359.0, False),
        (-170.0, 170.0, 180.0, True),
        (-170.0, 170.0, -170.4, False),
        (350.0, 360.0, 355.0, False),
        (350.0, 360.0, 5.0, True),
        (10.0, 20.0, 375.0, False),
        (-180.0, 180.0, 123.0, False),
    ],
)
def test_stops_are_an_arc_modulo_a_turn(low, high, angle, beyond):
    axis = AxisConfig(name="tilt", number=1, direction="up", min_angle_deg=low, max_angle_deg=high)
    if not beyond:
        check_stops(axis, angle, "table")
        return
    with pytest.raises(LimitExceeded, match="beyond its stops"):
        check_stops(axis, angle, "table")


def test_the_air_may_not_change_faster_than_the_ramp_by_a_fifth():
    limits = LimitsSection(max_ramp_k_per_min=5.0)
    check_ramp(limits, -11.9, 120.0)
    for change_k in (12.1, -12.1):
        with pytest.raises(LimitExceeded, match=r"6\.0|6\.1 K/min"):
            check_ramp(limits, change_k, 120.0)


@given(
    low=st.floats(-360, 10),
    width=st.floats(1, 350),
    outside_deg=st.floats(-3, 3),
    turns=st.integers(-2, 2),
    above=st.booleans(),
)
def test_half_a_degree_beyond_either_stop_is_allowed_and_no_more(low, width, outside_deg, turns, above):
    """By the distance from the middle of the arc, which has no side and no turn."""
    axis = AxisConfig(name="tilt", number=1, direction="up", min_angle_deg=low, max_angle_deg=low + width)
    angle_deg = (low + width + outside_deg if above else low - outside_deg) + 360.0 * turns
    beyond_deg = abs(math.remainder(angle_deg - low - 0.5 * width, 360.0)) - 0.5 * width
    assume(abs(beyond_deg - 0.5) > 1e-6)
    if beyond_deg < 0.5:
        check_stops(axis, angle_deg, "table")
    else:
        with pytest.raises(LimitExceeded, match="beyond its stops"):
            check_stops(axis, angle_deg, "table")


def test_a_twentieth_of_rate_and_ten_kelvin_beyond_the_limits_are_allowed_and_no_more():
    limits = LimitsSection(max_rate_dps=20.0, min_temp_c=-60.0, max_temp_c=85.0)
    for rate_dps, air_c in ((21.0, 20.0), (-21.0, 20.0), (0.0, -70.0), (0.0, 95.0)):
        check_telemetry(limits, rate_dps, air_c)
    for rate_dps, found in ((21.001, "21.001 deg/s"), (-21.001, "-21.001 deg/s"), (math.inf, "inf deg/s")):
        with pytest.raises(LimitExceeded, match="turns faster") as refused:
            check_telemetry(limits, rate_dps, 20.0)
        assert (refused.value.where, refused.value.found) == ("table", found)
        assert "at most 20 deg/s" in refused.value.expected
    for air_c, found in ((-70.1, "-70.1 degC"), (95.1, "95.1 degC"), (math.nan, "nan degC")):
        with pytest.raises(LimitExceeded, match="outside the allowed range") as refused:
            check_telemetry(limits, 0.0, air_c)
        assert (refused.value.where, refused.value.found) == ("chamber", found)
        assert refused.value.expected == "-60 .. 85 degC within 10 K"


def test_a_ramp_that_is_faster_by_exactly_a_fifth_is_allowed():
    limits = LimitsSection(max_ramp_k_per_min=5.0)
    check_ramp(limits, 12.0, 120.0)
    check_ramp(limits, -3.0, 30.0)
    with pytest.raises(LimitExceeded) as refused:
        check_ramp(limits, -3.1, 30.0)
    assert refused.value.found == "6.2 K/min over 30 s"
    assert "at most 5 K/min" in refused.value.expected


def test_a_rule_is_named_with_what_was_found_and_what_to_do():
    limits = LimitsSection(forbid=(COLD,))
    check_rules(limits, reach(rate=5.0, air=-41.0), "found", "remedy")
    with pytest.raises(LimitExceeded, match="forbidden on this bench: c") as refused:
        check_rules(limits, reach(rate=6.0, air=-41.0), "6 deg/s", "warm up")
    assert (refused.value.found, refused.value.remedy) == ("6 deg/s", "warm up")
    assert refused.value.expected == "never together: rate_dps above 5, air_temp_c below -40"


@pytest.mark.parametrize(
    ("quantity", "inside", "outside"),
    [
        ("rate_dps", {"rate": 6.0}, {"rate": 4.0}),
        ("angle_deg", {"angle": 6.0}, {"angle": 4.0}),
        ("air_temp_c", {"air": 6.0}, {"air": 4.0}),
        ("set_point_c", {"set_point": 6.0}, {"set_point": 4.0}),
        ("aux_temp_c", {"aux": (4.0, 6.0)}, {"aux": (4.0, 4.5)}),
    ],
)
def test_each_quantity_has_its_condition(quantity, inside, outside):
    rule = ForbiddenState(name="r", **{quantity: Band(above=5.0)})
    elsewhere = {"rate": 0.0, "angle": 0.0, "air": 0.0, "set_point": 0.0, "aux": (0.0,)}
    assert breaks(rule, reach(**elsewhere | inside))
    assert not breaks(rule, reach(**elsewhere | outside))


def test_a_rule_for_a_closed_door_holds_while_it_is_closed():
    rule = ForbiddenState(name="d", door="closed", rate_dps=Band(below=1.0))
    assert breaks(rule, reach(door=False)) and not breaks(rule, reach(door=True))
    assert breaks(ForbiddenState(name="n", rate_dps=Band(below=1.0)), reach(door=True))


def test_an_axis_without_stops_or_with_a_whole_turn_has_none_to_be_beyond():
    for low, high in ((None, None), (-180.0, 180.0), (-179.5, 179.5)):
        axis = AxisConfig(name="tilt", number=1, direction="up", min_angle_deg=low, max_angle_deg=high)
        for angle_deg in (-180.0, 0.0, 180.0, 1234.5):
            check_stops(axis, angle_deg, "table")
    axis = AxisConfig(name="tilt", number=1, direction="up", min_angle_deg=-170.0, max_angle_deg=160.0)
    with pytest.raises(LimitExceeded) as refused:
        check_stops(axis, 161.0, "outer")
    assert (refused.value.where, refused.value.found) == ("outer", "161.000 deg")
    assert refused.value.expected == "-170 .. 160 deg (bench file)"
