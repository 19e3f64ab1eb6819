"""What other packages bring: by entry points, looked up once a process since that takes 6 ms, and by extras."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoints, entry_points
from typing import Any, cast

from drivers.base.errors import ConfigurationError


@cache
def entry_points_of(group: str) -> EntryPoints:
    """Return the entry points of a group. A package installed while the process runs is not seen."""
    return cast(EntryPoints, _all().select(group=group))


def from_extra(module: str, extra: str, what: str) -> Any:
    """Return a module that comes with an extra of gyrobench; ConfigurationError names the extra without it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise ConfigurationError(
            f"{what} needs the package {module}",
            found=str(error),
            expected=f"the extra `{extra}`",
            remedy=f"pip install 'gyrobench[{extra}]'",
        ) from error


@cache
def _all() -> Any:
    return entry_points()
