"""Runs to and from other software: CSV, Parquet, MDF4 and BLF out; foreign logs in, by a mapping file."""

from bench.exchange._export import FORMATS, export_run
from bench.exchange._import import decode_imported, import_log
from bench.exchange._log import Log, read_log
from bench.exchange._mapping import LogEntry, Mapping, read_mapping

__all__ = [
    "FORMATS",
    "Log",
    "LogEntry",
    "Mapping",
    "decode_imported",
    "export_run",
    "import_log",
    "read_log",
    "read_mapping",
]
