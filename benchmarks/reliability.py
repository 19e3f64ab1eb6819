"""SIGKILLs at random moments of recording, closing and saving a fit: what is left is recovered and verified.

Run as `python -m benchmarks.reliability [KILLS] [SEED]`; writes its section of benchmarks/reliability.md. The
recorder is a process that hands a known stream to a `RunRecord` and reports through a pipe how much it has handed
over when; after the kill the bytes on the disk must be a prefix of the stream that holds all that was handed over
an interval earlier. A third of the kills come while it records, a third while it closes, a third while the files
of a fit (compensation, C header, ONNX) are saved again and again.
"""

from __future__ import annotations

import os
import random
import re
import signal
import statistics
import struct
import sys
import tempfile
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bench.analysis.common.state_file import read_state, save_file, write_state
from bench.control.recover import recover
from bench.control.run_record import RunRecord, decode_run
from bench.record.benchfile import bench_file_from
from bench.record.events.run import Note
from bench.record.recording import read_manifest, verify
from benchmarks._sections import write_section
from drivers.base.clock import WallClock
from drivers.base.errors import BenchError

_REPORT = struct.Struct("<dq")
_BLOCK = 360
_EVERY_S = 0.01
_RECORD_S = 1.6
_CLOSES_S = 0.4
"""Closing takes less than that on a quiet machine; moments are drawn more densely towards its beginning."""
_WEIGHTS = 40_000
_CLOSING, _CLOSED = -1.0, -2.0
_FILE = {
    "bench": {"name": "kill test", "latitude_deg": 40.0},
    "table": {"driver": "acutrol3000", "port": "/nowhere/table"},
    "chamber": {"driver": "weiss", "port": "/nowhere/chamber"},
    "gyro": [{"name": "fog_1", "driver": "kvh1750", "unit": "F", "axis": "x", "port": "/nowhere/fog"}],
}

Reports = list[tuple[float, int]]
Work = Callable[[Path, int], None]


@dataclass
class Tally:
    """What became of the killed processes."""

    kills: int = 0
    moments: dict[str, int] = field(default_factory=dict)
    unreadable: int = 0
    false_complete: int = 0
    lost_beyond_interval: int = 0
    lost_s: list[float] = field(default_factory=list)
    """By kill while recording: the age of the oldest byte that was lost, s."""
    problems: list[str] = field(default_factory=list)

    def count(self, moment: str) -> None:
        """Count a kill at `moment`."""
        self.kills += 1
        self.moments[moment] = self.moments.get(moment, 0) + 1


def _stream(count: int) -> bytes:
    return (np.arange(count, dtype=np.int64) * 2654435761 >> 7).astype(np.uint8).tobytes()


def _record(folder: Path, pipe: int) -> None:
    """Hand a known stream to a record for a while, then close it."""
    clock = WallClock()
    record = RunRecord.create(folder, "run", "kill", {}, bench_file_from(_FILE), None)
    port = record.tap("fog_1")
    record.tap("table")
    record.tap("chamber")
    record.stream_starts("fog_1", 0)
    stream, total = _stream(200_000), 0
    while clock.now() < _RECORD_S:
        port.received(stream[total : total + _BLOCK], clock.now())
        total += _BLOCK
        os.write(pipe, _REPORT.pack(clock.now(), total))
        if total // _BLOCK % 60 == 0:
            record.event(clock.now(), Note(f"{total} bytes"))
        record.check()
        clock.sleep(_EVERY_S)
    os.write(pipe, _REPORT.pack(_CLOSING, total))
    record.close("completed", "", clock.now())
    os.write(pipe, _REPORT.pack(_CLOSED, total))
    clock.sleep(10.0)


def _save(folder: Path, pipe: int) -> None:
    """Save the files of a fit again and again."""
    for number in range(1_000_000):
        write_state(folder / "fit.gyrocomp", {"number": number, "weights": np.full(_WEIGHTS, float(number))})
        save_file(folder / "fit.h", f"{number}," * _WEIGHTS)
        save_file(folder / "fit.onnx", np.full(_WEIGHTS, number, np.int32).tobytes())
        os.write(pipe, _REPORT.pack(0.0, number))


def _killed(work: Work, folder: Path, after_s: float, mark_s: float = 0.0) -> Reports:
    """Run `work` in a process, kill it `after_s` after its first report at `mark_s`; return what it reported."""
    read, write = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(read)
        try:
            work(folder, write)
        finally:
            os._exit(1)
    os.close(write)
    data = b""
    while more := os.read(read, _REPORT.size):
        data += more
        if mark_s >= 0.0 or any(time_s == mark_s for time_s, _ in _reports(data)):
            break
    clock = WallClock()
    clock.sleep(after_s)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    clock.close()
    while more := os.read(read, 65536):
        data += more
    os.close(read)
    return _reports(data)


