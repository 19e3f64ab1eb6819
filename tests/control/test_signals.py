"""Signals while a record is closed, and displays that fail: neither ends what the bench is at."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import pytest

from bench.control.displays import Displays
from bench.control.run_record import RunRecord
from bench.control.signals import held
from bench.lab.emulated import EmulatedLab, Plant
from bench.lab.testing import TestBench
from bench.record.benchfile import bench_file_from, load_bench_file
from bench.record.recording import Run
from drivers.base.errors import RecordError
from tests.benches import FOG_BENCH

pytestmark = pytest.mark.concurrent
SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture
def came() -> Iterator[list[int]]:
    """The signals that reach whoever had them before."""
    numbers: list[int] = []

    def take(number: int, frame: FrameType | None) -> None:
        numbers.append(number)

    before = {number: signal.signal(number, take) for number in (signal.SIGINT, signal.SIGTERM)}
    before[signal.SIGHUP] = signal.getsignal(signal.SIGHUP)
    yield numbers
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", SIGNALS[:2])
def test_a_signal_comes_when_the_record_is_closed(
    came: list[int], number: int, capsys: pytest.CaptureFixture[str]
) -> None:
    with held("the record is being closed"):
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), number)
        assert not came
    assert came == [number]
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2 and said[0].endswith("the record is being closed, one moment")
    with held("nothing comes"):
        pass
    assert came == [number]


@pytest.mark.parametrize("number", SIGNALS[:2])
def test_a_run_that_is_being_closed_is_closed(
    came: list[int], number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = RunRecord.close

    def close(record: RunRecord, *facts: object) -> object:
        os.kill(os.getpid(), number)
        return whole(record, *facts)  # type: ignore[arg-type]

    monkeypatch.setattr(RunRecord, "close", close)
    (tmp_path / "bench.toml").write_text(FOG_BENCH)
    with EmulatedLab(load_bench_file(tmp_path / "bench.toml"), Plant(seed=5)) as lab:
        bench = TestBench(lab.file, tmp_path / "runs", lambda *_: None, lab=lab)
        result = bench.drive(lambda bench: bench.wait(1.0), judge=False)
    assert came == [number] and result.outcome == "completed"
    assert Run.open(result.folder).complete


@pytest.mark.parametrize(
    "error", [BrokenPipeError(32, "Broken pipe"), OSError(28, "No space"), SystemExit(1)]
)
def test_a_display_that_fails_is_left_out_and_the_run_goes_on(error: BaseException, tmp_path: Path) -> None:
    shown: list[int] = []

    def broken(_: object) -> None:
        shown.append(0)
        raise error

    said: list[str] = []
    displays = Displays([broken, lambda _: shown.append(1)], said.append)
    for _ in range(3):
        displays.show(None)  # type: ignore[arg-type]
    assert shown == [0, 1, 1, 1] and len(said) == 1 and "the run goes on" in said[0]


def test_other_errors_of_a_display_are_ours() -> None:
    def wrong(_: object) -> None:
        raise KeyError("a mistake of the code")

    with pytest.raises(KeyError):
        Displays([wrong], print).show(None)  # type: ignore[arg-type]


def test_a_runs_folder_without_a_name_in_utf_8_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(FOG_BENCH)
    file = bench_file_from(load_bench_file(tmp_path / "bench.toml").model_dump(mode="json"))
    with pytest.raises(RecordError, match="not UTF-8") as refused:
        RunRecord.create(tmp_path / "r\udcfcns", None, "turn", {}, file, None)
    assert "--runs" in refused.value.remedy and str(refused.value).encode()
