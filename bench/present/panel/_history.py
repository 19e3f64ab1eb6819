"""The page of all runs: found by unit, procedure, date and outcome, with their reports and certificates."""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

from fastapi import Request
from fastapi.responses import Response

from bench.control.procedure import load_procedures
from bench.present.panel._access import visit_of
from bench.present.panel._benches import Benches
from bench.present.panel._folders import Entry, RunsFolder
from bench.present.panel._frame import Frame
from bench.present.panel._listing import listed, outside
from bench.record.catalogue import Catalogue, CatalogueRow
from drivers.base.errors import BenchError, ConfigurationError

OUTCOMES = ("completed", "invalid", "aborted", "running", "unreadable")
BROKEN = "any"
"""Searches for runs that break whatever limit."""
_STEP, _MOST = 50, 2000


class History:
    """Searches a catalogue of the panel's own, in `scratch`, brought up to date with the folders each time."""

    def __init__(self, folder: RunsFolder, benches: Benches, scratch: Path) -> None:
        self._folder = folder
        self._benches = benches
        self._frame = Frame(folder, benches)
        self._url = f"sqlite:///{scratch / 'runs.sqlite'}"
        self._one = threading.Lock()

    def page(
        self,
        request: Request,
        unit: str = "",
        procedure: str = "",
        outcome: str = "",
        since: str = "",
        until: str = "",
        limit: str = "",
        show: int = _STEP,
    ) -> Response:
        """Return the page; what cannot be searched for is said on it."""
        asked = {"unit": unit, "procedure": procedure, "outcome": outcome, "since": since, "until": until}
        asked["limit"] = limit
        rows: list[dict[str, Any]] = []
        broken: list[str] = []
        count, problem = 0, ""
        show = min(max(show, 1), _MOST)
        try:
            entries, count = self.entries(asked, show)
            rows = [listed(entry, self._folder, self._benches) for entry in entries]
            broken = sorted({name for entry in entries for name in outside(entry, self._folder)})
        except BenchError as error:
            problem = str(error)
        return self._frame.page(
            "history.html.j2",
            visit_of(request),
            "/history",
            400 if problem else 200,
            asked=asked,
            rows=rows,
            count=count,
            more=min(show + 4 * _STEP, _MOST) if count > len(rows) and show < _MOST else 0,
            problem=problem,
            procedures=list(load_procedures()),
            outcomes=OUTCOMES,
            broken=[BROKEN, *broken],
            runs=str(self._folder.root),
        )

    def entries(self, asked: dict[str, str], show: int = _MOST) -> tuple[list[Entry], int]:
        """Return the newest runs that fit, newest first, and how many fit; BenchError for no date.

        `limit`: the name of a figure that lies outside its limits, or BROKEN for any; looked for in the newest
        2,000 runs that fit the rest.
        """
        others = {name: text for name, text in asked.items() if name != "limit"}
        limit = asked.get("limit", "").strip()
        found, count = self._find(others, _MOST if limit else show)
        entries = self._entries(found)
        if limit:
            entries = [one for one in entries if _breaks(outside(one, self._folder), limit)]
            count = len(entries)
        return entries[:show], count

    def units(self) -> list[str]:
        """Return the serial numbers of the newest runs, in order."""
        return sorted({unit for row in self._find({}, _MOST)[0] for unit in row.units})

    def _entries(self, rows: Sequence[CatalogueRow]) -> list[Entry]:
        return [entry for row in rows if (entry := self._folder.entry(_folder_of(row))) is not None]

    def _find(self, asked: dict[str, str], show: int) -> tuple[list[CatalogueRow], int]:
        wanted = {name: text.strip() for name, text in asked.items() if text.strip()}
        if (outcome := wanted.get("outcome")) is not None and outcome not in OUTCOMES:
            raise ConfigurationError("no outcome of a run", found=outcome, expected=", ".join(OUTCOMES))
        with self._one, Catalogue(self._url) as catalogue:
            for place in self._places():
                catalogue.update(place)
            return catalogue.find(limit=show, **wanted)

    def _places(self) -> Iterator[Path]:
        """Yield the folders that hold run folders: the runs folder, campaigns and rehearsals in it."""
        root = self._folder.root
        if not root.is_dir():
            return
        yield root
        if (root / "runs").is_dir():
            yield root / "runs"
        for path in sorted(root.iterdir()):
            if not path.name.startswith(".") and not path.is_symlink() and (path / "runs").is_dir():
                yield path / "runs"


def _breaks(broken: Collection[str], limit: str) -> bool:
    return bool(broken) if limit == BROKEN else limit in broken


def _folder_of(row: CatalogueRow) -> Path:
    return Path(row.root.partition(":")[2]) / row.name
