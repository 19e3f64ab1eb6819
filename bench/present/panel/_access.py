"""Who may open the panel: everybody here, whoever has the token, or who signs in; never another site's page."""

from __future__ import annotations

import hmac
from dataclasses import dataclass
from urllib.parse import quote, urlencode, urlsplit

from starlette.datastructures import MultiDict
from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from bench.control.operators import Signature, may
from bench.present.panel._sign_in import Sessions
from bench.record.events import Role

LET_IN = "gyrobench.let_in"
"""In a request's state: what to call when it may pass (`Visitor`)."""
_VISIT = "gyrobench.visit"
COOKIE = "gyrobench_panel"
LOCAL_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
_READING = ("GET", "HEAD")
_OPEN = ("/sign-in", "/panel/style.css", "/panel/assets/")
"""What is served to those who have not signed in yet."""


@dataclass(frozen=True)
class Visit:
    """Who is behind a request. No name: nobody signs in at this panel, and names are typed."""

    name: str = ""
    role: Role = "configure"
    token: str = ""

    def signature(self, typed: str = "") -> Signature:
        """Return what stands in the record: who is signed in, else the name that was typed."""
        return Signature(self.name, self.role) if self.name else Signature(typed.strip())


def visit_of(request: HTTPConnection) -> Visit:
    """Return who is behind a request that was let in."""
    found: Visit = request.scope["state"][_VISIT]
    return found


def needed(method: str, path: str) -> Role:
    """Return the role that a request needs."""
    if path.startswith("/operators"):
        return "configure"
    if method in _READING or path == "/sign-out" or path.startswith("/_nicegui"):
        return "look"
    if path.startswith("/panel/queue/"):
        return "look" if path.endswith("/plan") else "run"
    return "run" if path.startswith("/panel/recover/") else "answer"


class Access:
    """ASGI middleware around everything the panel serves, pages, assets and sockets alike.

    `token` None and no `sessions`: nothing is asked for, but the request must name this machine by a local name,
    so that a page of another site cannot reach the panel through a name of its own that resolves to 127.0.0.1.
    With `sessions` operators sign in, and the token is for scripts, which may look. A request that says where it
    comes from (Origin) must come from the panel itself.
    """

    def __init__(self, app: ASGIApp, token: str | None, sessions: Sessions | None = None) -> None:
        self._app = app
        self._token = token
        self._sessions = sessions

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what may pass."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        request = HTTPConnection(scope)
        answer = self._refused(request) or self._passed(request)
        if answer is None:
            await self._app(scope, receive, send)
        elif scope["type"] == "http":
            await answer(scope, receive, send)
        else:
            await send({"type": "websocket.close", "code": 4000 + answer.status_code})

    def _refused(self, request: HTTPConnection) -> Response | None:
        """Refuse what comes from another site's page."""
        host, origin = request.headers.get("host", ""), request.headers.get("origin")
        if self._token is None and self._sessions is None and host_name(host) not in LOCAL_NAMES:
            return _refusal(403, "The panel is bound to this machine: open it as http://127.0.0.1.")
        if origin is not None and origin.partition("://")[2] != host:
            return _refusal(403, "The panel takes no requests from other sites' pages.")
        return None

    def _passed(self, request: HTTPConnection) -> Response | None:
        """Let a request in, with who is behind it in its state, or return why not."""
        scope = request.scope
        path, method = scope["path"], scope.get("method", "GET")
        visit = self._visit(request)
        if visit is None:
            if self._sessions is not None and path.startswith(_OPEN):
                return None
            return self._stranger(request)
        needs = needed(method, path)
        if not may(visit.role, needs):
            text = f"This needs the role {needs}: {visit.name} is signed in to {visit.role}."
            return JSONResponse({"error": text}, 403, {"cache-control": "no-store"})
        scope.setdefault("state", {})[_VISIT] = visit
        scope["state"].get(LET_IN, _nothing)()
        return None

    def _visit(self, request: HTTPConnection) -> Visit | None:
        """Return who is behind a request, None for somebody unknown."""
        cookie = request.cookies.get(COOKIE, "")
        if self._sessions is None:
            if self._token is None or self._bears_token(request) or self._equal(cookie):
                return Visit()
            return None
        if self._bears_token(request):
            return Visit("a script with the token", "look")
        found = self._sessions.of(cookie)
        return None if found is None else Visit(found.name, found.role, cookie)

    def _stranger(self, request: HTTPConnection) -> Response:
        scope = request.scope
        if self._sessions is not None:
            page = scope["type"] == "http" and "text/html" in request.headers.get("accept", "")
            if page and scope["method"] in _READING:
                query = f"?{scope['query_string'].decode('latin-1')}" if scope["query_string"] else ""
                return RedirectResponse(f"/sign-in?{urlencode({'to': scope['path'] + query})}", 303)
            return _refusal(401, "The panel needs you to sign in: open /sign-in.")
        if scope["type"] == "http" and self._equal(request.query_params.get("token", "")):
            return self._welcome(request)
        return _refusal(401, "The panel needs its token: open it once as /?token=...")

    def _bears_token(self, request: HTTPConnection) -> bool:
        return self._equal(request.headers.get("authorization", "").partition("Bearer ")[2])

    def _equal(self, given: str) -> bool:
        """Compare in constant time."""
        return self._token is not None and hmac.compare_digest(given.encode(), self._token.encode())

    def _welcome(self, request: HTTPConnection) -> Response:
        """Keep the token in a cookie that scripts cannot read, and take it out of the address."""
        others = MultiDict(request.query_params.multi_items())
        others.pop("token", None)
        query = urlencode(others.multi_items())
        location = "/" + quote(request.scope["path"].lstrip("/")) + (f"?{query}" if query else "")
        cookie = kept_cookie(self._token or "", secure=request.scope.get("scheme") == "https")
        return RedirectResponse(location, 303, {"set-cookie": cookie})


def kept_cookie(value: str, *, secure: bool, age_s: int | None = None) -> str:
    """Return the Set-Cookie line of the panel's cookie: no script reads it, no other site's page sends it."""
    age = "" if age_s is None else f"; Max-Age={age_s}"
    return f"{COOKIE}={value}; Path=/; HttpOnly; SameSite=Strict{age}" + ("; Secure" if secure else "")


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
