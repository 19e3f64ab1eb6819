"""raw/ to tables, in blocks: the one way decoded tables are made, at close and again by `runs verify`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bench.record.events.run import UnitsOff, UnitsOn
from bench.record.recording._events import Line
from bench.record.recording._free_parts import StreamReport
from bench.record.recording._pulses import PulseTimer, warnings_of
from bench.record.recording._raw import (
    first_arrivals,
    missing_tail,
    raw_path,
    read_blocks,
    read_exchanges,
    read_marks,
)
from bench.record.recording._tables import table_writer
from bench.record.recording._timing import StreamTimer, StreamTiming, Unwrapper
from drivers.kit.instruments import (
    FrameBatch,
    LossSide,
    StreamDecoder,
    has_counter,
    loss_taints,
    pulse_resolution_s,
)
from drivers.kit.kinds import Exchange

Columns = Mapping[str, NDArray[Any]]
Role = Literal["gyro", "platform"]
Transcript = Callable[[Iterable[Exchange]], tuple[Columns, Mapping[str, int]]]

_BITS_A_BYTE = 10
"""Start bit, eight data bits, stop bit."""
_MOST_LOST = 2**31 - 1
_LEAST_OFF_S = 1.0


@dataclass(frozen=True)
class StreamSource:
    """How the bytes of one streaming unit become a table.

    `name` is that of unit and port, `decoder` makes a fresh decoder. `values` makes what the table holds beside
    time, counter, losses and status, (n,) each, of decoded columns and the true sample rate in Hz.
    `start_offset`: bytes on the port before the stream began (answers to configuration). `baudrate`: of a serial
    port, to take the time on the wire off; None where a frame is stamped when it is complete. `pulse_interval_s`:
    from pulse to pulse at the unit's trigger input, where `since_pulse_s` is among the decoded columns.
    """

    role: Role
    name: str
    decoder: Callable[[], StreamDecoder]
    values: Callable[[Columns, float], Mapping[str, NDArray[Any]]]
    description: str = ""
    start_offset: int = 0
    baudrate: int | None = None
    pulse_interval_s: float = 1.0

    @property
    def table(self) -> str:
        """File name of the decoded table."""
        return table_name(self.role, self.name)


def table_name(role: Role, unit: str) -> str:
    """Return the file name of a unit's decoded table."""
    return f"{role}_{unit}.parquet"


def decode_stream(
    folder: Path,
    source: StreamSource,
    out: Path | None = None,
    off_s: Sequence[tuple[float, float]] = (),
) -> StreamReport:
    """Decode raw/<name>.bin of a run into the source's table in `out` (default: the run folder).

    `off_s`: spans of bench time in which the unit was switched off and on, see `units_off_s`. Two
    passes in blocks of a megabyte: the first finds where the samples lie in time, the second writes. A stream
    without a single frame gives no table and a report that says so.
    """
    path = raw_path(folder, source.name)
    marks = read_marks(path)
    decoder = source.decoder()
    timer = StreamTimer(
        decoder.counter_modulo, decoder.counter_step, decoder.nominal_rate_hz, has_counter(decoder)
    )
    frame_bytes = 0
    for batch in _batches(path, source, decoder):
        timer.feed(batch.columns["counter"], batch.end_offset, marks)
        if not frame_bytes and len(batch) > 1:
            frame_bytes = int(np.diff(batch.end_offset).min())
    report = StreamReport(
        frames=decoder.counts.frames,
        bytes_received=path.stat().st_size if path.exists() else 0,
        bytes_skipped=decoder.counts.bytes_skipped,
        rejected=dict(decoder.counts.rejected),
        start_offset=source.start_offset,
        warnings=_missing(path),
    )
    target = (out or folder) / source.table
    if not timer.has_arrivals:
        target.unlink(missing_ok=True)
        return replace(report, warnings=(*report.warnings, "no frame with an arrival time"))
    timing = timer.fit(_BITS_A_BYTE * frame_bytes / source.baudrate if source.baudrate else 0.0)
    return _write_table(path, source, timing, report, target, off_s)


def units_off_s(lines: Iterable[Line]) -> list[tuple[float, float]]:
    """Return the spans of bench time in which a procedure had its units switched off and on, from its events."""
    spans: list[tuple[float, float]] = []
    for time_s, event in lines:
        if isinstance(event, UnitsOff):
            spans.append((time_s, math.inf))
        elif isinstance(event, UnitsOn) and spans:
            spans[-1] = (spans[-1][0], time_s)
    return spans


@dataclass(frozen=True, eq=False)
class Arrivals:
    """When frames came in: unwrapped counter and bench time in s of those with an arrival mark, (m,) each.

    `count_s` is a count's length at the nominal rate. A gap of more than one wrap of the counter is not followed.
    """

    count: NDArray[np.int64]
    arrival_s: NDArray[np.float64]
    count_s: float


def read_arrivals(folder: Path, source: StreamSource) -> Arrivals:
    """Return when the frames of raw/<name>.bin arrived."""
    path = raw_path(folder, source.name)
    marks = read_marks(path)
    decoder = source.decoder()
    unwrap = Unwrapper(decoder.counter_modulo)
    counts, arrivals, at = [np.zeros(0, np.int64)], [np.zeros(0)], 0
    for batch in _batches(path, source, decoder):
        count, _ = unwrap.feed(batch.columns["counter"])
        frame, arrival_s, at = first_arrivals(marks, at, batch.end_offset)
        counts.append(count[frame])
        arrivals.append(arrival_s)
    count_s = 1.0 / (decoder.nominal_rate_hz * decoder.counter_step)
    return Arrivals(np.concatenate(counts), np.concatenate(arrivals), count_s)


