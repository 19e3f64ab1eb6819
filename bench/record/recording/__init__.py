"""The run folder: written while a run goes on, decoded from its raw bytes, verified and read."""

from bench.record.recording._decode import (
    Arrivals,
    StreamSource,
    decode_instrument,
    decode_stream,
    table_name,
    units_off_s,
)
from bench.record.recording._events import EventLog, read_events, record_error
from bench.record.recording._free_parts import PulseReport, StreamReport
from bench.record.recording._journal import Journal, PortJournal
from bench.record.recording._manifest import (
    DeviceEntry,
    EmulatedLab,
    Imported,
    Manifest,
    checksum,
    read_manifest,
    seal,
    seal_state,
    write_manifest,
)
from bench.record.recording._operators import operators_of
from bench.record.recording._raw import missing_tail, read_exchanges, read_marks
from bench.record.recording._read import Phase, Run, Table, check_room, read_table
from bench.record.recording._remote import local_manifests, local_run
from bench.record.recording._tables import (
    names_at,
    row_means,
    second_rows,
    seconds,
    table_writer,
    unit_of,
)
from bench.record.recording._verify import verify

__all__ = [
    "Arrivals",
    "DeviceEntry",
    "EmulatedLab",
    "EventLog",
    "Imported",
    "Journal",
    "Manifest",
    "Phase",
    "PortJournal",
    "PulseReport",
    "Run",
    "StreamReport",
    "StreamSource",
    "Table",
    "check_room",
    "checksum",
    "decode_instrument",
    "decode_stream",
    "local_manifests",
    "local_run",
    "missing_tail",
    "names_at",
    "operators_of",
    "read_events",
    "read_exchanges",
    "read_manifest",
    "read_marks",
    "read_table",
    "record_error",
    "row_means",
    "seal",
    "seal_state",
    "second_rows",
    "seconds",
    "table_name",
    "table_writer",
    "unit_of",
    "units_off_s",
    "verify",
    "write_manifest",
]
