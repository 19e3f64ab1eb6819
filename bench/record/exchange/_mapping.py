"""Mapping files (TOML): which column of a foreign log is what, in what unit; the phases of each recording."""

from __future__ import annotations

import re
from fnmatch import fnmatch
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from drivers.base.arrays import Array
from drivers.base.constants import ZERO_CELSIUS_K
from drivers.base.errors import ConfigurationError
from drivers.base.files import read_settings

Axis = Literal["x", "y", "z"]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Column(_Part):
    """A column by its name in the log, and its unit.

    `missing`: numbers and words that stand for a missing value. `wraps`: where a counter begins anew, in the
    log's numbers. `recorder`: which one wrote it, where it is in a log of its own.
    """

    name: str
    unit: str = ""
    missing: float | str | tuple[float | str, ...] = ()
    wraps: float | None = Field(default=None, gt=0.0, le=1e20)
    recorder: str = ""

    @property
    def missing_words(self) -> tuple[str, ...]:
        """The words that stand for a missing value."""
        return tuple(each for each in self._missing if isinstance(each, str))

    @property
    def missing_numbers(self) -> tuple[float, ...]:
        """The numbers that stand for a missing value."""
        return tuple(each for each in self._missing if not isinstance(each, str))

    @property
    def _missing(self) -> tuple[float | str, ...]:
        return self.missing if isinstance(self.missing, tuple) else (self.missing,)


class Columns(_Part):
    """What the columns are. `output`: the rate under the axis of test, not used where `valid` is zero.

    `gyros` and `accelerometers`: those of an IMU by axis; the gyro of the axis of test is then the output. A
    log of a chamber or a table alone has neither. `t_in`: the gyro's own temperature, `t_out` that of its case,
    `air` and `set_point` the chamber's; `angle` and `table_rate` the table's, `rate_demand` and `angle_demand`
    what it was told, `elevation` that of the input axis, `foretold` what somebody's own simulation has for the
    output. `heater` is heat put into the case, `door` how far a door, lid or flap is open. These four are read by
    the gap diagnosis from the log and are in no table of a run. MDF files have times of their own: `time` is left
    out for them.
    """

    time: Column | None = None
    output: Column | None = None
    gyros: dict[Axis, Column] = Field(default_factory=dict)
    accelerometers: dict[Axis, Column] = Field(default_factory=dict)
    t_in: Column | None = None
    t_out: Column | None = None
    angle: Column | None = None
    elevation: Column | None = None
    table_rate: Column | None = None
    air: Column | None = None
    set_point: Column | None = None
    rate_demand: Column | None = None
    angle_demand: Column | None = None
    heater: Column | None = None
    door: Column | None = None
    valid: Column | None = None
    foretold: Column | None = None


class PhaseEntry(_Part):
    """A phase, from `start_s` after the first row to the next one; where no column has the table's angle, it
    turns at `rate_dps` in it, from `angle_deg` or where the last phase left it."""

    name: str = Field(min_length=1)
    start_s: float = Field(ge=-3.2e7, le=3.2e7)
    rate_dps: float = Field(default=0.0, ge=-1e5, le=1e5)
    angle_deg: float | None = None