def _write_table(
    path: Path,
    source: StreamSource,
    timing: StreamTiming,
    report: StreamReport,
    target: Path,
    off_s: Sequence[tuple[float, float]],
) -> StreamReport:
    decoder = source.decoder()
    unwrap = Unwrapper(decoder.counter_modulo)
    frames = lost = off = duplicates = invalid = 0
    last: int | None = None
    restarts = timing.corrections[timing.corrections[:, 1] % decoder.counter_modulo != 0, 0]
    tick_s = 1.0 / (decoder.nominal_rate_hz * decoder.counter_step)
    pulses = PulseTimer(tick_s, source.pulse_interval_s, restarts, pulse_resolution_s(decoder))
    with table_writer(target, source.description) as writer:
        rows = _Rows(loss_taints(decoder))
        for batch in _batches(path, source, decoder):
            count = timing.corrected(unwrap.feed(batch.columns["counter"])[0], frames)
            before = int(count[0] - timing.counter_step) if last is None else last
            step = np.diff(count, prepend=before)
            lost_before = (np.rint(step / timing.counter_step) - 1.0).clip(0, _MOST_LOST).astype(np.int32)
            again = step == 0
            table = rows.judged(
                {
                    "time_ns": timing.time_ns(count),
                    "counter": count,
                    "lost_before": lost_before,
                    "status": batch.columns["status"],
                    "valid": batch.columns["valid"] & ~again,
                    **source.values(batch.columns, timing.sample_rate_hz),
                }
            )
            writer.write(table)
            if "since_pulse_s" in batch.columns:
                pulses.feed(count, batch.columns["since_pulse_s"])
            last = int(count[-1])
            frames += len(batch)
            lost += int(lost_before.sum())
            off += _not_sent(lost_before, timing.time_ns(count), 1.0 / timing.sample_rate_hz, off_s)
            duplicates += int(again.sum())
            invalid += int((~table["valid"]).sum())
        writer.write(rows.kept)
        invalid += int((~rows.kept["valid"]).sum())
    told = pulses.report(timing)
    return replace(
        report,
        lost=lost - off,
        off=off,
        duplicates=duplicates,
        invalid=invalid,
        sample_rate_hz=timing.sample_rate_hz,
        clock_error_ppm=timing.clock_error_ppm,
        residual_s=timing.residual_s,
        pulses=told,
        warnings=(*report.warnings, *timing.warnings, *warnings_of(told)),
    )


def _missing(path: Path) -> tuple[str, ...]:
    """Return a warning if the raw file ends before its index does."""
    if (missing := missing_tail(path)) is None:
        return ()
    return (f"{missing[0]} bytes of {path.name} are missing: nothing is known from {missing[1]:.3f} s on",)


def _not_sent(
    lost_before: NDArray[np.int32],
    time_ns: NDArray[np.int64],
    period_s: float,
    off_s: Sequence[tuple[float, float]],
) -> int:
    """Return how many of the missing samples fall into spans without power; a gap of less than 1 s is a loss."""
    found = 0
    for at in np.flatnonzero(lost_before * period_s > _LEAST_OFF_S).tolist() if off_s else ():
        end_s, missing = 1e-9 * float(time_ns[at]), int(lost_before[at])
        start_s = end_s - (missing + 1) * period_s
        inside_s = sum(max(0.0, min(end_s, high) - max(start_s, low)) for low, high in off_s)
        found += min(missing, round(inside_s / period_s))
    return found


class _Rows:
    """Rows of a table, each given when it is known whether samples were lost behind it.

    A sample beside lost ones whose messages may be of two samples is not valid: nothing tells which are.
    """

    def __init__(self, taints: frozenset[LossSide]) -> None:
        self._taints = taints
        self.kept: dict[str, NDArray[Any]] = {}
        """The last row, whose successor has not come."""

    def judged(self, columns: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Take the next rows (one at least); return those before the last of them, and the one kept."""
        if self.kept:
            columns = {name: np.concatenate((self.kept[name], columns[name])) for name in columns}
        gap = columns["lost_before"] > 0
        good = columns["valid"].copy()
        if "after" in self._taints:
            good &= ~gap
        if "before" in self._taints:
            good[:-1] &= ~gap[1:]
        columns["valid"] = good
        self.kept = {name: column[-1:] for name, column in columns.items()}
        return {name: column[:-1] for name, column in columns.items()}


def decode_instrument(
    folder: Path, port: str, table: str, decode_transcript: Transcript, out: Path | None = None
) -> dict[str, int]:
    """Decode what went over `port` into <table>.parquet; return the driver's counts of what was dropped.

    Telemetry comes a few times a second: one table in memory. Nothing decoded gives no table.
    """
    columns, counts = decode_transcript(read_exchanges(folder, port))
    with table_writer((out or folder) / f"{table}.parquet", f"{table}, from port {port}") as writer:
        if len(columns["time_ns"]):
            writer.write(columns)
    return dict(counts)


def _batches(path: Path, source: StreamSource, decoder: StreamDecoder) -> Iterator[FrameBatch]:
    """Yield non-empty batches, their end offsets counted from the start of the file."""
    for block in read_blocks(path, source.start_offset):
        batch = decoder.feed(block)
        if len(batch):
            yield FrameBatch(batch.columns, batch.end_offset + source.start_offset)
