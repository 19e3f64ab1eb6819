"""A process that outlives the runner: if the runner dies or hangs, it brings the bench to rest in its place.

The runner's driving thread beats over a pipe whenever it waits on the clock. Without a beat for `HUNG_S`, or when
the pipe closes, the watchdog ends the runner for good, takes its ports over, stops table and chamber, reads back
that they rest, and writes what it did into `watchdog/` of the run folder. Meanwhile it keeps the bench's lease.

Only a bench on the wall clock has one: in an emulated lab's virtual time nothing moves once the bench is gone.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from bench.control.lease import Lease
from bench.record.benchfile import BenchFile
from drivers.base.clock import host_seconds
from drivers.base.errors import BenchError

HUNG_S = 2.0
"""A runner that has not waited on its clock for so long is taken for hung: polls are a second apart."""

STARVED_S = 8.0
"""Most that is added for a runner that was ready to run and got no processor: longer, nobody drives the bench."""

READY_TIMEOUT_S = 60.0
"""A watchdog has to be imported first; a loaded machine takes its time."""

FOLDER = "watchdog"

ARMED, BEAT, DISMISSED = b"a", b".", b"q"

_BEAT_EVERY_S = 0.2


class Watchdog:
    """The runner's end of the pipe."""

    def __init__(self, file: BenchFile, run_folder: Path, lease: Lease) -> None:
        self._beaten_s = host_seconds()
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "bench.control.watchdog"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,  # Ctrl-C and a closed terminal are for the runner
            pass_fds=lease.descriptors,
        )
        lease.update(watchdog_pid=self._process.pid)
        order = {
            "bench": file.model_dump(mode="json"),
            "run_folder": str(run_folder.resolve()),
            "runner": os.getpid(),
            "lease": lease.descriptors,
        }
        self._dismissed = False
        assert self._process.stdin is not None
        self._pipe = self._process.stdin.fileno()
        self._write(json.dumps(order).encode() + b"\n")
        os.set_blocking(self._pipe, False)  # a watchdog that does not read must not stop the runner

    def arm(self) -> None:
        """Wait until the watchdog is ready, and begin to be watched; BenchError if it does not come up."""
        output = self._process.stdout
        assert output is not None
        ready, _, _ = select.select([output], [], [], READY_TIMEOUT_S)
        if not ready or output.readline() != b"ready\n":
            raise BenchError(
                "the watchdog process did not start",
                where="watchdog",
                expected=f"its word within {READY_TIMEOUT_S:g} s",
                remedy="its own output says why; `watchdog = false` in [safe] runs a bench without one",
            )
        self._write(ARMED)

    def beat(self) -> None:
        """Say that the runner lives; costs nothing when called often."""
        now_s = host_seconds()
        if now_s - self._beaten_s >= _BEAT_EVERY_S:
            self._beaten_s = now_s
            self._write(BEAT)

    def dismiss(self) -> None:
        """End the watchdog: the bench has been made safe, or nothing was moved. Harmless when done already."""
        if self._dismissed:
            return
        self._dismissed = True
        self._write(DISMISSED)
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        self._process.wait()

    def _write(self, data: bytes) -> None:
        with suppress(BrokenPipeError, BlockingIOError):  # a dead watchdog does not stop a run that is well
            os.write(self._pipe, data)
