"""Bytes of a gyro as it sent them, read by a frame description (docs/frames.md): the columns of one message."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from drivers.frames import (
    GYRO_ROLES,
    Form,
    FrameDecoder,
    FrameFamily,
    celsius,
    load_family,
    reader_of,
    shipped,
)
from drivers.frames import to_bench_unit as factor_of

FRAME_TIME = "frame_time"
"""Name of the times, in s: by the unit's own clock, or its counter at the sample rate. Lost frames leave gaps."""
_BLOCK = 1 << 20
_TRIED = 1 << 16
_ENOUGH = 3
"""Sound frames that make a description fit."""
_LONGEST = 100_000
"""Frames that may be lost at once."""
_UNITS = {
    "rate": "deg/s",
    "delta_angle": "deg/sample",
    "cumulative_angle": "deg/sample",
    "accel": "m/s^2",
    "delta_velocity": "m/s/sample",
}


def fitting_description(file: Path) -> str:
    """Return the shipped description whose frames take most of the head of a file, "" if none takes half."""
    with file.open("rb") as source:
        data = source.read(_TRIED)
    taken: dict[str, int] = {}
    for name in shipped():
        reader = reader_of(load_family(name))
        reader.feed(data)
        if reader.counts.frames >= _ENOUGH:
            taken[name] = len(data) - reader.counts.bytes_skipped
    best = max(taken, key=lambda name: taken[name], default="")
    return best if best and 2 * taken[best] > len(data) else ""


@dataclass(frozen=True)
class Described:
    """Columns (n,) of a message with their units, FRAME_TIME first."""

    columns: dict[str, Array]
    units: dict[str, str]
    remarks: list[str]


def read_described(
    file: Path, description: str, message: str = "", rate_hz: float | None = None
) -> Described:
    """Read the bytes in a file by a shipped description's name or a description file.

    `message` names one of several; default the commonest with rates. `rate_hz`: default the usual one of the
    description. Rates of a frame that says that they do not count are NaN. ConfigurationError for a description
    that cannot be used and a file without such frames.
    """
    family = load_family(description)
    message = message or _commonest(file, family)
    form = family.form(message)
    axes = "".join(dict.fromkeys(str(spec.axis) for spec in form.fields if spec.role in GYRO_ROLES))
    if not axes:
        raise ConfigurationError(
            f"the message {message!r} has no gyro",
            where=family.where,
            found=message,
            expected="one of " + ", ".join(each.name for each in family.forms if each.measures),
        )
    usual_hz = family.description.link.nominal_rate_hz
    decoder = FrameDecoder(family, rate_hz=rate_hz or usual_hz, axes=axes, message=message)
    batches = [batch for block in _blocks(file) if len(batch := decoder.feed(block))]
    if not batches:
        raise _without(file, family)
    raw = {name: np.concatenate([batch.columns[name] for batch in batches]) for name in batches[0].columns}
    samples = np.mod(np.diff(raw["counter"], prepend=raw["counter"][0]), decoder.counter_modulo)
    samples = samples / decoder.counter_step
    anew = samples > np.maximum(
        _LONGEST, len(samples)
    )  # more than the record: the unit was switched on again
    samples[anew] = 1.0
    columns, units = _in_bench_units(form, raw)
    refused = ", ".join(f"{n} {reason}" for reason, n in decoder.counts.rejected.items()) or "none"
    remarks = [
        f"{len(samples)} frames {message} of {family.description.title}; refused: {refused}; bytes in no frame: "
        f"{decoder.counts.bytes_skipped}"
    ]
    if rate_hz is None and (form.counter is None or form.counter.ticks_per_s is None):
        remarks.append(
            f"{usual_hz:g} Hz is what the description calls usual: say --rate HZ if it was another"
        )
    if bad := int(np.count_nonzero(raw["valid"] == 0)):
        remarks.append(f"{bad} frames say that their rates do not count")
    if anew.any():
        remarks.append(
            f"the counter begins anew {np.count_nonzero(anew)} times: how long the unit was off is not known"
        )
    time_s = np.cumsum(samples) / decoder.nominal_rate_hz
    return Described({FRAME_TIME: time_s, **columns}, {FRAME_TIME: "s", **units}, remarks)


def _in_bench_units(form: Form, raw: Mapping[str, Array]) -> tuple[dict[str, Array], dict[str, str]]:
    """Return gyros, accelerometers and temperatures in the units of `_UNITS` and degC, with those units."""
    columns: dict[str, Array] = {}
    units: dict[str, str] = {}
    for spec in form.fields:
        if spec.name in raw and spec.role in _UNITS:
            columns[spec.name] = np.multiply(raw[spec.name], factor_of(spec.unit), dtype=np.float64)
            units[spec.name] = _UNITS[spec.role]
            if spec.role in GYRO_ROLES:
                columns[spec.name][np.logical_not(raw["valid"])] = np.nan
        elif spec.name in raw and spec.role in ("temp", "case_temp"):
            columns[spec.name], units[spec.name] = celsius(spec, raw).astype(np.float64), "degC"
    return columns, units


def _commonest(file: Path, family: FrameFamily) -> str:
    """Return the name of the message with rates that comes most often in the first block."""
    reader = reader_of(family)
    reader.feed(next(_blocks(file), b""))
    came = {form.name: reader.by_form.get(form.name, 0) for form in family.forms if form.measures}
    name = max(came, key=lambda name: came[name])
    if not came[name]:
        raise _without(file, family)
    return name


def _without(file: Path, family: FrameFamily) -> ConfigurationError:
    fits = fitting_description(file)
    return ConfigurationError(
        "the file has no such frames",
        where=str(file),
        found=next(_blocks(file), b"")[:24].hex(" ") or "nothing",
        expected=f"frames of {family.description.title} with rates and a right check",
        remedy=f"--frames {fits} fits it"
        if fits
        else "check that the file is of this unit, at its baud rate",
    )


def _blocks(file: Path) -> Iterator[bytes]:
    with file.open("rb") as source:
        while block := source.read(_BLOCK):
            yield block
