"""Checks a run: the checksums of its files and its manifest, these against the events, and tables rebuilt."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from bench.record.events.run import Invalid, Measured, Outcome
from bench.record.recording._events import EVENTS_FILE, read_events
from bench.record.recording._manifest import (
    FileEntry,
    Manifest,
    checksum,
    own_files,
    read_manifest,
    seal_state,
)
from bench.record.recording._operators import operators_of
from bench.record.recording._raw import missing_tail
from bench.record.recording._remote import local_run
from bench.record.recording._tables import from_arrow
from bench.record.run_folder import MANIFEST_FILE
from bench.record.signing import NotSigned, PublicKey, check_file, signature_file
from drivers.base.errors import BenchError, ConfigurationError, RecordError

Decode = Callable[[Path, Path], object]
"""(run folder, folder for the tables): decodes everything of a run."""


@dataclass(frozen=True)
class FileProblem:
    """A file of the run that is not what it should be."""

    path: str
    text: str


@dataclass(frozen=True)
class VerifyReport:
    """The result: how many files and tables were compared, and every one that differs."""

    files: int
    tables: int
    problems: tuple[FileProblem, ...]
    sealed: bool
    """Whether the manifest has a checksum of its own: those written before November 2026 have none."""
    signed_by: str
    """Whose known key signed the manifest; empty without one."""
    signed: str
    """The comment that was signed with it: run, time, and the name that the key has at its bench."""
    unknown_key: str
    """The key of a whole signature that is not among the known ones: anybody may have made it."""

    @property
    def passed(self) -> bool:
        """Whether nothing differs."""
        return not self.problems


def verify(
    folder: Path, decode: Decode, keys: Sequence[PublicKey] = (), *, must_be_signed: bool = False
) -> VerifyReport:
    """Recompute the checksums of a run and rebuild its tables with `decode`; RecordError if it is no run.

    A run that was never closed has no checksums; its raw bytes can still be decoded, and the report says both.
    A table whose checksum is wrong is named once and not opened. A run on object storage is fetched.
    `keys`: those that are known; with `must_be_signed` a run that none of them signed differs.
    """
    folder = local_run(folder, everything=True)
    manifest = read_manifest(folder)
    problems: list[FileProblem] = []
    if not manifest.complete:
        problems.append(FileProblem("manifest.json", "the run was never closed: there are no checksums"))
    else:
        problems += _compare_files(folder, manifest)
        problems += _compare_manifest(folder, manifest)
    problems += _compare_raw(folder, manifest)
    signature = _signature(folder, manifest, keys, problems, must=must_be_signed)
    sealed = bool(manifest.seal)
    if grown := _grown(folder, manifest.files):
        problems.append(FileProblem(grown, "grown: no tables rebuilt"))
        return VerifyReport(len(manifest.files), 0, tuple(problems), sealed, *signature)
    with tempfile.TemporaryDirectory(prefix="gyrobench-verify-") as rebuilt:
        try:
            decode(folder, Path(rebuilt))
        except BenchError as error:
            problems.append(FileProblem("raw", f"the tables cannot be rebuilt: {error}"))
        names = sorted({path.name for place in (folder, Path(rebuilt)) for path in place.glob("*.parquet")})
        named = {problem.path for problem in problems}
        if manifest.outcome == "aborted":  # its disk may have been full: sealed without tables, raw is whole
            named |= {name for name in names if not (folder / name).exists() and name not in manifest.files}
        problems += [
            FileProblem(name, text)
            for name in names
            if name not in named and (text := _compare_tables(folder / name, Path(rebuilt) / name))
        ]
    return VerifyReport(len(manifest.files), len(names), tuple(problems), sealed, *signature)


def _signature(
    folder: Path, manifest: Manifest, keys: Sequence[PublicKey], problems: list[FileProblem], *, must: bool
) -> tuple[str, str, str]:
    """Return by whom a manifest is signed, what was signed with it, and the key if nobody knows it."""
    path = folder / MANIFEST_FILE
    name = signature_file(path).name
    if not manifest.key:
        if signature_file(path).exists() and manifest.complete:
            problems.append(FileProblem(name, "the manifest does not say that it is signed"))
        if must:
            problems.append(FileProblem(MANIFEST_FILE, "is not signed"))
        return "", "", ""
    try:
        known = next((key for key in keys if key.line == manifest.key), None)
        key, comment = check_file(path, [known or PublicKey.from_text(manifest.key)])
    except (NotSigned, ConfigurationError) as error:
        problems.append(FileProblem(name, str(error)))
        return "", "", ""
    if known is None:
        if must:
            problems.append(FileProblem(name, f"is of another key, {key.line}"))
        return "", comment, key.line
    return known.name, comment, ""


def _compare_files(folder: Path, manifest: Manifest) -> Iterator[FileProblem]:
    expected = manifest.files
    for name, entry in expected.items():
        path = folder / name
        if not path.is_file():
            yield FileProblem(name, "missing")
        elif (size := path.stat().st_size) != entry.bytes:  # a sparse terabyte takes hours to sum
            yield FileProblem(name, f"differs from the manifest: {size} bytes, expected {entry.bytes}")
        elif (found := checksum(path)) != entry:
            yield FileProblem(name, f"differs from the manifest: found {found}, expected {entry}")
    for path in own_files(folder):
        name = path.relative_to(folder).as_posix()
        # A truth was not sealed before manifests were.
        if name not in expected and (manifest.seal or not name.startswith("truth_")):
            yield FileProblem(name, "not in the manifest")


def _compare_manifest(folder: Path, manifest: Manifest) -> Iterator[FileProblem]:
    """Say where a manifest is not the one that was sealed, or says another thing than the events do."""
    if seal_state(folder, manifest) == "broken":
        yield FileProblem(MANIFEST_FILE, "changed after it was sealed")
    try:
        events = read_events(folder)
    except RecordError as error:
        yield FileProblem(EVENTS_FILE, str(error))
        return
    ends = [end for _, end in events.of(Outcome)]
    if not manifest.seal:
        if any(end.sealed for end in ends):
            yield FileProblem(MANIFEST_FILE, "its seal was taken off")
        return
    if not ends and manifest.outcome == "aborted":  # the disk may have been full by then
        return
    invalid = bool(events.of(Invalid))
    if manifest.imported is None and [*manifest.measurements] != [
        measured.fields() for _, measured in events.of(Measured)
    ]:
        yield FileProblem(MANIFEST_FILE, "its measurements are not those of the events")
    if manifest.operators is not None and manifest.operators != operators_of(
        line.event for line in events.lines
    ):
        yield FileProblem(MANIFEST_FILE, "who did what is not that of the events")
    if not ends or (manifest.outcome, manifest.reason) != (ends[-1].outcome, ends[-1].reason):
        yield FileProblem(MANIFEST_FILE, "its outcome or reason is not that of the events")
    elif manifest.outcome != "aborted" and invalid != (manifest.outcome == "invalid"):
        yield FileProblem(MANIFEST_FILE, f"says {manifest.outcome}, the events do not")


def _compare_raw(folder: Path, manifest: Manifest) -> Iterator[FileProblem]:
    """Say which raw files do not have the bytes that were written, or that their index speaks of."""
    for name, count in manifest.written.items():
        entry = manifest.files.get(name)
        if entry is not None and entry.bytes != count:
            yield FileProblem(name, f"has {entry.bytes} bytes; {count} were written")
    for path in sorted((folder / "raw").glob("*.bin")):
        with suppress(RecordError):  # decoding it says what is wrong with it
            if (missing := missing_tail(path)) is not None:
                text = f"lacks {missing[0]} bytes that its index has: nothing from {missing[1]:.3f} s on"
                yield FileProblem(path.relative_to(folder).as_posix(), text)


def _grown(folder: Path, expected: Mapping[str, FileEntry]) -> str:
    """Return the first raw file that is larger than when it was sealed, empty if none is."""
    raw = {name: entry.bytes for name, entry in expected.items() if name.startswith("raw/")}
    return next((n for n, b in raw.items() if (folder / n).is_file() and (folder / n).stat().st_size > b), "")


def _compare_tables(kept: Path, rebuilt: Path) -> str:
    """Return what differs between two tables, empty if they hold the same values bit for bit."""
    if not rebuilt.exists():
        return "cannot be rebuilt: the raw bytes hold nothing for it"
    if not kept.exists():
        return "missing: the raw bytes give this table"
    try:
        left, right = pq.ParquetFile(kept), pq.ParquetFile(rebuilt)
        if left.schema_arrow.names != right.schema_arrow.names:
            return f"has columns {left.schema_arrow.names}, rebuilt {right.schema_arrow.names}"
        if left.metadata.num_rows != right.metadata.num_rows:
            return f"has {left.metadata.num_rows} rows, rebuilt {right.metadata.num_rows}"
        row = 0
        for one, two in zip(left.iter_batches(), right.iter_batches(), strict=True):
            for name in left.schema_arrow.names:
                if text := _compare_columns(one[name], two[name], name, row):
                    return text
            row += len(one)
    except (pa.ArrowException, OSError, ValueError) as error:
        return f"cannot be read: {error}"
    return ""


def _compare_columns(one: pa.Array, two: pa.Array, name: str, row: int) -> str:
    left, right = from_arrow(one), from_arrow(two)
    if left.dtype != right.dtype:
        return f"{name} is {left.dtype}, rebuilt {right.dtype}"
    if left.tobytes() == right.tobytes():
        return ""
    bits = f"u{left.dtype.itemsize}"
    at = int(np.flatnonzero(left.view(bits) != right.view(bits))[0])
    return f"{name} differs from row {row + at} on: {left[at]}, rebuilt {right[at]}"
