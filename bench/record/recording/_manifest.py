"""manifest.json: what was asked, on what, how it ended, and the checksums that seal a run."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from bench.record.events import Role
from bench.record.recording._events import EVENTS_FILE, record_error
from bench.record.recording._free_parts import FreeParts, check_free_parts
from bench.record.run_folder import MANIFEST_FILE, PICTURES_FOLDER, PROCEDURE_FILE
from bench.record.shown import Shown
from bench.record.signing import SigningKey, signature_file
from drivers.base.clock import utc_now
from drivers.base.errors import RecordError
from drivers.base.files import MANIFEST_BYTES, read_bounded, replace_file
from drivers.base.system import sync_folder

T = TypeVar("T")
Outcome = Literal["running", "completed", "invalid", "aborted"]


def _inside(name: str) -> str:
    """Return a file's name relative to the run folder; ValueError for one that leads out of it."""
    if len(name) > 4096 or not name.isprintable() or "\\" in name:
        raise ValueError("not the name of a file")
    if any(part in ("", ".", "..") for part in name.split("/")):
        raise ValueError("leads out of the run folder")
    return name


def _one_name(name: str) -> str:
    if "/" in name:
        raise ValueError("a run's id is the name of a folder, not a path")
    return _inside(name)


FileName = Annotated[str, AfterValidator(_inside)]
RunId = Annotated[str, AfterValidator(_one_name)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="null", allow_inf_nan=False)


class DeviceEntry(_Part):
    """One device as it identified itself, and its place on the bench."""

    kind: str
    role: str
    maker: str = ""
    model: str = ""
    serial_number: str = ""
    firmware: str = ""
    axis: str | int | None = None
    case_sensor: int | None = None


class EmulatedLab(_Part):
    """Present if the devices were emulated."""

    seed: int
    model: str


class Imported(_Part):
    """Present if the run came from another bench: the log and its mapping file, paths in the run folder.

    `elevation_deg`: of the axis under test; None in older runs.
    """

    log: FileName
    mapping: FileName
    elevation_deg: float | None = None


class OperatorEntry(_Part):
    """Somebody who did something in the run; `role`: as which they were signed in, None if nobody checked."""

    name: str
    role: Role | None = None
    did: tuple[str, ...] = ()


class FileEntry(_Part):
    """Checksum and size of a file of the run."""

    sha256: str
    bytes: int


