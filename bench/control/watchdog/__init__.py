"""A process that outlives the runner: if the runner dies or hangs, it brings the bench to rest in its place.

The runner's driving thread beats over a pipe whenever it waits on the clock. Without a beat for `HUNG_S`, or when
the pipe closes, the watchdog ends the runner for good, takes its ports over, stops table and chamber, reads back
that they rest, and writes what it did into `watchdog/` of the run folder. Meanwhile it keeps the bench's lease;
where a lock ends with its process (Windows), it takes it anew.

A second one stands by, and does the same if the first does not (`_other.py`).

A watchdog sends the beats back. One that does not, or whose process ends, is an alarm of the run; it is ended for
good and another started. When none is left the run ends with the bench in its safe state.

Only a bench on the wall clock has one: in an emulated lab's virtual time nothing moves once the bench is gone.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from bench.control.lease import Lease
from bench.control.watchdog._silence import (
    HUNG_S,
    STARVED_S,
    UNARMED_S,
    SilenceTimeout,
    runqueue_wait_s,
)
from bench.record.benchfile import BenchFile
from bench.record.events.run import Alarm, Invalid
from drivers.base.clock import host_seconds
from drivers.base.errors import BenchError
from drivers.base.pipes import Pipes, of_its_own

__all__ = ["HUNG_S", "STARVED_S", "UNARMED_S", "Watchdog"]

UNANSWERED_S = 1.0
"""A watchdog that has not answered a beat for so long is taken for hung: beats come twice a second at least."""

READY_TIMEOUT_S = 60.0
"""A watchdog has to be imported first; a loaded machine takes its time."""

REPLACED_S = 20.0
"""The same where the table may be turning unguarded."""

FOLDER = "watchdog"

READY, ARMED, DISMISSED = b"ready", b"armed", b"dismissed"
"""Lines between the two; a beat is one of sequence number and time, see `beat_line`."""

_BEAT_EVERY_S = 0.2
_MOST_REPLACED = 3
_END_TIMEOUT_S = 5.0


def beat_line(sequence: int, sent_s: float) -> bytes:
    """Return a beat: its number and the host's monotonic time in s, which both processes share."""
    return b"%d %.6f\n" % (sequence, sent_s)


def sent_s(beat: bytes) -> float:
    """Return when a beat was sent: what lies unread in the pipe is no sign of life of now."""
    return float(beat.partition(b" ")[2])


