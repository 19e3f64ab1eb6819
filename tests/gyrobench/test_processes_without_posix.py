"""Runner, watchdog and lab as processes of their own, all without what Windows lacks."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from bench.control.lease import lease_holder
from bench.control.watchdog import DISMISSED, beat_line
from bench.record.benchfile import BenchFile, bench_file_from, load_bench_file
from bench.record.recording import Run, read_exchanges
from drivers.base.clock import host_seconds
from drivers.base.system import state_folder
from tests.gyrobench.hidden_posix import hidden_alike, said

pytestmark = [pytest.mark.concurrent, pytest.mark.slow]

DEMO = Path(__file__).parents[2] / "examples" / "demo.toml"
STOP_TABLE = b":mode:off 1\r\n"
LAB = """
import json, sys
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import load_bench_file

file = load_bench_file(sys.argv[1])
with EmulatedLab(file.model_copy(update={"gyro": file.gyro[:1]}), Plant(), clock="wall") as lab:
    print(json.dumps(lab.file.model_dump(mode="json")), flush=True)
    sys.stdin.read()
"""
RUNNER = """
import json, sys
from pathlib import Path
from bench.control.procedure import Demands, Parameters, Procedure
from bench.control.questions import AssumeYes
from bench.control.runner import RunRequest, run_procedure
from bench.record.benchfile import bench_file_from

def turn(bench, _):
    bench.table.device.servo_on()
    bench.chamber.go_to(10.0)
    bench.chamber.start()
    bench.table.spin(10.0)
    print("turning", flush=True)
    bench.wait(float(sys.argv[1]), "turning")

procedure = Procedure("turn", "", "", Parameters, turn, lambda _: 60.0, lambda _: Demands(10.0, 10.0))
file = bench_file_from(json.loads(sys.stdin.readline()))
print(run_procedure(RunRequest(procedure, Parameters(), file, Path("runs"), AssumeYes(), run_id="run")).outcome)
"""
DRIVE = """
import sys
from bench.control.procedure import find_procedure
from bench.control.questions import EmulatedOperator
from bench.control.runner import RunRequest
from bench.lab.emulated import EmulatedLab, Plant
from bench.lab.rehearsal import run_in_lab
from bench.record.benchfile import load_bench_file
from bench.record.recording import Run
from pathlib import Path

file, procedure = load_bench_file(sys.argv[1]), find_procedure("known-state")
with EmulatedLab(file, Plant(seed=3), apart=sys.argv[2] == "apart") as lab:
    operator = EmulatedOperator(lab.perform)
    result = run_in_lab(RunRequest(procedure, procedure.parse({}), file, Path("ran"), operator), lab)
    assert result.outcome == "completed", result.reason
