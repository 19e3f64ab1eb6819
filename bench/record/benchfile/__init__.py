"""The bench file: which devices stand on which ports, and the limits of the place."""

from bench.record.benchfile._calibration import Calibration, calibrations_of, overdue, require_quantities
from bench.record.benchfile._load import bench_file_from, bench_file_text, load_bench_file
from bench.record.benchfile._model import (
    Band,
    BenchFile,
    BenchSection,
    Emulated,
    ForbiddenState,
    LimitsSection,
    SafeSection,
)

__all__ = [
    "Band",
    "BenchFile",
    "BenchSection",
    "Calibration",
    "Emulated",
    "ForbiddenState",
    "LimitsSection",
    "SafeSection",
    "bench_file_from",
    "bench_file_text",
    "calibrations_of",
    "load_bench_file",
    "overdue",
    "require_quantities",
]
