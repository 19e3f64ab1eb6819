"""A run folder as a row of the catalogue; periods of time as an operator writes them."""

from __future__ import annotations

import calendar
import datetime
import json
import re
import socket
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from bench.record.run_folder import MANIFEST_FILE
from drivers.base.errors import ConfigurationError
from drivers.base.files import MANIFEST_BYTES, parse_json, read_bounded

_PERIOD = re.compile(r"^(\d{4})(?:-(\d{2})(?:-(\d{2})(?:[T ](\d{2}):(\d{2})(?::(\d{2}))?)?)?)?$")


@dataclass(frozen=True)
class CatalogueRow:
    """A run in a list; outcome "unreadable" with `reason` for a folder whose manifest cannot be read.

    `root`: host and folder that it lies in. `started_s`: seconds since 1970-01-01 UTC.
    """

    root: str
    name: str
    run_id: str
    procedure: str
    bench: str
    outcome: str
    reason: str
    started_s: float
    duration_s: float | None
    units: tuple[str, ...]


COLUMNS = tuple(field.name for field in fields(CatalogueRow))
"""Of the table of runs, too."""


def root_name(runs: Path) -> str:
    """Return the name under which a folder of runs is known: host and absolute path."""
    return f"{socket.gethostname()}:{runs.resolve()}"


def period_s(text: str) -> tuple[float, float]:
    """Return start and end of a year, month, day, minute or second in UTC, s since 1970; ConfigurationError."""
    match = _PERIOD.match(text.strip().removesuffix("Z"))
    given = [int(part) for part in match.groups() if part is not None] if match else []
    try:
        start = datetime.datetime(*[*given, *[1, 1][len(given) - 1 :]], tzinfo=datetime.UTC)  # type: ignore[misc,arg-type]
    except (ValueError, TypeError, IndexError) as error:
        raise ConfigurationError(
            "no date", found=text, expected="such as 2026, 2026-10, 2026-10-05 or 2026-10-05T08:30 (UTC)"
        ) from error
    if len(given) == 1:
        days = 366 if calendar.isleap(start.year) else 365
    elif len(given) == 2:
        days = calendar.monthrange(start.year, start.month)[1]
    else:
        days = 1
    length_s = 86_400.0 * days if len(given) <= 3 else 60.0 if len(given) == 5 else 1.0
    return start.timestamp(), start.timestamp() + length_s


def read_row(folder: Path, root: str) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return a run folder as a row of the catalogue, and its units; what cannot be read says why."""
    row: dict[str, Any] = {
        "root": root,
        "name": folder.name,
        "run_id": folder.name,
        "procedure": "",
        "bench": "",
        "outcome": "unreadable",
        "reason": "",
        "started_s": 0.0,
        "duration_s": None,
        "units": "[]",
    }
    try:
        manifest = parse_json(read_bounded(folder / MANIFEST_FILE, MANIFEST_BYTES))
        units = tuple(dict.fromkeys(_text(unit) for unit in manifest.get("units", {}).values()))
        started = datetime.datetime.fromisoformat(str(manifest["started_utc"]))
        started = started if started.tzinfo else started.replace(tzinfo=datetime.UTC)
        bench = manifest.get("bench", {}).get("bench", {})
        duration = manifest.get("duration_s")
        row |= {
            "run_id": _text(manifest["run_id"]),
            "procedure": _text(manifest["procedure"]),
            "bench": _text(bench.get("name", "")),
            "reason": _text(manifest.get("reason", "")),
            "started_s": started.timestamp(),
            "duration_s": None if duration is None else float(duration),
            "units": json.dumps(units, ensure_ascii=False),
            "outcome": _text(manifest["outcome"]),
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        return row | {"reason": f"{MANIFEST_FILE}: {type(error).__name__}: {error}"}, ()
    return row, units


def _text(value: object) -> str:
    """Return text that every database takes: no half characters, no zero bytes."""
    return str(value).encode("utf-8", "replace").decode().replace("\0", "\N{REPLACEMENT CHARACTER}")
