"""Sample time from the device's own counter, fitted to arrival.

A sample's bytes arrive no earlier than the sample ended plus the time on the wire; everything else (adapter,
operating system, the bench being busy) makes them later. So the line `time = start + period * count` is the
one that lies under all arrivals and closest to them: with the sum of the distances as measure it is the edge of
the arrivals' lower convex hull over their mean count.

A counter that wraps says how many samples were lost up to one wrap; what is more shows as arrivals that stay late
by whole wraps (a busy host is late only for a while). No frame comes before its sample: arrivals that are early
say that the device was switched off and on, and its counter began anew; so do those that stay late after a
silence.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bench.record.recording._raw import first_arrivals
from drivers.base.errors import ProtocolError

_WINDOW_S = 1.0
_RATE_TOLERANCE = 0.02
_CLOCK_TOLERANCE = 1e-3
"""A sample clock is told off by more than this if the record is long enough to know: quartz is 1e-4 at most."""
_RESTART_TOLERANCE_S = 0.02
_EARLY_S = 0.25
"""A frame that comes earlier than the counter says by more than this is of a new count: the device restarted."""
_SILENCE_S = 2.0
_BATCH_S, _BATCHED = 0.25, 3.0
"""Longest time between batches, and frames in each from which they are batches."""
_REGULAR, _GAPS = 0.25, 4096
"""Part by which most times between arrivals differ from the usual one at most; how many are looked at."""
_RECENT = 8
"""Windows whose least lateness says how early is possible."""

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass
class Unwrapper:
    """Turns a wrapping counter into one that does not, batch by batch; starts at the first raw value."""

    modulo: int
    last: int | None = None
    count: int = 0

    def feed(self, counter: Ints) -> tuple[Ints, Ints]:
        """Return (count, step), int64 (n,) each: unwrapped counter, and its step from the frame before."""
        if not len(counter):
            return counter, counter
        if self.last is None:
            self.last = self.count = int(counter[0])
        step = np.mod(np.diff(counter, prepend=self.last), self.modulo)
        count: Ints = self.count + np.cumsum(step)
        self.last, self.count = int(counter[-1]), int(count[-1])
        return count, step


@dataclass(frozen=True)
class StreamTiming:
    """Where the samples of a stream lie in bench time: `start_s + period_s * count`, `count` corrected.

    `corrections`: int64 (m, 2), rows (frame index, counts to add from that frame on), for gaps longer than a
    wrap and for restarts of the device. `residual_s`: how far the arrivals' lower envelope lies above the line,
    99th percentile of one-second windows. `counter_step`: counts a sample.
    """

    start_s: float
    period_s: float
    counter_step: float
    corrections: Ints
    sample_rate_hz: float
    clock_error_ppm: float
    residual_s: float
    warnings: tuple[str, ...] = ()

    def corrected(self, count: Ints, first_frame: int) -> Ints:
        """Return counts with the corrections applied; `first_frame` is the index of the first of them."""
        if not len(self.corrections):
            return count
        frames = first_frame + np.arange(len(count))
        total = np.concatenate(([0], np.cumsum(self.corrections[:, 1])))
        corrected: Ints = count + total[np.searchsorted(self.corrections[:, 0], frames, side="right")]
        return corrected

    def time_ns(self, count: Ints) -> Ints:
        """Return the bench time in ns at which each sample's interval ended, int64 (n,)."""
        seconds = self.start_s + self.period_s * count.astype(np.float64)
        return np.rint(seconds * 1e9).astype(np.int64)


