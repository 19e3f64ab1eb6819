"""The figures of all runs, worked out once a run by the worker and kept in a file of the panel's own."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Mapping
from contextlib import closing, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

from bench.present.panel._workshop import Workshop
from bench.record.run_folder import MANIFEST_FILE
from drivers.base.files import parse_json

FOLDER = ".figures"
_TABLE = (
    "CREATE TABLE IF NOT EXISTS figures (run TEXT PRIMARY KEY, stamp TEXT NOT NULL, answer TEXT NOT NULL)"
)
Answer = Mapping[str, Any]


class FigureStore:
    """Keeps `{"figures": rows}` or `{"problem"}` of each run under `root`, by the manifest it was read from.

    The file lies in `.figures` of the runs folder, or in `scratch` where that cannot be written; it may go.
    """

    def __init__(self, root: Path, scratch: Path) -> None:
        self.version = 0
        """Counts what became known."""
        self._root = root
        self._scratch = scratch
        self._workshop = Workshop()
        self._known: dict[str, tuple[str, Answer]] | None = None
        self._wanted: dict[str, str] = {}
        self._working = False

    def known(self, names: Iterable[str]) -> dict[str, Answer]:
        """Return what is known of runs, by their names in the root; what is not is wanted from then on."""
        if self._known is None:
            self._known = self._read()
        found = {}
        for name in names:
            stamp = _stamp(self._root / name)
            kept = self._known.get(name)
            if kept is not None and kept[0] == stamp:
                found[name] = kept[1]
            else:
                self._wanted[name] = stamp
        return found

    async def work(self) -> None:
        """Have the worker read what is wanted; a call while another one is at it returns at once."""
        if self._working:
            return
        self._working = True
        try:
            while self._wanted:
                name, stamp = next(iter(self._wanted.items()))
                answer = await self._workshop.ask("figures", run=str(self._root / name))
                del self._wanted[name]
                self._keep(name, stamp, answer)
        finally:
            self._working = False

    def _keep(self, name: str, stamp: str, answer: Answer) -> None:
        if self._known is not None:
            self._known[name] = (stamp, answer)
        self.version += 1
        with suppress(sqlite3.Error, OSError), closing(self._open()) as database, database:
            row = (name, stamp, json.dumps(answer))
            database.execute("INSERT OR REPLACE INTO figures VALUES (?, ?, ?)", row)

    def _read(self) -> dict[str, tuple[str, Answer]]:
        """Return what the file has; one that cannot be read is begun anew."""
        try:
            with closing(self._open()) as database:
                rows = database.execute("SELECT run, stamp, answer FROM figures").fetchall()
            return {name: (stamp, parse_json(answer)) for name, stamp, answer in rows}
        except (sqlite3.Error, OSError, ValueError):
            with suppress(OSError):
                (self._root / FOLDER / "figures.sqlite").unlink(missing_ok=True)
            return {}

    def _open(self) -> sqlite3.Connection:
        folder = self._root / FOLDER
        try:
            folder.mkdir(exist_ok=True)
        except OSError:
            folder = self._scratch
        database = sqlite3.connect(folder / "figures.sqlite", timeout=5.0)
        database.execute(_TABLE)
        return database


def _stamp(run: Path) -> str:
    """Return what changes when a run's figures may: its manifest, or the version that works them out."""
    try:
        state = (run / MANIFEST_FILE).stat()
        return f"{state.st_mtime_ns} {state.st_size} {version('gyrobench')}"
    except OSError:
        return ""
