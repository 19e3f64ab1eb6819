"""Runs to and from other software: CSV, Parquet, MDF4 and BLF out; foreign logs in, by a mapping file."""

from bench.record.exchange._export import export_run
from bench.record.exchange._import import decode_imported, import_log
from bench.record.exchange._log import load_asammdf, read_log
from bench.record.exchange._mapping import LogEntry, Mapping, read_mapping

__all__ = [
    "LogEntry",
    "Mapping",
    "decode_imported",
    "export_run",
    "import_log",
    "load_asammdf",
    "read_log",
    "read_mapping",
]
