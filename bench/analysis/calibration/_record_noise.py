"""The noise that a record shows of itself, against what the filter was told; wander of biases by likelihood.

White noise is read off the rests: first differences of means of 1 s know nothing of slow wander, nor of what is
estimated. Gyro: var = 2 N^2. Accelerometer: each second gains white noise V and the jitter J of the table's
velocity at its two ends, a moving average: cov at lag 1 = -J^2, var = V^2 + 2 J^2. A base that rocks is no gyro
noise: its differences are not white, and shorter means show less of it. Wander shows in the
innovations of the filter only, through turns: there the likelihood of a Markov wander is held against none.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.analysis.calibration._conventions import DPH_RAD_S, Noise, Task
from bench.analysis.calibration._estimator import (
    BiasWander,
    Estimate,
    Options,
    filter_track,
    prior_sigma,
    rest_intervals,
)
from bench.analysis.calibration._expected import by_rest, disturbed_rests, expected_innovations
from bench.analysis.calibration._navigation import Increments, Track, align, compensate, navigate
from bench.analysis.calibration._schedule import Schedule
from bench.analysis.common.statistics import stretches
from drivers.base.arrays import Array
from drivers.base.constants import UG_MPS2

FACTOR = 1.25
"""Noise beside what was told by more than this factor is an alarm; a record's own scatter is a few per cent."""
LIKELIHOOD = 9.0
"""Twice the gain of logarithmic likelihood that says biases wander."""
_FIRST = ((1e-3, 2.0, 1000.0), (3e-3, 6.0, 1000.0), (9e-3, 18.0, 1000.0), (3e-3, 6.0, 100.0))
"""Wander tried first: gyro deg/h, accelerometer ug, correlation time s."""
_BOUNDS = ((1e-5, 0.02, 50.0), (1.0, 1000.0, 10_000.0))
_STEPS = ((2.0, 2.0, 3.0), (1.4, 1.4, 1.7))
_SIZES, _TIMES = (0.4, 1.0, 2.5), (1.0 / 9.0, 1.0 / 3.0, 1.0, 3.0, 9.0)
"""Factors of the grid about the best wander, of sizes and of the time."""
_WORTH = 0.5
"""Twice the gain of logarithmic likelihood by which a step has to be better."""
_LAG_SIGMA = 6.0
_UNSEEN = 0.15
"""Scatter of the accelerometer noise found, over what was told, beyond which the record does not show it."""
_VIOLATED = 3.0
_ROUNDS = 4
_FINER, _FEWEST = (2, 4, 8, 16), 5
"""Parts of a second whose means are tried on a base that rocks, of so many samples at least: a unit's own filter
is a few samples long."""


@dataclass(frozen=True)
class RecordNoise:
    """What a record shows of its noise. `told`: what the filter was given.

    `found`: from the rests; `wander`: None where the record does not ask for one; `wander_gain`: twice the gain
    of logarithmic likelihood by the best wander tried. `correlation`: of innovations a second apart, in sigma
    of what white ones have. `innovations`: rms with the noise told, rest by rest, beside `expected`, what the
    schedule predicts with the sensors as told on a table that jitters as the rests show. `disturbed`: rests,
    from 0, whose innovations stay too large with the noise found, and how large. `wanders`: wanders
    about the best and their weights by likelihood, which sum to 1; none without a wander.
    """

    told: Noise
    found: Noise
    wander: BiasWander | None
    wander_gain: float
    correlation: float
    innovations: tuple[float, ...] = ()
    expected: tuple[float, ...] = ()
    disturbed: tuple[tuple[int, float], ...] = ()
    wanders: tuple[tuple[BiasWander, float], ...] = ()

    @property
    def innovation_ratio(self) -> float:
        """Innovations over what the schedule predicts, both rms over all rests; 1 where all is as told."""
        square, expected = (float(np.sum(np.square(part))) for part in (self.innovations, self.expected))
        return math.sqrt(square / expected) if expected > 0.0 else 1.0

    @property
    def alarms(self) -> tuple[str, ...]:
        """What is not as told, in words; none: ()."""
        said = []
        pairs = (
            ("gyro noise", self.found.arw_deg_per_sqrt_h, self.told.arw_deg_per_sqrt_h, "deg/sqrt(h)"),
            (
                "accelerometer noise",
                self.found.vrw_ug_per_sqrt_hz,
                self.told.vrw_ug_per_sqrt_hz,
                "ug/sqrt(Hz)",
            ),
        )
        for name, found, told, unit in pairs:
            if not 1.0 / FACTOR < found / told < FACTOR:
                said.append(f"The {name} of the rests is {found:.3g} {unit}, {told:.3g} was told.")
        if self.found.velocity_mps > FACTOR * self.told.velocity_mps:
            said.append(
                f"The table moves: its velocity jitters by {1e3 * self.found.velocity_mps:.2f} mm/s, "
                f"{1e3 * self.told.velocity_mps:.2f} was told."
            )
        if not 1.0 / FACTOR < self.innovation_ratio < FACTOR:
            rms, due = (
                float(np.sqrt(np.mean(np.square(part)))) for part in (self.innovations, self.expected)
            )
            said.append(
                f"Innovations have an rms of {rms:.2f} with the noise told; the schedule predicts {due:.2f} for "
                "such sensors on this table."
            )
        if self.disturbed:
            named = ", ".join(f"{number + 1} ({rms:.1f} times)" for number, rms in self.disturbed)
            said.append(f"Rests that something disturbed, by innovations beyond their scatter: {named}.")
        if self.wander is not None:
            said.append(
                f"The biases wander (log likelihood +{self.wander_gain / 2.0:.0f}): about "
                f"{self.wander.gyro_rad_s / DPH_RAD_S:.2g} deg/h and "
                f"{self.wander.accelerometer_mps2 / UG_MPS2:.2g} ug over {self.wander.time_s:.0f} s."
            )
        if abs(self.correlation) > _LAG_SIGMA:
            said.append(
                "Innovations are correlated from second to second: the table sways, or noise is not white. "
                f"Its velocity was taken as {1e3 * self.found.velocity_mps:.1f} mm/s of white noise."
            )
        return tuple(said)


