"""Recording and opening runs: `python -m benchmarks recording`.

Logging against PyMeasure's CSV, tables against asammdf's MDF 4 and against the disk, a day at 100 Hz opened
against pandas. Processor time, in turns.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.record.recording import PortJournal, read_table, table_writer
from benchmarks._measure import Row, in_turns, row
from drivers.kvh import encode_frames

_LOGGED = 50_000
_DAY = 8_640_000
_HOUR_S = (36_000.0, 39_600.0)


def rows() -> Iterator[Row]:
    """Yield the rows of what is installed."""
    with tempfile.TemporaryDirectory(prefix="gyrobench-recording-") as scratch:
        for part in (logging, storing, opening):
            try:
                yield from part(Path(scratch))
            except ImportError as missing:
                print(f"skipped: {part.__name__}: {missing}")


def logging(scratch: Path) -> Iterator[Row]:
    """Samples onto the disk as they come: raw bytes with arrival times, or a CSV line each."""
    from pymeasure.experiment.results import CSVFormatter

    frame = encode_frames("A", np.zeros((1, 3)), counter=np.zeros(1, np.int64), temp_c=25.0)
    formatter = CSVFormatter(columns=["time_s", "rate_dps", "temp_c"])

    def peer() -> None:
        with (scratch / "peer.csv").open("w", encoding="utf-8") as file:
            for number in range(_LOGGED):
                values = {"time_s": number * 0.01, "rate_dps": 1e-3, "temp_c": 25.0}
                file.write(formatter.format(values) + "\n")

    def ours() -> None:
        with tempfile.TemporaryDirectory(dir=scratch) as own:
            journal = PortJournal(Path(own), "fog")
            for number in range(_LOGGED):
                journal.received(frame, number * 0.01)
                if number % 100 == 0:
                    journal.flush(False)
            journal.flush(False)

    def limit() -> None:
        with (scratch / "limit.bin").open("wb", buffering=0) as file:
            for _ in range(_LOGGED // 100):
                file.write(frame * 100)

    title = f"logging {_LOGGED:,} samples as they come"
    yield row(
        title, in_turns(ours, peer), f"PyMeasure {version('pymeasure')} CSVFormatter", per=1e3, unit="ms"
    )
    yield row(
        title, in_turns(ours, limit), "limit: writing the same bytes a second at a time", per=1e3, unit="ms"
    )


def storing(scratch: Path) -> Iterator[Row]:
    """Ten million numbers as a table, and one of its columns back."""
    from asammdf import MDF, Signal

    columns = day(1_000_000)
    time_s = columns["time_ns"] * 1e-9
    ours_file, peer_file = scratch / "table.parquet", scratch / "table.mf4"

    def ours() -> None:
        write(ours_file, columns)

    def peer() -> None:
        with MDF(version="4.10") as file:
            names = [name for name in columns if name != "time_ns"]
            file.append([Signal(columns[name], time_s, name=name) for name in names])
            file.save(peer_file, overwrite=True, compression=1)

    def limit() -> None:
        with (scratch / "limit.bin").open("wb", buffering=0) as file:
            for column in columns.values():
                file.write(column.tobytes())

    def column() -> NDArray[np.float64]:
        with MDF(peer_file) as file:
            return np.asarray(file.get("rate_dps").samples)

    name = f"asammdf {version('asammdf')}, deflate"
    title = "a table of 1,000,000 rows of 9 columns written"
    yield row(title, in_turns(ours, peer, turns=3), name)
    yield row(title, in_turns(ours, limit, turns=3), "limit: writing the numbers as they are")
    assert np.array_equal(read_table(ours_file, ["rate_dps"])["rate_dps"], column())
    pair = in_turns(lambda: read_table(ours_file, ["rate_dps"]), column)
    yield row("one column of it read", pair, name)


def opening(scratch: Path) -> Iterator[Row]:
    """A day at 100 Hz: an hour of one column, one column, and the whole."""
    import pandas as pd

    path = scratch / "day.parquet"
    write(path, day(_DAY))
    low, high = (round(edge * 1e9) for edge in _HOUR_S)

    def plain_hour() -> object:
        frame = pd.read_parquet(path, columns=["time_ns", "rate_dps"], use_threads=False)
        return frame[(frame["time_ns"] >= low) & (frame["time_ns"] < high)]["rate_dps"].to_numpy()

    def hour() -> object:
        return read_table(path, ["rate_dps"], *_HOUR_S)["rate_dps"]

    def limit() -> object:
        return np.full(_DAY, 1.0, np.float32)

    assert np.array_equal(np.asarray(hour()), np.asarray(plain_hour()))
    name = f"pandas {version('pandas')} read_parquet of both columns, then the hour"
    milli = partial(row, per=1e3, unit="ms")
    yield milli("an hour of a day at 100 Hz, rates", in_turns(hour, plain_hour, turns=3), name)
    whole: Callable[[], object] = lambda: read_table(path, ["rate_dps"])  # noqa: E731
    plain: Callable[[], object] = lambda: pd.read_parquet(path, columns=["rate_dps"], use_threads=False)  # noqa: E731
    yield milli("a day at 100 Hz, rates", in_turns(whole, plain), f"pandas {version('pandas')} read_parquet")
    yield milli("a day at 100 Hz, rates", in_turns(whole, limit), "limit: filling memory of that size")


def day(count: int) -> dict[str, NDArray[Any]]:
    """Return `count` rows at 100 Hz as a gyro's table has them, noise in the rates."""
    rng = np.random.default_rng(0)
    number = np.arange(count, dtype=np.int64)
    zeros = np.zeros(count, np.int32)
    rates = {f"rate{axis}_dps": rng.standard_normal(count, np.float32) for axis in ("", "_y", "_z")}
    return {
        "time_ns": number * 10_000_000,
        "counter": number,
        "lost_before": zeros,
        "status": zeros,
        "valid": np.ones(count, np.bool_),
        **rates,
        "temp_c": np.float32(25.0) + rng.standard_normal(count, np.float32) * np.float32(0.01),
    }


def write(path: Path, columns: dict[str, NDArray[Any]], block: int = 29_127) -> None:
    """Write a table in blocks as they are decoded: a megabyte of raw bytes each."""
    count = len(columns["time_ns"])
    with table_writer(path, "gyro fog, axis under test z") as writer:
        for start in range(0, count, block):
            writer.write({name: column[start : start + block] for name, column in columns.items()})


if __name__ == "__main__":
    from benchmarks.__main__ import show

    show(rows())
