"""Calibration and simulation against what people would write or install instead: `python -m benchmarks peers`.

Both do the same work in turns; figures are medians of processor time. A missing peer is named and skipped;
gnss-ins-sim is on no package index and takes part where `gnss_ins_sim` can be imported (PYTHONPATH).
"""

from __future__ import annotations

import contextlib
import io
import math
import tempfile
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import numpy as np

from bench.analysis.calibration import Effort, Noise, Schedule, Site, Task, load_scheme, search
from bench.analysis.calibration._model import dwell_transitions, process_noise, turn_transitions
from bench.analysis.calibration._result import observability
from bench.analysis.calibration._segments import covariance, fold, schedule_segments
from benchmarks._measure import Row, in_turns, row
from benchmarks._turned_imu import Rest, Turn, measure_motion
from simulators.plant.imu import ImuErrors, ImuNoise

_TASK = Task()


def rows() -> Iterator[Row]:
    """Yield the rows of every peer that is installed."""
    for work in (observing, filtering, searching, imu_data):
        try:
            yield from work()
        except ImportError as missing:
            print(f"skipped: {work.__name__}: {missing}")


def observing() -> Iterator[Row]:
    """Observability degrees of 30 states: one factorisation, or a least-squares problem a state."""
    task = Task(site=Site(latitude_deg=45.0), noise=Noise(0.001, 10.0, 1e-3))
    q = np.random.default_rng(0).normal(size=(600, 30))
    scaled = q * (task.prior_sigma / task.noise.velocity_mps)

    def peer() -> np.ndarray:
        norms = [np.linalg.norm(np.linalg.lstsq(scaled.T, unit, rcond=None)[0]) for unit in np.eye(30)]
        return 1.0 / np.array(norms)

    np.testing.assert_allclose(observability(q, task).normalised, peer(), rtol=1e-6)
    pair = in_turns(lambda: observability(q, task), peer)
    name = f"numpy {version('numpy')} lstsq a state"
    yield row("observability degrees, 30 states, 600 rows", pair, name, per=1e3, unit="ms")


def filtering() -> Iterator[Row]:
    """Covariance of a 23-position calibration: a chain of segments, or a filter that goes second by second."""
    schedule = load_scheme("23-position").with_(profile="constant")
    scale, steps = _TASK.prior_sigma, _transitions(schedule)

    def ours() -> np.ndarray:
        end = fold(schedule_segments(_TASK, schedule))
        return np.asarray(np.sqrt(np.diag(covariance(end))) * scale)

    def peer() -> np.ndarray:
        return _plain(steps)

    np.testing.assert_allclose(ours(), peer(), rtol=1e-6)
    pair = in_turns(ours, peer, turns=3)
    title = f"covariance of 23 positions, 30 states, {len(steps):,} seconds and turns"
    yield row(title, pair, f"filterpy {version('filterpy')} KalmanFilter", per=1e3, unit="ms")


def _plain(steps: list[tuple[np.ndarray, np.ndarray, bool]]) -> np.ndarray:
    """Return posterior sigma (30,) by filterpy, one prediction and one update a step."""
    from filterpy.kalman import KalmanFilter

    scale = _TASK.prior_sigma
    kalman = KalmanFilter(dim_x=30, dim_z=3)
    kalman.P = np.eye(30)
    kalman.H = np.eye(30)[3:6]
    kalman.R = np.eye(3) * (_TASK.noise.velocity_mps / scale[3]) ** 2
    for transition, noise, updates in steps:
        kalman.predict(F=transition, Q=noise)
        if updates:
            kalman.update(np.zeros(3))
    return np.asarray(np.sqrt(np.diag(kalman.P)) * scale)


