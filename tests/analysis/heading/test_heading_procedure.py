"""`heading-change` on a bench that only writes down what it is told."""

from __future__ import annotations

from contextlib import contextmanager
from typing import Any, cast

import pytest

from bench.control.session import Bench
from drivers.base.errors import ConfigurationError
from procedures.heading_change import PROCEDURE


class Told:
    """Stands for the bench, its table and its chamber: time is what was waited."""

    def __init__(self) -> None:
        self.told: list[tuple[Any, ...]] = []
        self.now_s = 0.0
        self.table = self.chamber = self.device = self
        self.name = "pins_1"
        self.platforms = {self.name: self}

    @contextmanager
    def step(self, code: str, title: str) -> Any:
        yield

    @contextmanager
    def polling(self, every_s: float) -> Any:
        yield

    def wait(self, duration_s: float, doing: str = "") -> None:
        self.now_s += duration_s

    def __getattr__(self, name: str) -> Any:
        def call(*values: Any, **named: Any) -> str:
            self.told.append((round(self.now_s / 3600.0, 3), name, *values))
            return "done"

        return call


def told(**settings: str) -> Told:
    parameters = PROCEDURE.parse(settings)
    bench = Told()
    PROCEDURE.run(cast(Bench, bench), parameters)
    assert PROCEDURE.expected_duration_s(parameters) == pytest.approx(bench.now_s, abs=100.0)
    return bench


def test_the_paper_s_sequence_is_run_and_said_to_be_too_little() -> None:
    bench = told(headings_deg="0, 90, 200", stays_h="110, 48, 34", warm_up_h="240", north_deg="10")
    points = [(row[0], row[2]) for row in bench.told if row[1] == "point"]
    assert points == [(0.0, 10.0), (350.0, 100.0), (398.0, 210.0), (432.0, 10.0)]
    assert [row[2] for row in bench.told if row[1] == "phase"] == [
        "warm_up",
        "heading_0",
        "heading_1",
        "heading_2",
    ]
    assert "2 headings beside the reference" in next(row[2] for row in bench.told if row[1] == "invalidate")


def test_default_sequence_is_enough() -> None:
    bench = told(clockwise="false")
    assert not [row for row in bench.told if row[1] == "invalidate"]
    assert [row[2] for row in bench.told if row[1] == "point"] == [0.0, 300.0, 240.0, 180.0, 120.0, 60.0, 0.0]
    assert bench.now_s == 3600.0 * (96 + 6 * 48)


def test_short_reference_is_named() -> None:
    bench = told(stays_h="12,48,48,48,48,48")
    assert "a sidereal day is needed" in next(row[2] for row in bench.told if row[1] == "invalidate")


@pytest.mark.parametrize(
    "settings",
    [{"headings_deg": "0, east"}, {"stays_h": "48, 48"}, {"stays_h": "1"}, {"warm_up_h": "-1"}],
)
def test_wrong_parameters_are_refused_before_anything_moves(settings: dict[str, str]) -> None:
    with pytest.raises(ConfigurationError, match="parameters that cannot be used"):
        PROCEDURE.parse(settings)
