"""Who may open the panel: everybody on this machine, or whoever has the token; never another site's page."""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, quote, urlencode, urlsplit

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

LET_IN = "gyrobench.let_in"
"""In a request's state: what to call when it may pass (`Visitor`)."""
COOKIE = "gyrobench_panel"
LOCAL_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})


class Access:
    """ASGI middleware around everything the panel serves, pages, assets and sockets alike.

    `token` None: no token is asked for, but the request must name this machine by a local name, so that a page of
    another site cannot reach the panel through a name of its own that resolves to 127.0.0.1. A request that says
    where it comes from (Origin) must come from the panel itself.
    """

    def __init__(self, app: App, token: str | None) -> None:
        self._app = app
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what may pass."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {
            name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]
        }
        host = headers.get("host", "")
        if self._token is None and host_name(host) not in LOCAL_NAMES:
            await _refuse(
                scope, send, 403, "The panel is bound to this machine: open it as http://127.0.0.1."
            )
        elif (origin := headers.get("origin")) is not None and origin.partition("://")[2] != host:
            await _refuse(scope, send, 403, "The panel takes no requests from other sites' pages.")
        elif self._token is None or self._has_token(headers):
            scope.get("state", {}).get(LET_IN, _nothing)()
            await self._app(scope, receive, send)
        elif scope["type"] == "http" and self._equal(_query_token(scope)):
            await self._let_in(scope, send)
        else:
            await _refuse(
                scope,
                send,
                401,
                "The panel needs its token: open it once as /?token=...",
            )

    def _has_token(self, headers: MutableMapping[str, str]) -> bool:
        bearer = headers.get("authorization", "").partition("Bearer ")[2]
        try:
            morsel = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
        except CookieError:
            morsel = None
        return self._equal(bearer) or self._equal("" if morsel is None else morsel.value)

    def _equal(self, given: str) -> bool:
        """Compare in constant time."""
        return self._token is not None and hmac.compare_digest(given.encode(), self._token.encode())

    async def _let_in(self, scope: Scope, send: Send) -> None:
        """Keep the token in a cookie that scripts cannot read, and take it out of the address."""
        query = parse_qs(scope["query_string"].decode("latin-1"))
        query.pop("token", None)
        rest = urlencode(query, doseq=True)
        location = "/" + quote(scope["path"].lstrip("/")) + (f"?{rest}" if rest else "")
        cookie = f"{COOKIE}={self._token}; Path=/; HttpOnly; SameSite=Strict"
        cookie += "; Secure" if scope.get("scheme") == "https" else ""
        found = [(b"location", location.encode("latin-1")), (b"set-cookie", cookie.encode("latin-1"))]
        await send({"type": "http.response.start", "status": 303, "headers": found})
        await send({"type": "http.response.body", "body": b""})


def host_name(host: str) -> str:
    """Return the name in a Host header, without its port."""
    try:
        return (urlsplit(f"//{host}").hostname or "").lower()
    except ValueError:  # a bracket that is not closed
        return ""


def _nothing() -> None:
    """Who asks without a server of ours: a test."""


def _query_token(scope: Scope) -> str:
    query: bytes = scope.get("query_string", b"")
    return parse_qs(query.decode("latin-1")).get("token", [""])[0]


async def _refuse(scope: Scope, send: Send, status: int, text: str) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 4401 if status == 401 else 4403})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"cache-control", b"no-store")]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": text.encode()})
