"""The record of one run, from the first byte to the sealed folder."""

from __future__ import annotations

import dataclasses
import hashlib
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import datetime
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.record.benchfile import BenchFile, bench_file_from
from bench.record.events import Event
from bench.record.events.run import Answer, Invalid, Measured, Outcome, Repeat
from bench.record.recording import (
    DeviceEntry,
    EmulatedLab,
    EventLog,
    Journal,
    Manifest,
    PortJournal,
    StreamReport,
    StreamSource,
    decode_instrument,
    decode_stream,
    operators_of,
    read_events,
    read_manifest,
    record_error,
    seal,
    units_off_s,
    write_manifest,
)
from bench.record.run_folder import PICTURES_FOLDER, PROCEDURE_FILE
from bench.record.signing import SigningKey, bench_key
from drivers.base.clock import utc_now
from drivers.base.errors import BenchError, RecordError
from drivers.base.files import encodable, read_bounded, replace_file
from drivers.kit.config import GyroConfig, InstrumentConfig, PlatformConfig
from drivers.kit.instruments import Identity
from drivers.kit.kinds import (
    ChamberKind,
    Columns,
    Exchange,
    GyroKind,
    MeterKind,
    PlatformKind,
    TableKind,
    Transcript,
)
from drivers.kit.registry import load_kind

_MOST_PICTURE_BYTES = 4 << 20
_PICTURES = {b"\x89PNG\r\n\x1a\n": "png", b"\xff\xd8\xff": "jpg"}
_SOFTWARE = ("gyrobench", "numpy", "scipy", "pyserial", "python-can")


def _versions() -> dict[str, str]:
    """Return the versions of what a run's figures may depend on; scipy comes with an extra and may be absent."""
    found: dict[str, str] = {}
    for name in _SOFTWARE:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


