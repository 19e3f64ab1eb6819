"""Who may open the panel: everybody on this machine, or whoever has the token; never another site's page."""

from __future__ import annotations

import hmac
from urllib.parse import quote, urlencode, urlsplit

from starlette.datastructures import MultiDict
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

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

    def __init__(self, app: ASGIApp, token: str | None) -> None:
        self._app = app
        self._token = token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what may pass."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        request = HTTPConnection(scope)
        host, origin = request.headers.get("host", ""), request.headers.get("origin")
        if self._token is None and host_name(host) not in LOCAL_NAMES:
            answer = _refusal(403, "The panel is bound to this machine: open it as http://127.0.0.1.")
        elif origin is not None and origin.partition("://")[2] != host:
            answer = _refusal(403, "The panel takes no requests from other sites' pages.")
        elif self._token is None or self._has_token(request):
            scope.get("state", {}).get(LET_IN, _nothing)()
            await self._app(scope, receive, send)
            return
        elif scope["type"] == "http" and self._equal(request.query_params.get("token", "")):
            answer = self._welcome(request)
        else:
            answer = _refusal(401, "The panel needs its token: open it once as /?token=...")
        if scope["type"] == "http":
            await answer(scope, receive, send)
        else:
            await send({"type": "websocket.close", "code": 4000 + answer.status_code})

    def _has_token(self, request: HTTPConnection) -> bool:
        bearer = request.headers.get("authorization", "").partition("Bearer ")[2]
        return self._equal(bearer) or self._equal(request.cookies.get(COOKIE, ""))

    def _equal(self, given: str) -> bool:
        """Compare in constant time."""
        return self._token is not None and hmac.compare_digest(given.encode(), self._token.encode())

    def _welcome(self, request: HTTPConnection) -> Response:
        """Keep the token in a cookie that scripts cannot read, and take it out of the address."""
        others = MultiDict(request.query_params.multi_items())
        others.pop("token", None)
        query = urlencode(others.multi_items())
        location = "/" + quote(request.scope["path"].lstrip("/")) + (f"?{query}" if query else "")
        cookie = f"{COOKIE}={self._token}; Path=/; HttpOnly; SameSite=Strict"
        cookie += "; Secure" if request.scope.get("scheme") == "https" else ""
        return RedirectResponse(location, 303, {"set-cookie": cookie})


def host_name(host: str) -> str:
    """Return the name in a Host header, without its port."""
    try:
        return (urlsplit(f"//{host}").hostname or "").lower()
    except ValueError:  # a bracket that is not closed
        return ""


def _nothing() -> None:
    """Who asks without a server of ours: a test."""


def _refusal(status: int, text: str) -> Response:
    return PlainTextResponse(text, status, {"cache-control": "no-store"})
