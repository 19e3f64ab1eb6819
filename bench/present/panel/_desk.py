"""The desk of a bench: what it is to do next, for the queue's page, and what an operator may ask of it."""

from __future__ import annotations

import shlex
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode

from pydantic import ValidationError

from bench.campaign import (
    HUNT_FILE,
    Campaign,
    CampaignFolder,
    PlannedRun,
    bench_of,
    load_campaign,
    plan_campaign,
)
from bench.campaign.queue import (
    BenchQueue,
    CampaignOrder,
    Hold,
    HuntOrder,
    Item,
    Order,
    ResumeOrder,
    RunOrder,
)
from bench.control.disk import free_bytes
from bench.control.lease import lease_holder
from bench.control.procedure import beyond_limits, find_procedure
from bench.present.panel._benches import Benches
from bench.present.panel._forms import in_words
from bench.present.panel._texts import duration
from bench.present.panel._words import ENDED, HELD
from bench.record.benchfile import BenchFile, load_bench_file
from bench.record.events.campaign import Sought
from drivers.base.clock import utc_now
from drivers.base.errors import BenchError, ConfigurationError, LimitExceeded
from drivers.base.files import SETTINGS_BYTES, parse_json, read_bounded

_MOST_FILES = 200
_MOST_CAMPAIGNS = 40