@dataclass
class StreamTimer:
    """Gathers counters and arrivals of a stream, batch by batch, and fits.

    Memory: one row a second of stream plus one for every late arrival of more than half a wrap.
    """

    modulo: int
    nominal_step: float
    nominal_rate_hz: float
    has_counter: bool = True
    """False where the counter is that of the frames received."""
    _unwrap: Unwrapper = field(init=False)
    _frames: int = 0
    _step: float | None = None
    _mark_at: int = 0
    _late_s: float = np.nan
    _arrival_s: float = np.nan
    _floor: deque[float] = field(default_factory=lambda: deque(maxlen=_RECENT))
    _window: float = -1.0
    _largest_step: tuple[int, int] = (-1, 0)
    _counts: list[Ints] = field(default_factory=list)
    _arrivals: list[Floats] = field(default_factory=list)
    _suspects: list[Ints] = field(default_factory=list)
    _gaps: list[Floats] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._unwrap = Unwrapper(self.modulo)
        self._nominal_period_s = 1.0 / (self.nominal_rate_hz * self.nominal_step)
        self._wrap_s = self.modulo * self._nominal_period_s

    def feed(self, counter: Ints, end_offset: Ints, marks: Ints) -> None:
        """Take the counters of consecutive frames, the offsets of their ends, and the port's arrival index."""
        if not len(counter):
            return
        count, step = self._unwrap.feed(counter)
        if self._step is None and len(step) > 1:
            self._step = float(np.median(step[1:])) if self.nominal_step != 1 else 1.0
        frame, arrival_s, self._mark_at = first_arrivals(marks, self._mark_at, end_offset)
        if (more := _GAPS - sum(map(len, self._gaps))) > 0:
            self._gaps.append(np.column_stack((np.diff(arrival_s[: more + 1]), np.diff(frame[: more + 1]))))
        self._add_windows(count, step, frame, arrival_s)
        self._frames += len(counter)

    def _add_windows(self, count: Ints, step: Ints, frame: Ints, arrival_s: Floats) -> None:
        """Keep of every window the arrival that is least late; a suspect jump of lateness starts a window."""
        if not len(frame):
            self._remember_step(step, 0)
            return
        late_s = arrival_s - count[frame] * self._nominal_period_s
        jump = np.diff(late_s, prepend=self._late_s) > 0.5 * self._wrap_s
        silent = np.diff(arrival_s, prepend=self._arrival_s) > _SILENCE_S
        jump |= silent & (np.diff(late_s, prepend=self._late_s) > _EARLY_S)
        jump |= self._restarted(late_s, arrival_s)
        window = np.floor(arrival_s / _WINDOW_S)
        starts = np.flatnonzero(jump | (np.diff(window, prepend=self._window) != 0))
        if not len(starts) or starts[0] != 0:
            starts = np.concatenate(([0], starts))
        least = np.minimum.reduceat(late_s, starts)
        owner = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(late_s)))
        hits = np.flatnonzero(late_s == least[owner])
        best = hits[np.unique(owner[hits], return_index=True)[1]]
        suspects = np.full(len(starts), -1, np.int64)
        for at in np.flatnonzero(jump[starts]):
            mark = starts[at]
            suspects[at] = self._lost_at(step, int(frame[mark - 1]) if mark else -1, int(frame[mark]))
        self._counts.append(count[frame[best]])
        self._arrivals.append(arrival_s[best])
        self._suspects.append(suspects)
        self._late_s, self._window = float(late_s[-1]), float(window[-1])
        self._largest_step = (-1, 0)
        self._remember_step(step, int(frame[-1]) + 1)

    def _restarted(self, late_s: Floats, arrival_s: Floats) -> NDArray[np.bool_]:
        """Say at which arrivals, (n,), the device began to count anew: those too early for the count before."""
        found = np.zeros(len(late_s), np.bool_)
        since = 0
        for at in np.flatnonzero(np.diff(late_s, prepend=self._late_s) < -_EARLY_S).tolist():
            # late data that catch up come no earlier than what was in time before
            before = late_s[since:at][-_RECENT * 100 :]
            earliest_s = min(min(self._floor, default=np.inf), before.min(initial=np.inf))
            gap_s = arrival_s[at] - (arrival_s[at - 1] if at else self._arrival_s)
            if late_s[at] < earliest_s - _EARLY_S - _RATE_TOLERANCE * gap_s:
                found[at] = True
                since = at
                self._floor.clear()
        self._floor.append(float(late_s[since:].min()))
        self._arrival_s = float(arrival_s[-1])
        return found

    def _remember_step(self, step: Ints, start: int) -> None:
        """Keep where the counter stepped most since the last arrival; its frames may begin in this batch."""
        if start < len(step):
            at = start + int(np.argmax(self._loss(step, start, len(step))))
            if (loss := int(self._loss(step, at, at + 1)[0])) > self._largest_step[0]:
                self._largest_step = (loss, self._frames + at)

    def _lost_at(self, step: Ints, after: int, upto: int) -> int:
        """Return the index of the frame, of those that arrived together, before which most was lost."""
        loss = self._loss(step, after + 1, upto + 1)
        at = int(np.argmax(loss))
        before, frame = self._largest_step if after < 0 else (-1, 0)
        return frame if before > loss[at] else self._frames + after + 1 + at

    def _loss(self, step: Ints, start: int, stop: int) -> Ints:
        """Return steps to rank where most was lost; a wrap less one lost leaves no step at all."""
        part = step[start:stop]
        return np.where(part == 0, self.modulo, part)

    @property
    def has_arrivals(self) -> bool:
        """Whether any frame has an arrival time, so that `fit` can be called."""
        return bool(self._counts)

    def fit(self, transmission_s: float = 0.0) -> StreamTiming:
        """Fit; `transmission_s` is a frame's time on the wire. ProtocolError if no frame has an arrival time."""
        if not self._counts:
            raise ProtocolError(
                "no frame of the stream has an arrival time",
                found=f"{self._frames} frames",
                expected="frames and an arrival index",
                remedy="check that the gyro was streaming and that raw/ is complete",
            )
        count, arrival_s = np.concatenate(self._counts), np.concatenate(self._arrivals)
        suspect = np.concatenate(self._suspects)
        rough_s = _rough_period_s(count, arrival_s, suspect, self._nominal_period_s)
        extra, restarts = _resolve_jumps(count, arrival_s, suspect, rough_s, self.modulo)
        count = count + np.cumsum(extra)
        start_s, period_s = _line_below(count, arrival_s, rough_s)
        step = self._step or self.nominal_step
        rate_hz = 1.0 / (period_s * step)
        residual_s = float(np.percentile(arrival_s - start_s - period_s * count, 99))
        rows = np.flatnonzero(extra)
        return StreamTiming(
            start_s=start_s - transmission_s,
            period_s=period_s,
            counter_step=step,
            corrections=np.column_stack((suspect[rows], extra[rows])),
            sample_rate_hz=rate_hz,
            clock_error_ppm=(self._nominal_period_s / period_s - 1.0) * 1e6,
            residual_s=residual_s,
            warnings=tuple(self._warnings(rate_hz, residual_s, restarts, float(np.ptp(arrival_s)))),
        )

    def _batch(self) -> tuple[float, float] | None:
        """Return how often batches of frames arrive, s, and the frames in each; None where frames come singly."""
        gaps = np.concatenate(self._gaps) if self._gaps else np.empty((0, 2))
        if len(gaps) < _RECENT:
            return None
        usual_s, frames = np.median(gaps, axis=0).tolist()
        regular = float(np.mean(np.abs(gaps[:, 0] - usual_s) <= _REGULAR * usual_s))
        if usual_s > _BATCH_S or frames < _BATCHED or regular < 1.0 - _REGULAR:
            return None
        return usual_s, frames

    def _warnings(self, rate_hz: float, residual_s: float, restarts: int, span_s: float) -> list[str]:
        warnings = []
        off = rate_hz / self.nominal_rate_hz - 1.0
        known = abs(off) * span_s > 10.0 * residual_s + 2.0 / rate_hz
        if abs(off) > _RATE_TOLERANCE or (abs(off) > _CLOCK_TOLERANCE and known):
            warnings.append(
                f"the measured sample rate is {rate_hz:.3f} Hz, not the nominal {self.nominal_rate_hz:g} Hz "
                f"({off:+.2%}): times and rates follow the measured one"
            )
        if batch := self._batch():
            warnings.append(
                f"samples arrive in batches of {1e3 * batch[0]:.3g} ms, about {batch[1]:.0f} at a time, as from "
                "a USB adapter with a latency timer: their times follow the counter"
            )
        if restarts:
            what = "the device's counter started anew" if self.has_counter else "the stream paused"
            warnings.append(f"{what} {restarts} times; time there is from arrival")
        if residual_s > max(0.05, 2.0 / rate_hz):
            warnings.append(
                f"arrivals are up to {residual_s:.3f} s later than the counter says: a jump, or data held up"
            )
        return warnings