class _Process:
    """One watchdog process and the runner's ends of its pipes; `spare`: started in place of another."""

    def __init__(self, order: bytes, lease: Lease, spare: bool) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "bench.control.watchdog"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            **of_its_own(lease.descriptors),
        )
        self._pipes = Pipes(self._process, order)  # a watchdog that does not read must not stop the runner
        self.started_s = host_seconds()
        self.ready = self.ended = False
        self.untold = spare
        self._unread = b""
        self._sequence = 0
        self._unanswered: deque[tuple[int, float, float]] = deque()
        """Number of each beat, when it was sent, and how long the process had waited for a processor by then."""

    @property
    def pid(self) -> int:
        return self._process.pid

    def arm(self) -> None:
        """Have it watch from here on."""
        self.write(ARMED + b"\n")

    def beat(self, now_s: float) -> None:
        """Send the next beat."""
        self._sequence += 1
        self._unanswered.append((self._sequence, now_s, runqueue_wait_s(self.pid)))
        self.write(beat_line(self._sequence, now_s))

    def listen(self, timeout_s: float = 0.0) -> None:
        """Take what it says within `timeout_s`."""
        while not self.ended and select.select([self._pipes], [], [], timeout_s)[0]:
            data = self._pipes.read()
            self.ended = not data
            self._unread += data
            timeout_s = 0.0
        *lines, self._unread = self._unread.split(b"\n")
        for line in lines:
            number = line.partition(b" ")[0]
            if line == READY:
                self.ready = True
            while number.isdigit() and self._unanswered and self._unanswered[0][0] <= int(number):
                self._unanswered.popleft()

    def silent_s(self, now_s: float) -> float | None:
        """Return for how long it has not answered if that is too long for one that lives, else None."""
        if not self._unanswered:
            return None
        _, sent_s, waited_s = self._unanswered[0]
        hung = not SilenceTimeout(sent_s, waited_s, UNANSWERED_S).left_s(now_s, runqueue_wait_s(self.pid))
        return now_s - sent_s if hung else None

    def excuse(self, now_s: float) -> None:
        """Count what is unanswered from now on."""
        self._unanswered = deque((number, now_s, waited_s) for number, _, waited_s in self._unanswered)

    def write(self, data: bytes) -> None:
        self._pipes.write(data)  # `listen` tells of a watchdog that is dead or stopped

    def dismiss(self) -> None:
        """Let it end; one that is not up yet is not waited for."""
        if self.ready:
            self.write(DISMISSED + b"\n")
        else:
            self._process.kill()

    def ended_well(self) -> bool:
        """Wait until it has ended; return whether it was there to be dismissed, or not up yet."""
        return self._await_end() == 0 or not self.ready

    def kill(self) -> None:
        """End it for good: it must not come to and take a closed pipe for the runner's end."""
        self._process.kill()
        self._await_end()

    def _await_end(self) -> int:
        self._pipes.close()
        try:
            self._process.wait(timeout=_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        return self._process.returncode


class Watchdog:
    """The runner's end of the pipes to its watchdogs: the first, from `arm` on a second, and their successors.

    `tell` takes alarms and what makes the run invalid, `stop` ends the run.
    """

    def __init__(
        self,
        file: BenchFile,
        run_folder: Path,
        lease: Lease,
        tell: Callable[[Alarm | Invalid], None],
        stop: Callable[[str], None],
    ) -> None:
        self._lease, self._tell, self._stop = lease, tell, stop
        self._order = {
            "bench": file.model_dump(mode="json"),
            "run_folder": str(run_folder.resolve()),
            "runner": os.getpid(),
            "lease": lease.descriptors,
        }
        self._beaten_s = host_seconds()
        self._watched = self._dismissed = False
        self._replaced = 0
        self._processes: list[_Process] = []
        self._start()
        lease.update(watchdog_pid=self._processes[0].pid)

    def _start(self, spare: bool = False) -> None:
        """Start one more, behind those that are there."""
        first = self._processes[0].pid if self._processes else None
        order = self._order | {"armed": self._watched, "first": first}
        self._processes.append(_Process(json.dumps(order).encode() + b"\n", self._lease, spare))

    def arm(self) -> None:
        """Wait until the watchdog is ready, and begin to be watched; BenchError if it does not come up.

        Until then nothing moves: a runner that stands still is ended after `UNARMED_S`, for its lease.
        """
        (process,) = self._processes
        until_s = process.started_s + READY_TIMEOUT_S
        while not (process.ready or process.ended) and host_seconds() < until_s:
            process.listen(until_s - host_seconds())
        if not process.ready:
            raise BenchError(
                "the watchdog process did not start",
                where="watchdog",
                expected=f"its word within {READY_TIMEOUT_S:g} s",
                remedy="its own output says why; `watchdog = false` in [safe] runs a bench without one",
            )
        self._watched = True
        process.arm()
        try:
            self._start()
        except OSError as error:  # one guards
            self._tell(Alarm("watchdog", f"a second one could not be started: {error}", "watchdog_lost"))

    def beat(self) -> None:
        """Say that the runner lives and hear whether the watchdog does; costs nothing when called often."""
        now_s = host_seconds()
        if now_s - self._beaten_s < _BEAT_EVERY_S or self._dismissed:
            return
        away = now_s - self._beaten_s > HUNG_S
        self._beaten_s = now_s
        if not self._watched:  # what has not been armed answers when it has come up, which nobody waits for
            self._processes[0].write(beat_line(0, now_s))
            return
        for process in tuple(self._processes):
            process.listen()
            if away:  # this process was stopped, and what guards it, which has let it live, perhaps with it
                process.excuse(now_s)
            silent_s = process.silent_s(now_s)
            late = not process.ready and now_s - process.started_s > REPLACED_S
            if process.ended or late or silent_s is not None:
                self._replace(process, silent_s)
            elif not process.ready:  # when it is up it knows since when this process is silent
                process.write(beat_line(0, now_s))
            else:
                if process.untold:
                    process.untold = False
                    self._tell(Alarm("watchdog", "a new one stands by", "watchdog_back"))
                process.beat(now_s)

    def _replace(self, lost: _Process, silent_s: float | None) -> None:
        """End a watchdog that guards nothing any more and start another; give up if none is left."""
        what = "its process has ended" if lost.ended else f"it has not come up within {REPLACED_S:g} s"
        if silent_s is not None:
            what = f"it has not answered for {silent_s:.1f} s"
        facts = {"pid": lost.pid} | ({} if silent_s is None else {"silent_s": silent_s})
        self._processes.remove(lost)
        guarded = any(process.ready for process in self._processes)
        after = "the other one guards the bench" if guarded else "nobody stops the bench if this process dies"
        self._tell(Alarm("watchdog", f"{what}; {after}", "watchdog_lost", facts))
        came_late = not (lost.ready or lost.ended)
        lost.kill()
        if self._replaced < _MOST_REPLACED and (guarded or not came_late):
            with suppress(OSError):
                self._start(spare=True)
                self._replaced += 1
        if self._processes:
            self._lease.update(watchdog_pid=self._processes[0].pid)
            return
        self._dismissed = True
        why = "the watchdog is lost and no other one came up"
        self._tell(Invalid("unguarded", why, {"replaced": self._replaced}))
        self._stop(why)

    def dismiss(self) -> None:
        """End the watchdogs: the bench has been made safe, or nothing was moved. Harmless when done already."""
        if self._dismissed:
            return
        self._dismissed = True
        for process in self._processes:  # both, before either is waited for: one without the other takes over
            process.listen()
            process.dismiss()
        ended_well = [process.ended_well() for process in self._processes]
        if not all(ended_well) and self._watched:
            self._tell(Alarm("watchdog", "it was not there any more when the run ended", "watchdog_lost"))
