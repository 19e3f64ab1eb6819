"""One user a bench: who comes second is told who has it; what the dead leave behind binds nobody."""

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import tempfile

import pytest

from bench.control.lease import lease_holder, take_lease
from bench.control.process import process_start
from bench.record.benchfile import bench_file_from
from drivers.base.errors import BenchError, BenchInUse, ConfigurationError
from drivers.base.system import state_folder

pytestmark = pytest.mark.concurrent

HOLD = """
import sys, json
from bench.record.benchfile import bench_file_from
from bench.control.lease import take_lease
lease = take_lease(bench_file_from(json.loads(sys.argv[1])), "run of another")
print("taken", flush=True)
sys.stdin.read()
"""


def bench_data(table="/dev/ttyT0", chamber="socket://10.0.0.2:2049", gyro="/dev/ttyG0"):
    return {
        "bench": {"name": "bench 1", "latitude_deg": 40.0},
        "table": {"driver": "acutrol3000", "port": table},
        "chamber": {"driver": "weiss", "port": chamber},
        "gyro": [{"name": "fog_1", "driver": "kvh1750", "unit": "F1", "axis": "x", "port": gyro}],
    }


def bench_file(**ports):
    return bench_file_from(bench_data(**ports))


@pytest.fixture(autouse=True)
def own_state_folder(tmp_path, monkeypatch):
    """Tests that kill a runner leave its leases; those are not looked for here."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def lease_files():
    return sorted((state_folder() / "leases").glob("*"))


@pytest.fixture
def another():
    """A process that holds the lease of the default bench until it is told to end."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, json.dumps(bench_data())], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout.readline() == b"taken\n"
        yield process
        with contextlib.suppress(BrokenPipeError):
            process.stdin.close()


def test_the_second_user_is_told_who_has_the_bench(another):
    with pytest.raises(BenchInUse) as refused:
        take_lease(bench_file(), "mine")
    text = str(refused.value)
    assert f"process {another.pid}" in text and "run of another" in text
    holder = lease_holder(bench_file())
    assert holder.pid == another.pid and holder.alive and holder.host in text and holder.user in text


def test_one_shared_port_is_enough_and_no_half_lease_stays(another):
    elsewhere = bench_file(table="/dev/ttyT9", gyro="/dev/ttyG9")
    with pytest.raises(BenchInUse):
        take_lease(elsewhere, "mine")
    with take_lease(bench_file(table="/dev/ttyT9", gyro="/dev/ttyG9", chamber="/dev/ttyC9"), "mine"):
        pass


def test_a_platform_has_a_lease_too():
    platform = {"name": "ins", "driver": "platform_ins", "unit": "P1", "port": "/dev/ttyP0"}
    data = bench_data(table="/dev/ttyT5", chamber="/dev/ttyC5", gyro="/dev/ttyG5") | {"platform": [platform]}
    other = bench_data(table="/dev/ttyT6", chamber="/dev/ttyC6", gyro="/dev/ttyP0")
    with take_lease(bench_file_from(data), "with a platform"), pytest.raises(BenchInUse):
        take_lease(bench_file_from(other), "the same port for a gyro")


def test_two_names_of_one_port_are_one_port(tmp_path):
    real = tmp_path / "ttyUSB0"
    real.touch()
    link = tmp_path / "by-id"
    link.symlink_to(real)
    with take_lease(bench_file(table=str(real)), "mine"), pytest.raises(BenchInUse):
        take_lease(bench_file(table=str(link), chamber="/dev/c", gyro="/dev/g"), "again")


def test_what_a_killed_process_leaves_is_recognised_as_stale(another):
    another.send_signal(signal.SIGKILL)
    another.wait()
    assert lease_holder(bench_file()) is None
    with take_lease(bench_file(), "mine") as lease:
        assert [holder.pid for holder in lease.stale] == [another.pid]
        assert not lease.stale[0].alive
    assert lease_files() == []


def test_a_note_with_the_id_of_a_living_process_and_no_lock_binds_nobody():
    with take_lease(bench_file(), "mine") as lease:
        note = {path: path.read_text() for path in lease_files()}
        assert len(note) == 3
    for path, text in note.items():
        path.write_text(text)  # our own id and start time, as a crash would leave it
    with take_lease(bench_file(), "mine") as lease:
        assert len(lease.stale) == 1
    assert lease_files() == []


def test_a_reused_process_id_is_not_the_holder():
    with take_lease(bench_file(), "mine") as lease:
        assert lease.holder.alive
        data = json.loads(lease_files()[0].read_text())
        assert data["process_start"] == process_start(os.getpid()) > 0
        assert not type(lease.holder)(**{**data, "process_start": data["process_start"] - 1}).alive


