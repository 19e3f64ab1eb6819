"""A log of a CAN bus decoded by a layout: one table of samples, a plot, and what else was on the bus."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.record.capture import Columns, counter_note, draw_panels
from drivers.base.errors import ConfigurationError
from drivers.can_dbc import CanDecoder, CanLayout, identifier_names
from drivers.kit.slcan_codec import SlcanParser

LOG_SUFFIXES = (".asc", ".blf", ".csv", ".db", ".log", ".trc")
"""Logs that python-can reads; every other file is read as the text of an slcan adapter, as raw/<gyro>.bin is."""
_NOMINAL_HZ = 100.0
_BLOCK = 1 << 20


@dataclass
class CanCapture:
    """What was in it. `columns` has `time_s` (from the first frame on) for a log, else `end_offset` (bytes)."""

    frames: int
    columns: Columns
    rejected: dict[str, int]
    identifiers: dict[tuple[int, bool], int]
    left_out: dict[str, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def read_can_capture(layout: CanLayout, path: Path, source_address: int | None = None) -> CanCapture:
    """Decode the file at `path`; ConfigurationError if it cannot be read."""
    decoder = CanDecoder(layout, _NOMINAL_HZ, source_address=source_address)
    suffix = next((suffix.lower() for suffix in reversed(path.suffixes) if suffix != ".gz"), "")
    if suffix == ".mf4":
        raise _unreadable(path, "an MF4 log")
    try:
        if suffix in LOG_SUFFIXES:
            frames, times_s, left_out = _log(path)
            blocks: Iterator[NDArray[np.void]] = iter([frames] if len(frames) else [])
        else:
            times_s, left_out, parser = None, {}, SlcanParser()
            blocks = _lines(path, parser)
        parts, seen, count = [], dict[tuple[int, bool], int](), 0
        for block in blocks:
            count += len(block)
            for identifier, extended in zip(block["id"].tolist(), block["extended"].tolist(), strict=True):
                seen[identifier, extended] = seen.get((identifier, extended), 0) + 1
            batch = decoder.feed_frames(block)
            parts.append({"end_offset": batch.end_offset, **batch.columns})
    except OSError as error:
        raise _unreadable(path, error.strerror or str(error)) from error
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]} if parts else {}
    rejected = decoder.counts.rejected | ({} if times_s is not None else parser.counts.rejected)
    if times_s is not None and len(columns):
        ordinal = np.searchsorted(frames["end_offset"], columns.pop("end_offset"))
        columns = {"time_s": times_s[ordinal] - times_s[0], **columns}
    return CanCapture(count, columns, rejected, seen, left_out, _notes(decoder, columns))


def _log(path: Path) -> tuple[NDArray[np.void], NDArray[np.float64], dict[str, int]]:
    from drivers.kit.python_can import can
    from drivers.slcan import from_messages

    try:
        with can.LogReader(path) as messages:
            return from_messages(messages)
    except OSError:
        raise
    except Exception as error:  # python-can's readers raise whatever they meet
        raise _unreadable(path, f"{type(error).__name__}: {error}") from error


def _lines(path: Path, parser: SlcanParser) -> Iterator[NDArray[np.void]]:
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            frames = parser.feed(block)
            if len(frames):
                yield frames


def _unreadable(path: Path, found: str) -> ConfigurationError:
    return ConfigurationError(
        "the capture cannot be read",
        where=str(path),
        found=found,
        expected=f"a log that python-can reads ({', '.join(LOG_SUFFIXES)}, perhaps .gz), or slcan text",
    )


def _notes(decoder: CanDecoder, columns: Columns) -> list[str]:
    """Return what time and counter say about rate and losses."""
    notes: list[str] = []
    if not len(columns) or len(columns["counter"]) < 3:
        return notes
    rows = len(columns["counter"])
    if "time_s" in columns and (span_s := float(np.ptp(columns["time_s"]))) > 0.0:
        notes.append(f"{(rows - 1) / span_s:.6g} samples a second by the log's times")
    if decoder.layout.use("time", "counter") is not None:
        notes.append(counter_note(columns["counter"], decoder.counter_modulo, "samples"))
    return notes


def others_on_the_bus(layout: CanLayout, capture: CanCapture, most: int = 12) -> str:
    """Return identifiers that the DBC file does not have, commonest first, with their counts; empty for none."""
    unknown = {
        frame_id: count
        for frame_id, count in capture.identifiers.items()
        if not any(
            frame_id[0] & mask == identifier & mask and frame_id[1] == extended
            for identifier, mask, extended in layout.known
        )
    }
    ordered = sorted(unknown, key=lambda frame_id: -unknown[frame_id])
    shown = [f"{identifier_names({frame_id})} ({unknown[frame_id]})" for frame_id in ordered[:most]]
    return ", ".join(shown) + (f" and {len(ordered) - most} more" if len(ordered) > most else "")


def write_can_plot(target: Path, layout: CanLayout, columns: Columns) -> None:
    """Draw rates and temperatures over the log's time, or the number of the sample."""
    rates = [name for name in columns if name.startswith(("rate_", "angle_"))]
    temps = [name for name in ("temp_c", "case_temp_c") if np.isfinite(columns.get(name, [np.nan])).any()]
    forces = [name for name in columns if name.startswith("accelerometer_")]
    panels = [("rate, deg/s" if rates[0].startswith("rate_") else "angle increment, deg", rates)]
    panels += [("specific force, m/s2", forces)] if forces else []
    panels += [("temperature, degC", temps)] if temps else []
    draw_panels(
        target,
        f"{layout.maker} {layout.model}".strip() or layout.name,
        "time in the log, s" if "time_s" in columns else "sample number",
        columns.get("time_s", np.arange(len(columns["counter"]))),
        [(y_label, {name: columns[name] for name in names}) for y_label, names in panels],
    )
