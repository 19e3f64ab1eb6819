"""What a watchdog does once its runner is gone: which device it stops when, what it writes down and says."""

import json
import os
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import pytest

import bench.control.watchdog as watchdog
from bench.control.watchdog import ARMED, DISMISSED, READY, Watchdog, _process, beat_line
from bench.record.benchfile import load_bench_file
from drivers.base.clock import host_seconds
from drivers.base.errors import BenchError, ConfigurationError
from drivers.kit.instruments import Rest

pytestmark = pytest.mark.concurrent

DEMO = Path(__file__).parents[2] / "examples" / "demo.toml"
ARM, DISMISS = ARMED + b"\n", DISMISSED + b"\n"
FIRST = beat_line(1, 100.2)
AT_REST = {"table": Rest(True, {"table": 0.0}), "chamber": Rest(True, running=False, set_point_c=25.0)}


class Clock:
    """Time passes by sleeping only."""

    def __init__(self):
        self.time_s = 0.0

    def now(self):
        return self.time_s

    def sleep(self, duration_s):
        self.time_s = round(self.time_s + max(duration_s, 0.0), 9)


class Device:
    """Rests, or turns on whatever it is told; its port can be opened from `there_s` on."""

    def __init__(self, clock, rest, there_s=0.0):
        self.clock, self.rest, self.there_s = clock, rest, there_s
        self.link, self.tried_s, self.halted_s, self.tap = self, [], [], None

    def open(self, clock, tap):
        self.tried_s.append(clock.now())
        if clock.now() < self.there_s:
            raise ConfigurationError("the port cannot be opened")
        self.tap = tap
        return self

    def reopen(self):
        raise ConfigurationError("the port cannot be opened")

    def halt(self):
        self.halted_s.append(self.clock.now())
        if self.tap is not None:  # as a link does
            self.tap.sent(b"stop", self.clock.now())

    def make_safe(self):
        pass

    def read_rest(self):
        return self.rest


@pytest.fixture
def bench(monkeypatch, tmp_path):
    clock = Clock()
    monkeypatch.setattr(_process, "WallClock", lambda: clock)
    runner = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    pidfd = os.pidfd_open(runner.pid)
    devices = {name: Device(clock, rest) for name, rest in AT_REST.items()}
    folder = tmp_path / "run"
    folder.mkdir()

    def take_over(silent_s=None, **openers):
        opening = {name: device.open for name, device in devices.items()} | openers
        return _process._take_over(_process.Order(folder, runner.pid, (), opening), pidfd, silent_s)

    yield SimpleNamespace(take_over=take_over, devices=devices, folder=folder, clock=clock, runner=runner)
    runner.kill()
    runner.wait()
    runner.stdin.close()
    os.close(pidfd)


def events(bench):
    path = bench.folder / "watchdog" / "events.jsonl"
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    return [(row["kind"], row.get("device"), row.get("state"), row.get("code")) for row in rows], rows


CONFIRMED = [("safe_state", name, "confirmed", None) for name in AT_REST]


@pytest.mark.parametrize(("silent_s", "cause"), [(None, "runner_ended"), (2.5, "runner_silent")])
def test_the_runner_is_ended_both_devices_are_stopped_and_each_thing_is_written_once(
    bench, capfd, silent_s, cause
):
    assert bench.take_over(silent_s) is True
    assert bench.runner.wait(10.0) == -9
    kinds, rows = events(bench)
    assert kinds == [("takeover", None, None, None), *CONFIRMED, ("takeover_ended", None, None, None)]
    assert (rows[0]["cause"], rows[0]["runner"], rows[0].get("silent_s")) == (
        cause,
        bench.runner.pid,
        silent_s,
    )
    assert rows[-1]["confirmed"] is True and {row["cause"] for row in rows[1:3]} == {"takeover"}
    assert rows[1]["rates_dps"] == {"table": 0.0} and rows[2]["set_point_c"] == 25.0
    assert [device.halted_s[0] for device in bench.devices.values()] == [0.0, 0.0]
    assert b"stop" in (bench.folder / "watchdog" / "raw" / "table.sent.bin").read_bytes()
    said = capfd.readouterr().err.splitlines()
    assert len(said) == 4 and all(line.startswith("watchdog: ") for line in said)
    assert said[0].endswith(": the table and the chamber are being stopped")
    assert f"`gyrobench runs recover {bench.folder}`" in said[3]
    assert not any(words in "".join(said) for words in ("BY HAND", "not confirmed", "go and look"))


