"""A mapping's units, rules and limits against what they mean, and how messages on a bus are told and named."""

import math

import numpy as np
import pytest

from drivers.base.errors import ConfigurationError
from drivers.can_dbc import CanDecoder, layout_from_mapping, load_layout
from drivers.can_dbc._kind import identifier_names
from drivers.can_dbc._layout import ValidRule
from drivers.can_dbc._signals import MessageLayout
from drivers.can_dbc._values import merged

DBC = """VERSION ""
BU_: A
BO_ 16 ALL: 8 A
 SG_ COUNT : 0|8@1+ (1,0) [0|0] "" A
 SG_ FLAG : 8|1@1+ (1,0) [0|0] "" A
 SG_ X : 16|16@1- (1,0) [0|0] "" A
 SG_ F : 32|16@1- (1,0) [0|0] "" A
 SG_ T : 48|16@1- (1,0) [0|0] "" A
"""
RATE = {"role": "rate", "axis": "x", "message": "ALL", "signal": "X", "unit": "deg/s"}
TURN_DEG, G_MPS2 = 360.0, 9.80665


def signal(role, name, unit="", **keys):
    return {"role": role, "message": "ALL", "signal": name, "unit": unit, **keys}


@pytest.fixture
def layout(tmp_path):
    (tmp_path / "unit.dbc").write_text(DBC)

    def made(*signals, **keys):
        mapping = {"format": 1, "dbc": "unit.dbc", "sample": ["ALL"], "signal": list(signals), **keys}
        return layout_from_mapping(mapping, tmp_path, "map.toml", "unit")

    return made


def line(count=0, flag=0, x=0, f=0, t=0):
    data = bytes([count, flag]) + b"".join(value.to_bytes(2, "little", signed=True) for value in (x, f, t))
    return b"t0108" + data.hex().encode() + b"\r"


@pytest.mark.parametrize(
    ("role", "unit", "column", "worth"),
    [
        ("rate", "deg/s", "rate_x_dps", 1.0),
        ("rate", "rad/s", "rate_x_dps", TURN_DEG / math.tau),
        ("rate", "mrad/s", "rate_x_dps", TURN_DEG / math.tau / 1000),
        ("rate", "deg/h", "rate_x_dps", 1 / 3600),
        ("delta_angle", "deg", "angle_x_deg", 1.0),
        ("delta_angle", "rad", "angle_x_deg", TURN_DEG / math.tau),
        ("delta_angle", "mrad", "angle_x_deg", TURN_DEG / math.tau * 1e-3),
        ("delta_angle", "urad", "angle_x_deg", TURN_DEG / math.tau * 1e-6),
    ],
)
def test_a_rate_or_an_angle_in_every_unit(layout, role, unit, column, worth):
    decoder = CanDecoder(layout(signal(role, "X", unit, axis="x")), 100.0)
    batch = decoder.feed(line(x=-3) + line(x=1000))
    assert batch.columns[column].tolist() == pytest.approx([-3 * worth, 1000 * worth], rel=1e-6)


@pytest.mark.parametrize(
    ("unit", "worth"), [("m/s2", 1.0), ("m/s^2", 1.0), ("g", G_MPS2), ("mg", G_MPS2 / 1000)]
)
def test_an_acceleration_in_every_unit(layout, unit, worth):
    decoder = CanDecoder(layout(RATE, signal("accel", "F", unit, axis="x")), 100.0)
    columns = decoder.feed(line(f=-7)).columns
    assert columns["accelerometer_x_mps2"].tolist() == pytest.approx([-7 * worth], rel=1e-6)


@pytest.mark.parametrize(("unit", "boils"), [("degC", 100), ("K", 373), ("degF", 212)])
def test_a_temperature_in_every_unit(layout, unit, boils):
    columns = CanDecoder(layout(RATE, signal("temperature", "T", unit)), 100.0).feed(line(t=boils)).columns
    assert columns["temp_c"].tolist() == pytest.approx([100.0], abs=0.2)  # 373 K are 99.85 degC


@pytest.mark.parametrize(
    ("unit", "ticks"), [("s", 1), ("ms", 1000), ("100us", 10_000), ("us", 1_000_000), ("ns", 10**9)]
)
def test_a_time_in_every_unit_is_a_counter_of_the_nominal_rate(layout, unit, ticks):
    decoder = CanDecoder(layout(RATE, signal("time", "COUNT", unit)), 2.0)
    assert decoder.counter_step == pytest.approx(ticks / 2.0)
    assert decoder.counter_modulo == 256


