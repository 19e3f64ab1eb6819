"""A runner that gets no processor is not hung; one that sleeps, is stopped or computes on is."""

import os
import select
import signal
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.control.watchdog import HUNG_S, STARVED_S
from bench.control.watchdog._process import Patience, runqueue_wait_s

pytestmark = pytest.mark.concurrent

BUSY = "import os; os.sched_setaffinity(0, {int(os.environ['CPU'])}); print(flush=True)\nwhile True: pass"


def test_silence_without_waiting_is_a_hang_after_two_seconds():
    patience = Patience(10.0, 5.0)
    assert patience.left_s(10.0, 5.0) == HUNG_S == 2.0
    assert patience.left_s(11.999, 5.0) > 0.0
    assert patience.left_s(12.0, 5.0) == 0.0


@given(st.floats(0.0, 30.0), st.floats(0.0, 1.0))
def test_what_a_runner_starved_is_not_counted_against_it_up_to_a_limit(silent_s, share):
    starved_s = share * silent_s
    left_s = Patience(0.0, 1.0).left_s(silent_s, 1.0 + starved_s)
    own_s = silent_s - starved_s
    if starved_s < STARVED_S:
        assert left_s == pytest.approx(max(HUNG_S - own_s, 0.0), abs=1e-9)
    else:
        assert left_s == pytest.approx(max(HUNG_S + STARVED_S - silent_s, 0.0), abs=1e-9)


@pytest.mark.timeout(120)
def test_the_kernel_counts_the_waiting_of_a_thread_that_shares_its_processor():
    """Two loops on one processor: each must wait. Stopped, neither does."""
    if not os.path.exists("/proc/self/schedstat"):  # noqa: PTH110
        pytest.skip(
            "this kernel does not count waiting (/proc/PID/schedstat): the watchdog grants no extra time"
        )
    environment = os.environ | {"CPU": str(min(os.sched_getaffinity(0)))}
    command = [sys.executable, "-c", BUSY]
    loops = [subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) for _ in range(2)]
    try:
        for loop in loops:
            loop.stdout.readline()
        before_s = runqueue_wait_s(loops[0].pid)
        while runqueue_wait_s(loops[0].pid) - before_s < 0.1:  # the test's time limit ends it
            select.select([], [], [], 0.02)
        loops[0].send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, loops[0].pid, os.WSTOPPED)
        stopped_s = runqueue_wait_s(loops[0].pid)
        select.select([], [], [], 0.05)
        assert runqueue_wait_s(loops[0].pid) == stopped_s
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()
            loop.stdout.close()
    assert runqueue_wait_s(loops[0].pid) == 0.0  # it is gone
