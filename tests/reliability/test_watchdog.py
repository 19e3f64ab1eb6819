"""A runner that dies or hangs with the table turning: the watchdog brings the bench to rest and says so."""

import json
import os
import select
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from bench.control.lease import lease_holder, take_lease
from bench.control.live import read_now
from bench.control.watchdog._silence import runqueue_wait_s
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import load_bench_file
from bench.record.events.run import Invalid
from bench.record.events.safe import SafeState
from bench.record.recording import Run, read_exchanges
from drivers.base.clock import host_seconds
from drivers.base.errors import BenchInUse

pytestmark = [pytest.mark.concurrent, pytest.mark.slow]

DEMO = Path(__file__).parents[2] / "examples" / "demo.toml"
PROGRAM = Path(__file__).parent / "runner_program.py"
STOP_TABLE = b":mode:off 1\r\n"
STOP_CHAMBER = b"14001\xb61\xb61\xb60\r"


@contextmanager
def turning(lab, runs, *options):
    """Run the program until the table turns."""
    with subprocess.Popen(
        [sys.executable, str(PROGRAM), str(runs), *options],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        process.stdin.write(json.dumps(lab.file.model_dump(mode="json")).encode() + b"\n")
        process.stdin.flush()
        said = process.stdout.readline()
        assert said == b"turning\n", (said, process.stderr.read() if not said else b"")
        try:
            yield process
        finally:
            process.kill()
            process.stdin.close()


def await_end(pid):
    """Wait for a process that is not our child."""
    try:
        descriptor = os.pidfd_open(pid)
    except ProcessLookupError:
        return
    try:
        assert select.select([descriptor], [], [], 60.0)[0], "the watchdog did not end"
    finally:
        os.close(descriptor)


def watchdogs(process):
    """Return the pids of both watchdogs of a runner, the first one first, once the second is up."""
    found = []

    def both():
        found[:] = [
            int(pid)
            for pid in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
            if b"bench.control.watchdog" in Path(f"/proc/{pid}/cmdline").read_bytes()
        ]
        # it ignores SIGTERM as soon as nothing is left to import
        return len(found) == 2 and all(ignores(pid, signal.SIGTERM) for pid in found)

    assert wait_for(both, 30.0)
    return found


def ignores(pid, number):
    status = Path(f"/proc/{pid}/status").read_text()
    (mask,) = (line.split()[1] for line in status.splitlines() if line.startswith("SigIgn"))
    return int(mask, 16) >> (number - 1) & 1


def watchdog_events(folder):
    return [json.loads(line) for line in (folder / "watchdog" / "events.jsonl").read_text().splitlines()]


@pytest.fixture(scope="module")
def lab():
    file = load_bench_file(DEMO)
    with EmulatedLab(file.model_copy(update={"gyro": file.gyro[:1]}), Plant(), clock="wall") as lab:
        yield lab


@pytest.mark.parametrize(
    ("number", "cause"),
    [(signal.SIGKILL, "runner_ended"), (signal.SIGSTOP, "runner_silent")],
)
def test_the_watchdog_takes_over_from_a_runner_that_is_gone_or_hangs(lab, tmp_path, number, cause):
    with turning(lab, tmp_path) as process:
        holder = lease_holder(lab.file)
        assert holder.pid == process.pid and holder.watchdog_pid > 0
        watchdog = holder.watchdog_pid
        for harmless in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):  # meant for the runner
            os.kill(watchdog, harmless)
        if number == signal.SIGSTOP:  # the lease is looked at while the watchdog cannot let go of it
            os.kill(watchdog, signal.SIGSTOP)
        process.send_signal(number)
        if number == signal.SIGSTOP:
            with pytest.raises(BenchInUse, match="process"):
                take_lease(lab.file, "another")
            os.kill(watchdog, signal.SIGCONT)
        await_end(watchdog)
        assert process.wait() == -signal.SIGKILL
    folder = tmp_path / "run"
    rows = watchdog_events(folder)
    assert rows[0]["kind"] == "takeover" and rows[0]["cause"] == cause
    safe = {row["device"]: row for row in rows if row["kind"] == "safe_state"}
    assert {row["state"] for row in safe.values()} == {"confirmed"}
    assert abs(safe["table"]["rates_dps"]["table"]) < 0.01
    # the emulated controller's set point follows a demand with the next of its steps of one second
    assert safe["chamber"]["running"] is False
    assert safe["chamber"]["set_point_c"] == pytest.approx(25.0, abs=0.5)
    assert (rows[-1]["kind"], rows[-1]["confirmed"]) == ("takeover_ended", True)
    for port, stop in (("table", STOP_TABLE), ("chamber", STOP_CHAMBER)):
        assert stop in b"".join(
            data for _, way, data in read_exchanges(folder / "watchdog", port) if way == "sent"
        )
    assert Run.open(folder).manifest.outcome == "running"
    take_lease(lab.file, "another").release()


