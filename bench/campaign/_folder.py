"""A campaign's folder: copies of its files, the journal, the runs. The run folders are the truth."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import Any, Literal

from bench.campaign._file import Campaign, CampaignRun, load_campaign
from bench.lab.emulated import Plant
from bench.record.benchfile import BenchFile, bench_file_from
from bench.record.events import Event, read_event
from bench.record.events.campaign import CampaignBegun, Checked, RunAdded, RunStarted
from bench.record.events.run import Demand
from bench.record.recording import Manifest, checksum, read_events, read_manifest, seal_state
from bench.record.run_folder import MANIFEST_FILE
from bench.record.shown import Shown
from drivers.base.clock import epoch_seconds, utc_now
from drivers.base.errors import BenchInUse, ConfigurationError, RecordError
from drivers.base.files import RECORD_BYTES, SETTINGS_BYTES, parse_json, read_bounded, replace_file
from drivers.base.locks import take_lock
from drivers.base.system import open_flags

CAMPAIGN_FILE, BENCH_FILE, JOURNAL_FILE, LOCK_FILE = "campaign.toml", "bench.json", "events.jsonl", ".lock"
HUNT_FILE = "hunt.json"
"""In the folder of a search for a missing effect, whose runs are chosen one after the other."""


@dataclass(frozen=True)
class RunState:
    """How far one run of the campaign is. `folder` is that of its newest attempt, `attempts` how many there are.

    `done`: recorded whole and sealed, whatever its verdict; `open`: still to be done, `reason` says why the
    newest attempt does not count.
    """

    run: CampaignRun
    state: Literal["done", "open"]
    attempts: int = 0
    folder: Path | None = None
    outcome: str = ""
    reason: str = ""
    duration_s: float | None = None


class CampaignFolder(Shown):
    """The folder of a campaign that was begun."""

    def __init__(self, path: Path) -> None:
        self.path = path
        about = _read_about(path)
        self.file: BenchFile = bench_file_from(about["bench"], str(path / BENCH_FILE))
        self.campaign: Campaign = load_campaign(path / CAMPAIGN_FILE, self.file)
        plant = about.get("plant")
        self.plant: Plant | None = None if plant is None else Plant.model_validate(plant)
        self.ask: bool = bool(about.get("ask"))
        self.started_s = float(about["started_s"])

    @classmethod
    def create(
        cls, path: Path, campaign_file: Path, file: BenchFile, plant: Plant | None, ask: bool
    ) -> CampaignFolder:
        """Begin a campaign in a new or empty folder; ConfigurationError if there is something in it."""
        refuse_used(path)
        about = {
            "bench": file.model_dump(mode="json", exclude_none=True),
            "plant": None if plant is None else plant.model_dump(mode="json"),
            "ask": ask,
            "started_s": epoch_seconds(),
        }
        try:
            (path / "runs").mkdir(parents=True)
            replace_file(path / CAMPAIGN_FILE, campaign_file.read_bytes())
            replace_file(path / BENCH_FILE, json.dumps(about, indent=1))
        except OSError as error:
            raise RecordError(
                "the campaign folder cannot be written", where=str(path), found=str(error)
            ) from error
        folder = cls(path)
        campaign = folder.campaign
        names = [run.name for run in campaign.runs]
        folder.event(CampaignBegun(campaign.title, campaign.sha256, file.sha256, names))
        return folder

    def add(self, run: CampaignRun) -> None:
        """Add a run at the campaign's end; ConfigurationError if there is one of its name."""
        path = self.path / CAMPAIGN_FILE
        text = read_bounded(path, SETTINGS_BYTES).decode("utf-8") + f"\n{run.toml()}"
        replace_file(path, text)
        self.campaign = load_campaign(path, self.file)
        self.event(RunAdded(run.name, self.campaign.sha256))

    def shown(self) -> dict[str, object]:
        """Return the campaign, its bench, and how far it is."""
        states = self.states()
        return {
            "campaign": self.campaign.title,
            "bench": self.file.bench.name,
            "folder": self.path,
            "done": f"{sum(state.state == 'done' for state in states)} of {len(states)} runs",
        }

    @property
    def runs(self) -> Path:
        """The folder of the run folders."""
        return self.path / "runs"

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Be the one process that works on this campaign; BenchInUse names the one that does."""
        descriptor = os.open(self.path / LOCK_FILE, open_flags("O_RDWR", "O_CREAT"), 0o644)
        try:
            try:
                take_lock(descriptor)
            except BlockingIOError as error:
                holder = os.read(descriptor, 200).decode("utf-8", "replace").strip()
                raise BenchInUse(
                    "somebody works on this campaign already",
                    where=str(self.path),
                    found=holder or "another process",
                    remedy="`gyrobench campaign status` shows how far it is",
                ) from error
            os.ftruncate(descriptor, 0)
            os.write(descriptor, f"process {os.getpid()}, since {utc_now()}\n".encode())
            yield
        finally:
            os.close(descriptor)

    def event(self, event: Event) -> None:
        """Add a line to the journal, on the disk when this returns; RecordError if it cannot be written.

        A line that a power cut tore is ended first, so that it does not spoil this one.
        """
        row = event.row(round(epoch_seconds() - self.started_s, 3))
        line = {"time_s": row["time_s"], "kind": row["kind"], "utc": utc_now()} | row
        path = self.path / JOURNAL_FILE
        try:
            descriptor = os.open(path, open_flags("O_RDWR", "O_APPEND", "O_CREAT"), 0o644)
            try:
                size = os.fstat(descriptor).st_size
                torn = size > 0 and os.pread(descriptor, 1, size - 1) != b"\n"
                text = json.dumps(line, ensure_ascii=False, default=str).encode() + b"\n"
                text = b"\n" + text if torn else text
                if os.write(descriptor, text) != len(text):
                    raise OSError(28, "the line was written in part")
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
        except OSError as error:
            raise RecordError(
                "the campaign's journal cannot be written", where=str(path), found=str(error)
            ) from error

    def events(self) -> list[tuple[str, Event]]:
        """Return the journal, each event with when it was (UTC); a line torn by a power cut is left out."""
        events: list[tuple[str, Event]] = []
        with suppress(FileNotFoundError):
            for line in read_bounded(self.path / JOURNAL_FILE, RECORD_BYTES).splitlines():
                with suppress(ValueError):
                    row = parse_json(line)
                    events.append((str(row.get("utc", "")), read_event(row)[1]))
        return events

    def moved(self) -> bool:
        """Whether anything was told to move or to heat since the campaign began, or may have been.

        Only a run that was sealed without one demand in its events leaves the bench as it was found: one whose
        devices did not answer, or that was refused.
        """
        names = [event.folder for _, event in self.events() if isinstance(event, RunStarted | Checked)]
        return any(_moved(self.path / name) for name in dict.fromkeys(names))

    def states(self, *, thorough: bool = False) -> list[RunState]:
        """Return how far every run is; `thorough` recomputes the checksums of what counts as done."""
        names = [path.name for path in self.runs.iterdir() if path.is_dir()] if self.runs.is_dir() else []
        return [self._state(run, names, thorough) for run in self.campaign.runs]

    def next_id(self, run: CampaignRun) -> str:
        """Return the folder name of the run's next attempt: `name`, `name.2`, `name.3`, ..."""
        taken = self._attempts(run, [path.name for path in self.runs.iterdir()])
        last = max(taken, default=0)
        return run.name if last == 0 else f"{run.name}.{last + 1}"

    def judge(self, run: CampaignRun, folder: Path, *, thorough: bool = True) -> tuple[str, Manifest | None]:
        """Return why a folder does not count as a record of `run` (empty if it does), and its manifest."""
        try:
            manifest = read_manifest(folder)
        except RecordError as error:
            return str(error), None
        wanted = json.loads(run.values.model_dump_json())
        if manifest.procedure != run.procedure or dict(manifest.parameters) != wanted:
            return "it is of another procedure or other parameters", manifest
        if manifest.outcome == "running":
            return "it was not closed: the process or the power ended first", manifest
        if manifest.outcome not in ("completed", "invalid"):
            return f"{manifest.outcome}: {manifest.reason}", manifest
        return _damage(folder, manifest, thorough), manifest

    def _attempts(self, run: CampaignRun, names: list[str]) -> dict[int, str]:
        form = re.compile(re.escape(run.name) + r"(?:\.(\d+))?")
        found = ((form.fullmatch(name), name) for name in names)
        return {int(match[1] or 1): name for match, name in found if match is not None}

    def _state(self, run: CampaignRun, names: list[str], thorough: bool) -> RunState:
        attempts = self._attempts(run, names)
        newest = None
        for number in sorted(attempts, reverse=True):
            folder = self.runs / attempts[number]
            reason, manifest = self.judge(run, folder, thorough=thorough)
            facts: tuple[str, str, float | None] = ("unreadable", reason, None)
            if manifest is not None:
                facts = (manifest.outcome, reason or manifest.reason, manifest.duration_s)
            state = RunState(run, "open" if reason else "done", len(attempts), folder, *facts)
            if not reason:
                return state
            newest = newest or state
        return newest or RunState(run, "open")