def _transitions(schedule: Schedule) -> list[tuple[np.ndarray, np.ndarray, bool]]:
    """Return (transition, process noise, whether velocities follow) of every second and turn, prior-scaled."""
    scale = _TASK.prior_sigma
    attitudes = schedule.attitudes()
    seconds = dwell_transitions(_TASK.site, attitudes, np.array([1.0]))[:, 0]
    turns = turn_transitions(_TASK.site, attitudes[:-1], schedule.moves, schedule.rate_dps, schedule.profile)
    rest, moving = (_noise(duration_s) for duration_s in (1.0, 90.0 / schedule.rate_dps))
    steps = []
    for number, second in enumerate(seconds):
        steps += [(_whole(second, scale), rest, True)] * round(schedule.dwell_s)
        if number < len(turns):
            steps.append((_whole(turns[number], scale), moving, False))
    return steps


def _noise(duration_s: float) -> np.ndarray:
    noise = np.zeros((30, 30))
    noise[:6, :6] = process_noise(_TASK.site, _TASK.noise, duration_s)
    return noise / np.outer(_TASK.prior_sigma, _TASK.prior_sigma)


def _whole(rows_of_navigation: np.ndarray, scale: np.ndarray) -> np.ndarray:
    matrix = np.eye(30)
    matrix[:6] = rows_of_navigation
    return np.asarray(matrix / scale[:, None] * scale)


def searching() -> Iterator[Row]:
    """What a schedule costs in the scheme search, and in a filter that goes second by second."""
    pattern = Schedule("", (), np.eye(3), 60.0)
    effort = Effort(4, 40, 1)
    result = search(_TASK, "two-axis-horizontal", 14, pattern, effort=effort)
    steps = _transitions(result.schedule.with_(profile="constant"))
    pair = in_turns(
        lambda: search(_TASK, "two-axis-horizontal", 14, pattern, effort=effort),
        lambda: _plain(steps),
        turns=3,
    )
    yield {
        "benchmark": f"scheme search, one of {result.evaluated:,} schedules of 14 turns",
        "ours": 1e6 * pair.ours_s / result.evaluated,
        "yardstick": 1e6 * pair.other_s,
        "yardstick_name": f"filterpy {version('filterpy')} KalmanFilter",
        "unit": "us",
        "ratio": pair.ratio * result.evaluated,
        "kept": True,
    }


def imu_data() -> Iterator[Row]:
    """Ten minutes of an IMU at 100 Hz with a turn every minute."""
    from gnss_ins_sim.sim import imu_model, ins_sim

    legs: list[Rest | Turn] = [Rest(50.0), Turn(np.array([0.0, 0.0, 1.0]), math.radians(90.0), 10.0)] * 10
    noise = ImuNoise(1e-6, 1e-4, 1e-7, 1e-5, 100.0)

    def ours() -> int:
        made = measure_motion(np.eye(3), legs, ImuErrors(), noise, latitude_deg=32.0, gravity_mps2=9.79)
        return len(made.angle_rad)

    lines = ["ini", "32,120,0,0,0,0,0,0,0", "command", *["1,0,0,0,0,0,0,50,0", "1,9,0,0,0,0,0,10,0"] * 10]
    with tempfile.TemporaryDirectory(prefix="gyrobench-imu-") as scratch:
        motion = Path(scratch) / "motion.csv"
        motion.write_text("\n".join(lines) + "\n", encoding="utf-8")

        def peer() -> int:
            imu = imu_model.IMU(accuracy="mid-accuracy", axis=6, gps=False)
            with contextlib.redirect_stdout(io.StringIO()):
                made = ins_sim.Sim([100.0, 0.0, 0.0], str(motion), ref_frame=1, imu=imu)
                made.run(1)
            return len(made.dmgr.gyro.data[0])

        assert abs(ours() - peer()) <= 20
        pair = in_turns(ours, peer, turns=3)
    yield row("IMU data, 60,000 samples of 6 axes", pair, "gnss-ins-sim 3.0.0_alpha", per=1e3, unit="ms")


if __name__ == "__main__":
    from benchmarks.__main__ import show

    show(rows())
