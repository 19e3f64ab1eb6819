"""One log looked at: read, told apart, put on a grid, and every axis at its full rate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.look._axis import Figures, figures_of, longest
from bench.analysis.look._channels import (
    ACCELEROMETER,
    GYRO,
    TEMPERATURE,
    TIME,
    Channel,
    Columns,
    assign,
)  # fmt: skip
from bench.analysis.look._clock import Clock, clock_of, held_remarks, without_padding
from bench.analysis.look._noise import AllanLook, allan_of
from bench.analysis.look._rest import Motion, motion_of
from bench.analysis.look._spectrum import Spectrum, spectrum_of
from bench.analysis.look._table import TIME_OF_FILE, Table, read_table
from bench.analysis.look._temperature import FASTEST_K_PER_S, TemperatureLook, dependence, fastest_change
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS
from drivers.base.errors import ConfigurationError

_MOST_VALUES = 64
"""Values of an array that are still facts; longer ones are curves for plots."""
_FEWEST = 64


@dataclass(frozen=True)
class LookOptions:
    """What the log does not say: separator, lines before the first row, table, DBC files, sample rate.

    `columns` are texts KIND=NAME,NAME, `units` texts NAME=UNIT; both take globs. `still`: the unit never turned,
    whatever its gyros say; else rest and turning are found from the data.
    """

    separator: str = ""
    skip: int | None = None
    group: str = ""
    dbc: Sequence[Path] = ()
    rate_hz: float | None = None
    columns: Sequence[str] = ()
    units: Sequence[str] = ()
    still: bool = False


@dataclass(frozen=True, eq=False)
class AxisLook:
    """One gyro or accelerometer. Noise and spectrum are those of the longest unbroken rest (s from row one).

    `figures` are those of all rests, of an accelerometer in a log with turns of the longest one.
    `values`, shape (n,): on the grid, in `channel.base_unit`; the Allan deviation of a gyro is in deg/h.
    """

    channel: Channel
    figures: Figures
    noise_from_s: float
    noise_to_s: float
    allan: AllanLook | None
    spectrum: Spectrum | None
    temperature: TemperatureLook | None
    values: Array


@dataclass(frozen=True, eq=False)
class Look:
    """A log looked at. `remarks`: what was guessed or noticed; `questions`: what cannot be known from the log."""

    log: Path
    clock: Clock
    columns: Columns
    motion: Motion
    axes: tuple[AxisLook, ...]
    temperatures: Mapping[str, Array]
    remarks: tuple[str, ...]
    questions: tuple[str, ...]

    def facts(self) -> dict[str, Any]:
        """Return all that was found as plain values, arrays of up to 64 values as lists, curves left out."""
        return dict(_plain(self))


def look(log: Path, options: LookOptions | None = None) -> Look:
    """Look at a log of gyros and accelerometers; ConfigurationError if it cannot be read or has none."""
    options = options or LookOptions()
    table = read_table(
        log, separator=options.separator, skip=options.skip, group=options.group, dbc=options.dbc
    )
    sound, remarks = without_padding(table.columns)
    columns = assign(sound, table.units, _told(options, sound), options.units)
    if not any(channel.kind in (GYRO, ACCELEROMETER) for channel in columns.channels):
        raise ConfigurationError(
            "the log has no gyro and no accelerometer",
            where=str(log),
            found=", ".join(list(sound)[:20]) or "no columns of numbers",
            expected="names such as gyro_x, acc_z",
            remedy="say --column gyro=NAME,NAME",
        )
    clock, axes, temperatures, motion = _on_grid(table, sound, columns, options)
    questions = [*columns.questions, *_clock_questions(clock, columns, temperatures)]
    held = held_remarks({channel.name: sound[channel.name] for channel in columns.channels})
    heat = next(iter(temperatures.items()), None)
    looks = [_axis(channel, values, motion, clock, heat) for channel, values in axes.items()]
    return Look(
        log, clock, columns, motion, tuple(looks), temperatures,
        (*table.remarks, *remarks, *columns.remarks, *held), tuple(questions),
    )  # fmt: skip


def _told(options: LookOptions, sound: Mapping[str, Array]) -> Sequence[str]:
    return [f"{TIME}={TIME_OF_FILE}", *options.columns] if TIME_OF_FILE in sound else options.columns


def _on_grid(
    table: Table, sound: Mapping[str, Array], columns: Columns, options: LookOptions
) -> tuple[Clock, dict[Channel, Array], dict[str, Array], Motion]:
    """Return the clock, axes and temperatures on its grid, and where the unit rests."""
    rows = len(next(iter(sound.values())))
    time_s = sound[columns.time.name] * columns.time.factor if columns.time else None
    rate_hz, source = options.rate_hz, "you"
    if rate_hz is None and time_s is None:
        rate_hz, source = table.rate_hz, "the header"
    clock, grid = clock_of(time_s, rows, rate_hz, source)
    placed = {}
    for channel in columns.channels:
        factor = channel.factor * (clock.per_s if channel.per_sample else 1.0)
        placed[channel] = grid.put(sound[channel.name] * factor + channel.offset)
    axes = {channel: values for channel, values in placed.items() if channel.kind != TEMPERATURE}
    temperatures = {channel.name: values for channel, values in placed.items() if channel.kind == TEMPERATURE}
    gyros = [channel for channel in axes if channel.kind == GYRO and not options.still]
    motion = motion_of(
        [axes[channel] for channel in gyros],
        [channel.axis or channel.name for channel in gyros],
        [values for channel, values in axes.items() if channel.kind == ACCELEROMETER],
        grid.count,
        clock.per_s,
        all(channel.unit for channel in gyros),
    )
    return clock, axes, temperatures, motion


def _clock_questions(clock: Clock, columns: Columns, temperatures: Mapping[str, Array]) -> list[str]:
    if not clock.known:
        return ["the sample rate is not in the log: say --rate HZ; until then times count samples"]
    questions = []
    for name, values in temperatures.items():
        change = fastest_change(values, clock.per_s)
        if change > FASTEST_K_PER_S:
            questions.append(
                f"{name} would change by {change:.0f} K/s: the log's times are not those of the recording; "
                "say --rate HZ"
            )
    return questions


def _axis(
    channel: Channel, values: Array, motion: Motion, clock: Clock, heat: tuple[str, Array] | None
) -> AxisLook:
    part = longest(np.isfinite(values) & motion.rest)
    if part.stop - part.start < _FEWEST:
        part = longest(np.isfinite(values))
    rest = motion.rest
    if motion.turns and channel.kind == ACCELEROMETER:  # after a turn gravity is another one
        rest = np.zeros(len(values), np.bool_)
        rest[part] = True
    figures, clean = figures_of(values, rest, clock.per_s)
    stretch = clean[part]
    in_dph = channel.base_unit == "deg/s"
    allan = allan_of(
        stretch * (DPH_PER_DPS if in_dph else 1.0), clock.per_s, "deg/h" if in_dph else channel.base_unit
    )
    return AxisLook(
        channel,
        figures,
        part.start / clock.per_s,
        part.stop / clock.per_s,
        allan,
        spectrum_of(stretch, clock.per_s) if len(stretch) >= _FEWEST else None,
        dependence(clean, heat[1], motion.rest, heat[0]) if heat else None,
        values,
    )


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        pairs = ((field.name, getattr(value, field.name)) for field in fields(value))
        return {
            name: _plain(entry)
            for name, entry in pairs
            if name != "temperatures" and not (isinstance(entry, np.ndarray) and entry.size > _MOST_VALUES)
        }
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return str(value) if isinstance(value, Path) else value
