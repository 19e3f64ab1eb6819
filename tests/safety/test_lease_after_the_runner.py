"""Where a lock ends with its process, the watchdog takes the bench's lease once its runner has ended."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from bench.control.lease import Lease, lease_holder, take_lease
from bench.control.watchdog import _process
from bench.control.watchdog._other import Other
from bench.record.benchfile import BenchFile, load_bench_file
from drivers.base.errors import BenchInUse, ConfigurationError

pytestmark = pytest.mark.concurrent

DEMO = Path(__file__).parents[2] / "examples" / "demo.toml"


class Clock:
    """Time passes by sleeping only."""

    def __init__(self) -> None:
        self.time_s = 0.0

    def now(self) -> float:
        return self.time_s

    def sleep(self, duration_s: float) -> None:
        self.time_s += duration_s


def taken_over(
    folder: Path, monkeypatch: pytest.MonkeyPatch, take: Callable[[], Lease]
) -> tuple[list[dict[str, object]], float]:
    """Return what the watchdog of a bench without devices writes down, and how long it took (s)."""
    clock = Clock()
    monkeypatch.setattr(_process, "WallClock", lambda: clock)
    assert _process._take_over(_process.Order(folder, 1, (), {}, take_lease=take), Other(None), None) is True
    lines = (folder / "watchdog" / "events.jsonl").read_text().splitlines()
    return [json.loads(line) for line in lines], clock.time_s


def refused(error: Exception) -> Callable[[], Lease]:
    def take() -> Lease:
        raise error

    return take


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BenchFile:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return load_bench_file(DEMO)


def test_it_is_tried_until_the_dead_runner_has_let_go_and_given_back_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: BenchFile
) -> None:
    runner, tries = take_lease(file, "run"), []

    def take() -> Lease:
        tries.append(1)
        if len(tries) == 5:
            runner.release()
        return take_lease(file, "the watchdog of a run")

    said: list[str] = []
    notes = _process._Notes.say

    def say(self: _process._Notes, event: _process.Event) -> None:
        said.append(f"{type(event).__name__}: {lease_holder(file)}")
        notes(self, event)

    monkeypatch.setattr(_process._Notes, "say", say)
    rows, took_s = taken_over(tmp_path, monkeypatch, take)
    assert [row["kind"] for row in rows] == ["takeover", "takeover_ended"]
    assert len(tries) == 5 and took_s < 0.2
    assert said[-1].startswith("TakeoverEnded") and "the watchdog of a run" in said[-1]
    assert lease_holder(file) is None


@pytest.mark.parametrize(
    ("error", "waited_s"),
    [
        (BenchInUse("in use"), 1.0),
        (ConfigurationError("no folder for it"), 0.0),
        (OSError(28, "no room on the disk"), 0.0),
    ],
)
def test_the_bench_is_stopped_without_it_and_the_record_says_so(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    error: Exception,
    waited_s: float,
) -> None:
    rows, took_s = taken_over(tmp_path, monkeypatch, refused(error))
    assert [row["kind"] for row in rows] == ["takeover", "alarm", "takeover_ended"]
    assert (rows[1]["device"], rows[1]["code"]) == ("bench", "unleased")
    assert waited_s <= took_s < waited_s + 0.1
    assert f"watchdog: its lease could not be taken, the bench is stopped all the same: {error}" in (
        capfd.readouterr().err
    )


def test_an_inherited_lease_is_not_taken_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    order = _process.Order(tmp_path, 1, (5,), {})
    assert order.take_lease is None and _process._lease(order, Clock()) is None  # type: ignore[arg-type]
