"""Noise for a navigation filter: against strapdown equations that have nothing of the linear model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.analysis.calibration import BiasWander, CalibrationRun, Noise, Site, Task, calibrate
from bench.analysis.calibration._inflation import inflation, mean_variance
from benchmarks.off_class._imu_noise import AS_TOLD, WRONG, record
from benchmarks.off_class.calibration import scheme
from benchmarks.off_class.inflation import KINDS, Biases, navigated
from drivers.base.constants import SCHULER_RAD_S

DPH, UG = np.radians(1.0) / 3600.0, 9.7803267715e-6
RECORD_S = 1578.0


@pytest.mark.parametrize(
    ("kind", "wander"),
    [
        (Biases(gyro=2.0, accelerometer=2.0), None),
        (Biases((1000.0,), 0.003, 5.0), BiasWander(0.003 * DPH, 5.0 * UG, 1000.0)),
        (Biases((300.0,), 0.0, 80.0), BiasWander(0.0, 80.0 * UG, 300.0)),
    ],
    ids=["white", "gyro and accelerometer", "accelerometer"],
)
def test_sigmas_are_those_of_units_that_are_navigated(kind: Biases, wander: BiasWander | None) -> None:
    """160 units for an hour, each with the mean over a record of its own taken out."""
    task, rng, runs = Task(), np.random.default_rng(3), 160
    states = np.stack([kind.begin(rng) for _ in range(runs)])
    total = np.zeros((runs, 6))
    for _ in range(round(RECORD_S)):
        total += kind.biases(states)
        states = kind.ahead(states, rng, 1.0)
    states = kind.ahead(states, rng, 7200.0)
    squares = navigated(task, kind, states, total / RECORD_S, rng, (0.25, 1.0))
    noise = Noise(0.001 * kind.gyro, 10.0 * kind.accelerometer)
    stated = inflation(noise, ((wander, 1.0),) if wander else (), task.site, RECORD_S)
    # an hour is the first of the times; heading has one degree of freedom a unit, the others two
    nees = squares[:, :, 1].mean(axis=0) / stated.whole[:, 0] ** 2
    assert nees == pytest.approx(1.0, abs=0.4)
    if wander is not None:
        bare = squares[:, :, 1].mean(axis=0) / stated.white[:, 0] ** 2
        assert bare[1:].min() > 1.8
        assert stated.factors[1:, 0] == pytest.approx(np.sqrt(bare[1:]), rel=0.25)


def test_a_constant_accelerometer_error_swings_at_schuler() -> None:
    """So slow a wander that its mean is known from no record: v = b sin(w t) / w about each axis."""
    slow = BiasWander(1e-12 * DPH, 100.0 * UG, 1e9)
    found = inflation(Noise(1e-9, 1e-9), ((slow, 1.0),), Site(0.0), 1e-3)
    added = np.sqrt(found.whole[1] ** 2 - found.white[1] ** 2)
    # two axes, and the record's mean as far from now's as now's from zero: here it is now's, which comes twice
    hours = 3600.0 * np.array(found.hours)
    rate = SCHULER_RAD_S * np.sqrt(Site(0.0).gravity_mps2 / 9.798285)
    expected = 2.0 * 100.0 * UG / rate * np.abs(np.sin(rate * hours))
    assert added == pytest.approx(expected, rel=0.05, abs=0.05)


def test_the_mean_over_a_record_varies_as_its_sum_of_covariances() -> None:
    for time_s, length_s in ((1000.0, 1578.0), (50.0, 4000.0), (20_000.0, 600.0)):
        lags = np.arange(0.5, length_s)
        sums = 2.0 * np.sum((length_s - lags) * np.exp(-lags / time_s)) / length_s**2
        assert mean_variance(time_s, length_s) == pytest.approx(sums, rel=1e-3)


def test_a_record_gives_a_factor_where_its_biases_wander() -> None:
    found = {}
    for name in ("as told, still table", "biases wander (Markov, 1000 s)"):
        data, _ = record(Task(), scheme(), (AS_TOLD | WRONG)[name], 5)
        latitude = Task().site.latitude_deg
        run = CalibrationRun("log", "", "imu", "imu", latitude, data, scheme(), "by-hand", "", (), None)
        found[name.split(",")[0].split(" ")[0]] = calibrate(run, Noise()).inflation
    told, wandering = found["as"], found["biases"]
    assert told.factor == 1.0 and (told.factors == 1.0).all()
    # with the wander that was made exactly the factor to 10 h is 5.4
    assert 2.0 < wandering.factor < 11.0
    assert wandering.record_h == pytest.approx(RECORD_S / 3600.0, abs=0.05)
    assert wandering.factors[0, 2] > wandering.factors[0, 0] > 1.5
    assert set(KINDS) >= {"biases walk", "biases flicker"}
    assert replace(told, whole=told.white * 2.0).factor == 2.0
