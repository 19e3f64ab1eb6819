"""An emulated lab in a process of its own: for other software, the wall clock, and a bench that is killed."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import suppress
from typing import Any

from drivers.base.errors import BenchError, ConfigurationError
from drivers.base.pipes import of_its_own
from drivers.base.system import SELECTS_FILES

_LOOK_S = None if SELECTS_FILES else 0.5
"""How often to look whether a lab has ended: on Windows, who waits without end does not hear Ctrl-C."""


class LabProcess:
    """The lab that a line describes (`LabConfig.to_line`), until `close`; it has ended when its output has.

    `ports`: where the devices are, by name. `clock_url`: its clock, None of one on the wall clock.
    """

    def __init__(self, line: bytes) -> None:
        self._popen = subprocess.Popen(
            [sys.executable, "-P", "-m", "simulators.lab"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            **of_its_own(),  # Ctrl-C is for the bench: the lab lives until the bench lets go of it
        )
        assert self._popen.stdin is not None and self._popen.stdout is not None
        self._stdin, self._stdout = self._popen.stdin, self._popen.stdout
        try:
            ready = self.perform(line)
            if "refused" in ready:
                raise ConfigurationError(**ready["refused"])
        except BaseException:
            self.close()
            raise
        self.ports: dict[str, str] = ready["ports"]
        self.clock_url: str | None = ready["clock"]

    def perform(self, line: bytes) -> dict[str, Any]:
        """Write a line to the control channel and return the answer; BenchError if the lab has ended."""
        with suppress(OSError):  # it has ended, which the answer that does not come says
            self._stdin.write(line + b"\n")
            self._stdin.flush()
        if not (answer := self._stdout.readline()):
            raise BenchError(
                "the emulated lab ended before it was asked to", remedy="its own output says why"
            )
        said: dict[str, Any] = json.loads(answer)
        return said

    def wait(self) -> None:
        """Wait until it has ended."""
        while self._popen.poll() is None:
            with suppress(subprocess.TimeoutExpired):
                self._popen.wait(_LOOK_S)

    def kill(self) -> None:
        """End it at once."""
        self._popen.kill()

    def close(self) -> None:
        """Close the control channel: the lab's process ends."""
        with suppress(OSError):
            self._stdin.close()
        try:
            self._popen.wait(timeout=10.0)
        except subprocess.TimeoutExpired:
            self._popen.kill()
            self._popen.wait()
        self._stdout.close()