def record_noise(
    data: Increments, task: Task, options: Options, found: Estimate, schedule: Schedule
) -> RecordNoise:
    """Return what a record of `schedule` shows of its noise, `found` from it with the noise of `task`.

    A wander that `options` bring is taken as it is. The likelihoods are of the noise of the rests.
    """
    current = np.concatenate([found.parameters, found.lever_m.ravel(), [found.lag_s]])
    clean = compensate(data, current)
    track = navigate(clean, align(clean, options.alignment_s), task.site)
    resting = rest_intervals(track, options)
    noise = rest_noise(clean, resting, task.noise)
    quiet = replace(task, noise=noise)
    white = filter_track(track, current, prior_sigma(quiet, options), quiet, options).innovations
    correlation = lag_correlation(np.array(white))
    if abs(correlation) > _LAG_SIGMA:
        noise = _velocity_as_seen(track, current, quiet, options)
        quiet = replace(task, noise=noise)

    def likelihood(wander: BiasWander | None) -> float:
        own = replace(options, wander=wander)
        return filter_track(track, current, prior_sigma(quiet, own), quiet, own).log_likelihood

    wander, gain = (None, 0.0) if options.wander is not None else best_wander(likelihood)
    own = replace(options, wander=options.wander or wander)
    seen = filter_track(track, current, prior_sigma(quiet, own), quiet, own).innovations
    told = filter_track(track, current, prior_sigma(task, options), task, options).innovations
    there = replace(task.noise, velocity_mps=noise.velocity_mps)
    return RecordNoise(
        task.noise,
        noise,
        wander,
        gain,
        correlation,
        innovations=tuple(float(np.sqrt(np.mean(rest**2))) for rest in by_rest(told, resting)),
        expected=tuple(expected_innovations(task, schedule, there).tolist()),
        wanders=weighted_wanders(likelihood, wander) if wander is not None else (),
        # of innovations that are correlated the scatter is not known, and another alarm says so
        disturbed=() if abs(correlation) > _LAG_SIGMA else tuple(disturbed_rests(by_rest(seen, resting))),
    )


def _velocity_as_seen(track: Track, current: Array, task: Task, options: Options) -> Noise:
    """Return the noise of a task with the table's velocity so large that innovations are as large as expected.

    A table that sways has no white velocity. White noise of the same size leaves sigmas a little too large, since
    sway averages out faster.
    """
    noise = task.noise
    for _ in range(_ROUNDS):
        own = replace(task, noise=noise)
        innovations = filter_track(track, current, prior_sigma(own, options), own, options).innovations
        rms = float(np.sqrt(np.mean(np.square(innovations))))
        noise = replace(noise, velocity_mps=noise.velocity_mps * max(rms, 1.0 / FACTOR))
    return noise


def rest_noise(data: Increments, resting: NDArray[np.bool_], told: Noise) -> Noise:
    """Return the noise of a record's rests, `resting` (m,) by seconds; the first and last second are left out.

    Jitter is at least a hundredth of what was told: a table has some, and the filter needs some.
    """
    samples = round(1.0 / data.period_s)
    _, velocity = data.sums(samples, len(resting))
    after, neighbour, count = 0.0, 0.0, 0
    for start, stop in stretches(resting):
        v = velocity[start + 1 : stop - 1]
        if len(v) < 10:
            continue
        step = np.diff(v, axis=0)
        after += float((step**2).sum())
        neighbour += float((step[1:] * step[:-1]).sum()) * (len(step) / (len(step) - 1))
        count += step.size
    # Differences of V + J: var = 2 V^2 + 6 J^2, cov at lag 1 = -V^2 - 4 J^2.
    variance, covariance = after / count, neighbour / count
    jitter2, told2 = -covariance - variance / 2.0, told.vrw**2
    white2 = variance / 2.0 - 3.0 * jitter2
    scatter = 3.0 * variance / math.sqrt(count)
    if scatter > _UNSEEN * max(told2, white2) or jitter2 < -_VIOLATED * scatter:
        # The table's jitter hides the accelerometers' noise, or is not white: what was told of them stands.
        white2, jitter2 = told2, (variance - 2.0 * told2) / 6.0
    return Noise(
        math.degrees(_gyro_noise(data, resting)) * 60.0,
        math.sqrt(max(white2, 0.01 * told2)) / UG_MPS2,
        max(math.sqrt(max(jitter2, 0.0)), 0.01 * told.velocity_mps),
    )


