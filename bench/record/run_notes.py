"""Notes and pictures that people attach to a run, beside its record: the seal covers neither and stays whole.

They lie in `notes/` of the run folder: `notes.jsonl`, one note a line, only ever appended to, and pictures under
the checksum of their bytes.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from dataclasses import asdict, dataclass
from pathlib import Path

from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError, RecordError
from drivers.base.files import parse_json, read_bounded, replace_file

NOTES_FOLDER = "notes"
NOTES_FILE = "notes.jsonl"
MOST_TEXT, MOST_PICTURE_BYTES = 4000, 8 << 20
_MOST_NAME = 200
_MOST_BYTES = 4 << 20
"""Of a file of notes that is read; a thousand long notes."""
_MAGIC = {b"\x89PNG\r\n\x1a\n": "png", b"\xff\xd8\xff": "jpg"}
_PICTURE = re.compile(r"[0-9a-f]{64}\.(png|jpg)")
MEDIA_TYPES = {"png": "image/png", "jpg": "image/jpeg"}


@dataclass(frozen=True)
class RunNote:
    """What somebody noted of a run; `picture` is the name of a file in `notes/`, its stem the file's SHA-256."""

    utc: str
    by: str
    text: str
    picture: str = ""


def add_note(run: Path, by: str, text: str, picture: bytes = b"") -> RunNote:
    """Attach a note to a run folder, synced to the disk before this returns; `picture`: a PNG or JPEG, or empty.

    Raises ConfigurationError for a note without a name or content, too long, or a picture of another kind;
    RecordError if it cannot be written.
    """
    by, text = by.strip()[:_MOST_NAME], text.strip()
    if not by:
        raise ConfigurationError("a note without a name", expected="the name of whoever writes it")
    if not text and not picture:
        raise ConfigurationError("an empty note", expected="a text, a picture, or both")
    if len(text) > MOST_TEXT:
        raise ConfigurationError(
            "a note that is too long", found=f"{len(text)} characters", expected=f"at most {MOST_TEXT}"
        )
    name = _picture_name(picture) if picture else ""
    folder = run / NOTES_FOLDER
    note = RunNote(utc_now(), by, text, name)
    try:
        folder.mkdir(exist_ok=True)
        if name and not (folder / name).exists():
            replace_file(folder / name, picture)
        _append(folder / NOTES_FILE, json.dumps(asdict(note)).encode())
    except OSError as error:
        raise RecordError(
            "the note could not be kept",
            where=str(folder),
            found=error.strerror or str(error),
            expected="a run folder that can be written, with space on its disk",
            remedy="the run is not affected; write the note again once there is room",
        ) from error
    return note


def read_notes(run: Path) -> list[RunNote]:
    """Return the notes of a run folder, oldest first; a line that is no note is left out."""
    try:
        lines = read_bounded(run / NOTES_FOLDER / NOTES_FILE, _MOST_BYTES).splitlines()
    except (OSError, ValueError):
        return []
    return [note for line in lines if (note := _note(line)) is not None]


def note_picture(run: Path, name: str) -> bytes:
    """Return a picture of a run by its name; RecordError if it is not there or not the one that was attached."""
    path = run / NOTES_FOLDER / name
    try:
        if not _PICTURE.fullmatch(name):
            raise ValueError("not the name of a picture")
        content = read_bounded(path, MOST_PICTURE_BYTES)
        if hashlib.sha256(content).hexdigest() != path.stem:
            raise ValueError("its checksum is not its name: it was changed")
    except (OSError, ValueError) as error:
        raise RecordError("a picture cannot be shown", where=str(path), found=str(error)) from error
    return content


def notes_changed_ns(run: Path) -> int:
    """Return when the notes of a run were changed last, 0 without any."""
    try:
        return (run / NOTES_FOLDER / NOTES_FILE).stat().st_mtime_ns
    except OSError:
        return 0


def _picture_name(content: bytes) -> str:
    kind = next((kind for magic, kind in _MAGIC.items() if content.startswith(magic)), "")
    if not kind or len(content) > MOST_PICTURE_BYTES:
        raise ConfigurationError(
            "this picture cannot be attached",
            found="no PNG or JPEG" if not kind else f"{len(content) / 1e6:.1f} MB",
            expected=f"a PNG or JPEG of at most {MOST_PICTURE_BYTES >> 20} MiB",
        )
    return f"{hashlib.sha256(content).hexdigest()}.{kind}"


def _append(path: Path, line: bytes) -> None:
    """Append a line in one write; one that a crash left without its end stays a line of its own."""
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
    descriptor = os.open(path, flags, 0o644)
    try:
        size = os.fstat(descriptor).st_size
        torn = size > 0 and os.pread(descriptor, 1, size - 1) != b"\n"
        os.write(descriptor, (b"\n" if torn else b"") + line + b"\n")
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _note(line: bytes) -> RunNote | None:
    try:
        row = parse_json(line)
        note = RunNote(*(row.get(name, "") for name in ("utc", "by", "text", "picture")))
    except (ValueError, AttributeError):
        return None
    if not all(isinstance(text, str) for text in vars(note).values()) or not note.by:
        return None
    return note if not note.picture or _PICTURE.fullmatch(note.picture) else None
