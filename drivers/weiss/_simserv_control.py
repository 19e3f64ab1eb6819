"""SimServ exchanges on a link: commands that must be confirmed, values and texts that must fit."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

from drivers.base.errors import DeviceRefused, DeviceSilent, ProtocolError
from drivers.kit.link import Link
from drivers.kit.retry import await_confirmation, command_with_retry, misfit, query_with_retry
from drivers.weiss.simserv import (
    OK,
    REPLY_END,
    STATUS_TEXTS,
    Number,
    SimServReply,
    decode_simserv_reply,
    encode_request,
)

_T = TypeVar("_T")
_TIMEOUT_S = 2.0
_READ_BACK = {
    Number.SET_SET_POINT: Number.GET_SET_POINT,
    Number.SET_DIGITAL_OUT: Number.GET_DIGITAL_OUT,
    Number.SET_GRADIENT_UP: Number.GET_GRADIENT_UP,
    Number.SET_GRADIENT_DOWN: Number.GET_GRADIENT_DOWN,
}


class SimServControl:
    """Every exchange has a deadline (DeviceSilent); a status other than 1 raises DeviceRefused: for good when the
    exchange has been tried again.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def request(self, number: Number, *arguments: object) -> None:
        """Drop late answers and send a request."""
        self._link.discard()
        self._link.write(encode_request(number, *arguments))

    def command(self, number: Number, index: int, value: float) -> None:
        """Set a value and take its confirmation; read it back if that does not come."""

        def tell() -> None:
            self.request(number, index, value)
            reply = self._read(_TIMEOUT_S)
            self._accept(reply, number)
            if reply.fields:  # the late answer to a question
                raise self._unfit(repr(reply.fields), number, "nothing but status 1")

        def in_force() -> bool:
            return math.isclose(self.value(_READ_BACK[number], index), value, rel_tol=0.0, abs_tol=1e-3)

        command_with_retry(self._link, tell, in_force, doubt_refusal=True)

    def value(self, number: Number, *arguments: object) -> float:
        """Ask for a number."""
        return self._query(self.take_value, number, *arguments)

    def text(self, number: Number, *arguments: object) -> str:
        """Ask for a text."""
        return self._query(self._take_field, number, *arguments)

    def _query(self, take: Callable[[Number], _T], number: Number, *arguments: object) -> _T:
        def ask() -> _T:
            self.request(number, *arguments)
            return take(number)

        return query_with_retry(self._link, ask)

    def take_value(self, number: Number) -> float:
        """Take the answer to `request` as a finite number."""
        field = self._take_field(number)
        try:
            value = float(field)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self._unfit(field, number, "a number")
        return value

    def insist(self, number: Number, *arguments: object) -> None:
        """Send a command and pass over replies to older requests until it is confirmed by a bare 1."""
        self._link.write(encode_request(number, *arguments))
        self._await_confirmation(number)

    def confirms(self, number: Number) -> bool:
        """Wait as `insist` does for a command that was sent before; False if nothing comes.

        Raises DeviceRefused or ProtocolError if only other things than a confirmation come.
        """
        try:
            self._await_confirmation(number)
        except DeviceSilent:
            return False
        return True

    def _await_confirmation(self, number: Number) -> None:
        def confirmed(timeout_s: float) -> bool:
            reply = self._read(timeout_s)
            if not reply.fields:
                self._accept(reply, number)
            return not reply.fields

        await_confirmation(self._link, _TIMEOUT_S, confirmed)

    def _take_field(self, number: Number) -> str:
        reply = self._read(_TIMEOUT_S)
        self._accept(reply, number)
        if len(reply.fields) != 1:
            raise self._unfit(repr(reply.fields), number, "one field")
        return reply.fields[0].strip()

    def _read(self, timeout_s: float) -> SimServReply:
        try:
            return decode_simserv_reply(self._link.read_until(REPLY_END, timeout_s))
        except ProtocolError as error:
            error.where = error.where or self._link.where
            raise

    def _accept(self, reply: SimServReply, number: Number) -> None:
        if reply.status == OK:
            return
        raise DeviceRefused(
            f"the chamber refused SimServ command {int(number)} ({number.name.lower().replace('_', ' ')})",
            where=self._link.where,
            found=f"status {reply.status}, {STATUS_TEXTS.get(reply.status, 'not in the list')}",
            expected="status 1",
            remedy="check the demand against the chamber's limits and that its panel allows external control",
        )

    def _unfit(self, found: str, number: Number, expected: str) -> ProtocolError:
        return misfit("chamber", f"{self._link.where}, SimServ command {int(number)}", found, expected)
