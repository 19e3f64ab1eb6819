"""When each thing on the way to the safe state happens: commands, read-backs, further tries, and their end."""

import itertools

import pytest

from bench.control.safe_state import Reading, bring_to_rest
from drivers.base.errors import (
    ConfigurationError,
    DeviceRefused,
    DeviceSilent,
    LinkLost,
    ProtocolError,
)
from drivers.kit.instruments import Rest

AT_REST = Rest(True, {"table": 0.0})
TURNING = Rest(False, {"table": 30.0})


class Clock:
    """Time passes by sleeping only, in whole ms; sleeping may meet losses of ports."""

    def __init__(self, losses=0):
        self.ms, self.losses, self.slept = 0, losses, 0

    def now(self):
        return self.ms / 1000

    def sleep(self, duration_s):
        self.slept += 1
        if self.losses:
            self.losses -= 1
            raise LinkLost("the port is gone", where="fog_1")
        self.ms += max(0, round(1000 * duration_s))


class Device:
    """Says of each call when it came; each may be given what it raises or returns, call by call."""

    def __init__(self, clock, **answers):
        self.clock, self.answers, self.link = clock, answers, self
        self.calls = {name: [] for name in ("halt", "make_safe", "read_rest", "reopen")}

    def _call(self, name):
        self.calls[name].append(self.clock.ms)
        answers = self.answers.get(name, [AT_REST])
        answer = answers.pop(0) if len(answers) > 1 else answers[0]
        if isinstance(answer, Exception):
            raise answer
        return answer

    def halt(self):
        self._call("halt")

    def make_safe(self):
        self._call("make_safe")

    def read_rest(self):
        return self._call("read_rest")

    def reopen(self):
        self._call("reopen")


def steps(times_ms):
    return {later - sooner for sooner, later in itertools.pairwise(times_ms)}


def test_two_devices_at_rest_are_told_once_and_read_back_after_a_fifth_of_a_second():
    clock = Clock()
    devices = {"table": Device(clock), "chamber": Device(clock)}
    assert bring_to_rest(devices, clock) == {"table": Reading(AT_REST), "chamber": Reading(AT_REST)}
    assert devices["table"].calls == {"halt": [0], "make_safe": [0], "read_rest": [200], "reopen": []}
    assert devices["chamber"].calls["read_rest"] == [400]


def test_a_silent_device_is_told_three_times_at_once_and_every_two_seconds_for_a_minute():
    clock, told = Clock(), []
    silent = Device(clock, make_safe=[DeviceSilent("no reply")])
    other = Device(clock)
    found = bring_to_rest(
        {"table": silent, "chamber": other}, clock, away=lambda *what: told.append((clock.ms, *what))
    )
    assert [(name, reading.code) for name, reading in found.items()] == [
        ("chamber", None),
        ("table", "silent"),
    ]
    tries_ms = silent.calls["make_safe"]
    assert tries_ms[:3] == [0, 200, 400] and silent.calls["halt"] == [0] and silent.calls["read_rest"] == []
    assert steps(tries_ms[3:]) == {2000} and tries_ms[3] == 400 + 200 + 2000
    assert 60_400 <= tries_ms[-1] < 60_400 + 2000
    assert told == [(when_ms, "table", "not_confirming") for when_ms in [400, *tries_ms[3:]]]


def test_a_device_that_confirms_at_the_third_try_was_never_told_of():
    clock, told = Clock(), []
    device = Device(clock, make_safe=[DeviceRefused("no"), DeviceSilent("no reply"), None])
    assert bring_to_rest({"table": device}, clock, away=lambda *what: told.append(what)) == {
        "table": Reading(AT_REST)
    }
    assert device.calls["make_safe"] == [0, 200, 400] and device.calls["read_rest"] == [600] and told == []


def test_a_port_that_is_away_is_looked_for_twice_a_second_for_twenty_seconds():
    clock, told = Clock(), []
    gone = LinkLost("the port is gone")
    device = Device(clock, halt=[gone], make_safe=[gone], reopen=[ConfigurationError("no such port")])
    reading = bring_to_rest({"table": device}, clock, away=lambda *what: told.append((clock.ms, *what)))
    assert reading["table"].code == "port_gone"
    looks_ms = device.calls["reopen"]
    assert looks_ms == list(range(0, 20_001, 500))
    assert device.calls["make_safe"] == [0]
    assert told == [(when_ms, "table", "port_gone") for when_ms in [0, *looks_ms]]


def test_a_port_that_comes_back_is_told_at_once_and_read_back():
    clock = Clock()
    gone, away = LinkLost("the port is gone"), ConfigurationError("no such port")
    device = Device(clock, halt=[gone, gone, None], make_safe=[gone, None], reopen=[away, away, None])
    assert bring_to_rest({"table": device}, clock) == {"table": Reading(AT_REST)}
    assert device.calls["reopen"] == [0, 500, 1000]
    assert device.calls["make_safe"] == [0, 1000] and device.calls["read_rest"] == [1200]


