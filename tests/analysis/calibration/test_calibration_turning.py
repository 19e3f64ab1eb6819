"""From scheme to table: mounting, start angles, axis by axis; and the file that corrects a unit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.analysis.calibration import (
    PARAMETERS,
    Effort,
    ImuCompensation,
    Schedule,
    TableAxis,
    Task,
    load_scheme,
    plan_turns,
    search,
    table_type,
)
from bench.analysis.calibration._conventions import unpack
from bench.analysis.calibration._schedule import Move, scheme_names
from bench.analysis.calibration._table import first_impossible
from drivers.base.errors import ConfigurationError, RecordError

FLAT = (TableAxis("outer", "east"), TableAxis("inner", "up"))
TALL = (TableAxis("outer", "up"), TableAxis("inner", "north"))
THREE = (TableAxis("outer", "up"), TableAxis("middle", "east"), TableAxis("inner", "up"))
LINES = {"east": (1, 0, 0), "north": (0, 1, 0), "up": (0, 0, 1)}


def about(line, angle_deg):
    """Rotation by Rodrigues' formula, written out here."""
    k = np.array(line, dtype=float)
    a, s = math.radians(angle_deg), np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + math.sin(a) * s + (1 - math.cos(a)) * s @ s


def attitudes(axes, plan):
    """The unit's attitude at every position from the table's angles alone."""
    angles = dict(plan.start_deg)
    found = []
    for turn in (None, *plan.turns):
        if turn is not None:
            angles[turn.axis] += turn.by_deg
            assert angles[turn.axis] == turn.to_deg
        c = np.eye(3)
        for axis in axes:
            c = c @ about(LINES[axis.direction], angles[axis.name])
        found.append(c @ plan.mount)
    return np.array(found)


@pytest.mark.parametrize("name", [name for name in scheme_names() if name != "23-position-d"])
@pytest.mark.parametrize("axes", [FLAT, TALL, THREE], ids=["flat", "tall", "three"])
def test_the_table_takes_the_unit_through_the_schemes_attitudes(name, axes):
    scheme = load_scheme(name)
    try:
        plan = plan_turns(scheme, axes)
    except ConfigurationError:
        heads = [about((0, 0, 1), h) for h in (0, 90, 180, 270)]
        closes = scheme.closes
        assert not closes or not any(
            first_impossible(table_type(axes), scheme.with_(home=np.rint(h @ scheme.home))) is None
            for h in heads
        )
        return
    np.testing.assert_allclose(attitudes(axes, plan), plan.schedule.attitudes(), atol=1e-9)
    # the home's up axis is the scheme's; only the heading may differ
    np.testing.assert_allclose(plan.schedule.home[2], scheme.home[2], atol=1e-9)


def test_published_schemes_run_on_a_table_with_a_horizontal_outer_axis():
    for name in ("19-position", "19-position-z-up", "23-position", "23-position-b", "23-position-c", "t22"):
        plan_turns(load_scheme(name), FLAT)


def test_a_table_that_cannot_names_the_turn():
    with pytest.raises(ConfigurationError, match=r"two-axis-vertical table cannot make turn \d+"):
        plan_turns(load_scheme("23-position"), TALL)


def test_a_scheme_that_does_not_close_is_refused():
    with pytest.raises(ConfigurationError, match="does not come back"):
        plan_turns(load_scheme("23-position-d"), FLAT)


def test_one_axis_is_not_enough():
    with pytest.raises(ConfigurationError, match="two or three axes"):
        plan_turns(load_scheme("19-position"), (TableAxis("table", "up"),))