def _rough_period_s(count: Ints, arrival_s: Floats, suspect: Ints, nominal_s: float) -> float:
    """Return the median slope between windows; a few gaps do not move it."""
    counts, seconds = np.diff(count), np.diff(arrival_s)
    plain = (suspect[1:] < 0) & (counts > 0)
    return float(np.median(seconds[plain] / counts[plain])) if plain.any() else nominal_s


def _resolve_jumps(
    count: Ints, arrival_s: Floats, suspect: Ints, period_s: float, modulo: int
) -> tuple[Ints, int]:
    """Return counts to add at each window, int64 (m,), and how many of them are no whole wraps: restarts."""
    extra = np.zeros(len(count), np.int64)
    late = np.diff(arrival_s - arrival_s[0] - period_s * (count - count[0]), prepend=0.0)
    wraps = np.rint(late / (modulo * period_s)).astype(np.int64)
    off_s = np.abs(late - wraps * modulo * period_s)
    tolerance_s = max(_RESTART_TOLERANCE_S, 0.1 * modulo * period_s)
    suspicious = suspect >= 0
    restart = suspicious & (off_s > tolerance_s) & (late > 0.5 * modulo * period_s)
    whole = suspicious & ~restart & (wraps > 0)
    extra[whole] = wraps[whole] * modulo
    extra[restart] = np.rint(late[restart] / period_s).astype(np.int64)
    rest = np.flatnonzero(suspicious & ~restart & ~whole & (np.abs(late) > 0.5 * _EARLY_S))
    for at in rest.tolist():
        moved_s = _stays_moved_s(np.cumsum(late), np.flatnonzero(suspicious), at)
        if abs(moved_s) > 0.5 * _EARLY_S:
            extra[at] = round(moved_s / period_s)
            restart[at] = True
    return extra, int(restart.sum())