class Desk:
    """A bench's queue with all that its page says of it; `campaigns`: the folder of its campaign files."""

    def __init__(self, queue: BenchQueue, benches: Benches, campaigns: Path) -> None:
        self.queue = queue
        self.campaigns = campaigns
        self._benches = benches
        self._emulated = 0, False

    @property
    def file(self) -> BenchFile:
        """The bench file as it is now; ConfigurationError if it has become unusable."""
        return load_bench_file(self.queue.bench_file)

    @property
    def address(self) -> str:
        """The address of its page."""
        return f"/queue/{self.queue.name}"

    @property
    def emulated(self) -> bool:
        """Whether nothing real moves; not so of a file that has become unusable."""
        try:
            changed_ns = self.queue.bench_file.stat().st_mtime_ns
            if self._emulated[0] != changed_ns:
                bench = self.file.bench
                self._emulated = changed_ns, bool(bench.emulated or bench.clock)
        except (BenchError, OSError):
            return False
        return self._emulated[1]

    def view(self) -> dict[str, Any]:
        """Return the queue for its page; times are UTC, the browser shows them in its own zone."""
        state = self.queue.state()
        file = self.file
        now = at = datetime.fromisoformat(utc_now())
        if (current := state.current) is not None and current.started is not None:
            at = max(now, current.started.utc + timedelta(seconds=self.expected_s(current.order, file) or 0))
        rows = []
        for item in state.waiting:
            begin = max(at, item.not_before or at)
            expected_s = self.expected_s(item.order, file)
            at = begin + timedelta(seconds=expected_s or 0.0)
            rows.append(
                self._item(item) | {"length": duration(expected_s), "begin": _utc(begin), "end": _utc(at)}
            )
        holder = None if current is not None else lease_holder(file)
        return {
            "bench": self.queue.bench,
            "held": None if state.held is None else HELD[state.held.why].format(by=state.held.by),
            "look": state.held == Hold(why="ended_badly"),
            "used": "" if holder is None else str(holder),
            "current": None if current is None else self._item(current) | self._live(current),
            "waiting": rows,
            "ended": [self._item(item) | self._outcome(item) for item in state.ended],
        }

    def expected_s(self, order: Order, file: BenchFile) -> float | None:
        """Return how long an order is expected to take, None if that cannot be told."""
        try:
            if isinstance(order, RunOrder):
                procedure = find_procedure(order.procedure)
                return procedure.expected_duration_s(procedure.parse(order.parameters))
            if isinstance(order, HuntOrder):
                return 3600.0 * order.budget_h
            return load_campaign(_file_of(order), file).expected_duration_s()
        except BenchError:
            return None

    def campaign_files(self) -> list[tuple[str, str]]:
        """Return name and title of the campaign files of the folder."""
        return [
            (path.name, str(data["title"]))
            for path, data in self._files("*.toml")
            if "title" in data and "run" in data
        ]

    def model_files(self) -> list[tuple[str, str]]:
        """Return name and title of the nominal models in the folder and in `nominal` in it, to search from."""
        return [
            (str(path.relative_to(self.campaigns)), str(data.get("name", "nominal")))
            for pattern in ("*.toml", "nominal/*.toml")
            for path, data in self._files(pattern)
            if "effect" in data and "noise" in data
        ]

    def _files(self, pattern: str) -> Iterator[tuple[Path, dict[str, Any]]]:
        for path in sorted(self.campaigns.glob(pattern))[:_MOST_FILES]:
            with suppress(OSError, ValueError):
                yield path, tomllib.loads(read_bounded(path, SETTINGS_BYTES).decode())

    def campaign_order(self, name: str, title: str = "") -> CampaignOrder:
        """Return the order for a campaign file of the folder; ConfigurationError for one that is not there."""
        if name not in dict(self.campaign_files()):
            raise ConfigurationError(
                "there is no such campaign file",
                where=str(self.campaigns),
                found=name,
                expected="one of the list",
            )
        campaign = load_campaign(self.campaigns / name, self.file)
        return CampaignOrder(
            file=(self.campaigns / name).resolve(),
            title=title or campaign.title,
            out=self._new_folder(Path(name).stem),
        )

    def hunt_order(self, name: str, budget_h: object, until: object) -> HuntOrder:
        """Return the order for a search from a nominal model; ConfigurationError for what is none."""
        models = dict(self.model_files())
        if name not in models:
            raise ConfigurationError(
                "there is no such model", where=str(self.campaigns), found=name, expected="one of the list"
            )
        try:
            return HuntOrder.model_validate(
                {
                    "model": (self.campaigns / name).resolve(),
                    "title": f"search for what {models[name]} lacks",
                    "out": self._new_folder("search"),
                    "budget_h": budget_h,
                    "until": until,
                }
            )
        except ValidationError as error:
            raise ConfigurationError(
                "a search needs its bench time and a probability",
                found=f"{budget_h} h, {until}",
                expected="0 to 10000 h, 0.5 to 1",
            ) from error

    def _new_folder(self, name: str) -> str:
        """Return the name of a folder that is not there yet, from a name and the time."""
        stamp = utc_now()[:16].replace("-", "").replace(":", "").replace("T", "-")
        letters = "".join(letter if letter.isalnum() and letter.isascii() else "-" for letter in name)
        out = f"{letters.strip('-') or 'campaign'}-{stamp}"
        taken = sum((self.queue.runs / f"{out}{tail}").exists() for tail in ("", "-2", "-3"))
        return out + (f"-{taken + 1}" if taken else "")

    def open_campaigns(self) -> Iterator[dict[str, Any]]:
        """Yield the campaigns of this bench that were begun and are not done, newest first."""
        queued = {_folder_of(item.order, self.queue.runs) for item in self.queue.state().waiting}
        with suppress(OSError):
            folders = [path for path in self.queue.runs.iterdir() if (path / "campaign.toml").is_file()]
            folders.sort(key=lambda path: path.stat().st_mtime, reverse=True)
            for path in folders[:_MOST_CAMPAIGNS]:
                if path in queued or any(one.path == path and one.alive for one in self._benches.sessions):
                    continue
                with suppress(BenchError):
                    folder = CampaignFolder(path)
                    states = folder.states()
                    done = sum(state.state == "done" for state in states)
                    going_on = done < len(states) or _searches_on(folder)
                    if folder.file.bench.name == self.queue.bench and folder.plant is None and going_on:
                        yield {
                            "folder": path.name,
                            "title": folder.campaign.title,
                            "done": f"{done} of {len(states)} runs recorded",
                        }

    def campaign_of(self, order: RunOrder | CampaignOrder) -> Campaign:
        """Return what an order runs as a campaign: of a single run, that run."""
        if isinstance(order, CampaignOrder):
            return load_campaign(order.file, self.file)
        run = {"name": "run", "procedure": order.procedure, "parameters": order.parameters}
        return Campaign.model_validate({"title": order.procedure, "run": [run]})

    def estimate(self, order: RunOrder | CampaignOrder | HuntOrder) -> dict[str, Any]:
        """Return the plan by the procedures' own estimates; BenchError for what may not be."""
        file = self.file
        if isinstance(order, HuntOrder):
            budget_s = 3600.0 * order.budget_h
            return {"duration_s": budget_s, "length": f"at most {duration(budget_s)}", "fits": True}
        campaign = self.campaign_of(order)
        for run in campaign.runs:
            run.test.check_bench(file)
            beyond = ", ".join(beyond_limits(run.test.demands(run.values), file))
            if beyond and isinstance(order, RunOrder):
                raise LimitExceeded(f"this bench does not allow {beyond}", remedy="change what demands it")
        return self.plan(plan_campaign(campaign, bench_of(campaign, file), None))

    def plan(self, planned: list[PlannedRun]) -> dict[str, Any]:
        """Return a plan for the page: time, extremes against the bench's limits, size against the disk."""
        limits, demands = self.file.limits, [row.demands for row in planned]
        needed, free = sum(row.bytes for row in planned), free_bytes(self.queue.runs)
        table = [
            ("Table", max(one.max_rate_dps for one in demands), f"at most {limits.max_rate_dps:g}", "°/s")
        ]
        chamber = [
            ("Coldest", min(one.min_temp_c for one in demands), f"at least {limits.min_temp_c:g}", "°C"),
            ("Warmest", max(one.max_temp_c for one in demands), f"at most {limits.max_temp_c:g}", "°C"),
            (
                "Ramp",
                max(one.max_ramp_k_per_min for one in demands),
                f"at most {limits.max_ramp_k_per_min:g}",
                "K/min",
            ),
        ]
        conditioned_s = sum(row.chamber_s for row in planned)
        most = table + (chamber if conditioned_s else [])
        return {
            "duration_s": planned[-1].end_s,
            "length": duration(planned[-1].end_s),
            "chamber": chamber_words(conditioned_s),
            "bytes": needed,
            "free": free,
            "fits": needed <= free,
            "extremes": [(name, f"{value:g}", limit, unit) for name, value, limit, unit in most],
            "runs": [(row.run.name, row.run.procedure, duration(row.duration_s)) for row in planned],
        }

    def _item(self, item: Item) -> dict[str, Any]:
        order = item.order
        back, detail = f"{self.address}?", ""
        if isinstance(order, RunOrder):
            title, again = order.procedure, {"procedure": order.procedure, "item": item.id}
            with suppress(ConfigurationError):  # a procedure that is not installed any more
                detail = in_words(find_procedure(order.procedure), order.parameters)
            detail = detail or "all parameters as usual"
        elif isinstance(order, CampaignOrder):
            title, detail, again = (
                order.title,
                f"campaign {order.file.name}, into {order.out}",
                {"campaign": order.file.name},
            )
        elif isinstance(order, HuntOrder):
            how = (
                f"up to {order.budget_h:g} h of bench time, until {order.until:g} probable, into {order.out}"
            )
            title, detail, again = order.title, how if order.model else f"go on in {order.out}", {}
        else:
            title, detail, again = order.title, f"resume the campaign in {order.folder.name}", {}
        return {
            "id": item.id,
            "title": title,
            "detail": detail,
            "by": item.by,
            "not_before": None if item.not_before is None else _utc(item.not_before),
            "again": back + urlencode(again) if again else "",
            "edit": back + urlencode(again | {"edit": item.id}) if isinstance(order, RunOrder) else "",
            "command": "gyrobench " + shlex.join(self.queue.arguments(order, item.by, item.role)),
        }

    def _live(self, item: Item) -> dict[str, Any]:
        """Return where a started item can be seen: its session has its process."""
        started = item.started
        pid = 0 if started is None else started.pid
        session = next((one for one in self._benches.sessions if (one.now or {}).get("pid") == pid), None)
        return {
            "started": None if started is None else _utc(started.utc),
            "link": "" if session is None else self._benches.link(session),
            "word": "starting" if session is None else session.banner().word,
        }

    def _outcome(self, item: Item) -> dict[str, Any]:
        ended = item.ended
        assert ended is not None
        folder = Path(ended.folder) if ended.folder else None
        inside = folder is not None and folder.is_relative_to(self.queue.runs)
        name = str(folder.relative_to(self.queue.runs)) if folder is not None and inside else ""
        return {
            "outcome": ended.outcome,
            "said": ENDED[ended.outcome],
            "reason": ended.detail,
            "report": f"/report/{quote(name)}" if name and item.order.kind == "run" else "",
        }


