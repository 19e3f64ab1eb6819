"""A run folder as a row of the catalogue; periods of time as an operator writes them."""

from __future__ import annotations

import calendar
import datetime
import re
import socket
from dataclasses import dataclass, fields
from pathlib import Path

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
    procedure: str = ""
    bench: str = ""
    outcome: str = "unreadable"
    reason: str = ""
    started_s: float = 0.0
    duration_s: float | None = None
    units: tuple[str, ...] = ()


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
    length_s = {
        1: 86_400.0 * (365 + calendar.isleap(start.year)),
        2: 86_400.0 * calendar.monthrange(start.year, start.month)[1],
        3: 86_400.0,
        5: 60.0,
        6: 1.0,
    }[len(given)]
    return start.timestamp(), start.timestamp() + length_s


def read_row(folder: Path, root: str) -> CatalogueRow:
    """Return a run folder as a row of the catalogue; what cannot be read says why."""
    try:
        manifest = parse_json(read_bounded(folder / MANIFEST_FILE, MANIFEST_BYTES))
        started = datetime.datetime.fromisoformat(str(manifest["started_utc"]))
        started = started if started.tzinfo else started.replace(tzinfo=datetime.UTC)
        duration = manifest.get("duration_s")
        return CatalogueRow(
            root=root,
            name=folder.name,
            run_id=_text(manifest["run_id"]),
            procedure=_text(manifest["procedure"]),
            bench=_text(manifest.get("bench", {}).get("bench", {}).get("name", "")),
            outcome=_text(manifest["outcome"]),
            reason=_text(manifest.get("reason", "")),
            started_s=started.timestamp(),
            duration_s=None if duration is None else float(duration),
            units=tuple(dict.fromkeys(_text(unit) for unit in manifest.get("units", {}).values())),
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        reason = f"{MANIFEST_FILE}: {type(error).__name__}: {error}"
        return CatalogueRow(root, folder.name, folder.name, reason=reason)


def _text(value: object) -> str:
    """Return text that every database takes: no half characters, no zero bytes."""
    return str(value).encode("utf-8", "replace").decode().replace("\0", "\N{REPLACEMENT CHARACTER}")
