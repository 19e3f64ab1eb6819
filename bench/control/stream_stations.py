"""The streaming units a procedure works with: their bytes go to the record, recent means to the procedure."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from bench.control.history import History
from drivers.kit.config import GyroConfig, PlatformConfig
from drivers.kit.instruments import Platform, StreamDecoder
from drivers.kit.kinds import GyroKind, PlatformKind
from drivers.kit.link import Tap

Columns = Mapping[str, NDArray[Any]]
Values = Callable[[Columns], tuple[NDArray[Any], ...]]
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
    """Counts the samples that never came, between the first and the last one seen, while a stream runs.

    A counter that begins anew after a power-on looks like a jump forward by nearly its whole range. Arrivals tell
    the difference: from then on they are earlier (or, after a long silence, later) than the count says, and stay
    so. The record's tables are made with more care afterwards (`bench.record.recording`); a gap of more than a
    wrap of the counter that lasts less than a quarter of a second shows only there.
    """

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


class StreamStation:
    """One streaming unit: its bytes go to the record, and recent means of its output to the procedure.

    The history has a row per delivered block that has valid samples: how many, and the means of `columns`, whose
    values `values` makes of decoded columns, a (n,) array for each.
    """

    role: ClassVar[Literal["gyro", "platform"]]

    def __init__(
        self,
        name: str,
        interval_s: float,
        decoder: Callable[[], StreamDecoder],
        columns: tuple[str, ...],
        values: Values,
    ) -> None:
        self.name = name
        self.interval_s = interval_s
        """Time from sample to sample, as the bench file has it."""
        self.history = History(("samples", *columns))
        self._values = values
        self._decoder, self._listening = decoder(), False
        self._offset = 0
        self._blocks: deque[tuple[float, bytes]] = deque()
        self._lock = threading.Lock()
        self._pending_bytes = 0
        self.total_samples, self.total = 0, 0.0
        """Valid samples since the stream began and their sum in the first column: means between any two looks."""
        self._loss = StreamLoss(self._decoder)
        self.heard_s = math.nan
        """Bench time of the last bytes; of `listen` before there were any."""
        self.silent = False
        self.gone = False
        """Whether its port went away."""

    @property
    def frames(self) -> int:
        """Frames decoded so far."""
        return self._decoder.counts.frames

    @property
    def lost(self) -> int:
        """Samples that never came, by the unit's own counter and the time they took."""
        return self._loss.lost

    @property
    def rejected(self) -> dict[str, int]:
        """Frames rejected so far, by reason."""
        return dict(self._decoder.counts.rejected)

    def listen(self, now_s: float) -> None:
        """Take everything that arrives from now on for the stream."""
        self.heard_s, self._listening = now_s, True

    def take(self, data: bytes, arrival_s: float) -> None:
        """Keep a block for the next update; with 256 KiB waiting, decode at once so that memory stays flat."""
        if not self._listening:
            return
        self.heard_s = arrival_s
        with self._lock:
            self._blocks.append((arrival_s, data))
            self._pending_bytes += len(data)
            full = self._pending_bytes > 262_144
        if full:
            self.update()

    def power_off(self) -> None:
        """Take what does not come until `power_on` for intended, not for lost."""
        self.update()
        self._loss.pause()

    def power_on(self) -> None:
        """Go on counting what is lost."""
        self.update()
        self._loss.resume()

    def update(self) -> History:
        """Decode what has arrived since the last call and return the history."""
        with self._lock:
            blocks, self._pending_bytes = list(self._blocks), 0
            self._blocks.clear()
            if blocks:
                self._decode(blocks)
        return self.history

    def _decode(self, blocks: list[tuple[float, bytes]]) -> None:
        ends = self._offset + np.cumsum([len(data) for _, data in blocks])
        batch = self._decoder.feed(b"".join(data for _, data in blocks))
        self._offset = int(ends[-1])
        if not len(batch):
            return
        self._loss.feed(np.asarray(batch.columns["counter"], dtype=np.int64), blocks[-1][0])
        first = np.searchsorted(batch.end_offset, np.concatenate(([0], ends[:-1])), side="right")
        last = np.append(first[1:], len(batch))
        values = [np.asarray(column, dtype=np.float64) for column in self._values(batch.columns)]
        valid = np.asarray(batch.columns["valid"], dtype=bool)
        samples = _sums(valid, first, last)
        sums = [samples]
        known = valid & ~np.isnan(values[0])
        self.total_samples += int(known.sum())
        self.total += float(values[0][known].sum())
        for column in values:
            known = valid & ~np.isnan(column)
            with np.errstate(invalid="ignore"):  # no known value in a block: its mean is NaN
                sums.append(_sums(np.where(known, column, 0.0), first, last) / _sums(known, first, last))
        arrival_s = np.array([time_s for time_s, _ in blocks])
        self.history.extend(np.column_stack([arrival_s, *sums])[samples > 0])