class RunRecord:
    """Writes a run folder: events as they come, raw bytes on the journal's cadence, by the journal's thread."""

    def __init__(
        self, folder: Path, manifest: Manifest, flush_interval_s: float, key: SigningKey | None = None
    ) -> None:
        self.folder = folder
        self._key = key
        self._manifest = manifest
        self._journal = Journal(folder, flush_interval_s)
        self._events = EventLog(folder)
        self._journal.adopt(self._events)

    @classmethod
    def create(
        cls,
        runs_folder: Path,
        run_id: str | None,
        procedure: str,
        parameters: Mapping[str, Any],
        file: BenchFile,
        emulated: Mapping[str, Any] | None,
    ) -> RunRecord:
        """Make the run's folder and write that it is running; RecordError if it cannot be written.

        ConfigurationError if the bench has a key that cannot be used: that is known before anything moves.
        """
        key = bench_key()
        started = utc_now()
        name = run_id or f"{datetime.fromisoformat(started):%Y%m%d-%H%M%S}-{procedure}"
        folder = _new_folder(runs_folder, name)
        manifest = Manifest(
            run_id=folder.name,
            procedure=procedure,
            parameters=dict(parameters),
            started_utc=started,
            bench=file.model_dump(mode="json"),
            bench_file_sha256=file.sha256,
            units=file.units,
            emulated=None if emulated is None else dict(emulated),
            operators=(),
            flush_interval_s=min(file.recording.flush_interval_s, 1.0),
            software={"python": platform.python_version()} | _versions(),
        )
        write_manifest(folder, manifest)
        return cls(folder, manifest, file.recording.flush_interval_s, key)

    def keep_procedure(self, text: str) -> None:
        """Keep the source of a procedure that is not installed, sealed with the rest. Raises RecordError."""
        path = self.folder / PROCEDURE_FILE
        try:
            replace_file(path, text)
        except OSError as error:
            raise record_error(path, error) from error

    def keep_picture(self, path: Path | None, say: Callable[[str], None]) -> str | None:
        """Keep the picture of a question, if it has one; return its name in the run folder, or say why not.

        A question without its picture can still be answered: a run does not end for it.
        """
        if path is None:
            return None
        try:
            content = read_bounded(path, _MOST_PICTURE_BYTES)
            kind = next((kind for mark, kind in _PICTURES.items() if content.startswith(mark)), "")
            if not kind:
                raise ValueError("neither a PNG nor a JPEG")
            name = f"{PICTURES_FOLDER}/{hashlib.sha256(content).hexdigest()[:16]}.{kind}"
            (self.folder / PICTURES_FOLDER).mkdir(exist_ok=True)
            replace_file(self.folder / name, content)
        except (OSError, ValueError) as error:
            say(f"a question without its picture: {path}: {error}")
            return None
        return name

    @property
    def started_utc(self) -> str:
        """When the run began, ISO 8601."""
        return self._manifest.started_utc

    def tap(self, port: str) -> PortJournal:
        """Return the journal of a port, for its link."""
        return self._journal.port(port)

    def event(self, time_s: float, event: Event) -> None:
        """Write one line of events.jsonl."""
        known = self._manifest
        if isinstance(event, Measured):
            self._note(measurements=(*known.measurements, event.fields()))
        if isinstance(event, Repeat):
            self._note(repeats=known.repeats | {event.device: known.repeats.get(event.device, 0) + 1})
        if isinstance(event, Answer) and event.mounting is not None:
            self._note(mounting=event.mounting)
        if (operators := operators_of([event], known.operators or ())) != known.operators:
            self._note(operators=operators)
        self._events.event(time_s, event)

    def emulated(self, metadata: Mapping[str, Any]) -> None:
        """Note what the lab that serves the clock says it emulates."""
        self._note(emulated=EmulatedLab.model_validate(metadata))

    def check(self) -> list[Invalid]:
        """Raise what the journal met; return what it found missing of the raw files."""
        self._journal.check()
        return self._holes()

    def _holes(self) -> list[Invalid]:
        return [
            Invalid(
                "record_hole",
                f"{hole.file} has {hole.whole_bytes} of {hole.written_bytes} bytes as they came: "
                f"what it had from {hole.from_s:.3f} s on is lost",
                {"file": hole.file, "from_s": hole.from_s},
            )
            for hole in self._journal.take_holes()
        ]

    def identify(self, name: str, role: str, kind: str, identity: Identity, gyro: object = None) -> None:
        """Note who answered on a port; `gyro`: its section of the bench file, if it is one."""
        section = gyro if isinstance(gyro, GyroConfig) else None
        entry = DeviceEntry(
            kind=kind,
            role=role,
            axis=section.axis if section else None,
            case_sensor=section.case_sensor if section else None,
            **{name: getattr(identity, name) for name in ("maker", "model", "serial_number", "firmware")},
        )
        self._note(devices=self._manifest.devices | {name: entry})

    def stream_starts(self, name: str, offset: int) -> None:
        """Note that what arrives on gyro port `name` from byte `offset` on is its stream."""
        self._note(stream=self._manifest.stream | {name: {"start_offset": offset}})
        write_manifest(self.folder, self._manifest)  # a run that is never closed can be decoded too

    def close(
        self, outcome: str, reason: str, duration_s: float, cause: BaseException | None = None
    ) -> tuple[Manifest, list[str]]:
        """Close the raw files, decode them, write the outcome and seal the folder; return manifest and warnings.

        `cause` is what `reason` says already; it is not said twice if the journal met it too.
        A run that could not be recorded or decoded whole is sealed as aborted with what there is. RecordError
        only if not even the seal can be written.
        """
        problems: list[str] = []
        with _told(problems):
            self._journal.close()
        for hole in self._holes():
            outcome = "invalid" if outcome == "completed" else outcome
            reason = "; ".join(filter(None, [reason, hole.text]))
            with suppress(BenchError):
                self._events.event(duration_s, hole)
        streams: dict[str, StreamReport] = {}
        with _told(problems, "The record could not be decoded: "):
            write_manifest(self.folder, self._manifest)
            streams = decode_run(self.folder)
        if problems:
            outcome = "aborted"
            reason = " ".join([reason, *(text for text in problems if text != str(cause))]).strip()
        outcome, reason = self._conclude(outcome, reason, duration_s)
        sealed = seal(
            self.folder,
            self._manifest,
            self._key,
            outcome=outcome,
            reason=reason,
            ended_utc=utc_now(),
            duration_s=duration_s,
            written=self._journal.written,
            # Without its start a stream that could not be decoded now could not be decoded ever.
            stream=self._manifest.stream
            | {name: dataclasses.asdict(found) for name, found in streams.items()},
        )
        warnings = [f"{name}: {text}" for name, stream in streams.items() for text in _warnings(stream)]
        warnings += [
            f"{name}: {count} exchange{'s' * (count > 1)} tried again"
            for name, count in sealed.repeats.items()
        ]
        return sealed, warnings

    def _conclude(self, outcome: str, reason: str, duration_s: float) -> tuple[str, str]:
        """Write the last event and close the event log; return what the run ended as and why.

        A run whose end is not in its events is aborted: its seal must say nothing else than they do.
        """
        try:
            self._events.event(duration_s, Outcome(outcome, reason, sealed=True))
            self._events.sync()
        except BenchError as error:
            outcome, reason = "aborted", f"{reason} {error}".strip()
            with suppress(BenchError):  # what it could not write yet goes first
                self._events.event(duration_s, Outcome(outcome, reason, sealed=True))
        with suppress(BenchError):
            self._events.close()
        return outcome, reason

    def _note(self, **facts: Any) -> None:
        self._manifest = self._manifest.model_copy(update=facts)


@contextmanager
def _told(problems: list[str], what: str = "") -> Iterator[None]:
    """Add to `problems` what went wrong inside."""
    try:
        yield
    except (BenchError, OSError) as error:
        problems.append(f"{what}{error}")
    except MemoryError:
        problems.append(f"{what}The computer has no memory left.")


