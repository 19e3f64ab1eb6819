"""Values as text for reading, and as JSON for machines."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console


_SPACES = "\N{NO-BREAK SPACE}\N{NARROW NO-BREAK SPACE}\N{THIN SPACE}"


def say_json(console: Console, kind: str, **fields: Any) -> None:
    """Print one JSON object on a line; numbers that are not finite become null."""
    import json

    text = json.dumps({"kind": kind} | _finite(fields), ensure_ascii=False, allow_nan=False, default=str)
    console.file.write(text + "\n")
    console.file.flush()


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def duration(seconds: float) -> str:
    """Return a duration as h:mm:ss."""
    whole = round(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def size(count: float) -> str:
    """Return a number of bytes for reading."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000.0 or unit == "GB":
            return f"{count:.0f} {unit}" if unit == "B" else f"{count:.1f} {unit}"
        count /= 1000.0
    raise AssertionError("unreachable")


def printable(text: str, keep: str = "") -> str:
    """Return text without what a terminal would act on, save the letters in `keep`."""
    return "".join(
        letter if letter.isprintable() or letter in keep or letter in _SPACES else "\N{REPLACEMENT CHARACTER}"
        for letter in text
    )
