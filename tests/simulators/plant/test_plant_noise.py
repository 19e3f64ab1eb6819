"""Noise statistics against the theory of IEEE Std 952: white noise, flicker floor, quantisation."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulators.plant.noise import (
    BLOCK,
    GyroNoise,
    NoiseParameters,
    NoiseSource,
    SampleNoise,
    TickNoise,
    flicker,
)


def block_means(values: np.ndarray, length: int) -> np.ndarray:
    whole = len(values) // length * length
    return np.asarray(values[:whole].reshape(-1, length).mean(axis=1))


def test_angle_random_walk_gives_6n_at_100_s_and_19n_at_10_s() -> None:
    n = 0.004
    noise = GyroNoise(NoiseSource(1, "gyro"), NoiseParameters(n, 0.0, 0.0))
    rate_dph = np.degrees(noise.increments_rad(0, 2_000_000, 1.0)) * 3600.0
    # std of m means is known to 1/sqrt(2 m): 0.5 % at 20,000 blocks
    assert block_means(rate_dph, 100).std() == pytest.approx(6.0 * n, rel=0.02)
    assert block_means(rate_dph, 10).std() == pytest.approx(18.97 * n, rel=0.02)


def test_sample_period_does_not_change_the_random_walk() -> None:
    noise = GyroNoise(NoiseSource(2, "gyro"), NoiseParameters(0.2, 0.0, 0.0))
    fast = np.degrees(noise.increments_rad(0, 1_000_000, 0.01)).reshape(-1, 100).sum(axis=1)
    assert fast.std() == pytest.approx(0.2 / 60.0, rel=0.03)


def test_flicker_floor_is_0_664_b() -> None:
    b = 0.006
    variances = []
    for seed in range(24):
        process = flicker(NoiseSource(seed, "gyro"), b)
        values = np.array([process.value(tick) for tick in range(60_000)])
        sums = np.concatenate(([0.0], np.cumsum(values)))
        row = []
        for m in (300, 500, 1000):
            second = sums[2 * m :] - 2.0 * sums[m:-m] + sums[: -2 * m]
            row.append(np.mean(second**2) / (2.0 * m * m))
        variances.append(row)
    adev = np.sqrt(np.mean(variances, axis=0))
    floor = b * math.sqrt(2.0 * math.log(2.0) / math.pi)
    np.testing.assert_allclose(adev, floor, rtol=0.05)


def test_quantisation_does_not_accumulate() -> None:
    quantum = 1.0
    noise = GyroNoise(NoiseSource(3, "gyro"), NoiseParameters(0.0, 0.0, quantum))
    angle = np.degrees(np.cumsum(noise.increments_rad(0, 200_000, 0.01))) * 3600.0
    assert np.ptp(angle) <= quantum
    increments = np.diff(angle)
    assert increments.std() == pytest.approx(quantum / math.sqrt(6.0), rel=0.02)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 3 * BLOCK), st.lists(st.integers(1, 2 * BLOCK), min_size=1, max_size=6))
def test_samples_do_not_depend_on_chunking(start: int, counts: list[int]) -> None:
    whole = SampleNoise(NoiseSource(7, "a"), "normal").values(start, sum(counts))
    source = SampleNoise(NoiseSource(7, "a"), "normal")
    at, parts = start, []
    for count in counts:
        parts.append(source.values(at, count))
        at += count
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_owners_streams_seeds_and_blocks_are_independent() -> None:
    sources = [NoiseSource(1, "a"), NoiseSource(2, "a"), NoiseSource(1, "b"), NoiseSource(1, "a", 1)]
    columns = [SampleNoise(source, "normal").values(0, BLOCK) for source in sources]
    columns.append(SampleNoise(sources[0], "normal").values(BLOCK, BLOCK))
    correlation = np.corrcoef(columns) - np.eye(len(columns))
    assert np.abs(correlation).max() < 5.0 / math.sqrt(BLOCK)


def test_markov_process_is_continuous_over_its_blocks() -> None:
    process = TickNoise(NoiseSource(0, "a"), (3000.0,), 1.0)
    values = np.array([process.value(tick) for tick in range(4 * BLOCK)])
    steps = np.diff(values)
    assert steps.std() == pytest.approx(math.sqrt(2.0 / 3000.0), rel=0.05)
    assert np.abs(steps[BLOCK - 1 :: BLOCK]).max() < 5.0 * math.sqrt(2.0 / 3000.0)
