"""Daily work against what people would write or install instead: `python -m benchmarks.peers`.

Both do the same work in turns; figures are medians of wall time. A missing peer is named and skipped.
"""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from bench.calibration import Noise, Site, Task
from bench.calibration._observability import observability
from bench.recording import PortJournal
from drivers.clock import host_seconds
from drivers.kvh import encode_frames

Row = dict[str, object]
_TURNS = 3


def rows() -> list[Row]:
    """Return a row for every peer that is installed."""
    table: list[Row] = []
    for work in (observing, logging):
        try:
            table += work()
        except (ImportError, PackageNotFoundError) as missing:
            print(f"skipped: {work.__name__}: {missing}")
    return table


def observing() -> Iterator[Row]:
    """Observability degrees of 30 states: one factorisation, or a least-squares problem a state."""
    task = Task(site=Site(latitude_deg=45.0), noise=Noise(0.001, 10.0, 1e-3))
    q = np.random.default_rng(0).normal(size=(600, 30))
    scaled = q * (task.prior_sigma / task.noise.velocity_mps)

    def peer() -> np.ndarray:
        norms = [np.linalg.norm(np.linalg.lstsq(scaled.T, unit, rcond=None)[0]) for unit in np.eye(30)]
        return 1.0 / np.array(norms)

    np.testing.assert_allclose(observability(q, task).normalised, peer(), rtol=1e-6)
    fast, slow = _turns(lambda: observability(q, task), peer)
    yield _row(
        "observability degrees, 30 states, 600 rows", fast, slow, f"numpy {version('numpy')} lstsq a state"
    )


def logging() -> Iterator[Row]:
    """100,000 samples onto the disk as they come: raw bytes with arrival times, or a CSV line each."""
    from pymeasure.experiment import FloatParameter, Procedure
    from pymeasure.experiment.results import CSVFormatter

    class Gyro(Procedure):  # type: ignore[misc]  # PyMeasure has no types
        rate_hz = FloatParameter("rate", default=100.0)
        DATA_COLUMNS = ["time_s", "rate_dps", "temp_c"]  # noqa: RUF012

    count = 100_000
    frame = encode_frames("A", np.zeros((1, 3)), counter=np.zeros(1, np.int64), temp_c=25.0)
    formatter = CSVFormatter(columns=Gyro.DATA_COLUMNS)
    with tempfile.TemporaryDirectory() as folder:

        def peer() -> None:
            with (Path(folder) / "peer.csv").open("w", encoding="utf-8") as file:
                for number in range(count):
                    row = {"time_s": number * 0.01, "rate_dps": 1e-3, "temp_c": 25.0}
                    file.write(formatter.format(row) + "\n")

        def ours() -> None:
            with tempfile.TemporaryDirectory(dir=folder) as own:
                journal = PortJournal(Path(own), "fog")
                for number in range(count):
                    journal.received(frame, number * 0.01)
                    if number % 100 == 0:
                        journal.flush(False)
                journal.flush(False)

        fast, slow = _turns(ours, peer)
    yield _row("logging 100,000 samples", fast, slow, f"PyMeasure {version('pymeasure')} CSVFormatter")


def _turns(one: Callable[[], object], other: Callable[[], object]) -> tuple[float, float]:
    """Return the median wall time of each in s, run in turns."""
    times = [(_seconds(one), _seconds(other)) for _ in range(_TURNS)]
    return statistics.median(a for a, _ in times), statistics.median(b for _, b in times)


def _seconds(work: Callable[[], object]) -> float:
    begin = host_seconds()
    work()
    return host_seconds() - begin


def _row(benchmark: str, ours: float, peer: float, name: str) -> Row:
    return {
        "benchmark": benchmark,
        "ours": 1e3 * ours,
        "yardstick": 1e3 * peer,
        "yardstick_name": name,
        "unit": "ms",
        "ratio": peer / ours,
    }


if __name__ == "__main__":
    from benchmarks.__main__ import show

    show(rows())