class GyroStation(StreamStation):
    """One gyro: mean rate about the axis under test at the nominal sample rate, and its own temperature."""

    role = "gyro"

    def __init__(self, kind: GyroKind[Any], config: GyroConfig) -> None:
        self.axis: str = config.axis
        self.heed: Callable[[str, float, float, float], None] = lambda *evaluated: None
        """Told of every mean that a procedure asks for: name, from, until, deg/s."""
        self.case_sensor: int | None = config.case_sensor

        def values(columns: Columns) -> tuple[NDArray[Any], ...]:
            return kind.rates(config, columns, config.rate_hz)[self.axis], columns["temp_c"]

        super().__init__(
            config.name,
            1.0 / config.rate_hz,
            lambda: kind.decoder(config),
            ("rate_dps", "temp_c"),
            values,
        )

    def mean_rate_dps(self, start_s: float, end_s: float | None = None) -> float:
        """Return the mean output from `start_s` to `end_s` (default now), NaN without samples.

        The run is invalid if the table turned meanwhile and the axis under test hardly felt it.
        """
        mean_dps = self.output_dps(start_s, end_s)
        last_s = self.history.last.get("time_s", start_s)
        self.heed(self.name, start_s, last_s if end_s is None else end_s, mean_dps)
        return mean_dps

    def seconds(self, start_s: float, end_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the valid samples of each second of a stretch and the sum of their rates, deg/s, (n,) each.

        A sample counts in the second in which it arrived, with others. Ask in time: the history holds the last
        65,536 arrivals, which is 17 min of an adapter that hands over every 16 ms.
        """
        rows = self.update().since(start_s)
        count = max(1, round(end_s - start_s))
        second = np.minimum((rows["time_s"] - start_s).astype(np.int64), count - 1)
        known = np.isfinite(rows["rate_dps"]) & (rows["time_s"] < end_s)
        second, samples, rates = second[known], rows["samples"][known], rows["rate_dps"][known]
        summed = [
            np.bincount(second, weights, count).astype(np.float64) for weights in (samples, samples * rates)
        ]
        return summed[0], summed[1]

    def output_dps(self, start_s: float, end_s: float | None = None) -> float:
        """Return the same for a display: nothing is made of it."""
        rows = self.update().since(start_s)
        keep = rows["time_s"] <= (np.inf if end_s is None else end_s)
        samples = rows["samples"][keep]
        total = samples.sum()
        return float((rows["rate_dps"][keep] * samples).sum() / total) if total else float("nan")


class PlatformStation(StreamStation):
    """One platform INS: position and temperature."""

    role = "platform"
    device: Platform

    def __init__(self, kind: PlatformKind[Any], config: PlatformConfig) -> None:
        names = ("latitude_deg", "longitude_deg", "temp_c")
        super().__init__(
            config.name,
            float(config.period_s),
            lambda: kind.decoder(config),
            names,
            lambda rows: tuple(rows[n] for n in names),
        )


def _sums(values: NDArray[Any], first: NDArray[np.int64], last: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the sums of values[first[k]:last[k]], (m,)."""
    total = np.concatenate(([0.0], np.cumsum(values, dtype=np.float64)))
    sums: NDArray[np.float64] = total[last] - total[first]
    return sums


class StreamTap:
    """Sends a gyro link's bytes to the record first, then to the station."""

    def __init__(self, record: Tap, station: Callable[[bytes, float], None]) -> None:
        self._record = record
        self._station = station

    def received(self, data: bytes, arrival_s: float) -> None:
        """Record, then hand over."""
        self._record.received(data, arrival_s)
        self._station(data, arrival_s)

    def sent(self, data: bytes, time_s: float) -> None:
        """Record what the bench wrote."""
        self._record.sent(data, time_s)
