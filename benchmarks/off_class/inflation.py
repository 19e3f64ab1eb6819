"""Noise for a navigation filter: are the sigmas true that it states with the factor of a calibration?

    python -m benchmarks.off_class.inflation [--records N] [--runs N] [--only TEXT]

Each record gives white noise and a factor. The same unit, its biases wandering on, then stands still for 10 h
and is navigated by strapdown equations that have nothing of the model: whole rotations, a sphere, one second a
step. The mean of the biases over the record is taken out exactly; two hours pass between. NEES: squared error
over the variance stated; 1 when sigmas are true, without the factor in brackets.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.analysis.calibration import Task
from bench.analysis.calibration._estimator import Options, estimate
from bench.analysis.calibration._inflation import ERRORS, HOURS, inflation
from bench.analysis.calibration._record_noise import record_noise
from benchmarks._turned_imu import ImuRecord
from benchmarks.off_class._imu_noise import DPH, record, white
from benchmarks.off_class.calibration import scheme
from drivers.base.arrays import Array
from drivers.base.constants import UG_MPS2

_GAP_S, _RADIUS_M = 7200, 6378137.0


@dataclass(frozen=True)
class Biases:
    """Six biases as sums of Markov processes of `times_s` (infinite: a walk), each of this size, deg/h and ug;
    white noise `gyro`, `accelerometer` times what is told.
    """

    times_s: tuple[float, ...] = ()
    gyro_dph: float = 0.0
    accelerometer_ug: float = 0.0
    gyro: float = 1.0
    accelerometer: float = 1.0

    def begin(self, rng: np.random.Generator) -> Array:
        """Return states (k, 6) in units of the size, a walk at nothing."""
        still = np.isinf(np.array(self.times_s))[:, None]
        return np.where(still, 0.0, rng.standard_normal((len(self.times_s), 6)))

    def ahead(self, states: Array, rng: np.random.Generator, step_s: float) -> Array:
        """Return states (..., k, 6) a step later; a walk goes by one size an hour."""
        times = np.array(self.times_s)[:, None]
        keep = np.exp(-step_s / times)
        drive = np.where(np.isinf(times), np.sqrt(step_s / 3600.0), np.sqrt(1.0 - keep**2))
        return np.asarray(keep * states + drive * rng.standard_normal(states.shape))

    def biases(self, states: Array) -> Array:
        """Return the biases of states (..., k, 6), SI, (..., 6)."""
        size = np.repeat([self.gyro_dph * DPH, self.accelerometer_ug * UG_MPS2], 3)
        return np.asarray(states.sum(axis=-2) * size)


KINDS = {
    "as told, still table": Biases(),
    "gyro and accelerometer twice as noisy": Biases(gyro=2.0, accelerometer=2.0),
    "biases wander (Markov, 1000 s)": Biases((1000.0,), 0.003, 5.0),
    "biases walk": Biases((np.inf,), 0.005, 8.0),
    "biases flicker": Biases(tuple(10.0 * 3.0**k for k in range(8)), 0.0008, 1.5),
}


@dataclass(frozen=True, eq=False)
class Outcome:
    """NEES by error and time, (3, hours), with the factor and without; the records' factors."""

    nees: Array
    bare: Array
    factors: Array


def examine(kind: Biases, records: int, runs: int, first_seed: int = 0) -> Outcome:
    """Calibrate `records` units and navigate each `runs` times."""
    task, schedule = Task(), scheme()
    found, ends = [], []
    for seed in range(first_seed, first_seed + records):
        kept: dict[str, Array] = {}

        def disturb(
            exact: ImuRecord, attitude: Array, rng: np.random.Generator, kept: dict[str, Array] = kept
        ) -> tuple[Array, Array, Array]:
            angle, velocity, _ = white(kind.gyro, kind.accelerometer)(exact, attitude, rng)
            seconds = round(len(angle) * exact.period_s) + 1
            states, course = kind.begin(rng), []
            for _ in range(seconds):
                course.append(kind.biases(states))
                states = kind.ahead(states, rng, 1.0)
            held = np.array(course)[(np.arange(len(angle)) * exact.period_s).astype(np.int64)]
            mean = held.mean(axis=0)
            kept["states"], kept["mean"] = states, mean
            return angle + exact.period_s * held[:, :3], velocity + exact.period_s * held[:, 3:], mean

        data, _ = record(task, schedule, disturb, seed)
        options = Options(alignment_s=48.0)
        first = estimate(data, task, options, schedule)
        shown = record_noise(data, task, options, first, schedule)
        length_s = len(data.angle_rad) * data.period_s
        found.append(inflation(shown.found, shown.wanders, task.site, length_s))
        rng = np.random.default_rng((seed, 9))
        later = kind.ahead(np.broadcast_to(kept["states"], (runs, *kept["states"].shape)), rng, float(_GAP_S))
        ends.append(navigated(task, kind, later, kept["mean"], rng))
    squares = np.array(ends)  # (records, runs, 3, hours)
    stated = np.array([[made.whole**2, made.white**2] for made in found])[:, :, None]
    over = (squares[:, None] / stated).mean(axis=(0, 2))
    return Outcome(over[0], over[1], np.array([made.factor for made in found]))


