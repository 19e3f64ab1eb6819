"""A USB adapter between a device that streams and the bench: it hands bytes over in batches."""

from __future__ import annotations

import numpy as np

from simulators.interfaces import StreamBlock


class Adapter:
    """Hands over what has come every `period_s`, as the latency timer of a serial adapter does (FTDI AN232B-04).

    16 ms as delivered, 1 ms at best. What a device streams is held until the next of these instants; its answers,
    before and after it streams, are not.
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._held = b""
        self._answered_s = 0.0

    def answered(self, now_s: float) -> None:
        """Take note of an answer: what streams behind it was sent after it."""
        self._answered_s = now_s

    def clear(self) -> None:
        """Forget what is held: nobody has the port open."""
        self._held = b""

    def block(self, block: StreamBlock | None, since_s: float, now_s: float) -> StreamBlock | None:
        """Return what is handed over until `now_s` of what was sent since `since_s` and of what is held."""
        since_s = max(since_s, self._answered_s)
        before, data = len(self._held), self._held + (b"" if block is None else block.data)
        first = np.floor(since_s / self._period_s + 1e-9) + 1.0
        instants_s = self._period_s * np.arange(first, np.floor(now_s / self._period_s + 1e-9) + 1.0)
        counts, times_s = np.array([before]), np.array([since_s])
        if block is not None and len(block.marks):
            counts = np.append(counts, before + block.marks[:, 0])
            times_s = np.append(times_s, block.marks[:, 1] * 1e-9)
        # a byte that ends at an instant is there
        there = np.floor(np.interp(instants_s, times_s, counts) + 1e-6).astype(np.int64)
        fresh = np.diff(there, prepend=0) > 0
        if not fresh.any():
            self._held = data
            return None
        there, instants_s = there[fresh], instants_s[fresh]
        self._held = data[there[-1] :]
        marks = np.column_stack((there, np.rint(1e9 * instants_s).astype(np.int64)))
        return StreamBlock(data[: there[-1]], marks)
