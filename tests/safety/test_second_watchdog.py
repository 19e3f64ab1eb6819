"""When the second watchdog leaves the bench to the first, and what is kept of one that died in its work."""

import json
import os
import signal
import subprocess
import sys

import pytest

from bench.control.watchdog import _other
from bench.control.watchdog._other import Other, set_aside, sign_of_life

pytestmark = pytest.mark.concurrent

ENDED = {"time_s": 1.0, "kind": "takeover_ended", "confirmed": True}
BEGUN = {
    "time_s": 0.0,
    "kind": "takeover",
    "cause": "runner_ended",
    "utc": "2026-11-26T00:00:00+00:00",
    "runner": 4711,
}


class Waits:
    """The clock of who waits for another process: time passes as it waits, and `then` happens at its time."""

    def __init__(self, monkeypatch, **then):
        self.now_s, self.then = 0.0, then
        self.ended_s = None
        monkeypatch.setattr(_other, "host_seconds", lambda: self.now_s)
        monkeypatch.setattr(Other, "ends_within", self.wait)
        monkeypatch.setattr(Other, "end", self.end)

    def wait(self, timeout_s):
        self.now_s = round(self.now_s + timeout_s, 6)
        assert self.now_s < 100.0, "it waits for ever"
        for at in [at for at in self.then if float(at[1:]) <= self.now_s]:
            if self.then.pop(at)():
                self.ended_s = self.now_s
        return self.ended_s is not None

    def end(self):
        self.ended_s = self.now_s


def written(folder, *rows):
    folder.mkdir(exist_ok=True)
    (folder / "events.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "watchdog"


def test_one_that_does_not_begin_in_time_is_ended(monkeypatch, folder):
    waits = Waits(monkeypatch)
    assert Other(7).has_done_it(folder, 0.3) is False
    assert 0.3 < waits.ended_s < 0.35


def test_one_that_begins_in_time_is_waited_for_to_its_end_however_long_while_it_gives_signs(
    monkeypatch, folder
):
    signs = {f"t{second}": lambda: sign_of_life(folder) for second in range(1, 70)}
    waits = Waits(
        monkeypatch,
        **{"t0.2": lambda: written(folder, BEGUN)},
        **signs,
        t70=lambda: written(folder, BEGUN, ENDED) or True,
    )
    assert Other(7).has_done_it(folder, 0.3) is True
    assert waits.ended_s == pytest.approx(70.0)


@pytest.mark.parametrize("begun", [False, True])
def test_one_that_stands_still_in_its_work_is_ended_after_two_seconds(monkeypatch, folder, begun):
    if begun:
        written(folder, BEGUN)
    waits = Waits(monkeypatch, **({} if begun else {"t0.2": lambda: written(folder, BEGUN)}))
    assert Other(7).has_done_it(folder, 0.3) is False
    assert waits.ended_s == pytest.approx(2.0 if begun else 2.2, abs=0.05)


@pytest.mark.parametrize("torn", [b"", b'{"time_s": 1.0, "ki', b'{"broken\n{"broken\n'])
def test_one_that_died_in_its_work_has_not_done_it(monkeypatch, folder, torn):
    def die():
        written(folder, BEGUN)
        with (folder / "events.jsonl").open("ab") as file:
            file.write(torn)
        return True

    Waits(monkeypatch, **{"t0.2": die})
    assert Other(7).has_done_it(folder, 0.3) is False


def test_one_whose_bench_could_not_be_confirmed_has_done_what_it_could(monkeypatch, folder):
    Waits(monkeypatch, **{"t0.1": lambda: written(folder, BEGUN, ENDED | {"confirmed": False}) or True})
    assert Other(7).has_done_it(folder, 0.3) is True


def test_a_sign_of_life_in_a_folder_that_is_gone_is_none(folder):
    sign_of_life(folder)
    assert not folder.exists()


@pytest.mark.parametrize("there", ["nothing", "an empty folder", "another's"])
def test_what_another_left_is_kept_beside_and_out_of_the_way(folder, there):
    if there != "nothing":
        folder.mkdir()
    if there == "another's":
        written(folder, BEGUN)
        (folder / "raw").mkdir()
        (folder / "raw" / "table.bin").write_bytes(b"x")
    set_aside(folder)
    found = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    kept = ["unfinished/events.jsonl", "unfinished/raw/table.bin"]
    assert found == (kept if there == "another's" else [])


def test_a_process_is_held_whatever_gets_its_number_later():
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    other = Other.of(process.pid)
    assert not other.ends_within(0.0)
    os.kill(process.pid, signal.SIGSTOP)  # a stopped process is ended too
    other.end()
    assert process.wait(10.0) == -signal.SIGKILL and other.ends_within(0.0)
    other.end()
    process.stdin.close()
    os.close(other.held)
    gone = Other.of(process.pid)
    assert gone.held is None and gone.ends_within(0.0)
    gone.end()
