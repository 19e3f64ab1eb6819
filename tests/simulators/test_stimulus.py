"""What follows from a table's angle: means over samples against integrals of another making."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from simulators.effects import Stimulus


@pytest.mark.parametrize("order", [1, 2, 5])
def test_waves_of_a_table_that_speeds_up_are_integrals_over_its_angle(order: int) -> None:
    """From 10 by 30 deg/s^2 for 4 s, then even: an angle of second order in each sample."""

    def angle_deg(t: float) -> float:
        since = min(t, 4.0)
        return 20.0 + 10.0 * since + 15.0 * since**2 + 130.0 * (t - since)

    edges = np.arange(9.0)
    at = np.full(8, 25.0)
    angle = np.array([angle_deg(t) for t in edges])
    rates = np.minimum(10.0 + 30.0 * edges, 130.0)
    s = Stimulus(edges[1:], at, at, angle, np.zeros(8), 48.0, 1.0, rates)
    expected = [
        [quad(lambda t, wave=wave: wave(np.radians(order * angle_deg(t))), k, k + 1.0)[0] for k in range(8)]
        for wave in (np.cos, np.sin)
    ]
    assert s.harmonic(order) == pytest.approx(np.array(expected), abs=2e-4)
    even = Stimulus(edges[1:], at, at, angle, np.zeros(8), 48.0)
    assert np.abs(even.harmonic(order) - expected)[:, :4].max() > 0.02  # a mean rate in each sample
    assert even.harmonic(order)[:, 5:] == pytest.approx(np.array(expected)[:, 5:], abs=1e-9)


def test_many_waves_in_a_sample_are_those_of_its_mean_rate() -> None:
    """Order 24 at 60 deg/s: four waves in a sample of 1 s, and edge rates that are read with some noise."""
    rng, edges = np.random.default_rng(1), np.arange(101.0)
    at, angle = np.full(100, 25.0), 3.0 + 61.0 * edges
    noisy = Stimulus(edges[1:], at, at, angle, np.zeros(100), 48.0, 1.0, 61.0 + rng.normal(0.0, 1e-3, 101))
    even = Stimulus(edges[1:], at, at, angle, np.zeros(100), 48.0)
    assert noisy.harmonic(24) == pytest.approx(even.harmonic(24), abs=1e-3)
