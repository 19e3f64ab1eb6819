"""How many samples of a stream never came, counted while it runs, by the unit's counter and the arrivals.

A counter that begins anew after a power-on looks like a jump forward by nearly its whole range. Arrivals tell the
difference: from then on they are earlier (or, after a long silence, later) than the count says, and stay so. The
record's tables are made with more care afterwards (`bench.record.recording`); a gap of more than a wrap of the
counter that lasts less than a quarter of a second shows only there.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from drivers.kit.instruments import StreamDecoder

_MOVED_S = 0.25
"""Arrivals off by more than this from what the count says: a new count, whole wraps lost, or data held up."""
_CLOCK_OFF = 0.02
"""A unit's clock may be off by this share: what is looked at once a minute has moved by 1.2 s then."""
_SHORT_S = 8.0
"""In so long that is less than `_MOVED_S`."""
_SETTLE_S = 2.0
"""What is off for so long stays off: data that were held up have come by then."""
_RECENT = 8


class StreamLoss:
    """Counts the samples that are missing between the first and the last one seen."""

    def __init__(self, decoder: StreamDecoder) -> None:
        self._modulo, self._step = decoder.counter_modulo, decoder.counter_step
        self._rate_hz = decoder.nominal_rate_hz
        self._last: int | None = None
        self._span = 0.0
        """Samples since the first one, those lost included."""
        self._lost = 0
        self._recent_s: deque[tuple[float, float]] = deque(maxlen=_RECENT)
        """Of the last arrivals: how late by the count, and when."""
        self._since_s: float | None = None
        self._least_s = 0.0
        self._shown = 0
        self._off = False

    def pause(self) -> None:
        """Count nothing until `resume`: the unit's power is switched off and on."""
        self._lost, self._since_s, self._off = self.lost, None, True

    def resume(self) -> None:
        """Go on counting, from the next sample on."""
        self._last, self._span, self._off = None, 0.0, False
        self._recent_s.clear()

    @property
    def lost(self) -> int:
        """Samples lost; while it is open whether the unit began to count anew, those lost before."""
        return self._lost if self._since_s is None else self._shown

    def feed(self, counter: NDArray[np.int64], arrival_s: float) -> None:
        """Take the counters of consecutive samples, int64 (n,), and the bench time at which the last one came."""
        if self._off:
            return
        before = counter[0] - round(self._step) if self._last is None else self._last
        samples = np.rint(np.mod(np.diff(counter, prepend=before), self._modulo) / self._step)
        self._last = int(counter[-1])
        self._span += float(samples.sum())
        shown, self._lost = self._lost, self._lost + int(np.maximum(samples - 1.0, 0.0).sum())
        late_s = arrival_s - self._span / self._rate_hz
        least_s, then_s = min(self._recent_s, default=(late_s, arrival_s))
        moved_s = late_s - least_s
        if abs(moved_s) < _MOVED_S + _CLOCK_OFF * max(0.0, arrival_s - then_s - _SHORT_S):
            self._since_s = None
            self._recent_s.append((late_s, arrival_s))
        elif self._since_s is None:
            self._since_s, self._least_s, self._shown = arrival_s, moved_s, shown
        elif arrival_s - self._since_s < _SETTLE_S:
            self._least_s = min(self._least_s, moved_s)
        else:
            self._settle(min(self._least_s, moved_s), late_s, arrival_s)

    def _settle(self, moved_s: float, late_s: float, arrival_s: float) -> None:
        """Count what the clock says in place of what the counter said."""
        self._since_s = None
        samples = round(moved_s * self._rate_hz)
        self._span += samples
        self._lost = max(self._shown, self._lost + samples)
        self._recent_s.clear()
        self._recent_s.append((late_s - samples / self._rate_hz, arrival_s))
