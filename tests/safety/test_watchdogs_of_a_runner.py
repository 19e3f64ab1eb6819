"""The runner's end of the pipes to its watchdogs: whom it arms, what it tells of a lost one, when it gives up."""

import json
import os
import subprocess
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import pytest

import bench.control.watchdog as watchdog
from bench.control.watchdog import ARMED, DISMISSED, READY, Watchdog, beat_line
from bench.record.benchfile import load_bench_file
from drivers.base.errors import BenchError

pytestmark = pytest.mark.concurrent

DEMO = Path(__file__).parents[2] / "examples" / "demo.toml"
ARM, DISMISS = ARMED + b"\n", DISMISSED + b"\n"


class Process:
    """In place of the watchdog's process: the other ends of its pipes."""

    def __init__(self, pid):
        (self.heard, stdin), (stdout, self.says) = os.pipe(), os.pipe()
        self.stdin, self.stdout = os.fdopen(stdin, "wb", 0), os.fdopen(stdout, "rb", 0)
        self.pid, self.waited, self.killed, self.returncode = pid, 0, False, 0

    def wait(self, timeout=None):
        self.waited += 1
        return self.returncode

    def kill(self):
        self.killed, self.returncode = True, -9

    def read(self):
        os.set_blocking(self.heard, False)
        try:
            return os.read(self.heard, 1 << 20)
        except BlockingIOError:
            return b""

    def says_ready(self):
        os.write(self.says, READY + b"\n")

    def end(self):
        """End as a process does: nothing is heard or said any more."""
        os.close(self.says)
        os.close(self.heard)
        self.says = self.heard = -1


class Guarded:
    """The watchdogs of a runner, whose processes are stood in for, and what it tells of them."""

    def __init__(self, monkeypatch):
        self.lease = SimpleNamespace(descriptors=(5,), told={})
        self.lease.update = self.lease.told.update
        self.now_s, self.started, self.told, self.stopped, self.refused = 100.0, [], [], [], False
        monkeypatch.setattr(watchdog.subprocess, "Popen", self.start)
        monkeypatch.setattr(watchdog, "host_seconds", lambda: self.now_s)
        monkeypatch.setattr(watchdog, "runqueue_wait_s", lambda pid: 0.0)
        file = load_bench_file(DEMO)
        self.dog = Watchdog(file, Path("runs"), self.lease, self.told.append, self.stopped.append)

    def start(self, command, **options):
        if self.refused:
            raise BlockingIOError(11, "no more processes")
        self.options = options
        self.started.append(Process(4711 + len(self.started)))
        return self.started[-1]

    @property
    def first(self):
        return self.started[0]

    @property
    def last(self):
        return self.started[-1]

    def arm(self, *, second=True):
        """Arm the first; the second comes up, or stays on its way."""
        self.first.says_ready()
        self.dog.arm()
        if second:
            self.last.says_ready()
            self.now_s += 0.25
            self.dog.beat()

    def run(self, for_s, *, but=()):
        """Let time pass, a beat every quarter of a second; return the codes of what was told, with the times.

        Every watchdog `but` some answers.
        """
        until_s, told = self.now_s + for_s, []
        while self.now_s < until_s:
            self.now_s = round(self.now_s + 0.25, 3)
            self.dog.beat()
            told += [(event.code, self.now_s) for event in self.told[len(told) :]]
            for process in self.started:
                if process not in but and process.heard >= 0 and not process.killed:
                    lines = process.read().splitlines(keepends=True)
                    os.write(process.says, b"".join(lines[-1:]))
        self.told.clear()
        return told


