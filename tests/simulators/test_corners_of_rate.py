"""Rates at the edges of samples: where a table goes round a corner within them, against the motion itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.base.arrays import Array
from simulators.effects._sample_times import _edges, _transitions


def angle(times: Array, begins: float, lasts: float, low: float, high: float) -> Array:
    """The angle of a table that goes from one rate to another at constant acceleration; a sample is 1."""
    since = np.clip(times - begins, 0.0, lasts)
    return low * times + (high - low) * (
        since**2 / (2.0 * lasts) + np.clip(times - begins - lasts, 0.0, None)
    )


@given(
    begins=st.floats(10.0, 11.0),
    lasts=st.floats(0.05, 1.9),
    low=st.floats(-50.0, 50.0),
    change=st.floats(1.0, 100.0) | st.floats(-100.0, -1.0),
)
def test_a_change_within_three_samples_is_known_at_their_edges(
    begins: float, lasts: float, low: float, change: float
) -> None:
    edges = np.arange(31.0)
    rate = np.diff(angle(edges, begins, lasts, low, low + change))
    true = low + change * np.clip((edges - begins) / lasts, 0.0, 1.0)
    smooth, found = _edges(rate)[2], _edges(rate)[1:4]
    # below a two-hundredth of the change a part counts as steady: of t in a sample that is t^2 / 2, t at its edge
    assert np.abs(smooth - true).max() < (np.sqrt(2.0 * 0.005 / lasts) + 0.01) * abs(change)
    moved = np.abs(np.diff(rate))[np.abs(np.diff(rate)) > 1e-9 * abs(change)]
    if moved.min() > 0.006 * abs(change):
        assert np.abs(smooth - true).max() < 1e-6 * abs(change)
    if begins + lasts < 11.0:
        assert np.abs(found - true).max() < 0.02 * abs(change)


def test_what_is_no_such_change_is_left() -> None:
    rng = np.random.default_rng(4)
    sine = np.sin(0.3 * np.arange(200.0))
    ramp = np.concatenate((np.zeros(20), np.arange(20.0), np.full(20, 19.0)))
    jump = np.repeat((0.0, 5.0, -3.0), 20)
    bump = np.concatenate((np.zeros(20), [1.0, 2.0, 1.0], np.zeros(20)))
    for rate in (sine, ramp, jump, bump, rng.normal(size=100), np.zeros(50)):
        assert list(_transitions(rate)) == []


@pytest.mark.parametrize("noise", [1e-4, 1e-3])
def test_codes_of_an_angle_are_no_change(noise: float) -> None:
    edges = np.arange(31.0)
    rate = np.diff(angle(edges, 10.3, 0.4, -20.0, 20.0) + np.random.default_rng(1).normal(0.0, noise, 31))
    (found,) = _transitions(rate)
    assert found[0] == 10 and found[1] == pytest.approx([-20.0, 20.0], abs=0.01)
