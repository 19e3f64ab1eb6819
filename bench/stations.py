"""The places a procedure works at: table, chamber, gyros - devices plus limits, telemetry and the record."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bench.history import History
from drivers.errors import DeviceRefused, LimitExceeded, RunAborted
from drivers.instruments import Chamber, GyroKind, Settings, StreamDecoder, Turntable
from drivers.link import Tap

if TYPE_CHECKING:
    from bench.session import Bench

_SETTLED_POLLS = 3
_STAYS = 10.0
"""A settled table may be off by this many times what counted as settled before it has left its demand."""


class TableStation:
    """The rate table. Verbs return when telemetry shows that the motion has settled."""

    def __init__(self, device: Turntable, bench: Bench) -> None:
        self.device = device
        self.history = History(("angle_deg", "rate_dps"))
        self.demand_text = "at rest"
        self._bench = bench
        self._stays: Callable[[dict[str, float]], bool] | None = None

    def check(self, max_rate_dps: float) -> None:
        """Raise LimitExceeded if `max_rate_dps` is beyond the bench file's or the table's own limit."""
        allowed = min(self._bench.file.limits.max_rate_dps, self.device.limits().max_rate_dps)
        if max_rate_dps > allowed:
            raise LimitExceeded(
                f"a table rate of {max_rate_dps:g} deg/s is not allowed",
                where="table",
                found=f"{max_rate_dps:g} deg/s",
                expected=f"at most {allowed:g} deg/s (bench file and table limits)",
                remedy="lower the rate parameter, or raise limits.max_rate_dps if the bench really allows it",
            )

    def confine(self) -> None:
        """Have the table itself keep turns to an angle within the bench file's and its own rate limit."""
        self.device.limit_turns(min(self._bench.file.limits.max_rate_dps, self.device.limits().max_rate_dps))

    def point(self, angle_deg: float, *, tolerance_deg: float = 0.002, timeout_s: float = 300.0) -> None:
        """Turn to `angle_deg` and wait until three polls in a row are within `tolerance_deg`."""
        self._bench.command("table", f"point to {angle_deg:.4f} deg")
        self.demand_text = f"{angle_deg:.3f} deg"
        self._stays = None
        self.device.point(angle_deg)

        def error(row: dict[str, float]) -> float:
            return abs((row["angle_deg"] - angle_deg + 180.0) % 360.0 - 180.0)

        self._settle(
            lambda row: error(row) <= tolerance_deg,
            lambda row: error(row) <= _STAYS * tolerance_deg,
            f"pointing to {angle_deg:.3f} deg",
            timeout_s,
        )

    def spin(self, rate_dps: float, *, timeout_s: float = 300.0) -> None:
        """Turn at `rate_dps` and wait until three polls in a row are within 0.1 % + 0.002 deg/s of it."""
        self.check(abs(rate_dps))
        self._bench.command("table", f"spin at {rate_dps:g} deg/s")
        self.demand_text = f"{rate_dps:g} deg/s"
        self._stays = None
        self.device.spin(rate_dps)
        tolerance = 1e-3 * abs(rate_dps) + 0.002
        self._settle(
            lambda row: abs(row["rate_dps"] - rate_dps) <= tolerance,
            lambda row: abs(row["rate_dps"] - rate_dps) <= _STAYS * tolerance,
            f"reaching {rate_dps:g} deg/s",
            timeout_s,
        )

    def stop(self) -> None:
        """Come to rest."""
        self.spin(0.0)
        self.demand_text = "at rest"

    def watch(self) -> None:
        """Raise RunAborted if telemetry shows that the table has left what it had settled at."""
        if self._stays is None or self._stays(self.history.last):
            return
        self._stays = None
        last = self.history.last
        raise RunAborted(
            "the table has left its demand",
            where="table",
            found=f"{last['angle_deg']:.3f} deg, {last['rate_dps']:.4f} deg/s; "
            + ("; ".join(self.device.alarms()) or "no alarm"),
            expected=self.demand_text,
            remedy="check interlock, emergency stop and the controller's error queue",
        )

    def _settle(
        self,
        close: Callable[[dict[str, float]], bool],
        stays: Callable[[dict[str, float]], bool],
        what: str,
        timeout_s: float,
    ) -> None:
        in_a_row = 0

        def settled() -> bool:
            nonlocal in_a_row
            in_a_row = in_a_row + 1 if close(self.history.last) else 0
            return in_a_row >= _SETTLED_POLLS

        if not self._bench.wait_until(settled, timeout_s=timeout_s, what=what):
            raise DeviceRefused(
                f"the table did not settle within {timeout_s:g} s while {what}",
                where="table",
                found=f"{self.history.last}, {'; '.join(self.device.alarms()) or 'no alarm'}",
                expected=self.demand_text,
                remedy="check interlock, load balance and the axis limits",
            )
        self._stays = stays


