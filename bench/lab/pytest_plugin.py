"""The pytest plug-in: fixtures `emulated_bench` and `bench`, measurements in the JUnit file. See docs/pytest.md.

Nothing of the bench is imported before a test asks for it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from bench.lab.emulated import Plant
    from bench.lab.testing import TestBench
    from bench.record.benchfile import BenchFile


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of the `bench` fixture."""
    group = parser.getgroup("gyrobench", "gyro test bench")
    group.addoption(
        "--bench",
        metavar="FILE",
        help="bench file (TOML): the `bench` fixture drives its devices; without it, an emulated bench",
    )
    group.addoption(
        "--bench-yes",
        action="store_true",
        help="answer the operator's questions on a real bench beforehand: it is prepared",
    )
    group.addoption("--bench-runs", metavar="FOLDER", help="where run folders go; default a temporary folder")
    parser.addini("gyrobench_bench", "bench file that emulated benches are like (default: one FOG, one MEMS)")


@pytest.fixture
def bench_plant() -> Plant:
    """The physics behind an emulated bench; override it to choose seed, models or chamber."""
    from bench.lab.emulated import Plant

    return Plant()


@pytest.fixture
def emulated_bench(request: pytest.FixtureRequest) -> Iterator[TestBench]:
    """A bench on an emulated lab in virtual time, fresh for every test."""
    _require_rooms()
    from bench.lab.emulated import EmulatedLab
    from bench.lab.testing import usual_bench

    like = request.config.getini("gyrobench_bench")
    file = usual_bench(request.config.rootpath / like if like else None)
    with EmulatedLab(file, request.getfixturevalue("bench_plant")) as lab:
        yield _test_bench(request, lab.file, lab=lab)


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> TestBench:
    """The bench of `--bench FILE`, or an emulated one."""
    _require_rooms()
    from bench.record.benchfile import load_bench_file

    path = request.config.getoption("--bench")
    if path is None:
        emulated: TestBench = request.getfixturevalue("emulated_bench")
        return emulated
    yes = bool(request.config.getoption("--bench-yes"))
    return _test_bench(request, load_bench_file(path), yes=yes)


def _require_rooms() -> None:
    """Fail in one sentence where a folder beside the tests hides one of our packages."""
    from gyrobench._rooms import check_rooms

    try:
        check_rooms()
    except ImportError as error:
        raise pytest.fail.Exception(str(error), pytrace=False) from None


def _test_bench(request: pytest.FixtureRequest, file: BenchFile, **how: Any) -> TestBench:
    from bench.lab.testing import TestBench

    given = request.config.getoption("--bench-runs")
    runs = Path(given) if given else request.getfixturevalue("tmp_path") / "runs"
    properties = request.node.user_properties  # what `record_property` adds to, with a warning about xunit2
    return TestBench(file, runs, lambda name, value: properties.append((name, value)), **how)
