"""What people noted of a run, with their pictures."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from bench.present.report._numbers import DASH, moment
from bench.present.report._page import Block, Cell, Figures, Notes, Row, Table
from bench.record.run_notes import MEDIA_TYPES, RunNote, note_picture, read_notes
from drivers.base.errors import RecordError

Attached = tuple[RunNote, bytes]
"""A note and its picture, empty without one; a picture that cannot be shown is told in the note's text."""


def attached_notes(place: Path | str) -> list[Attached]:
    """Return the notes of a run folder; of a run on object storage there are none."""
    if isinstance(place, str):
        return []
    found: list[Attached] = []
    for note in read_notes(place):
        picture = b""
        if note.picture:
            try:
                picture = note_picture(place, note.picture)
            except RecordError as error:
                note = RunNote(note.utc, note.by, f"{note.text} ({error})".strip())
        found.append((note, picture))
    return found


def notes_blocks(notes: Sequence[Attached]) -> list[Block]:
    """Return the notes as a table, pictures under it; nothing without notes."""
    if not notes:
        return []
    rows = [Row([Cell(moment(note.utc)), Cell(note.by), Cell(note.text or DASH)]) for note, _ in notes]
    pictures: list[Block] = [
        Figures([_image(note, picture)], f"{note.text or 'Picture'} ({note.by}, {moment(note.utc)})")
        for note, picture in notes
        if picture
    ]
    remark = Notes(["Notes stand beside the run: the checksums of its record do not cover them."])
    return [Table(("When", "Who", "Note"), rows, "What people noted."), *pictures, remark]


def _image(note: RunNote, picture: bytes) -> Markup:
    kind = MEDIA_TYPES[note.picture.rpartition(".")[2]]
    data = base64.b64encode(picture).decode()
    return Markup('<img class="attached" alt="{}" src="data:{};base64,{}">').format(
        note.text or f"picture by {note.by}", kind, data
    )
