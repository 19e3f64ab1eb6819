"""Other processes as a watchdog sees them: the runner, and the watchdog that comes before this one.

Two watchdogs guard a bench. The first takes over when the runner dies or hangs. The second leaves that to it as
long as it gives a sign of life, and ends it and does it anew when it does not: so a watchdog that dies or is
stopped at the same time as the runner, or while it stops the bench, leaves nothing turning.
"""

from __future__ import annotations

import os
import select
import signal
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from bench.control.watchdog._silence import HUNG_S
from bench.record.events.safe import TakeoverEnded
from bench.record.recording import read_events
from drivers.base.clock import host_seconds
from drivers.base.errors import RecordError
from drivers.base.system import SELECTS_FILES
from drivers.base.windows import end_process, has_ended, hold_process

SPARE_S = 0.2
"""By so much the second watchdog is later than the first: what the first needs to begin."""

_UNFINISHED = "unfinished"
_END_TIMEOUT_S = 1.0
_LOOKS_AGAIN_S = 0.02


@dataclass(frozen=True)
class Other:
    """A process by its descriptor (pidfd_open(2)) or handle, which no later process of its number has.

    None: it had ended before.
    """

    held: int | None

    @classmethod
    def of(cls, pid: int) -> Other:
        """Return the process that has a number now."""
        try:
            return cls(os.pidfd_open(pid) if SELECTS_FILES else hold_process(pid))
        except ProcessLookupError:
            return cls(None)

    def end(self) -> None:
        """End it for good: it must not come to and command the table again."""
        if self.held is None:
            return
        if not SELECTS_FILES:
            end_process(self.held, _END_TIMEOUT_S)
            return
        with suppress(ProcessLookupError):
            signal.pidfd_send_signal(self.held, signal.SIGKILL)
        self.ends_within(_END_TIMEOUT_S)

    def ends_within(self, timeout_s: float) -> bool:
        """Return whether it has ended, now or within `timeout_s`."""
        if self.held is None:
            return True
        if not SELECTS_FILES:
            return has_ended(self.held, timeout_s)
        return bool(select.select([self.held], [], [], timeout_s)[0])

    def has_done_it(self, folder: Path, begins_within_s: float) -> bool:
        """Wait for a watchdog that takes the bench over and return whether it did all it could.

        `folder` is where it writes. One that does not begin in time, or stands still for `HUNG_S`, is ended.
        """
        seen, since_s = _last_sign(folder), host_seconds()
        patience_s = begins_within_s if seen is None else HUNG_S
        while not self.ends_within(_LOOKS_AGAIN_S):
            sign, now_s = _last_sign(folder), host_seconds()
            if sign != seen:
                seen, since_s, patience_s = sign, now_s, HUNG_S
            elif now_s - since_s > patience_s:
                self.end()
        with suppress(RecordError):
            return bool(read_events(folder).of(TakeoverEnded))
        return False


def sign_of_life(folder: Path) -> None:
    """Say that the watchdog that writes into a folder lives; in a folder that is gone it says nothing."""
    with suppress(OSError):
        os.utime(folder)


def _last_sign(folder: Path) -> int | None:
    try:
        return folder.stat().st_mtime_ns
    except OSError:
        return None


def set_aside(folder: Path) -> None:
    """Keep what another watchdog wrote that did not come to its end, in `unfinished` of the new folder."""
    if folder.is_dir() and any(folder.iterdir()):
        aside = folder.with_name(f"{folder.name}-{_UNFINISHED}")
        folder.rename(aside)
        folder.mkdir()
        aside.rename(folder / _UNFINISHED)
