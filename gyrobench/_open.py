"""Open what is on disk, on any operating system: runs and bench files."""

from __future__ import annotations

from pathlib import Path

from bench.record.benchfile import BenchFile, load_bench_file
from bench.record.recording import Run


def open_run(folder: Path | str) -> Run:
    """Return a run, read as asked for: a folder, or a URL on object storage (`s3://...`).

    `run.manifest` says what was asked, on what, with what outcome. `run.gyro(name)`, `run.turntable()` and
    `run.chamber()` give dictionaries of arrays, float64 or int64 of shape (n,): `time_ns` is bench time in ns,
    `rate_dps` deg/s, `temp_c` degC, `angle_deg` deg. `pandas.DataFrame(run.gyro(name))`,
    `polars.DataFrame(...)` and `pyarrow.table(...)` take such a dictionary as it is.

    RecordError if the folder is no run. A run that a crash left open is read as far as it was written.
    """
    return Run.open(folder)


def load_bench(file: Path | str) -> BenchFile:
    """Return a bench file (TOML) with its devices, limits and safe state, checked.

    ConfigurationError names every key that is missing, unknown or beyond its limits.
    """
    return load_bench_file(Path(file))
