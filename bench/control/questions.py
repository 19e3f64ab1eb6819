"""Questions to a human, and who answers them."""

from __future__ import annotations

import fnmatch
import getpass
import queue
import re
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

from bench.record.events import Role
from bench.record.events.run import BEFOREHAND, Answer
from drivers.base.errors import RunAborted
from drivers.base.files import encodable

_EMULATED = "emulated operator"
_YES, _NO = ("yes", "y", "done", "ok", "ready"), ("no", "n", "abort", "stop")
_ASKED = 10
"""Times that a question is put anew after answers that are neither yes nor no."""


@dataclass(frozen=True)
class Question:
    """Something hands have to do or eyes have to confirm.

    `act` says the same to a machine, e.g. {"act": "mount", "unit": "gyro_1", "mounting": "axis_up"}: whoever
    answers for an emulated lab performs it there.
    """

    text: str
    act: dict[str, Any] = field(default_factory=dict)
    picture: str | None = None
    """A file of the run folder that shows what is meant."""

    @property
    def shown(self) -> str:
        """The text for those who see no pictures, with where the picture lies."""
        return f"{self.text} (see {self.picture} in the run folder)" if self.picture else self.text

    def answered(self, reply: Reply) -> Answer:
        """Return what the record says of a reply: whose it is, and what the question asked to be done."""
        act = dict(self.act)
        what, mounting = act.pop("act", None), act.pop("mounting", None)
        return Answer(self.text, reply.answer, reply.by, what, mounting, act, reply.role)


class Reply(NamedTuple):
    """What somebody answered, and who; `role`: as which they were signed in at the panel."""

    answer: str
    by: str
    role: Role | None = None


def consents(answer: str) -> bool | None:
    """Return whether an answer begins with a yes (yes, done, ok, ready) or a no (no, abort, stop); None: neither.

    A remark may follow: "done, torque 5 Nm".
    """
    word = next(iter(re.findall(r"[^\W\d_]+", answer.casefold())), "")
    return word in _YES if word in _YES + _NO else None


def agreed(question: Question, put: Callable[[Question], Reply], note: Callable[[str], None]) -> Reply:
    """Put a question until somebody says yes, and return that reply; RunAborted for a no.

    What is neither is told to `note` and asked again, some times: an Enter is no consent.
    """
    for _ in range(_ASKED):
        reply = put(question)
        said = consents(reply.answer)
        if said is False:
            raise RunAborted(f"the operator answered {reply.answer!r} to: {question.text}")
        if said:
            return reply
        note(f"{reply.answer!r} by {reply.by} is neither yes nor no, asked again: {question.text}")
    raise RunAborted(
        f"nobody said yes or no in {_ASKED} answers to: {question.text}",
        expected=f"an answer that begins with {', '.join(_YES + _NO)}",
    )


class Operator(Protocol):
    """Whoever answers."""

    def ask(self, question: Question) -> Callable[[], Reply | None]:
        """Put the question; the returned function gives the answer, or None while there is none yet."""


class AssumeYes:
    """Answers every question beforehand, for unattended runs on a prepared bench."""

    def __init__(self, answer: str = "yes", by: str = BEFOREHAND) -> None:
        self._reply = Reply(answer, by)

    def ask(self, question: Question) -> Callable[[], Reply | None]:
        """Answer at once."""
        return lambda: self._reply


class Assisted:
    """Does in the emulated lab what the operator says is done; `perform` sends an act there."""

    def __init__(self, operator: Operator, perform: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        self._operator, self._perform = operator, perform

    def ask(self, question: Question) -> Callable[[], Reply | None]:
        """Put the question; the act follows the answer."""
        answered = self._operator.ask(question)

        def answer() -> Reply | None:
            reply = answered()
            if reply is not None and question.act and consents(reply.answer):
                self._perform(dict(question.act))
                if reply.by == BEFOREHAND:  # now somebody did it
                    return reply._replace(by=_EMULATED)
            return reply

        return answer


class EmulatedOperator(Assisted):
    """Does every act in the emulated lab, and says so."""

    def __init__(self, perform: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        super().__init__(AssumeYes("done", _EMULATED), perform)


class Prepared:
    """Answers what somebody wrote down beforehand, and passes on what nobody foresaw.

    `answers`: (pattern, answer), the pattern as in file names (`*`, `?`), compared with the question's text; the
    first that matches counts. `otherwise` answers the rest.
    """

    def __init__(self, answers: Sequence[tuple[str, str]], by: str, otherwise: Operator) -> None:
        self._by, self._answers, self._otherwise = by, tuple(answers), otherwise

    def ask(self, question: Question) -> Callable[[], Reply | None]:
        """Look the question up, or pass it on."""
        for pattern, prepared in self._answers:
            if fnmatch.fnmatchcase(question.text, pattern):
                return lambda: Reply(prepared, self._by)
        return self._otherwise.ask(question)


class Console:
    """Asks on the terminal; a thread waits for the line so that telemetry goes on meanwhile.

    A question that was answered elsewhere leaves the thread waiting: its line then answers the next question.
    `say` shows that next question.
    """

    def __init__(self, prompt: Callable[[str], str], say: Callable[[str], None] | None = None) -> None:
        self.name = f"{user_name()} at the console"
        self._prompt, self._say = prompt, say
        self._lines: queue.Queue[tuple[int, str]] = queue.Queue()
        self._number = 0
        self._waiting = False
        self._lock = threading.Lock()

    def ask(self, question: Question) -> Callable[[], Reply | None]:
        """Show the question and wait for a line in the background."""
        with self._lock:
            self._number += 1
            mine = self._number
            waiting, self._waiting = self._waiting, True
        if not waiting:
            self._read(question.shown)
        elif self._say is not None:
            self._say(question.shown)

        def answer() -> Reply | None:
            try:
                number, line = self._lines.get_nowait()
            except queue.Empty:
                return None
            if number == mine:
                return Reply(line, self.name)
            with self._lock:
                self._waiting = True
            self._read(question.shown)  # that line was for an earlier question
            return None

        return answer

    def _read(self, text: str) -> None:
        def read() -> None:
            try:
                drop_typed()
                line = self._prompt(text)
            except EOFError:  # no terminal: somebody else has to answer
                return
            except UnicodeDecodeError as error:  # it is no answer, and is asked again
                line = repr(error.object)
            with self._lock:
                self._waiting = False
                self._lines.put((self._number, encodable(line)))

        threading.Thread(target=read, name="operator", daemon=True).start()


def drop_typed() -> None:
    """Drop what was typed on the terminal before a question: it answers none."""
    with suppress(ImportError, OSError, ValueError):  # Windows, no terminal, or none any more
        import termios

        if sys.stdin.isatty():
            termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)


def user_name() -> str:
    """Return the name of the user whose process this is."""
    try:
        return getpass.getuser()
    except (OSError, KeyError):
        return "somebody"