@pytest.mark.parametrize("runner", [signal.SIGKILL, signal.SIGSTOP])
@pytest.mark.parametrize("first", [signal.SIGKILL, signal.SIGSTOP])
def test_when_runner_and_first_watchdog_are_lost_at_once_the_second_brings_the_bench_to_rest(
    lab, tmp_path, first, runner
):
    with turning(lab, tmp_path) as process:
        pids = watchdogs(process)
        os.kill(pids[0], first)
        process.send_signal(runner)
        await_end(pids[1])
        assert process.wait() == -signal.SIGKILL
    rows = watchdog_events(tmp_path / "run")
    assert rows[0]["cause"] == ("runner_ended" if runner == signal.SIGKILL else "runner_silent")
    assert {row["state"] for row in rows if row["kind"] == "safe_state"} == {"confirmed"}
    assert (rows[-1]["kind"], rows[-1]["confirmed"]) == ("takeover_ended", True)
    take_lease(lab.file, "another").release()


SUPPLY = """
[[supply]]
name = "psu"
driver = "rs_hmp"
port = "/dev/ttyUSB9"
start_s = 2
outputs = [{ number = 2, voltage_v = 5.0, current_limit_a = 1.0, units = ["fog_1"], safe = "off" }]
"""


def test_a_supply_that_is_to_be_off_is_switched_off_by_the_watchdog(tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text(DEMO.read_text() + SUPPLY)
    file = load_bench_file(path)
    file = file.model_copy(update={"gyro": file.gyro[:1]})
    with EmulatedLab(file, Plant(), clock="wall") as lab, turning(lab, tmp_path / "runs") as process:
        watchdog = lease_holder(lab.file).watchdog_pid
        process.send_signal(signal.SIGKILL)
        await_end(watchdog)
    rows = watchdog_events(tmp_path / "runs" / "run")
    safe = {row["device"]: row for row in rows if row["kind"] == "safe_state"}
    assert {row["state"] for row in safe.values()} == {"confirmed"}
    assert safe["psu"]["outputs"] == {"2": False}
    told = [data for _, way, data in read_exchanges(tmp_path / "runs/run/watchdog", "psu") if way == "sent"]
    assert b"INST:NSEL 2\nOUTP:SEL 0\n" in b"".join(told)


def test_a_runner_that_ends_well_dismisses_its_watchdog(lab, tmp_path):
    with turning(lab, tmp_path) as process:
        watchdog = lease_holder(lab.file).watchdog_pid
        process.send_signal(signal.SIGTERM)
        assert process.stdout.readline() == b"aborted\n"
        process.wait()
        await_end(watchdog)
    assert not (tmp_path / "run" / "watchdog").exists()
    assert lease_holder(lab.file) is None


def alarms(folder):
    """Return (bench time, code) of alarms and reasons to be invalid so far."""
    lines = (folder / "events.jsonl").read_text().splitlines()
    rows = [json.loads(line) for line in lines if line.endswith("}")]
    return [(row["time_s"], row["code"]) for row in rows if row["kind"] in ("alarm", "invalid")]


def began_s(folder):
    """Return the host's monotonic time at bench time zero: the program notes it once."""
    rows = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    note = next(row for row in rows if row["kind"] == "note")
    return float(note["text"]) - note["time_s"]


def wait_for(condition, timeout_s):
    """Look until something holds; return whether it does."""
    until_s = host_seconds() + timeout_s
    while not (held := condition()) and host_seconds() < until_s:
        select.select([], [], [], 0.02)
    return held


def shown(folder):
    return [row.get("code") for row in read_now(folder)["alarms"]]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_dead_or_stopped_watchdog_is_an_alarm_within_two_seconds_and_the_next_one_guards(
    lab, tmp_path, number
):
    folder = tmp_path / "run"
    with turning(lab, tmp_path) as process:
        first = lease_holder(lab.file).watchdog_pid
        waited_s = runqueue_wait_s(process.pid) + runqueue_wait_s(first)
        os.kill(first, number)
        killed_s = host_seconds()
        assert wait_for(lambda: alarms(folder) and "watchdog_lost" in shown(folder), 20.0)
        # on a loaded machine: what kept the two from running
        waited_s = max(runqueue_wait_s(process.pid) + runqueue_wait_s(first) - waited_s, 0.0)
        assert alarms(folder)[0][0] + began_s(folder) - killed_s <= 2.0 + waited_s
        terminal = b""
        while b"ALARM" not in terminal and select.select([process.stderr], [], [], 2.0)[0]:
            terminal += os.read(process.stderr.fileno(), 1 << 16)
        assert b"watchdog" in terminal
        assert wait_for(lambda: [code for _, code in alarms(folder)][-1] == "watchdog_back", 20.0)
        second = lease_holder(lab.file).watchdog_pid
        assert second != first and not Path(f"/proc/{first}").exists()
        assert not (folder / "watchdog").exists()  # nobody has taken over
        process.send_signal(signal.SIGKILL)
        await_end(second)
    rows = watchdog_events(folder)
    assert (rows[0]["kind"], rows[0]["cause"]) == ("takeover", "runner_ended")
    assert (rows[-1]["kind"], rows[-1]["confirmed"]) == ("takeover_ended", True)


@pytest.mark.parametrize(("stopped_s", "code"), [(4.0, "poll_gap"), (13.0, "unwatched")])
def test_a_bench_that_stood_still_as_a_whole_says_so_and_ends_when_it_was_long(
    lab, tmp_path, stopped_s, code
):
    """Runner and watchdogs are stopped and go on together, as on a virtual machine that was paused."""
    folder = tmp_path / "run"
    with turning(lab, tmp_path) as process:
        pids = [process.pid, *watchdogs(process)]
        for number in (signal.SIGSTOP, signal.SIGCONT):
            for pid in pids:
                os.kill(pid, number)
            if number == signal.SIGSTOP:
                with pytest.raises(subprocess.TimeoutExpired):
                    process.wait(timeout=stopped_s)
        assert wait_for(lambda: alarms(folder), 20.0) and alarms(folder)[0][1] == code
        if code == "poll_gap":
            assert wait_for(lambda: code in shown(folder), 20.0)
            process.send_signal(signal.SIGTERM)
        assert process.stdout.readline() == b"aborted\n"
        process.wait()
    run = Run.open(folder)
    assert ("nobody watched" in run.manifest.reason) == (code == "unwatched")
    assert {state.device for _, state in run.of(SafeState) if state.confirmed} == {"table", "chamber"}
    assert not (folder / "watchdog").exists()  # nobody took over


def test_a_run_without_another_watchdog_ends_invalid_with_the_bench_at_rest(lab, tmp_path):
    folder = tmp_path / "run"
    with turning(lab, tmp_path, "no-other-watchdog") as process:
        for pid in watchdogs(process):
            os.kill(pid, signal.SIGKILL)
        assert process.stdout.readline() == b"aborted\n"
        process.wait()
    run = Run.open(folder)
    assert "watchdog" in run.manifest.reason
    assert "unguarded" in [invalid.code for _, invalid in run.of(Invalid)]
    safe = [state for _, state in run.of(SafeState)]
    assert {state.device for state in safe} == {"table", "chamber"} and all(state.confirmed for state in safe)


def test_a_run_whose_watchdog_was_lost_can_be_stopped_as_any_other(lab, tmp_path):
    with turning(lab, tmp_path) as process:
        os.kill(lease_holder(lab.file).watchdog_pid, signal.SIGKILL)
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(timeout=1.5)
        process.send_signal(signal.SIGTERM)
        assert process.stdout.readline() == b"aborted\n"
