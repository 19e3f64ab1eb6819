"""Typed events: what is written to events.jsonl of a run or a campaign, one class a kind (docs/events.md).

`run`, `safe` and `campaign` have the classes.
"""

from __future__ import annotations

from bench.record.events import campaign, run, safe  # noqa: F401  (makes their kinds known)
from bench.record.events._base import EVENTS, Event, Other, Row, event_from, plain, time_of
from bench.record.events._legacy import typed
from bench.record.events.run import Role


def read_event(row: object) -> tuple[float, Event]:
    """Return time (s) and event of a line of events.jsonl; ValueError names the field that is missing or wrong.

    A kind that this version does not know comes as `Other`; lines of old run folders come as what is written now.
    """
    time_s = time_of(row)
    assert isinstance(row, dict)
    if (old := typed(row)) is not None:
        return time_s, old
    kind: str = row["kind"]
    if kind in EVENTS:
        return time_s, event_from(EVENTS[kind], row)
    return time_s, Other(kind, {key: value for key, value in row.items() if key not in ("time_s", "kind")})


__all__ = ["EVENTS", "Event", "Other", "Role", "Row", "plain", "read_event"]