def test_a_child_that_inherits_the_lease_keeps_it_after_its_parent():
    """As a watchdog does."""
    code = HOLD.replace(
        "sys.stdin.read()",
        "import subprocess, os\n"
        "child = subprocess.Popen([sys.executable, '-c', 'import sys; sys.stdin.read()'],"
        " pass_fds=lease.descriptors)\n"
        "lease.update(watchdog_pid=child.pid)\n"
        "print(child.pid, flush=True)\n"
        "os._exit(0)",
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, json.dumps(bench_data())], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout.readline() == b"taken\n"
        child = int(process.stdout.readline())
        process.wait()
        with pytest.raises(BenchInUse, match=f"has ended; its watchdog {child} has the bench still"):
            take_lease(bench_file(), "mine")
        pidfd = os.pidfd_open(child)
        process.stdin.close()
        assert select.select([pidfd], [], [], 60.0)[0]
        os.close(pidfd)
    take_lease(bench_file(), "mine").release()


def test_the_same_process_cannot_take_a_bench_twice_and_release_is_harmless_twice():
    lease = take_lease(bench_file(), "one")
    lease.update(purpose="one, run 2")
    with pytest.raises(BenchInUse, match="one, run 2"):
        take_lease(bench_file(), "two")
    lease.release()
    lease.release()
    assert lease.descriptors == () and lease_files() == []


def test_a_state_folder_that_cannot_be_written_is_named(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    with pytest.raises(ConfigurationError, match="XDG_STATE_HOME"):
        take_lease(bench_file(), "mine")


def test_another_terminal_that_gets_the_number_of_a_dead_one_is_another_bench(tmp_path, monkeypatch):
    """The watchdog of a killed run keeps its lease while it looks for the ports of a lab that was killed, too.

    Files in place of terminals: which number the kernel gives next is not ours to say.
    """
    monkeypatch.setattr("bench.control.lease._PSEUDO_TERMINALS", f"{tmp_path}/")
    number = tmp_path / "7"
    number.touch()
    made_ns = number.stat().st_ctime_ns
    other = bench_file(table=str(number), chamber="socket://10.0.0.3:2049", gyro="/dev/ttyG1")
    with take_lease(bench_file(table=str(number)), "run on the dead lab"):
        with pytest.raises(BenchInUse, match="dead lab"):
            take_lease(other, "too soon")
        while number.stat().st_ctime_ns == made_ns:
            number.unlink()
            number.touch()
        take_lease(other, "run on the new lab").release()


@pytest.mark.parametrize(
    ("one", "other"),
    [("socket://localhost:2049", "socket://127.0.0.1:2049"), ("socket://localhost:2049", "socket://LOCALHOST:02049/"),
     ("SOCKET://127.0.0.1:2049", "socket://127.0.0.1:2049")],
)  # fmt: skip
def test_a_network_port_is_one_however_it_is_written(one, other):
    with take_lease(bench_file(chamber=one), "mine"):
        with pytest.raises(BenchInUse):
            take_lease(bench_file(chamber=other, table="/dev/ttyT1", gyro="/dev/ttyG1"), "another")
        take_lease(
            bench_file(chamber="socket://127.0.0.1:2050", table="/dev/ttyT1", gyro="/dev/ttyG1"), "a third"
        ).release()


def test_one_port_twice_in_a_bench_file_is_refused_however_it_is_written():
    with pytest.raises(ConfigurationError, match="a port of its own"):
        bench_file(chamber="socket://lab:2049", table="socket://LAB:02049")


def test_accounts_that_share_the_folder_share_the_leases(tmp_path):
    """Who comes second may read whose bench it is, and whoever died blocks nobody."""
    folder = state_folder() / "leases"
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    with take_lease(bench_file(), "mine"):
        assert {path.stat().st_mode & 0o777 for path in lease_files()} == {0o666}
    folder.chmod(0o700)
    with take_lease(bench_file(), "mine"):
        assert {path.stat().st_mode & 0o022 for path in lease_files()} == {0}


def as_another(doing):
    """Return what a process of another account says that does something: whether it could, or why not."""
    near, far = os.pipe()
    if (child := os.fork()) == 0:
        try:
            os.setgid(12345)
            os.setuid(12345)
            doing()
            os.write(far, b"taken")
        except BenchError as error:
            os.write(far, str(error).encode())
        finally:
            os._exit(0)
    os.close(far)
    os.waitpid(child, 0)
    with os.fdopen(near, "rb") as answer:
        return answer.read().decode()


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="another account: needs root")
def test_another_account_is_told_who_has_the_bench_and_takes_what_the_dead_left(monkeypatch):
    """Leases as an earlier version made them: only their owner could write them."""
    with tempfile.TemporaryDirectory() as shared:
        monkeypatch.setenv("XDG_STATE_HOME", shared)
        folder = state_folder() / "leases"
        folder.mkdir(parents=True)
        for place in (folder, *folder.parents[:2]):
            place.chmod(0o777)
        lease = take_lease(bench_file(), "mine")
        for path in lease_files():
            path.chmod(0o644)
        said = as_another(lambda: take_lease(bench_file(), "theirs"))
        assert "the bench is in use" in said and "mine" in said
        for descriptor in lease.descriptors:  # as when the process is killed
            os.close(descriptor)
        assert as_another(lambda: take_lease(bench_file(), "theirs")) == "taken"
