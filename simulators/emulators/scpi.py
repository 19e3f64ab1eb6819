"""An instrument that speaks SCPI in bytes: lines, compound messages, short and long words, the error queue.

Source: SCPI-99 (syntax, error numbers), IEEE Std 488.2 (`*IDN?`, `*CLS`, `*OPC?`).
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping

from simulators.faults import DeviceFault, Fault
from simulators.interfaces import Reply

_LIMIT = 4096
_CHANNELS = re.compile(r"\(@([\d,:\s]+)\)")
_MOST_ERRORS = 20
UNDEFINED = '-113,"Undefined header"'
OUT_OF_RANGE = '-222,"Data out of range"'
MISSING = '-109,"Missing parameter"'


class Refusal(Exception):
    """A command that is not carried out; its text goes to the error queue."""


class ScpiEmulator(ABC):
    """Takes lines apart and answers them, `latency_s` after they were taken up.

    `words`: the long forms that the instrument knows, capitals being the short form. Later queries of a compound
    message are answered on the same line, after a semicolon.
    """

    words: tuple[str, ...] = ()

    def __init__(self, identity: str, latency_s: float) -> None:
        self._identity, self._latency_s = identity, latency_s
        self._input = b""
        self._free_at_s = 0.0
        self._errors: list[str] = []
        self._refusals = 0
        self._forms = {
            form: "".join(letter for letter in word if letter.isupper())
            for word in (*self.words, "SYSTem", "ERRor", "NEXT")
            for form in (word.upper(), "".join(letter for letter in word if letter.isupper()))
        }

    @abstractmethod
    def query(self, header: str, arguments: list[str], channels: list[int], now_s: float) -> str:
        """Return the answer to a query in short form ("MEAS:VOLT?"); Refusal if there is none."""

    @abstractmethod
    def command(self, header: str, arguments: list[str], channels: list[int], now_s: float) -> None:
        """Carry out a command; Refusal if it is not allowed."""

    @property
    def faults(self) -> Mapping[str, DeviceFault]:
        """`refuse`: the next `count` commands are refused: settings conflict."""
        return {"refuse": self._refuse}

    def _refuse(self, fault: Fault, now_s: float) -> None:
        self._refusals = fault.count

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take bytes the bench wrote (any chunking); LF ends a line."""
        *lines, unfinished = (self._input + data).split(b"\n")
        self._input = unfinished[-_LIMIT:]
        replies = []
        for line in lines:
            text = line.decode("latin-1").strip()
            if not text:
                continue
            self._free_at_s = max(self._free_at_s, now_s) + self._latency_s
            if answers := self._message(text, now_s):
                replies.append(Reply(self._free_at_s, ";".join(answers).encode("latin-1") + b"\n"))
        return replies

    def _message(self, text: str, now_s: float) -> list[str]:
        answers, path = [], ""
        for unit in text.split(";"):
            words, _, rest = unit.strip().partition(" ")
            try:
                if words.startswith("*"):
                    answer = self._common(words.upper())
                else:
                    header = self._header(words if words.startswith(":") or not path else f"{path}:{words}")
                    path = header.rstrip("?").rpartition(":")[0]
                    answer = self._unit(header, rest, now_s)
            except Refusal as refusal:
                self._errors = [*self._errors, str(refusal)][:_MOST_ERRORS]
                continue
            if answer is not None:
                answers.append(answer)
        return answers

    def _header(self, text: str) -> str:
        """Return a header in short form without optional words; Refusal for one with an unknown word."""
        shorts = []
        for word in text.strip(":").upper().split(":"):
            name = word.rstrip("?")
            if name not in self._forms:
                raise Refusal(UNDEFINED)
            shorts.append(self._forms[name])
        return ":".join(shorts) + ("?" if text.endswith("?") else "")

    def _common(self, word: str) -> str | None:
        if word == "*IDN?":
            return self._identity
        if word == "*OPC?":
            return "1"
        if word == "*CLS":
            self._errors.clear()
            return None
        raise Refusal(UNDEFINED)

    def _unit(self, header: str, rest: str, now_s: float) -> str | None:
        if header in ("SYST:ERR?", "SYST:ERR:NEXT?"):
            return self._errors.pop(0) if self._errors else self.no_error
        found = _CHANNELS.search(rest)
        channels = [] if found is None else _expanded(found[1])
        plain = rest if found is None else rest.replace(found[0], "")
        arguments = [part.strip() for part in plain.split(",") if part.strip()]
        if header.endswith("?"):
            return self.query(header, arguments, channels, now_s)
        if self._refusals:
            self._refusals -= 1
            raise Refusal('-221,"Settings conflict"')
        self.command(header, arguments, channels, now_s)
        return None

    no_error = '+0,"No error"'


def number(arguments: list[str], low: float, high: float) -> float:
    """Return the first argument as a number from `low` to `high`, which MIN and MAX stand for; Refusal."""
    if not arguments:
        raise Refusal(MISSING)
    named = {"MIN": low, "MINIMUM": low, "MAX": high, "MAXIMUM": high}
    try:
        value = named.get(arguments[0].upper())
        value = float(arguments[0]) if value is None else value
    except ValueError:
        raise Refusal('-104,"Data type error"') from None
    if not low <= value <= high:
        raise Refusal(OUT_OF_RANGE)
    return value


def switch(arguments: list[str]) -> bool:
    """Return the first argument as a truth value; Refusal if it is none."""
    word = arguments[0].upper() if arguments else ""
    if word not in ("0", "1", "ON", "OFF"):
        raise Refusal('-104,"Data type error"' if word else MISSING)
    return word in ("1", "ON")


def _expanded(text: str) -> list[int]:
    channels: list[int] = []
    for part in text.replace(" ", "").split(","):
        first, _, last = part.partition(":")
        channels += range(int(first), int(last or first) + 1)
    return channels
