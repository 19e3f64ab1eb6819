"""What the panel may look at: the runs folder and what lies in it, nothing beyond, whatever a page asks for."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from bench.control.live import read_lines
from bench.present.sentences import event_of
from bench.record.events.campaign import CertificateMade, SetAside
from bench.record.recording import Manifest, read_manifest
from bench.record.run_folder import MANIFEST_FILE
from bench.record.run_notes import RunNote, notes_changed_ns, read_notes
from drivers.base.clock import host_seconds
from drivers.base.errors import BenchError

EVENTS_FILE = "events.jsonl"
_LISTED = 40
_LOOKED_AT = 200
_REHEARSED = 20
_PAPERS_S = 2.0
NOW = Path("live") / "now.json"
PAPERS = {"certificate": "certificate.html", "report": "report.html"}
"""What lies in a campaign's folder: name and file."""


@dataclass(frozen=True)
class QueueLink:
    """The queue of a bench as other pages show it: address, whether nothing real moves, what waits in words."""

    address: str
    emulated: bool
    waits: str = ""


@dataclass(frozen=True)
class Entry:
    """A run of the history: its folder relative to the runs folder; `problem` if its manifest cannot be read."""

    name: str
    manifest: Manifest | None
    problem: str = ""


@dataclass(frozen=True)
class _Journal:
    """What a campaign says of its runs: why which are set aside, and what its newest certificate says."""

    set_aside: Mapping[str, str]
    passed: bool | None