def _stays_moved_s(late_s: Floats, borders: Ints, at: int) -> float:
    """Return how much later (+) or earlier the windows from `at` on are than those before, at their least."""
    place = int(np.searchsorted(borders, at))
    first = max(at - _RECENT, int(borders[place - 1]) if place else 0)
    last = min(at + _RECENT, int(borders[place + 1]) if place + 1 < len(borders) else len(late_s))
    return float(late_s[at:last].min() - late_s[first:at].min()) if at else 0.0


def _line_below(count: Ints, arrival_s: Floats, rough_period_s: float) -> tuple[float, float]:
    """Return (start_s, period_s) of the line under all points with the least sum of distances to them.

    Worked in coordinates relative to the rough line, where the numbers are small.
    """
    order = np.argsort(count, kind="stable")
    x = (count[order] - count[order[0]]).astype(np.float64)
    y = arrival_s[order] - arrival_s[order[0]] - rough_period_s * x
    hull: list[int] = []
    for at in range(len(x)):
        while hull and x[at] == x[hull[-1]] and y[at] <= y[hull[-1]]:
            hull.pop()
        if hull and x[at] == x[hull[-1]]:
            continue
        while len(hull) > 1 and not _turns_left(x, y, hull[-2], hull[-1], at):
            hull.pop()
        hull.append(at)
    edge = int(np.clip(np.searchsorted(x[hull], x.mean()), 1, max(1, len(hull) - 1)))
    slope = 0.0
    if len(hull) > 1:
        left, right = hull[edge - 1], hull[edge]
        slope = float((y[right] - y[left]) / (x[right] - x[left]))
    offset = float(y[hull[edge - 1]] - slope * x[hull[edge - 1]])
    period_s = rough_period_s + slope
    return float(arrival_s[order[0]]) + offset - period_s * float(count[order[0]]), period_s


def _turns_left(x: Floats, y: Floats, first: int, second: int, third: int) -> bool:
    return bool(
        (x[second] - x[first]) * (y[third] - y[first]) > (y[second] - y[first]) * (x[third] - x[first])
    )
