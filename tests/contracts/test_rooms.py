"""The house rules of docs/architecture.md, read from the source: who reads the clock, who imports whom."""

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROOMS = ("bench", "drivers", "procedures", "simulators")
CLOCK = Path("drivers/base/clock.py")
FORBIDDEN = {
    "drivers": {"bench", "procedures", "simulators"},
    "simulators": {"bench", "procedures"},
    "bench": {"simulators", "procedures"},
    "procedures": {"drivers", "simulators"},
}
COMPARES_WITH_EMULATION = {
    Path("bench/analysis/gap"): ("simulators.effects", "simulators.exam"),
    Path("bench/lab"): (
        "simulators.config",
        "simulators.faults",
        "simulators.lab.in_process",
        "simulators.lab.unit_alone",
    ),
}
"""The gap diagnosis holds a bench against its emulation and reads its effects; a lab is told what to be, and may
be in the bench's process: then it too hands out ports and a clock URL only. An FMU is told which
unit to execute."""
SOURCES = sorted(path.relative_to(ROOT) for room in ROOMS for path in (ROOT / room).rglob("*.py"))


def imports(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def clock_uses(tree: ast.AST) -> Iterator[str]:
    """Yield what reads or waits on the host's clock, however it was imported."""
    for name in imports(tree):
        if name == "time" or name.startswith("time.") or name in ("asyncio.sleep", "signal.setitimer"):
            yield f"imports {name}"
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and node.attr in ("now", "utcnow", "today"):
            owner = ast.unparse(node.value)
            if owner.split(".")[-1] in ("datetime", "date"):
                yield f"{owner}.{node.attr}"
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("signal.alarm", "signal.sigtimedwait"):
            yield ast.unparse(node.func)


def parse(path: Path) -> ast.Module:
    return ast.parse((ROOT / path).read_text(encoding="utf-8"))


@pytest.mark.parametrize("room", ROOMS)
def test_rooms_import_only_what_they_may(room: str) -> None:
    wrong = [
        f"{path}: {name}"
        for path in SOURCES
        if path.parts[0] == room
        for name in imports(parse(path))
        if name.split(".")[0] in FORBIDDEN[room]
        and not name.startswith(COMPARES_WITH_EMULATION.get(path.parent, ("no module",)))
    ]
    assert wrong == []


def test_only_the_clock_module_reads_or_waits_on_the_hosts_clock() -> None:
    wrong = [f"{path}: {use}" for path in SOURCES if path != CLOCK for use in clock_uses(parse(path))]
    assert wrong == []
    assert list(clock_uses(parse(CLOCK)))  # the check sees the one place that does


@pytest.mark.parametrize(
    "code",
    [
        "import time",
        "from time import sleep",
        "import time as t",
        "import datetime\ndatetime.datetime.now()",
        "from datetime import datetime as d, date\ndate.today()",
        "from asyncio import sleep",
    ],
)
def test_the_clock_check_finds(code: str) -> None:
    assert list(clock_uses(ast.parse(code)))


def test_simulators_use_only_codecs_clock_and_errors_of_the_drivers() -> None:
    """No driver class that talks to a link, no serial port: only what driver and emulator share."""
    wrong = [
        f"{path}: {name}"
        for path in SOURCES
        if path.parts[0] == "simulators"
        for name in imports(parse(path))
        if name.split(".")[0] in ("serial", "can") or name.startswith("drivers.kit.link")
    ]
    assert wrong == []


def test_every_source_file_says_what_it_is() -> None:
    assert [str(path) for path in SOURCES if ast.get_docstring(parse(path)) is None] == []


GENERIC = {"base", "kit", "slcan", "platform", "rlg", "can_dbc", "frames"}
"""Packages of drivers/ that are no maker's, and the kinds of drivers that read any unit by a description."""
MAKERS = {"acutronic", "aerosmith", "atl", "ellipse", "sensonor", "simserv", "vötsch"}
ENTRY_POINTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]


def families() -> set[str]:
    places = (ROOT / "drivers").iterdir()
    return {path.stem for path in places if path.stem[0] != "_" and path.name != "py.typed"}


def vendors() -> set[str]:
    kinds = {name.partition(".")[2] for name in ENTRY_POINTS["gyrobench.drivers"]}
    return (families() | kinds | MAKERS) - GENERIC


def test_the_bench_knows_no_vendor() -> None:
    """What a device is called and how it is configured is its driver's: nothing of it is a word of bench/."""
    word = re.compile(r"(?<![a-z0-9])(" + "|".join(sorted(vendors())) + r")(?![a-z0-9])", re.IGNORECASE)
    assert word.search('driver = "kvh1750"') and word.search("a Weiss chamber") and word.search("drivers.sbg")
    wrong = [
        f"{path}: {found.group()}"
        for path in SOURCES
        if path.parts[0] == "bench"
        for found in word.finditer((ROOT / path).read_text(encoding="utf-8"))
    ]
    assert wrong == []


def test_every_driver_is_registered_with_its_emulator() -> None:
    drivers, emulators = ENTRY_POINTS["gyrobench.drivers"], ENTRY_POINTS["gyrobench.emulators"]
    assert drivers.keys() == emulators.keys()
    assert {path.split(":")[0].split(".")[1] for path in drivers.values()} == families() - {
        "base",
        "kit",
        "slcan",
    }
    assert all(path.startswith("simulators.emulators.") for path in emulators.values())
