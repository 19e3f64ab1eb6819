"""A runner that gets no processor is not hung; one that sleeps, is stopped or computes on is."""

import math
import os
import select
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.control.watchdog import ARMED, DISMISSED, HUNG_S, STARVED_S, _process, beat_line
from bench.control.watchdog._silence import SilenceTimeout, runqueue_wait_s

pytestmark = pytest.mark.concurrent

BUSY = "import os; os.sched_setaffinity(0, {int(os.environ['CPU'])}); print(flush=True)\nwhile True: pass"


def test_silence_without_waiting_is_a_hang_after_two_seconds():
    timeout = SilenceTimeout(10.0, 5.0)
    assert timeout.left_s(10.0, 5.0) == HUNG_S == 2.0
    assert timeout.left_s(11.999, 5.0) > 0.0
    assert timeout.left_s(12.0, 5.0) == 0.0


@given(st.floats(0.0, 30.0), st.floats(0.0, 1.0))
def test_what_a_runner_starved_is_not_counted_against_it_up_to_a_limit(silent_s, share):
    starved_s = share * silent_s
    left_s = SilenceTimeout(0.0, 1.0).left_s(silent_s, 1.0 + starved_s)
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


class Stand:
    """A process: whether it was ended, and, for a watchdog, whether it has brought the bench to rest."""

    def __init__(self):
        self.ended, self.does_it, self.asked = False, False, []

    def end(self):
        self.ended = True

    def has_done_it(self, folder, begins_within_s):
        self.asked.append((folder, begins_within_s))
        return self.does_it


class Silence:
    """A runner as its watchdog sees it: bytes at times, and how long it has waited for a processor by then.

    Time passes only while the watchdog listens. Each takeover adds to `silences_s` for how long the runner was
    silent; None: its process had ended.
    """

    def __init__(self, monkeypatch, said, starved, first=None, armed=False):
        self.others = {1: Stand(), 2: Stand()}
        self.said, self.starved, self.now_s, self.silences_s = dict(said), starved, 0.0, []
        quiet = SimpleNamespace(SIGINT=0, SIGTERM=0, SIGHUP=0, SIG_IGN=0, signal=lambda *_: None)
        system = SimpleNamespace(write=lambda *_: 0, read=self.read)
        for name, stand_in in {
            "signal": quiet,
            "os": system,
            "select": SimpleNamespace(select=self.select),
            "host_seconds": lambda: self.now_s,
            "runqueue_wait_s": lambda pid: self.starved(self.now_s),
            "_read_order": lambda: _process.Order(Path(), 1, (), {}, armed, first=first),
            "Other": SimpleNamespace(of=lambda pid: self.others[pid]),
            "_take_over": lambda order, runner, silent_s: self.silences_s.append(silent_s) is None,
        }.items():
            monkeypatch.setattr(_process, name, stand_in)

    def select(self, readers, _, __, timeout_s):
        due_s = min(self.said, default=math.inf)
        end_s = math.inf if timeout_s is None else self.now_s + timeout_s
        self.now_s = max(self.now_s, min(due_s, end_s))
        return (readers if due_s <= end_s else []), [], []

    def read(self, *_):
        return self.said.pop(min(self.said))


ARM, DISMISS = ARMED + b"\n", DISMISSED + b"\n"
BEATS = {0.0: ARM, **{round(0.2 * k, 1): beat_line(k, 0.2 * k) for k in range(1, 51)}}


def starved_from_ten(for_s):
    """Ready to run without a processor from 10 s on."""
    return lambda now_s: min(max(now_s - 10.0, 0.0), for_s)


def test_a_runner_that_is_starved_when_its_time_is_up_is_given_what_it_waited(monkeypatch):
    """It beats again 3.2 s later: nobody takes over."""
    runner = Silence(monkeypatch, {**BEATS, 13.2: beat_line(51, 13.2), 14.0: DISMISS}, starved_from_ten(3.0))
    assert _process.main() == 0
    assert runner.silences_s == [] and runner.now_s == 14.0


