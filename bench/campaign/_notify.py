"""Tells people: a program, an address or a file gets a JSON message. Nothing here can hold up or fail a run."""

from __future__ import annotations

import json
import subprocess
import threading
import urllib.request
from collections import deque
from collections.abc import Callable
from http.client import HTTPException
from typing import Any

from bench.campaign._file import Notice
from bench.control.questions import Operator, Question, Reply
from bench.record.events.campaign import Notified
from drivers.base.clock import utc_now

_TIMEOUT_S = 20.0


class Notifier:
    """Sends messages in the background; `sent` has what became of each."""

    def __init__(self, notices: tuple[Notice, ...], title: str) -> None:
        self.sent: deque[Notified] = deque()
        self._notices = notices
        self._title = title
        self._threads: list[threading.Thread] = []

    def tell(self, occasion: str, text: str, **fields: Any) -> None:
        """Tell everybody who wants to know of such an occasion."""
        message = {"campaign": self._title, "on": occasion, "text": text, "utc": utc_now()} | fields
        for notice in self._notices:
            if occasion in notice.on:
                thread = threading.Thread(
                    target=self._send, args=(notice, message), name="notify", daemon=True
                )
                thread.start()
                self._threads.append(thread)

    def wait(self) -> None:
        """Wait until all messages are sent or given up."""
        while self._threads:
            self._threads.pop().join(2.0 * _TIMEOUT_S)

    def _send(self, notice: Notice, message: dict[str, Any]) -> None:
        body = json.dumps(message, ensure_ascii=False, default=str).encode() + b"\n"
        problem = ""
        try:
            if notice.command is not None:
                problem = _run(notice.command, body)
            elif notice.webhook is not None:
                headers = {"Content-Type": "application/json"}
                request = urllib.request.Request(notice.webhook, body, headers)
                urllib.request.urlopen(request, timeout=_TIMEOUT_S).close()
            elif notice.file is not None:
                with notice.file.open("ab") as file:
                    file.write(body)
        except (OSError, ValueError, HTTPException, subprocess.SubprocessError) as error:
            problem = f"{type(error).__name__}: {error}"
        to = notice.webhook or str(notice.file or (notice.command or ("",))[0])
        self.sent.append(Notified(str(message["on"]), to, problem))


class Announcing:
    """An operator who is told of every question, e.g. on a phone, and then asked as ever."""

    def __init__(self, operator: Operator, notifier: Notifier) -> None:
        self._operator, self._notifier = operator, notifier

    def ask(self, question: Question) -> Callable[[], Reply | None]:
        """Tell, then ask."""
        self._notifier.tell("prompt", question.text)
        return self._operator.ask(question)


def _run(command: tuple[str, ...], body: bytes) -> str:
    """Run a program with the message on its standard input: its arguments are the file's, never the message's."""
    done = subprocess.run(command, input=body, capture_output=True, timeout=_TIMEOUT_S, check=False)
    said = done.stderr.decode("utf-8", "replace").strip()[-200:]
    return f"ended with {done.returncode}: {said}" if done.returncode else ""
