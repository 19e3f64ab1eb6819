"""First-order recursion over an array, in numpy alone (decision 0021: a lab starts without scipy)."""

from __future__ import annotations

import numpy as np

from drivers.base.arrays import Array

_BLOCK = 32


def follow(driven: Array, decay: float) -> Array:
    """Return x with x[k] = decay x[k-1] + driven[k] and x[-1] = 0, along the first axis; shaped like `driven`.

    Blocks of 32 are a matrix product each; only the last values of the blocks follow one another in a loop.
    """
    count = len(driven)
    blocks = -(-count // _BLOCK)
    padded = np.zeros((blocks * _BLOCK, *driven.shape[1:]))
    padded[:count] = driven
    padded = padded.reshape(blocks, _BLOCK, -1)
    powers = decay ** np.arange(_BLOCK + 1)
    lag = np.subtract.outer(np.arange(_BLOCK), np.arange(_BLOCK))
    within = np.where(lag >= 0, powers[np.abs(lag)], 0.0) @ padded
    carried = np.zeros(within.shape[2])
    entries = np.empty((blocks, within.shape[2]))
    for block in range(blocks):
        entries[block] = carried
        carried = within[block, -1] + powers[_BLOCK] * carried
    within += powers[1:, None] * entries[:, None, :]
    return within.reshape(blocks * _BLOCK, *driven.shape[1:])[:count]