def test_a_port_that_is_away_keeps_the_other_device_waiting_for_a_second_and_is_tried_on(bench, capfd):
    bench.devices["table"].there_s = 5.0
    assert bench.take_over() is True
    assert 1.0 <= bench.devices["chamber"].halted_s[0] < 1.1
    assert 5.0 <= bench.devices["table"].halted_s[0] < 5.1
    assert len(bench.devices["chamber"].tried_s) == 1
    tried_s = bench.devices["table"].tried_s
    assert tried_s[0] == 0.0 and max(later - sooner for sooner, later in pairwise(tried_s)) < 1.0
    kinds, rows = events(bench)
    assert kinds[1:-1] == [CONFIRMED[1], ("safe_state", "table", "pending", "refused"), CONFIRMED[0]]
    assert 1.0 <= rows[2]["time_s"] < 1.5 and "cannot be opened" in rows[2]["error"]
    said = capfd.readouterr().err.splitlines()
    assert "not stopped yet, STOP IT BY HAND; its port is tried for 60 s" in said[2]
    assert sum("BY HAND" in line for line in said) == 1


def test_what_opens_late_is_stopped_at_once_though_another_port_stays_away(bench):
    bench.devices["table"].there_s = 5.011  # between two tries, so that no clock reads exactly a second
    bench.devices["chamber"].there_s = float("inf")
    assert bench.take_over() is False
    assert 5.0 <= bench.devices["table"].halted_s[0] < 5.1


def test_a_port_that_opens_within_the_first_second_is_not_told_of(bench):
    bench.devices["table"].there_s = 0.5
    assert bench.take_over() is True
    assert 0.5 <= bench.devices["chamber"].halted_s[0] < 0.6  # both at once
    assert sorted(events(bench)[0][1:-1]) == sorted(CONFIRMED)


def test_a_port_that_stays_away_is_given_up_after_a_minute(bench, capfd):
    bench.devices["table"].there_s = float("inf")
    assert bench.take_over() is False
    assert 60.0 <= bench.devices["table"].tried_s[-1] < 60.1
    assert bench.devices["chamber"].halted_s[0] < 1.1
    kinds, rows = events(bench)
    assert kinds[1:-1] == [
        CONFIRMED[1],
        ("safe_state", "table", "pending", "refused"),
        ("safe_state", "table", "not_confirmed", "refused"),
    ]
    assert rows[-1]["confirmed"] is False
    said = capfd.readouterr().err.splitlines()
    assert said[-2].startswith("watchdog: not confirmed safe: ")
    assert "go and look before anything else" in said[-1]


def test_no_port_at_all_is_given_up_after_a_minute_too(bench):
    for device in bench.devices.values():
        device.there_s = float("inf")
    assert bench.take_over() is False
    assert 60.0 <= bench.clock.now() < 60.1
    kinds, _ = events(bench)
    assert sorted(kinds[1:3]) == [("safe_state", name, "pending", "refused") for name in sorted(AT_REST)]
    assert [kind[2] for kind in kinds[3:-1]] == ["not_confirmed", "not_confirmed"]


def test_a_device_that_was_replaced_is_left_alone(bench):
    tried = []

    def replaced(clock, tap):
        tried.append(clock.now())
        raise _process._Replaced("the device is no more")

    assert bench.take_over(chamber=replaced) is False
    assert len(tried) == 1 and bench.clock.now() < 1.0
    assert sorted(events(bench)[0][1:-1]) == sorted(
        [CONFIRMED[0], ("safe_state", "chamber", "not_confirmed", "replaced")]
    )


