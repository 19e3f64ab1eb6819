"""The page of all runs: found by unit, procedure, date and outcome, with their reports and certificates."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from fastapi.responses import HTMLResponse, Response

from bench.control.procedure import load_procedures
from bench.present.panel._benches import Benches
from bench.present.panel._desk_routes import PAGE_HEADERS, template
from bench.present.panel._folders import Entry, RunsFolder
from bench.present.panel._listing import listed
from bench.record.catalogue import Catalogue, CatalogueRow
from drivers.base.errors import BenchError, ConfigurationError

OUTCOMES = ("completed", "invalid", "aborted", "running", "unreadable")
_STEP, _MOST = 50, 2000


class History:
    """Searches a catalogue of the panel's own, in `scratch`, brought up to date with the folders each time."""

    def __init__(self, folder: RunsFolder, benches: Benches, scratch: Path) -> None:
        self._folder = folder
        self._benches = benches
        self._url = f"sqlite:///{scratch / 'runs.sqlite'}"
        self._one = threading.Lock()

    def page(
        self,
        unit: str = "",
        procedure: str = "",
        outcome: str = "",
        since: str = "",
        until: str = "",
        show: int = _STEP,
    ) -> Response:
        """Return the page; what cannot be searched for is said on it."""
        asked = {"unit": unit, "procedure": procedure, "outcome": outcome, "since": since, "until": until}
        rows: list[dict[str, Any]] = []
        count, problem = 0, ""
        show = min(max(show, 1), _MOST)
        try:
            rows, count = self.find(asked, show)
        except BenchError as error:
            problem = str(error)
        text = template("history.html.j2").render(
            asked=asked,
            rows=rows,
            count=count,
            more=min(show + 4 * _STEP, _MOST) if count > len(rows) and show < _MOST else 0,
            problem=problem,
            procedures=list(load_procedures()),
            outcomes=OUTCOMES,
            tabs=list(self._folder.queues.items()),
            runs=str(self._folder.root),
            benches=self._benches.strip(),
        )
        return HTMLResponse(text, headers=PAGE_HEADERS, status_code=400 if problem else 200)

    def find(self, asked: dict[str, str], show: int) -> tuple[list[dict[str, Any]], int]:
        """Return the newest runs that fit, as rows of a list, and how many fit; BenchError for no date."""
        found, count = self._find(asked, show)
        return [listed(entry, self._folder, self._benches) for entry in self._entries(found)], count

    def entries(self, asked: dict[str, str]) -> list[Entry]:
        """Return the newest runs that fit, newest first."""
        return self._entries(self._find(asked, _MOST)[0])

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


def _folder_of(row: CatalogueRow) -> Path:
    return Path(row.root.partition(":")[2]) / row.name
