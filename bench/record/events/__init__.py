"""Typed events: what is written to events.jsonl of a run or a campaign, one class a kind (docs/events.md).

`run`, `safe` and `campaign` have the classes.
"""

from __future__ import annotations

from types import ModuleType

from bench.record.events import campaign, run, safe
from bench.record.events._base import Event, Other, Row, event_from, plain, time_of
from bench.record.events._legacy import typed


def _kinds(module: ModuleType) -> dict[str, type[Event]]:
    events = (
        member for member in vars(module).values() if isinstance(member, type) and issubclass(member, Event)
    )
    return {event.kind: event for event in events if "kind" in vars(event)}


RUN_EVENTS = _kinds(run) | _kinds(safe)
CAMPAIGN_EVENTS = _kinds(campaign)
_KINDS = RUN_EVENTS | CAMPAIGN_EVENTS


def read_event(row: object) -> tuple[float, Event]:
    """Return time (s) and event of a line of events.jsonl; ValueError names the field that is missing or wrong.

    A kind that this version does not know comes as `Other`; lines of old run folders come as what is written now.
    """
    time_s = time_of(row)
    assert isinstance(row, dict)
    if (old := typed(row)) is not None:
        return time_s, old
    kind: str = row["kind"]
    if kind in _KINDS:
        return time_s, event_from(_KINDS[kind], row)
    return time_s, Other(kind, {key: value for key, value in row.items() if key not in ("time_s", "kind")})


__all__ = ["CAMPAIGN_EVENTS", "RUN_EVENTS", "Event", "Other", "Row", "plain", "read_event"]
