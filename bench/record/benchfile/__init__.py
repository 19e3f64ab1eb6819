"""The bench file: which devices stand on which ports, and the limits of the place."""

from bench.record.benchfile._drivers import ENTRY_POINT_GROUP, ROLES, driver_path, known_drivers
from bench.record.benchfile._load import bench_file_from, load_bench_file
from bench.record.benchfile._model import (
    AxisSection,
    Band,
    BenchFile,
    BenchSection,
    ChamberSection,
    Emulated,
    ForbiddenState,
    GyroSection,
    LimitsSection,
    PlatformSection,
    RecordingSection,
    SafeSection,
    TableSection,
)
from bench.record.benchfile._write import bench_file_text

__all__ = [
    "ENTRY_POINT_GROUP",
    "ROLES",
    "AxisSection",
    "Band",
    "BenchFile",
    "BenchSection",
    "ChamberSection",
    "Emulated",
    "ForbiddenState",
    "GyroSection",
    "LimitsSection",
    "PlatformSection",
    "RecordingSection",
    "SafeSection",
    "TableSection",
    "bench_file_from",
    "bench_file_text",
    "driver_path",
    "known_drivers",
    "load_bench_file",
]
