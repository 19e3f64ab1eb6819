"""The schedule language, the schemes that come with the package, tables, and the search."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.analysis.calibration import (
    STATE_NAMES,
    UNIT_SIZE,
    Effort,
    Schedule,
    Task,
    after,
    evaluate,
    home_attitude,
    home_text,
    load_scheme,
    moves_text,
    scheme_file,
    search,
)
from bench.analysis.calibration._conventions import PARAMETERS
from bench.analysis.calibration._graph import build_graph
from bench.analysis.calibration._schedule import Move, parse_moves, scheme_names
from bench.analysis.calibration._search import merit_of
from bench.analysis.calibration._segments import (
    chain_segments,
    compose,
    posterior_sigma,
    scaled_variances,
    schedule_segments,
)
from bench.analysis.calibration._table import first_impossible, require_possible
from bench.present.cli import _scheme as commands
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

TASK = Task()


def merit(schedule: Schedule) -> tuple[float, float]:
    end = chain_segments(schedule_segments(TASK, schedule))[-1]
    found = merit_of(posterior_sigma(end.information, TASK), TASK)
    return found.worst, found.rms


def test_moves_and_homes_are_read_as_written() -> None:
    assert parse_moves("+y, -x180 +z360") == (Move(1, 90), Move(0, -180), Move(2, 360))
    np.testing.assert_array_equal(home_attitude("x up, y south"), [[0, 0, 1], [0, -1, 0], [1, 0, 0]])
    assert home_text(home_attitude("z south, x up")) == "x up, y west, z south"


@given(st.lists(st.tuples(st.integers(0, 2), st.sampled_from([90, -90, 180, -180, 270, -270, 360]))))
@settings(deadline=None, max_examples=50)
def test_moves_survive_writing_and_reading(moves: list[tuple[int, int]]) -> None:
    written = tuple(Move(*move) for move in moves)
    assert parse_moves(moves_text(written)) == written


@pytest.mark.parametrize("text", ["+y y", "+w", "+x45", "x"])
def test_what_is_no_move_is_named(text: str) -> None:
    with pytest.raises(ConfigurationError, match="not a move"):
        parse_moves(text)


@pytest.mark.parametrize("text", ["x up", "x up, y down", "x up, y south, z west", "x up, y sideways", ""])
def test_homes_that_are_none_or_left_handed_are_refused(text: str) -> None:
    with pytest.raises(ConfigurationError, match="home"):
        home_attitude(text)


def test_up_axes_of_the_23_positions() -> None:
    expected = "+z +y -z -y -z +y +z -x +y +x -y +x +y -x -z -y +z +y +z -y -z +x +z"
    assert load_scheme("23-position").up_axes() == expected.split()
    expected = "+x +z -x -z -x +z +x -y +z +y -z +y +z -y -x +y -x -y +x"
    assert load_scheme("19-position").up_axes() == expected.split()


def test_readings_of_the_23_positions() -> None:
    readings = [load_scheme(f"23-position{suffix}") for suffix in ("", "-b", "-c", "-d")]
    assert [scheme.positions for scheme in readings] == [23, 23, 25, 23]
    assert [scheme.closes for scheme in readings] == [True, True, True, False]
    assert [scheme.net_turns for scheme in readings] == [(0, 1, 0), (0, 0, 0), (0, 0, 0), (0, 0.5, 0)]
    assert readings[0].with_(dwell_s=180.0).duration_s == 4338.0


@pytest.mark.parametrize("name", scheme_names())
def test_schemes_survive_writing_and_reading(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    scheme = load_scheme(name)
    path = tmp_path_factory.mktemp("scheme") / "copy.toml"
    path.write_text(scheme_file(scheme))
    again = load_scheme(str(path))
    assert (again.moves, again.name) == (scheme.moves, scheme.name)
    np.testing.assert_array_equal(again.home, scheme.home)


def test_the_optimised_scheme_beats_the_classical_ones_on_a_two_axis_table() -> None:
    best = load_scheme("optimised")
    assert first_impossible("two-axis-horizontal", best) is None and best.closes
    for dwell_s in (60.0, 180.0):
        classical = merit(load_scheme("23-position").with_(dwell_s=dwell_s))[0]
        assert merit(best.with_(dwell_s=dwell_s))[0] < 0.9 * classical


def test_a_scheme_that_is_not_there_is_named(tmp_path: object) -> None:
    with pytest.raises(ConfigurationError, match="23-position"):
        load_scheme("24-position")


# Figures of an independent computation: worst and rms of sigma over target.
@pytest.mark.parametrize(
    ("name", "dwell_s", "worst", "rms"),
    [
        ("t22", 180.0, 0.397, 0.170),
        ("t22", 60.0, 0.755, 0.282),
        ("o22", 180.0, 0.397, 0.176),
        ("t18", 180.0, 0.445, 0.201),
        ("t18", 60.0, 0.871, 0.335),
        ("o14", 180.0, 0.519, 0.226),
        ("t14", 60.0, 1.336, 0.460),
        ("o10", 180.0, 0.678, 0.314),
        ("t10", 180.0, 0.702, 0.303),
        ("o8", 180.0, 0.822, 0.444),
        ("o8", 60.0, 3.25, 1.15),
        ("23-position-b", 180.0, 0.448, 0.181),
        ("23-position-d", 60.0, 0.928, 0.313),
    ],
)
def test_merit_of_the_schemes(name: str, dwell_s: float, worst: float, rms: float) -> None:
    assert merit(load_scheme(name).with_(dwell_s=dwell_s)) == pytest.approx((worst, rms), rel=0.005)


def test_home_attitude_decides_not_the_schedule() -> None:
    paper = load_scheme("23-position")
    assert (
        merit(load_scheme("19-position"))[0]
        < merit(paper)[0] * 1.0
        < merit(load_scheme("19-position-z-up"))[0] / 20
    )
    tipped = paper.with_(home=home_attitude("x up, y west"))
    assert merit(tipped)[0] == pytest.approx(20.0, rel=0.01)


def test_tables_run_what_their_gimbals_allow() -> None:
    for name in ("19-position", "19-position-z-up", "23-position", "t22", "t18", "t14", "t10"):
        assert first_impossible("two-axis-horizontal", load_scheme(name)) is None, name
        assert first_impossible("three-axis", load_scheme(name)) is None, name
    for name in ("o8", "o10", "o14", "o22"):
        assert first_impossible("two-axis-horizontal", load_scheme(name)) is not None, name
    assert first_impossible("three-axis", load_scheme("o8")) is None
    assert first_impossible("two-axis-vertical", load_scheme("23-position")) is not None


def test_a_turn_that_a_table_cannot_make_is_named() -> None:
    # From x east, y north, z up: +x leaves z and x as possible axes for an outer axis east, x and y for north.
    scheme = Schedule("three axes", parse_moves("+x +z +y +x +z"), np.eye(3))
    at = first_impossible("two-axis-horizontal", scheme)
    assert at is not None
    with pytest.raises(ConfigurationError, match=f"turn {at + 1} of this scheme"):
        require_possible("two-axis-horizontal", scheme)
    with pytest.raises(ConfigurationError, match="no such table"):
        require_possible("four-axis", scheme)  # type: ignore[arg-type]
    with pytest.raises(ConfigurationError, match="grid"):
        first_impossible("three-axis", scheme.with_(home=np.linalg.qr(np.eye(3) + 0.2)[0]))


@given(
    st.integers(0, 23),
    st.lists(st.sampled_from(["+x", "-x", "+y", "-y", "+z", "-z"]), min_size=1, max_size=8),
)
@settings(deadline=None, max_examples=60)
def test_gimbal_angles_exist_for_what_a_two_axis_table_is_said_to_run(home: int, tokens: list[str]) -> None:
    """A second model: the table's own kinematics, outer angle then inner angle, C = R_outer C_0 R_inner."""
    from bench.analysis.calibration._graph import grid_attitudes

    attitude = grid_attitudes()[home]
    scheme = Schedule("random", parse_moves(" ".join(tokens)), attitude)
    assert (first_impossible("two-axis-horizontal", scheme) is None) == _runs_on_two_axes(scheme)