def _reports(data: bytes) -> Reports:
    return list(_REPORT.iter_unpack(data[: len(data) // _REPORT.size * _REPORT.size]))


def _judge_record(folder: Path, reports: Reports, tally: Tally) -> None:
    closing = any(time_s == _CLOSING for time_s, _ in reports)
    closed = any(time_s == _CLOSED for time_s, _ in reports)
    handed = [(time_s, total) for time_s, total in reports if time_s >= 0.0]
    tally.count("after closing" if closed else "closing" if closing else "recording")
    run = folder / "run"
    try:
        before = read_manifest(run)
        manifest = recover(run)
        rebuilt = verify(run, decode_run)
        if rebuilt.problems:
            raise BenchError(str(rebuilt.problems[0]))
    except BenchError as error:
        tally.unreadable += 1
        tally.problems.append(str(error))
        return
    raw = (run / "raw" / "fog_1.bin").read_bytes()
    last_s, total = handed[-1]
    whole = raw == _stream(200_000)[: len(raw)]
    short = before.complete and len(raw) != total
    early = not closing and manifest.outcome == "completed"
    if early or short or not whole:
        tally.false_complete += 1
        tally.problems.append(f"{run}: {manifest.outcome}, {len(raw)} of {total} bytes")
    interval_s = manifest.flush_interval_s or 1.0
    due = [count for time_s, count in handed if time_s <= last_s - interval_s]
    tally.lost_beyond_interval += max(0, (due[-1] if due else 0) - len(raw))
    if not closing:
        first_lost = bisect_right([count for _, count in handed], len(raw))
        tally.lost_s.append(last_s - handed[first_lost][0] if first_lost < len(handed) else 0.0)


def _judge_fit(folder: Path, tally: Tally) -> None:
    tally.count("saving a fit")
    try:
        state = read_state(folder / "fit.gyrocomp")
        header = re.fullmatch(r"(\d+),(?:\1,)*", (folder / "fit.h").read_text("ascii"))
        onnx = np.frombuffer((folder / "fit.onnx").read_bytes(), np.int32)
        whole = (state["weights"] == float(state["number"])).all() and len(state["weights"]) == _WEIGHTS
        if not whole or header is None or header[0].count(",") != _WEIGHTS or len(onnx) != _WEIGHTS:
            raise BenchError("a file of a fit is not whole", where=str(folder))
    except (BenchError, OSError, ValueError) as error:
        tally.unreadable += 1
        tally.problems.append(str(error))


def kill_test(kills: int, seed: int) -> Tally:
    """Kill `kills` processes at moments drawn from `seed`."""
    moments, tally = random.Random(seed), Tally()
    with tempfile.TemporaryDirectory() as root:
        for number in range(kills):
            folder = Path(root) / str(number)
            folder.mkdir()
            if number % 3 == 0:
                _judge_record(folder, _killed(_record, folder, moments.uniform(0.0, _RECORD_S)), tally)
            elif number % 3 == 1:
                after_s = _CLOSES_S * moments.random() ** 3
                _judge_record(folder, _killed(_record, folder, after_s, _CLOSING), tally)
            else:
                _killed(_save, folder, moments.uniform(0.0, 0.3))
                _judge_fit(folder, tally)
    return tally


def main() -> int:
    """Run the kill test and write its section; 1 if a promise was broken."""
    kills = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    tally = kill_test(kills, seed)
    lost = tally.lost_s or [0.0]
    lines = [
        "| | |",
        "|---|---|",
        f"| SIGKILLs | {tally.kills} |",
        *(f"| of these while {moment} | {count} |" for moment, count in sorted(tally.moments.items())),
        f"| folders or fits that could not be read | {tally.unreadable} |",
        f"| runs that read complete and are not | {tally.false_complete} |",
        f"| bytes lost beyond the flush interval of 1 s | {tally.lost_beyond_interval} |",
        f"| age of the oldest byte lost while recording, median | {statistics.median(lost):.2f} s |",
        f"| the same, worst | {max(lost):.2f} s |",
        "",
        *(f"- {problem}" for problem in tally.problems[:10]),
    ]
    print(write_section("Kills", f"python -m benchmarks.reliability {kills} {seed}", lines))
    return 1 if tally.unreadable or tally.false_complete or tally.lost_beyond_interval else 0


if __name__ == "__main__":
    sys.exit(main())
