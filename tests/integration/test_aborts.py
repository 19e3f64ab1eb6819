"""A run that ends early: the bench is made safe, what was received is kept and can be read and verified."""

import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.control.devices import open_chamber, open_table
from bench.control.procedure import find_procedure
from bench.control.questions import AssumeYes, Question, Reply
from bench.control.runner import RunRequest, run_procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import bench_file_text, load_bench_file
from bench.record.recording import Run, read_exchanges
from drivers.base.errors import BenchError, LinkLost, RecordError, RunAborted, RunUnsealed
from drivers.base.virtual_clock import VirtualClock

CLI = "import bench.present.cli; bench.present.cli.main()"
STOP_TABLE = b":mode:off 1\r\n"
STOP_CHAMBER = b"14001\xb61\xb61\xb60\r"
SAFE_SET_POINT = b"11001\xb61\xb61\xb625.0\r"


def events(folder):
    return [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]


def manifest(folder):
    return json.loads((folder / "manifest.json").read_text())


def sent(folder, port):
    path = folder / "raw" / f"{port}.sent.bin"
    return path.read_bytes() if path.exists() else b""


def assert_safe_and_readable(tools, folder):
    """The last bytes to table and chamber are those that bring them to rest, each confirmed."""
    assert manifest(folder)["outcome"] == "aborted"
    assert events(folder)[-1]["outcome"] == "aborted"
    assert STOP_TABLE in sent(folder, "table").rsplit(b":demand", 1)[-1]
    chamber = sent(folder, "chamber")
    assert chamber.rfind(STOP_CHAMBER) < chamber.rfind(SAFE_SET_POINT)
    assert b"14001\xb61\xb61\xb61\r" not in chamber[chamber.rfind(STOP_CHAMBER) :]
    assert [row["text"] for row in events(folder) if row["kind"] == "alarm"] == []
    assert tools.problems(folder) == []


class InterruptAfter:
    """An emulator's double that has Ctrl-C pressed when it is sent its n-th message."""

    def __init__(self, emulator, count, number=signal.SIGINT):
        self._emulator, self._left, self._number = emulator, count, number

    def receive(self, data, now_s):
        self._left -= 1
        if self._left == 0:
            os.kill(os.getpid(), self._number)
        return self._emulator.receive(data, now_s)


MOMENTS = sorted(random.Random(20261121).sample(range(4, 160), 12))


@pytest.mark.parametrize("moment", MOMENTS)
def test_ctrl_c_at_any_moment_leaves_a_safe_bench_and_a_whole_record(bench, fog_file, tmp_path, moment):
    number = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)[moment % 3]
    ours = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # whoever runs the tests under nohup ignores it
    before = signal.getsignal(number)
    swap = {"chamber": lambda emulator, lab, index: InterruptAfter(emulator, moment, number)}
    procedure = find_procedure("zero-bias-cold-shock")
    with bench.lab(fog_file, Plant(seed=2), swap) as lab:
        result = bench.drive(lab.file, tmp_path, procedure, east_after_min=0, east_dwell_s=60)
    assert result.outcome == "aborted"
    assert isinstance(result.error, RunAborted)
    assert result.reason == f"stopped by {'Ctrl-C' if number == signal.SIGINT else number.name}."
    assert signal.getsignal(number) is before
    signal.signal(signal.SIGHUP, ours)
    if any(row["kind"].startswith("demand_") for row in events(result.folder)):
        assert_safe_and_readable(bench, result.folder)
        received = (result.folder / "raw" / "fog_1.bin").read_bytes()
        assert Run.open(result.folder).manifest.stream["fog_1"]["bytes_received"] == len(received)
    else:
        assert bench.problems(result.folder) == []


def test_stop_commands_leave_on_both_ports_before_any_answer_is_awaited(bench, fog_file, tmp_path):
    swap = {"chamber": lambda emulator, lab, index: InterruptAfter(emulator, 60)}
    with bench.lab(fog_file, Plant(), swap) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=200.0)
    assert_safe_and_readable(bench, result.folder)
    table = list(read_exchanges(result.folder, "table"))
    chamber = list(read_exchanges(result.folder, "chamber"))
    stopped_ns = next(t for t, way, data in reversed(table) if way == "sent" and data == STOP_TABLE)
    cut_ns = next(t for t, way, data in reversed(chamber) if way == "sent" and data == STOP_CHAMBER)
    confirmed_ns = next(t for t, way, _ in table if way == "received" and t > stopped_ns)
    assert stopped_ns <= cut_ns + 1000 < confirmed_ns
    assert any(t > cut_ns and way == "received" and data == b"1\r\n" for t, way, data in chamber)
    made_safe = [row for row in events(result.folder) if row["kind"] == "safe_state"]
    assert made_safe[0]["why"] == "stopped by Ctrl-C."