class LogEntry(_Part):
    """One recording: `file` from the mapping's folder (or a pattern such as "*.csv"), and what is not in it.

    `angle_deg`: of the table, where no column says it. `elevation_deg` of the input axis: 0 level, 90 up.
    `air_temp_c`: of the air about the unit, where no column says it. `power_on_s`: how long the unit had been on
    at the first row, where it is known. `profile` is the same for recordings through the same temperatures,
    `condition` what differs between them. `starts_s`: of its recorders, see `Recorder`.
    """

    file: str = "*"
    run_id: str = ""
    profile: str = ""
    condition: str = "0"
    elevation_deg: float = 0.0
    angle_deg: float | None = None
    air_temp_c: float | None = Field(default=None, ge=-ZERO_CELSIUS_K, le=1e4)
    azimuth_error_deg: float = Field(default=0.0, ge=-360.0, le=360.0)
    power_on_s: float | None = Field(default=None, ge=0.0, le=1e10)
    started_utc: str = ""
    starts_s: dict[str, float] = Field(default_factory=dict)
    phases: tuple[PhaseEntry, ...] = ()

    def table_angle_deg(self, time_s: Array) -> Array | None:
        """Return the table's angle, turns counted, at times (n,) from the first row; None if nothing says it."""
        if self.angle_deg is None and all(
            part.angle_deg is None and not part.rate_dps for part in self.phases
        ):
            return None
        at = self.angle_deg or 0.0
        angle, since_s, rate_dps = np.full(len(time_s), at), 0.0, 0.0
        for part in sorted(self.phases, key=lambda part: part.start_s):
            at += rate_dps * (part.start_s - since_s)
            at, since_s, rate_dps = (
                at if part.angle_deg is None else part.angle_deg,
                part.start_s,
                part.rate_dps,
            )
            later = time_s >= since_s
            angle[later] = at + rate_dps * (time_s[later] - since_s)
        return angle


class Recorder(_Part):
    """What another recorder wrote while a log was: the chamber's, the table's.

    `file`: from the log's folder; "*" in it stands for what it stands for in the `file` of [[run]]. `time`: its
    column of times, or `rate_hz` of its rows. Date-times are compared as they are. Of other clocks somebody has
    to say what they have in common: `shift_s` is added to its times, 0 where both have one zero; `starts_s`, here
    or in [[run]] by the recorder's name, is how long after the log's first row its first one was written.
    `separator`: see `Mapping`.
    """

    file: str = Field(min_length=1)
    separator: str = Field(default="", max_length=9)
    time: Column | None = None
    rate_hz: float | None = Field(default=None, gt=0.0, le=1e6)
    starts_s: float | None = Field(default=None, ge=-3.2e7, le=3.2e7)
    shift_s: float | None = Field(default=None, ge=-1e10, le=1e10)


