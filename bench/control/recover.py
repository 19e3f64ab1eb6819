"""Completes a run folder that a crash left behind: nothing is lost but what had not reached the disk."""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np

from bench.control.lease import lease_holder
from bench.control.live import read_now
from bench.control.run_record import decode_run
from bench.record.benchfile import bench_file_from
from bench.record.events import Event
from bench.record.events.run import Invalid, Measured, Note, Outcome, Repeat
from bench.record.events.safe import Takeover, TakeoverEnded
from bench.record.recording import (
    Manifest,
    local_run,
    missing_tail,
    operators_of,
    read_events,
    read_manifest,
    read_marks,
    seal,
)
from bench.record.run_folder import MANIFEST_FILE
from bench.record.signing import bench_key
from drivers.base.clock import utc_now
from drivers.base.errors import BenchError, BenchInUse, RecordError

_EVENTS = "events.jsonl"
_PAIR_BYTES = 16


def open_runs(root: Path) -> list[Path]:
    """Return the run folders in `root` that were never closed, and those that cannot be read."""
    return [path.parent for path in sorted(root.glob(f"*/{MANIFEST_FILE}")) if _is_open(path.parent)]


def _is_open(folder: Path) -> bool:
    """Return whether a run was not closed; one that cannot be read is, and `recover` says why it cannot."""
    try:
        return not read_manifest(folder).complete
    except BenchError:
        return True


def recover(folder: Path, by: str = "") -> Manifest:
    """Decode and seal a run that was never closed, as aborted; return its manifest. A closed run stays as it is.

    `by`: who asked for it, for the record.

    BenchInUse while somebody has had its bench since before the run began, for then it may still go on;
    RecordError if the folder cannot be read or written.
    """
    manifest = read_manifest(local_run(folder))
    if manifest.complete:
        return manifest
    holder = lease_holder(bench_file_from(manifest.bench))
    # A run, its watchdog included, keeps its lease from before it begins until it ends: a later one is another's.
    # Clocks are set: what says itself that it goes on does, whenever its lease was taken.
    if holder is not None and (holder.since_utc <= manifest.started_utc or _goes_on(folder, manifest)):
        raise BenchInUse(
            "the run may still be going on",
            where=str(folder),
            found=str(holder),
            expected="a bench that nobody uses",
            remedy="recover the run when its bench is free",
        )
    try:
        return _complete(folder, manifest, by)
    except OSError as error:  # a disk without room or inodes, a folder that is read-only
        raise RecordError(
            "the run cannot be completed",
            where=str(folder),
            found=error.strerror or str(error),
            expected="a run folder that can be written, with space and inodes on its disk",
            remedy="free some, or copy the folder to another disk, and recover it there",
        ) from error


def _goes_on(folder: Path, manifest: Manifest) -> bool:
    """Return whether the process of a run, or of the campaign that it belongs to, lives and is at it."""
    for place in (folder, folder.parent.parent):
        with suppress(BenchError):
            now = read_now(place)
            if now and now["alive"] and (now.get("run") or {}).get("run_id") == manifest.run_id:
                return True
    return False


def _complete(folder: Path, manifest: Manifest, by: str) -> Manifest:
    key = bench_key()
    torn = _cut_events(folder)
    for index in sorted((folder / "raw").glob("*.idx")):
        _cut(index, index.stat().st_size // _PAIR_BYTES * _PAIR_BYTES)
    holes = [hole for path in sorted((folder / "raw").glob("*.bin")) if (hole := _cut_marks(path))]
    events = read_events(folder)
    duration_s = _last_s(folder, [line.time_s for line in events.lines])
    reason = f"Recovered: the controller ended without closing the run. {_watchdog(folder)}".strip()
    added: list[Event] = [Note(f"recovered {utc_now()}{f' by {by}' if by else ''}"), *holes]
    if torn:
        added.append(Note(f"an event was cut off: {torn}"))
    added.append(Outcome("aborted", reason, sealed=True))
    with (folder / _EVENTS).open("a", encoding="utf-8") as file:
        for event in added:
            file.write(json.dumps(event.row(duration_s), ensure_ascii=False) + "\n")
    streams = decode_run(folder)
    return seal(
        folder,
        manifest,
        key,
        outcome="aborted",
        reason=reason,
        ended_utc=utc_now(),
        duration_s=duration_s,
        measurements=tuple(measured.fields() for _, measured in events.of(Measured)),
        operators=operators_of(line.event for line in events.lines),
        repeats=dict(Counter(repeat.device for _, repeat in events.of(Repeat))),
        stream={name: dataclasses.asdict(stream) for name, stream in streams.items()},
    )


def _cut_events(folder: Path) -> str:
    """Cut an incomplete last line off the event log and return it."""
    path = folder / _EVENTS
    if torn := read_events(folder).torn:
        _cut(path, path.read_bytes().rfind(b"\n") + 1)
    return torn


def _cut_marks(path: Path) -> Invalid | None:
    """Cut the marks of bytes that never reached the disk, and return what they said; None if there are none."""
    missing = missing_tail(path)
    if missing is None:
        return None
    _cut(path.with_suffix(".idx"), len(read_marks(path)) * _PAIR_BYTES)
    text = f"{path.name} lacks {missing[0]} bytes that came: nothing is known from {missing[1]:.3f} s on"
    return Invalid("record_hole", text, {"file": path.name, "from_s": missing[1]})


def _cut(path: Path, size: int) -> None:
    with path.open("r+b") as file:
        file.truncate(size)


def _last_s(folder: Path, event_times_s: list[float]) -> float:
    """Return the last bench time that anything in the record has."""
    last = [0.0, *event_times_s]
    for index in (folder / "raw").glob("*.idx"):
        pairs = index.stat().st_size // _PAIR_BYTES
        if pairs:
            last.append(float(np.fromfile(index, "<i8", 2, offset=(pairs - 1) * _PAIR_BYTES)[1]) / 1e9)
    return max(last)


def _watchdog(folder: Path) -> str:
    """Return in a sentence what a watchdog did."""
    events = read_events(folder / "watchdog")
    begun = [takeover for _, takeover in events.of(Takeover)]
    if not begun:
        return "No watchdog took over."
    ended = [str(end) for _, end in events.of(TakeoverEnded)]
    return f"The watchdog took over ({begun[0]}): {ended[-1] if ended else 'it did not finish'}."