def decode_run(folder: Path, out: Path | None = None) -> dict[str, StreamReport]:
    """Make all tables of a run from its raw bytes, in `out` (default: the run folder); the one way there is."""
    manifest = read_manifest(folder)
    if manifest.imported is not None:
        from bench.record.exchange import decode_imported  # only a run of another bench needs it

        return decode_imported(folder, out or folder)
    file = bench_file_from(manifest.bench)
    table: TableKind[Any] = load_kind("table", file.table.driver)
    chamber: ChamberKind[Any] = load_kind("chamber", file.chamber.driver)
    decode_instrument(
        folder, "table", "turntable", lambda rows: table.decode_transcript(rows, file.table), out
    )
    decode_instrument(folder, "chamber", "chamber", chamber.decode_transcript, out)
    for name, (role, section) in file.all_instruments.items():
        meter: MeterKind[Any] = load_kind(role, section.driver)
        decode_instrument(folder, name, f"{role}_{name}", partial(_of_meter, meter, section), out)
    starts = {name: int(entry.get("start_offset", 0)) for name, entry in manifest.stream.items()}
    units: tuple[GyroConfig | PlatformConfig, ...] = (*file.gyro, *file.platform)
    sources = [_source(unit, starts[unit.name]) for unit in units if unit.name in starts]
    off_s: list[tuple[float, float]] = []
    with suppress(RecordError):  # a damaged log is said when it is verified; without it more counts as lost
        off_s = units_off_s(read_events(folder).lines)
    return {source.name: decode_stream(folder, source, out, off_s) for source in sources}


def _of_meter(kind: MeterKind[Any], section: InstrumentConfig, rows: Iterable[Exchange]) -> Transcript:
    return kind.decode_transcript(rows, section)


def gyro_source(manifest: Manifest, name: str) -> StreamSource:
    """Return how the stream of a recorded run's gyro is decoded."""
    section = bench_file_from(manifest.bench).gyro_named(name)
    return _source(section, int(manifest.stream[name].get("start_offset", 0)))


def _source(section: GyroConfig | PlatformConfig, start_offset: int) -> StreamSource:
    if isinstance(section, PlatformConfig):
        platform: PlatformKind[Any] = load_kind("platform", section.driver)
        return StreamSource(
            "platform",
            section.name,
            lambda: platform.decoder(section),
            lambda columns, _: {name: columns[name] for name in platform.columns if name in columns},
            f"platform INS {section.name}",
            start_offset,
            section.baudrate,
        )
    gyro: GyroKind[Any] = load_kind("gyro", section.driver)
    return StreamSource(
        "gyro",
        section.name,
        lambda: gyro.decoder(section),
        partial(_gyro_values, gyro, section),
        f"gyro {section.name}, axis under test {section.axis}",
        start_offset,
        None if section.on_can else section.baudrate,
        section.pulse_interval_s,
    )


def _gyro_values(
    kind: GyroKind[Any], section: GyroConfig, columns: Columns, sample_rate_hz: float
) -> dict[str, NDArray[np.float32]]:
    """Return rates of all axes, the one under test first, specific forces and temperatures."""
    rates = kind.rates(section, columns, sample_rate_hz)
    named = {"rate_dps": rates[section.axis]}
    named |= {f"rate_{axis}_dps": rate for axis, rate in rates.items() if axis != section.axis}
    if kind.accelerations is not None:
        forces = kind.accelerations(section, columns, sample_rate_hz)
        named |= {f"accelerometer_{axis}_mps2": force for axis, force in forces.items()}
    named |= {name: columns[name] for name in ("temp_c", "since_pulse_s") if name in columns}
    if kind.temperatures is not None:
        named |= kind.temperatures(section, columns, sample_rate_hz)
    return {name: np.asarray(column, dtype=np.float32) for name, column in named.items()}


def _warnings(stream: StreamReport) -> list[str]:
    texts = list(stream.warnings)
    if stream.lost:
        texts.append(f"{stream.lost} frames lost (marked in the table)")
    if any(stream.rejected.values()):
        texts.append("frames rejected: " + ", ".join(f"{n} {why}" for why, n in stream.rejected.items() if n))
    return texts


def _new_folder(root: Path, name: str) -> Path:
    if name == ".." or Path(name).name != name or not name.isprintable():
        raise RecordError(
            "a run's id is the name of its folder",
            found=repr(name),
            expected="a name without / that does not lead out of the runs folder",
        )
    if encodable(str(root)) != str(root):
        raise RecordError(
            "the runs folder has a name that is not UTF-8: no record could say where it is",
            where=encodable(str(root)),
            found=repr(str(root)),
            expected="a name in UTF-8",
            remedy="rename the folder, or name another with --runs",
        )
    for suffix in ("", *(f"-{n}" for n in range(2, 1000))):
        folder = root / f"{name}{suffix}"
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise RecordError(
                "the run folder cannot be made",
                where=str(folder),
                found=error.strerror or str(error),
                expected="a folder that can be written",
                remedy="name another with --runs",
            ) from error
        return folder
    raise RecordError("too many runs of that name", where=str(root / name))
