"""What others bring: packages by entry points (looked up once: that takes 6 ms), extras, and a file."""

from __future__ import annotations

import runpy
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoints, entry_points
from pathlib import Path
from typing import Any, cast

from drivers.base.errors import ConfigurationError

_EXTRA_OF = {"pandas": "analysis", "scipy": "analysis"}
"""Top-level package -> the extra of gyrobench that brings it, for those that are imported where they are used."""


@cache
def entry_points_of(group: str) -> EntryPoints:
    """Return the entry points of a group. A package installed while the process runs is not seen."""
    return cast(EntryPoints, _all().select(group=group))


def from_extra(module: str, extra: str, what: str) -> Any:
    """Return a module that comes with an extra of gyrobench; ConfigurationError names the extra without it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise _needs(what, module, extra, error) from error


def needs_extra(error: ModuleNotFoundError, what: str) -> ConfigurationError | None:
    """Return the error that names the extra with the package that is missing; None if no extra of ours has it."""
    package = (error.name or "").partition(".")[0]
    return _needs(what, package, _EXTRA_OF[package], error) if package in _EXTRA_OF else None


def _needs(what: str, package: str, extra: str, error: ImportError) -> ConfigurationError:
    return ConfigurationError(
        f"{what} needs the package {package}",
        found=str(error),
        expected=f"the extra `{extra}`",
        remedy=f"pip install 'gyrobench[{extra}]'",
    )


def names_of_file(path: Path) -> dict[str, Any]:
    """Return what a Python file beside somebody's data defines, name -> value; its code runs.

    ConfigurationError for a file that cannot be read or that fails.
    """
    try:
        return runpy.run_path(str(path))
    except Exception as error:  # whatever somebody's code raises
        raise ConfigurationError(
            "the Python file cannot be used",
            where=str(path),
            found=f"{type(error).__name__}: {error}",
            expected="a file that Python can run",
        ) from error


@cache
def _all() -> Any:
    return entry_points()
