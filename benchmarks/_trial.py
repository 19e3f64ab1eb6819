"""Tests in a copy of the tree, where a source may be changed: what mutants and guards have in common.

The tests run in a process forked from one that has the libraries loaded, so that none of them is imported anew.
What a trial tells while it runs lies in memory that both share: which test is running, and the processor time
that the tests so far may have taken.
"""

from __future__ import annotations

import compileall
import ctypes
import gc
import importlib
import mmap
import os
import py_compile
import re
import resource
import select
import shutil
import signal
import struct
import subprocess
import sys
import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
_PACKAGES = ("bench", "drivers", "procedures", "simulators")
_IDLE_S, _IDLE_SHARE = 20.0, 0.05
"""Tests that take less than this share of a processor for so long are waiting for what does not come."""
_WALL = 20.0
"""Wall clock that tests may take for each second of their processor time: others compute beside them."""
_POLL_S = 0.5
_MOST_BYTES = 8 << 30
_SET_CHILD_SUBREAPER, _SET_PARENT_DEATH_SIGNAL = 36, 1
"""Of prctl(2)."""
PASSED, FAILED, TIME = "passed", "failed", "out of time"
NO_TEST = "(no test)"
"""In place of the test that failed: none was run, say because a module cannot be imported."""
_LIBRARIES = (
    "numpy",
    "scipy.fft",
    "scipy.linalg",
    "scipy.optimize",
    "scipy.signal",
    "scipy.stats",
    "pandas",
    "pyarrow.parquet",
    "pydantic",
    "typer",
    "rich",
    "hypothesis.strategies",
    "pytest",
    "_pytest.assertion.rewrite",
    "can",
    "cantools",
    "serial",
    "torch",
    "statsmodels.api",
    "allantools",
    "pymodbus",
    "fsspec",
    "jinja2",
    "joblib",
)
"""Loaded once, before the processes of the tests are forked; nothing of ours."""


@dataclass(frozen=True)
class Outcome:
    """How tests ended, which failed first, and the processor time that they took, children included."""

    kind: str
    test: str
    processor_s: float


class Progress:
    """How far a trial is: the processor time that its tests so far may take, the number of the running one."""

    _FORM = struct.Struct("dq")

    def __init__(self) -> None:
        self._memory = mmap.mmap(-1, self._FORM.size)
        self.tell(0.0, -1)

    def tell(self, allowed_s: float, running: int) -> None:
        """Write it down, where the process that started the trial reads it."""
        self._FORM.pack_into(self._memory, 0, allowed_s, running)

    @property
    def allowed_s(self) -> float:
        """What the tests so far may take."""
        return float(self._FORM.unpack_from(self._memory)[0])

    @property
    def running(self) -> int:
        """The place in the order of the test that runs, or ran last; -1 if none did."""
        return int(self._FORM.unpack_from(self._memory)[1])


class Steps:
    """Pytest plug-in that runs tests in a given order and tells of each what it and those before may take."""

    def __init__(self, progress: Progress, limits_s: Mapping[str, float], least_s: float) -> None:
        self._progress, self._limits_s, self._allowed_s = progress, limits_s, least_s
        self._rank = {test: rank for rank, test in enumerate(limits_s)}
        progress.tell(least_s, -1)

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        items.sort(key=lambda item: self._rank.get(item.nodeid, -1))

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._allowed_s += self._limits_s.get(nodeid, 0.0)
        self._progress.tell(self._allowed_s, self._rank.get(nodeid, -1))


class Early(ABC):
    """A plug-in that begins before anything of ours is imported: pytest's own begin when its plug-ins are."""

    @abstractmethod
    def begin(self) -> None:
        """Begin."""