def _runs_on_two_axes(scheme: Schedule) -> bool:
    quarter = [_turn(axis, np.pi / 2) for axis in range(3)]
    for outer in (0, 1):
        for inner in range(3):
            if abs(scheme.home[outer, inner]) > 0.5:
                continue
            node, ok = scheme.home, True
            for wanted in scheme.attitudes()[1:]:
                reached = [
                    node @ quarter[inner],
                    node @ quarter[inner].T,
                    quarter[outer] @ node,
                    quarter[outer].T @ node,
                ]
                ok = ok and any(np.allclose(each, wanted) for each in reached)
                node = wanted
            if ok:
                return True
    return False


def _turn(axis: int, angle: float) -> np.ndarray:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[i, j], matrix[j, i] = -np.sin(angle), np.sin(angle)
    return matrix


def test_a_vertical_outer_axis_leaves_an_accelerometer_at_its_prior() -> None:
    found = search(TASK, "two-axis-vertical", 8, Schedule("", (), np.eye(3)), effort=Effort(4, 10, 1))
    assert found.merit.worst == pytest.approx(20.0, rel=1e-3)


def random_schedules(task: Task, turns: int, pattern: Schedule, count: int, seed: int = 0) -> Array:
    """Return worst and rms ratio, shape (count, 2), of uniformly random schedules from the pattern's home."""
    graph = build_graph(task, "by-hand", pattern)
    weight = (task.prior_sigma[PARAMETERS] / task.target_sigma) ** 2
    at = int(np.argmin([np.abs(each - pattern.home).max() for each in graph.attitudes]))
    node = np.full(count, at)
    stretch = graph.rests[node]
    for move in np.random.default_rng(seed).integers(0, 6, (turns, count)):
        stretch = compose(stretch, graph.segments[node, move])
        node = graph.edges[node, move]
    ratio = scaled_variances(stretch.information) * weight
    return np.stack([np.sqrt(ratio.max(axis=1)), np.sqrt(ratio.mean(axis=1))], axis=1)