def test_one_device_that_turns_on_makes_the_takeover_unconfirmed(bench):
    bench.devices["table"].rest = Rest(False, {"table": 30.0})
    assert bench.take_over() is False
    kinds, rows = events(bench)
    assert kinds[1:-1] == [CONFIRMED[1], ("safe_state", "table", "not_confirmed", "not_at_rest")]
    assert rows[2]["rates_dps"] == {"table": 30.0} and rows[-1]["confirmed"] is False


def test_a_run_folder_that_is_gone_stops_nothing(bench, capfd):
    bench.folder.rmdir()
    assert bench.take_over() is True
    assert all(device.halted_s for device in bench.devices.values())
    assert not bench.folder.exists()
    said = capfd.readouterr().err.splitlines()
    assert "No such file" in said[0] and len(said) == 5


def test_a_folder_that_another_watchdog_left_is_gone_on_with(bench):
    (bench.folder / "watchdog").mkdir()
    assert bench.take_over() is True
    assert events(bench)[0][1:-1] == CONFIRMED


class Heard:
    """What the watchdog's process hears and says, and the takeover that it makes of it."""

    def __init__(self, monkeypatch, said, *, runner=None, confirmed=True, lease=(), ready=None, armed=False):
        self.said, self.written, self.taken = list(said), [], []
        system = SimpleNamespace(
            pidfd_open=runner or (lambda pid: 7), write=ready or self.write, read=lambda *_: self.said.pop(0)
        )
        quiet = SimpleNamespace(SIGINT=0, SIGTERM=0, SIGHUP=0, SIG_IGN=0, signal=lambda *_: None)
        for name, stand_in in {
            "signal": quiet,
            "os": system,
            "select": SimpleNamespace(select=lambda readers, *_: (readers, [], [])),
            "runqueue_wait_s": lambda pid: 0.0,
            "host_seconds": lambda: 100.3,
            "_read_order": lambda: _process.Order(Path(), 1, lease, {}, armed),
            "_take_over": lambda order, runner, silent_s: self.taken.append((runner, silent_s)) or confirmed,
        }.items():
            monkeypatch.setattr(_process, name, stand_in)

    def write(self, descriptor, data):
        self.written.append((descriptor, data))


def lost(*_):
    raise BrokenPipeError


def ended(pid):
    raise ProcessLookupError


@pytest.mark.parametrize(
    ("said", "settings"),
    [
        ([DISMISS], {}),
        ([b""], {}),  # the runner ended before anything was moved
        ([ARM, FIRST, DISMISS], {}),
        ([ARM + FIRST, FIRST[:3], FIRST[3:] + DISMISS], {}),
        ([b""], {"runner": ended}),
        ([DISMISS], {"ready": lost}),
        ([DISMISS], {"ready": lost, "armed": True}),
    ],
)
def test_a_watchdog_that_is_not_needed_ends_without_a_word(monkeypatch, said, settings):
    heard = Heard(monkeypatch, said, **settings)
    assert _process.main() == 0
    assert heard.taken == [] and heard.said == []


@pytest.mark.parametrize("confirmed", [True, False])
def test_a_watchdog_takes_over_lets_go_of_the_lease_and_says_how_it_went(monkeypatch, tmp_path, confirmed):
    lease = tmp_path / "lease"
    with lease.open("w") as file:
        heard = Heard(monkeypatch, [ARM, FIRST, b""], confirmed=confirmed, lease=(file.fileno(),))
        assert _process.main() == (0 if confirmed else 1)
    assert heard.taken == [(7, None)]
    assert heard.written == [(1, b"ready\n"), (1, ARM), (1, FIRST)]
    assert not lease.exists()


def test_what_lay_unread_in_the_pipe_is_no_sign_of_life_of_now(monkeypatch):
    """A beat of 97.0 s is read at 100.3 s, together with the word that arms; nothing comes after it."""
    beat = beat_line(1, 97.0)
    heard = Heard(monkeypatch, [ARM + beat])
    waits = iter([([0], [], []), ([], [], [])])
    monkeypatch.setattr(_process.select, "select", lambda *_: next(waits))
    assert _process.main() == 0
    assert heard.taken == [(7, pytest.approx(3.3))]
    assert heard.written == [(1, b"ready\n"), (1, beat)]  # the answer is to the last of them


