"""Proves that a restructuring changed nothing: what two checkouts do from their command lines, held side by side.

    python -m benchmarks.goldens capture OUT [--command PATH_TO_GYROBENCH] [--only NAME ...] [--list]
    python -m benchmarks.goldens compare A B [--all]

A capture has a run folder of every example bench, what every command says about them, the files of every fit and
a blind exam of the gap diagnosis: `OUT/results/<item>` has a command's words, exit code, output and errors,
`OUT/work` the files. An item whose result is there is not run again; all take ten to thirteen minutes of one
processor. Nothing of the project is imported: any `gyrobench` will do, whatever its modules are called.
`_golden_items.py` lists the items, `_golden_compare.py` what may differ from one capture to the next and why.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from benchmarks._golden_compare import compare, shown
from benchmarks._golden_items import Item, derive_inputs, items

_ROOT = Path(__file__).parents[1]
_ENVIRONMENT = {
    "COLUMNS": "200", "LINES": "50", "TERM": "dumb", "NO_COLOR": "1", "TZ": "UTC", "LC_ALL": "C.UTF-8",
    "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "PYTHONHASHSEED": "0",
    "CUDA_VISIBLE_DEVICES": "",
}  # fmt: skip
_LAB_STARTS_S = 60.0
_LONGEST_S = 1800.0
_DONE = "command.json"


@dataclass(frozen=True)
class Capture:
    """Where a capture lies, by which command it is made, whose examples it takes."""

    folder: Path
    command: Path
    examples: Path

    @property
    def work(self) -> Path:
        return self.folder / "work"

    def result(self, item: Item) -> Path:
        return self.folder / "results" / item.name

    def done(self, item: Item) -> bool:
        return (self.result(item) / _DONE).exists()

    def prepare(self) -> None:
        """Make the work folder, once; what was begun is taken up again only with the same command."""
        about = self.folder / "capture.json"
        said = {"command": str(self.command), "folder": str(self.folder)}
        if about.exists():
            before = json.loads(about.read_text(encoding="utf-8"))
            if before != said:
                raise SystemExit(f"{self.folder} holds a capture made otherwise: {before}, not {said}")
            return
        shutil.copytree(self.examples, self.work / "examples")
        for name in ("runs", "out"):
            (self.work / name).mkdir()
        derive_inputs(self.work)
        about.write_text(json.dumps(said, indent=1), encoding="utf-8")

    def take(self, item: Item) -> dict[str, object]:
        """Run an item and keep what it said and made; return how that went."""
        self._clear(item)
        if item.before:
            item.before(self.work)
        begin, cpu_s = time.monotonic(), _cpu_s()
        with self._lab(item):
            done = subprocess.run(
                [str(self.command), *item.line.split()],
                cwd=self.work,
                env=_environment(),
                capture_output=True,
                stdin=subprocess.DEVNULL,
                timeout=_LONGEST_S,
                check=False,
            )
        problem = self._name_run(item)
        if item.after and done.returncode == 0:
            item.after(self.work)
        said: dict[str, object] = {
            "args": item.line.split(),
            "exit_code": done.returncode,
            "problem": problem,
            "wall_s": round(time.monotonic() - begin, 1),
            "cpu_s": round(_cpu_s() - cpu_s, 1),
        }
        target = self.result(item)
        target.mkdir(parents=True, exist_ok=True)
        (target / "stdout").write_bytes(done.stdout)
        (target / "stderr").write_bytes(done.stderr)
        (target / _DONE).write_text(json.dumps(said, indent=1), encoding="utf-8")
        return said

    def _clear(self, item: Item) -> None:
        """Take away what an attempt that was broken off left."""
        left = [*item.makes, *([f"runs/{item.run}.new"] if item.run else [])]
        for path in (self.work / name for name in left):
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)

    def _name_run(self, item: Item) -> str:
        """Move the one run folder that was recorded to its name; return why not, empty if all is well."""
        if not item.run:
            return ""
        made = self.work / "runs" / f"{item.run}.new"
        found = sorted(path for path in made.glob("*") if not path.name.startswith("."))
        if len(found) != 1:
            return f"{len(found)} run folders, not one"
        found[0].rename(self.work / "runs" / item.run)
        shutil.rmtree(made)
        return ""

    @contextmanager
    def _lab(self, item: Item) -> Iterator[None]:
        """Serve the item's emulated lab, if it has one, until the item is done."""
        if not item.lab:
            yield
            return
        lab = subprocess.Popen(
            [str(self.command), *item.lab.split()],
            cwd=self.work,
            env=_environment(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            bench = self.work / item.lab.partition(" --write ")[2]
            until = time.monotonic() + _LAB_STARTS_S
            while not bench.exists() and lab.poll() is None and time.monotonic() < until:
                time.sleep(0.05)
            yield
        finally:
            lab.terminate()  # not SIGINT: a shell's background jobs ignore it
            lab.wait(timeout=_LAB_STARTS_S)


def _environment() -> dict[str, str]:
    """Return the environment of every command: one thread, plain text, and no modules but the checkout's own."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | _ENVIRONMENT


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def capture(made: Capture, only: Sequence[str]) -> int:
    """Take every item that is not there yet, or those named; return 1 if one of those run had a problem."""
    wanted = [item for item in items() if not only or item.name in only]
    made.prepare()
    problems, begin = [], _cpu_s()
    for number, item in enumerate(wanted, 1):
        head = f"{number:3d} of {len(wanted)} {item.name}"
        if made.done(item) and not only:
            print(f"{head}: there", flush=True)
            continue
        said = made.take(item)
        print(
            f"{head}: exit {said['exit_code']}, {said['cpu_s']} s CPU, {said['wall_s']} s {said['problem']}",
            flush=True,
        )
        if said["problem"] or said["exit_code"] not in (0, 4):
            problems.append(item.name)
    print(f"{_cpu_s() - begin:.0f} s CPU; without a result: {', '.join(problems) or 'none'}")
    return 1 if problems else 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Capture, or compare two captures; 1 if something could not be captured or differs."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.goldens", description=(__doc__ or "").partition("\n")[0]
    )
    kinds = parser.add_subparsers(dest="kind", required=True)
    take = kinds.add_parser("capture", help="run everything and keep what it said and made")
    take.add_argument("out", type=Path)
    take.add_argument("--command", type=Path, default=Path(sys.executable).with_name("gyrobench"))
    take.add_argument("--examples", type=Path, default=_ROOT / "examples", help="default this checkout's")
    take.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="again, even if it is there"
    )
    take.add_argument("--list", action="store_true", help="name the items")
    both = kinds.add_parser("compare", help="report every difference, grouped by field")
    both.add_argument("a", type=Path)
    both.add_argument("b", type=Path)
    both.add_argument("--all", action="store_true", help="every place of a field, not the first few")
    asked = parser.parse_args(arguments)
    if asked.kind == "compare":
        found = compare(asked.a, asked.b)
        print(shown(found, everything=asked.all))
        return 1 if found else 0
    if asked.list:
        print("\n".join(item.name for item in items()))
        return 0
    if unknown := sorted(set(asked.only) - {item.name for item in items()}):
        parser.error(f"no item {', '.join(unknown)}; --list names them")
    return capture(
        Capture(asked.out.resolve(), asked.command.absolute(), asked.examples.resolve()), asked.only
    )


if __name__ == "__main__":
    sys.exit(main())
