"""Mapping files (TOML): which column of a foreign log is what, in what unit; the phases of each recording."""

from __future__ import annotations

from fnmatch import fnmatch
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drivers.base.errors import ConfigurationError
from drivers.base.files import read_settings


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Column(_Part):
    """A column by its name in the log, and its unit."""

    name: str
    unit: str = ""


class Columns(_Part):
    """What the columns are. `output`: the rate under the axis of test; `valid`: zero where it is none.

    `t_in`: the gyro's own temperature, `t_out` that of its case, `air` and `set_point` the chamber's; `angle`
    and `table_rate` the table's, `elevation` that of the input axis (read by the gap diagnosis, not kept in
    runs). MDF files have times of their own: `time` is left out for them.
    """

    time: Column | None = None
    output: Column
    t_in: Column | None = None
    t_out: Column | None = None
    angle: Column | None = None
    elevation: Column | None = None
    table_rate: Column | None = None
    air: Column | None = None
    set_point: Column | None = None
    valid: Column | None = None


class PhaseEntry(_Part):
    """A phase, from `start_s` after the first row to the next one."""

    name: str = Field(min_length=1)
    start_s: float = Field(ge=-3.2e7, le=3.2e7)


class LogEntry(_Part):
    """One recording: `file` from the mapping's folder (or a pattern such as "*.csv"), and what is not in it.

    `angle_deg`: of the table, where no column says it. `elevation_deg` of the input axis: 0 level, 90 up.
    `power_on_s`: how long the unit had been on at the first row. `profile` is the same for recordings through
    the same temperatures, `condition` what differs between them.
    """

    file: str = "*"
    run_id: str = ""
    profile: str = ""
    condition: str = "0"
    elevation_deg: float = 0.0
    angle_deg: float | None = None
    azimuth_error_deg: float = Field(default=0.0, ge=-360.0, le=360.0)
    power_on_s: float = Field(default=0.0, ge=0.0, le=1e10)
    started_utc: str = ""
    phases: tuple[PhaseEntry, ...] = ()


class Mapping(_Part):
    """A mapping file."""

    format: Literal[1]
    unit_id: str = Field(min_length=1)
    latitude_deg: float = Field(ge=-90, le=90)
    columns: Columns
    run: tuple[LogEntry, ...] = (LogEntry(),)
    gyro: str = Field(default="gyro", pattern=r"^[a-z][a-z0-9_]{0,31}$")
    axis: Literal["x", "y", "z"] = "x"
    maker: str = ""
    model: str = ""
    bench: str = "another bench"
    procedure: str = ""

    def entry_for(self, log: Path, where: Path) -> LogEntry:
        """Return the entry of a log, by its name; ConfigurationError when none fits."""
        for entry in self.run:
            if log.name == Path(entry.file).name or fnmatch(log.name, entry.file):
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
        rows = [(".".join(map(str, row["loc"])), row["type"], row["msg"]) for row in error.errors()]
        missing = [key for key, kind, _ in rows if kind == "missing"]
        wrong = [f"{key}: {text.lower()}" for key, kind, text in rows if kind != "missing"]
        raise ConfigurationError(
            "the mapping file is not complete"
            if missing
            else "the mapping file has keys that cannot be used",
            where=str(path),
            found="; ".join([*(["without " + ", ".join(missing)] if missing else []), *wrong]),
            expected="format = 1, unit_id, latitude_deg, columns time, output (docs/exchange.md)",
        ) from error
