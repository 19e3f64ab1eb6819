"""On a clock that runs by itself the wait for a lost port ends: a spinning thread would be taken for hung.

And what becomes of a device that confirms its stop and goes on, or whose port comes back late.
"""

from itertools import pairwise
from unittest.mock import MagicMock

import pytest

from bench.control.safe_state import Reading, bring_to_rest
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
    found = bring_to_rest({"table": device}, clock)
    assert [(name, reading.code) for name, reading in found.items()] == [("table", "port_gone")]
    assert clock.time_s < 120.0 and device.link.reopen.call_count > 3


def test_a_device_that_is_silent_for_half_a_minute_is_told_until_it_listens():
    clock, told = RunningClock(), []

    class Deaf(MagicMock):
        def make_safe(self):
            clock.sleep(2.0)  # its timeout
            if clock.time_s < 30.0:
                raise DeviceSilent("no complete reply within 2 s")

        def read_rest(self):
            rests.append(("table", clock.time_s))
            return Rest(True, {"table": 0.0})

    chamber, rests = MagicMock(), []
    chamber.read_rest.side_effect = lambda: (
        rests.append(("chamber", clock.time_s)) or Rest(True, running=False)
    )
    devices = {"table": Deaf(), "chamber": chamber}
    found = bring_to_rest(devices, clock, away=lambda *what: told.append(what))
    assert [reading.code for reading in found.values()] == [None, None]
    assert [name for name, _ in rests] == ["chamber", "table"]
    assert rests[0][1] < 10.0 and 30.0 < rests[1][1] < 40.0
    assert set(told) == {("table", "not_confirming")}


def test_a_device_that_stays_silent_is_given_up_after_a_minute():
    clock, device = RunningClock(), MagicMock()

    def silent():
        clock.sleep(2.0)
        raise DeviceSilent("no complete reply within 2 s")

    device.make_safe.side_effect = silent
    reading = bring_to_rest({"table": device}, clock)["table"]
    assert reading.code == "silent" and str(reading.error) == "no complete reply within 2 s."
    assert 60.0 < clock.time_s < 75.0


class Braking:
    """A table that brakes at 2 deg/s2 from 100 deg/s from the stop command on that it hears; it confirms each."""

    def __init__(self, clock, *, deaf_to=0, port_back_s=0.0):
        self.clock, self.link = clock, self
        self.deaf_to, self.port_back_s, self.told_s, self.stopped_s = deaf_to, port_back_s, [], None

    def reopen(self):
        if self.clock.time_s < self.port_back_s:
            raise ConfigurationError("the port cannot be opened")

    def halt(self):
        if self.clock.time_s < self.port_back_s:
            raise LinkLost("the port is gone")

    def make_safe(self):
        self.halt()
        self.told_s.append(self.clock.time_s)
        if len(self.told_s) > self.deaf_to and self.stopped_s is None:
            self.stopped_s = self.clock.time_s

    def read_rest(self):
        since_s = 0.0 if self.stopped_s is None else self.clock.time_s - self.stopped_s
        rate_dps = max(100.0 - 2.0 * since_s, 0.0)
        return Rest(rate_dps == 0.0, {"table": rate_dps})


@pytest.mark.parametrize("lost", [1, 2])
def test_a_device_whose_stop_was_lost_though_confirmed_is_told_again_and_comes_to_rest(lost):
    clock = RunningClock()
    table = Braking(clock, deaf_to=lost)
    # 50 s of braking fit into the 60 s only if it is told again soon
    found = bring_to_rest({"table": table}, clock, timeout_s=61.0)
    assert found == {"table": Reading(Rest(True, {"table": 0.0}))}
    assert len(table.told_s) > lost
    assert (
        min(after - before for before, after in pairwise(table.told_s)) > 4.0
    )  # it is not drowned in commands


def test_a_table_whose_port_comes_back_has_the_whole_time_to_brake_from_then_on():
    """Told 15 s late it needs 50 s more: beyond the minute that began when all were told."""
    clock = RunningClock()
    table = Braking(clock, port_back_s=15.0)
    assert bring_to_rest({"table": table}, clock) == {"table": Reading(Rest(True, {"table": 0.0}))}
    assert clock.time_s > 60.0


def test_a_table_that_does_not_stop_after_its_port_came_back_is_given_up_a_minute_later():
    clock = RunningClock()
    table = Braking(clock, deaf_to=1000, port_back_s=15.0)
    reading = bring_to_rest({"table": table}, clock)["table"]
    assert reading.code == "not_at_rest" and reading.rest == Rest(False, {"table": 100.0})
    assert 15.0 + 60.0 < clock.time_s < 15.0 + 62.0
