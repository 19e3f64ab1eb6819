"""What the free parts of a manifest must be made of.

Readers count on a number where a number is said, so text in its place is found here, once, and not by whoever
computes with it. A key that is not named here may hold anything.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, JsonValue, TypeAdapter

Number = Annotated[float, Field(ge=-1e300, le=1e300)]
Count = Annotated[int, Field(ge=0, lt=1 << 63)]


class _Shape(BaseModel):
    model_config = ConfigDict(extra="allow", strict=True, allow_inf_nan=False)


class _Stream(_Shape):
    """`StreamReport`; of a run that goes on, where its stream begins."""

    frames: Count = 0
    lost: Count = 0
    duplicates: Count = 0
    invalid: Count = 0
    bytes_received: Count = 0
    bytes_skipped: Count = 0
    rejected: dict[str, Count] = Field(default_factory=dict)
    start_offset: Count = 0
    off: Count = 0
    sample_rate_hz: Number | None = None
    clock_error_ppm: Number | None = None
    residual_s: Number | None = None
    warnings: list[str] = Field(default_factory=list)


class _Measurement(_Shape):
    """A number that a procedure measured; null where it was not finite."""

    name: str
    value: Number | None = None
    unit: str = ""
    low: Number | None = None
    high: Number | None = None
    passed: bool | None = None


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


class _FreeParts(_Shape):
    started_utc: str
    bench: _BenchData
    stream: dict[str, _Stream]
    measurements: list[_Measurement]
    parameters: dict[str, bool | Number | str | list[JsonValue] | dict[str, JsonValue] | None]


_FREE_PARTS = TypeAdapter(_FreeParts)


def check_free_parts(parts: Mapping[str, Any]) -> None:
    """Raise ValueError (ValidationError is one) for parts of a manifest, as JSON has them, that no run has."""
    _FREE_PARTS.validate_python(parts)
    started = datetime.fromisoformat(parts["started_utc"])
    if not 1970 <= started.year < 3000:
        raise ValueError(f"started_utc: {parts['started_utc']} is no time of a run")
