"""The control channel: one JSON object a line on standard input, answered on standard output.

It is for what hands do in a real lab (mount a unit, close a door) and for what only an emulated lab can tell
(the true drift). The process ends when standard input does, so a lab never outlives whoever started it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from io import FileIO
from typing import Any

from drivers.base.errors import BenchError
from drivers.base.pipes import pumped_in
from drivers.base.system import SELECTS_FILES

Act = Callable[[dict[str, Any]], dict[str, Any]]


def perform(acts: Mapping[str, Act], line: bytes) -> dict[str, Any]:
    """Do what {"act": name, ...} asks for; return {"ok": true, ...} or {"ok": false, "error": text}."""
    try:
        request = json.loads(line)
        act = acts[request.pop("act")]
        return {"ok": True, **act(request)}
    except BenchError as error:
        return {"ok": False, "error": str(error)}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        return {"ok": False, "error": f"{type(error).__name__}: {error}"}


class ControlChannel:
    """Reads requests, a line each, and answers them (`perform`)."""

    def __init__(self, acts: Mapping[str, Act], *, input_fd: int = 0, output_fd: int = 1) -> None:
        self._acts = acts
        self._input, self._output = input_fd, output_fd
        self._read: Callable[[int], bytes] = partial(os.read, input_fd)
        if not SELECTS_FILES:
            source = pumped_in(FileIO(input_fd, closefd=False))
            self._input, self._read = source.fileno(), source.recv
        self._pending = b""

    def fileno(self) -> int:
        """Return the descriptor to select on."""
        return self._input

    def say(self, message: dict[str, Any]) -> None:
        """Write one line; if whoever should hear it has gone, the closed channel ends the lab."""
        view = memoryview(json.dumps(message).encode() + b"\n")
        with suppress(OSError):
            while view:
                view = view[os.write(self._output, view) :]

    def answer(self) -> bool:
        """Answer what has arrived; False when the channel is closed."""
        data = self._read(65536)
        if not data:
            return False
        self._pending += data
        *lines, self._pending = self._pending.split(b"\n")
        for line in lines:
            if line.strip():
                self.say(perform(self._acts, line))
        return True
