"""What a record shows of the output against the input rate: means over blocks at one rate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array


class SlowRates:
    """Means over blocks at one rate: input and output rate in deg/h, run number, each (m,)."""

    def __init__(self, rate: Array, output: Array, run: NDArray[np.int64]) -> None:
        self.rate, self.output, self.run = rate, output, run

    def apart(self, values: Array, use: NDArray[np.bool_]) -> Array:
        """Return values less the mean over their run of those in `use`; of a run without any they stay."""
        result = values.copy()
        for run in np.unique(self.run[use]):
            at = self.run == run
            result[at] -= values[at & use].mean()
        return result
