"""Signing in: a session that a cookie carries, and how often a password may be tried."""

from __future__ import annotations

import asyncio
import hashlib
from contextlib import suppress

from itsdangerous import BadSignature, URLSafeTimedSerializer

from bench.control.operators import Operator, OperatorsFile
from drivers.base.clock import host_seconds
from drivers.base.errors import BenchError

SESSION_S = 12 * 3600
"""A shift: then the operator signs in anew."""
_MOST_AT_ONCE = 8
"""Sign-ins that wait for one another: each takes some tenths of a second of a processor."""
_FREE_TRIES, _FIRST_WAIT_S, _LONGEST_WAIT_S = 5, 15.0, 900.0
_REMEMBERED = 1000
_SALT = "gyrobench.panel.session"


class Sessions:
    """Sessions of operators: the cookie says who and since when, signed with the key of the operators' file.

    Nothing is kept, so that a panel that is started anew knows everybody. A session ends with its 12 hours, when
    its operator signs out (here, until the panel ends), is removed, or gets another password.
    """

    def __init__(self, operators: OperatorsFile) -> None:
        self.operators = operators
        self._ended: dict[str, float] = {}

    def begin(self, operator: Operator) -> str:
        """Return the token of a new session."""
        return str(self._serializer().dumps([operator.name, _stamp(operator)]))

    def of(self, cookie: str) -> Operator | None:
        """Return whose session that is, None for one that has ended or never was."""
        if _digest(cookie) in self._ended:
            return None
        with suppress(BadSignature, BenchError, TypeError, ValueError):
            name, stamp = self._serializer().loads(cookie, max_age=SESSION_S)
            found = self.operators.find(str(name))
            if found is not None and found.name == name and _stamp(found) == stamp:
                return found
        return None

    def end(self, token: str) -> None:
        """End a session before its time."""
        now_s = host_seconds()
        self._ended = {one: at for one, at in self._ended.items() if now_s - at < SESSION_S}
        self._ended[_digest(token)] = now_s

    def _serializer(self) -> URLSafeTimedSerializer:
        return URLSafeTimedSerializer(self.operators.key, salt=_SALT)


def _digest(token: str) -> str:
    """Return what a token is known by once its session was ended: the token itself is kept nowhere."""
    return hashlib.sha256(token.encode()).hexdigest()


def _stamp(operator: Operator) -> str:
    """Return what changes with every new password, and tells nothing of it."""
    return hashlib.sha256(operator.password.salt.encode()).hexdigest()[:16]


class TooMany(Exception):
    """Passwords are tried too often; `wait_s`: until when to wait."""

    def __init__(self, wait_s: float) -> None:
        super().__init__()
        self.wait_s = wait_s


class Doorkeeper:
    """Checks passwords one at a time, and has whoever was wrong five times wait, longer each time.

    It is the address together with the name that waits: nobody can lock an operator out from elsewhere.
    """

    def __init__(self, operators: OperatorsFile) -> None:
        self._operators = operators
        self._one = asyncio.Lock()
        self._waiting = 0
        self._wrong: dict[tuple[str, str], tuple[int, float]] = {}

    async def check(self, name: str, password: str, address: str) -> Operator | None:
        """Return who signs in, None for a wrong name or password; TooMany instead of looking."""
        key = (address, name.strip().casefold()[:80])
        self._require_patience(key)
        if self._waiting >= _MOST_AT_ONCE:
            raise TooMany(5.0)
        self._waiting += 1
        try:
            async with self._one:
                self._require_patience(key)
                found = await asyncio.to_thread(self._operators.check, name, password)
        finally:
            self._waiting -= 1
        if found is not None:
            self._wrong.pop(key, None)
            return found
        while len(self._wrong) >= _REMEMBERED:
            del self._wrong[next(iter(self._wrong))]
        self._wrong[key] = (self._wrong.pop(key, (0, 0.0))[0] + 1, host_seconds())
        return None

    def _require_patience(self, key: tuple[str, str]) -> None:
        wrong, at_s = self._wrong.get(key, (0, 0.0))
        if wrong >= _FREE_TRIES:
            wait_s = min(_FIRST_WAIT_S * 2.0 ** (wrong - _FREE_TRIES), _LONGEST_WAIT_S)
            left_s = at_s + wait_s - host_seconds()
            if left_s > 0.0:
                raise TooMany(left_s)
