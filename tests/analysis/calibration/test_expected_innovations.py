"""Innovations that a schedule leads to expect: against draws through another filter, and on records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.calibration import Noise, Task, load_scheme
from bench.analysis.calibration import evaluate as evaluate_scheme
from bench.analysis.calibration._estimator import Options, estimate
from bench.analysis.calibration._expected import disturbed_rests, expected_innovations, still_table
from bench.analysis.calibration._navigation import Increments
from bench.analysis.calibration._record_noise import RecordNoise, record_noise
from benchmarks.off_class._imu_noise import AS_TOLD, WRONG, record
from benchmarks.off_class.calibration import scheme

SHORT = load_scheme("optimised").with_(dwell_s=20.0)


def drawn(plain: SimpleNamespace, task: Task, there: Noise, count: int) -> np.ndarray:
    """Rms of whitened innovations by position of `count` draws, through a filter with the noise of `task`."""
    scale, rng = task.prior_sigma, np.random.default_rng(11)
    g = plain.skew(np.array([0.0, 0.0, task.site.gravity_mps2]))

    def noise(told: Noise, time: float) -> np.ndarray:
        n, a = told.arw**2, told.vrw**2
        q = np.zeros((6, 6))
        q[:3, :3], q[:3, 3:] = n * time * np.eye(3), n * time**2 / 2 * g.T
        q[3:, :3] = q[:3, 3:].T
        q[3:, 3:] = a * time * np.eye(3) + n * time**3 / 3 * g @ g.T
        return q

    x = rng.standard_normal((30, count)) * scale[:, None]
    mean, p = np.zeros((30, count)), np.diag(scale**2)
    found = []

    def ahead(step: np.ndarray, time: float) -> None:
        nonlocal x, mean, p
        x, mean, p = step @ x, step @ mean, step @ p @ step.T
        p[:6, :6] += noise(task.noise, time)
        x[:6] += np.linalg.cholesky(noise(there, time) + 1e-30 * np.eye(6)) @ rng.standard_normal((6, count))

    for number, c in enumerate(SHORT.attitudes()):
        kept = np.ix_(plain.kept, plain.kept)
        squares = []
        for _ in range(20):
            ahead(plain.second(task, c)[kept], 1.0)
            s = p[3:6, 3:6] + np.eye(3) * task.noise.velocity_mps**2
            seen = x[3:6] + there.velocity_mps * rng.standard_normal((3, count))
            innovation = seen - mean[3:6]
            squares.append(np.einsum("in,ij,jn->n", innovation, np.linalg.inv(s), innovation) / 3.0)
            gain = p[:, 3:6] @ np.linalg.inv(s)
            mean, p = mean + gain @ innovation, p - gain @ p[3:6]
        found.append(np.sqrt(np.mean(squares)))
        if number < len(SHORT.moves):
            duration = abs(SHORT.moves[number].angle_deg) / SHORT.rate_dps
            ahead(plain.turn_matrix(task, c, SHORT, number)[kept], duration)
    return np.array(found)


@pytest.mark.parametrize(
    "there", [Noise(0.001, 10.0, 0.0), Noise(0.003, 20.0, 5e-4), Noise(0.0005, 10.0, 2e-3)], ids=str
)
def test_innovations_are_those_of_draws_through_another_filter(plain: SimpleNamespace, there: Noise) -> None:
    task = Task()
    expected = expected_innovations(task, SHORT, there)
    np.testing.assert_allclose(expected, drawn(plain, task, there, 250), rtol=0.12)
    # positions of independent draws: their mean is sharper
    assert np.mean(expected) == pytest.approx(np.mean(drawn(plain, task, there, 250)), rel=0.03)


def test_noise_as_told_gives_one_and_a_still_table_a_fifth() -> None:
    task = Task()
    np.testing.assert_allclose(expected_innovations(task, SHORT, task.noise), 1.0, atol=1e-6)
    long = load_scheme("19-position").with_(dwell_s=180.0)
    still = evaluate_scheme(task, long).still_innovations
    assert len(still) == long.positions
    assert np.sqrt(np.mean(still**2)) == pytest.approx(0.22, abs=0.01)  # the design study's value
    assert expected_innovations(task, SHORT, still_table(task.noise)).max() < 0.5


Spoil = Callable[[Increments], Increments]
Judge = Callable[[str, int, Spoil], RecordNoise]


def whole(data: Increments) -> Increments:
    return data


@pytest.fixture(scope="module")
def judge() -> Judge:
    def judged(name: str, seed: int, spoil: Spoil) -> RecordNoise:
        task, schedule, options = Task(), scheme(), Options(alignment_s=48.0)
        data = spoil(record(task, schedule, (AS_TOLD | WRONG)[name], seed)[0])
        return record_noise(data, task, options, estimate(data, task, options, schedule), schedule)

    return judged


@pytest.mark.parametrize("name", list(AS_TOLD))
def test_a_record_as_told_is_what_the_schedule_predicts(judge: Judge, name: str) -> None:
    shown = judge(name, 7, whole)
    assert shown.innovation_ratio == pytest.approx(1.0, abs=0.12)
    assert not shown.disturbed and not shown.alarms
    assert bool(np.mean(shown.expected) < 0.3) == ("still" in name)


def test_innovations_alarm_where_noise_is_not_as_told(judge: Judge) -> None:
    for name, low, high in (("half as noisy", 0.4, 0.7), ("gyro and accelerometer twice as noisy", 1.7, 2.2)):
        shown = judge(name, 7, whole)
        assert low < shown.innovation_ratio < high
        assert any("the schedule predicts 0.2" in text for text in shown.alarms)


def test_a_rest_that_somebody_disturbed_is_named(judge: Judge) -> None:
    """A door, a hand on the table: 2 mm/s for two seconds in the fourth rest of a still table."""

    def bump(data: Increments) -> Increments:
        velocity = data.velocity_mps.copy()
        start = round((3.0 * 69.0 + 30.0) / data.period_s)
        ahead, back = start, start + round(2.0 / data.period_s)
        velocity[ahead, 0] += 2e-3
        velocity[back, 0] -= 2e-3
        return replace(data, velocity_mps=velocity)

    shown = judge("as told, still table", 7, bump)
    assert [number for number, _ in shown.disturbed] == [3]
    assert any("Rests that something disturbed" in text and ": 4 (" in text for text in shown.alarms)


def test_a_rest_is_named_by_its_own_scatter_only() -> None:
    rng = np.random.default_rng(2)
    named = sum(bool(disturbed_rests(list(rng.standard_normal((23, 60, 3))))) for _ in range(200))
    assert named <= 2  # one in a thousand
    rests = list(rng.standard_normal((23, 60, 3)))
    rests[5] = 1.5 * rests[5]
    (found,) = disturbed_rests(rests)
    assert found[0] == 5 and found[1] == pytest.approx(1.5, abs=0.15)
