"""A week of bench time in one run: memory, open files and threads stay what they were.

Run as `python -m benchmarks.week [DAYS]`; writes its section of benchmarks/reliability.md, and fails if memory
grew by more than a tenth from the end of the first day to the end of the last, or if a file or thread more is
open. The run is an emulated one in virtual time: table and chamber are polled once a second as on a real bench,
two gyros stream, the table turns back and forth every hour. The lab has a process of its own, which is not looked
at: it keeps the truth of every second.
"""

from __future__ import annotations

import sys
import tempfile
import textwrap
from dataclasses import dataclass
from pathlib import Path

from bench.control.procedure import Demands, Parameters, Procedure
from bench.control.questions import EmulatedOperator
from bench.control.run_record import decode_run
from bench.control.runner import RunRequest
from bench.control.session import Bench
from bench.lab.emulated import EmulatedLab, Plant
from bench.lab.rehearsal import run_in_lab
from bench.record.benchfile import bench_file_from
from bench.record.recording import Run, verify
from benchmarks._sealed_runs import FILE, GYROS
from benchmarks._sections import write_section
from drivers.base.clock import WallClock

_HOUR_S, _DAY_S = 3600.0, 86_400.0
_GYRO_HZ = 10
_MOST_GROWTH = 1.1


@dataclass(frozen=True)
class Sample:
    """What the process held at a time of the run."""

    day: float
    memory_mib: float
    files: int
    threads: int
    raw_mib: float
    wall_s: float


def _sample(bench_s: float, folder: Path, wall: WallClock) -> Sample:
    status = dict(
        line.split(":", 1)
        for line in Path("/proc/self/status").read_text("ascii").splitlines()
        if ":" in line
    )
    raw = sum(path.stat().st_size for path in folder.glob("*/raw/*"))
    return Sample(
        bench_s / _DAY_S,
        int(status["VmRSS"].split()[0]) / 1024,
        len(list(Path("/proc/self/fd").iterdir())),
        int(status["Threads"]),
        raw / (1 << 20),
        wall.now(),
    )


def week(days: float, runs: Path) -> tuple[list[Sample], Run]:
    """Make a run of so many days in `runs`; return a sample every six hours, and the run."""
    samples: list[Sample] = []
    wall = WallClock()

    def turn(bench: Bench, _: Parameters) -> None:
        bench.table.device.servo_on()
        bench.chamber.go_to(30.0)
        bench.chamber.start()
        for hour in range(round(days * 24.0)):
            bench.table.spin(5.0 if hour % 2 else -5.0)
            bench.wait(_HOUR_S - bench.now_s % _HOUR_S, "turning")
            if hour % 6 == 5:
                samples.append(_sample(bench.now_s, runs, wall))
                print(samples[-1], flush=True)
        bench.table.stop()

    gyros = [gyro | {"rate_hz": _GYRO_HZ} for gyro in GYROS]
    file = bench_file_from(FILE | {"gyro": gyros})
    length_s = days * _DAY_S
    procedure = Procedure(
        "week", "A week", "", Parameters, turn, lambda _: length_s, lambda _: Demands(5.0, 30.0, 30.0)
    )
    with EmulatedLab(file, Plant(seed=11), apart=True) as lab:
        request = RunRequest(
            procedure, Parameters(), file, runs, EmulatedOperator(lab.perform), run_id="week"
        )
        result = run_in_lab(request, lab)
    if result.outcome != "completed":
        raise RuntimeError(f"the run ended as {result.outcome}: {result.reason}")
    samples.append(_sample(result.duration_s, runs, wall))
    wall.close()
    return samples, Run.open(result.folder)


def _line(when: str, sample: Sample) -> str:
    cells = (
        f"{sample.memory_mib:.1f}",
        sample.files,
        sample.threads,
        f"{sample.raw_mib:.1f}",
        f"{sample.wall_s:.0f}",
    )
    return f"| {when} | {' | '.join(map(str, cells))} |"


def main() -> int:
    """Make the run and write the section; 1 if something grew or the record is not whole."""
    days = float(sys.argv[1]) if len(sys.argv) > 1 else 7.0
    with tempfile.TemporaryDirectory(prefix="gyrobench-week-") as folder:
        samples, run = week(days, Path(folder))
        *inside, after = samples
        polls = len(run.turntable(("time_ns",))["time_ns"])
        lost = sum(int(entry["lost"]) for entry in run.manifest.stream.values())
        whole = verify(Path(str(run.place)), decode_run).passed
    first, last = next(sample for sample in inside if sample.day >= min(1.0, inside[-1].day)), inside[-1]
    flat = last.memory_mib <= _MOST_GROWTH * first.memory_mib
    flat &= (last.files, last.threads) == (first.files, first.threads)
    text = (
        f"{days:g} days of bench time in one run, {after.wall_s / 60.0:.0f} min of wall time: {polls:,} polls of "
        f"the table, two gyros at {_GYRO_HZ} Hz, {lost} frames lost, record {'' if whole else 'NOT '}verified. "
        f"From the end of day {first.day:g} to that of day {last.day:g} memory went from {first.memory_mib:.1f} "
        f"to {last.memory_mib:.1f} MiB. What is needed to decode and to seal at the end is in the last row."
    )
    lines = [
        *textwrap.wrap(text, 110),
        "",
        "| day | memory, MiB | open files | threads | raw, MiB | wall, s |",
        "|---|---|---|---|---|---|",
        *(_line(f"{sample.day:.2f}", sample) for sample in inside),
        _line("closed", after),
    ]
    print(write_section("A week in one run", f"python -m benchmarks.week {days:g}", lines))
    return 0 if flat and whole else 1


if __name__ == "__main__":
    sys.exit(main())