def test_search_result_closes_runs_on_its_table_and_is_worth_what_it_says() -> None:
    pattern = Schedule("", (), np.eye(3), 60.0)
    found = search(TASK, "two-axis-horizontal", 10, pattern, effort=Effort(6, 60, 1), seed=3)
    scheme = found.schedule
    assert scheme.closes and len(scheme.moves) == 10
    require_possible("two-axis-horizontal", scheme)
    assert merit(scheme) == pytest.approx((found.merit.worst, found.merit.rms), rel=1e-6)
    chance = random_schedules(TASK, 10, pattern, 300)
    assert found.merit.worst < np.quantile(chance[:, 0], 0.02)
    assert "not proven" in found.statement
    again = search(TASK, "two-axis-horizontal", 10, pattern, effort=Effort(6, 60, 1), seed=3)
    assert again.schedule.moves == scheme.moves


def test_a_count_of_turns_that_cannot_close_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="closes"):
        search(TASK, "by-hand", 1, Schedule("", (), np.eye(3)))


def test_random_schedules_are_the_baseline_to_beat() -> None:
    chance = random_schedules(TASK, 22, Schedule("", (), np.eye(3)), 600, seed=1)
    # 3000 schedules of an independent computation: 20 % quantile .462, median .498 of the worst ratio.
    np.testing.assert_allclose(np.quantile(chance[:, 0], [0.2, 0.5]), [0.462, 0.498], rtol=0.02)


def test_evaluation_says_what_a_scheme_cannot_see() -> None:
    found = evaluate(TASK, load_scheme("19-position-z-up").with_(dwell_s=180.0, profile="constant"))
    (weak,) = found.combinations
    # The heading error hides in the turns about the vertical: K_g,zz; 62.6 of 100 ppm remain.
    assert weak.shares[0][0] == "Kg_zz"
    assert weak.remaining == pytest.approx(0.64, abs=0.02)
    text = " ".join(found.warnings)
    assert "Kg_zz 12.5" in text and "Home attitude" in text and "x up" in text
    best = evaluate(TASK, load_scheme("t22"), "two-axis-horizontal")
    assert not best.combinations and not any("missed" in text for text in best.warnings)


