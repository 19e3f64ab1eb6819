"""Many newer sessions in a runs folder: a bench in danger stays on the strip until somebody has seen it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from bench.present.panel import _benches
from bench.present.panel._benches import Benches
from bench.present.panel._folders import RunsFolder
from tests.present.panel.browser import write_now

GONE = 2**22 - 7
"""A process that is not there."""


def strip(benches: Benches, monkeypatch: pytest.MonkeyPatch, now_s: float) -> dict[str, str]:
    monkeypatch.setattr(_benches, "host_seconds", lambda: now_s)
    benches.update()
    return {entry["name"]: entry["tone"] for entry in benches.strip()}


@pytest.mark.parametrize("newer", [5, 30, 120])
def test_a_bench_in_danger_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, newer: int) -> None:
    write_now(tmp_path / "east", "east", pid=GONE, process_start=1)
    for number in range(newer):
        write_now(
            tmp_path / f"run-{number:03d}",
            "rehearsal",
            pid=GONE,
            process_start=1,
            state="ended",
            outcome="completed",
        )
    for number, path in enumerate([tmp_path / "east", *sorted(tmp_path.glob("run-*"))]):
        os.utime(path / "live" / "now.json", (1e9 + number, 1e9 + number))
    benches = Benches(RunsFolder(tmp_path))
    shown: dict[str, str] = {}
    for look in range(6):  # older ones are looked at some at a time
        shown = strip(benches, monkeypatch, 1000.0 + 3.0 * look)
    assert shown["bench of east"] == "bad" and len(shown) == 2
    assert len(benches.sessions) <= 25


def test_of_older_ones_only_the_last_word_of_a_bench_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(40):
        title = "west" if number < 10 else "rehearsal"
        write_now(
            tmp_path / f"run-{number:03d}",
            title,
            pid=GONE,
            process_start=1,
            state="ended",
            outcome="completed",
        )
        os.utime(tmp_path / f"run-{number:03d}" / "live" / "now.json", (1e9 + number, 1e9 + number))
    benches = Benches(RunsFolder(tmp_path))
    shown = strip(benches, monkeypatch, 1000.0)
    assert set(shown) == {"bench of west", "bench of rehearsal"}
    (west,) = [session for session in benches.sessions if session.bench == "bench of west"]
    assert west.name == "run-009"
