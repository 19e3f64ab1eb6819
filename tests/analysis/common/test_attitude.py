"""Rotations of many samples against scipy's, multiplied one by one."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bench.analysis.common.attitude import rotations, running_rotation, whole_rotation


@settings(max_examples=60, deadline=None)
@given(
    st.integers(1, 130),
    st.sampled_from([1e-9, 1e-3, 0.5, 3.0]),
    st.integers(0, 2**32 - 1),
)
def test_products_of_rotations_are_scipys(count: int, size_rad: float, seed: int) -> None:
    vectors = size_rad * np.random.default_rng(seed).standard_normal((2, count, 3))
    for own in vectors:
        running = [Rotation.identity()]
        for step in own:
            running.append(running[-1] * Rotation.from_rotvec(step))
        expected = np.array([each.as_matrix() for each in running])
        np.testing.assert_allclose(running_rotation(own), expected, atol=1e-11)
        np.testing.assert_allclose(whole_rotation(own), expected[-1], atol=1e-11)
        np.testing.assert_allclose(rotations(own), Rotation.from_rotvec(own).as_matrix(), atol=1e-12)
    together = whole_rotation(vectors)
    assert together.shape == (2, 3, 3)
    np.testing.assert_allclose(together, [whole_rotation(own) for own in vectors], atol=1e-14)
