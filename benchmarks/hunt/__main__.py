"""The command: searches in process or through bytes, kept a line each; the best fixed order; kills; the table."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.hunt._cases import Case, drawn_case
from benchmarks.hunt._plants import HuntPlant, families
from benchmarks.hunt._seek import Searched, keep, kept, seek
from benchmarks.hunt._strategies import DEFAULT_ORDER, STRATEGIES, strategy_of


def main(words: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hunt", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    searching = commands.add_parser("search", help="search what is not in the journal yet")
    _common(searching)
    searching.add_argument("--strategies", nargs="+", choices=STRATEGIES, default=STRATEGIES)
    searching.add_argument("--from", dest="first", type=int, default=0, help="number of the first case")
    chosen = parser.parse_args(words)
    if chosen.command == "search":
        for one in _searched(chosen):
            print(_line(one), flush=True)
    return 0


def _common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True, help="folder of the journal")
    parser.add_argument("--families", nargs="+", default=None, help="plant families (default: all)")
    parser.add_argument("--cases", type=int, default=8, help="cases of each family")
    parser.add_argument("--seed", type=int, default=1)


def _searched(chosen: argparse.Namespace) -> Iterator[Searched]:
    known = {one.key for one in kept([chosen.out])}
    for plant, case in _in_turn(chosen):
        for name in chosen.strategies:
            if (case.family, case.name, name, "in process") in known:
                continue
            strategy = strategy_of(name, plant, case.seed, DEFAULT_ORDER)
            one = seek(plant, case, name, strategy)
            keep(chosen.out, one)
            yield one


def _in_turn(chosen: argparse.Namespace) -> Iterator[tuple[HuntPlant, Case]]:
    """Yield the first case of each family, then the second of each."""
    plants = families()
    names = chosen.families or sorted(plants)
    for number in range(chosen.first, chosen.cases):
        for name in names:
            yield plants[name], drawn_case(plants[name], number, chosen.seed)


def _line(one: Searched) -> str:
    took_s = sum(step.diagnosis_s + step.choice_s for step in one.steps)
    mark = "right" if one.right else "WRONG" if one.wrong else "open"
    return (
        f"{one.case} {one.kind} [{one.truth}] {one.strategy}: {mark}, {one.ended}, {one.acts} "
        f"{100 * one.probability:.0f} %, {one.hours:.1f} h, {len(one.steps)} runs, {took_s:.0f} s"
    )


if __name__ == "__main__":
    sys.exit(main())
