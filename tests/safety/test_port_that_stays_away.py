"""On a clock that runs by itself the wait for a lost port ends: a spinning thread would be taken for hung."""

from unittest.mock import MagicMock

from bench.control.safe_state import bring_to_rest
from drivers.base.errors import ConfigurationError, DeviceSilent, LinkLost
from drivers.kit.instruments import Rest


class RunningClock:
    """Time goes on with every look at it, as on a wall clock."""

    def __init__(self):
        self.time_s, self.looks = 0.0, 0

    def now(self):
        self.looks += 1
        assert self.looks < 20_000, "it spins"
        self.time_s += 1e-6
        return self.time_s

    def sleep(self, duration_s):
        self.time_s += max(duration_s, 0.0)


def test_a_port_that_stays_away_is_given_up_and_named():
    device = MagicMock()
    device.halt.side_effect = device.make_safe.side_effect = LinkLost("the port is gone")
    device.link.reopen.side_effect = ConfigurationError("the port cannot be opened")
    clock = RunningClock()
    left = bring_to_rest({"table": device}, clock, lambda name, text: None)
    assert [text.partition(":")[0] for text in left] == ["table"]
    assert clock.time_s < 120.0 and device.link.reopen.call_count > 3


def test_a_device_that_is_silent_for_half_a_minute_is_told_until_it_listens():
    clock, told = RunningClock(), []

    class Deaf(MagicMock):
        def make_safe(self):
            clock.sleep(2.0)  # its timeout
            if clock.time_s < 30.0:
                raise DeviceSilent("no complete reply within 2 s")

        def read_rest(self):
            return Rest(True, "0 deg/s")

    chamber = MagicMock()
    chamber.read_rest.return_value = Rest(True, "stopped")
    devices, rests = {"table": Deaf(), "chamber": chamber}, []
    left = bring_to_rest(
        devices,
        clock,
        lambda name, text: rests.append((name, clock.time_s)),
        away=lambda *what: told.append(what),
    )
    assert left == {}
    assert [name for name, _ in rests] == ["chamber", "table"]
    assert rests[0][1] < 10.0 and 30.0 < rests[1][1] < 40.0
    assert set(told) == {("table", "it does not confirm its stop")}


def test_a_device_that_stays_silent_is_given_up_after_a_minute():
    clock, device = RunningClock(), MagicMock()

    def silent():
        clock.sleep(2.0)
        raise DeviceSilent("no complete reply within 2 s")

    device.make_safe.side_effect = silent
    left = bring_to_rest({"table": device}, clock, lambda name, text: None)
    assert left == {"table": "no complete reply within 2 s."}
    assert 60.0 < clock.time_s < 75.0