def test_a_device_that_refuses_once_its_port_is_back_may_be_at_rest_all_the_same():
    clock = Clock()
    gone, no = LinkLost("the port is gone"), DeviceRefused("no")
    device = Device(clock, halt=[gone, gone, None], make_safe=[gone, no], reopen=[None])
    assert bring_to_rest({"table": device}, clock) == {"table": Reading(AT_REST)}


def test_a_port_that_goes_away_again_is_looked_for_again():
    clock = Clock()
    gone = LinkLost("the port is gone")
    device = Device(clock, halt=[gone, gone, gone, None], make_safe=[gone, gone, None], reopen=[None, None])
    assert bring_to_rest({"table": device}, clock) == {"table": Reading(AT_REST)}
    assert device.calls["reopen"] == [0, 500]


def test_a_device_that_turns_on_is_asked_five_times_a_second_and_stopped_every_five_seconds():
    clock = Clock()
    device = Device(clock, read_rest=[TURNING])
    reading = bring_to_rest({"table": device}, clock)["table"]
    assert (reading.code, reading.rest) == ("not_at_rest", TURNING)
    assert reading.error.found == "30.0000 deg/s" and reading.error.expected == "a device at rest"
    reads_ms = device.calls["read_rest"]
    assert (steps(reads_ms) == {200} and reads_ms[0] == 200 and reads_ms[-1] == 60_000) or reads_ms[
        -1
    ] == 60_400
    again_ms = device.calls["make_safe"][1:]
    assert again_ms == device.calls["halt"][1:]
    assert again_ms == list(range(5000, 60_001, 5000))


@pytest.mark.parametrize(
    "error", [ProtocolError("no sense", found="???"), DeviceSilent("no reply", found="nothing")]
)
def test_an_answer_that_makes_no_sense_is_asked_for_again_and_told_in_the_end(error):
    clock = Clock()
    device = Device(clock, read_rest=[TURNING, error])
    reading = bring_to_rest({"table": device}, clock)["table"]
    assert (reading.code, reading.rest, reading.error.found) == ("not_at_rest", None, error.found)
    clock = Clock()
    device = Device(clock, read_rest=[error, error, AT_REST])
    assert bring_to_rest({"table": device}, clock) == {"table": Reading(AT_REST)}


@pytest.mark.parametrize(
    ("error", "code"),
    [(DeviceRefused("no"), "refused"), (ProtocolError("no sense"), "garbled"), (DeviceSilent("x"), "silent")],
)
def test_what_a_device_answered_is_a_code(error, code):
    clock = Clock()
    assert bring_to_rest({"table": Device(clock, make_safe=[error])}, clock)["table"].code == code


@pytest.mark.parametrize("call", ["make_safe", "read_rest"])
def test_sixteen_other_ports_may_go_away_while_a_device_is_stopped(call):
    """Each loss is met by whoever waits; a stop command that still can be written says that it is another's."""
    other = LinkLost("the port is gone", where="fog_1")
    clock = Clock()
    device = Device(clock, **{call: [*[other] * 16, AT_REST]})
    assert bring_to_rest({"table": device}, clock) == {"table": Reading(AT_REST)}
    assert device.calls["reopen"] == []
    clock = Clock()
    device = Device(clock, **{call: [*[other] * 17, AT_REST]})
    bring_to_rest({"table": device}, clock)
    assert len(device.calls["reopen"]) == 1


def test_a_pause_is_kept_though_other_ports_go_away_meanwhile():
    clock = Clock(losses=3)
    device = Device(clock)
    assert bring_to_rest({"table": device}, clock) == {"table": Reading(AT_REST)}
    assert device.calls["read_rest"] == [200] and clock.slept == 4


def test_a_refusal_of_a_stop_command_does_not_make_a_port_gone():
    clock = Clock()
    other = LinkLost("the port is gone", where="fog_1")
    device = Device(clock, halt=[None, DeviceSilent("busy")], make_safe=[other, None])
    assert bring_to_rest({"table": device}, clock) == {"table": Reading(AT_REST)}
    assert device.calls["reopen"] == []


def test_on_a_clock_that_stands_still_nobody_waits_for_what_cannot_come():
    """The lab behind a virtual clock is gone: sleeping changes nothing."""
    clock = Clock()
    clock.sleep = lambda duration_s: None
    gone = LinkLost("the port is gone")
    devices = {
        "table": Device(clock, make_safe=[DeviceSilent("no reply")]),
        "chamber": Device(clock, halt=[gone], make_safe=[gone], reopen=[ConfigurationError("no such port")]),
    }
    found = bring_to_rest(devices, clock)
    assert {name: reading.code for name, reading in found.items()} == {
        "table": "silent",
        "chamber": "port_gone",
    }
    assert len(devices["table"].calls["make_safe"]) == 4 and len(devices["chamber"].calls["reopen"]) == 1
