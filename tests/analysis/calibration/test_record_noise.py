"""What a record shows of its noise: found from exact increments with noise added here, not by the plant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.analysis.calibration import BiasWander, CalibrationRun, Noise, Task, calibrate
from bench.analysis.calibration._estimator import Options, estimate
from bench.analysis.calibration._navigation import Increments
from bench.analysis.calibration._record_noise import RecordNoise, best_wander, record_noise, rest_noise
from benchmarks.off_class._imu_noise import AS_TOLD, WRONG, record
from benchmarks.off_class.calibration import scheme
from drivers.base.errors import ConfigurationError, RecordError

TOLD = Noise()


def rests(arw: float, vrw: float, jitter: float, seconds: int = 4000) -> Increments:
    """A table at rest: white noise in units of what is told, jitter in mm/s, at 10 Hz."""
    rng, period = np.random.default_rng(5), 0.1
    shape = (10 * seconds, 3)
    angle = arw * TOLD.arw * period**0.5 * rng.standard_normal(shape)
    velocity = vrw * TOLD.vrw * period**0.5 * rng.standard_normal(shape)
    moved = 1e-3 * jitter * rng.standard_normal((shape[0] + 1, 3))
    return Increments(period, angle, velocity + np.diff(moved, axis=0))


@pytest.mark.parametrize(("arw", "vrw", "jitter"), [(1.0, 1.0, 0.0), (2.0, 0.5, 0.0), (0.5, 2.0, 0.1)])
def test_white_noise_and_jitter_are_found_from_rests(arw: float, vrw: float, jitter: float) -> None:
    found = rest_noise(rests(arw, vrw, jitter), np.ones(4000, dtype=np.bool_), TOLD)
    assert found.arw == pytest.approx(arw * TOLD.arw, rel=0.03)
    assert found.vrw == pytest.approx(vrw * TOLD.vrw, rel=0.06)
    assert found.velocity_mps == pytest.approx(1e-3 * jitter, abs=3e-5)


def test_a_table_that_jitters_more_than_the_noise_leaves_the_accelerometers_as_told() -> None:
    found = rest_noise(rests(1.0, 1.0, 1.0), np.ones(4000, dtype=np.bool_), TOLD)
    assert found.vrw == TOLD.vrw
    assert found.velocity_mps == pytest.approx(1e-3, rel=0.03)


def test_the_likeliest_wander_is_found_on_a_known_likelihood() -> None:
    """A likelihood with its top at 6e-3 deg/h, 2 ug and 300 s, 50 above none."""
    top = np.log([6e-3, 2.0, 300.0])

    def likelihood(wander: BiasWander | None) -> float:
        if wander is None:
            return 0.0
        at = np.log(
            [
                np.degrees(wander.gyro_rad_s) * 3600.0,
                wander.accelerometer_mps2 / 9.7803267715e-6,
                wander.time_s,
            ]
        )
        return float(50.0 - 10.0 * np.sum((at - top) ** 2))

    wander, gain = best_wander(likelihood)
    assert wander is not None and wander.time_s == 300.0
    assert np.degrees(wander.gyro_rad_s) * 3600.0 == pytest.approx(6e-3, rel=0.3)
    assert gain > 60.0
    assert best_wander(lambda wander: 0.0 if wander is None else 3.0) == (None, 6.0)


KINDS = ["as told, still table", "biases wander (Markov, 1000 s)", "pier sways at 0.15 Hz, 3 mm/s"]


@pytest.mark.parametrize("name", KINDS)
def test_a_record_is_judged_and_its_sigmas_are_then_true(name: str) -> None:
    task, schedule, options = Task(), scheme(), Options(alignment_s=48.0)
    data, truth = record(task, schedule, (AS_TOLD | WRONG)[name], 3)
    first = estimate(data, task, options, schedule)
    shown = record_noise(data, task, options, first, schedule)
    found = estimate(data, replace(task, noise=shown.found), replace(options, wander=shown.wander), schedule)
    error = found.parameters - truth
    nees = float(error @ np.linalg.solve(found.covariance, error)) / 24.0
    # 24 degrees of freedom: 0.52 to 1.64 holds 95 %.
    assert 0.3 < nees < 1.8
    assert found.innovation_rms == pytest.approx(1.0, abs=0.04)
    if name in AS_TOLD:
        assert not shown.alarms and shown.wander is None
        return
    before = first.parameters - truth
    assert before @ np.linalg.solve(first.covariance, before) / 24.0 > nees + 0.2
    assert any(("sways" if "sways" in name else "wander") in text for text in shown.alarms)
    # A pier of 3 mm/s is taken as white noise of that size.
    assert ("sways" in name) == (2e-3 < shown.found.velocity_mps < 4e-3)
    assert len(found.course_s) == len(found.course_parameters) == schedule.positions
    assert found.course_parameters[-1] == pytest.approx(found.parameters, abs=1e-12)
    assert found.course[-1] == pytest.approx(found.sigma, rel=1e-9)


def test_of_biases_that_wander_the_mean_over_the_record_is_estimated() -> None:
    """The sigma of the mean is far below the wander's own; that of the constant part is not."""
    task, schedule = Task(), scheme()
    data, truth = record(task, schedule, WRONG["biases wander (Markov, 1000 s)"], 2)
    wander = BiasWander(np.radians(0.003) / 3600.0, 5.0 * 9.8e-6, 1000.0)
    found = estimate(data, task, Options(alignment_s=48.0, wander=wander), schedule)
    error = found.parameters[3:6] - truth[3:6]
    assert (found.sigma[3:6] < 0.4 * wander.accelerometer_mps2).all()
    assert (np.abs(error) < 4.0 * found.sigma[3:6]).all()


def test_alarms_name_what_is_not_as_told() -> None:
    shown = RecordNoise(TOLD, Noise(0.002, 10.0, 3e-3), None, 0.0, 9.0)
    said = " ".join(shown.alarms)
    assert "gyro noise of the rests is 0.002" in said and "3.00 mm/s" in said and "correlated" in said
    assert "accelerometer" not in said


def test_a_unit_with_errors_ten_times_as_large_is_calibrated_when_that_is_told() -> None:
    """1000 ppm, 10 mg, 1 deg/h: turned by it, up is 3 deg off; without the word that is refused."""
    told = np.where(np.arange(30) // 3 == 1, 1.0, 10.0)
    large = replace(Task(), prior_sigma=Task().prior_sigma * told)
    data, truth = record(large, scheme(), AS_TOLD["as told, still table"], 0)
    run = CalibrationRun(
        "log", "", "imu", "imu", large.site.latitude_deg, data, scheme(), "by-hand", "", (), None
    )
    found = calibrate(run, Noise(), prior_scale=10.0).estimate
    error = found.parameters - truth
    assert float(error @ np.linalg.solve(found.covariance, error)) / 24.0 < 1.8
    with pytest.raises(RecordError, match="disagree about the turns"):
        calibrate(run, Noise())
    with pytest.raises(ConfigurationError, match="Expected: 1 to 30"):
        calibrate(run, Noise(), prior_scale=100.0)
