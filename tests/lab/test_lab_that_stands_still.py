"""An emulated lab whose process is killed or stopped: who waits on its clock is told, and waits no longer."""

import os
import signal
from pathlib import Path

import pytest

from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import load_bench_file
from drivers.base import lab_time
from drivers.base.errors import BenchError
from drivers.base.virtual_clock import VirtualClock

pytestmark = [
    pytest.mark.concurrent,
    pytest.mark.skipif(
        not Path("/proc/self/task").exists(), reason="without /proc no child's number is known"
    ),
]

DEMO = Path(__file__).parents[2] / "examples" / "demo.toml"


def labs() -> set[int]:
    """Return the processes of labs that this one has started."""
    children = Path(f"/proc/{os.getpid()}/task").glob("*/children")
    pids = {int(pid) for each in children for pid in each.read_text().split()}
    return {pid for pid in pids if b"simulators.lab" in Path(f"/proc/{pid}/cmdline").read_bytes()}


@pytest.mark.parametrize(
    ("number", "words"),
    [(signal.SIGKILL, "the emulated lab is gone"), (signal.SIGSTOP, "said nothing for 1 s")],
)
def test_a_lab_that_dies_or_stands_still_is_told(
    monkeypatch: pytest.MonkeyPatch, number: signal.Signals, words: str
) -> None:
    monkeypatch.setattr(lab_time, "WATCHDOG_S", 1.0)
    others = labs()
    with EmulatedLab(load_bench_file(DEMO), Plant(), apart=True) as lab:
        (pid,) = labs() - others
        clock = VirtualClock(lab.file.bench.clock)
        clock.sleep(2.0)
        assert clock.now() == 2.0
        os.kill(pid, number)
        try:
            with pytest.raises(BenchError, match=words):
                clock.sleep(60.0)
        finally:
            if number == signal.SIGSTOP:
                os.kill(pid, signal.SIGCONT)
            clock.close()