@pytest.mark.concurrent
@pytest.mark.slow
def test_a_killed_lab_ends_the_run_with_one_clear_paragraph(bench, fog_file, tmp_path):
    with EmulatedLab(fog_file, Plant(), apart=True) as lab:

        def kill(progress):
            if progress.phase == "spin" and progress.time_s > 30.0:
                lab._lab.kill()

        result = bench.drive(lab.file, tmp_path, display=kill, hold_s=1e6)
    assert result.outcome == "aborted"
    assert isinstance(result.error, LinkLost)
    assert "\n" not in result.reason and "Remedy" in result.reason
    assert "NOT CONFIRMED SAFE" in result.reason and "table" in result.reason and "chamber" in result.reason
    assert Run.open(result.folder).manifest.reason == result.reason
    states = [row["state"] for row in events(result.folder) if row["kind"] == "safe_state"]
    assert sorted(states) == ["not_confirmed", "not_confirmed", "pending", "pending"]
    table = Run.open(result.folder).gyro("fog_1", ("time_ns",))
    assert len(table["time_ns"]) > 100 * 25
    assert bench.problems(result.folder) == []


def test_a_full_disk_ends_the_run_and_keeps_what_was_written(bench, fog_file, tmp_path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        with bench.lab(fog_file, Plant()) as lab:
            resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, limits[1]))
            result = bench.drive(lab.file, tmp_path, hold_s=3600.0)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert result.outcome == "aborted"
    assert isinstance(result.error, RecordError)
    assert "fog_1.bin" in result.reason and "cannot be recorded any further" in result.reason
    assert bench.problems(result.folder) == []
    assert (result.folder / "raw" / "fog_1.bin").stat().st_size == 300_000
    assert manifest(result.folder)["outcome"] == "aborted"
    start = manifest(result.folder)["stream"]["fog_1"]["start_offset"]
    frames = len(Run.open(result.folder).gyro("fog_1", ("time_ns",))["time_ns"])
    assert frames == (300_000 - start) // 36 > 7000  # every whole Format A message that the disk took


def test_an_operator_who_says_no_ends_the_run_before_anything_moves(bench, fog_file, tmp_path):
    class No:
        def ask(self, question: Question):
            return lambda: Reply("No", "a careful man")

    with bench.lab(fog_file, Plant()) as lab:
        result = bench.drive(lab.file, tmp_path, find_procedure("zero-bias-cold-shock"), operator=No())
    assert result.outcome == "aborted" and "answered 'No'" in result.reason
    assert b":demand" not in sent(result.folder, "table")
    assert_safe_and_readable(bench, result.folder)


def test_a_bug_in_a_procedure_makes_the_bench_safe_and_is_not_swallowed(bench, fog_file, tmp_path):
    def run(session, p):
        session.table.device.servo_on()
        session.table.spin(5.0)
        raise ZeroDivisionError("a bug")

    with bench.lab(fog_file, Plant()) as lab, pytest.raises(ZeroDivisionError):
        bench.drive(lab.file, tmp_path, replace(bench.spin, run=run))
    folder = tmp_path / "run"
    assert manifest(folder)["reason"] == "ZeroDivisionError: a bug"
    assert_safe_and_readable(bench, folder)


def test_a_run_whose_last_step_fails_is_sealed_as_aborted(bench, fog_file, tmp_path):
    def fail(folder):
        raise BenchError("the truth could not be kept")

    with bench.lab(fog_file, Plant()) as lab:
        request = RunRequest(
            bench.spin, bench.spin.parse({"hold_s": 1.0}), lab.file, tmp_path, AssumeYes(), before_close=fail
        )
        result = run_procedure(request)
    assert result.outcome == manifest(result.folder)["outcome"] == "aborted"
    assert "the truth could not be kept" in result.reason
    assert bench.problems(result.folder) == []


