"""python-can's own back-to-back tests on our interface: two slcan adapters on one bus, by pseudo-terminals."""

from __future__ import annotations

import importlib
import logging
import os
import select
import sys
import threading
import tty
import unittest
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from simulators.emulators.slcan import SlcanAdapter

_INTERFACE, _BITRATE = "gyrobench_slcan", 500_000


class Bus:
    """Two adapters on pseudo-terminals: a frame that one accepts comes out of the other."""

    def __init__(self) -> None:
        self._ends = [os.openpty() for _ in range(2)]
        for _, end in self._ends:
            tty.setraw(end)
        self.channels = [os.ttyname(end) for _, end in self._ends]
        self._adapters = [SlcanAdapter(_BITRATE) for _ in self._ends]
        self._lines = [b"", b""]
        self._changed = threading.Condition()
        threading.Thread(target=self._serve, daemon=True).start()

    def wait(self) -> None:
        """Wait until both channels are open."""
        with self._changed:
            self._changed.wait_for(lambda: all(adapter.passing for adapter in self._adapters), timeout=5.0)

    def _serve(self) -> None:
        masters = [master for master, _ in self._ends]
        while True:
            for master in select.select(masters, [], [])[0]:
                self._take(masters.index(master), os.read(master, 4096))

    def _take(self, number: int, data: bytes) -> None:
        *lines, self._lines[number] = (self._lines[number] + data).split(b"\r")
        for line in lines:
            answer = b"".join(reply.data for reply in self._adapters[number].receive(line + b"\r", 0.0))
            if (
                line[:1] in (b"t", b"T", b"r", b"R")
                and answer == b"\r"
                and self._adapters[1 - number].passing
            ):
                os.write(self._ends[1 - number][0], line + b"\r")
            os.write(self._ends[number][0], answer)
        with self._changed:
            self._changed.notify_all()


def back_to_back(source: Path) -> Iterator[tuple[str, str]]:
    """Yield each test's name and result; the tests run on the python-can that is installed."""
    logging.disable(logging.CRITICAL)
    importlib.import_module("can")
    sys.path.insert(0, str(source))
    os.environ.pop("CI", None)
    tests = importlib.import_module("test.back2back_test").Back2BackTestCase
    bus = Bus()
    keys: dict[str, Any] = {"INTERFACE_1": _INTERFACE, "INTERFACE_2": _INTERFACE, "TIMEOUT": 1.0}
    keys["CHANNEL_1"], keys["CHANNEL_2"] = bus.channels

    def set_up(test: Any) -> None:
        tests.setUp(test)
        bus.wait()

    keys["setUp"] = set_up
    for module in ("test.config", "test.back2back_test"):
        vars(sys.modules[module])["TEST_CAN_FD"] = False
    ours: Any = type("OnSlcan", (tests,), keys)
    for name in unittest.defaultTestLoader.getTestCaseNames(ours):
        result = unittest.TestResult()
        ours(name).run(result)
        words = _words(result)
        for channel in bus.channels:
            words = words.replace(f"{channel} ({channel}): ", "")
        yield name, words


def _words(result: unittest.TestResult) -> str:
    """Say how a test ended; what classic CAN or one port for one program cannot do is refused in words."""
    if result.skipped:
        return f"skipped by python-can: {result.skipped[0][1]}"
    if not result.errors + result.failures:
        return "passes"
    last = (result.errors + result.failures)[0][1].strip().splitlines()[-1]
    error, _, text = last.partition(": ")
    refused = error.rpartition(".")[2] in ("NotClassicCan", "ConfigurationError")
    reason = text or last
    found = reason.rfind("Found")
    return f"{'refused' if refused else 'fails'}: {reason[:found].strip() if found > 0 else reason}"
