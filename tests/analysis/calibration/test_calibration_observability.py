"""Degrees and covariances against the definition, a plain filter and figures of an independent computation."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.calibration import PARAMETERS, STATE_NAMES, UNIT_SIZE, Schedule, Task, after, load_scheme
from bench.analysis.calibration._model import observability_matrix
from bench.analysis.calibration._result import observability
from bench.analysis.calibration._schedule import Profile, parse_moves
from bench.analysis.calibration._segments import (
    chain_segments,
    compose,
    covariance,
    fold,
    posterior_sigma,
    schedule_segments,
)

TASK = Task()
FIRST = ("19-position-z-up", "19-position", "23-position")
# Independent computation (RK4 transitions, plain covariance filter), 180 s dwell, constant rate, reference set.
DEGREES = {
    "19-position-z-up": "2995 2869 11972 984 898 1938 19300 7758 2466 1689 1695 1653 "
    "266 11629 20406 418 264 14763 818 825 181 2437 419 834 "
    "2421 845 4149 170 170 166",
    "19-position": "14696 13389 45987 991 1277 1449 17422 12753 12001 15678 15644 15922 "
    "2805 14282 11025 5125 2828 10953 4245 4359 2856 4333 4784 4216 "
    "8452 4319 5856 1471 1422 1434",
    "23-position": "34455 38528 41064 1414 946 2035 17714 8128 14790 52890 51282 37260 "
    "11148 15236 17407 5844 8740 11436 9692 5773 6088 5423 4828 6814 "
    "4709 6728 5575 3302 3655 3182",
}
SIGMAS = {
    "19-position-z-up": "1.39 1.39 31.4 3.4e-4 3.4e-4 3.1e-4 .00119 .00118 .00201 6.46 6.46 6.38 "
    "4.11 .254 .254 27.1 4.11 .254 1.34 1.34 62.6 .470 27.1 1.32 "
    ".470 1.32 .230 6.42 6.42 6.37",
    "19-position": ".638 .638 21.3 3.4e-4 3.4e-4 3.1e-4 .00132 .00129 .00136 1.22 1.22 1.22 "
    "1.00 .254 .254 .410 1.00 .254 .411 .410 1.00 .291 .323 .323 "
    ".309 .323 .327 1.25 1.26 1.26",
    "23-position": ".429 .454 19.7 3.4e-4 3.4e-4 3.1e-4 .00109 .00139 .00135 1.07 .785 .737 "
    ".552 .179 .179 .419 .988 .300 .385 .310 .920 .345 .296 .290 "
    ".254 .178 .255 1.13 .827 .781",
}
MERITS = {
    "19-position-z-up": (12.53, 3.056),
    "19-position": (0.4535, 0.2033),
    "23-position": (0.4622, 0.1826),
}


def constant(name: str, dwell_s: float = 180.0) -> Schedule:
    return load_scheme(name).with_(profile="constant", dwell_s=dwell_s)


def final_sigma(schedule: Schedule, task: Task = TASK) -> np.ndarray:
    end = chain_segments(schedule_segments(task, schedule))[-1]
    return np.sqrt(np.diag(covariance(end))) * task.prior_sigma


def test_three_matrix_elements_are_conventions_and_no_more(plain: SimpleNamespace) -> None:
    schedule = constant("23-position", 60.0)
    q = plain.q_matrix(TASK, schedule)
    scaled = q / np.linalg.norm(q, axis=0)
    singular = np.linalg.svd(scaled, compute_uv=False)
    assert singular[30] / singular[29] < 1e-9
    assert singular[29] / singular[0] > 1e-6
    for theta in np.eye(3):
        turn = plain.skew(theta)
        null = np.zeros(33)
        null[:3], null[12:21], null[21:30] = schedule.home @ theta, turn.ravel("F"), turn.ravel("F")
        assert np.linalg.norm(q @ null) < 1e-10 * np.linalg.norm(q[:, :3] @ null[:3])


@pytest.mark.parametrize("profile", ["constant", "smooth"])
def test_closed_form_transitions_equal_runge_kutta(plain: SimpleNamespace, profile: str) -> None:
    moves = parse_moves("+x -y180 +z -z270 +x360")
    schedule = Schedule(
        "t", moves, plain.turn_about(1, 0.7) @ plain.turn_about(2, 0.4), 20.0, profile=profile
    )  # type: ignore[arg-type]
    reference = plain.q_matrix(TASK, schedule)[:, [*range(24), 25, 26, 29, 30, 31, 32]]
    ours = observability_matrix(TASK.site, schedule)
    assert np.max(np.abs(ours - reference) / np.abs(reference).max(axis=0)) < 2e-9


def test_static_rest_shows_nine_combinations_and_only_the_velocity_error() -> None:
    found = observability(observability_matrix(TASK.site, Schedule("rest", (), np.eye(3), 600.0)), TASK)
    assert found.rank == 9
    assert np.flatnonzero(found.normalised).tolist() == [3, 4, 5]
    np.testing.assert_allclose(found.normalised[3:6], [819.9, 616.7, 1227.3], rtol=1e-3)


@pytest.mark.parametrize("moves", ["+x+x", "+x+y+z-x", "+y+z+x"])
def test_degree_is_the_definition_and_the_cramer_rao_bound(plain: SimpleNamespace, moves: str) -> None:
    schedule = Schedule("short", parse_moves(moves), np.eye(3), 60.0)
    q = observability_matrix(TASK.site, schedule).reshape(-1, 3, 30)[::5].reshape(-1, 30)
    found = observability(q, TASK)
    scaled = q * (TASK.prior_sigma / TASK.noise.velocity_mps)
    definition = np.array([plain.null_space_degree(scaled, column) for column in range(30)])
    seen = found.normalised > 0.0
    assert np.all(definition[~seen] < 1e-6 * definition.max())
    np.testing.assert_allclose(found.normalised[seen], definition[seen], rtol=1e-9)
    if found.rank == 30:
        information = q.T @ q / TASK.noise.velocity_mps**2
        scale = TASK.prior_sigma
        bound = np.sqrt(np.diag(np.linalg.inv(information * np.outer(scale, scale)))) * scale
        np.testing.assert_allclose(found.normalised, TASK.prior_sigma / bound, rtol=1e-4)


@pytest.mark.parametrize("name", FIRST)
def test_degrees_of_the_classical_schedules(name: str) -> None:
    found = observability(observability_matrix(TASK.site, constant(name)), TASK)
    assert found.rank == 30
    np.testing.assert_allclose(found.normalised, np.array(DEGREES[name].split(), float), rtol=0.01)


@pytest.mark.parametrize("name", FIRST)
def test_posterior_sigma_of_the_classical_schedules(name: str) -> None:
    sigma = final_sigma(constant(name))
    np.testing.assert_allclose(sigma / UNIT_SIZE, np.array(SIGMAS[name].split(), float), rtol=0.013)
    ratio = sigma[PARAMETERS] / TASK.target_sigma
    assert (ratio.max(), np.sqrt(np.mean(ratio**2))) == pytest.approx(MERITS[name], rel=0.005)


@pytest.mark.parametrize("name", FIRST)
def test_segment_chain_equals_the_filter_step_by_step(plain: SimpleNamespace, name: str) -> None:
    schedule = constant(name, 60.0)
    np.testing.assert_allclose(final_sigma(schedule), plain.kalman(TASK, schedule), rtol=1e-8)


@pytest.mark.parametrize("profile", ["constant", "smooth"])
@pytest.mark.parametrize("dwell_s", [1.0, 7.0, 12.0])  # 1, 111, 1100: powers that are taken and that are not
def test_turns_of_any_size_between_short_rests_off_the_grid(
    plain: SimpleNamespace, dwell_s: float, profile: Profile
) -> None:
    moves = parse_moves("-x +y180 -z270 +y -x360 +z +x")
    home = plain.turn_about(0, 0.3) @ plain.turn_about(2, -1.1)
    schedule = Schedule("short", moves, home, dwell_s, 25.0, profile)
    covariances = covariance(fold(schedule_segments(TASK, schedule))), plain.covariance(TASK, schedule)
    ours, theirs = (np.diag(found) for found in covariances)
    np.testing.assert_allclose(ours, theirs, rtol=1e-8)
    sizes = np.sqrt(np.outer(theirs, theirs))
    assert np.max(np.abs(covariances[0] - covariances[1]) / sizes) < 1e-8


def test_three_turns_in_six_orders_from_z_up() -> None:
    ranks, gains = [], []
    for order in ("xyz", "xzy", "yxz", "yzx", "zxy", "zyx"):
        moves = parse_moves("".join(f"+{axis}" for axis in order))
        schedule = Schedule(order, moves, np.eye(3), 180.0, profile="constant")
        ranks.append(observability(observability_matrix(TASK.site, schedule), TASK, 1e-10).rank)
        gain = TASK.prior_sigma / final_sigma(schedule)
        ka = [at for at, name in enumerate(STATE_NAMES) if name.startswith("Ka")]
        gains.append(float(np.exp(np.mean(np.log(gain[ka])))))
    assert ranks == [29, 30, 29, 30, 24, 24]
    np.testing.assert_allclose(gains, [2.5, 3.2, 2.5, 8.2, 1.5, 1.6], rtol=0.03)


def test_relabelling_body_axes_permutes_what_is_no_convention() -> None:
    schedule = constant("23-position", 60.0)
    relabelled = tuple(type(move)((move.axis + 1) % 3, move.angle_deg) for move in schedule.moves)
    # The new x, y, z body axes point where the old z, x, y axes pointed.
    other = schedule.with_(moves=relabelled, home=schedule.home[:, [2, 0, 1]])
    ours, theirs = final_sigma(schedule), final_sigma(other)
    groups = ([6, 7, 8], [9, 10, 11], [12, 16, 20], [21, 24, 26], [27, 28, 29])
    for group in groups:
        np.testing.assert_allclose(theirs[group], ours[group][[2, 0, 1]], rtol=1e-6)
    off_diagonal = [13, 14, 15, 17, 18, 19]
    assert not np.allclose(
        theirs[off_diagonal], ours[[17, 15, 18, 19, 13, 14]], rtol=1e-3
    ) or not np.allclose(theirs[[22, 23, 25]], ours[[25, 22, 23]], rtol=1e-3)


def test_parameters_alone_are_the_parameter_block_of_the_covariance() -> None:
    end = chain_segments(schedule_segments(TASK, constant("o8", 60.0)))[-1]
    np.testing.assert_allclose(
        posterior_sigma(end.information, TASK), final_sigma(constant("o8", 60.0))[PARAMETERS], rtol=1e-10
    )


@pytest.mark.parametrize("name", ["o8", "23-position"])  # an odd and an even number of pairs
def test_folding_in_pairs_is_chaining(name: str) -> None:
    segments = schedule_segments(TASK, load_scheme(name))
    whole, last = fold(segments), chain_segments(segments)[-1]
    np.testing.assert_allclose(covariance(whole), covariance(last), rtol=1e-9, atol=1e-14)


def test_composition_is_associative() -> None:
    a, b, c = (schedule_segments(TASK, load_scheme("o8").with_(dwell_s=30.0))[at] for at in (0, 3, 6))
    left, right = compose(compose(a, b), c), compose(a, compose(b, c))
    for name in ("change", "information", "noise"):
        ours, theirs = getattr(left, name), getattr(right, name)
        np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-10 * np.abs(theirs).max())


def test_a_run_after_others_knows_what_they_told_and_begins_its_navigation_anew(
    plain: SimpleNamespace,
) -> None:
    first, second = constant("19-position", 20.0), constant("o8", 20.0)
    start = np.eye(30)
    start[PARAMETERS, PARAMETERS] = plain.covariance(TASK, first)[PARAMETERS, PARAMETERS]
    expected = plain.covariance(TASK, second, start=start)
    further = after(TASK, [first])
    found = covariance(fold(schedule_segments(further, second)))
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
    # three runs: one after the other is the same as both before the third
    twice = after(further, [second])
    assert twice.known == pytest.approx(after(TASK, [second, first]).known, rel=1e-9)
    assert TASK.known is None