def _gyro_noise(data: Increments, resting: NDArray[np.bool_]) -> float:
    """Return the gyros' white noise in the rests, rad/sqrt(s)."""
    density2, neighbours, count = _differences(data, resting, 1)
    if abs(neighbours + 0.5) * math.sqrt(count) > _LAG_SIGMA:  # differences of white noise have -1/2
        finer = [parts for parts in _FINER if round(1.0 / data.period_s) >= _FEWEST * parts]
        density2 = min([density2, *(_differences(data, resting, parts)[0] for parts in finer)])
    return math.sqrt(density2)


def _differences(data: Increments, resting: NDArray[np.bool_], parts: int) -> tuple[float, float, int]:
    """Return the density by differences of means over so many parts of a second, rad^2/s, the correlation of
    neighbours among them, and how many there are.
    """
    samples = round(1.0 / data.period_s) // parts
    each_s = samples * data.period_s
    square, product, count = 0.0, 0.0, 0
    for start, stop in stretches(resting):
        first, last = (round(at / each_s) for at in (start + 1, stop - 1))
        angle = data.angle_rad[first * samples : last * samples]
        if stop - start < 12:
            continue
        step = np.diff(angle.reshape(-1, samples, 3).sum(axis=1), axis=0)
        square += float((step**2).sum())
        product += float((step[1:] * step[:-1]).sum())
        count += step.size
    # a record without noise, as an emulator writes it, has neighbours like white noise
    return square / count / 2.0 / each_s, product / square if square else -0.5, count


def best_wander(likelihood: Callable[[BiasWander | None], float]) -> tuple[BiasWander | None, float]:
    """Return the wander that makes a record likeliest and twice the gain over none; None if it gains little."""
    none = likelihood(None)
    tried: dict[tuple[float, ...], float] = {}

    def gain(at: tuple[float, ...]) -> float:
        at = tuple(round(value, 9) for value in np.clip(at, *_BOUNDS))
        if at not in tried:
            tried[at] = 2.0 * (likelihood(_wander(*at)) - none)
        return tried[at]

    best: tuple[float, ...] = max(_FIRST, key=gain)
    if gain(best) <= 0.0:
        return None, 0.0
    # A pattern search: a step in each direction from the best so far, shorter steps when none is better.
    for steps in _STEPS:
        better = True
        while better:
            better = False
            for index, step in enumerate(steps):
                for factor in (step, 1.0 / step):
                    at = tuple(value * factor if k == index else value for k, value in enumerate(best))
                    if gain(at) > gain(best) + _WORTH:
                        best, better = at, True
                        break
    best = max(tried, key=lambda at: tried[at])
    return (_wander(*best) if tried[best] > LIKELIHOOD else None), tried[best]


def weighted_wanders(
    likelihood: Callable[[BiasWander | None], float], best: BiasWander
) -> tuple[tuple[BiasWander, float], ...]:
    """Return wanders on a grid about the best and their weights by likelihood, flat in the logarithm of each
    size.

    Half an hour tells size and time of a wander to a factor, and they trade: what follows from a wander is to be
    averaged over these.
    """
    at = (best.gyro_rad_s / DPH_RAD_S, best.accelerometer_mps2 / UG_MPS2, best.time_s)
    grid = {
        tuple(np.clip([value * factor for value, factor in zip(at, factors, strict=True)], *_BOUNDS).tolist())
        for factors in itertools.product(_SIZES, _SIZES, _TIMES)
    }
    made = [_wander(*values) for values in sorted(grid)]
    found = np.array([likelihood(wander) for wander in made])
    weights = np.exp(found - found.max())
    weights /= weights.sum()
    return tuple(
        (wander, weight) for wander, weight in zip(made, weights.tolist(), strict=True) if weight > 1e-4
    )


def lag_correlation(innovations: Array) -> float:
    """Return the correlation of neighbours among whitened innovations (k, 3), over what sigma it should have."""
    white = np.asarray(innovations)
    neighbours = float((white[1:] * white[:-1]).sum() / (white**2).sum())
    return neighbours * math.sqrt(white.size)


def _wander(gyro_dph: float, accelerometer_ug: float, time_s: float) -> BiasWander:
    return BiasWander(gyro_dph * DPH_RAD_S, accelerometer_ug * UG_MPS2, time_s)
