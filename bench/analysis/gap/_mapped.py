"""The logs of a mapping file, and the log that an imported run keeps: each read once for all of its signals."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bench.record.exchange import Log, LogEntry, Mapping, read_log, read_mapping
from bench.record.recording import Run
from drivers.base.errors import ConfigurationError

_BLOCK = 1 << 20


@dataclass(frozen=True, eq=False)
class MappedLog:
    """A log, its mapping and its entry in that; `run_id` and `checksum` are the log's, or the imported run's."""

    entry: LogEntry
    mapping: Mapping
    file: Path
    log: Log
    run_id: str
    checksum: str

    @property
    def has_rate(self) -> bool:
        """Whether the log has a gyro's output."""
        return "output" in self.log.columns


def mapped_logs(path: Path) -> Iterator[MappedLog]:
    """Yield the logs that a mapping file lists; ConfigurationError says what a mapping or file lacks."""
    mapping = read_mapping(path)
    logs = mapping.logs(path)
    same = Counter(entry.run_id for entry, _ in logs)
    for entry, file in logs:
        own = entry.run_id if entry.run_id and same[entry.run_id] == 1 else file.stem
        beside = [mapping.recorder_file(name, file) for name in sorted(mapping.recorder)]
        yield MappedLog(entry, mapping, file, read_log(file, mapping), own, checksum_of(file, *beside))


def imported_log(run: Run) -> MappedLog:
    """Return the log that a run made by `gyrobench import` keeps; ConfigurationError for another run."""
    imported = run.manifest.imported
    if imported is None:
        raise ConfigurationError("this run was not imported", where=str(run.place))
    mapping, file = read_mapping(run.file(imported.mapping)), run.file(imported.log)
    entry = mapping.entry_for(file, file)
    return MappedLog(entry, mapping, file, read_log(file, mapping), run.manifest.run_id, run.checksum)


def checksum_of(*files: Path) -> str:
    """Return the SHA-256 of a log and of what other recorders wrote beside it, one file after the other."""
    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as log:
            while block := log.read(_BLOCK):
                digest.update(block)
    return digest.hexdigest()
