"""An exam's folder: what was planned, and a line for every case marked, so that a part can be read, too."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from bench.analysis.common.fan_out import ALONE, FanOut
from bench.analysis.gap._examination import examine
from bench.analysis.gap._score import Exam, Marked
from drivers.base.errors import ConfigurationError

RESULTS_FILE = "results.jsonl"
PLAN_FILE = "exam.json"


def hold_exam(
    cases: int, seed: int, folder: Path, fan: FanOut = ALONE
) -> Iterator[tuple[str, Marked | None]]:
    """Hold an exam, keep its results in a new folder; yield what `examine` does, case by case."""
    if cases < 1 or seed < 0:
        raise ConfigurationError(
            "an exam needs cases", found=f"{cases} cases, seed {seed}", expected="at least 1"
        )
    if (folder / RESULTS_FILE).exists():
        raise ConfigurationError(
            "the folder holds an exam already",
            where=str(folder),
            expected="a new folder",
            remedy="--from FOLDER prints the table of an exam held before",
        )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / PLAN_FILE).write_text(json.dumps({"seed": seed, "cases": cases}) + "\n", encoding="utf-8")
    for shown, one in examine(cases, seed, folder, fan):
        if one is not None:
            with (folder / RESULTS_FILE).open("a", encoding="utf-8") as lines:
                lines.write(one.line + "\n")
        yield shown, one


def read_exam(folder: Path) -> Exam:
    """Return the exam that a folder holds, finished or not; ConfigurationError without a case marked."""
    lines = []
    for name in (PLAN_FILE, RESULTS_FILE):
        try:
            lines.append((folder / name).read_text(encoding="utf-8").splitlines())
        except OSError as error:
            raise ConfigurationError(
                "the folder holds no exam's results",
                where=str(folder),
                found=f"{name}: {error.strerror}",
                expected="the folder that `gyrobench gap exam --out` writes, one case finished at least",
            ) from error
    plan = json.loads("".join(lines[0]))
    return Exam(plan["seed"], plan["cases"], tuple(Marked.from_line(line) for line in lines[1]))
