"""Records of a turned IMU whose noise is not what the filter assumes: made from exact increments, noise apart.

The exact increments are those of `benchmarks/_turned_imu.py`; none of the noise is the plant's or filter's.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from bench.analysis.calibration import PARAMETERS, Schedule, Task
from bench.analysis.calibration._conventions import unpack
from bench.analysis.calibration._navigation import Increments
from benchmarks._turned_imu import ImuRecord, Rest, Turn, measure_motion
from drivers.base.arrays import Array
from drivers.base.constants import UG_MPS2
from simulators.plant.imu import ImuErrors, ImuNoise

DPH = math.radians(1.0) / 3600.0
ARW, VRW = math.radians(0.001) / 60.0, 10.0 * UG_MPS2
"""What the filter is told: 0.001 deg/sqrt(h), 10 ug/sqrt(Hz)."""
Disturbance = Callable[[ImuRecord, Array, np.random.Generator], tuple[Array, Array, Array]]
"""Of a record and its attitudes, body to level, (n, 3, 3): increments to add to angle (rad) and velocity (m/s),
(n, 3) each; the mean of biases that wander, (6,), SI."""


def white(gyro: float = 1.0, accelerometer: float = 1.0, sway_mps: float = 0.0) -> Disturbance:
    """Return white noise in units of what is told, and a table that jitters by `sway_mps` at every sample."""

    def add(record: ImuRecord, attitude: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        shape, root = record.angle_rad.shape, math.sqrt(record.period_s)
        angle = gyro * ARW * root * rng.standard_normal(shape)
        velocity = accelerometer * VRW * root * rng.standard_normal(shape)
        jitter = sway_mps * rng.standard_normal((shape[0] + 1, 3))
        return angle, velocity + _in_body(attitude, jitter), np.zeros(6)

    return add


def wandering(gyro_dph: float, accelerometer_ug: float, kind: str, time_s: float = 1000.0) -> Disturbance:
    """Return told white noise with biases that wander; `kind`: markov, walk (that much in an hour) or flicker."""

    def series(count: int, period_s: float, rng: np.random.Generator) -> Array:
        if kind == "walk":
            return np.cumsum(rng.standard_normal((count, 3)), axis=0) * math.sqrt(period_s / 3600.0)
        if kind == "markov":
            keep = math.exp(-period_s / time_s)
            drive = rng.standard_normal((count, 3)) * math.sqrt(1.0 - keep**2)
            drive[0] /= math.sqrt(1.0 - keep**2)
            return np.asarray(lfilter([1.0], [1.0, -keep], drive, axis=0))
        frequency = np.fft.rfftfreq(count, period_s)[:, None]
        frequency[0] = np.inf
        phase = rng.standard_normal((2, len(frequency), 3))
        made = np.fft.irfft((phase[0] + 1j * phase[1]) / np.sqrt(frequency), count, axis=0)
        return np.asarray(made / made.std())

    def add(record: ImuRecord, attitude: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        angle, velocity, _ = white()(record, attitude, rng)
        count, period = len(angle), record.period_s
        gyro = gyro_dph * DPH * series(count, period, rng)
        accelerometer = accelerometer_ug * UG_MPS2 * series(count, period, rng)
        mean = np.concatenate([gyro.mean(axis=0), accelerometer.mean(axis=0)])
        return angle + period * gyro, velocity + period * accelerometer, mean

    return add


def swaying(amplitude_mps: float, frequency_hz: float) -> Disturbance:
    """Return told noise on a pier that sways: narrow-band velocity, no white noise to average out."""

    def add(record: ImuRecord, attitude: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        angle, velocity, _ = white()(record, attitude, rng)
        pole = math.exp(-2.0 * math.pi * frequency_hz * record.period_s / 20.0)
        turn = 2.0 * math.pi * frequency_hz * record.period_s
        drive = rng.standard_normal((len(angle) + 1, 3))
        swing = lfilter([1.0], [1.0, -2.0 * pole * math.cos(turn), pole**2], drive, axis=0)
        return angle, velocity + _in_body(attitude, amplitude_mps * swing / swing.std()), np.zeros(6)

    return add


def _in_body(attitude: Array, level_mps: Array) -> Array:
    """Return the increments of velocity (n, 3) in body axes of a table that moves by (n + 1, 3) in level axes."""
    return np.asarray(np.einsum("nji,nj->ni", attitude, np.diff(level_mps, axis=0)))


def attitudes(home: Array, legs: list[Rest | Turn], rate_hz: float) -> Array:
    """Return body to level in the middle of each sample of the legs, (n, 3, 3), of turns from rest to rest."""
    start, parts = Rotation.from_matrix(home), []
    for leg in legs:
        share = (np.arange(round(leg.duration_s * rate_hz)) + 0.5) / (leg.duration_s * rate_hz)
        if isinstance(leg, Rest):
            parts.append(np.broadcast_to(start.as_matrix(), (len(share), 3, 3)))
            continue
        done = share - np.sin(2.0 * np.pi * share) / (2.0 * np.pi)
        turned = Rotation.from_rotvec(np.outer(done, leg.angle_rad * leg.axis))
        parts.append((start * turned).as_matrix())
        start = start * Rotation.from_rotvec(leg.angle_rad * leg.axis)
    return np.concatenate(parts)


AS_TOLD: dict[str, Disturbance] = {
    "as told, table jitters 1 mm/s": white(sway_mps=1e-3),
    "as told, still table": white(),
}
WRONG: dict[str, Disturbance] = {
    "gyro and accelerometer twice as noisy": white(2.0, 2.0),
    "gyro twice as noisy": white(gyro=2.0),
    "half as noisy": white(0.5, 0.5),
    "biases wander (Markov, 1000 s)": wandering(0.003, 5.0, "markov"),
    "biases walk": wandering(0.005, 8.0, "walk"),
    "biases flicker": wandering(0.002, 4.0, "flicker"),
    "pier sways at 0.15 Hz, 3 mm/s": swaying(3e-3, 0.15),
}


def record(task: Task, schedule: Schedule, disturbance: Disturbance, seed: int) -> tuple[Increments, Array]:
    """Return a record of an IMU with parameters drawn from their priors, and these, (24,), SI.

    Biases are the means over the record.
    """
    legs: list[Rest | Turn] = [Rest(schedule.dwell_s)]
    for move in schedule.moves:
        turn = Turn(np.eye(3)[move.axis], math.radians(move.angle_deg), schedule.turn_s(move))
        legs += [turn, Rest(schedule.dwell_s)]
    truth = np.random.default_rng((seed, 1)).standard_normal(24) * task.prior_sigma[PARAMETERS]
    exact = measure_motion(
        schedule.home,
        legs,
        ImuErrors(*unpack(truth)),
        ImuNoise(0.0, 0.0, vibration_mps=0.0),
        latitude_deg=task.site.latitude_deg,
        gravity_mps2=task.site.gravity_mps2,
    )
    attitude = attitudes(schedule.home, legs, 1.0 / exact.period_s)
    angle, velocity, mean = disturbance(exact, attitude, np.random.default_rng((seed, 2)))
    truth[:6] += mean
    return Increments(exact.period_s, exact.angle_rad + angle, exact.velocity_mps + velocity), truth
