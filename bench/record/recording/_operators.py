"""Who did what in a run: taken from its events, for the manifest."""

from __future__ import annotations

from collections.abc import Iterable

from bench.record.events import Event, Role
from bench.record.events.campaign import Started
from bench.record.events.run import Answer, Requested
from bench.record.recording._manifest import OperatorEntry

_ACTS = {"pause": "paused", "resume": "resumed", "abort": "aborted"}


def operators_of(events: Iterable[Event], known: tuple[OperatorEntry, ...] = ()) -> tuple[OperatorEntry, ...]:
    """Return who started, answered, paused, resumed or aborted, in order; `known`: by the events before these."""
    found = {(entry.name, entry.role): entry for entry in known}
    for event in events:
        if (act := _act(event)) is None:
            continue
        name, role, did = act
        entry = found.get((name, role), OperatorEntry(name=name, role=role))
        if did not in entry.did:
            entry = entry.model_copy(update={"did": (*entry.did, did)})
        found[name, role] = entry
    return tuple(found.values())


def _act(event: Event) -> tuple[str, Role | None, str] | None:
    match event:
        case Started():
            return event.by, event.role, "started"
        case Answer():
            return event.by, event.role, "answered"
        case Requested() if event.action in _ACTS:
            return event.by, event.role, _ACTS[event.action]
    return None
