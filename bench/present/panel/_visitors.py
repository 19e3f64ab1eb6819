"""Connections that ask for nothing: how long and how many the panel bears, so that nobody fills its doorway."""

from __future__ import annotations

import asyncio
from typing import Any, ClassVar

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from bench.present.panel._access import LET_IN

MOST_WAITING = 256
"""Connections idle or not let in; of one more the oldest is closed. An operator's own waits for milliseconds."""
REQUEST_S = 10.0
"""How long a connection may go on without a request that is let in."""
SERVER_LIMITS: dict[str, Any] = {
    "h11_max_incomplete_event_size": 16_384,
    "timeout_keep_alive": 5,
    "ws_max_size": 1 << 20,
    "backlog": 512,
    "uvicorn_logging_level": "error",
}
"""What `ui.run` is told: bytes of a request's head and of a message; no line in the log for each bad request."""


class Visitor(H11Protocol):
    """A connection of the panel's server.

    A limit on all connections (`limit_concurrency`) would shut out the operator as soon as somebody else holds
    that many; here those who only hold a place lose it. Whose request was let in keeps it until that is answered.
    """

    _waiting: ClassVar[dict[Visitor, asyncio.TimerHandle]] = {}
    """The one that has waited longest comes first."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for the first request."""
        super().connection_made(transport)
        self._known = False
        self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        """Give up the place."""
        self._wait_no_more()
        super().connection_lost(exc)

    def handle_events(self) -> None:
        """Take what has come; `Access` ends the wait if it lets a request in, which is looked at after this."""
        super().handle_events()
        if self.scope is not None:
            self.scope["state"][LET_IN] = self._let_in

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Hand the connection to the socket, which waits for nothing."""
        self._wait_no_more()
        super().handle_websocket_upgrade(event)

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        if not self.transport.is_closing():
            self._wait()
        super().on_response_complete()

    def _let_in(self) -> None:
        self._known = True
        self._wait_no_more()

    def _wait(self) -> None:
        self._wait_no_more()
        self._waiting[self] = self.loop.call_later(REQUEST_S, self.put_out)
        if len(self._waiting) > MOST_WAITING:
            next(iter(self._waiting)).put_out()

    def _wait_no_more(self) -> None:
        if timer := self._waiting.pop(self, None):
            timer.cancel()

    def put_out(self) -> None:
        """Close; not before what is still on its way to a slow browser of ours has gone."""
        self._wait_no_more()
        if self._known:
            self.transport.close()
        else:
            self.transport.abort()
