"""Questions to a human, and who answers them."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol


@dataclass(frozen=True)
class Question:
    """Something hands have to do or eyes have to confirm.

    `act` says the same to a machine, e.g. {"act": "mount", "unit": "gyro_1", "mounting": "axis_up"}: whoever
    answers for an emulated lab performs it there.
    """

    text: str
    act: dict[str, Any] = field(default_factory=dict)


class Operator(Protocol):
    """Whoever answers."""

    name: str

    def ask(self, question: Question) -> Callable[[], str | None]:
        """Put the question; the returned function gives the answer, or None while there is none yet."""
        ...


class AssumeYes:
    """Answers every question beforehand, for unattended runs on a prepared bench."""

    name = "answered beforehand"

    def ask(self, question: Question) -> Callable[[], str | None]:
        """Answer at once."""
        return lambda: "yes"


class StageHand:
    """Answers by doing the act in the emulated lab; `perform` sends it there and returns the lab's answer."""

    name = "emulated operator"

    def __init__(self, perform: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        self._perform = perform

    def ask(self, question: Question) -> Callable[[], str | None]:
        """Do the act, then answer."""
        if question.act:
            self._perform(dict(question.act))
        return lambda: "done"


class Console:
    """Asks on the terminal; a thread waits for the line so that telemetry goes on meanwhile."""

    name = "console"

    def __init__(self, prompt: Callable[[str], str]) -> None:
        self._prompt = prompt

    def ask(self, question: Question) -> Callable[[], str | None]:
        """Show the question and wait for a line in the background."""
        answers: queue.Queue[str] = queue.Queue()
        thread = threading.Thread(
            target=lambda: answers.put(self._prompt(question.text)), name="operator", daemon=True
        )
        thread.start()

        def answer() -> str | None:
            try:
                return answers.get_nowait()
            except queue.Empty:
                return None

        return answer
