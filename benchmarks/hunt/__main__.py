"""The command: searches in process or through bytes, kept a line each; the best fixed order; kills; the table."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks._sections import stamp
from benchmarks.gap_exam.__main__ import put_section
from benchmarks.hunt._bytes import killed, through_bytes
from benchmarks.hunt._cases import Case, drawn_case
from benchmarks.hunt._order import find_order, keep_order, order_of
from benchmarks.hunt._plants import FibreOptic, HuntPlant, families
from benchmarks.hunt._seek import Searched, check, keep, keep_all, kept, seek
from benchmarks.hunt._strategies import SEARCH, STRATEGIES, strategy_of
from benchmarks.hunt._table import by_mode, tables

PAGE = Path(__file__).parents[2] / "docs" / "hunt.md"
TITLE = "## How long it takes"


def main(words: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hunt", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    searching = commands.add_parser("search", help="search what is not in the journal yet")
    _common(searching)
    searching.add_argument("--strategies", nargs="+", choices=STRATEGIES, default=STRATEGIES)
    ordering = commands.add_parser("order", help="find the best fixed order, on cases of its own seed")
    _common(ordering)
    byting = commands.add_parser(
        "bytes", help="search on emulated labs through bytes what is not in the journal yet"
    )
    _common(byting)
    checking = commands.add_parser(
        "check", help="make every run once more after searches that no run should have decided"
    )
    checking.add_argument("--out", type=Path, required=True, help="folder of the journal")
    killing = commands.add_parser("kill", help="kill one search ten times at random and compare its journal")
    killing.add_argument("--seed", type=int, default=1)
    killing.add_argument("--number", type=int, default=0, help="of the case")
    tabling = commands.add_parser("table", help="print the tables of journals")
    tabling.add_argument("folders", type=Path, nargs="+")
    tabling.add_argument("--write", action="store_true", help=f"put them into docs/{PAGE.name}")
    chosen = parser.parse_args(words)
    if chosen.command == "search":
        for one in _searched(chosen):
            print(_line(one), flush=True)
    elif chosen.command == "order":
        order: list[str] = []
        for name in find_order(list(_in_turn(chosen))):
            print(name, flush=True)
            order.append(name)
        keep_order(chosen.out, order)
    elif chosen.command == "bytes":
        for one in _through_bytes(chosen):
            print(_line(one), flush=True)
    elif chosen.command == "check":
        for one in _checked(chosen.out):
            print(_line(one), flush=True)
    elif chosen.command == "kill":
        return _kill(chosen.seed, chosen.number)
    else:
        _table(chosen.folders, write=chosen.write)
    return 0


def _table(folders: Sequence[Path], *, write: bool) -> None:
    lines: list[str] = []
    for mode, found in by_mode(list(kept(folders))).items():
        lines += [f"### Recorded {mode}", "", *tables(found, order_of(folders[0])), ""]
    print("\n".join(lines))
    if write:
        command = "python -m benchmarks.hunt table " + " ".join(folder.name for folder in folders)
        put_section(PAGE, TITLE, [stamp(command), "", *lines])


def _common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True, help="folder of the journal")
    parser.add_argument("--families", nargs="+", default=None, help="plant families (default: all)")
    parser.add_argument("--cases", type=int, default=8, help="cases of each family")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--from", dest="first", type=int, default=0, help="number of the first case")


def _searched(chosen: argparse.Namespace) -> Iterator[Searched]:
    known = {one.key for one in kept([chosen.out])}
    for plant, case in _in_turn(chosen):
        for name in chosen.strategies:
            if (case.family, case.name, name, "in process") in known:
                continue
            strategy = strategy_of(name, plant, case.seed, order_of(chosen.out))
            one = seek(plant, case, name, strategy)
            keep(chosen.out, one)
            yield one


def _through_bytes(chosen: argparse.Namespace) -> Iterator[Searched]:
    plant = FibreOptic()
    known = {one.key for one in kept([chosen.out])}
    for number in range(chosen.first, chosen.cases):
        case = drawn_case(plant, number, chosen.seed)
        if (case.family, case.name, SEARCH, "through bytes") in known:
            continue
        with tempfile.TemporaryDirectory() as place:
            one = through_bytes(plant, case, Path(place))
        keep(chosen.out, one)
        yield one


def _checked(folder: Path) -> Iterator[Searched]:
    """Check what was not checked yet; the journal has it at once."""
    plants = families()
    searches = list(kept([folder]))
    for place, one in enumerate(searches):
        if one.checked:
            continue
        plant = plants[one.family]
        case = Case(one.family, one.number, one.kind, one.seed, one.sizes)
        searches[place] = check(plant, case, one)
        keep_all(folder, searches)
        yield searches[place]


def _kill(seed: int, number: int) -> int:
    plant = FibreOptic()
    case = drawn_case(plant, number, seed)
    with tempfile.TemporaryDirectory() as place:
        kills, whole, broken = killed(plant, case, Path(place))
    same = whole == broken
    verdict = "the same" if same else "OTHERS"
    print(f"{case.name} [{case.acts}]: killed {kills} times, {len(whole)} entries, {verdict}")
    for one, other in zip(whole, broken, strict=False):
        if one != other:
            print(f"- {one}\n+ {other}")
    return 0 if same else 1


def _in_turn(chosen: argparse.Namespace) -> Iterator[tuple[HuntPlant, Case]]:
    """Yield the first case of each family, then the second of each."""
    plants = families()
    names = chosen.families or sorted(plants)
    for number in range(chosen.first, chosen.cases):
        for name in names:
            yield plants[name], drawn_case(plants[name], number, chosen.seed)


def _line(one: Searched) -> str:
    took_s = sum(step.diagnosis_s + step.choice_s for step in one.steps)
    mark = "right" if one.right else "WRONG" if one.wrong else "open" if one.checked else "to check"
    return (
        f"{one.case} {one.kind} [{one.truth}] {one.strategy}: {mark}, {one.ended}, {one.acts} "
        f"{100 * one.probability:.0f} %, {one.hours:.1f} h, {len(one.steps)} runs, {took_s:.0f} s"
    )


if __name__ == "__main__":
    sys.exit(main())
