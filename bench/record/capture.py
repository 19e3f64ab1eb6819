"""A file of bytes that some gyro sent, decoded by its description: tables of every message, and a plot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import ConfigurationError
from drivers.frames import FrameFamily, reader_of
from drivers.kit.instruments import StreamCounts

Columns = dict[str, NDArray[Any]]
_BLOCK = 1 << 20
_POINTS = 4000
_PANELS = (
    (("rate", "delta_angle", "cumulative_angle"), "gyro"),
    (("accel", "delta_velocity"), "accelerometer"),
    (("temp", "case_temp"), "temperature"),
)


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
        with path.open("rb") as file:
            while block := file.read(_BLOCK):
                head, size = head or block[:24], size + len(block)
                for messages in reader.feed(block):
                    columns = {"end_offset": messages.end_offset, **messages.columns()}
                    parts.setdefault(messages.form.name, []).append(columns)
    except OSError as error:
        raise ConfigurationError(
            "the capture cannot be read",
            where=str(path),
            found=error.strerror or str(error),
            expected="a file of bytes as the gyro sent them",
        ) from error
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
