"""Gram matrices: the plain product, and torch equal to numpy."""

import numpy as np

from bench.analysis.gap._grams import gram_blocks, with_torch


def test_each_runs_matrix_is_the_product_of_its_rows_in_numpy_and_in_torch():
    """The path of a CUDA device, here on torch's processor; `make bench-gpu` compares a device itself."""
    rows = np.random.default_rng(3).normal(size=(3, 6, 500)) * 10.0 ** np.arange(-3.0, 3.0)[:, None]
    for made in (gram_blocks(rows, "cpu"), with_torch(rows, "cpu"), gram_blocks(rows)):
        assert len(made) == 3
        for run, gram in enumerate(made):
            expected = np.array([[np.sum(rows[run, i] * rows[run, j]) for j in range(6)] for i in range(6)])
            np.testing.assert_allclose(gram, expected, rtol=1e-12, atol=1e-12 * expected.max())
