"""A bench's queue at work: what operators change in it, and how what is due becomes a process of its own.

The process is the command that a person would type. It is no child in the sense that it needs us: it has a
session of its own, reads nothing, writes into files, and goes on when whoever started it is killed.
"""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime, timedelta
from pathlib import Path

from bench.campaign.queue._file import (
    FOLDER,
    MOST_WAITING,
    CampaignOrder,
    Ended,
    Hold,
    HuntOrder,
    Item,
    Order,
    QueueState,
    RunOrder,
    Started,
    alone,
    read_model,
    write_model,
)
from bench.control.lease import lease_holder
from bench.control.live import read_lines
from bench.control.operators import checked_name
from bench.control.process import process_start
from bench.record.benchfile import load_bench_file
from bench.record.events import Role
from drivers.base.clock import utc_now
from drivers.base.errors import BenchError, BenchInUse, ConfigurationError
from drivers.base.pipes import of_its_own

_ATTENDED_EVERY = timedelta(minutes=1)
_LEFT_ALONE = timedelta(minutes=10)
_TAIL_BYTES = 1 << 18
_TORN_DOWN_S = 5.0
"""Time that the threads of a process take at most to end once its first one has, s."""
_GOOD = ("completed", "invalid")
"""Outcomes after which the next item begins: a run that is invalid was recorded to its end."""


def _now() -> datetime:
    return datetime.fromisoformat(utc_now())


