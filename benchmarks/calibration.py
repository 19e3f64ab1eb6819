"""System-level calibration: covariance against a plain filter, searched schemes against classical ones.

Run as `python -m benchmarks.calibration`; with `--monte-carlo [runs]` it also simulates full records (72 minutes
at 100 Hz), all 24 parameters drawn from their priors, and holds errors against predicted sigma.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator

import numpy as np

from bench.analysis.calibration import (
    PARAMETERS,
    BiasWander,
    Effort,
    Schedule,
    Task,
    after,
    evaluate,
    load_scheme,
    search,
)
from bench.analysis.calibration._conventions import unpack
from bench.analysis.calibration._estimator import Options, estimate
from bench.analysis.calibration._model import dwell_transitions, process_noise, turn_transitions
from bench.analysis.calibration._navigation import Increments
from bench.analysis.calibration._segments import Segment, covariance, fold, schedule_segments
from benchmarks._measure import Row, figure, in_turns, row
from benchmarks._turned_imu import Rest, Turn, measure_motion
from drivers.base.arrays import Array
from drivers.base.clock import host_seconds
from simulators.plant.imu import ImuErrors, ImuNoise

_TASK = Task()
_EFFORT = Effort(8, 300, 2)
_WANDER = BiasWander(0.003 * math.radians(1.0) / 3600.0, 5.0 * 9.7803267715e-6, 1000.0)


def plain_filter(task: Task, schedule: Schedule) -> Callable[[], Array]:
    """Return a filter, its transitions at hand: one predict and one update a second, to posterior sigma (30,)."""
    scale = task.prior_sigma
    attitudes = schedule.attitudes()
    seconds = dwell_transitions(task.site, attitudes, np.array([1.0]))[:, 0]
    turns = turn_transitions(task.site, attitudes[:-1], schedule.moves, schedule.rate_dps, schedule.profile)
    noise = np.zeros((30, 30))
    noise[:6, :6] = process_noise(task.site, task.noise, 1.0)
    between = np.zeros((30, 30))
    between[:6, :6] = process_noise(task.site, task.noise, 90.0 / schedule.rate_dps)
    whole = [_whole(row, scale) for row in (*seconds, *turns)]
    noise, between = noise / np.outer(scale, scale), between / np.outer(scale, scale)
    r = np.eye(3) * (task.noise.velocity_mps / scale[3]) ** 2

    def filtered() -> Array:
        p = np.eye(30)
        for number in range(len(attitudes)):
            step = whole[number]
            for _ in range(round(schedule.dwell_s)):
                p = step @ p @ step.T + noise
                gain = p[:, 3:6] @ np.linalg.inv(p[3:6, 3:6] + r)
                p = p - gain @ p[3:6]
                p = (p + p.T) / 2.0
            if number < len(turns):
                step = whole[len(attitudes) + number]
                p = step @ p @ step.T + between
        return np.asarray(np.sqrt(np.diag(p)) * scale)

    return filtered


def _whole(row: Array, scale: Array) -> Array:
    matrix = np.eye(30)
    matrix[:6] = row
    return matrix / scale[:, None] * scale


def covariance_rows() -> Iterator[Row]:
    """Yield the chain of segments, alone and with making them, to the plain filter (equal to 1e-8) and goal."""
    schedule = load_scheme("23-position").with_(profile="constant")
    segments, plain = schedule_segments(_TASK, schedule), plain_filter(_TASK, schedule)

    def chained(made: Segment) -> Array:
        return np.asarray(np.sqrt(np.diag(covariance(fold(made)))) * _TASK.prior_sigma)

    def from_nothing() -> Array:
        return chained(schedule_segments(_TASK, schedule))

    assert np.max(np.abs(from_nothing() / plain() - 1.0)) < 1e-8
    name = "plain Kalman filter"
    alone, made = in_turns(lambda: chained(segments), plain), in_turns(from_nothing, plain)
    yield row("covariance of 23 positions, segments at hand", alone, name, per=1e3, unit="ms")
    yield row("covariance of 23 positions, from nothing", made, name, per=1e3, unit="ms")
    title = "covariance of 23 positions, from nothing: times faster than the plain filter"
    yield figure(title, made.ratio, 50.0, "goal", "times")


def search_rows() -> list[Row]:
    """Worst sigma over target of searched schemes on a two-axis table."""
    found = []
    for turns, dwell_s in ((22, 180.0), (22, 60.0), (14, 60.0)):
        pattern = Schedule("", (), np.eye(3), dwell_s)
        begin = host_seconds()
        result = search(_TASK, "two-axis-horizontal", turns, pattern, effort=_EFFORT)
        took = host_seconds() - begin
        classical = evaluate(_TASK, load_scheme("23-position").with_(dwell_s=dwell_s)).merit.worst
        title = f"{turns} turns, two axes, {dwell_s:g} s dwell ({took:.0f} s search)"
        found.append(
            figure(
                title,
                result.merit.worst,
                classical,
                "23-position, same dwell",
                "worst sigma/target",
                least=True,
            )
        )
    made = load_scheme("23-position").with_(dwell_s=60.0)
    further = after(_TASK, [made])
    chosen = search(further, "two-axis-horizontal", 8, made, effort=_EFFORT)
    again = evaluate(further, made)
    title = (
        f"8 turns after 23 positions, {chosen.schedule.duration_s / 60.0:.0f} against "
        f"{made.duration_s / 60.0:.0f} min"
    )
    found.append(
        figure(
            title, chosen.merit.worst, again.merit.worst, "them once more", "worst sigma/target", least=True
        )
    )
    return found


def rows() -> list[Row]:
    """Return benchmark, ours, yardstick, yardstick_name, unit and ratio (ours / yardstick) of each comparison."""
    return [*covariance_rows(), *search_rows()]


def monte_carlo(
    name: str, runs: int, wander: BiasWander | None = None, states: bool = True
) -> dict[str, float]:
    """Mean NEES / 24, rms of innovations, worst rms error over target of full simulated calibrations."""
    schedule = load_scheme(name)
    legs: list[Rest | Turn] = [Rest(schedule.dwell_s)]
    for move in schedule.moves:
        angle = math.radians(move.angle_deg)
        legs += [Turn(np.eye(3)[move.axis], angle, schedule.turn_s(move)), Rest(schedule.dwell_s)]
    task = _TASK
    noise = ImuNoise(task.noise.arw, task.noise.vrw, vibration_mps=task.noise.velocity_mps)
    if wander is not None:
        noise = ImuNoise(
            noise.arw_rad_per_sqrt_s,
            noise.vrw_mps_per_sqrt_s,
            wander.gyro_rad_s,
            wander.accelerometer_mps2,
            wander.time_s,
            noise.vibration_mps,
        )
    squares, innovations, errors = [], [], []
    for seed in range(runs):
        truth = np.random.default_rng(1000 + seed).standard_normal(24) * task.prior_sigma[PARAMETERS]
        made = measure_motion(
            schedule.home,
            legs,
            ImuErrors(*unpack(truth)),
            noise,
            latitude_deg=task.site.latitude_deg,
            gravity_mps2=task.site.gravity_mps2,
            seed=seed,
        )
        data = Increments(made.period_s, made.angle_rad, made.velocity_mps)
        found = estimate(data, task, Options(wander=wander if states else None), schedule)
        error = found.parameters - truth
        squares.append(error @ np.linalg.solve(found.covariance, error) / 24.0)
        innovations.append(found.innovation_rms)
        errors.append(error / task.target_sigma)
    worst = float(np.sqrt(np.mean(np.square(errors), axis=0)).max())
    return {"nees": float(np.mean(squares)), "innovations": float(np.mean(innovations)), "worst": worst}


def main() -> None:
    """Print the tables."""
    for found in rows():
        print(
            f"{found['benchmark']:<52}{found['ours']:>10.4g}{found['yardstick']:>10.4g}  {found['unit']:<20}"
            f"{found['ratio']:>8.3g}  {found['yardstick_name']}"
        )
    if "--monte-carlo" in sys.argv:
        runs = int(sys.argv[-1]) if sys.argv[-1].isdigit() else 20
        print(f"\n{runs} runs each: NEES / 24, innovations rms, worst rms error over target")
        for name in ("19-position", "23-position", "t22"):
            _say(name, monte_carlo(name, runs))
        for states in (False, True):
            title = f"23-position, bias wander, {36 if states else 30} states"
            _say(title, monte_carlo("23-position", max(4, runs // 2), _WANDER, states))


def _say(title: str, told: dict[str, float]) -> None:
    print(f"{title:<40}{told['nees']:>8.2f}{told['innovations']:>8.3f}{told['worst']:>8.2f}", flush=True)


if __name__ == "__main__":
    main()
