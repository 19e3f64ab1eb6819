"""Other processes as Windows knows them: by a handle, which keeps their number from being given to another.

Untried on Windows itself; a test imitates the calls.
"""

from __future__ import annotations

from contextlib import suppress
from importlib import import_module
from typing import Any

from drivers.base.system import SELECTS_FILES

_TERMINATE, _SYNCHRONIZE = 0x0001, 0x0010_0000
_RUNS = 258
"""WAIT_TIMEOUT: what was waited for has not happened."""


def _calls() -> Any:
    try:
        return import_module("_winapi")
    except ModuleNotFoundError:
        return None


_winapi: Any = None if SELECTS_FILES else _calls()
HOLDS_PROCESSES = _winapi is not None
"""Whether this is Windows, or something that has its calls."""


def hold_process(pid: int) -> int:
    """Return a handle of a process; ProcessLookupError if there is none, PermissionError if we may not end it."""
    try:
        return int(_winapi.OpenProcess(_TERMINATE | _SYNCHRONIZE, False, pid))
    except PermissionError:
        raise
    except OSError as error:
        raise ProcessLookupError(str(error)) from error


def end_process(handle: int, timeout_s: float) -> None:
    """End a process for good and wait until it has let go of its ports and locks, at most `timeout_s`."""
    with suppress(OSError):  # it has ended
        _winapi.TerminateProcess(handle, 1)
    _winapi.WaitForSingleObject(handle, round(timeout_s * 1e3))


def has_ended(handle: int, timeout_s: float) -> bool:
    """Return whether a process has ended, now or within `timeout_s`."""
    return bool(_winapi.WaitForSingleObject(handle, round(timeout_s * 1e3)) != _RUNS)


def process_runs(pid: int) -> bool:
    """Return whether a process still runs."""
    try:
        handle = _winapi.OpenProcess(_SYNCHRONIZE, False, pid)
    except PermissionError:
        return True
    except OSError:
        return False
    try:
        return bool(_winapi.WaitForSingleObject(handle, 0) == _RUNS)
    finally:
        _winapi.CloseHandle(handle)
