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

from bench.control.watchdog import ARMED, DISMISSED, _process, beat_line
from bench.control.watchdog._other import Other
from bench.record.benchfile import load_bench_file
from drivers.base.clock import host_seconds
from drivers.base.errors import ConfigurationError
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
    other = Other.of(runner.pid)
    devices = {name: Device(clock, rest) for name, rest in AT_REST.items()}
    folder = tmp_path / "run"
    folder.mkdir()

    def take_over(silent_s=None, **openers):
        opening = {name: device.open for name, device in devices.items()} | openers
        return _process._take_over(_process.Order(folder, runner.pid, (), opening), other, silent_s)

    yield SimpleNamespace(take_over=take_over, devices=devices, folder=folder, clock=clock, runner=runner)
    runner.kill()
    runner.wait()
    runner.stdin.close()
    os.close(other.held)


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

    def __init__(self, monkeypatch, said, *, runner=7, confirmed=True, lease=(), ready=None, armed=False):
        self.said, self.written, self.taken = list(said), [], []
        system = SimpleNamespace(write=ready or self.write, read=lambda *_: self.said.pop(0))
        quiet = SimpleNamespace(SIGINT=0, SIGTERM=0, SIGHUP=0, SIG_IGN=0, signal=lambda *_: None)
        for name, stand_in in {
            "signal": quiet,
            "os": system,
            "select": SimpleNamespace(select=lambda readers, *_: (readers, [], [])),
            "runqueue_wait_s": lambda pid: 0.0,
            "host_seconds": lambda: 100.3,
            "Other": SimpleNamespace(of=lambda pid: Other(runner)),
            "_read_order": lambda: _process.Order(Path(), 1, lease, {}, armed),
            "_take_over": lambda order, runner, silent_s: (
                self.taken.append((runner.held, silent_s)) or confirmed
            ),
        }.items():
            monkeypatch.setattr(_process, name, stand_in)

    def write(self, descriptor, data):
        self.written.append((descriptor, data))


def lost(*_):
    raise BrokenPipeError


@pytest.mark.parametrize(
    ("said", "settings"),
    [
        ([DISMISS], {}),
        ([b""], {}),  # the runner ended before anything was moved
        ([ARM, FIRST, DISMISS], {}),
        ([ARM + FIRST, FIRST[:3], FIRST[3:] + DISMISS], {}),
        ([b""], {"runner": None}),
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


@pytest.mark.parametrize(("settings", "runner"), [({}, 7), ({"ready": lost}, 7), ({"runner": None}, None)])
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
            "first": None,
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
        "first": None,
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
        "first": 41,
    }
    sent = bytearray(json.dumps(order).encode() + b"\n" + ARM)

    def read(descriptor, count):
        assert descriptor == 0
        data = bytes(sent[:count])
        del sent[:count]
        return data

    monkeypatch.setattr(_process.os, "read", read)
    found = _process._read_order()
    assert (found.run_folder, found.runner, found.lease) == (Path("/runs/r"), 42, (3, 4))
    assert (found.armed, found.first) == (True, 41)
    assert list(found.openers) == ["table", "chamber"]
    assert bytes(sent) == ARM  # it is for the loop that comes after
