"""Runs to and from other software: CSV, Parquet, MDF4 and BLF out; foreign logs in, by a mapping file."""

from bench.record.exchange._described import fitting_description
from bench.record.exchange._export import export_run
from bench.record.exchange._import import decode_imported, import_log
from bench.record.exchange._log import Log, read_log
from bench.record.exchange._mapping import LogEntry, Mapping, read_mapping
from bench.record.exchange._table import Table, read_table
from bench.record.exchange._units import BASE_UNITS, Scale, scale_of, unit_error

__all__ = [
    "BASE_UNITS",
    "Log",
    "LogEntry",
    "Mapping",
    "Scale",
    "Table",
    "decode_imported",
    "export_run",
    "fitting_description",
    "import_log",
    "read_log",
    "read_mapping",
    "read_table",
    "scale_of",
    "unit_error",
]
