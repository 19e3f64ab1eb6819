"""CAN layouts named in a bench file, compiled when it is read: a run keeps what it was decoded by."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bench.record.benchfile._checks import Mistake
from drivers.base.errors import ConfigurationError


def with_layouts(data: Mapping[str, Any], folder: Path) -> tuple[dict[str, Any], list[Mistake]]:
    """Return a bench file's data with every gyro's `layout` compiled, and what is wrong with layouts.

    `folder`: where relative paths of mapping files start. A layout that cannot be used is left as it is.
    """
    gyros = data.get("gyro")
    if not isinstance(gyros, list):
        return dict(data), []
    mistakes: list[Mistake] = []
    compiled = []
    for at, section in enumerate(gyros):
        layout = section.get("layout") if isinstance(section, dict) else None
        if isinstance(layout, (str, dict)) and section.get("driver") == "can_dbc":
            try:
                section = {**section, "layout": _compiled(layout, section.get("axes"), folder)}
            except ConfigurationError as error:
                found = ": ".join(part for part in (error.where, error.what, error.found) if part)
                mistakes.append(Mistake(f"gyro[{at}].layout", found, error.expected))
        compiled.append(section)
    return {**data, "gyro": compiled}, mistakes


def _compiled(layout: str | dict[str, Any], axes: object, folder: Path) -> dict[str, Any]:
    from drivers.can_dbc import layout_from_plain, resolve_layout  # only a bench with such a gyro needs it

    plain = resolve_layout(layout, folder)
    have = "".join(layout_from_plain(plain).rates())
    if isinstance(axes, str) and not set(axes) <= set(have):
        raise ConfigurationError(
            "the layout lacks an axis that the gyro is said to have",
            found=f"axes {have!r}",
            expected=repr(axes),
        )
    return plain
