"""How others see and steer a session: the live files beside a run, see docs/events.md."""

from bench.control.live._files import (
    Action,
    acknowledge,
    drop_answer,
    drop_request,
    read_acknowledged,
    read_lines,
    read_now,
)
from bench.control.live._session import Live

__all__ = [
    "Action",
    "Live",
    "acknowledge",
    "drop_answer",
    "drop_request",
    "read_acknowledged",
    "read_lines",
    "read_now",
]
