"""Listing 100,000 runs from the catalogue, against reading their manifests, in the same run.

Run as `python -m benchmarks.catalogue [RUNS]` (default 100,000; about a minute and 1 GB of small files in a
temporary folder). The yardstick of a list is the budget of 0.3 s, that of the catalogue a loop over the folders.
"""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from time import process_time

from bench.record.catalogue import Catalogue, root_name
from bench.record.run_folder import MANIFEST_FILE
from benchmarks._measure import Row, figure, usual
from drivers.base.clock import host_seconds

_BUDGET_S = 0.3
_NEW_GOAL_S = 1.0
_REPEATS = 5
_DURATION_S = 14_000.0


def make_runs(runs: Path, count: int) -> None:
    """Write `count` run folders with manifests of the usual size, written when their runs ended."""
    bench = {
        "bench": {"name": "bench 2", "latitude_deg": 39.98},
        "gyro": [{"name": f"g{k}", "text": "x" * 300} for k in range(4)],
    }
    files = {f"raw/port_{k}.bin": {"sha256": "0" * 64, "bytes": 1 << 20} for k in range(16)}
    for number in range(count):
        folder = runs / f"2026{number:08d}-zero-bias-cold-shock"
        folder.mkdir()
        started = datetime(2010 + number % 17, 1 + number % 12, 1 + number % 28, 8, tzinfo=UTC)
        manifest = {
            "format": 1,
            "run_id": folder.name,
            "procedure": ("zero-bias-cold-shock", "scale-factor-cold-shock", "thermal-ramp")[number % 3],
            "outcome": "completed",
            "started_utc": started.isoformat(),
            "duration_s": _DURATION_S,
            "units": {"fog_1": f"SN{number % 500}"},
            "bench": bench,
            "files": files,
        }
        path = folder / MANIFEST_FILE
        path.write_text(json.dumps(manifest), encoding="utf-8")
        ended_s = started.timestamp() + _DURATION_S
        os.utime(path, (ended_s, ended_s))


def rows(count: int | None = None) -> list[Row]:
    """Return seconds of a list (budget / ours), of the whole command, and of a rebuild against a plain loop."""
    count = count or usual(100_000, 20_000)
    with tempfile.TemporaryDirectory(prefix="gyrobench-catalogue-") as scratch:
        runs = Path(scratch) / "runs"
        runs.mkdir()
        make_runs(runs, count)
        os.utime(runs, ns=(10**18, 10**18))
        begin = host_seconds()
        units = {
            folder.name: json.loads((folder / "manifest.json").read_bytes())["units"]
            for folder in runs.iterdir()
        }
        loop_s = host_seconds() - begin
        begin = process_time()
        _floor(runs)
        floor_s = process_time() - begin
        _, new_s = _process(["runs", "list", str(runs), "--catalogue", f"sqlite:///{scratch}/new.sqlite"])
        begin = host_seconds()
        with Catalogue(f"sqlite:///{scratch}/runs.sqlite") as catalogue:
            catalogue.rebuild(runs)
        rebuild_s = host_seconds() - begin
        asked_s = statistics.median(_ask(f"sqlite:///{scratch}/runs.sqlite", runs) for _ in range(_REPEATS))
        commands = [_command(f"sqlite:///{scratch}/runs.sqlite", runs) for _ in range(_REPEATS)]
        assert len(units) == count
    title = f"{count:,} runs"
    cpu_s = statistics.median(seconds for _, seconds in commands)
    limit = "limit of the design"
    new = f"{title}: `gyrobench runs list`, all of them new, processor time"
    return [
        figure(new, new_s, _NEW_GOAL_S, "goal", "s", least=True),
        figure(new, new_s, floor_s, "limit: scandir, every manifest read and parsed", "s", least=True),
        figure(
            f"{title}: one unit, one procedure, since 2026-10", asked_s, _BUDGET_S, limit, "s", least=True
        ),
        figure(
            f"{title}: `gyrobench runs list`, best of {_REPEATS}",
            min(commands)[0],
            _BUDGET_S,
            limit,
            "s",
            least=True,
        ),
        figure(f"{title}: `gyrobench runs list`, processor time", cpu_s, _BUDGET_S, limit, "s", least=True),
        figure(
            f"{title}: catalogue made anew",
            rebuild_s,
            loop_s,
            "a json.loads loop over the folders",
            "s",
            least=True,
        ),
    ]


def _floor(runs: Path) -> None:
    """Find every run folder, read and parse its manifest: nothing is looked at, nothing kept."""
    with os.scandir(runs) as entries:
        names = [entry.name for entry in entries if entry.is_dir()]
    for name in names:
        descriptor = os.open(f"{runs}/{name}/{MANIFEST_FILE}", os.O_RDONLY)
        json.loads(os.read(descriptor, 1 << 16))
        os.close(descriptor)


def _ask(url: str, runs: Path) -> float:
    begin = host_seconds()
    with Catalogue(url) as catalogue:
        catalogue.update(runs)
        found, _ = catalogue.find(
            root=root_name(runs), unit="SN123", procedure="zero-bias-cold-shock", since="2026-10"
        )
    assert all("SN123" in row.units for row in found)
    return host_seconds() - begin


def _command(url: str, runs: Path) -> tuple[float, float]:
    """Return wall time and processor time of the whole process, s."""
    arguments = [
        "runs",
        "list",
        str(runs),
        "--catalogue",
        url,
        "--unit",
        "SN123",
        "--since",
        "2026-10",
    ]
    return _process(arguments)


def _process(arguments: list[str]) -> tuple[float, float]:
    """Return wall time and processor time, s, of `gyrobench` with `arguments`, its start included."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), host_seconds()
    subprocess.run(
        [sys.executable, "-c", "from bench.present.cli import main; main()", *arguments],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    wall_s, after = host_seconds() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall_s, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print the rows."""
    for row in rows(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000):
        print(f"{row['benchmark']}: {row['ours']:.3f} s, {row['yardstick_name']} {row['yardstick']:.3f} s")


if __name__ == "__main__":
    main()