def test_evaluation_follows_convergence_position_by_position() -> None:
    found = evaluate(TASK, load_scheme("23-position").with_(profile="constant"))
    at = np.array([5, 10, 13, 16, 19, 23]) - 1
    expected = {  # of an independent computation
        "nabla_x": [867, 30.5, 6.9, 5.7, 1.75, 1.07],
        "Kg_zz": [98.7, 5.5, 4.4, 3.7, 1.1, 0.92],
        "Ka_yx": [100, 6.3, 1.4, 1.2, 0.36, 0.30],
    }
    for name, values in expected.items():
        number = STATE_NAMES.index(name)
        np.testing.assert_allclose(found.course[at, number] / UNIT_SIZE[number], values, rtol=0.03)


def test_evaluate_command_prints_and_speaks_json(capsys: pytest.CaptureFixture[str]) -> None:
    commands.evaluate("19-position", table="two-axis-horizontal")
    assert "worst sigma/target 0.45" in capsys.readouterr().out
    commands.evaluate("19-position", json=True)
    states = json.loads(capsys.readouterr().out)["states"]
    row = next(state for state in states if state["name"] == "eps_x")
    assert row["unit"] == "deg/h" and row["sigma"] == pytest.approx(0.00132, rel=0.02)
    with pytest.raises(ConfigurationError, match="cannot make turn"):
        commands.evaluate("o8", table="two-axis-horizontal")
    with pytest.raises(ConfigurationError, match="latitude"):
        commands.evaluate("o8", latitude_deg=90.0)


def test_turns_after_a_run_are_chosen_for_what_it_left_open(capsys: pytest.CaptureFixture[str]) -> None:
    """Eight of them add more to 23 positions than eight that know of no run, and than no further run."""
    pattern = Schedule("", (), np.eye(3), 60.0)
    before = load_scheme("23-position").with_(dwell_s=60.0)
    further = after(TASK, [before])
    table = "two-axis-horizontal"
    chosen = search(further, table, 8, pattern, effort=Effort(8, 60, 1))
    alone = search(TASK, table, 8, pattern, effort=Effort(8, 60, 1))
    promised = evaluate(further, chosen.schedule).merit.worst
    assert chosen.merit.worst == pytest.approx(promised, rel=1e-6)
    assert promised < evaluate(further, alone.schedule).merit.worst < evaluate(TASK, before).merit.worst
    # the same by the command, of which a run is named by its scheme
    commands.evaluate("o8", dwell_s=60.0, after=["23-position"], json=True)
    printed = json.loads(capsys.readouterr().out)
    expected = evaluate(further, load_scheme("o8").with_(dwell_s=60.0)).merit.worst
    assert printed["worst_sigma_over_target"] == pytest.approx(expected, rel=1e-6)


def test_search_command_writes_a_scheme_that_loads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(commands, "_QUICK", (2, 5, 1))
    commands.search(6, dwell_s=60.0, out=tmp_path / "mine.toml")
    assert "not proven" in capsys.readouterr().out.replace("\n", " ")
    scheme = load_scheme(str(tmp_path / "mine.toml"))
    assert scheme.closes and len(scheme.moves) == 6
    require_possible("two-axis-horizontal", scheme)


def test_a_search_with_half_turns_is_turned_by_its_table_and_evaluated_alike() -> None:
    pattern = Schedule("", (), np.eye(3), 60.0, profile="constant")
    result = search(TASK, "two-axis-horizontal", 6, pattern, effort=Effort(4, 20, 1), angles_deg=(90, 180))
    assert result.schedule.closes and "90, 180 deg" in result.statement
    require_possible("two-axis-horizontal", result.schedule)
    assert evaluate(TASK, result.schedule).merit.worst == pytest.approx(result.merit.worst, rel=1e-6)
    with pytest.raises(ConfigurationError, match="other angles"):
        search(TASK, "by-hand", 6, pattern, angles_deg=(45,))


def test_half_turns_that_help_are_found() -> None:
    """Turns by 90 and 180 deg contain those by 90 deg: with a beam this wide never worse."""
    pattern = Schedule("", (), np.eye(3), 180.0)
    quarter = search(TASK, "by-hand", 4, pattern, effort=Effort(64, 40, 2))
    mixed = search(TASK, "by-hand", 4, pattern, effort=Effort(64, 40, 2), angles_deg=(90, 180))
    assert mixed.merit.worst <= quarter.merit.worst * (1.0 + 1e-9)
