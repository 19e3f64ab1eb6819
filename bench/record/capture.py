"""What some gyro sent, decoded: bytes by a frame description, a CAN log by a layout; tables and a plot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.record.mdf_frames import read_mdf_frames
from drivers.base.errors import ConfigurationError
from drivers.can_dbc import CanDecoder, CanLayout, identifier_names
from drivers.frames import FrameFamily, reader_of
from drivers.kit.instruments import StreamCounts
from drivers.kit.slcan_codec import SlcanParser

Columns = dict[str, NDArray[Any]]
_BLOCK = 1 << 20
_POINTS = 4000
_PANELS = (
    (("rate", "delta_angle", "cumulative_angle"), "gyro"),
    (("accel", "delta_velocity"), "accelerometer"),
    (("temp", "case_temp"), "temperature"),
)
LOG_SUFFIXES = (".asc", ".blf", ".csv", ".db", ".log", ".trc")
"""Logs that python-can reads; every other file is read as the text of an slcan adapter, as raw/<gyro>.bin is."""
_MDF = ".mf4"
_LOGS = f"a log that python-can reads ({', '.join(LOG_SUFFIXES)}, perhaps .gz), {_MDF}, or slcan text"
_NOMINAL_HZ = 100.0


@dataclass
class Capture:
    """What was in it: a table for each message that came, with `end_offset` (bytes up to its end) first."""

    size: int
    head: bytes
    tables: dict[str, Columns]
    counts: StreamCounts
    pending: int
    counter_notes: list[str] = field(default_factory=list)


def read_capture(family: FrameFamily, path: Path) -> Capture:
    """Decode the file at `path` in blocks; ConfigurationError if it cannot be read."""
    reader = reader_of(family)
    parts: dict[str, list[Columns]] = {}
    size, head = 0, b""
    try:
        for block in _blocks(path):
            head, size = head or block[:24], size + len(block)
            for messages in reader.feed(block):
                columns = {"end_offset": messages.end_offset, **messages.columns()}
                parts.setdefault(messages.form.name, []).append(columns)
    except OSError as error:
        raise _unreadable(path, error, "a file of bytes as the gyro sent them") from error
    tables = {name: _joined(found) for name, found in parts.items()}
    notes = [note for name in tables if (note := _losses(family, name, tables[name]))]
    return Capture(size, head, tables, reader.counts, reader.pending, notes)


def write_table(target: Path, columns: Columns) -> None:
    """Write columns as CSV or Parquet, by the file's name; texts in hexadecimal."""
    import pandas as pd

    table = pd.DataFrame({name: _plain(values) for name, values in columns.items()})
    if target.suffix == ".parquet":
        table.to_parquet(target, index=False)
    else:
        table.to_csv(target, index=False)


def write_plot(target: Path, family: FrameFamily, capture: Capture) -> bool:
    """Draw rates, accelerations and temperatures of the commonest message with rates; False if there is none."""
    names = [form.name for form in family.forms if form.measures and form.name in capture.tables]
    if not names:
        return False
    name = max(names, key=lambda name: len(capture.tables[name]["end_offset"]))
    columns, form = capture.tables[name], family.form(name)
    panels = []
    for roles, title in _PANELS:
        specs = [spec for spec in form.fields if spec.role in roles and spec.name in columns]
        if specs:
            panels.append((f"{title}, {specs[0].unit}", {spec.name: columns[spec.name] for spec in specs}))
    number = np.arange(len(columns["end_offset"]))
    draw_panels(target, f"{family.description.title}: {name}", "message number", number, panels)
    return True


