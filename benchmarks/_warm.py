"""A process that has collected the tests of a part: each trial is forked from it, and nothing is imported anew.

The trial gives the functions of the changed source the code that they would have had. That is the same as an
import of the changed source where only the body of functions differs that did not run before the tests; who calls
sees to that, and where it cannot be done (`Cold`), the tests run in a process that imports everything.
"""

from __future__ import annotations

import gc
import json
import os
import signal
import sys
import types
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from benchmarks._trial import Copy, Outcome, Progress, Steps, end_with_parent, wait

_COLD, _NO_SUCH_TEST = 71, 72
"""Exit statuses of a trial that has not run."""


class Cold(Exception):
    """The change cannot be made in a process that has imported the source."""


class Warm:
    """Runs tests of these files up to the first that fails, with one source of the copy changed."""

    def __init__(self, copy: Copy, files: Sequence[str], progress: Progress) -> None:
        self._copy, self._progress = copy, progress
        requests, self._requests = os.pipe()
        (self._replies, replies), (self._ends, ends) = os.pipe(), os.pipe()
        copy.clear()
        self._pid = copy.fork(
            files, [_Server(copy.root, (requests, replies, ends), progress)], keep_compiled=True
        )
        copy.lasting.add(self._pid)
        for descriptor in (requests, replies, ends):
            os.close(descriptor)
        if not os.read(self._replies, 1 << 10):
            raise RuntimeError(f"{copy.said()[-3000:]}\nthe tests are not collected")

    def run(self, file: str, limits_s: Mapping[str, float], least_s: float) -> Outcome:
        """Run the tests that limits are given for, in that order; the file is changed in the copy already.

        Raises:
            Cold: The change is not one of functions only
        """
        self._copy.clear()
        os.write(self._requests, json.dumps([file, dict(limits_s), least_s]).encode() + b"\n")
        pid = int(os.read(self._replies, 1 << 10))
        try:
            in_time = wait(self._ends, lambda: self._progress.allowed_s)
        finally:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
            status, processor_s = json.loads(os.read(self._ends, 1 << 10))
            self._copy.end_orphans()
        if os.WIFEXITED(status) and os.WEXITSTATUS(status) == _COLD:
            raise Cold
        found = self._copy.outcome(status, processor_s, in_time=in_time)
        if os.WIFEXITED(status) and os.WEXITSTATUS(status) == _NO_SUCH_TEST:
            raise RuntimeError(f"{self._copy.said()[-3000:]}\ntests that were not collected")
        return found

    def close(self) -> None:
        """End the process."""
        os.kill(self._pid, signal.SIGKILL)
        os.waitpid(self._pid, 0)
        for descriptor in (self._requests, self._replies, self._ends):
            os.close(descriptor)
        self._copy.lasting.discard(self._pid)


class _Server:
    """Pytest plug-in that goes on, once the tests are collected, in a process of its own for each request."""

    def __init__(self, root: Path, pipes: tuple[int, int, int], progress: Progress) -> None:
        self._root, self._progress = root, progress
        self._requests, self._replies, self._ends = pipes

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: Any) -> None:
        end_with_parent()
        functions = _functions(self._root)
        gc.collect()
        gc.freeze()
        os.write(self._replies, b"collected")
        with os.fdopen(self._requests, encoding="utf-8") as requests:
            while line := requests.readline():
                pid = os.fork()
                if not pid:
                    self._begin(session, functions, *json.loads(line))
                    return
                os.write(self._replies, str(pid).encode())
                _, status, usage = os.wait4(pid, 0)
                os.write(self._ends, json.dumps([status, usage.ru_utime + usage.ru_stime]).encode())
        os._exit(0)

    def _begin(
        self,
        session: Any,
        functions: Mapping[str, Sequence[types.FunctionType]],
        file: str,
        limits_s: dict[str, float],
        least_s: float,
    ) -> None:
        os.setsid()
        os.environ["PYTHONDONTWRITEBYTECODE"], sys.dont_write_bytecode = "1", True
        path = str(self._root / file)
        try:
            _exchange(functions.get(path, ()), Path(path).read_text(encoding="utf-8"), path)
        except (Cold, SyntaxError, ValueError):
            os._exit(_COLD)
        items = {item.nodeid: item for item in session.items}
        if missing := set(limits_s) - set(items):
            os.write(2, f"{sorted(missing)}\n".encode())
            os._exit(_NO_SUCH_TEST)
        session.items[:] = [items[test] for test in limits_s]
        session.config.pluginmanager.register(Steps(self._progress, limits_s, least_s))


def _functions(root: Path) -> dict[str, list[types.FunctionType]]:
    """Return the functions that there are of the sources below a folder, by file."""
    found: dict[str, list[types.FunctionType]] = {}
    for each in gc.get_objects():
        if type(each) is types.FunctionType and each.__code__.co_filename.startswith(f"{root}/"):
            found.setdefault(each.__code__.co_filename, []).append(each)
    return found


def _exchange(functions: Sequence[types.FunctionType], text: str, path: str) -> None:
    """Give functions the code that the changed source makes of them."""
    codes: dict[tuple[str, int], list[types.CodeType]] = {}
    for code in _codes(compile(text, path, "exec", dont_inherit=True)):
        codes.setdefault((code.co_qualname, code.co_firstlineno), []).append(code)
    changed = 0
    for function in functions:
        now = codes.get((function.__code__.co_qualname, function.__code__.co_firstlineno), [])
        if function.__code__ in now:
            continue
        if len(now) != 1:  # two functions of a name in a line: which is it?
            raise Cold
        function.__code__ = now[0]
        changed += 1
    if not changed:
        raise Cold


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    yield code
    for each in code.co_consts:
        if isinstance(each, types.CodeType):
            yield from _codes(each)
