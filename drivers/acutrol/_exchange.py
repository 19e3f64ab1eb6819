"""Exchanges with an ACUTROL3000 on a link: queries, commands that are read back, confirmations awaited."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from typing import TypeVar

from drivers.acutrol.codec import (
    HEADER_BYTES,
    Reply,
    decode_header,
    decode_numbers,
    decode_text,
    encode_command,
)
from drivers.base.errors import DeviceRefused, DeviceSilent, ProtocolError
from drivers.kit.polled import PolledTable
from drivers.kit.retry import await_confirmation, command_with_retry, misfit, query_with_retry

REPLY_TIMEOUT_S = 2.0
"""A reply takes about 2 ms over Ethernet, 40 ms and more through a device server at 9600 baud."""

Argument = int | float | str
_T = TypeVar("_T")


class AcutrolExchanges(PolledTable):
    """Every exchange has a deadline (DeviceSilent), a reply that is not one raises ProtocolError, and an error
    code raises DeviceRefused with the controller's own text and the top of its error queue: for good when the
    exchange has been tried again (`drivers.kit.retry`).
    """

    def _take(self, count: int) -> tuple[float, ...]:
        """Return the `count` numbers that answer what was sent last."""
        return self._numbers(self._accepted(self._read_reply(REPLY_TIMEOUT_S), "state poll"), count)

    def _query(self, read: Callable[[str], _T], header: str, *arguments: Argument) -> _T:
        """Ask and return what `read` makes of the answer; ProtocolError from there has it asked again."""
        return query_with_retry(self.link, lambda: read(self._ask(header, *arguments)))

    def _ask_number(self, header: str, *arguments: Argument) -> float:
        return self._query(lambda text: self._numbers(text, 1)[0], header, *arguments)

    def _ask_word(self, header: str, *arguments: Argument) -> str:
        """Ask for a word; return it in small letters."""

        def read(text: str) -> str:
            if not (text.isascii() and text.isalpha()):
                raise self._misfit(text, "one word")
            return text.lower()

        return self._query(read, header, *arguments)

    def _numbers(self, text: str, count: int) -> tuple[float, ...]:
        """Return the `count` numbers of an answer; raises ProtocolError."""
        try:
            return decode_numbers(text, count)
        except ProtocolError as problem:
            raise self._misfit(text, problem.expected) from problem

    def _command(self, header: str, *arguments: Argument) -> None:
        """Tell what does the same when it is told twice."""
        in_force = self._reading_back(header, *arguments)
        command_with_retry(self.link, lambda: self._tell(header, *arguments), in_force, doubt_refusal=True)

    def _tell(self, header: str, *arguments: Argument) -> None:
        """Send a command once and take its confirmation."""
        text = self._ask(header, *arguments)
        if text.upper() not in ("", "OK"):
            raise self._misfit(text, f"OK or an empty answer to {header}")

    def _insist(self, header: str, axis: int | str) -> None:
        self.link.write(encode_command(header, axis))
        self._await_confirmation(header)

    def _await_confirmation(self, header: str) -> None:
        """Pass over replies to older commands until the last one sent is confirmed."""

        def confirmed(timeout_s: float) -> bool:
            reply = self._read_reply(max(0.0, timeout_s))
            if reply.error == 0 and reply.text.upper() in ("", "OK"):
                return True
            raise self._refused(header, reply, "")

        await_confirmation(self.link, REPLY_TIMEOUT_S, confirmed)

    def _misfit(self, found: str, expected: str) -> ProtocolError:
        return misfit("table", self._where, repr(found), expected)

    def _reading_back(self, header: str, *arguments: Argument) -> Callable[[], bool] | None:
        """Return how to see that a demand, a limit or a mode of an axis is in force; None where it cannot be."""
        if header.startswith((":demand:", ":limit:")):
            *which, value = arguments
            return lambda: math.isclose(
                self._ask_number(f"{header}?", *which), float(value), rel_tol=1e-6, abs_tol=1e-5
            )
        if header.startswith(":mode:") and isinstance(axis := arguments[0], int):
            wanted = header.removeprefix(":mode:")
            return lambda: self._ask_word(":mode?", axis).startswith(wanted[0])
        return None

    def _ask(self, header: str, *arguments: Argument) -> str:
        reply = self._exchange(header, *arguments)
        return self._accepted(reply, encode_command(header, *arguments).decode("ascii").strip())

    def _exchange(self, header: str, *arguments: Argument) -> Reply:
        self._settle_input()
        self.link.write(encode_command(header, *arguments))
        return self._read_reply(REPLY_TIMEOUT_S)

    def _settle_input(self) -> None:
        """Take the answer to a state poll nobody read, then drop late answers."""
        if self._state_asked:
            self._state_asked = False
            with contextlib.suppress(DeviceSilent, ProtocolError):
                self._read_reply(REPLY_TIMEOUT_S)
        self.link.discard()

    def _read_reply(self, timeout_s: float) -> Reply:
        deadline = self.link.clock.now() + timeout_s
        header = self.link.read_exactly(HEADER_BYTES, timeout_s)
        try:
            error, length = decode_header(header)
        except ProtocolError as problem:
            rest = self.link.discard()
            raise self._misfit((header + rest[:60]).decode("latin-1"), problem.expected) from problem
        text = self.link.read_exactly(length, max(0.0, deadline - self.link.clock.now()))
        return Reply(error, decode_text(text))

    def _accepted(self, reply: Reply, request: str) -> str:
        if reply.error == 0:
            return reply.text
        queue = self._exchange(":Status:MSG?", "QERROR")
        raise self._refused(request, reply, queue.text if queue.error == 0 else "")

    def _refused(self, request: str, reply: Reply, queue: str) -> DeviceRefused:
        return DeviceRefused(
            f"the table refused {request!r}",
            where=self._where,
            found=f"error {reply.error}: {reply.text or 'no text'}"
            + (f"; error queue: {queue}" if queue else ""),
            expected="error code 0",
            remedy="check the demand against the limits, the axis number and the interlock",
        )
