"""What every event is: a frozen dataclass with a `kind`, made a line of events.jsonl and checked when read."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, dataclass_transform

from pydantic import Field, TypeAdapter, ValidationError

_MOST_S = 3.2e7
"""A year of bench time; what is computed second by second of more would not fit in memory."""

Number = Annotated[float, Field(strict=True, ge=-1e300, le=1e300, allow_inf_nan=False)]
BenchTime = Annotated[float, Field(strict=True, ge=-_MOST_S, le=_MOST_S, allow_inf_nan=False)]
"""s since the run's clock started."""
Whole = Annotated[int, Field(strict=True)]
Flag = Annotated[bool, Field(strict=True)]
Row = dict[str, Any]
"""A line of events.jsonl as JSON has it: `time_s`, `kind` and the fields of its kind."""

_TIME: TypeAdapter[float] = TypeAdapter(BenchTime)
EVENTS: dict[str, type[Event]] = {}
"""All kinds of events that are written."""
_ADAPTERS: dict[type[Event], TypeAdapter[Event]] = {}
"""Made when a kind is first read: few readers need them all."""


@dataclass_transform(frozen_default=True)
@dataclass(frozen=True)
class Event:
    """Something that happened: `class Step(Event, kind="step")` has a field for each fact, units in the names.

    Subclasses are frozen dataclasses. A field that is None by default is left out of the line when it is None.
    A field `details` (a dict) holds what a kind has beside its named fields: its entries stand beside them.
    """

    kind: ClassVar[str]
    alarming: ClassVar[bool]
    """Whether an operator has to see it at once, among the alarms."""

    def __init_subclass__(cls, kind: str | None = None, alarming: bool = False) -> None:
        super().__init_subclass__()
        cls.alarming = alarming
        dataclass(frozen=True)(cls)
        if kind is not None:
            cls.kind = kind
            EVENTS[kind] = cls

    @property
    def alarms(self) -> bool:
        """Whether this one is shown among the alarms."""
        return self.alarming

    def fields(self) -> Row:
        """Return the facts as JSON has them; numbers that are not finite become None."""
        row: Row = {}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.name == "details":
                row |= plain(value)
            elif value is not None or field.default is not None:
                row[field.name] = plain(value)
        return row

    def row(self, time_s: float) -> Row:
        """Return the line of events.jsonl, at bench time `time_s`."""
        return {"time_s": round(time_s, 9), "kind": self.kind} | self.fields()


class Other(Event):
    """A line of a kind that this version does not know: `name` is the kind."""

    name: str
    details: dict[str, Any]

    def row(self, time_s: float) -> Row:
        """Return the line as it was."""
        details: Row = plain(self.details)
        return {"time_s": round(time_s, 9), "kind": self.name} | details


def event_from(kind: type[Event], fields: Mapping[str, Any]) -> Event:
    """Return the event of a class that a line's fields describe; ValueError names the field that is wrong."""
    names = {field.name for field in dataclasses.fields(kind)}
    given = dict(fields)
    if "details" in names:
        named = names - {"details"} | {"time_s", "kind"}
        given["details"] = {key: value for key, value in fields.items() if key not in named}
    try:
        adapter = _ADAPTERS.get(kind) or _ADAPTERS.setdefault(kind, TypeAdapter(kind))
        return adapter.validate_python(given)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"{kind.kind}: {where}: {first['msg']}") from error


def time_of(row: object) -> float:
    """Return the bench time of a line, s; ValueError for what is no line of an event log."""
    if not (isinstance(row, dict) and "time_s" in row and isinstance(row.get("kind"), str)):
        raise ValueError("no object with time_s and kind")
    try:
        return _TIME.validate_python(row["time_s"])
    except ValidationError as error:
        raise ValueError("time_s is no time of a run") from error


def plain(value: Any) -> Any:
    """Return `value` as JSON types: numpy scalars unwrapped, dataclasses as objects, NaN and infinity as None."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {key: plain(entry) for key, entry in vars(value).items() if entry is not None}
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
