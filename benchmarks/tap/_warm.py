"""`gyrobench` commands without seconds of imports: each is forked from a process that has loaded them all.

Started as `python -m benchmarks.tap._warm`; reads [working folder, file for what is said, words] a line and
answers with the pid of the command at once, and with [pid, exit status] when it has ended. The command is a
process of its own like any other, in a session of its own. Nothing is called but the command line.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import pkgutil
import select
import subprocess
import sys
import threading
from pathlib import Path

_LOADED = ("bench.present.cli", "bench.control", "bench.record", "drivers", "numpy.random", "pyarrow.parquet")


class Commands:
    """The harness's end: starts commands and waits for them, from any thread."""

    def __init__(self) -> None:
        words = [sys.executable, "-m", "benchmarks.tap._warm"]
        self._server = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._news = threading.Condition()
        self._pids: list[int] = []
        self._ended: dict[int, int] = {}
        self._starting = threading.Lock()
        threading.Thread(target=self._hear, daemon=True).start()

    def start(self, folder: Path, said: Path, *words: str) -> int:
        """Start `gyrobench` with these words; return its pid."""
        assert self._server.stdin is not None
        with self._starting:
            self._server.stdin.write(json.dumps([str(folder), str(said), words]).encode() + b"\n")
            self._server.stdin.flush()
            with self._news:
                self._news.wait_for(lambda: self._pids)
                return self._pids.pop()

    def wait(self, pid: int) -> int:
        """Wait until a command has ended; return its exit status as `os.waitpid` has it."""
        with self._news:
            self._news.wait_for(lambda: pid in self._ended)
            return self._ended.pop(pid)

    def close(self) -> None:
        """End the server."""
        self._server.communicate()

    def _hear(self) -> None:
        assert self._server.stdout is not None
        for line in self._server.stdout:
            told = json.loads(line)
            with self._news:
                if isinstance(told, int):
                    self._pids.append(told)
                else:
                    self._ended[told[0]] = told[1]
                self._news.notify_all()


def _load() -> None:
    for name in _LOADED:
        package = importlib.import_module(name)
        for module in pkgutil.walk_packages(getattr(package, "__path__", ()), f"{name}."):
            if name.startswith(("numpy", "pyarrow")) or module.name.endswith("__main__"):
                continue
            with contextlib.suppress(ImportError):  # what comes with an extra that is not here
                importlib.import_module(module.name)
    gc.freeze()


def _command(folder: str, said: str, words: list[str]) -> None:
    os.setsid()
    os.chdir(folder)
    output = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    silence = os.open(os.devnull, os.O_RDONLY)
    for descriptor, source in ((0, silence), (1, output), (2, output)):
        os.dup2(source, descriptor)
    sys.stdin, sys.stdout, sys.stderr = open(0), open(1, "w"), open(2, "w")  # noqa: SIM115
    sys.argv = ["gyrobench", *words]
    from gyrobench.__main__ import main as command_line

    command_line()


def main() -> None:
    """Serve until standard input ends."""
    _load()
    running: set[int] = set()
    requests = b""
    while True:
        if select.select([0], [], [], 0.02)[0]:
            if not (data := os.read(0, 1 << 16)):
                return
            requests += data
        *lines, requests = requests.split(b"\n")
        for line in lines:
            if not (pid := os.fork()):
                try:
                    _command(*json.loads(line))
                except SystemExit as end:
                    sys.stdout.flush()
                    os._exit(end.code if isinstance(end.code, int) else 1)
                finally:
                    os._exit(0)
            running.add(pid)
            os.write(1, b"%d\n" % pid)
        for pid in sorted(running):
            ended, status = os.waitpid(pid, os.WNOHANG)
            if ended:
                running.discard(pid)
                os.write(1, json.dumps([pid, status]).encode() + b"\n")


if __name__ == "__main__":
    main()