def test_ctrl_c_while_the_record_is_closed_is_told_in_words(bench, fog_file, tmp_path):
    """The bench is at rest by then, and what was recorded is kept."""

    def interrupted(folder):
        raise KeyboardInterrupt

    with bench.lab(fog_file, Plant()) as lab:
        request = RunRequest(
            bench.spin,
            bench.spin.parse({"hold_s": 1.0}),
            lab.file,
            tmp_path,
            AssumeYes(),
            before_close=interrupted,
            run_id="run",
        )
        with pytest.raises(KeyboardInterrupt):
            run_procedure(request)
    assert manifest(tmp_path / "run")["reason"] == "stopped by Ctrl-C"
    assert_safe_and_readable(bench, tmp_path / "run")


@pytest.mark.concurrent
@pytest.mark.slow
def test_a_run_in_a_thread_leaves_the_signals_to_whoever_owns_them(bench, fog_file, tmp_path):
    results = []
    before = signal.getsignal(signal.SIGINT)
    with bench.lab(fog_file, Plant()) as lab:
        thread = threading.Thread(target=lambda: results.append(bench.drive(lab.file, tmp_path, hold_s=1.0)))
        thread.start()
        thread.join()
    assert results[0].outcome == "completed"
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.concurrent
@pytest.mark.slow
def test_signals_to_a_run_on_the_wall_clock(fog_text, tmp_path):
    """`gyrobench run` against a lab on the wall clock, SIGTERM: exit code 3, safe bytes sent and confirmed."""
    path = tmp_path / "lab.toml"
    path.write_text(fog_text)
    with EmulatedLab(load_bench_file(path), Plant(), clock="wall") as lab:
        path.write_text(bench_file_text(lab.file))
        process = subprocess.Popen(
            [
                *(sys.executable, "-c", CLI, "run", "zero-bias-cold-shock", "--yes"),
                *("--bench", str(path), "--runs", str(tmp_path / "runs")),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert process.stdout is not None
        first = process.stdout.readline()
        assert "S111" in first, first + process.stdout.read()
        process.send_signal(signal.SIGTERM)
        said, _ = process.communicate(timeout=30)
    assert process.returncode == 3, said
    assert "stopped by SIGTERM" in said and "Traceback" not in said and "shut down" not in said
    (folder,) = (tmp_path / "runs").iterdir()
    exchanges = list(read_exchanges(folder, "table"))
    stop_ns = next(t for t, way, data in exchanges if way == "sent" and data == STOP_TABLE)
    assert any(t > stop_ns and way == "received" and data.endswith(b"OK") for t, way, data in exchanges)
    chamber = list(read_exchanges(folder, "chamber"))
    safe_ns = next(t for t, way, data in chamber if way == "sent" and data == SAFE_SET_POINT)
    assert any(t > safe_ns and way == "received" and data == b"1\r\n" for t, way, data in chamber)
    assert manifest(folder)["outcome"] == "aborted"
    assert manifest(folder)["emulated"]["seed"] == 1
    verified = subprocess.run(
        [sys.executable, "-c", CLI, "runs", "verify", str(folder)], capture_output=True, text=True
    )
    assert verified.returncode == 0, verified.stdout + verified.stderr
    assert np.all(np.diff([t for t, _, _ in exchanges]) >= 0)


def test_a_run_folder_that_is_gone_ends_the_run_with_the_bench_at_rest(bench, fog_file, tmp_path):
    """As when its mount is gone for good: not even the manifest can be written. The bench comes first."""

    def remove(progress):
        if progress.phase == "spin" and progress.time_s > 20.0:
            shutil.rmtree(tmp_path / "run", ignore_errors=True)

    with bench.lab(fog_file, Plant(seed=5)) as lab:
        with pytest.raises(
            RunUnsealed, match=f"{tmp_path / 'run'}: the run folder could not be closed"
        ) as told:
            bench.drive(lab.file, tmp_path, display=remove, hold_s=1e5)
        clock = VirtualClock(lab.file.bench.clock)
        rests = []
        for opener in (open_table, open_chamber):
            device = opener(lab.file, clock, SimpleNamespace(received=lambda *_: 0, sent=lambda *_: 0))
            rests.append(device.read_rest())
            device.link.close()
        clock.close()
    assert [rest.reached for rest in rests] == [True, True], rests
    text = str(told.value)
    assert "Bench: table at rest: 0.0000 deg/s; chamber at rest: stopped" in text
    assert "the run ended as aborted: " in text and f"`gyrobench runs recover {tmp_path / 'run'}`" in text