class RunsFolder:
    """A runs folder: in it run folders, and campaigns and rehearsals with run folders of their own."""

    def __init__(self, root: Path) -> None:
        self.root = root.resolve()
        self.queues: dict[str, QueueLink] = {}
        """By the name of the bench, of those on which runs can be started from here."""
        self._manifests: dict[Path, tuple[int, Entry]] = {}
        self._notes: dict[Path, tuple[int, list[RunNote]]] = {}
        self._journals: dict[Path, tuple[int, _Journal]] = {}
        self._papers: dict[Path, tuple[float, list[tuple[str, str]]]] = {}

    def inside(self, name: str) -> Path | None:
        """Return the folder or file of that relative name; None if it is not there or leads out."""
        path = self.within(self.root / name) if not Path(name).is_absolute() else None
        return None if path == self.root else path

    def within(self, path: str | Path) -> Path | None:
        """Return what lies at an absolute path, None unless it is inside the runs folder.

        Links are followed before the check: one that points elsewhere leads out.
        """
        try:
            real = Path(path).resolve(strict=True)
        except (OSError, RuntimeError, ValueError):
            return None
        return real if real.is_relative_to(self.root) else None

    def sessions(self) -> list[Path]:
        """Return the folders with live files, the one that was written to last first.

        A campaign has them itself; of a rehearsal each run has its own.
        """
        live = []
        for folder in [self.root, *_newest(self.root)]:
            if changed_ns := _live_ns(folder):
                live.append((changed_ns, folder))
            elif not (folder / MANIFEST_FILE).exists():
                runs = _newest(folder / "runs")[:_REHEARSED]
                live += [(run_ns, run) for run in runs if (run_ns := _live_ns(run))]
        return [folder for _, folder in sorted(live, reverse=True)]

    def session(self, name: str) -> Path | None:
        """Return the session folder of that name ("." is the runs folder itself), None if there is none."""
        folder = self.root if name == "." else self.inside(name)
        return folder if folder is not None and (folder / NOW).is_file() else None

    def history(self) -> list[Entry]:
        """Return the newest runs, newest first; manifests are read again only when they have changed."""
        folders: list[Path] = []
        for folder in _newest(self.root):
            if (folder / MANIFEST_FILE).is_file():
                folders.append(folder)
            else:
                below = [*_newest(folder), *_newest(folder / "runs")]
                folders += [run for run in below if (run / MANIFEST_FILE).is_file()]
        entries = [entry for folder in folders[:_LOOKED_AT] if (entry := self.entry(folder)) is not None]
        entries.sort(key=lambda entry: entry.manifest.started_utc if entry.manifest else "", reverse=True)
        return entries[:_LISTED]

    def page_in(self, name: str, file: str) -> Path | None:
        """Return the report or certificate in a run or campaign folder ("." is the runs folder), or None."""
        folder = self.root if name in ("", ".") else self.inside(name)
        path = None if folder is None else self.within(folder / file)
        return path if path is not None and path.is_file() else None

    def papers(self, folder: Path) -> list[tuple[str, str]]:
        """Return (what, address) of the certificate and the report that lie in a campaign's folder.

        Pages ask ten times a second, the disk is asked every two.
        """
        now_s = host_seconds()
        if now_s - self._papers.get(folder, (-_PAPERS_S, []))[0] >= _PAPERS_S:
            if len(self._papers) > _LOOKED_AT:
                self._papers.clear()
            self._papers[folder] = (now_s, self._papers_there(folder))
        return self._papers[folder][1]

    def _papers_there(self, folder: Path) -> list[tuple[str, str]]:
        name = str(folder.relative_to(self.root))
        there = [(what, file) for what, file in PAPERS.items() if self.page_in(name, file) is not None]
        return [(what, f"/{what}/{quote(name)}") for what, _ in there]

    def set_aside(self, run: Path) -> str:
        """Return why a campaign has set a run aside, empty if it has not."""
        return self._journal(run).set_aside.get(f"{run.parent.name}/{run.name}", "")

    def certified(self, run: Path) -> bool | None:
        """Return whether the certificate of a run's campaign says passed, None where nothing was judged."""
        return self._journal(run).passed

    def _journal(self, run: Path) -> _Journal:
        """Return what the journal of a run's campaign says; it is read again only when it has changed."""
        journal = self.within(run.parent.parent / EVENTS_FILE)
        if journal is None:
            return _Journal({}, None)
        try:
            changed = journal.stat().st_mtime_ns
        except OSError:
            return _Journal({}, None)
        if journal not in self._journals or self._journals[journal][0] != changed:
            events = [event_of(row) for row in read_lines(journal)[0]]
            why = {event.folder: event.reason for event in events if isinstance(event, SetAside)}
            made = [event.passed for event in events if isinstance(event, CertificateMade)]
            self._journals[journal] = (changed, _Journal(why, made[-1] if made else None))
        return self._journals[journal][1]

    def notes(self, run: Path) -> list[RunNote]:
        """Return the notes of a run; they are read again only when they have changed."""
        changed = notes_changed_ns(run)
        if not changed:
            return []
        if self._notes.get(run, (0, []))[0] != changed:
            if len(self._notes) > 4 * _LOOKED_AT:
                self._notes.clear()
            self._notes[run] = (changed, read_notes(run))
        return self._notes[run][1]

    def entry(self, folder: Path) -> Entry | None:
        """Return a run by its folder in the runs folder, None if there is no manifest any more."""
        try:
            changed = (folder / MANIFEST_FILE).stat().st_mtime_ns
        except OSError:
            return None
        known = self._manifests.get(folder)
        if known is not None and known[0] == changed:
            return known[1]
        name = str(folder.relative_to(self.root))
        try:
            entry = Entry(name, read_manifest(folder))
        except BenchError as error:
            entry = Entry(name, None, str(error))
        if len(self._manifests) > 4 * _LOOKED_AT:
            self._manifests.clear()
        self._manifests[folder] = (changed, entry)
        return entry


def _newest(folder: Path) -> list[Path]:
    """Return the folders in a folder, no links and none that is hidden, the one changed last first."""
    try:
        with os.scandir(folder) as entries:
            dated = [
                (entry.stat(follow_symlinks=False).st_mtime_ns, entry.path)
                for entry in entries
                if entry.is_dir(follow_symlinks=False) and not entry.name.startswith(".")
            ]
    except OSError:
        return []
    return [Path(path) for _, path in sorted(dated, reverse=True)[:_LOOKED_AT]]


def _live_ns(session: Path) -> int:
    """Return when a folder's live state was written last, 0 if it has none."""
    try:
        return (session / NOW).stat().st_mtime_ns
    except OSError:
        return 0
