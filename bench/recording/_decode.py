"""raw/ to tables, in blocks: the one way decoded tables are made, at close and again by `runs verify`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.recording._raw import raw_path, read_blocks, read_exchanges, read_marks
from bench.recording._tables import table_writer
from bench.recording._timing import StreamTimer, StreamTiming, Unwrapper
from drivers.instruments import Exchange, FrameBatch, StreamDecoder

Columns = Mapping[str, NDArray[Any]]
Rates = Callable[[Columns, float], Mapping[str, NDArray[Any]]]
Transcript = Callable[[Iterable[Exchange]], tuple[Columns, Mapping[str, int]]]

_BITS_A_BYTE = 10
"""Start bit, eight data bits, stop bit."""
_MOST_LOST = 2**31 - 1


@dataclass(frozen=True)
class GyroSource:
    """How the bytes of one gyro become a table.

    `decoder` makes a fresh decoder; `rates` turns its columns into deg/s by axis, given the true sample rate in
    Hz, `accelerations` into m/s2 by axis where the unit has accelerometers, `temperatures` into further ones in
    degC by column; `axis` is the one under test. `start_offset`: bytes on the port before the stream began
    (answers to configuration). `baudrate`: of a serial port, to take the time on the wire off; None where a
    frame is stamped when it is complete.
    """

    name: str
    decoder: Callable[[], StreamDecoder]
    rates: Rates
    axis: str
    accelerations: Rates | None = None
    temperatures: Rates | None = None
    start_offset: int = 0
    baudrate: int | None = None


@dataclass(frozen=True)
class StreamReport:
    """What a stream held: for the manifest's `stream` entry and the report.

    `lost` frames never arrived (the counter says so), `duplicates` came twice (their rows are not valid),
    `rejected` counts refused candidates by reason. `clock_error_ppm` > 0: the device's clock is fast.
    """

    frames: int
    lost: int
    duplicates: int
    invalid: int
    bytes_received: int
    bytes_skipped: int
    rejected: dict[str, int] = field(default_factory=dict)
    start_offset: int = 0
    sample_rate_hz: float | None = None
    clock_error_ppm: float | None = None
    residual_s: float | None = None
    warnings: tuple[str, ...] = ()


def gyro_table(name: str) -> str:
    """Return the file name of a gyro's decoded table."""
    return f"gyro_{name}.parquet"


def decode_gyro(folder: Path, source: GyroSource, out: Path | None = None) -> StreamReport:
    """Decode raw/<name>.bin of a run into gyro_<name>.parquet in `out` (default: the run folder).

    Two passes in blocks of a megabyte: the first finds where the samples lie in time, the second writes. A stream
    without a single frame gives no table and a report that says so.
    """
    path = raw_path(folder, source.name)
    marks = read_marks(path)
    decoder = source.decoder()
    timer = StreamTimer(decoder.counter_modulo, decoder.counter_step, decoder.nominal_rate_hz)
    frame_bytes = 0
    for batch in _batches(path, source, decoder):
        timer.feed(batch.columns["counter"], batch.end_offset, marks)
        if not frame_bytes and len(batch) > 1:
            frame_bytes = int(np.diff(batch.end_offset).min())
    report = StreamReport(
        frames=decoder.counts.frames,
        lost=0,
        duplicates=0,
        invalid=0,
        bytes_received=path.stat().st_size if path.exists() else 0,
        bytes_skipped=decoder.counts.bytes_skipped,
        rejected=dict(decoder.counts.rejected),
        start_offset=source.start_offset,
    )
    target = (out or folder) / gyro_table(source.name)
    if not timer.has_arrivals:
        target.unlink(missing_ok=True)
        return _with(report, warnings=("no frame with an arrival time",))
    timing = timer.fit(_BITS_A_BYTE * frame_bytes / source.baudrate if source.baudrate else 0.0)
    return _write_gyro(path, source, timing, report, target)


def _write_gyro(
    path: Path, source: GyroSource, timing: StreamTiming, report: StreamReport, target: Path
) -> StreamReport:
    decoder = source.decoder()
    unwrap = Unwrapper(decoder.counter_modulo)
    frames = lost = duplicates = invalid = 0
    last: int | None = None
    with table_writer(target, f"gyro {source.name}, axis under test {source.axis}") as writer:
        for batch in _batches(path, source, decoder):
            count = timing.corrected(unwrap.feed(batch.columns["counter"])[0], frames)
            before = int(count[0] - timing.counter_step) if last is None else last
            step = np.diff(count, prepend=before)
            lost_before = (np.rint(step / timing.counter_step) - 1.0).clip(0, _MOST_LOST).astype(np.int32)
            again = step == 0
            valid = batch.columns["valid"] & ~again
            writer.write(
                {
                    "time_ns": timing.time_ns(count),
                    "counter": count,
                    "lost_before": lost_before,
                    "status": batch.columns["status"],
                    "valid": valid,
                    **_rate_columns(source, batch, timing.sample_rate_hz),
                    "temp_c": batch.columns["temp_c"].astype(np.float32),
                    **_temperatures(source, batch, timing.sample_rate_hz),
                }
            )
            last = int(count[-1])
            frames += len(batch)
            lost += int(lost_before.sum())
            duplicates += int(again.sum())
            invalid += int((~valid).sum())
    return _with(
        report,
        lost=lost,
        duplicates=duplicates,
        invalid=invalid,
        sample_rate_hz=timing.sample_rate_hz,
        clock_error_ppm=timing.clock_error_ppm,
        residual_s=timing.residual_s,
        warnings=timing.warnings,
    )


def decode_instrument(
    folder: Path, port: str, table: str, decode_transcript: Transcript, out: Path | None = None
) -> dict[str, int]:
    """Decode what went over `port` into <table>.parquet; return the driver's counts of what was dropped.

    Telemetry comes a few times a second: one table in memory. Nothing decoded gives no table.
    """
    columns, counts = decode_transcript(read_exchanges(folder, port))
    target = (out or folder) / f"{table}.parquet"
    if not len(columns["time_ns"]):
        target.unlink(missing_ok=True)
        return dict(counts)
    with table_writer(target, f"{table}, from port {port}") as writer:
        writer.write(columns)
    return dict(counts)


def _batches(path: Path, source: GyroSource, decoder: StreamDecoder) -> Iterator[FrameBatch]:
    """Yield non-empty batches, their end offsets counted from the start of the file."""
    for block in read_blocks(path, source.start_offset):
        batch = decoder.feed(block)
        if len(batch):
            yield FrameBatch(batch.columns, batch.end_offset + source.start_offset)


def _rate_columns(source: GyroSource, batch: FrameBatch, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    rates = source.rates(batch.columns, sample_rate_hz)
    others = {f"rate_{axis}_dps": rate for axis, rate in rates.items() if axis != source.axis}
    columns = {"rate_dps": rates[source.axis]} | others
    if source.accelerations is not None:
        forces = source.accelerations(batch.columns, sample_rate_hz)
        columns |= {f"accelerometer_{axis}_mps2": force for axis, force in forces.items()}
    return {name: np.asarray(rate, dtype=np.float32) for name, rate in columns.items()}


def _temperatures(source: GyroSource, batch: FrameBatch, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
    found = {} if source.temperatures is None else source.temperatures(batch.columns, sample_rate_hz)
    return {name: np.asarray(temp_c, dtype=np.float32) for name, temp_c in found.items()}


def _with(report: StreamReport, **changes: Any) -> StreamReport:
    return StreamReport(**{**report.__dict__, **changes})
