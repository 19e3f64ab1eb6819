"""How others see and steer a session: the live files beside a run, see docs/events.md."""

from bench.control.live._files import (
    Action,
    drop_answer,
    drop_request,
    read_lines,
    read_now,
)
from bench.control.live._session import Live

__all__ = [
    "Action",
    "Live",
    "drop_answer",
    "drop_request",
    "read_lines",
    "read_now",
]
