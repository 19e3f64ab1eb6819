"""The latency benchmark finds the end of a takeover, whatever words the events of the watchdog have."""

import signal

from benchmarks.abort_latency import _watchdog_ms


def test_a_killed_runners_takeover_is_found_and_timed() -> None:
    (latency_ms,) = _watchdog_ms(signal.SIGKILL, 1)
    assert 0.0 < latency_ms < 30e3