@pytest.mark.parametrize("beat", [[], [beat_line(1, 100.1)]])
def test_a_watchdog_that_was_stopped_gives_the_runner_its_time_anew_once(monkeypatch, beat):
    """It wants to wake after 2 s and does after 9; the runner was stopped too, and says nothing any more."""
    heard, now_s, waited_s = Heard(monkeypatch, [ARM, *beat]), [100.0], []
    waits = iter([([0], 0.0), ([0] if beat else [], 9.0), ([], 2.0), ([], 9.0)])

    def select(readers, _, __, timeout_s):
        waited_s.append(timeout_s)
        ready, for_s = next(waits)
        now_s[0] += for_s
        return ready, [], []

    monkeypatch.setattr(_process.select, "select", select)
    monkeypatch.setattr(_process, "host_seconds", lambda: now_s[0])
    assert _process.main() == 0
    assert heard.taken == [(7, pytest.approx(2.0))] and waited_s == [60.0, 2.0, 2.0]


def test_one_that_was_stopped_before_anything_came_gives_the_runner_its_time_anew_too(monkeypatch):
    """It guards from its start, wants to wake after 2 s and does after 9, then after the 2 s given anew."""
    heard, now_s, waits = Heard(monkeypatch, [], armed=True), [100.0], iter([9.0, 2.0])

    def select(*_):
        now_s[0] += next(waits)
        return [], [], []

    monkeypatch.setattr(_process.select, "select", select)
    monkeypatch.setattr(_process, "host_seconds", lambda: now_s[0])
    assert _process.main() == 0
    assert heard.taken == [(7, pytest.approx(2.0))]


@pytest.mark.parametrize(("settings", "runner"), [({}, 7), ({"ready": lost}, 7), ({"runner": ended}, None)])
def test_one_that_takes_the_place_of_a_lost_watchdog_guards_from_its_start(monkeypatch, settings, runner):
    """The runner that ordered it died before it was up."""
    heard = Heard(monkeypatch, [b""], armed=True, **settings)
    assert _process.main() == 0
    assert heard.taken == [(runner, None)]


FROZEN = """
import sys
from bench.control.watchdog import _process
_process.UNARMED_S = 0.5
sys.exit(_process.main())
"""


def test_a_runner_that_is_stopped_before_its_first_command_is_ended_and_its_lease_given_back(tmp_path):
    runner = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    os.kill(runner.pid, signal.SIGSTOP)
    with (tmp_path / "lease").open("w") as lease:
        order = {
            "bench": load_bench_file(DEMO).model_dump(mode="json"),
            "run_folder": str(tmp_path),
            "runner": runner.pid,
            "lease": [lease.fileno()],
            "armed": False,
        }
        guard = subprocess.Popen(
            [sys.executable, "-c", FROZEN],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            pass_fds=[lease.fileno()],
        )
        guard.stdin.write(json.dumps(order).encode() + b"\n")
        guard.stdin.flush()
        assert runner.wait(60) == -signal.SIGKILL
        assert guard.wait(60) == 0
    assert b"before its first command" in guard.stderr.read()
    assert not (tmp_path / "lease").exists() and not (tmp_path / "watchdog").exists()
    for pipe in (runner.stdin, guard.stdin, guard.stdout, guard.stderr):
        pipe.close()


