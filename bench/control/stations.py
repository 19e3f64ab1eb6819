"""The places a procedure works at: chamber and gyros - devices plus limits, telemetry and the record."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from bench.control.approach import WINDOW_S, Approach
from bench.control.history import History
from bench.control.stream_loss import StreamLoss
from drivers.base.errors import LimitExceeded
from drivers.kit.config import GyroConfig, PlatformConfig
from drivers.kit.instruments import (
    Chamber,
    ChamberState,
    Platform,
    StreamDecoder,
    require_ramp,
)
from drivers.kit.kinds import GyroKind, PlatformKind
from drivers.kit.link import Tap

if TYPE_CHECKING:
    from bench.control.session import Bench

_JUMP_C, _FASTEST_C_PER_S = 5.0, 1.0
"""Air, and what is in it, never moves by more than so much and so much a second: fast chambers reach 30 K/min."""

Columns = Mapping[str, NDArray[Any]]
Values = Callable[[Columns], tuple[NDArray[Any], ...]]


class ChamberStation:
    """The thermal chamber. Demands return at once; procedures wait on telemetry."""

    def __init__(self, device: Chamber, bench: Bench, auxiliary: tuple[int, ...]) -> None:
        self.device = device
        self.history = History(("air_temp_c", "set_point_c", *(f"aux_{n}_temp_c" for n in auxiliary)))
        self.auxiliary = auxiliary
        self.set_point_c: float | None = None
        self._approach = Approach()
        self._bench = bench

    def check(self, min_temp_c: float, max_temp_c: float, max_ramp_k_per_min: float = 0.0) -> None:
        """Raise LimitExceeded if the demands are beyond the bench file's or the chamber's own limits."""
        limits, own, can = self._bench.file.limits, self.device.limits(), self.device.capabilities()
        low, high = max(limits.min_temp_c, own.min_temp_c), min(limits.max_temp_c, own.max_temp_c)
        if min_temp_c < low or max_temp_c > high:
            raise LimitExceeded(
                "a chamber set point outside the allowed range",
                where="chamber",
                found=f"{min_temp_c:g} .. {max_temp_c:g} degC",
                expected=f"{low:g} .. {high:g} degC (bench file and chamber limits)",
                remedy="change the temperature parameters, or the limits if chamber and unit really allow it",
            )
        if max_ramp_k_per_min:
            require_ramp(can, max_temp_c, max_ramp_k_per_min, "chamber")
        if max_ramp_k_per_min > limits.max_ramp_k_per_min:
            raise LimitExceeded(
                "a chamber ramp faster than allowed",
                where="chamber",
                found=f"{max_ramp_k_per_min:g} K/min",
                expected=f"at most {limits.max_ramp_k_per_min:g} K/min (bench file)",
                remedy="lower the ramp parameter, or raise limits.max_ramp_k_per_min if the unit allows it",
            )

    def read_state(self) -> ChamberState:
        """Read telemetry; once more if air or a sensor seems to have moved as none does: a digit was damaged.

        Few chamber protocols have a check value. The second answer is believed, whatever it says.
        """
        state, last = self.device.read_state(), self.history.last
        if not last:
            return state
        elapsed_s = self._bench.now_s - last["time_s"]
        read = {"air": (last["air_temp_c"], state.air_temp_c)}
        read |= {f"sensor {n}": (last[f"aux_{n}_temp_c"], state.auxiliary_c[n]) for n in self.auxiliary}
        jumps = [
            f"{name} {now_c:g} degC {elapsed_s:.1f} s after {before_c:g} degC"
            for name, (before_c, now_c) in read.items()
            if abs(now_c - before_c) > _JUMP_C + _FASTEST_C_PER_S * elapsed_s
        ]
        if not jumps:
            return state
        self._bench.repeated("chamber", f"{', '.join(jumps)}, which none does")
        self.device.request_state()
        return self.device.read_state()

    def watch(self) -> None:
        """Write an alarm, once a demand, when the air gets no nearer to its set point."""
        now_s = self._bench.now_s
        if not self._approach.due(now_s) or not (before := self.history.row_at(now_s - WINDOW_S)):
            return
        if wrong := self._approach.look(self.history.last["air_temp_c"], before["air_temp_c"]):
            self._bench.event("alarm", device="chamber", text=wrong)

    def last_seen(self) -> str:
        """Return in words what telemetry said last, empty before the first."""
        if not (last := self.history.last):
            return ""
        ago_s = self._bench.now_s - last["time_s"]
        air, target = last["air_temp_c"], last["set_point_c"]
        return f" ({ago_s:.0f} s ago its air was at {air:.1f} degC, the set point {target:.1f} degC)"

    @property
    def auxiliary_c(self) -> list[float]:
        """What the auxiliary sensors said last, degC."""
        return [self.history.last[f"aux_{number}_temp_c"] for number in self.auxiliary]

    def alarms(self) -> list[str]:
        """Return the chamber's alarms and warnings but for the one that says that its door is open."""
        return [text for text in self.device.alarms() if not self._tells_door(text)]

    def look_at_door(self) -> bool:
        """Ask whether the door is open, as `chamber.door_message` of the bench file tells it."""
        return any(self._tells_door(text) for text in self.device.alarms())

    def _tells_door(self, text: str) -> bool:
        words = self._bench.file.chamber.door_message
        return words is not None and words.casefold() in text.casefold()

    def check_sensors(self) -> None:
        """Raise LimitExceeded if the bench file names a sensor that the chamber does not have."""
        have = self.device.capabilities().auxiliary
        missing = [] if have is None else [number for number in self.auxiliary if number not in have]
        if missing:
            raise LimitExceeded(
                "the chamber has no such auxiliary sensor",
                where="chamber",
                found=", ".join(str(number) for number in missing),
                expected="one of " + ", ".join(str(number) for number in have or ()) if have else "none",
                remedy="correct auxiliary in the bench file, and case_sensor of the gyros with it",
            )

    def go_to(self, set_point_c: float, ramp_k_per_min: float | None = None) -> None:
        """Demand a set point, approached at `ramp_k_per_min` (None: as fast as the chamber can)."""
        self.check(set_point_c, set_point_c, ramp_k_per_min or 0.0)
        self._bench.limits.allow(f"go to {set_point_c:g} degC", set_point_c=set_point_c)
        ramp = "as fast as possible" if ramp_k_per_min is None else f"at {ramp_k_per_min:g} K/min"
        self._bench.command("chamber", f"go to {set_point_c:g} degC {ramp}")
        self.set_point_c = set_point_c
        self._approach.demand(self._bench.now_s, set_point_c, ramp_k_per_min)
        self.device.set_temperature(set_point_c, ramp_k_per_min)

    def start(self) -> None:
        """Start conditioning."""
        self._bench.command("chamber", "start")
        self.device.start()
        self._approach.run(self._bench.now_s, True)

    def stop(self) -> None:
        """Stop conditioning."""
        self._bench.command("chamber", "stop")
        self._approach.run(self._bench.now_s, False)
        self.device.stop()


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
        self._new_decoder = decoder
        self._values = values
        self._decoder: StreamDecoder | None = None
        self._offset = 0
        self._blocks: deque[tuple[float, bytes]] = deque()
        self._lock = threading.Lock()
        self._pending_bytes = 0
        self._loss: StreamLoss | None = None
        self.heard_s = math.nan
        """Bench time of the last bytes; of `listen` before there were any."""
        self.silent = False
        self.gone = False
        """Whether its port went away."""

    @property
    def frames(self) -> int:
        """Frames decoded so far."""
        return 0 if self._decoder is None else self._decoder.counts.frames

    @property
    def lost(self) -> int:
        """Samples that never came, by the unit's own counter and the time they took."""
        return 0 if self._loss is None else self._loss.lost

    @property
    def rejected(self) -> dict[str, int]:
        """Frames rejected so far, by reason."""
        return {} if self._decoder is None else dict(self._decoder.counts.rejected)

    def listen(self, now_s: float) -> None:
        """Take everything that arrives from now on for the stream."""
        self.heard_s = now_s
        self._decoder = self._new_decoder()
        self._loss = StreamLoss(self._decoder)

    def take(self, data: bytes, arrival_s: float) -> None:
        """Keep a block for the next update; with 256 KiB waiting, decode at once so that memory stays flat."""
        if self._decoder is None:
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
        if self._loss is not None:
            self._loss.pause()

    def power_on(self) -> None:
        """Go on counting what is lost."""
        self.update()
        if self._loss is not None:
            self._loss.resume()

    def update(self) -> History:
        """Decode what has arrived since the last call and return the history."""
        with self._lock:
            blocks, self._pending_bytes = list(self._blocks), 0
            self._blocks.clear()
            if blocks and self._decoder is not None:
                self._decode(self._decoder, blocks)
        return self.history

    def _decode(self, decoder: StreamDecoder, blocks: list[tuple[float, bytes]]) -> None:
        ends = self._offset + np.cumsum([len(data) for _, data in blocks])
        batch = decoder.feed(b"".join(data for _, data in blocks))
        self._offset = int(ends[-1])
        if not len(batch):
            return
        if self._loss is not None:
            self._loss.feed(np.asarray(batch.columns["counter"], dtype=np.int64), blocks[-1][0])
        first = np.searchsorted(batch.end_offset, np.concatenate(([0], ends[:-1])), side="right")
        last = np.append(first[1:], len(batch))
        values = [np.asarray(column, dtype=np.float64) for column in self._values(batch.columns)]
        valid = np.asarray(batch.columns["valid"], dtype=bool)
        samples = _sums(valid, first, last)
        sums = [samples]
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
        """Return the mean output from `start_s` to `end_s` (default now), NaN without samples."""
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
