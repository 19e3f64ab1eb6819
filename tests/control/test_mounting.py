"""The part of a rotation that an axis under test feels, by geometry, and what a run makes of it."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from bench.control.mounting import Mountings, Turning
from bench.control.procedure import Demands, Parameters, Procedure
from bench.control.runner import RunResult
from bench.control.session import Bench
from bench.lab.emulated import Plant
from bench.lab.rehearsal import rehearse_procedure
from bench.lab.testing import usual_bench
from bench.record.events.run import Invalid, Prompt
from bench.record.recording import Run
from drivers.base.errors import ConfigurationError
from drivers.kit.config import AxisConfig, Direction, GyroConfig, Mounting

ATTITUDE = [[0.0, 0.6, -0.8], [0.0, 0.8, 0.6], [1.0, 0.0, 0.0]]
"""Columns: where body x, y and z point in east, north, up."""


def mountings(axis: str, *directions: Direction) -> Mountings:
    axes = [
        AxisConfig(name=f"axis{number}", number=number, direction=each)
        for number, each in enumerate(directions, 1)
    ]
    return Mountings(
        axes, [GyroConfig(name="g", driver="kvh1750", unit="1", axis=axis, axes="xyz", port="p")]
    )


@pytest.mark.parametrize(
    ("mounting", "axis", "part"),
    [
        ("axis_up", "x", 1.0),
        ("axis_up", "z", 1.0),
        ("axis_horizontal", "z", 0.0),
        ("z_up", "x", 0.0),
        ("z_up", "y", 0.0),
        ("z_up", "z", 1.0),
    ],
)
def test_on_a_table_that_turns_about_the_vertical(mounting: Mounting, axis: str, part: float) -> None:
    one = mountings(axis, "up")
    assert one.part_along("g", "axis1", {"axis1": 77.0}.__getitem__) is None  # nothing was told
    one.tell({"act": "mount", "mounting": mounting})
    assert one.part_along("g", "axis1", {"axis1": 77.0}.__getitem__) == pytest.approx(part)


def test_about_a_horizontal_east_axis_the_inner_angle_decides() -> None:
    """Turned by an angle about up, right-handed, an axis that pointed north has a part of -sin along east."""
    two = mountings("x", "east", "up")
    two.tell({"act": "mount", "mounting": "axis_horizontal"})
    for angle_deg in (0.0, 30.0, 90.0, 200.0):
        part = two.part_along("g", "axis1", {"axis1": 12.0, "axis2": angle_deg}.__getitem__)
        assert part == pytest.approx(-math.sin(math.radians(angle_deg)), abs=1e-12)
    two.tell({"act": "mount", "mounting": "axis_up"})
    at = {"axis1": 12.0, "axis2": 200.0}.__getitem__
    assert two.part_along("g", "axis1", at) == pytest.approx(0.0, abs=1e-12)
    assert two.part_along("g", "axis2", at) == pytest.approx(1.0)


def test_an_attitude_says_where_each_axis_points() -> None:
    for axis, parts in (("x", (0.0, 1.0)), ("y", (0.6, 0.0)), ("z", (-0.8, 0.0))):
        two = mountings(axis, "east", "up")
        two.tell({"act": "mount", "mounting": "in words", "attitude": ATTITUDE})
        assert two.part_along("g", "axis1", lambda axis: 0.0) == pytest.approx(parts[0])
        assert two.part_along("g", "axis2", lambda axis: 0.0) == pytest.approx(parts[1])


def test_a_mounting_that_there_is_not_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"'z-up'.*axis_horizontal, axis_up, z_up"):
        mountings("x", "up").tell({"act": "mount", "mounting": "z-up"})
    with pytest.raises(ConfigurationError, match="does not say how"):
        mountings("x", "up").tell({"act": "mount"})


def test_a_unit_is_turned_about_its_axis_by_a_number_of_degrees() -> None:
    """It is along the rotation as much as before."""
    level = mountings("x", "up")
    level.tell({"act": "mount", "mounting": "axis_horizontal", "roll_deg": 270.0})
    assert level.part_along("g", "axis1", {"axis1": 77.0}.__getitem__) == pytest.approx(0.0)
    for wrong in ({"roll_deg": "over"}, {"roll_deg": math.nan}, {"roll_deg": 90.0, "mounting": "z_up"}):
        with pytest.raises(ConfigurationError, match="turned so about its axis"):
            level.require_known({"act": "mount", "mounting": "axis_up"} | wrong)


@pytest.mark.parametrize("act", [{}, {"mounting": "sideways"}])
def test_nobody_is_asked_for_a_mounting_that_there_is_not(tmp_path: Path, act: dict[str, str]) -> None:
    def run(bench: Bench, p: Parameters) -> None:
        bench.ask("Mount the unit. Ready?", act="mount", **act)

    procedure = Procedure("t", "t", "t", Parameters, run, lambda p: 60.0, lambda p: Demands())
    result = rehearse_procedure(procedure, Parameters(), usual_bench(None), Plant(), tmp_path)
    assert result.outcome == "aborted" and isinstance(result.error, ConfigurationError), result.reason
    assert not Run.open(result.folder).of(Prompt)


def test_a_figure_is_of_a_gyro_that_there_is(tmp_path: Path) -> None:
    def run(bench: Bench, p: Parameters) -> None:
        bench.measure("mine", 1.0, "ppm", gyro=bench.judge.name)
        bench.measure("nobodys", 1.0, "ppm", gyro="gyro_7")

    procedure = Procedure("t", "t", "t", Parameters, run, lambda p: 60.0, lambda p: Demands())
    result = rehearse_procedure(procedure, Parameters(), usual_bench(None), Plant(), tmp_path)
    assert isinstance(result.error, ConfigurationError) and "'gyro_7'" in result.reason
    (row,) = Run.open(result.folder).manifest.measurements
    names = [gyro.name for gyro in usual_bench(None).gyro]
    assert row["name"] == "mine" and row["gyro"] == names[0]


def test_a_mean_is_held_against_the_rate_that_was_turned_meanwhile() -> None:
    one = mountings("x", "up")
    one.turnings.append(Turning("axis1", 10.0, False, 100.0))
    one.ends("axis1", 200.0)
    assert one.not_felt("g", 100.0, 200.0, 9.99) is None
    assert one.not_felt("g", 60.0, 110.0, 0.0) is None  # mostly before
    assert one.not_felt("g", 190.0, 290.0, 0.0) is None  # mostly after
    assert one.not_felt("g", 100.0, 200.0, math.nan) is None
    found = one.not_felt("g", 120.0, 180.0, -9.99)  # upside down
    assert found is not None and found.code == "rotation_not_felt" and found.facts["share"] == -0.999
    assert one.not_felt("g", 120.0, 180.0, -9.99) is None  # once is enough


def scale_factor(bench: Bench, mounting: str | None, across: bool) -> None:
    if mounting is not None:
        bench.ask("Mounted?", act="mount", mounting=mounting)
    bench.table.engage()
    mean_dps = []
    for rate_dps in (10.0, -10.0):
        bench.table.spin(rate_dps, across=across)
        start_s = bench.now_s
        bench.wait(36.0, "turning")
        mean_dps.append(bench.judge.mean_rate_dps(start_s))
    bench.measure("error", 1e6 * ((mean_dps[0] - mean_dps[1]) / 20.0 - 1.0), "ppm")


def rehearsed(folder: Path, mounting: str | None, *, across: bool = False) -> tuple[RunResult, list[str]]:
    procedure = Procedure(
        "sf",
        "-",
        "-",
        Parameters,
        lambda bench, _: scale_factor(bench, mounting, across),
        lambda _: 100.0,
        lambda _: Demands(max_rate_dps=10.0),
    )
    result = rehearse_procedure(procedure, Parameters(), usual_bench(None), Plant(), folder)
    run = Run.open(result.folder)
    return result, [reason.code for _, reason in run.of(Invalid)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mounting", "across", "outcome", "codes"),
    [
        ("axis_up", False, "completed", []),
        ("z_up", False, "aborted", []),
        ("axis_horizontal", False, "aborted", []),
        (None, False, "invalid", ["rotation_not_felt", "rotation_not_felt"]),
        ("z_up", True, "completed", []),
    ],
)
def test_a_scale_factor_of_an_axis_that_was_not_turned_is_never_valid(
    tmp_path: Path, mounting: str | None, across: bool, outcome: str, codes: list[str]
) -> None:
    result, found = rehearsed(tmp_path, mounting, across=across)
    assert (result.outcome, found) == (outcome, codes), result.reason
    if outcome == "aborted":
        assert isinstance(result.error, ConfigurationError) and "across its axis under test" in result.reason
