"""How long a peer may be silent: what it spent ready to run, without a processor, is not counted against it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

HUNG_S = 2.0
"""A runner that has not waited on its clock for so long is taken for hung: polls are a second apart."""

UNARMED_S = 60.0
"""The same before its first command, where nothing moves yet: it opens ports and reads its settings."""

STARVED_S = 8.0
"""Most that is added for a process that was ready to run and got no processor: longer, it guards nothing."""


@dataclass(frozen=True)
class SilenceTimeout:
    """When a process was last heard, and how long its main thread had waited for a processor by then (s)."""

    heard_s: float
    waited_s: float
    hung_s: float = HUNG_S

    def left_s(self, now_s: float, waited_s: float) -> float:
        """Return how long a silent process may go on being silent, 0 when it is taken for hung.

        What it spent ready to run, without a processor, is the machine's fault and not its own.
        """
        starved_s = min(max(waited_s - self.waited_s, 0.0), STARVED_S)
        return max(self.heard_s + self.hung_s + starved_s - now_s, 0.0)


def runqueue_wait_s(pid: int) -> float:
    """Return how long the main thread of a process has waited for a processor; 0 where nobody counts it.

    Linux: second number of /proc/PID/task/TID/schedstat, ns (Documentation/scheduler/sched-stats.rst). A thread
    that is stopped, asleep or computing does not wait.
    """
    try:
        counted = Path(f"/proc/{pid}/task/{pid}/schedstat").read_text(encoding="ascii")
        return int(counted.split()[1]) / 1e9
    except (OSError, ValueError, IndexError):
        return 0.0
