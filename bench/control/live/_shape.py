"""The shape of live/now.json: a reader finds the types of docs/events.md, whoever wrote the file."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from bench.record.events._base import BenchTime, Number

Count = Annotated[int, Field(strict=True, ge=0, le=10**15)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="allow", strict=True)


class _Line(_Part):
    time_s: BenchTime
    kind: str


class _Prompt(_Part):
    id: Count
    question: str = ""
    picture: str = ""


class _Campaign(_Part):
    title: str = ""
    bench: str = ""
    number: Count = 0
    count: Count = 0
    run: str = ""
    left_s: Number | None = None
    emulated: bool = False


class _Run(_Part):
    folder: str = ""
    run_id: str = ""
    procedure: str = ""
    bench: str = ""
    units: dict[str, str] = Field(default_factory=dict)
    auxiliary: dict[str, str] = Field(default_factory=dict)
    emulated: bool = False


class _Device(_Part):
    age_s: Number | None = None
    stale: bool = False


class _Chamber(_Device):
    air_temp_c: Number | None = None
    set_point_c: Number | None = None
    rate_k_per_min: Number | None = None
    auxiliary_c: dict[str, Number | None] = Field(default_factory=dict)


class _Table(_Device):
    angle_deg: Number | None = None
    rate_dps: Number | None = None
    demands: dict[str, dict[str, Number | str | None] | None] = Field(default_factory=dict)


class _Gyro(_Device):
    rate_dps: Number | None = None
    latest_dps: Number | None = None
    temp_c: Number | None = None
    frames: Count = 0
    lost: Count = 0
    rejected: dict[str, Count] = Field(default_factory=dict)


class _Now(_Part):
    format: Literal[1]
    utc: str
    pid: int | None = None
    process_start: int = 0
    state: Literal["starting", "running", "asking", "paused", "ended"]
    outcome: str = ""
    reason: str | None = ""
    warnings: list[str] = Field(default_factory=list)
    error: dict[str, str | None] | None = None
    safe: list[dict[str, Any]] = Field(default_factory=list)
    pause_wanted: bool = False
    campaign: _Campaign | None = None
    run: _Run | None = None
    time_s: BenchTime | None = None
    left_s: Number | None = None
    speed: Number | None = None
    step: str = ""
    doing: str = ""
    phase: str = ""
    chamber: _Chamber | None = None
    table: _Table | None = None
    gyros: dict[str, _Gyro] = Field(default_factory=dict)
    alarms: list[_Line] = Field(default_factory=list)
    prompts: list[_Prompt] = Field(default_factory=list)
    log: list[_Line] = Field(default_factory=list)


def checked_now(found: object) -> dict[str, Any]:
    """Return what was read as it is; ValueError names what is not as it should be."""
    if not isinstance(found, dict):
        raise ValueError("not an object of format 1")
    try:
        _Now.model_validate(found)
        json.dumps(found, ensure_ascii=False).encode()  # half characters can be shown nowhere
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"{where}: {first['msg'].lower()}") from error
    return found