def chamber_words(conditioned_s: float) -> str:
    """Return how long the chamber is on, in words."""
    return f"on for {duration(conditioned_s)}" if conditioned_s else "not used"


def resume_order(runs: Path, name: str) -> ResumeOrder | HuntOrder:
    """Return the order that goes on with a campaign or a search; ConfigurationError for what is none."""
    if name in ("", ".", "..") or "/" in name:
        raise ConfigurationError("this is no campaign of the runs folder", found=name)
    if (runs / name / HUNT_FILE).exists():
        parts = {"model": None, "title": CampaignFolder(runs / name).campaign.title, "out": name}
        try:
            asked = parse_json(read_bounded(runs / name / HUNT_FILE, SETTINGS_BYTES))
            kept = {key: value for key, value in asked.items() if key in ("budget_h", "until")}
            return HuntOrder.model_validate(parts | kept)
        except (OSError, ValueError, AttributeError) as error:  # a ValidationError is a ValueError
            raise ConfigurationError(
                "the search cannot go on", where=str(runs / name / HUNT_FILE), found=str(error)
            ) from error
    return ResumeOrder(folder=runs / name, title=CampaignFolder(runs / name).campaign.title)


def repeated(manifest_parameters: Mapping[str, Any], procedure: str) -> dict[str, Any]:
    """Return a recorded run's parameters that the procedure still knows."""
    known = find_procedure(procedure).parameters.model_fields
    return {name: value for name, value in manifest_parameters.items() if name in known}


def _searches_on(folder: CampaignFolder) -> bool:
    """Return whether a folder is that of a search that has not ended."""
    ended = any(isinstance(event, Sought) and event.ended for _, event in folder.events())
    return (folder.path / HUNT_FILE).exists() and not ended


def _folder_of(order: Order, runs: Path) -> Path | None:
    """Return the folder that an order goes on in, None for one that begins a new one."""
    if isinstance(order, ResumeOrder):
        return order.folder
    return runs / order.out if isinstance(order, HuntOrder) and order.model is None else None


def _file_of(order: CampaignOrder | ResumeOrder) -> Path:
    return order.file if isinstance(order, CampaignOrder) else order.folder / "campaign.toml"


def _utc(time: datetime) -> str:
    return time.isoformat(timespec="seconds")