class Manifest(Shown, _Part):
    """The manifest as written; outcome "running" until the run has been closed."""

    format: Literal[1] = 1
    run_id: RunId
    procedure: str
    parameters: dict[str, Any] = Field(default_factory=dict)
    mounting: str = ""
    outcome: Outcome = "running"
    reason: str = ""
    started_utc: str
    ended_utc: str | None = None
    duration_s: float | None = None
    flush_interval_s: float | None = None
    """What came longer than this before a crash, in wall time, is on the disk."""
    bench: dict[str, Any] = Field(default_factory=dict)
    bench_file_sha256: str = ""
    devices: dict[str, DeviceEntry] = Field(default_factory=dict)
    units: dict[str, str] = Field(default_factory=dict)
    emulated: EmulatedLab | None = None
    imported: Imported | None = None
    software: dict[str, str] = Field(default_factory=dict)
    stream: dict[str, dict[str, Any]] = Field(default_factory=dict)
    measurements: tuple[dict[str, Any], ...] = ()
    operators: tuple[OperatorEntry, ...] | None = None
    """Who started, answered, paused, resumed or aborted; None in imported and older runs."""
    repeats: dict[str, int] = Field(default_factory=dict)
    """How many exchanges with an instrument were tried again, by device: the `repeat` events."""
    written: dict[FileName, int] = Field(default_factory=dict)
    """Bytes of each raw file that the operating system took while the run went on."""
    files: dict[FileName, FileEntry] = Field(default_factory=dict)
    key: str = ""
    """The bench's public key (a minisign key, RW...) if the manifest is signed; its signature lies beside it."""
    seal: str = ""
    """SHA-256 of this manifest's bytes without these 64; empty in runs of before November 2026."""

    def shown(self) -> dict[str, object]:
        """Return what was asked, on what, and what came of it; `model_dump()` has all of it."""
        return {
            "run": self.run_id,
            "procedure": self.procedure,
            "parameters": [f"{name} {value}" for name, value in self.parameters.items()],
            "outcome": self.outcome,
            **({"reason": self.reason} if self.reason else {}),
            "units": list(self.units.values()),
            "measurements": [row["name"] for row in self.measurements],
        }

    @property
    def complete(self) -> bool:
        """Whether the run was closed and sealed, whatever its outcome."""
        return self.outcome != "running"

    @property
    def bench_name(self) -> str:
        """The name of the bench, empty if none was kept."""
        return str(self.bench.get("bench", {}).get("name", ""))

    @property
    def elevation_deg(self) -> float:
        """Elevation of the axis under test: as it was mounted, upright or level; of an imported run as told."""
        if self.imported is not None and self.imported.elevation_deg is not None:
            return self.imported.elevation_deg
        return 90.0 if self.mounting == "axis_up" else 0.0

    @property
    def latitude_deg(self) -> float:
        """Where the bench stands; RecordError if the run does not say so."""
        bench = self.bench.get("bench", {})
        return float(self._held(bench, "latitude_deg", "the latitude of the bench", "bench.bench"))

    def device(self, name: str) -> DeviceEntry:
        """Return who answered under a name of the bench file; RecordError if nobody is in the record."""
        return self._held(self.devices, name, f"the device {name}", "devices")

    def unit(self, name: str) -> str:
        """Return the unit that was tested under a gyro's name; RecordError if none is in the record."""
        return self._held(self.units, name, f"the unit of {name}", "units")

    def measured(self, name: str) -> float | None:
        """Return a measured value; None if it was not measured or was not finite."""
        return next((row.get("value") for row in self.measurements if row["name"] == name), None)

    def parameter(self, name: str) -> float | None:
        """Return a parameter that is a number; None if there is none, RecordError for text."""
        value = self.parameters.get(name)
        if value is None or (isinstance(value, int | float) and not isinstance(value, bool)):
            return value
        raise RecordError(
            f"the parameter {name} is no number", where=f"run {self.run_id}", found=repr(value)[:60]
        )

    def _held(self, part: Mapping[str, T], name: str, what: str, where: str) -> T:
        if name in part:
            return part[name]
        raise RecordError(
            f"the run's manifest does not have {what}",
            where=f"run {self.run_id}",
            found=f"no {where}.{name} in {MANIFEST_FILE}",
            expected="a run that was begun on a bench, its devices found",
        )


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Write manifest.json in one piece: a reader finds the old one or the new one. Raises RecordError."""
    path = folder / MANIFEST_FILE
    try:
        replace_file(path, _text(manifest))
        sync_folder(folder)
    except OSError as error:
        raise record_error(path, error) from error


def _text(manifest: Manifest) -> str:
    return manifest.model_dump_json(indent=2) + "\n"


def seal(folder: Path, manifest: Manifest, key: SigningKey | None = None, **ending: Any) -> Manifest:
    """Write the final manifest with the checksums of the run's files and its own; return it. Raises RecordError.

    `key`: of the bench, which then signs it; `ending`: what `manifest` does not have yet, its outcome first,
    which must not be "running" any more. The signature is there before what it signs: a crash between the two
    leaves an open run.
    """
    sealed = manifest.model_copy(update=ending)
    if not sealed.complete:
        raise RecordError("a running run cannot be sealed", where=str(folder))
    try:
        files = checksums(folder)
    except OSError as error:
        raise record_error(folder, error) from error
    said = key.public.line if key is not None else ""
    sealed = sealed.model_copy(update={"files": files, "key": said, "seal": ""})
    sealed = sealed.model_copy(update={"seal": hashlib.sha256(_text(sealed).encode()).hexdigest()})
    signature = signature_file(folder / MANIFEST_FILE)
    try:
        if key is None:
            signature.unlink(missing_ok=True)  # of a seal that a crash prevented
        else:
            comment = f"run:{sealed.run_id}\tsealed:{utc_now()}\tby:{key.public.name}"
            replace_file(signature, key.sign(_text(sealed).encode(), comment))
    except OSError as error:
        raise record_error(signature, error) from error
    write_manifest(folder, sealed)
    return sealed


def seal_state(folder: Path, manifest: Manifest) -> Literal["whole", "broken", "none"]:
    """Return whether the manifest of a run folder has the bytes that it was sealed with; RecordError."""
    if not manifest.seal:
        return "none"
    path = folder / MANIFEST_FILE
    try:
        content = read_bounded(path, MANIFEST_BYTES)
    except OSError as error:
        raise record_error(path, error) from error
    unsealed = content.replace(manifest.seal.encode(), b"")
    return "whole" if hashlib.sha256(unsealed).hexdigest() == manifest.seal else "broken"


def read_manifest(folder: Path) -> Manifest:
    """Read manifest.json of a run folder; RecordError if it is missing or not a manifest."""
    path = folder / MANIFEST_FILE
    try:
        manifest = Manifest.model_validate_json(read_bounded(path, MANIFEST_BYTES))
        parts = {name: getattr(manifest, name) for name in FreeParts.model_fields}
        check_free_parts(parts | {"measurements": list(manifest.measurements)})
        return manifest
    except OSError as error:
        raise RecordError(
            "this is not a run folder",
            where=str(folder),
            found=f"{MANIFEST_FILE}: {error.strerror}",
            expected="a folder with manifest.json, events.jsonl and raw/",
            remedy="`gyrobench runs list` lists the runs there are",
        ) from error
    except ValueError as error:
        raise RecordError(
            "the manifest cannot be read",
            where=str(path),
            found=_mistakes(error),
            expected="a manifest of format 1",
            remedy="restore the file from a copy, or read the run with the version that wrote it",
        ) from error


def _mistakes(error: ValueError) -> str:
    if not isinstance(error, ValidationError):
        return str(error)
    first = error.errors()[0]
    return f"{'.'.join(map(str, first['loc']))}: {first['msg']} ({error.error_count()} in all)"


def own_files(folder: Path) -> list[Path]:
    """Return what a run consists of, sorted: events, raw, tables, watchdog, pictures, procedure, truth.

    All of it is sealed. Notes are not, which people add later.
    """
    paths = [
        folder / EVENTS_FILE,
        folder / PROCEDURE_FILE,
        *folder.glob("*.parquet"),
        *folder.glob("truth_*"),
    ]
    paths += [path for name in ("raw", PICTURES_FOLDER) for path in (folder / name).glob("*")]
    return sorted(path for path in [*paths, *(folder / "watchdog").rglob("*")] if path.is_file())


def checksums(folder: Path) -> dict[str, FileEntry]:
    """Return the checksums of the run's own files by their paths in it."""
    return {path.relative_to(folder).as_posix(): checksum(path) for path in own_files(folder)}


def checksum(path: Path) -> FileEntry:
    """Return SHA-256 and size of a file."""
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256")
        return FileEntry(sha256=digest.hexdigest(), bytes=file.tell())
