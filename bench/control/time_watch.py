"""Whether time passed over the bench unseen: late polls, a machine that was suspended, a clock that was set."""

from __future__ import annotations

from collections.abc import Callable

from bench.record.events.run import Alarm, Invalid
from drivers.base.clock import Clock, WallClock, host_offsets
from drivers.base.errors import RunAborted

LATE_S = 2.0
"""A poll that comes later than this is an alarm."""
UNWATCHED_S = 10.0
"""One later than this ends the run: the longest that a watchdog lets a starved runner live."""
STEP_S = 0.5
"""A step of the host's date, or of its time since boot against bench time, that is told."""

Tell = Callable[[Alarm | Invalid], None]


class TimeWatch:
    """Looks at the clocks with every poll; `tell` gets what is an alarm or makes the run invalid.

    `offsets`: how far the host's date and its time since boot, with what it was suspended, are ahead of its
    monotonic time, which is bench time (s); in virtual time always 0, since the lab stands still with the host.
    """

    def __init__(
        self, clock: Clock, tell: Tell, offsets: Callable[[], tuple[float, float]] | None = None
    ) -> None:
        self._clock, self._tell = clock, tell
        self._offsets = offsets or (host_offsets if isinstance(clock, WallClock) else lambda: (0.0, 0.0))
        self._date_s, self._boot_s = self._offsets()
        self._last_s: float | None = None
        self._due_s = 0.0

    def look(self, period_s: float) -> None:
        """Take note of a poll, with the next one due in `period_s`; RunAborted if it is much too late."""
        now_s = self._clock.now()
        (date_s, boot_s), last_s = self._offsets(), self._last_s
        suspended_s = boot_s - self._boot_s
        late_s = (now_s - self._due_s if last_s is not None else 0.0) + max(suspended_s, 0.0)
        stepped_s = date_s - self._date_s - suspended_s
        self._date_s, self._boot_s, self._last_s, self._due_s = date_s, boot_s, now_s, now_s + period_s
        if abs(stepped_s) > STEP_S:
            text = f"the date of this computer was set by {stepped_s:+.1f} s; bench time goes on as it was"
            self._tell(Alarm("bench", text, "clock_step", {"step_s": stepped_s}))
        since = {"from_s": now_s if last_s is None else last_s}
        if suspended_s > STEP_S:
            text = f"this computer was suspended for {suspended_s:.1f} s, which bench time lacks"
            self._tell(Invalid("suspended", text, since | {"suspended_s": suspended_s}))
        if late_s <= LATE_S:
            return
        text = f"telemetry comes {late_s:.1f} s late: nobody watched the bench"
        if late_s <= UNWATCHED_S:
            self._tell(Alarm("bench", text, "poll_gap", since | {"late_s": late_s}))
            return
        self._tell(Invalid("unwatched", text, since | {"late_s": late_s}))
        raise RunAborted(
            "nobody watched the bench",
            where="bench",
            found=f"telemetry {late_s:.1f} s late",
            expected=f"at most {UNWATCHED_S:g} s",
            remedy="keep this computer from being suspended and from being out of processor or memory",
        )
