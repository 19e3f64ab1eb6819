"""Values as text for reading."""

from __future__ import annotations

_SPACES = "\N{NO-BREAK SPACE}\N{NARROW NO-BREAK SPACE}\N{THIN SPACE}"


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