class Copy:
    """A copy of the tree, those files among it that are not committed yet."""

    def __init__(self, folder: Path) -> None:
        self.lasting: set[int] = set()
        """Processes that go on from trial to trial."""
        self.root, self._log, self._scratch = folder / "copy", folder / "log", folder / "tmp"
        _adopt_orphans()
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # what was started is ended, too
        words = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
        names = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout
        for name in names.splitlines():
            if (ROOT / name).is_file():
                (self.root / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(ROOT / name, self.root / name)
        # by content: a changed file may have its original's size and second of change
        hashed = py_compile.PycInvalidationMode.CHECKED_HASH
        for name in _PACKAGES:
            compileall.compile_dir(self.root / name, quiet=2, invalidation_mode=hashed)
        for name in _LIBRARIES:
            with suppress(ImportError):
                importlib.import_module(name)
        gc.freeze()  # else each child searches all libraries for garbage: half of a short test's time

    @contextmanager
    def changed(self, file: str, text: str) -> Iterator[None]:
        """Put a text in a file's place for a while."""
        path = self.root / file
        before = path.read_text(encoding="utf-8")
        path.write_text(text, encoding="utf-8")
        try:
            yield
        finally:
            path.write_text(before, encoding="utf-8")

    def run(
        self,
        words: Sequence[str],
        limit_s: float | Callable[[], float],
        plugins: Sequence[object] = (),
        *,
        keep_compiled: bool = False,
    ) -> Outcome:
        """Run tests up to the first that fails.

        Args:
            words: pytest's
            limit_s: processor time that the tests and what they start may take, or what returns it as they go on
            plugins: pytest's; they live in the forked process and hand on through files
            keep_compiled: whether what is imported is compiled for the next time; only where nothing is changed
        """
        self.clear()
        pid = self.fork(words, plugins, keep_compiled=keep_compiled)
        ended = os.pidfd_open(pid)
        try:
            in_time = wait(ended, limit_s if callable(limit_s) else lambda: limit_s)
        finally:
            os.close(ended)
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
            _, status, usage = os.wait4(pid, 0)
            self.end_orphans()
        return self.outcome(status, usage.ru_utime + usage.ru_stime, in_time=in_time)

    def clear(self) -> None:
        """Remove what the last trial left and printed."""
        shutil.rmtree(self._scratch, ignore_errors=True)
        self._log.write_bytes(b"")

    def fork(self, words: Sequence[str], plugins: Sequence[object], *, keep_compiled: bool = False) -> int:
        """Start pytest in a process of its own; return the process' number."""
        sys.stdout.flush()
        pid = os.fork()
        if not pid:
            self._run_and_exit(words, plugins, keep_compiled)
        return pid

    def outcome(self, status: int, processor_s: float, *, in_time: bool) -> Outcome:
        """Return how tests ended, by their process' exit status and by what they printed."""
        if not in_time:
            return Outcome(TIME, "", processor_s)
        if status == 0:
            return Outcome(PASSED, "", processor_s)
        failed = re.search(r"^(?:FAILED|ERROR) (\S+::\w+)", self.said(), re.MULTILINE)
        return Outcome(FAILED, failed[1] if failed else NO_TEST, processor_s)

    def end_orphans(self) -> None:
        """End the processes that are children of this one now that their parents have ended."""
        while children := set(_children(os.getpid())) - self.lasting:
            for child in children:
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)

    def said(self) -> str:
        """Return what the tests printed."""
        return self._log.read_text(encoding="utf-8", errors="replace")

    def _run_and_exit(self, tests: Sequence[str], plugins: Sequence[object], keep_compiled: bool) -> None:
        code = 70
        try:
            os.setsid()
            resource.setrlimit(resource.RLIMIT_DATA, (_MOST_BYTES, _MOST_BYTES))
            nothing = os.open(os.devnull, os.O_RDONLY)
            log = os.open(self._log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
            for end, descriptor in ((0, nothing), (1, log), (2, log)):
                os.dup2(descriptor, end)
            os.chdir(self.root)
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            signal.signal(
                signal.SIGINT, signal.default_int_handler
            )  # ignored where a shell started this behind
            ours = (*_PACKAGES, "benchmarks")  # from here on, they are imported from the copy
            for name in [name for name in sys.modules if name.partition(".")[0] in ours]:
                del sys.modules[name]
            sys.path[:] = [str(self.root), *(folder for folder in sys.path if Path(folder).resolve() != ROOT)]
            os.environ |= {
                "PYTHONPATH": str(self.root),
                "PYTHONDONTWRITEBYTECODE": "" if keep_compiled else "1",
            }
            sys.dont_write_bytecode = not keep_compiled
            for plugin in plugins:
                if isinstance(plugin, Early):
                    plugin.begin()
            import pytest
            from hypothesis import HealthCheck, Phase, settings

            settings.register_profile(
                "trial",
                database=None,
                deadline=None,
                derandomize=True,
                phases=(
                    Phase.explicit,
                    Phase.generate,
                ),  # whether it fails is asked, not how little is enough
                suppress_health_check=[HealthCheck.too_slow],
            )
            words = ["-x", "-p", "no:cacheprovider", "--basetemp", str(self._scratch)]
            words += ["--hypothesis-profile", "trial"]
            words += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # hypothesis is loaded already
            code = int(pytest.main([*words, *tests], plugins=[*plugins]))
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)


def wait(ended: int, limit_s: Callable[[], float]) -> bool:
    """Wait for the tests; return whether they ended within their processor time and did not hang."""
    began_s = moved_s = time.monotonic()
    before_s = _used(os.getpid())[0]
    moved_used_s = starved_s = 0.0
    while not select.select([ended], [], [], _POLL_S)[0]:
        now_s, (used_s, ready) = time.monotonic(), _used(os.getpid())
        used_s -= before_s
        starved_s += _POLL_S if ready else 0.0  # who waits for a processor does not hang
        if used_s + starved_s - moved_used_s > _IDLE_SHARE * _IDLE_S:
            moved_s, moved_used_s = now_s, used_s + starved_s
        most_s = limit_s()
        if used_s > most_s or now_s - moved_s > _IDLE_S or now_s - began_s > _WALL * most_s:
            return False
    return True


def _children(pid: int) -> list[int]:
    tables = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(word) for table in tables for word in table.read_text(encoding="ascii").split()]


def _used(pid: int) -> tuple[float, bool]:
    """Return the processor time of all processes below one, ended ones included, and whether one could run.

    See proc(5).
    """
    ticks, found, ready = 0, [pid], False
    while found:
        with suppress(OSError):
            for child in _children(found.pop()):
                found.append(child)
                text = Path(f"/proc/{child}/stat").read_text(encoding="utf-8", errors="replace")
                words = text.rpartition(")")[2].split()
                ticks += sum(int(word) for word in words[11:15])
                ready |= words[0] == "R"
    return ticks / os.sysconf("SC_CLK_TCK"), ready


def _adopt_orphans() -> None:
    """Become the parent of what tests start and leave: a watchdog that is a mutant may never end."""
    _prctl(_SET_CHILD_SUBREAPER, 1)


def end_with_parent() -> None:
    """Be ended when the process that started this one ends."""
    _prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)


def _prctl(option: int, value: int) -> None:
    if ctypes.CDLL(None, use_errno=True).prctl(option, value, 0, 0, 0):
        raise OSError(ctypes.get_errno(), "prctl")