def refuse_used(path: Path) -> None:
    """Raise ConfigurationError for a folder with something in it: nothing is begun there."""
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        begun = (path / CAMPAIGN_FILE).exists()
        raise ConfigurationError(
            "the folder is not empty",
            where=str(path),
            found="a campaign that was begun" if begun else "files",
            expected="a new or empty folder: runs are never overwritten",
            remedy=f"`gyrobench campaign resume {quote(str(path))}`"
            if begun
            else "name another one with --out",
        )


def _moved(folder: Path) -> bool:
    try:
        if not read_manifest(folder).complete:
            return True  # killed: its last events may be missing
        return bool(read_events(folder).of(Demand))
    except RecordError:
        return True


def _damage(folder: Path, manifest: Manifest, thorough: bool) -> str:
    """Return what of the sealed files is missing or not what was sealed, empty if nothing."""
    if not manifest.files:
        return "it was sealed without files"
    paths = {name: folder / name for name in manifest.files}
    wrong = [
        name
        for name, path in paths.items()
        if not path.is_file() or path.stat().st_size != manifest.files[name].bytes
    ]
    if seal_state(folder, manifest) == "broken":
        wrong.append(MANIFEST_FILE)
    if thorough and not wrong:
        wrong = [name for name, path in paths.items() if checksum(path) != manifest.files[name]]
    return f"not what was sealed: {', '.join(wrong)}" if wrong else ""


def _read_about(path: Path) -> dict[str, Any]:
    try:
        about: dict[str, Any] = parse_json(read_bounded(path / BENCH_FILE, SETTINGS_BYTES))
        _ = about["bench"], about["started_s"]
    except (OSError, ValueError, KeyError) as error:
        raise ConfigurationError(
            "this is not the folder of a campaign",
            where=str(path),
            found=str(error),
            expected=f"{CAMPAIGN_FILE}, {BENCH_FILE} and runs/ as `gyrobench campaign run` makes them",
        ) from error
    return about