class Mapping(_Part):
    """A mapping file. `rate_hz`: of the rows, where no column has the time.

    `separator`: of a text, where it is not seen by itself: comma, semicolon, tab, blank, bar, or the character.
    """

    format: Literal[1]
    unit_id: str = Field(min_length=1)
    latitude_deg: float = Field(ge=-90, le=90)
    columns: Columns
    run: tuple[LogEntry, ...] = (LogEntry(),)
    recorder: dict[str, Recorder] = Field(default_factory=dict)
    separator: str = Field(default="", max_length=9)
    gyro: str = Field(default="gyro", pattern=r"^[a-z][a-z0-9_]{0,31}$")
    axis: Axis = "x"
    rate_hz: float | None = Field(default=None, gt=0.0, le=1e6)
    maker: str = ""
    model: str = ""
    bench: str = "another bench"
    procedure: str = ""

    @model_validator(mode="after")
    def _each_recorder_is_known(self) -> Mapping:
        columns = self.named()
        told = {column.recorder for column in columns.values()} - {""}
        if unknown := sorted(told - set(self.recorder)):
            raise ValueError(f"a column is of recorder {unknown[0]}, and there is no [recorder.{unknown[0]}]")
        if unused := sorted(set(self.recorder) - told):
            raise ValueError(f"no column is of [recorder.{unused[0]}]")
        if strange := {name for entry in self.run for name in entry.starts_s} - set(self.recorder):
            raise ValueError(f"starts_s of {sorted(strange)[0]}: no such recorder")
        if wrong := [name for name in ("time", "output") if name in columns and columns[name].recorder]:
            raise ValueError(f"{wrong[0]} is one of the log itself, of no other recorder")
        output, under_test = self.columns.output, self.columns.gyros.get(self.axis)
        if output is not None and under_test is not None and output != under_test:
            raise ValueError(
                f"output is {output.name}, and the gyro of the axis of test, {self.axis}, is {under_test.name}: "
                "leave output out, or say the axis under test (axis)"
            )
        return self

    def named(self) -> dict[str, Column]:
        """Return the columns by what they are: `output`, `rate_y`, `accelerometer_x`, `t_in`, ..."""
        columns = self.columns
        found = {name: column for name, column in columns if isinstance(column, Column)}
        if "output" not in found and self.axis in columns.gyros:
            found["output"] = columns.gyros[self.axis]
        found |= {f"rate_{axis}": column for axis, column in columns.gyros.items() if axis != self.axis}
        return found | {f"accelerometer_{axis}": column for axis, column in columns.accelerometers.items()}

    def logs(self, where: Path) -> list[tuple[LogEntry, Path]]:
        """Return every recording of the mapping file `where` with its entry, patterns resolved, each once.

        ConfigurationError for a pattern that fits no file.
        """
        found: dict[Path, LogEntry] = {}
        for entry in self.run:
            files = [where.parent / entry.file]
            if not files[0].is_file() and any(letter in entry.file for letter in "*?["):
                files = sorted(where.parent.glob(entry.file))
                files = [file for file in files if file.is_file() and file.suffix != where.suffix]
                if not files:
                    raise ConfigurationError(
                        "no log fits the pattern",
                        where=str(where),
                        found=entry.file,
                        expected="files beside it",
                    )
            found |= {file: entry for file in files if file not in found}
        beside = {self.recorder_file(name, file) for name in self.recorder for file in found}
        return [(entry, file) for file, entry in found.items() if file not in beside]

    def recorder_file(self, name: str, log: Path) -> Path:
        """Return where a recorder's file is: from the log's folder, or beside the log if only that is there."""
        pattern = self.recorder[name].file
        before, star, behind = "", "", ""
        if entry := self.entry_of(log):
            before, star, behind = Path(entry.file).name.partition("*")
        fits = star and log.name.startswith(before) and log.name.endswith(behind)
        stem = log.name[len(before) : len(log.name) - len(behind)] if fits else log.stem
        # of "shock*_gyro.csv" the star is 1, and what a reader has in mind is shock1, as of "shock1_gyro.csv"
        words = (stem, before + stem, log.stem, re.sub(r"[ _.-][^ _.-]*$", "", log.stem))
        files = [log.parent / pattern.replace("*", word) for word in words]
        files += [log.parent / file.name for file in files]
        return next((file for file in files if file.is_file()), files[len(words) - 1])

    def entry_of(self, log: Path) -> LogEntry | None:
        """Return the first entry that a log's name fits, if there is one."""
        for entry in self.run:
            if log.name == Path(entry.file).name or fnmatch(log.name, Path(entry.file).name):
                return entry
        return None

    def entry_for(self, log: Path, where: Path) -> LogEntry:
        """Return the entry of a log, by its name; ConfigurationError when none fits."""
        if entry := self.entry_of(log):
            return entry
        raise ConfigurationError(
            "the mapping file has no entry for this log",
            where=str(where),
            found=log.name,
            expected=", ".join(entry.file for entry in self.run) or 'a [[run]] with file = "*"',
        )


def read_mapping(path: Path) -> Mapping:
    """Read a mapping file; ConfigurationError says what it lacks or what cannot be used."""
    data, _ = read_settings(path, "the mapping file", expected="TOML in UTF-8")
    try:
        return Mapping.model_validate(data)
    except ValidationError as error:
        rows = [
            (
                ".".join(map(str, row["loc"])) or "mapping",
                row["type"],
                row["msg"].removeprefix("Value error, "),
            )
            for row in error.errors()
        ]
        missing = [key for key, kind, _ in rows if kind == "missing"]
        wrong = [f"{key}: {text.lower()}" for key, kind, text in rows if kind != "missing"]
        raise ConfigurationError(
            "the mapping file is not complete"
            if missing
            else "the mapping file has keys that cannot be used",
            where=str(path),
            found="; ".join([*(["without " + ", ".join(missing)] if missing else []), *wrong]),
            expected="format = 1, unit_id, latitude_deg, columns (docs/exchange.md)",
        ) from error
