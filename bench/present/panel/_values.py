"""What stands in live files, whatever wrote them, as something that can be shown."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

_LARGEST = 1e300


def number_of(value: object) -> float | None:
    """Return a number of a file as one that can be drawn, None for what is none."""
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST:
        return float(value)
    return None


def table_of(value: object) -> Mapping[str, Any]:
    """Return a table of a file, an empty one for what is none."""
    return value if isinstance(value, dict) else {}


def fresh(device: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """Return what a device says, nothing if it no longer does."""
    return {} if not device or device.get("stale") else device


def rounded(value: float, digits: int) -> float | None:
    """Return a number with so many digits, None for none."""
    return float(f"{value:.{digits}g}") if math.isfinite(value) else None