def test_a_counter_of_two_values_and_a_step(layout):
    decoder = CanDecoder(layout(RATE, signal("counter", "COUNT", modulo=2)), 100.0)
    assert decoder.counter_modulo == 2 and decoder.counter_step == 1
    decoder = CanDecoder(layout(RATE, signal("counter", "COUNT", step=5)), 100.0)
    assert decoder.counter_modulo == 256 and decoder.counter_step == 5
    for keys in ({"modulo": 1}, {"modulo": 257}, {"modulo": 4, "step": 4}, {"step": 0}, {"healthy": -1}):
        with pytest.raises(ConfigurationError):
            layout(RATE, signal("counter", "COUNT", **keys))


@pytest.mark.parametrize(
    ("signals", "words"),
    [
        ([RATE, signal("delta_angle", "F", "deg", axis="y")], "rates and angle increments"),
        ([RATE, signal("temperature", "T", "degC"), signal("temperature", "F", "K")], "at most one"),
        ([RATE, signal("time", "COUNT", "s"), signal("counter", "FLAG")], "of role time or counter"),
        ([RATE, *[signal("accel", "F", "g", axis="x")] * 2], "accelerations of axes x, x"),
        ([RATE, signal("accel", "F", "g")], "x, y or z"),
        ([RATE, signal("temperature", "T")], "Found: none"),
        ([RATE, signal("temperature", "T", "R")], "'R'"),
    ],
)  # fmt: skip
def test_signals_that_contradict_each_other_are_refused(layout, signals, words):
    with pytest.raises(ConfigurationError) as refused:
        layout(*signals)
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("rule", "flags"),
    [
        ({"signal": "FLAG", "equals": 1}, [False, True, True]),
        ({"signal": "FLAG", "equals": 0}, [True, False, False]),
        ({"signal": "COUNT", "bits": [0, 2]}, [False, False, True]),
        ({"signal": "COUNT", "bits": [0], "good": 0}, [True, False, False]),
        ({"signal": "COUNT", "equals": 5}, [False, False, True]),
    ],
)
def test_a_sample_is_good_when_its_rule_says_so(layout, rule, flags):
    decoder = CanDecoder(layout(RATE, valid=[{"message": "ALL", **rule}]), 100.0)
    batch = decoder.feed(line(0, 0) + line(3, 1) + line(5, 1))
    assert batch.columns["valid"].tolist() == flags
    for bad in ({"signal": "FLAG", "equals": 2}, {"signal": "FLAG", "bits": [-1]}, {"signal": "X"}):
        with pytest.raises(ConfigurationError):
            layout(RATE, valid=[{"message": "ALL", **bad}])


def test_rules_about_one_signal_are_one_unless_they_contradict_each_other():
    low, high = ValidRule("M", "S", 0b01, 0b01), ValidRule("M", "S", 0b10, 0b00)
    opposite, other = ValidRule("M", "S", 0b01, 0b00), ValidRule("M", "R", 0b01, 0b01)
    assert merged([low, high]) == [(low, 0b11, 0b01)]
    assert merged([low, opposite]) == [(low, 0b01, 0b01), (opposite, 0b01, 0b00)]
    assert merged([low, other, high]) == [(low, 0b11, 0b01), (other, 0b01, 0b01)]
    assert merged([low, opposite, high]) == [(low, 0b11, 0b01), (opposite, 0b01, 0b00)]
    assert merged([]) == []


def test_a_mapping_that_is_not_there_says_so_in_the_systems_words(tmp_path):
    with pytest.raises(ConfigurationError) as refused:
        load_layout("none.toml", tmp_path)
    assert refused.value.found == "No such file or directory"
    assert str(tmp_path / "none.toml") in str(refused.value)


def test_identifiers_are_named_as_an_adapter_shows_them():
    names = identifier_names({(0x18F00503, True), (0x7F, False), (0x1, True), (0x7FF, False)})
    assert names == "0x07F, 0x7FF, 0x00000001, 0x18F00503"


def test_a_j1939_message_is_told_by_its_parameter_group_whoever_sends_it():
    """Priority (bits 26 to 28) and source address (the last byte) do not count (SAE J1939-21)."""
    message = MessageLayout("SSI2", 0x0CF02903, True, 8, {}, 0x03FFFF00)
    sent = np.array([0x0CF02903, 0x18F029FE, 0x0CF02A03, 0x0CF12903, 0x0CF02903], np.uint32)
    extended = np.array([True, True, True, True, False])
    assert message.sent_by(sent, extended).tolist() == [True, True, False, False, False]
    exact = MessageLayout("OTHER", 0x10, False, 8, {})
    numbers, kinds = np.array([0x10, 0x10, 0x11], np.uint32), np.array([False, True, False])
    assert exact.sent_by(numbers, kinds).tolist() == [True, False, False]
