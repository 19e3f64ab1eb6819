"""One log looked at: read, told apart, put on a grid, and every axis at its full rate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.common.spectrum import Spectrum, spectrum_of
from bench.analysis.look._axis import Figures, figures_of, longest
from bench.analysis.look._channels import (
    ACCELEROMETER,
    GYRO,
    TEMPERATURE,
    TIME,
    Channel,
    Columns,
    assign,
    is_gyro,
)
from bench.analysis.look._clock import Clock, clock_of, held_remarks, without_padding
from bench.analysis.look._noise import AllanLook, allan_of
from bench.analysis.look._rest import Motion, motion_of
from bench.analysis.look._temperature import FASTEST_K_PER_S, TemperatureLook, dependence, fastest_change
from bench.record.exchange import read_table
from bench.record.shown import Shown
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS, STANDARD_GRAVITY_MPS2
from drivers.base.errors import ConfigurationError

_MOST_VALUES = 64
"""Values of an array that are still facts; longer ones are curves for plots."""
_FEWEST = 64
_GRAVITY_OFF = 0.15


@dataclass(frozen=True)
class LookOptions:
    """What the log does not say: separator, lines before the first row, table, DBC files, frames, sample rate.

    `columns` are texts KIND=NAME,NAME, `units` texts NAME=UNIT; both take globs. `still`: the unit never
    turned, whatever its gyros say; else rest and turning are found from the data.
    """

    separator: str = ""
    skip: int | None = None
    group: str = ""
    dbc: Sequence[Path] = ()
    frames: str = ""
    rate_hz: float | None = None
    columns: Sequence[str] = ()
    units: Sequence[str] = ()
    still: bool = False


@dataclass(frozen=True, eq=False)
class AxisLook:
    """One gyro or accelerometer. Noise and spectrum are those of the longest unbroken rest (s from row one).

    `figures` are those of all rests, of an accelerometer in a log with turns of the longest one.
    `values`, shape (n,): on the grid, in `channel.base_unit`; the Allan deviation of a gyro is in deg/h. Without
    `clock_known` every s is a sample, and the deviation is in the gyro's own unit.
    """

    channel: Channel
    figures: Figures
    noise_from_s: float
    noise_to_s: float
    allan: AllanLook | None
    spectrum: Spectrum | None
    temperature: TemperatureLook | None
    values: Array
    clock_known: bool = True


@dataclass(frozen=True, eq=False, repr=False)
class Look(Shown):
    """A log looked at. `remarks`: what was guessed or noticed; `questions`: what cannot be known from the log."""

    log: Path
    clock: Clock
    columns: Columns
    motion: Motion
    axes: tuple[AxisLook, ...]
    temperatures: Mapping[str, Array]
    remarks: tuple[str, ...]
    questions: tuple[str, ...]

    def shown(self) -> dict[str, object]:
        """Return the log, its axes with mean and noise, and how much is open."""
        return {
            "log": self.log.name,
            **{
                f"{axis.channel.name}, {axis.channel.base_unit}": (
                    f"{axis.figures.mean:.5g}, 1 sigma {axis.figures.sigma:.3g}"
                )
                for axis in self.axes
            },
            "remarks": len(self.remarks),
            "not known": list(self.questions),
        }

    def facts(self) -> dict[str, Any]:
        """Return all that was found as plain values, arrays of up to 64 values as lists, curves left out."""
        return dict(_plain(self))


def look(log: Path, options: LookOptions | None = None) -> Look:
    """Look at a log of gyros and accelerometers; ConfigurationError if it cannot be read or has none."""
    options = options or LookOptions()
    table = read_table(
        log,
        separator=options.separator,
        skip=options.skip,
        group=options.group,
        dbc=options.dbc,
        frames=options.frames,
        rate_hz=options.rate_hz,
        sought=is_gyro,
    )
    sound, remarks = without_padding(table.columns)
    told = [f"{TIME}={table.time}", *options.columns] if table.time in sound else options.columns
    units = table.units | ({table.time: "s"} if table.time else {})
    columns = assign(sound, units, told, options.units, options.rate_hz or table.rate_hz, log.stem)
    if not any(channel.kind in (GYRO, ACCELEROMETER) for channel in columns.channels):
        raise ConfigurationError(
            "the log has no gyro and no accelerometer",
            where=str(log),
            found=", ".join(list(sound)[:20]) or "no columns of numbers",
            expected="names such as gyro_x, acc_z",
            remedy="say --column gyro=NAME,NAME",
        )
    time = columns.time
    time_s = sound[time.name] * time.scale.factor if time else None
    rate_hz, source = options.rate_hz, "you"
    if rate_hz is None and (time is None or not time.unit):
        rate_hz, source = table.rate_hz, "the header"
    rows = len(next(iter(sound.values())))
    clock, grid = clock_of(time_s, rows, rate_hz, source, in_s=time is not None and bool(time.unit))
    recorded, placed = {}, {}
    for channel in columns.channels:
        scale, values = channel.scale, sound[channel.name]
        factor = scale.factor * (clock.per_s if scale.per_sample or scale.counted else 1.0)
        if scale.counted:
            # the rate is what it counted since the row before, where that is there
            recorded[channel] = np.diff(values) * factor
            placed[channel] = np.diff(grid.put(values), prepend=np.nan) * factor
            continue
        recorded[channel] = values * factor + scale.offset
        placed[channel] = grid.put(recorded[channel])
    temperatures = {channel.name: values for channel, values in placed.items() if channel.kind == TEMPERATURE}
    axes = {channel: values for channel, values in placed.items() if channel.kind != TEMPERATURE}
    gyros = [
        channel for channel in axes if channel.kind == GYRO and not options.still and not columns.guessed
    ]
    motion = motion_of(
        [axes[channel] for channel in gyros],
        [channel.axis or channel.name for channel in gyros],
        [values for channel, values in axes.items() if channel.kind == ACCELEROMETER],
        grid.count,
        clock.per_s,
        all(channel.unit for channel in gyros),
    )
    if motion.judged and not motion.rest.any():
        remarks.append(
            "nothing in it rests: means, drifts and noise are those of the whole record in its motion"
        )
        motion = replace(motion, rest=np.ones(grid.count, np.bool_))
    heat = next(iter(temperatures.items()), None)
    looks = tuple(
        _axis(channel, values, recorded[channel], motion, clock, heat) for channel, values in axes.items()
    )
    questions = (*columns.questions, *_clock_questions(clock, columns.questions, temperatures))
    held = held_remarks({channel.name: sound[channel.name] for channel in columns.channels})
    remarks = [*table.remarks, *remarks, *columns.remarks, *_gravity_remarks(looks), *held]
    return Look(log, clock, columns, motion, looks, temperatures, tuple(remarks), questions)


def _clock_questions(clock: Clock, asked: list[str], temperatures: Mapping[str, Array]) -> list[str]:
    if not clock.known:
        if any("the unit of" in question and "Hz" in question for question in asked):
            return []
        return ["the sample rate is not in the log: say --rate HZ; until then times count samples"]
    changes = {name: fastest_change(values, clock.per_s) for name, values in temperatures.items()}
    return [
        f"{name} would change by {change:.0f} K/s: the log's times are not those of the recording; say --rate HZ"
        for name, change in changes.items()
        if change > FASTEST_K_PER_S
    ]


def _gravity_remarks(looks: Sequence[AxisLook]) -> list[str]:
    """Say if three accelerometers of a known unit do not feel gravity at rest: no such thing rests on Earth."""
    heavy = [axis for axis in looks if axis.channel.kind == ACCELEROMETER and axis.channel.unit]
    if len(heavy) != 3:
        return []
    norm = float(np.sqrt(sum(axis.figures.mean**2 for axis in heavy)))
    if abs(norm / STANDARD_GRAVITY_MPS2 - 1.0) < _GRAVITY_OFF:
        return []
    return [
        f"the accelerometers' mean is {norm:.3g} m/s^2 in all, not gravity's {STANDARD_GRAVITY_MPS2:.2f}: "
        "gravity is taken off, or they move, or their unit is another"
    ]


def _axis(
    channel: Channel,
    values: Array,
    recorded: Array,
    motion: Motion,
    clock: Clock,
    heat: tuple[str, Array] | None,
) -> AxisLook:
    part = longest(np.isfinite(values) & motion.rest)
    rest = motion.rest
    moved = motion.turns or not motion.by_gyros
    if moved and channel.kind == ACCELEROMETER:  # after a turn gravity is another one
        rest = np.zeros(len(values), np.bool_)
        rest[part] = True
    figures, clean = figures_of(values, rest, clock.per_s, recorded[np.isfinite(recorded)])
    stretch, per_s = clean[part], clock.per_s
    in_dph = channel.base_unit == "deg/s" and clock.known
    factor, unit = (DPH_PER_DPS, "deg/h") if in_dph else (1.0, channel.base_unit)
    return AxisLook(
        channel,
        figures=figures,
        noise_from_s=part.start / per_s,
        noise_to_s=part.stop / per_s,
        allan=allan_of(stretch * factor, per_s, unit) if len(stretch) >= _FEWEST else None,
        spectrum=spectrum_of(stretch, per_s) if len(stretch) >= _FEWEST else None,
        temperature=dependence(clean, heat[1], motion.rest, heat[0]) if heat else None,
        values=values,
        clock_known=clock.known,
    )


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        pairs = {
            part.name: getattr(value, part.name) for part in fields(value) if part.name != "temperatures"
        }
        return {
            name: _plain(entry)
            for name, entry in pairs.items()
            if not (isinstance(entry, np.ndarray) and entry.size > _MOST_VALUES)
        }
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return (
        value.tolist() if isinstance(value, np.ndarray) else str(value) if isinstance(value, Path) else value
    )
