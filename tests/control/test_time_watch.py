"""Time that passes over the bench unseen is told, and by limit makes the run invalid or ends it."""

from types import SimpleNamespace

import pytest

from bench.control import time_watch
from bench.control.time_watch import TimeWatch
from drivers.base.clock import WallClock, host_offsets
from drivers.base.errors import RunAborted

pytestmark = pytest.mark.concurrent


class Host:
    """A computer whose three clocks are set by hand; each is bench time at first."""

    def __init__(self):
        self.now_s, self.date_s, self.boot_s, self.told = 0.0, 1.7e9, 5000.0, []
        self.watch = TimeWatch(self, self.told.append, lambda: (self.date_s, self.boot_s))

    def now(self):
        return self.now_s

    def poll(self, after_s, *, suspended_s=0.0, set_s=0.0, period_s=1.0):
        """Poll `after_s` of bench time later; return kind, code and facts of what is told of it."""
        self.told.clear()
        self.now_s += after_s
        self.date_s += suspended_s + set_s
        self.boot_s += suspended_s
        self.watch.look(period_s)
        return [(event.kind, event.code, event.facts) for event in self.told]


@pytest.fixture
def host():
    host = Host()
    host.poll(40.0)  # what comes before the first poll is nobody's delay
    assert host.told == []
    return host


def test_polls_on_time_and_a_little_late_are_told_of_by_nobody(host):
    assert [host.poll(after_s, set_s=0.4) for after_s in (1.0, 1.1, 0.2, 2.9, 1.0)] == [[]] * 5


@pytest.mark.parametrize("late_s", [2.1, 5.0, 9.9])
def test_a_late_poll_is_an_alarm(host, late_s):
    facts = {"from_s": 40.0, "late_s": pytest.approx(late_s)}
    assert host.poll(1.0 + late_s) == [("alarm", "poll_gap", facts)]
    assert host.poll(1.0) == []


def test_one_much_too_late_is_invalid_and_ends_the_run(host):
    with pytest.raises(RunAborted, match="nobody watched the bench"):
        host.poll(11.1)
    (event,) = host.told
    assert (event.kind, event.code) == ("invalid", "unwatched")
    assert event.facts == {"from_s": 40.0, "late_s": pytest.approx(10.1)}


def test_long_periods_are_not_late(host):
    assert host.poll(1.0, period_s=60.0) == []
    assert host.poll(61.0) == []
    assert [code for _, code, _ in host.poll(3.5)] == ["poll_gap"]


def test_a_suspended_computer_lacks_bench_time(host):
    """Linux: CLOCK_MONOTONIC stands still in a suspended system, CLOCK_BOOTTIME does not (clock_gettime(2))."""
    facts = {"from_s": 40.0, "suspended_s": pytest.approx(1.5)}
    assert host.poll(1.0, suspended_s=1.5) == [("invalid", "suspended", facts)]
    found = host.poll(1.0, suspended_s=5.0)
    assert [code for _, code, _ in found] == ["suspended", "poll_gap"]
    with pytest.raises(RunAborted):
        host.poll(1.0, suspended_s=11.0)
    assert [event.code for event in host.told] == ["suspended", "unwatched"]


@pytest.mark.parametrize("step_s", [-3600.0, 0.6])
def test_a_date_that_is_set_is_an_alarm(host, step_s):
    assert host.poll(1.0, set_s=step_s) == [("alarm", "clock_step", {"step_s": pytest.approx(step_s)})]
    assert host.poll(1.0) == []


def test_the_hosts_own_clocks_keep_step():
    before, after = host_offsets(), host_offsets()
    assert before == pytest.approx(after, abs=0.1) and before[0] > 1.7e9 and before[1] >= -0.1


def test_only_bench_time_on_the_wall_has_a_host(monkeypatch):
    """A computer that is suspended for an hour while a lab in virtual time waits."""
    monkeypatch.setattr(time_watch, "host_offsets", iter([(1.7e9, 0.0), (1.7e9, 3600.0)]).__next__)
    told = []
    TimeWatch(SimpleNamespace(now=lambda: 1.0), told.append).look(1.0)
    assert told == []
    watch = TimeWatch(clock := WallClock(), told.append)
    with pytest.raises(RunAborted):
        watch.look(1.0)
    clock.close()