@pytest.mark.parametrize(
    ("starved_s", "silent_s"), [(0.0, 2.0), (0.5, 2.5), (1.999, 3.999), (3.0, 5.0), (60.0, 10.0)]
)
def test_a_runner_that_stays_silent_is_taken_over_from_two_seconds_of_its_own_later(
    monkeypatch, starved_s, silent_s
):
    """At most 8 s are added for what it waited for a processor."""
    runner = Silence(monkeypatch, BEATS, starved_from_ten(starved_s))
    assert _process.main() == 0
    assert runner.silences_s == [pytest.approx(silent_s, abs=1e-6)]
    assert runner.now_s == pytest.approx(10.0 + silent_s, abs=1e-6)


def test_a_runner_that_is_not_armed_yet_may_be_silent_for_a_minute(monkeypatch):
    runner = Silence(monkeypatch, {59.9: ARM, 60.1: beat_line(1, 60.1), 60.3: b""}, starved_from_ten(0.0))
    assert _process.main() == 0
    assert runner.silences_s == [None] and runner.now_s == 60.3


def test_a_runner_that_stands_still_before_it_is_armed_is_ended_and_nothing_is_taken_over(monkeypatch):
    runner = Silence(monkeypatch, {100.0: ARM}, starved_from_ten(0.0))
    told = []
    monkeypatch.setattr(_process, "_tell", told.append)
    assert _process.main() == 0
    assert runner.silences_s == [] and runner.now_s == pytest.approx(60.0)
    assert runner.others[1].ended
    assert "stood still for 60 s" in told[0]


@pytest.mark.parametrize("does_it", [False, True])
@pytest.mark.parametrize("ends", [False, True])
def test_the_second_leaves_the_bench_to_the_first_for_a_little_and_does_it_if_that_does_not(
    monkeypatch, ends, does_it
):
    """A runner that ends is told at once: the first has 0.2 s. Of a silent one the second hears later."""
    said = {0.0: ARM, 1.0: beat_line(1, 1.0)} | ({1.5: b""} if ends else {})
    runner = Silence(monkeypatch, said, starved_from_ten(0.0), first=2)
    first = runner.others[2]
    first.does_it = does_it
    assert _process.main() == 0
    assert first.asked == [(Path("watchdog"), 0.2 if ends else 0.0)]
    assert runner.now_s == pytest.approx(1.5 if ends else 3.2)
    assert runner.silences_s == ([] if does_it else [None if ends else pytest.approx(2.2)])


def test_one_that_comes_up_counts_from_the_last_beat_that_was_sent_meanwhile(monkeypatch):
    """The runner was stopped 1.2 s ago."""
    runner = Silence(monkeypatch, {0.0: beat_line(0, -1.2)}, starved_from_ten(0.0), first=2, armed=True)
    assert _process.main() == 0
    assert runner.silences_s == [pytest.approx(2.2)] and runner.now_s == pytest.approx(1.0)


def test_one_that_was_stopped_on_its_way_hears_the_runner_go_on(monkeypatch):
    """Both were stopped for 5 s: the beats in the pipe are old, the next comes half a second after it is up."""
    said = {0.0: beat_line(0, -5.0), 0.5: beat_line(0, 0.5), 0.7: DISMISS}
    runner = Silence(monkeypatch, said, starved_from_ten(0.0), first=2, armed=True)
    assert _process.main() == 0
    assert runner.silences_s == [] and runner.now_s == 0.7


def test_one_that_comes_up_long_after_the_last_beat_waits_for_one_for_a_moment_only(monkeypatch):
    runner = Silence(monkeypatch, {0.0: beat_line(0, -5.0)}, starved_from_ten(0.0), first=2, armed=True)
    assert _process.main() == 0
    assert runner.now_s == pytest.approx(0.8) and len(runner.silences_s) == 1


def test_beats_that_lay_in_the_pipe_are_no_sign_of_life_of_now(monkeypatch):
    """Two are read at 1.9 s that were sent at 0.2 and 0.4 s."""
    runner = Silence(
        monkeypatch, {0.0: ARM, 1.9: beat_line(1, 0.2) + beat_line(2, 0.4)}, starved_from_ten(0.0)
    )
    assert _process.main() == 0
    assert runner.silences_s == [pytest.approx(2.0)] and runner.now_s == pytest.approx(2.4)


def test_a_count_of_waiting_that_begins_anew_takes_no_time_from_the_runner():
    """The kernel counts a thread's waiting from its start: another thread's count may be the smaller one."""
    assert SilenceTimeout(100.0, 5.0, HUNG_S).left_s(101.0, 3.0) == pytest.approx(HUNG_S - 1.0)
