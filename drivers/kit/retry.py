"""A line may damage or lose an answer: questions are asked again, commands read back, a few times and no more.

Nothing is added to an exchange that goes well. After one that did not, whatever is still on its way is waited for
and dropped, and a question is asked whose answer is unlike any other (`Link.fence`), lest the late answer to one
question be taken for that to the next. Every repeat is told to `Link.on_retry` with what was received.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

from drivers.base.errors import BenchError, DeviceRefused, DeviceSilent, ProtocolError
from drivers.kit.link import Link

RETRY_TIMEOUT_S = 4.5
"""No repeat begins later than this after the first try: a device that stays dead is known to be soon."""

_TROUBLES = (DeviceSilent, ProtocolError, DeviceRefused)

_T = TypeVar("_T")


def query_with_retry(link: Link, question: Callable[[], _T]) -> _T:
    """Return what `question` returns, a query that changes nothing; again if its answer is damaged or missing.

    `question` is one exchange: of several under one roof, the late answer to one is taken for that to another.
    A refusal counts as damage: a question that met a flipped bit on its way is refused. An answer after a trouble
    is believed when nothing follows it; else it was the late one to the question before, and it is asked anew.
    """
    begun_s = link.clock.now()
    trouble: BenchError | None = None
    for left in range(link.retries, -1, -1):
        last = not left or link.retrying
        try:
            if trouble is not None:
                _fence(link, trouble)
            answer = question()
        except _TROUBLES as error:
            if last or link.clock.now() - begun_s > RETRY_TIMEOUT_S:
                raise
            link.on_retry(error)
            link.drain()
            trouble = error
            continue
        if last or trouble is None or not link.drain():
            return answer
    raise AssertionError("unreachable")


def command_with_retry(
    link: Link,
    command: Callable[[], None],
    in_force: Callable[[], bool] | None = None,
    *,
    doubt_refusal: bool = False,
) -> None:
    """Carry out `command`; if it is not confirmed, read back whether it is `in_force`, else tell it again.

    `command` must do the same when it is done twice. A refusal is never told again. `doubt_refusal`: on a line
    without a check value it may be a damaged yes; it is raised unless what was told is in force.
    """
    begun_s = link.clock.now()
    for left in range(link.retries, -1, -1):
        try:
            command()
        except _TROUBLES as error:
            refused = isinstance(error, DeviceRefused)
            if not link.retries or link.retrying or (refused and not doubt_refusal):
                raise
            link.drain()
            if in_force is not None and _holds(link, in_force):
                link.on_retry(error)
                return
            if not left or refused or link.clock.now() - begun_s > RETRY_TIMEOUT_S:
                raise
            link.on_retry(error)
            continue
        if left < link.retries:
            link.drain()
        return


def command_once(link: Link, command: Callable[[], None], done: Callable[[], bool]) -> None:
    """Carry out a `command` that must not be done twice; if it is not confirmed, only if it was not `done`.

    What `done` raises ends it: rather no turn than two.
    """
    for left in range(link.retries, -1, -1):
        try:
            command()
        except _TROUBLES as error:
            if not link.retries or link.retrying:
                raise
            link.drain()
            link.on_retry(error)
            if done():
                return
            if not left or isinstance(error, DeviceRefused):
                raise
            continue
        if left < link.retries:
            link.drain()
        return


def await_confirmation(link: Link, timeout_s: float, confirmed: Callable[[float], bool]) -> None:
    """Pass over replies to older commands until one confirms the last that was sent.

    `confirmed` reads a reply in so many seconds. What else came is raised when nothing more does in `timeout_s`.
    """
    deadline_s = link.clock.now() + timeout_s
    problem: BenchError | None = None
    while True:
        try:
            if confirmed(deadline_s - link.clock.now()):
                return
        except (DeviceRefused, ProtocolError) as error:
            problem = error
        except DeviceSilent as error:
            raise (problem or error) from error


def pass_over(link: Link, timeout_s: float, is_mine: Callable[[float], bool]) -> bool:
    """Wait for the one answer that no other question has; return whether it was the first to come.

    `is_mine` reads an answer in so many seconds. ProtocolError if others come and not that one, DeviceSilent if
    nothing does.
    """
    first = True

    def confirmed(timeout_s: float) -> bool:
        nonlocal first
        if is_mine(timeout_s):
            return True
        first = False
        raise ProtocolError(
            "answers to earlier questions come, and not that to the last",
            where=link.where,
            found="an answer that fits another question",
            expected="one answer to each question",
            remedy="check for an adapter that holds answers back, and that nobody else talks on the line",
        )

    await_confirmation(link, timeout_s, confirmed)
    return first


def misfit(whose: str, where: str, found: str, expected: str) -> ProtocolError:
    """Return the error for an answer that is none to the question."""
    return ProtocolError(
        f"the {whose}'s answer does not fit the question",
        where=where,
        found=found,
        expected=expected,
        remedy="check the line for lost bytes and that nobody else talks on it",
    )


def _fence(link: Link, trouble: BenchError) -> None:
    """Have the line in step again after a `trouble`, or raise that; a refusal is an answer and needs no more."""
    if isinstance(trouble, DeviceRefused):
        return
    try:
        link.fence()
    except _TROUBLES as error:
        raise trouble from error


def _holds(link: Link, in_force: Callable[[], bool]) -> bool:
    link.retrying = True
    try:
        with suppress(*_TROUBLES):
            link.fence()
        return in_force()
    except _TROUBLES:
        return False
    finally:
        link.retrying = False