class ChamberStation:
    """The thermal chamber. Demands return at once; procedures wait on telemetry."""

    def __init__(self, device: Chamber, bench: Bench, auxiliary: tuple[int, ...]) -> None:
        self.device = device
        self.history = History(("air_temp_c", "set_point_c", *(f"aux_{n}_temp_c" for n in auxiliary)))
        self.auxiliary = auxiliary
        self.set_point_c: float | None = None
        self._bench = bench

    def check(self, min_temp_c: float, max_temp_c: float, max_ramp_k_per_min: float = 0.0) -> None:
        """Raise LimitExceeded if the demands are beyond the bench file's or the chamber's own limits."""
        limits, own = self._bench.file.limits, self.device.limits()
        low, high = max(limits.min_temp_c, own.min_temp_c), min(limits.max_temp_c, own.max_temp_c)
        if min_temp_c < low or max_temp_c > high:
            raise LimitExceeded(
                "a chamber set point outside the allowed range",
                where="chamber",
                found=f"{min_temp_c:g} .. {max_temp_c:g} degC",
                expected=f"{low:g} .. {high:g} degC (bench file and chamber limits)",
                remedy="change the temperature parameters, or the limits if chamber and unit really allow it",
            )
        if max_ramp_k_per_min > limits.max_ramp_k_per_min:
            raise LimitExceeded(
                "a chamber ramp faster than allowed",
                where="chamber",
                found=f"{max_ramp_k_per_min:g} K/min",
                expected=f"at most {limits.max_ramp_k_per_min:g} K/min (bench file)",
                remedy="lower the ramp parameter, or raise limits.max_ramp_k_per_min if the unit allows it",
            )

    def go_to(self, set_point_c: float, ramp_k_per_min: float | None = None) -> None:
        """Demand a set point, approached at `ramp_k_per_min` (None: as fast as the chamber can)."""
        self.check(set_point_c, set_point_c, ramp_k_per_min or 0.0)
        ramp = "as fast as possible" if ramp_k_per_min is None else f"at {ramp_k_per_min:g} K/min"
        self._bench.command("chamber", f"go to {set_point_c:g} degC {ramp}")
        self.set_point_c = set_point_c
        self.device.set_temperature(set_point_c, ramp_k_per_min)

    def start(self) -> None:
        """Start conditioning."""
        self._bench.command("chamber", "start")
        self.device.start()

    def stop(self) -> None:
        """Stop conditioning."""
        self._bench.command("chamber", "stop")
        self.device.stop()


class GyroStation:
    """One streaming gyro: its bytes go to the record, and recent means of its output to the procedure.

    The history has a row per delivered block that has valid samples: how many, their mean rate under the axis of
    test in deg/s at the nominal sample rate, and the mean of the gyro's own temperature.
    """

    def __init__(self, kind: GyroKind, settings: Settings) -> None:
        self.name: str = settings["name"]
        self.axis: str = settings["axis"]
        self.case_sensor: int | None = settings["case_sensor"]
        self.history = History(("samples", "rate_dps", "temp_c"))
        self._kind = kind
        self._settings = settings
        self._decoder: StreamDecoder | None = None
        self._offset = 0
        self._blocks: deque[tuple[float, bytes]] = deque()
        self._lock = threading.Lock()
        self._pending_bytes = 0
        self._counter: int | None = None
        self.lost = 0
        """Samples that never came, by the unit's own counter."""

    @property
    def frames(self) -> int:
        """Frames decoded so far."""
        return 0 if self._decoder is None else self._decoder.counts.frames

    @property
    def rejected(self) -> dict[str, int]:
        """Frames rejected so far, by reason."""
        return {} if self._decoder is None else dict(self._decoder.counts.rejected)

    def listen(self) -> None:
        """Take everything that arrives from now on for the stream."""
        self._decoder = self._kind.decoder(self._settings)

    def take(self, data: bytes, arrival_s: float) -> None:
        """Keep a block for the next update; with 256 KiB waiting, decode at once so that memory stays flat."""
        if self._decoder is None:
            return
        with self._lock:
            self._blocks.append((arrival_s, data))
            self._pending_bytes += len(data)
            full = self._pending_bytes > 262_144
        if full:
            self.update()

    def update(self) -> History:
        """Decode what has arrived since the last call and return the history."""
        with self._lock:
            blocks, self._pending_bytes = list(self._blocks), 0
            self._blocks.clear()
            if blocks and self._decoder is not None:
                self._decode(self._decoder, blocks)
        return self.history

    def mean_rate_dps(self, start_s: float, end_s: float | None = None) -> float:
        """Return the mean output from `start_s` to `end_s` (default now), NaN without samples."""
        rows = self.update().since(start_s)
        keep = rows["time_s"] <= (np.inf if end_s is None else end_s)
        samples = rows["samples"][keep]
        total = samples.sum()
        return float((rows["rate_dps"][keep] * samples).sum() / total) if total else float("nan")

    def _decode(self, decoder: StreamDecoder, blocks: list[tuple[float, bytes]]) -> None:
        ends = self._offset + np.cumsum([len(data) for _, data in blocks])
        batch = decoder.feed(b"".join(data for _, data in blocks))
        self._offset = int(ends[-1])
        if not len(batch):
            return
        self._count_lost(decoder, np.asarray(batch.columns["counter"], dtype=np.int64))
        first = np.searchsorted(batch.end_offset, np.concatenate(([0], ends[:-1])), side="right")
        last = np.append(first[1:], len(batch))
        rate = np.asarray(
            self._kind.rates(self._settings, batch.columns, self._settings["rate_hz"])[self.axis],
            dtype=np.float64,
        )
        temp = np.asarray(batch.columns["temp_c"], dtype=np.float64)
        valid = np.asarray(batch.columns["valid"], dtype=bool)
        for (arrival_s, _), start, stop in zip(blocks, first, last, strict=True):
            use = valid[start:stop]
            if use.any():
                known = temp[start:stop][use & ~np.isnan(temp[start:stop])]
                mean_temp = float(known.mean()) if len(known) else float("nan")
                self.history.append(arrival_s, int(use.sum()), float(rate[start:stop][use].mean()), mean_temp)

    def _count_lost(self, decoder: StreamDecoder, counter: NDArray[np.int64]) -> None:
        before = counter[0] - round(decoder.counter_step) if self._counter is None else self._counter
        step = np.mod(np.diff(counter, prepend=before), decoder.counter_modulo)
        self._counter = int(counter[-1])
        self.lost += int(np.maximum(np.rint(step / decoder.counter_step) - 1.0, 0.0).sum())


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