def test_a_runner_that_reads_nothing_does_not_stop_its_watchdog():
    """The echoes of forty long beats are more than a pipe holds, 64 KiB (pipe(7))."""
    order = {
        "bench": load_bench_file(DEMO).model_dump(mode="json"),
        "run_folder": "/nowhere",
        "runner": os.getpid(),
        "lease": [],
        "armed": False,
    }
    words = [sys.executable, "-P", "-m", "bench.control.watchdog"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as guard:
        beats = b"".join(beat_line(k, host_seconds()).rstrip(b"\n") + b"0" * 4000 + b"\n" for k in range(40))
        guard.stdin.write(json.dumps(order).encode() + b"\n" + beats + DISMISS)
        guard.stdin.flush()
        try:
            assert guard.wait(60) == 0
        finally:
            guard.kill()


def test_the_order_is_read_to_the_end_of_its_line(monkeypatch):
    file = load_bench_file(DEMO)
    order = {
        "bench": file.model_dump(mode="json"),
        "run_folder": "/runs/r",
        "runner": 42,
        "lease": [3, 4],
        "armed": True,
    }
    sent = bytearray(json.dumps(order).encode() + b"\n" + ARM)

    def read(descriptor, count):
        assert descriptor == 0
        data = bytes(sent[:count])
        del sent[:count]
        return data

    monkeypatch.setattr(_process.os, "read", read)
    found = _process._read_order()
    assert (found.run_folder, found.runner, found.lease, found.armed) == (Path("/runs/r"), 42, (3, 4), True)
    assert list(found.openers) == ["table", "chamber"]
    assert bytes(sent) == ARM  # it is for the loop that comes after


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

    def end(self):
        """End as a process does: nothing is heard or said any more."""
        os.close(self.says)
        os.close(self.heard)
        self.says = self.heard = -1


class Guarded:
    """A watchdog of the runner whose processes are stood in for, and what it tells of them."""

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
    def process(self):
        return self.started[-1]

    def arm(self):
        os.write(self.process.says, READY + b"\n")
        self.dog.arm()

    def run(self, for_s, *, answering=True):
        """Let time pass, a beat every quarter of a second; return the codes of what was told, with the times."""
        until_s, told = self.now_s + for_s, []
        while self.now_s < until_s:
            self.now_s = round(self.now_s + 0.25, 3)
            self.dog.beat()
            told += [(event.code, self.now_s) for event in self.told[len(told) :]]
            if answering and self.process.heard >= 0:
                lines = self.process.read().splitlines(keepends=True)
                os.write(self.process.says, b"".join(lines[-1:]))
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


def test_the_runner_orders_arms_beats_five_times_a_second_and_dismisses(guarded, tmp_path):
    process, dog = guarded.process, guarded.dog
    assert guarded.lease.told == {"watchdog_pid": 4711}
    assert guarded.options["start_new_session"] is True and guarded.options["pass_fds"] == (5,)
    order = json.loads(process.read())
    assert (order["runner"], order["lease"]) == (os.getpid(), [5])
    assert order["run_folder"] == str(tmp_path / "runs")
    guarded.arm()
    assert process.read() == ARM
    beats = []
    for tick in range(1, 101):
        guarded.now_s = 100.0 + tick / 100
        dog.beat()
        beats += [tick] if process.read() == beat_line(len(beats) + 1, guarded.now_s) else []
    assert len(beats) in (4, 5) and 20 <= beats[0] <= 21
    assert all(20 <= later - sooner <= 21 for sooner, later in pairwise(beats))
    dog.dismiss()
    dog.dismiss()
    assert process.read() == DISMISS and process.waited == 1 and not process.killed
    assert process.stdin.closed and process.stdout.closed
    assert guarded.told == guarded.stopped == []


@pytest.mark.parametrize("said", [b"", b"Traceback\n"])
def test_a_watchdog_that_does_not_come_up_is_an_error(guarded, said):
    os.write(guarded.process.says, said)
    os.close(guarded.process.says)
    guarded.process.says = -1
    guarded.process.read()
    with pytest.raises(BenchError, match="did not start"):
        guarded.dog.arm()
    assert guarded.process.read() == b""  # it is not armed
    guarded.dog.dismiss()
    assert guarded.told == []


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

    guarded.process.wait = wait
    guarded.dog.dismiss()
    assert guarded.process.killed and waited_s == [5.0, None]
    assert [event.code for event in guarded.told] == ["watchdog_lost"]


def test_a_watchdog_that_answers_is_well_however_late_the_runner_looks(guarded):
    guarded.arm()
    assert guarded.run(5.0) == []
    guarded.now_s += 30.0  # the runner was busy; the answer has come long since
    assert guarded.run(2.0) == [] and len(guarded.started) == 1


@pytest.mark.parametrize("dead", [False, True])
def test_a_watchdog_that_was_stopped_together_with_its_runner_is_well(guarded, dead):
    guarded.arm()
    guarded.run(0.25, answering=False)
    guarded.now_s += 7.0  # a beat is unanswered: both were stopped
    guarded.dog.beat()
    assert guarded.told == []
    assert [code for code, _ in guarded.run(2.0, answering=not dead)] == (["watchdog_lost"] if dead else [])


@pytest.mark.parametrize("stopped", [False, True])
def test_a_watchdog_that_is_dead_or_stopped_is_told_within_two_seconds_and_another_put_in_its_place(
    guarded, stopped
):
    guarded.arm()
    guarded.run(3.0)
    lost_s, lost = guarded.now_s, guarded.process
    if not stopped:
        lost.end()
    ((code, told_s),) = guarded.run(2.0, answering=False)
    assert code == "watchdog_lost" and told_s - lost_s <= (1.5 if stopped else 0.25)
    assert lost.killed and lost.waited == 1 and len(guarded.started) == 2
    assert guarded.lease.told == {"watchdog_pid": 4712}
    assert json.loads(guarded.process.read())["runner"] == os.getpid()
    os.write(guarded.process.says, READY + b"\n")
    assert [code for code, _ in guarded.run(0.25, answering=False)] == ["watchdog_back"]
    assert guarded.process.read().startswith(ARM + b"1 ")
    assert guarded.run(30.0) == [] and guarded.stopped == []
    guarded.dog.dismiss()
    assert guarded.told == []


@pytest.mark.parametrize("how", ["does not start", "ends", "is not ready"])
def test_without_another_watchdog_the_run_is_invalid_and_ends(guarded, how):
    guarded.arm()
    guarded.process.end()
    guarded.refused = how == "does not start"
    if how == "ends":
        assert [code for code, _ in guarded.run(0.25)] == ["watchdog_lost"]
        guarded.process.end()
    told = [code for code, _ in guarded.run(25.0, answering=False)]
    assert told[-1] == "unguarded" and told.count("unguarded") == 1
    assert len(guarded.stopped) == 1
    guarded.dog.dismiss()


@pytest.mark.parametrize("stopped", [False, True])
def test_the_alarm_says_which_watchdog_is_lost_and_for_how_long_it_said_nothing(guarded, stopped):
    guarded.arm()
    guarded.now_s += 0.25
    guarded.dog.beat()
    if stopped:
        guarded.now_s += 1.75  # since the beat that was not answered
    else:
        guarded.process.end()
        guarded.now_s += 0.25
    guarded.dog.beat()
    (alarm,) = guarded.told
    assert alarm.facts == {"pid": 4711} | ({"silent_s": pytest.approx(1.75)} if stopped else {})


def test_one_in_place_of_a_lost_watchdog_is_waited_for_twenty_seconds(guarded):
    guarded.arm()
    guarded.process.end()
    guarded.run(0.25)
    for waited_s, stopped in ((19.9, 0), (0.3, 1)):
        guarded.now_s += waited_s
        guarded.dog.beat()
        assert len(guarded.stopped) == stopped


def test_beats_before_the_word_that_arms_have_no_number_to_answer(guarded):
    guarded.process.read()
    guarded.now_s += 0.5
    guarded.dog.beat()
    assert guarded.process.read() == b"0 100.500000\n"


def test_a_watchdog_that_is_lost_again_and_again_ends_the_run(guarded):
    guarded.arm()
    for _ in range(3):
        guarded.process.end()
        assert [code for code, _ in guarded.run(0.25)] == ["watchdog_lost"]
        os.write(guarded.process.says, READY + b"\n")
        assert [code for code, _ in guarded.run(5.0)] == ["watchdog_back"]
    guarded.process.end()
    assert [code for code, _ in guarded.run(0.25)] == ["watchdog_lost", "unguarded"]
    assert len(guarded.stopped) == 1 and len(guarded.started) == 4


def test_a_watchdog_that_died_just_before_the_end_is_told(guarded):
    guarded.arm()
    guarded.process.end()
    guarded.process.returncode = -9
    guarded.dog.dismiss()
    assert [event.code for event in guarded.told] == ["watchdog_lost"]
