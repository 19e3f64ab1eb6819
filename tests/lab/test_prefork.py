"""Labs that are forked: each its own, each gone when its door closes, all gone with the prefork."""

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bench.lab.emulated import EmulatedLab, Plant, lab_config
from bench.lab.prefork import PreforkServer
from bench.lab.testing import usual_bench
from bench.record.benchfile import bench_file_text
from drivers.base.errors import BenchError, ConfigurationError

pytestmark = [pytest.mark.concurrent, pytest.mark.slow]


def ended(process: int) -> bool:
    """Say whether the process of a pidfd ends; the wait is a bound, not a measurement."""
    ready, _, _ = select.select([process], [], [], 30.0)
    os.close(process)
    return bool(ready)


def test_forked_labs_are_labs_of_their_own():
    file = usual_bench(None)
    with PreforkServer(lab_config(file, Plant())) as prefork:
        with (
            EmulatedLab(file, Plant(), start=prefork.start_lab) as one,
            EmulatedLab(file, Plant(), start=prefork.start_lab) as two,
        ):
            labs = [os.pidfd_open(lab._process.pid) for lab in (one, two)]
            assert not select.select(labs, [], [], 0)[0] and one.clock_url != two.clock_url
            assert not set(one.ports.values()) & set(two.ports.values())
            one.perform({"act": "mount", "unit": "fog_1", "mounting": "axis_up"})
        assert all(map(ended, labs))
        left = EmulatedLab(file, Plant(), start=prefork.start_lab)
        left._process.kill()
        with pytest.raises(BenchError, match="ended before"):
            left.perform({"act": "mount", "unit": "fog_1", "mounting": "axis_up"})
        left.close()
    with pytest.raises((BenchError, ConfigurationError)):
        EmulatedLab(file, Plant(), start=prefork.start_lab)


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="reads /proc")
def test_what_a_lab_needs_is_loaded_before_the_first_fork():
    """Else every bench of a test suite takes half a second more, and nobody sees why."""
    file = usual_bench(None)
    with (
        PreforkServer(lab_config(file, Plant())) as prefork,
        EmulatedLab(file, Plant(), start=prefork.start_lab) as lab,
    ):
        own, parent = (loaded(pid) for pid in (lab._process.pid, prefork._process.pid))
    assert own == parent and len(own) > 10


def loaded(pid: int) -> set[str]:
    """Return the compiled libraries that a process has mapped."""
    lines = Path(f"/proc/{pid}/maps").read_text().splitlines()
    return {line.split()[-1] for line in lines if ".so" in line}


def test_a_lab_that_cannot_be_says_why():
    file = usual_bench(None)
    plant = Plant(models={gyro.unit: "no such gyro" for gyro in file.gyro})
    with pytest.raises(ConfigurationError, match="no such gyro") as refused:
        EmulatedLab(file, plant)
    assert refused.value.expected


def test_a_lab_in_the_background_of_a_shell_ends_on_sigterm(tmp_path):
    """Such a shell starts it with SIGINT ignored; POSIX, Shell Command Language 2.11."""
    path = tmp_path / "lab.toml"
    path.write_text(bench_file_text(usual_bench(None)), encoding="utf-8")
    code = "from signal import *; from bench.present.cli import main; signal(SIGINT, SIG_IGN); main()"
    command = [sys.executable, "-c", code, "lab", "--bench", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as lab:
        assert lab.stdout is not None
        assert any(b"Ctrl-C" in line for line in lab.stdout)
        lab.send_signal(signal.SIGTERM)
        assert b"lab closed" in lab.stdout.read()
    assert lab.returncode == 0
