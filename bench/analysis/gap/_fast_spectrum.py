"""The spectrum of a run's rows in one phase."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.base.arrays import Array


@dataclass(frozen=True, eq=False)
class FastSpectrum:
    """Power density of a run's rows in one phase, one-sided, (deg/h)^2/Hz, (m,) over `frequency_hz` (m,).

    `averages`: segments, half over each other; `knocked`: how many more were left out, many times as strong as
    these. `turns_hz`: how often the table turns in it, the mean.
    """

    phase: str
    start_s: float
    row_s: float
    frequency_hz: Array
    density: Array
    averages: int
    turns_hz: float
    knocked: int = 0
