"""The command: make cases of a family, diagnose a folder of cases, score folders (see the package)."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks._sections import stamp
from benchmarks.gap_exam._answer import answer_all
from benchmarks.gap_exam._claims import claims_of, claims_table
from benchmarks.gap_exam._compare import compared
from benchmarks.gap_exam._families import FAMILIES, make_cases
from benchmarks.gap_exam._make import KINDS
from benchmarks.gap_exam._rotate import rotate, rotation_table
from benchmarks.gap_exam._score import marked_cases
from benchmarks.gap_exam._table import details, table
from drivers.base.files import replace_file

PAGE = Path(__file__).parents[2] / "docs" / "gap_exam.md"
TITLE = "## Plant families"


def main(words: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap_exam", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    making = commands.add_parser("make", help="make blind cases of a plant family")
    making.add_argument("family", choices=sorted(FAMILIES))
    making.add_argument("--seed", type=int, required=True)
    making.add_argument("--cases", type=int, default=36)
    making.add_argument("--only", choices=KINDS, default="", help="cases of one kind")
    making.add_argument("--out", type=Path, required=True)
    making.add_argument("--jobs", type=int, default=1)
    answering = commands.add_parser("diagnose", help="diagnose the cases of a folder that have no answer yet")
    answering.add_argument("folder", type=Path)
    answering.add_argument("--jobs", type=int, default=1)
    rotating = commands.add_parser(
        "rotate",
        help="answer cases with constants changed; with several folders a table, each left out in turn",
    )
    rotating.add_argument("folders", type=Path, nargs="+")
    claiming = commands.add_parser(
        "claims", help="how often what was stated is true, by its size and what is left"
    )
    claiming.add_argument("folders", type=Path, nargs="+")
    comparing = commands.add_parser(
        "compare", help="the cases that are right or wrong in another way, answered by two states of the code"
    )
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    scoring = commands.add_parser("score", help="print the table, a column a folder")
    scoring.add_argument("folders", type=Path, nargs="+")
    scoring.add_argument("--details", action="store_true", help="a line a case, too")
    scoring.add_argument("--write", action="store_true", help=f"put the table into docs/{PAGE.name}")
    chosen = parser.parse_args(words)
    if chosen.command == "make":
        for name in make_cases(
            chosen.family, chosen.seed, chosen.cases, chosen.only, chosen.out, chosen.jobs
        ):
            print(name, flush=True)
    elif chosen.command == "diagnose":
        for name, seconds, verdict in answer_all(chosen.folder, chosen.jobs):
            print(f"{name}: {verdict} ({seconds:.1f} s)", flush=True)
    elif chosen.command == "rotate":
        for folder in chosen.folders:
            for name in rotate(folder):
                print(f"{folder.name}: {name}", flush=True)
        if len(chosen.folders) > 1:
            print("\n".join(rotation_table(chosen.folders)))
    elif chosen.command == "claims":
        if len(chosen.folders) < 2:
            parser.error("claims judges each family by the others: name two folders or more")
        print("\n".join(claims_table(list(claims_of(chosen.folders)))))
    elif chosen.command == "compare":
        for line in compared(chosen.before, chosen.after):
            print(line)
    else:
        _score(chosen.folders, with_details=chosen.details, write=chosen.write)
    return 0


def _score(folders: Sequence[Path], *, with_details: bool, write: bool) -> None:
    columns = [(folder.resolve().name, list(marked_cases(folder))) for folder in folders]
    lines = table(columns)
    print("\n".join(lines))
    if with_details:
        for name, cases in columns:
            print("\n".join([f"\n{name}", *details(cases)]))
    if write:
        command = "python -m benchmarks.gap_exam score " + " ".join(name for name, _ in columns)
        put_section(PAGE, TITLE, [stamp(command), "", *lines])


def put_section(page: Path, title: str, lines: Sequence[str]) -> None:
    """Put a section into a page in place of the one of that title, or at its end."""
    text = page.read_text(encoding="utf-8")
    head, found, rest = text.partition(f"\n{title}\n")
    following = rest.find("\n## ") if found else -1
    tail = rest[following:] if following >= 0 else ""
    replace_file(page, "\n".join([head.rstrip("\n"), "", title, "", *lines]) + "\n" + tail)


if __name__ == "__main__":
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    sys.exit(main())
