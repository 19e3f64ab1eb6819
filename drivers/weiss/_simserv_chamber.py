"""A Weiss or Vötsch chamber by SimServ: commands that must be confirmed, values and texts that must fit."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeVar

from drivers.base.errors import DeviceRefused, DeviceSilent, ProtocolError
from drivers.kit.instruments import ChamberCapabilities, ChamberLimits, ChamberState, require_ramp
from drivers.kit.kinds import Connection
from drivers.kit.retry import await_confirmation, command_with_retry, misfit, pass_over, query_with_retry
from drivers.weiss._driver import REPLY_TIMEOUT_S, WeissChamber, WeissConfig
from drivers.weiss.simserv import (
    MESSAGE_TYPES,
    OK,
    REPLY_END,
    STATUS_TEXTS,
    ChamberStatus,
    Number,
    SimServReply,
    decode_simserv_reply,
    encode_request,
)

SET_POINT_EVERY = 10
"""States between two readings of the set point; 1 s states give 10 s."""

_T = TypeVar("_T")
_SET_POINT = (Number.GET_SET_POINT, 1)
_AIR = (Number.GET_ACTUAL, 1)
_READ_BACK = {
    Number.SET_SET_POINT: Number.GET_SET_POINT,
    Number.SET_DIGITAL_OUT: Number.GET_DIGITAL_OUT,
    Number.SET_GRADIENT_UP: Number.GET_GRADIENT_UP,
    Number.SET_GRADIENT_DOWN: Number.GET_GRADIENT_DOWN,
}


class SimServChamber(WeissChamber):
    """Every exchange has a deadline (DeviceSilent); a status other than 1 raises DeviceRefused: for good when the
    exchange has been tried again.

    A state is one exchange for each auxiliary sensor and one for the air, which ends it. The set point, which
    only a command, a ramp or somebody at the panel moves, is asked with every `SET_POINT_EVERY`th state and after
    a command, and held between.
    """

    _known_by = "SimServ replies and an ASCII-2 configuration text"

    def __init__(self, config: WeissConfig, connection: Connection) -> None:
        super().__init__(config, connection)
        self._questions: list[tuple[Number, int]] = []
        self._polls_to_set_point = 0
        self._set_point_c = math.nan

    def _model(self) -> tuple[str, str, dict[str, str]]:
        model, year, serial_number = (self._text(Number.CHAMBER_INFO, item) for item in (1, 2, 3))
        return model, serial_number, {"year": year}

    def capabilities(self) -> ChamberCapabilities:
        """Return thousandths of a degree; SimServ does not say which sensors there are."""
        return ChamberCapabilities(0.001, (0.001, math.inf), None)

    def limits(self) -> ChamberLimits:
        """Read the input limits of the temperature set point."""
        self._settle_input()
        return ChamberLimits(
            self._value(Number.GET_INPUT_MINIMUM, 1), self._value(Number.GET_INPUT_MAXIMUM, 1)
        )

    def set_temperature(self, set_point_c: float, ramp_k_per_min: float | None = None) -> None:
        """Demand a set point; `ramp_k_per_min` limits both directions, None takes every limit away."""
        require_ramp(self.capabilities(), set_point_c, ramp_k_per_min, self._where)
        ramp = 0.0 if ramp_k_per_min is None else ramp_k_per_min
        self._settle_input()
        self._command(Number.SET_GRADIENT_UP, 1, round(float(ramp), 3))
        self._command(Number.SET_GRADIENT_DOWN, 1, round(float(ramp), 3))
        self._command(Number.SET_SET_POINT, 1, round(float(set_point_c), 3))
        self._polls_to_set_point = 0

    def request_state(self) -> None:
        """Send the first question of a state without waiting; `read_state` must follow before anything else."""
        self._questions = self._state_questions()
        self._ask_state(encode_request(*self._questions[0]))

    def read_state(self) -> ChamberState:
        """Take the answer to `request_state` and ask the rest."""
        first, *others = self._questions
        answers = {first: self._collected(lambda: self._request(*first), lambda: self._take_value(first[0]))}
        answers |= {question: self._value(*question) for question in others}
        self._set_point_c = answers.get(_SET_POINT, self._set_point_c)
        auxiliary_c = {number: answers[Number.GET_MEASURED, number] for number in self.auxiliary}
        return ChamberState(answers[_AIR], self._set_point_c, auxiliary_c)

    def _state_questions(self) -> list[tuple[Number, int]]:
        """Return what to ask, the air last: it ends a poll. The set point moves only by a ramp or on demand."""
        questions = [(Number.GET_MEASURED, number) for number in self.auxiliary]
        if self._polls_to_set_point == 0:
            questions.insert(0, _SET_POINT)
        self._polls_to_set_point = (self._polls_to_set_point or SET_POINT_EVERY) - 1
        return [*questions, _AIR]

    def alarms(self) -> list[str]:
        """Return active alarms and warnings in words: one exchange while there are none."""
        self._settle_input()
        status = self._status()
        if not status & (ChamberStatus.ALARM | ChamberStatus.WARNING):
            return []
        alarms = []
        for index in range(1, int(self._value(Number.MESSAGE_COUNT)) + 1):
            kind = MESSAGE_TYPES.get(int(self._value(Number.MESSAGE_TYPE, index)), "message")
            if kind != "info" and int(self._value(Number.MESSAGE_ACTIVE, index)) == 1:
                alarms.append(f"{kind}: {self._text(Number.MESSAGE_TEXT, index)}")
        return alarms or [f"chamber status {int(status)} without an active message"]

    def in_step(self) -> bool:
        """Ask for the model, which is text where all other questions of a run have a number for an answer."""

        def is_text(timeout_s: float) -> bool:
            reply = self._read(timeout_s)
            return len(reply.fields) == 1 and not _is_number(reply.fields[0])

        self._settle_input()
        self._request(Number.CHAMBER_INFO, 1)
        return pass_over(self.link, REPLY_TIMEOUT_S, is_text)

    def _send_stop(self) -> None:
        self.link.write(b"\r")
        for command in self._first_commands():
            self.link.write(encode_request(*command))

    def _way_to_rest(self) -> Iterable[Callable[[], None]]:
        gradients = ((Number.SET_GRADIENT_UP, 1, 0), (Number.SET_GRADIENT_DOWN, 1, 0))
        return (
            *(partial(self._confirm, *command) for command in self._first_commands()),
            *(partial(self._insist, *command) for command in gradients),
        )

    def _first_commands(self) -> list[tuple[Number, int, float]]:
        return [
            (Number.SET_DIGITAL_OUT, self._start_channel, 0),
            (Number.SET_SET_POINT, 1, float(self.safe_set_point_c)),
        ]

    def _demanded_c(self) -> float:
        self._settle_input()
        return self._value(*_SET_POINT)

    def _switch(self, on: bool) -> None:
        self._settle_input()
        self._command(Number.SET_DIGITAL_OUT, self._start_channel, int(on))

    def _is_running(self) -> bool:
        self._settle_input()
        return bool(self._status() & ChamberStatus.RUNNING)

    def _status(self) -> ChamberStatus:
        return ChamberStatus(int(self._value(Number.CHAMBER_STATUS)))

    def _request(self, number: Number, *arguments: object) -> None:
        """Drop late answers and send a request."""
        self.link.discard()
        self.link.write(encode_request(number, *arguments))

    def _command(self, number: Number, index: int, value: float) -> None:
        """Set a value and take its confirmation; read it back if that does not come."""

        def tell() -> None:
            self._request(number, index, value)
            reply = self._read(REPLY_TIMEOUT_S)
            self._accept(reply, number)
            if reply.fields:  # the late answer to a question
                raise self._unfit(repr(reply.fields), number, "nothing but status 1")

        def in_force() -> bool:
            return math.isclose(self._value(_READ_BACK[number], index), value, rel_tol=0.0, abs_tol=1e-3)

        command_with_retry(self.link, tell, in_force, doubt_refusal=True)

    def _value(self, number: Number, *arguments: object) -> float:
        return self._query(self._take_value, number, *arguments)

    def _text(self, number: Number, *arguments: object) -> str:
        return self._query(self._take_field, number, *arguments)

    def _query(self, take: Callable[[Number], _T], number: Number, *arguments: object) -> _T:
        def ask() -> _T:
            self._request(number, *arguments)
            return take(number)

        return query_with_retry(self.link, ask)

    def _take_value(self, number: Number) -> float:
        """Take the answer to `_request` as a finite number."""
        field = self._take_field(number)
        if not _is_number(field):
            raise self._unfit(field, number, "a number")
        return float(field)

    def _confirm(self, number: Number, *arguments: object) -> None:
        """Wait for the confirmation of a command that was sent.

        If nothing comes it is sent again on its own, in case only one line is taken at a time. Raises
        DeviceRefused or ProtocolError if only other things than a confirmation come.
        """
        with contextlib.suppress(DeviceSilent):
            self._await_confirmation(number)
            return
        self._insist(number, *arguments)

    def _insist(self, number: Number, *arguments: object) -> None:
        """Send a command and pass over replies to older requests until it is confirmed by a bare 1."""
        self.link.write(encode_request(number, *arguments))
        self._await_confirmation(number)

    def _await_confirmation(self, number: Number) -> None:
        def confirmed(timeout_s: float) -> bool:
            reply = self._read(timeout_s)
            if not reply.fields:
                self._accept(reply, number)
            return not reply.fields

        await_confirmation(self.link, REPLY_TIMEOUT_S, confirmed)

    def _take_field(self, number: Number) -> str:
        reply = self._read(REPLY_TIMEOUT_S)
        self._accept(reply, number)
        if len(reply.fields) != 1:
            raise self._unfit(repr(reply.fields), number, "one field")
        return reply.fields[0].strip()

    def _read(self, timeout_s: float) -> SimServReply:
        try:
            return decode_simserv_reply(self.link.read_until(REPLY_END, timeout_s))
        except ProtocolError as error:
            error.where = error.where or self._where
            raise

    def _accept(self, reply: SimServReply, number: Number) -> None:
        if reply.status == OK:
            return
        raise DeviceRefused(
            f"the chamber refused SimServ command {int(number)} ({number.name.lower().replace('_', ' ')})",
            where=self._where,
            found=f"status {reply.status}, {STATUS_TEXTS.get(reply.status, 'not in the list')}",
            expected="status 1",
            remedy="check the demand against the chamber's limits and that its panel allows external control",
        )

    def _unfit(self, found: str, number: Number, expected: str) -> ProtocolError:
        return misfit("chamber", f"{self._where}, SimServ command {int(number)}", found, expected)


def _is_number(field: str) -> bool:
    with contextlib.suppress(ValueError):
        return math.isfinite(float(field))
    return False
