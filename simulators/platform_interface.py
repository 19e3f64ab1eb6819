"""The seam between the emulated platform INS and its plant, as `simulators.interfaces` is for the other
devices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class PlatformSignal:
    """What the unit computed and measured at sample times, shape (n,) each; NaN temperature: sensor dead."""

    latitude_deg: NDArray[np.float64]
    longitude_deg: NDArray[np.float64]
    temp_c: NDArray[np.float64]
    cabinet_temp_c: NDArray[np.float64]


class PlatformPlant(Protocol):
    """One platform INS on the table. Times never decrease."""

    def measure(self, times_s: NDArray[np.float64]) -> PlatformSignal:
        """Return what it says at `times_s`, shape (n,)."""

    def align(self, now_s: float) -> None:
        """End the alignment."""
