"""SIGKILLs at random moments of recording, closing and saving a fit: what is left is recovered and verified.

Run as `python -m benchmarks.reliability [KILLS] [SEED]`; writes benchmarks/reliability.md. The recorder is a
process that hands a known stream to a `RunRecord` and reports through a pipe how much it has handed over when;
after the kill the bytes on the disk must be a prefix of the stream that holds all that was handed over an
interval earlier.
"""

from __future__ import annotations

import os
import random
import signal
import struct
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bench.benchfile import bench_file_from
from bench.recording import read_manifest, verify
from bench.recover import recover
from bench.run_record import RunRecord, decode_run
from bench.state_file import read_state, write_state
from drivers.clock import WallClock
from drivers.errors import BenchError

_REPORT = struct.Struct("<dq")
_BLOCK = 360
_RECORD_S = 1.6
_LATEST_KILL_S = 2.4
_FILE = {
    "bench": {"name": "kill test", "latitude_deg": 40.0},
    "table": {"driver": "acutrol3000", "port": "/nowhere/table"},
    "chamber": {"driver": "weiss", "port": "/nowhere/chamber"},
    "gyro": [{"name": "fog_1", "driver": "kvh1750", "unit": "F", "axis": "x", "port": "/nowhere/fog"}],
}


@dataclass
class Tally:
    """What became of the killed processes."""

    kills: int = 0
    moments: dict[str, int] = field(default_factory=dict)
    unreadable: int = 0
    false_complete: int = 0
    lost_beyond_interval: int = 0
    most_lost_bytes: int = 0
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
            record.event(clock.now(), "note", text=f"{total} bytes")
        record.check()
        clock.sleep(0.01)
    os.write(pipe, _REPORT.pack(-1.0, total))
    record.close("completed", "", clock.now())
    os.write(pipe, _REPORT.pack(-2.0, total))
    clock.sleep(10.0)


def _save(folder: Path, pipe: int) -> None:
    """Save a fit again and again."""
    for number in range(1_000_000):
        write_state(folder / "fit.gyrocomp", {"number": number, "weights": np.full(40_000, float(number))})
        os.write(pipe, _REPORT.pack(0.0, number))


def _killed(work: object, folder: Path, after_s: float) -> list[tuple[float, int]]:
    """Run `work` in a process, kill it `after_s` after its first report; return what it reported."""
    read, write = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(read)
        try:
            work(folder, write)  # type: ignore[operator]
        finally:
            os._exit(1)
    os.close(write)
    data = os.read(read, _REPORT.size)
    clock = WallClock()
    clock.sleep(after_s)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    clock.close()
    while more := os.read(read, 65536):
        data += more
    os.close(read)
    return list(_REPORT.iter_unpack(data[: len(data) // _REPORT.size * _REPORT.size]))


def _judge_record(folder: Path, reports: list[tuple[float, int]], tally: Tally) -> None:
    closing = any(time_s == -1.0 for time_s, _ in reports)
    closed = any(time_s == -2.0 for time_s, _ in reports)
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
    total = handed[-1][1]
    whole = raw == _stream(200_000)[: len(raw)]
    short = before.complete and len(raw) != total
    early = not closing and manifest.outcome == "completed"
    if early or short or not whole:
        tally.false_complete += 1
        tally.problems.append(f"{run}: {manifest.outcome}, {len(raw)} of {total} bytes")
    interval_s = manifest.flush_interval_s or 1.0
    due = [count for time_s, count in handed if closing or time_s <= handed[-1][0] - interval_s]
    missing = max(0, (due[-1] if due else 0) - len(raw))
    tally.lost_beyond_interval += missing
    tally.most_lost_bytes = max(tally.most_lost_bytes, total - len(raw))


def _judge_fit(folder: Path, tally: Tally) -> None:
    tally.count("saving a fit")
    try:
        state = read_state(folder / "fit.gyrocomp")
        if not (state["weights"] == float(state["number"])).all():
            raise BenchError("numbers of two fits in one file")
    except (BenchError, FileNotFoundError) as error:
        tally.unreadable += 1
        tally.problems.append(str(error))


def kill_test(kills: int, seed: int) -> Tally:
    """Kill `kills` processes at moments drawn from `seed`: two thirds record and close, a third save fits."""
    moments, tally = random.Random(seed), Tally()
    with tempfile.TemporaryDirectory() as root:
        for number in range(kills):
            folder = Path(root) / str(number)
            folder.mkdir()
            if number % 3 == 2:
                _killed(_save, folder, moments.uniform(0.0, 0.3))
                _judge_fit(folder, tally)
            else:
                reports = _killed(_record, folder, moments.uniform(0.0, _LATEST_KILL_S))
                _judge_record(folder, reports, tally)
    return tally


def main() -> None:
    """Run the kill test and write benchmarks/reliability.md."""
    kills = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    tally = kill_test(kills, seed)
    lines = [
        "# Reliability",
        "",
        f"Written by `python -m benchmarks.reliability {kills} {seed}`.",
        "",
        "| | |",
        "|---|---|",
        f"| SIGKILLs | {tally.kills} |",
        *(f"| of these while {moment} | {count} |" for moment, count in sorted(tally.moments.items())),
        f"| folders or fits that could not be read | {tally.unreadable} |",
        f"| runs that read complete and are not | {tally.false_complete} |",
        f"| bytes lost beyond the flush interval | {tally.lost_beyond_interval} |",
        f"| most bytes lost within it, of {_BLOCK} every 10 ms | {tally.most_lost_bytes} |",
        "",
    ]
    (Path(__file__).parent / "reliability.md").write_text("\n".join(lines), encoding="utf-8")
    print("\n".join(lines + tally.problems[:10]))


if __name__ == "__main__":
    main()