@pytest.fixture
def guarded(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    guarded = Guarded(monkeypatch)
    yield guarded
    for process in guarded.started:
        for pipe in (process.stdin, process.stdout):
            pipe.close()
        for descriptor in (process.heard, process.says):
            if descriptor >= 0:
                os.close(descriptor)


def test_the_runner_orders_arms_beats_five_times_a_second_and_dismisses_both(guarded, tmp_path):
    first, dog = guarded.first, guarded.dog
    assert guarded.lease.told == {"watchdog_pid": 4711}
    assert guarded.options["start_new_session"] is True and guarded.options["pass_fds"] == (5,)
    order = json.loads(first.read())
    assert (order["runner"], order["lease"], order["armed"], order["first"]) == (
        os.getpid(),
        [5],
        False,
        None,
    )
    assert order["run_folder"] == str(tmp_path / "runs")
    guarded.arm(second=False)
    assert first.read() == ARM
    second = guarded.last
    second.says_ready()
    order = json.loads(second.read())  # it guards from the start, and leaves the bench to the first
    assert (order["runner"], order["lease"], order["armed"], order["first"]) == (os.getpid(), [5], True, 4711)
    assert guarded.lease.told == {"watchdog_pid": 4711}
    beats = []
    for tick in range(1, 101):
        guarded.now_s = 100.0 + tick / 100
        dog.beat()
        beat = beat_line(len(beats) + 1, guarded.now_s)
        said = [process.read() for process in (first, second)]
        assert said in ([beat, beat], [b"", b""])
        beats += [tick] if said[0] else []
    assert len(beats) in (4, 5) and 20 <= beats[0] <= 21
    assert all(20 <= later - sooner <= 21 for sooner, later in pairwise(beats))
    said = []
    first.wait = lambda timeout=None: said.append((first.read(), second.read()))
    dog.dismiss()
    dog.dismiss()
    assert said == [(DISMISS, DISMISS)]  # both are told before either is waited for
    assert not first.killed and not second.killed
    assert all(pipe.closed for process in (first, second) for pipe in (process.stdin, process.stdout))
    assert guarded.told == guarded.stopped == []


@pytest.mark.parametrize("said", [b"", b"Traceback\n"])
def test_a_watchdog_that_does_not_come_up_is_an_error(guarded, said):
    os.write(guarded.first.says, said)
    os.close(guarded.first.says)
    guarded.first.says = -1
    guarded.first.read()
    with pytest.raises(BenchError, match="did not start"):
        guarded.dog.arm()
    assert guarded.first.read() == b""  # it is not armed
    guarded.dog.dismiss()
    assert guarded.told == [] and len(guarded.started) == 1


def test_a_watchdog_is_waited_for_a_minute_from_its_start(guarded, monkeypatch):
    waited_s = []

    def wait(readers, writers, others, timeout_s):
        waited_s.append(timeout_s)
        guarded.now_s += timeout_s + 0.001  # a wait ends a little late
        return [], [], []

    monkeypatch.setattr(watchdog, "select", SimpleNamespace(select=wait))
    guarded.now_s += 15.0
    with pytest.raises(BenchError, match="did not start") as late:
        guarded.dog.arm()
    assert waited_s == [45.0] and late.value.expected == "its word within 60 s"


def test_a_watchdog_that_does_not_end_when_told_is_ended_after_five_seconds(guarded):
    guarded.arm()
    waited_s = []

    def wait(timeout=None):
        waited_s.append(timeout)
        if timeout is not None:
            raise subprocess.TimeoutExpired("watchdog", timeout)

    guarded.first.wait = wait
    guarded.dog.dismiss()
    assert guarded.first.killed and waited_s == [5.0, None]
    assert [event.code for event in guarded.told] == ["watchdog_lost"]


def test_one_that_is_not_up_when_the_run_ends_is_not_waited_for(guarded):
    guarded.arm(second=False)
    guarded.dog.dismiss()
    assert guarded.last.killed and not guarded.first.killed and guarded.told == []


def test_watchdogs_that_answer_are_well_however_late_the_runner_looks(guarded):
    guarded.arm()
    assert guarded.run(5.0) == []
    guarded.now_s += 30.0  # the runner was busy; the answers have come long since
    assert guarded.run(2.0) == [] and len(guarded.started) == 2


@pytest.mark.parametrize("dead", [False, True])
def test_watchdogs_that_were_stopped_together_with_their_runner_are_well(guarded, dead):
    guarded.arm()
    guarded.run(0.25, but=guarded.started)
    guarded.now_s += 7.0  # beats are unanswered: all were stopped
    guarded.dog.beat()
    assert guarded.told == []
    told = guarded.run(2.0, but=guarded.started if dead else ())
    assert [code for code, _ in told] == (["watchdog_lost"] * 2 if dead else [])


@pytest.mark.parametrize("stopped", [False, True])
@pytest.mark.parametrize("number", [0, 1])
def test_either_that_is_dead_or_stopped_is_told_within_two_seconds_and_another_put_in_its_place(
    guarded, stopped, number
):
    guarded.arm()
    guarded.run(3.0)
    lost_s, lost, left = guarded.now_s, guarded.started[number], guarded.started[1 - number]
    if not stopped:
        lost.end()
    ((code, told_s),) = guarded.run(2.0, but=(lost,))
    assert code == "watchdog_lost" and told_s - lost_s <= (1.5 if stopped else 0.25)
    assert lost.killed and lost.waited == 1 and not left.killed and len(guarded.started) == 3
    assert guarded.lease.told == {"watchdog_pid": left.pid}
    guarded.last.says_ready()
    assert [code for code, _ in guarded.run(0.25)] == ["watchdog_back"]
    assert guarded.run(30.0) == [] and guarded.stopped == []
    guarded.dog.dismiss()
    assert guarded.told == []


def test_one_that_takes_the_place_of_the_first_leaves_the_bench_to_the_second(guarded):
    guarded.arm()
    guarded.first.end()
    guarded.now_s += 0.25
    guarded.dog.beat()
    order = json.loads(guarded.last.read().splitlines()[0])
    assert (order["armed"], order["first"]) == (True, guarded.started[1].pid)


def test_the_alarm_says_whether_anybody_guards_the_bench_still(guarded):
    guarded.arm()
    for expected in ("the other one guards", "nobody stops the bench"):
        guarded.started[len(guarded.told)].end()
        guarded.now_s += 0.25
        guarded.dog.beat()
        assert expected in guarded.told[-1].text


@pytest.mark.parametrize(
    ("how", "started", "after_s"), [("do not start", 2, 0.25), ("end", 5, 0.75), ("are not ready", 4, 20.5)]
)
def test_when_no_watchdog_is_left_the_run_is_invalid_and_ends(guarded, how, started, after_s):
    """Of those that end at once three more are tried; those that do not come up are waited for once."""
    guarded.arm()
    guarded.refused = how == "do not start"
    for process in guarded.started:
        process.end()
    told, from_s = [], guarded.now_s
    while not guarded.stopped and guarded.now_s < 200.0:
        told += guarded.run(0.25, but=guarded.started)
        for process in guarded.started[2:] if how == "end" else ():
            if process.heard >= 0:
                process.end()
    codes = [code for code, _ in told]
    assert codes == ["watchdog_lost"] * (len(codes) - 1) + ["unguarded"]
    assert (len(guarded.started), len(guarded.stopped)) == (started, 1)
    assert guarded.now_s - from_s == pytest.approx(after_s, abs=0.3)
    guarded.dog.dismiss()


def test_a_second_one_that_cannot_be_started_is_told_and_the_first_guards(guarded):
    guarded.refused = True
    guarded.arm(second=False)
    ((text, code),) = [(event.text, event.code) for event in guarded.told]
    assert code == "watchdog_lost" and "could not be started" in text and "no more processes" in text
    guarded.told.clear()
    assert guarded.run(5.0) == [] and guarded.stopped == []


@pytest.mark.parametrize("stopped", [False, True])
def test_the_alarm_says_which_watchdog_is_lost_and_for_how_long_it_said_nothing(guarded, stopped):
    guarded.arm(second=False)
    guarded.now_s += 0.25
    guarded.dog.beat()
    if stopped:
        guarded.now_s += 1.75  # since the beat that was not answered
    else:
        guarded.first.end()
        guarded.now_s += 0.25
    guarded.dog.beat()
    (alarm,) = guarded.told
    assert ("its process has ended" in alarm.text) is not stopped
    assert alarm.facts == {"pid": 4711} | ({"silent_s": pytest.approx(1.75)} if stopped else {})


def test_one_that_dies_before_it_is_up_is_replaced(guarded):
    guarded.arm(second=False)
    guarded.last.end()
    assert [code for code, _ in guarded.run(0.25)] == ["watchdog_lost"]
    guarded.last.says_ready()
    assert [code for code, _ in guarded.run(1.0)] == ["watchdog_back"] and len(guarded.started) == 3


def test_one_that_comes_up_is_waited_for_twenty_seconds_then_another_started(guarded):
    guarded.arm(second=False)
    for waited_s, codes in ((19.9, []), (0.3, ["watchdog_lost"])):
        guarded.now_s += waited_s
        guarded.dog.beat()
        assert [event.code for event in guarded.told] == codes
        assert all(
            "has not come up within 20 s; the other one guards" in event.text for event in guarded.told
        )
        guarded.first.read()
        os.write(guarded.first.says, beat_line(1000, 0.0))
    assert guarded.started[1].killed and len(guarded.started) == 3 and guarded.stopped == []


def test_beats_before_the_word_that_arms_have_no_number_to_answer(guarded):
    guarded.first.read()
    guarded.now_s += 0.5
    guarded.dog.beat()
    assert guarded.first.read() == b"0 100.500000\n"


def test_one_that_comes_up_finds_the_beats_that_were_sent_meanwhile(guarded):
    guarded.arm(second=False)
    guarded.last.read()
    for _ in range(2):
        guarded.now_s += 0.25
        guarded.dog.beat()
    assert guarded.last.read() == b"0 100.250000\n0 100.500000\n"
    guarded.last.says_ready()
    guarded.now_s += 0.25
    guarded.dog.beat()
    assert guarded.last.read() == beat_line(1, 100.75)


def test_watchdogs_that_are_lost_again_and_again_end_the_run(guarded):
    """Three are replaced; then the two that are left are the last."""
    guarded.arm()
    for _ in range(3):
        guarded.started[-2].end()
        assert [code for code, _ in guarded.run(0.25)] == ["watchdog_lost"]
        guarded.last.says_ready()
        assert [code for code, _ in guarded.run(5.0)] == ["watchdog_back"]
    guarded.started[-2].end()
    assert [code for code, _ in guarded.run(5.0)] == ["watchdog_lost"]
    guarded.last.end()
    assert [code for code, _ in guarded.run(0.25)] == ["watchdog_lost", "unguarded"]
    assert len(guarded.stopped) == 1 and len(guarded.started) == 5


def test_a_watchdog_that_died_just_before_the_end_is_told(guarded):
    guarded.arm()
    guarded.first.end()
    guarded.first.returncode = -9
    guarded.dog.dismiss()
    assert [event.code for event in guarded.told] == ["watchdog_lost"]