print({n: e.sha256 for n, e in Run.open(result.folder).manifest.files.items() if n.startswith("raw/")})
print(lab.clock_url.rpartition(":")[0], file=sys.stderr)
"""


@contextmanager
def started(code: str, folder: Path, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """Start a process that hides, as its children do, what Windows lacks."""
    with subprocess.Popen(
        [sys.executable, "-c", code, *words],
        cwd=folder,
        env=hidden_alike(folder),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def answer(process: subprocess.Popen[bytes], line: bytes = b"") -> bytes:
    assert process.stdin is not None and process.stdout is not None and process.stderr is not None
    if line:
        process.stdin.write(line + b"\n")
        process.stdin.flush()
    said = process.stdout.readline()
    assert said, process.stderr.read().decode()
    return said.rstrip(b"\n")


@contextmanager
def bench_in_a_lab(folder: Path) -> Iterator[BenchFile]:
    with started(LAB, folder, str(DEMO)) as lab:
        file = bench_file_from(json.loads(answer(lab)))
        assert {place.partition("://")[0] for place in file.ports.values()} == {"socket"}
        yield file
        assert lab.stdin is not None
        lab.stdin.close()
        assert lab.wait(30) == 0


def as_line(file: BenchFile) -> bytes:
    return json.dumps(file.model_dump(mode="json")).encode()


def await_end(descriptor: int) -> None:
    try:
        assert select.select([descriptor], [], [], 60.0)[0], "the process did not end"
    finally:
        os.close(descriptor)


@pytest.fixture(autouse=True)
def own_state_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.mark.parametrize(
    ("number", "cause"), [(signal.SIGKILL, "runner_ended"), (signal.SIGSTOP, "runner_silent")]
)
def test_the_watchdog_brings_the_bench_to_rest(tmp_path: Path, number: signal.Signals, cause: str) -> None:
    with bench_in_a_lab(tmp_path) as file, started(RUNNER, tmp_path, "3600") as runner:
        assert answer(runner, as_line(file)) == b"turning"
        holder = lease_holder(file)
        assert holder is not None and holder.pid == runner.pid
        watchdog = os.pidfd_open(holder.watchdog_pid)
        for harmless in (signal.SIGTERM, signal.SIGINT):  # meant for the runner
            signal.pidfd_send_signal(watchdog, harmless)
        runner.send_signal(number)
        await_end(watchdog)
        assert runner.wait(30) == -signal.SIGKILL
        assert lease_holder(file) is None
    folder = tmp_path / "runs" / "run"
    rows: list[dict[str, Any]] = [
        json.loads(line) for line in (folder / "watchdog" / "events.jsonl").read_text().splitlines()
    ]
    assert [row["kind"] for row in rows] == ["takeover", "safe_state", "safe_state", "takeover_ended"]
    assert rows[0]["cause"] == cause and rows[-1]["confirmed"] is True
    safe = {row["device"]: row for row in rows[1:-1]}
    assert {row["state"] for row in safe.values()} == {"confirmed"}
    assert abs(safe["table"]["rates_dps"]["table"]) < 0.01 and safe["chamber"]["running"] is False
    sent = (data for _, way, data in read_exchanges(folder / "watchdog", "table") if way == "sent")
    assert STOP_TABLE in b"".join(sent)
    assert Run.open(folder).manifest.outcome == "running"
    # the watchdog has had the lease: what is left of a killed holder lies there until the next one
    assert list((state_folder() / "leases").iterdir()) == []
    hidden = (tmp_path / "hidden").read_text()
    assert all(module in hidden for module in ("-m bench.control.watchdog", "-m simulators.lab"))


def test_a_run_without_incident_dismisses_its_watchdog(tmp_path: Path) -> None:
    with bench_in_a_lab(tmp_path) as file, started(RUNNER, tmp_path, "1") as runner:
        assert answer(runner, as_line(file)) == b"turning"
        holder = lease_holder(file)
        assert holder is not None
        watchdog = os.pidfd_open(holder.watchdog_pid)
        assert answer(runner) == b"completed"
        await_end(watchdog)
        assert runner.wait(30) == 0 and lease_holder(file) is None
    assert not (tmp_path / "runs" / "run" / "watchdog").exists()
    assert "watchdog_lost" not in (tmp_path / "runs" / "run" / "events.jsonl").read_text()


def test_a_watchdog_that_is_stopped_is_replaced(tmp_path: Path) -> None:
    """The next one guards: it takes over when the runner dies."""
    with bench_in_a_lab(tmp_path) as file, started(RUNNER, tmp_path, "3600") as runner:
        assert answer(runner, as_line(file)) == b"turning"
        holder = lease_holder(file)
        assert holder is not None
        first, events = holder.watchdog_pid, tmp_path / "runs" / "run" / "events.jsonl"
        os.kill(first, signal.SIGSTOP)
        until_s = host_seconds() + 60.0
        while "watchdog_back" not in events.read_text() and host_seconds() < until_s:
            select.select([], [], [], 0.05)
        holder = lease_holder(file)
        assert holder is not None and holder.watchdog_pid != first
        watchdog = os.pidfd_open(holder.watchdog_pid)
        runner.kill()
        await_end(watchdog)
    rows = (tmp_path / "runs" / "run" / "watchdog" / "events.jsonl").read_text().splitlines()
    assert json.loads(rows[-1])["confirmed"] is True


def test_a_runner_that_reads_nothing_does_not_stop_its_watchdog(tmp_path: Path) -> None:
    """The echoes are more than pipe and sockets hold."""
    order = {
        "bench": load_bench_file(DEMO).model_dump(mode="json"),
        "run_folder": str(tmp_path / "nowhere"),
        "runner": os.getpid(),
        "lease": [],
        "armed": False,
        "first": None,
    }
    with subprocess.Popen(
        [sys.executable, "-P", "-m", "bench.control.watchdog"],
        env=hidden_alike(tmp_path),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as guard:
        assert guard.stdin is not None
        beat = beat_line(1, host_seconds()).rstrip(b"\n") + b"0" * 4000 + b"\n"
        guard.stdin.write(json.dumps(order).encode() + b"\n")
        for _ in range(4000):
            guard.stdin.write(beat)
        guard.stdin.write(DISMISSED + b"\n")
        guard.stdin.flush()
        try:
            assert guard.wait(60) == 0
        finally:
            guard.kill()


def test_a_lab_of_its_own_in_virtual_time_gives_the_same_bytes(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    with started(DRIVE, there, str(DEMO), "apart") as hidden:
        said_hidden, errors = hidden.communicate(timeout=200)
    assert hidden.returncode == 0, errors.decode()
    assert said_hidden.decode() == said(DRIVE, here, str(DEMO), "in this process")
    assert b"virtual://127.0.0.1" in errors
    assert "-m simulators.lab" in (there / "hidden").read_text()