class BenchQueue:
    """The queue of the bench that `bench_file` describes, in the runs folder `runs`.

    Any number of processes may have one of the same bench: each change is made by one of them at a time, and what
    is due is started by whoever comes first.
    """

    def __init__(self, runs: Path, bench_file: Path, now: Callable[[], datetime] = _now) -> None:
        self.runs = runs.resolve()
        self.bench_file = bench_file.resolve()
        self.bench = load_bench_file(bench_file).bench.name
        digest = hashlib.sha256(self.bench.encode()).hexdigest()[:8]
        self.name = f"{re.sub(r'[^A-Za-z0-9]+', '-', self.bench).strip('-').lower()[:40]}-{digest}"
        """The bench in an address and in a file's name."""
        self._path = self.runs / FOLDER / f"{self.name}.json"
        self._now = now
        self._children: list[subprocess.Popen[bytes]] = []

    def state(self) -> QueueState:
        """Return the queue as it is; RecordError if its file is none."""
        found = read_model(self._path, QueueState, "the queue")
        return found or QueueState(bench=self.bench)

    def add(
        self, order: Order, by: str, not_before: datetime | None = None, role: Role | None = None
    ) -> Item:
        """Put an order at the end; ConfigurationError for one without a name, or one too many."""
        with self._changing() as change:
            if len(change.state.waiting) >= MOST_WAITING:
                raise ConfigurationError("the queue is full", found=f"{MOST_WAITING} items")
            item = Item(order=order, by=_named(by), role=role, added=self._now(), not_before=not_before)
            change.state = change.state.but(waiting=(*change.state.waiting, item), attended=self._now())
        return item

    def edit(
        self,
        item_id: str,
        order: Order,
        by: str,
        not_before: datetime | None = None,
        role: Role | None = None,
    ) -> Item:
        """Put another order in the place of a waiting one; ConfigurationError if that has begun or is gone."""
        with self._changing() as change:
            update = {"order": order, "by": _named(by), "role": role, "not_before": not_before}
            item = _waiting(change.state, item_id).model_copy(update=update)
            others = (item if one.id == item_id else one for one in change.state.waiting)
            change.state = change.state.but(waiting=tuple(others))
        return item

    def move(self, item_id: str, place: int) -> None:
        """Put a waiting item at a place, counted from 0."""
        with self._changing() as change:
            item = _waiting(change.state, item_id)
            others = [one for one in change.state.waiting if one.id != item_id]
            others.insert(max(0, place), item)
            change.state = change.state.but(waiting=tuple(others))

    def remove(self, item_id: str) -> None:
        """Take a waiting item out."""
        with self._changing() as change:
            item = _waiting(change.state, item_id)
            change.state = change.state.but(waiting=tuple(one for one in change.state.waiting if one != item))

    def hold(self, by: str) -> None:
        """Start nothing by itself from now on; what goes on goes on."""
        with self._changing() as change:
            change.state = change.state.but(held=Hold(why="operator", by=_named(by)))

    def let_go(self, by: str) -> None:
        """Start what is due by itself from now on."""
        _named(by)
        with self._changing() as change:
            change.state = change.state.but(held=None, attended=self._now())

    def start(self, item_id: str, by: str, role: Role | None = None) -> Item:
        """Start a waiting item at once, also of a queue that is held.

        BenchInUse if another item goes on or somebody else has the bench.
        """
        with self._changing() as change:
            item = _waiting(change.state, item_id)
            if change.state.current is not None:
                raise BenchInUse("the bench is busy", where=self.bench, found="a run of this queue goes on")
            if holder := lease_holder(load_bench_file(self.bench_file)):
                raise BenchInUse("the bench is in use", where=self.bench, found=str(holder))
            return self._begin(change, item, _named(by), role)

    def work(self) -> bool:
        """See what has ended, start what is due; return whether anything has changed. For a call a second."""
        self._reap()
        state, now = self.state(), self._now()
        busy = state.current is not None and _alive(state.current)
        attended = state.attended is not None and now - state.attended < _ATTENDED_EVERY
        idle = state.current is None and (state.held is not None or not state.waiting)
        if idle or (busy and attended):
            return False
        with self._changing() as change:
            self._see_the_end(change)
            state = change.state
            alone_for = now - (state.attended or now)
            if alone_for > _LEFT_ALONE and state.current is None and state.waiting and state.held is None:
                state = state.but(held=Hold(why="left_alone"))
            change.state = state = state.but(attended=now) if not attended else state
            due = state.held is None and state.current is None and state.waiting
            if due and (state.waiting[0].not_before or now) <= now and self._free():
                self._begin(change, state.waiting[0], state.waiting[0].by, state.waiting[0].role)
            return change.written or change.changed

    def arguments(self, order: Order, by: str, role: Role | None = None) -> list[str]:
        """Return the command line of an order that `by` starts, as they would type it behind `gyrobench`."""
        if isinstance(order, RunOrder):
            words = ["run", order.procedure, "--bench", str(self.bench_file), "--runs", str(self.runs)]
            for name, value in order.parameters.items():
                words += ["--set", f"{name}={str(value).lower() if isinstance(value, bool) else value}"]
        elif isinstance(order, CampaignOrder):
            out = str(self.runs / order.out)
            words = ["campaign", "run", str(order.file), "--bench", str(self.bench_file), "--out", out]
        elif isinstance(order, HuntOrder):
            words = ["gap", "hunt", "--bench", str(self.bench_file), "--out", str(self.runs / order.out)]
            if order.model is not None:
                words += ["--model", str(order.model)]
                words += ["--budget-h", f"{order.budget_h:g}", "--until", f"{order.until:g}"]
        else:
            words = ["campaign", "resume", str(order.folder)]
        signed = ["--by", by, *(["--signed-in-as", role] if role else [])]
        return [*words, *signed, "--json"]

    def _free(self) -> bool:
        try:
            return lease_holder(load_bench_file(self.bench_file)) is None
        except BenchError:
            return True  # the command says what is wrong with the bench file

    def _begin(self, change: _Change, item: Item, by: str, role: Role | None) -> Item:
        """Start an item. That it is being started is on the disk before its process is: at most once."""
        waiting = tuple(one for one in change.state.waiting if one.id != item.id)
        item = item.model_copy(update={"started": Started(by=by, role=role, utc=self._now())})
        change.write(change.state.but(current=item, waiting=waiting, attended=self._now()))
        output, errors = self._logs(item)
        output.parent.mkdir(exist_ok=True)
        with output.open("wb") as out, errors.open("wb") as err:
            child = subprocess.Popen(
                [sys.executable, "-P", "-m", "gyrobench", *self.arguments(item.order, by, role)],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                **of_its_own(),
            )
        self._children.append(child)
        process = {"pid": child.pid, "process_start": process_start(child.pid)}
        assert item.started is not None
        item = item.model_copy(update={"started": item.started.model_copy(update=process)})
        change.state = change.state.but(current=item)
        return item

    def _reap(self, ended: Item | None = None) -> None:
        """Forget children that have ended. That of `ended` has: only threads of it are being torn down."""
        started = ended.started if ended is not None else None
        for child in self._children:
            if started is not None and child.pid == started.pid:
                with suppress(subprocess.TimeoutExpired):
                    child.wait(_TORN_DOWN_S)
        self._children = [child for child in self._children if child.poll() is None]

    def _see_the_end(self, change: _Change) -> None:
        item = change.state.current
        if item is None or _alive(item):
            return
        self._reap(item)
        ended = self._how(item)
        item = item.model_copy(update={"ended": ended})
        held = change.state.held if ended.outcome in _GOOD else Hold(why="ended_badly")
        change.state = change.state.but(current=None, ended=(item, *change.state.ended), held=held)

    def _how(self, item: Item) -> Ended:
        """Return how a process ended, by the last line that it said."""
        if item.started is None or not item.started.pid:
            return Ended(outcome="unclear")
        output, errors = self._logs(item)
        said = read_lines(output, max(0, _size(output) - _TAIL_BYTES))[0]
        result = next((row for row in reversed(said) if row.get("kind") == "result"), None)
        if result is not None:
            facts = {"detail": str(result.get("reason") or ""), "folder": str(result.get("folder") or "")}
            return Ended.model_validate({"outcome": result["outcome"]} | facts)
        with errors.open("rb") as file:
            text = file.read(4096).decode("utf-8", "replace").strip()
        return Ended(outcome="refused", detail=text) if text else Ended(outcome="lost")

    def _logs(self, item: Item) -> tuple[Path, Path]:
        folder = self._path.parent / "said"
        return folder / f"{item.id}.jsonl", folder / f"{item.id}.txt"

    @contextmanager
    def _changing(self) -> Iterator[_Change]:
        with alone(self._path):
            change = _Change(self._path, self.state())
            yield change
            if change.changed:
                change.write(change.state)


class _Change:
    """A change of the queue's file while nobody else makes one: `state` is written at the end, or by `write`."""

    def __init__(self, path: Path, state: QueueState) -> None:
        self._path = path
        self._on_disk = self.state = state
        self.written = False

    @property
    def changed(self) -> bool:
        return self.state != self._on_disk

    def write(self, state: QueueState) -> None:
        write_model(self._path, state)
        self._on_disk = self.state = state
        self.written = True


def _waiting(state: QueueState, item_id: str) -> Item:
    found = state.item(item_id)
    if found is None:
        raise ConfigurationError(
            "this is not in the queue any more", found="it was started or taken out", remedy="look again"
        )
    return found


def _named(by: str) -> str:
    if not by.strip():
        raise ConfigurationError(
            "nobody asks for this", found="no name", expected="the name of whoever is at the bench"
        )
    return checked_name(by)


def _alive(item: Item) -> bool:
    """Return whether an item's process still runs; a later one of the same number began at another time."""
    started = item.started
    if started is None or not started.pid:
        return False
    return bool(started.process_start) and process_start(started.pid) == started.process_start


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0
