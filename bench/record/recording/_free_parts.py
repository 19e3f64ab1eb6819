"""The parts of a manifest that are read as plain dictionaries: what each must look like, and what streams say."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field, JsonValue

from bench.record.events._base import Number


class _Shape(BaseModel):
    """A free part of a manifest: a number where a number is said; keys not named here may hold anything."""

    model_config = ConfigDict(extra="allow", strict=True, allow_inf_nan=False)


Count = Annotated[int, Field(strict=True, ge=0, lt=1 << 63)]


@dataclass(frozen=True)
class PulseReport:
    """The pulses at a unit's trigger input and what they say of the clocks; a clock's error is > 0 if it is fast.

    `missed` pulses are between those that came, `interval_s` from one to the next. `scatter_s`: standard
    deviation of their instants by the unit's clock about a line. Uncertainties are standard ones. None: too few.
    """

    __pydantic_config__: ClassVar = ConfigDict(strict=False)

    pulses: Count = 0
    missed: Count = 0
    interval_s: Number | None = None
    scatter_s: Number | None = None
    unit_clock_error_ppm: Number | None = None
    unit_clock_uncertainty_ppm: Number | None = None
    bench_clock_error_ppm: Number | None = None
    bench_clock_uncertainty_ppm: Number | None = None


@dataclass(frozen=True)
class StreamReport:
    """What a stream held: for the manifest's `stream` entry and the report.

    `lost` frames never arrived (the counter says so), `off` were never sent since the procedure had the unit
    switched off (both are gaps in the table), `duplicates` came twice (their rows are not valid),
    `rejected` counts refused candidates by reason. `clock_error_ppm` > 0: the device's clock is fast against
    the bench's. `pulses`: of a unit that tells the time since a pulse at its trigger input.
    The manifest of a run that goes on has only `start_offset`, where its stream begins.
    """

    __pydantic_config__: ClassVar = ConfigDict(strict=False)

    frames: Count = 0
    lost: Count = 0
    duplicates: Count = 0
    invalid: Count = 0
    bytes_received: Count = 0
    bytes_skipped: Count = 0
    rejected: dict[str, Count] = dataclasses.field(default_factory=dict)
    start_offset: Count = 0
    off: Count = 0
    sample_rate_hz: Number | None = None
    clock_error_ppm: Number | None = None
    residual_s: Number | None = None
    pulses: PulseReport | None = None
    warnings: tuple[str, ...] = ()


class _Measurement(_Shape):
    """A number that a procedure measured; null where it was not finite."""

    name: str
    value: Number | None = None
    unit: str = ""
    low: Number | None = None
    high: Number | None = None
    passed: bool | None = None
    gyro: str | None = None


class _Site(_Shape):
    name: str = ""
    latitude_deg: Annotated[Number, Field(ge=-90.0, le=90.0)] = 0.0


class _Gyro(_Shape):
    name: str
    axis: str | int | None = None
    axes: str | None = None
    channel: str | None = None


class _BenchData(_Shape):
    """The parts of a bench file that runs are read by; all of it is checked by who decodes."""

    bench: _Site = Field(default_factory=_Site)
    gyro: list[_Gyro] = Field(default_factory=list)


class FreeParts(_Shape):
    """Everything that is checked of them."""

    started_utc: str
    bench: _BenchData
    stream: dict[str, StreamReport]
    measurements: list[_Measurement]
    parameters: dict[str, bool | Number | str | list[JsonValue] | dict[str, JsonValue] | None]


def check_free_parts(parts: Mapping[str, Any]) -> None:
    """Raise ValueError (ValidationError is one) for parts of a manifest, as JSON has them, that no run has."""
    FreeParts.model_validate(parts)
    started = datetime.fromisoformat(parts["started_utc"])
    if not 1970 <= started.year < 3000:
        raise ValueError(f"started_utc: {parts['started_utc']} is no time of a run")
