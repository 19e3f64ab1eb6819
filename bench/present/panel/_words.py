"""The queue in words."""

from __future__ import annotations

from bench.campaign.queue import QueueState

HELD = {
    "new": "The queue is held: nothing starts by itself.",
    "operator": "{by} holds the queue: nothing starts by itself.",
    "ended_badly": "The queue is held: the last item did not end well. What has ended, below, says why.",
    "left_alone": "The queue is held: no panel looked after it for a while, and nobody may expect a start.",
}
"""`Hold.why` -> what the page says."""

ENDED = {
    "completed": "✓ completed",
    "invalid": "! invalid",
    "aborted": "✕ aborted",
    "failed": "✕ failed",
    "refused": "✕ refused: nothing was recorded",
    "lost": "✕ its process ended without a word: look at the live page",
    "unclear": "? the panel was killed while it started this: it may or may not have run",
}
"""`Ended.outcome` -> what the page says."""


def waiting_words(state: QueueState) -> str:
    """Return what waits in a queue and whether it is held, for the strip; empty if nothing waits."""
    if not state.waiting:
        return ""
    return f"{len(state.waiting)} waiting" + (", queue held" if state.held is not None else "")
