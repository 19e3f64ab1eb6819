"""On a clock that runs by itself the wait for a lost port ends: a spinning thread would be taken for hung."""

from unittest.mock import MagicMock

from bench.safe_state import bring_to_rest
from drivers.errors import ConfigurationError, LinkLost


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