def test_stops_of_an_axis_are_kept():
    limited = (TableAxis("outer", "east"), TableAxis("inner", "up", -100.0, 280.0))
    plan = plan_turns(load_scheme("19-position"), limited)
    assert all(-100 <= turn.to_deg <= 280 for turn in plan.turns if turn.axis == "inner")
    with pytest.raises(ConfigurationError, match="stops"):
        plan_turns(load_scheme("19-position"), (TableAxis("outer", "east", -45.0, 45.0), FLAT[1]))


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 2), st.sampled_from([90, -90, 180, 270, -360])), max_size=6))
def test_any_closed_walk_is_turned_as_written_or_refused(steps):
    there = [Move(axis, angle) for axis, angle in steps]
    back = [Move(move.axis, -move.angle_deg) for move in reversed(there)]
    scheme = Schedule("walk", tuple(there + back), np.eye(3), 60.0)
    try:
        plan = plan_turns(scheme, THREE)
    except ConfigurationError:
        return
    np.testing.assert_allclose(attitudes(THREE, plan), plan.schedule.attitudes(), atol=1e-9)


def test_the_file_takes_the_errors_out_of_the_unit_it_belongs_to(tmp_path):
    rng = np.random.default_rng(3)
    truth = rng.standard_normal(24) * Task().prior_sigma[PARAMETERS]
    eps, nabla, kg, ka, k2 = unpack(truth)
    w = rng.uniform(-10, 10, (50, 3))
    f = rng.uniform(-9, 9, (50, 3))
    measured_w = w + w @ kg.T + np.degrees(eps)
    measured_f = f + f @ ka.T + nabla + k2 * f**2
    saved = ImuCompensation(
        "IMU-7",
        parameters=truth,
        sigma=np.full(24, 1e-6),
        covariance=np.eye(24) * 1e-12,
        lever_m=np.zeros((2, 3)),
        lag_s=0.0,
        scheme="23-position",
        innovation_rms=1.0,
        declared=("x",),
        runs={"a": "b"},
    )
    path = tmp_path / "compensation.gyrocomp"
    saved.save(path)
    loaded = ImuCompensation.load(path)
    assert loaded.describe() == saved.describe()
    np.testing.assert_array_equal(loaded.covariance, saved.covariance)
    rate, force = loaded.apply("IMU-7", 0.01, measured_w, measured_f)
    np.testing.assert_allclose(rate, w, atol=1e-9)
    np.testing.assert_allclose(force, f, atol=1e-8)
    with pytest.raises(ConfigurationError, match="another unit"):
        loaded.apply("IMU-8", 0.01, measured_w, measured_f)
    with pytest.raises(RecordError, match="no numbers"):
        loaded.apply("IMU-7", 0.01, measured_w * np.nan, measured_f)
    with pytest.raises(RecordError, match="shape"):
        loaded.apply("IMU-7", 0.01, measured_w[:, :2], measured_f[:, :2])


def test_another_file_is_refused(tmp_path):
    path = tmp_path / "x.gyrocomp"
    path.write_bytes(b"no zip")
    with pytest.raises(RecordError, match="not a readable compensation"):
        ImuCompensation.load(path)


@pytest.mark.parametrize(("pointing", "line"), [("east", "east"), ("west", "east"), ("south", "north")])
def test_a_scheme_searched_for_a_table_runs_from_its_own_home(pointing, line):
    """Every turn lies along the outer axis or the carried inner one, at the heading that the scheme asks for."""
    pattern = Schedule("", (), np.eye(3), 60.0)
    result = search(Task(), "two-axis-horizontal", 6, pattern, effort=Effort(3, 5, 1), outer=pointing)
    assert f"outer axis {pointing}" in result.statement
    plan = plan_turns(result.schedule, (TableAxis("outer", pointing), TableAxis("inner", "up")))
    half = about((0, 0, 1), 180.0)
    assert any(np.allclose(plan.schedule.home, turn @ result.schedule.home) for turn in (np.eye(3), half))
    # found here without the planner: one body axis is the inner one, all other turns are about the outer line
    before = result.schedule.attitudes()[:-1]
    turns = list(zip(before, result.schedule.moves, strict=True))
    along = [abs(c[:, move.axis] @ np.array(LINES[line])) > 0.99 for c, move in turns]
    inner = {move.axis for (_, move), outer in zip(turns, along, strict=True) if not outer}
    assert len(inner) == 1
