"""The pages of signing in and of operators, and what they send."""

from __future__ import annotations

import math
from collections.abc import Mapping
from urllib.parse import parse_qsl, urlsplit

from fastapi import Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from bench.control.operators import ROLES, SHORTEST_PASSWORD, OperatorsFile
from bench.present.panel._access import kept_cookie, visit_of
from bench.present.panel._frame import PAGE_HEADERS, Frame, template
from bench.present.panel._sign_in import SESSION_S, Doorkeeper, Sessions, TooMany
from drivers.base.errors import BenchError

_LONGEST_FORM = 4096


class SignIn:
    """Lets operators in and out; those who may configure add, change and remove others."""

    def __init__(self, sessions: Sessions, frame: Frame) -> None:
        self._frame = frame
        self._sessions = sessions
        self._operators: OperatorsFile = sessions.operators
        self._doorkeeper = Doorkeeper(sessions.operators)

    def page(self, to: str = "/") -> Response:
        """Return the page to sign in."""
        return self._form(to)

    async def enter(self, request: Request) -> Response:
        """Check a name and a password; begin a session, or say what is wrong."""
        form = await _form_of(request)
        name, password, to = (form.get(key, "") for key in ("name", "password", "to"))
        address = request.client.host if request.client is not None else ""
        try:
            found = await self._doorkeeper.check(name, password, address)
        except TooMany as many:
            wait = f"Tried too often. Wait {math.ceil(many.wait_s)} s."
            return self._form(to, name, wait, 429)
        except BenchError as error:
            return self._form(to, name, str(error), 500)
        if found is None:
            return self._form(to, name, "Name and password do not fit together.", 401)
        secure = request.url.scheme == "https"
        cookie = kept_cookie(self._sessions.begin(found), secure=secure, age_s=SESSION_S)
        return RedirectResponse(_inside(to), 303, {"set-cookie": cookie})

    def leave(self, request: Request) -> Response:
        """End a session."""
        self._sessions.end(visit_of(request).token)
        secure = request.url.scheme == "https"
        return RedirectResponse("/sign-in", 303, {"set-cookie": kept_cookie("", secure=secure, age_s=0)})

    def operators(self, request: Request, said: str = "") -> Response:
        """Return the page of operators, for those who may configure."""
        return self._operators_page(request, said)

    async def change(self, request: Request) -> Response:
        """Add an operator, change a role or a password, remove one."""
        form = await _form_of(request)
        try:
            return self._operators_page(request, self._change(request, form))
        except BenchError as error:
            return self._operators_page(request, str(error), 400)

    def _change(self, request: Request, form: Mapping[str, str]) -> str:
        action, name = form.get("action", ""), form.get("name", "")
        own = name.casefold() == visit_of(request).name.casefold()
        if action == "add":
            added = self._operators.add(name, form.get("role", ""), form.get("password", ""))
            return f"{added.name} may sign in ({added.role})."
        if action == "password":
            self._operators.set_password(name, form.get("password", ""))
            return f"{name} has another password and is signed out."
        if own:
            return "Nobody changes their own role or removes themselves: another one who may configure does."
        if action == "role":
            changed = self._operators.set_role(name, form.get("role", ""))
            return f"{changed.name} may now {changed.role}."
        if action == "remove":
            self._operators.remove(name)
            return f"{name} cannot sign in any more. What they did stays in the records."
        return "Nothing was asked for."

    def _operators_page(self, request: Request, said: str, status: int = 200) -> Response:
        return self._frame.page(
            "operators.html.j2",
            visit_of(request),
            "/operators",
            status,
            operators=self._operators.all(),
            roles=ROLES,
            said=said,
            shortest=SHORTEST_PASSWORD,
        )

    @staticmethod
    def _form(to: str, name: str = "", wrong: str = "", status: int = 200) -> Response:
        text = template("sign_in.html.j2").render(to=_inside(to), name=name[:80], wrong=wrong)
        return HTMLResponse(text, status, PAGE_HEADERS)


async def _form_of(request: Request) -> dict[str, str]:
    """Return the fields of a form, none of one that is longer than any of ours."""
    body = bytearray()
    async for block in request.stream():
        body += block
        if len(body) > _LONGEST_FORM:
            return {}
    try:
        return dict(parse_qsl(body.decode(), keep_blank_values=True, max_num_fields=20))
    except ValueError:
        return {}


def _inside(address: str) -> str:
    """Return an address of the panel; what leads elsewhere becomes the first page."""
    try:
        parts = urlsplit(address)
    except ValueError:
        return "/"
    inside = not parts.scheme and not parts.netloc and address.startswith("/") and address.isprintable()
    return address if inside and not address.startswith("//") and "\\" not in address else "/"