def draw_panels(
    target: Path, title: str, x_label: str, x: NDArray[Any], panels: Sequence[tuple[str, Columns]]
) -> None:
    """Draw curves (n,) over a common `x` (n,): `panels` has what stands on the axis, and the curves by name."""
    from matplotlib.figure import Figure

    step = max(1, len(x) // _POINTS)
    figure = Figure(figsize=(9.0, 2.2 * len(panels) + 0.6), layout="constrained")
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for panel, (y_label, curves) in zip(axes, panels, strict=True):
        for name, values in curves.items():
            panel.plot(x[::step], values[::step], label=name, linewidth=0.8)
        panel.set_ylabel(y_label)
        panel.legend(loc="upper right", fontsize=8, ncol=3)
        panel.grid(alpha=0.3)
    axes[0].set_title(title, loc="left")
    axes[-1].set_xlabel(x_label)
    figure.savefig(target, dpi=110)


def counter_note(counter: NDArray[Any], modulo: float, what: str, ticks_per_s: float | None = None) -> str:
    """Return the usual step of a counter (n,) of `what`, its rate, and how many are lost or repeated."""
    step = np.mod(np.diff(counter), modulo)
    usual = float(np.median(step))
    lost = int(np.maximum(0.0, np.rint(step / usual) - 1.0).sum()) if usual else 0
    per_s = f", {ticks_per_s / usual:.6g} {what} a second" if ticks_per_s and usual else ""
    return f"the counter steps by {usual:g}{per_s}; {lost} {what} lost, {int((step == 0).sum())} repeated"


def _losses(family: FrameFamily, name: str, columns: Columns) -> str:
    """Return what the counter says about lost messages, empty without one."""
    form = family.form(name)
    counter = form.counter
    if counter is None or not form.measures or len(columns["end_offset"]) < 3:
        return ""
    if not isinstance(columns[counter.field][0], np.integer):
        return ""
    spec = next(spec for spec in form.fields if spec.name == counter.field)
    bits = 8 * spec.bytes if spec.bits is None else spec.bits[1]
    raw = np.rint((columns[counter.field] - spec.offset) / spec.scale.factor)
    modulo = float(counter.modulo or 2.0**bits)
    return f"{name}: {counter_note(raw, modulo, 'messages', counter.ticks_per_s)}"


def _joined(parts: list[Columns]) -> Columns:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _plain(values: NDArray[Any]) -> NDArray[Any]:
    if values.dtype.kind == "S":
        return np.array([bytes(value).hex(" ") for value in values], dtype=object)
    return values


def _blocks(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            yield block


def _unreadable(path: Path, found: OSError | str, expected: str) -> ConfigurationError:
    text = found if isinstance(found, str) else found.strerror or str(found)
    return ConfigurationError("the capture cannot be read", where=str(path), found=text, expected=expected)


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
    try:
        if suffix in (*LOG_SUFFIXES, _MDF):
            frames, times_s, left_out = read_mdf_frames(path) if suffix == _MDF else _log(path)
            blocks: Iterable[NDArray[np.void]] = [frames]
        else:
            times_s, left_out, parser = None, {}, SlcanParser()
            blocks = map(parser.feed, _blocks(path))
        parts, seen = [], Counter[tuple[int, bool]]()
        for block in filter(len, blocks):
            seen.update(zip(block["id"].tolist(), block["extended"].tolist(), strict=True))
            batch = decoder.feed_frames(block)
            parts.append({"end_offset": batch.end_offset, **batch.columns})
    except OSError as error:
        raise _unreadable(path, error, _LOGS) from error
    columns = _joined(parts) if parts else {}
    rejected = decoder.counts.rejected | ({} if times_s is not None else parser.counts.rejected)
    if times_s is not None and len(columns):
        ordinal = np.searchsorted(frames["end_offset"], columns.pop("end_offset"))
        columns = {"time_s": times_s[ordinal] - times_s[0], **columns}
    return CanCapture(seen.total(), columns, rejected, seen, left_out, _notes(decoder, columns))


def _log(path: Path) -> tuple[NDArray[np.void], NDArray[np.float64], dict[str, int]]:
    from drivers.kit.python_can import can
    from drivers.slcan import from_messages

    try:
        with can.LogReader(path) as messages:
            return from_messages(messages)
    except OSError:
        raise
    except Exception as error:  # python-can's readers raise whatever they meet
        raise _unreadable(path, f"{type(error).__name__}: {error}", _LOGS) from error


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
    unknown = Counter(
        {
            frame_id: count
            for frame_id, count in capture.identifiers.items()
            if not any(
                frame_id[0] & mask == identifier & mask and frame_id[1] == extended
                for identifier, mask, extended in layout.known
            )
        }
    )
    shown = [f"{identifier_names({frame_id})} ({count})" for frame_id, count in unknown.most_common(most)]
    return ", ".join(shown) + (f" and {len(unknown) - most} more" if len(unknown) > most else "")


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