def navigated(
    task: Task,
    kind: Biases,
    states: Array,
    mean: Array,
    rng: np.random.Generator,
    until_h: Sequence[float] = HOURS,
) -> Array:
    """Return squared errors of heading, velocity, position, (runs, 3, hours), of units that stand level and
    still.
    """
    runs, site = len(states), task.site
    arw, vrw = kind.gyro * task.noise.arw, kind.accelerometer * task.noise.vrw
    earth, gravity = site.earth_rate_rad_s, np.array([0.0, 0.0, site.gravity_mps2])
    rate = float(np.linalg.norm(earth))
    start = np.radians(site.latitude_deg)
    c, v = np.broadcast_to(np.eye(3), (runs, 3, 3)).copy(), np.zeros((runs, 3))
    latitude, longitude = np.full(runs, start), np.zeros(runs)
    found = []
    for second in range(1, round(3600.0 * until_h[-1]) + 1):
        bias = kind.biases(states) - mean
        states = kind.ahead(states, rng, 1.0)
        turned = earth + bias[:, :3] + arw * rng.standard_normal((runs, 3))
        pushed = gravity + bias[:, 3:] + vrw * rng.standard_normal((runs, 3))
        of_earth = rate * np.column_stack([np.zeros(runs), np.cos(latitude), np.sin(latitude)])
        carried = np.column_stack([-v[:, 1], v[:, 0], v[:, 0] * np.tan(latitude)]) / _RADIUS_M
        before, c = c, turn(-(of_earth + carried)) @ c @ turn(turned)
        gained = np.einsum("nij,nj->ni", 0.5 * (before + c), pushed) - gravity
        v = v + gained - np.cross(2.0 * of_earth + carried, v)
        v[:, 2] = 0.0
        latitude = latitude + v[:, 1] / _RADIUS_M
        longitude = longitude + v[:, 0] / (_RADIUS_M * np.cos(latitude))
        if second in [round(3600.0 * hours) for hours in until_h]:
            heading = 0.5 * (c[:, 0, 1] - c[:, 1, 0])
            east, north = longitude * np.cos(start) * _RADIUS_M, (latitude - start) * _RADIUS_M
            found.append(np.stack([heading**2, v[:, 0] ** 2 + v[:, 1] ** 2, east**2 + north**2], axis=1))
    return np.stack(found, axis=2)


def turn(vector: Array) -> Array:
    """Return the rotations by vectors (n, 3), rad: Rodrigues to the fourth order, for angles of 1e-4."""
    x, y, z = vector.T
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    square = np.sum(vector**2, axis=1)[:, None, None]
    return np.asarray(np.eye(3) + (1.0 - square / 6.0) * skew + (0.5 - square / 24.0) * skew @ skew)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--records", type=int, default=12)
    parser.add_argument("--runs", type=int, default=12)
    parser.add_argument("--only", default="", help="kinds of noise whose name holds this")
    asked = parser.parse_args(arguments)
    heads = [f"{name}, {hours:g} h" for name in ERRORS for hours in HOURS]
    print(f"| noise | factor | {' | '.join(heads)} |\n|{'---|' * (2 + len(heads))}")
    for number, (name, kind) in enumerate(KINDS.items()):
        if asked.only not in name:
            continue
        o = examine(kind, asked.records, asked.runs, 5000 + 1000 * number)
        cells = [f"{a:.2f} ({b:.1f})" for a, b in zip(o.nees.ravel(), o.bare.ravel(), strict=True)]
        low, middle, high = np.percentile(o.factors, [0, 50, 100])
        print(f"| {name} | {middle:.1f} ({low:.1f} to {high:.1f}) | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
