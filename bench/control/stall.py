"""Detects a chamber whose air no longer approaches its set point, without an alarm of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass

WINDOW_S = 900.0
FAR_K = 2.0
_SLOWEST_K_PER_MIN = 1.0
"""What any chamber manages of a step or a fast ramp."""
_SHARE = 0.1


@dataclass(frozen=True)
class Stall:
    """Air that stands away from its set point and came nearer by `nearer_k` only in `window_s`."""

    air_temp_c: float
    set_point_c: float
    nearer_k: float
    window_s: float

    def __str__(self) -> str:
        off_k = abs(self.air_temp_c - self.set_point_c)
        return (
            f"the air stands at {self.air_temp_c:.1f} degC, {off_k:.1f} K from its set point "
            f"{self.set_point_c:g} degC, and came {self.nearer_k:.1f} K nearer in "
            f"{self.window_s / 60.0:.0f} min: look at the chamber's panel, door and refrigeration"
        )


class StallDetector:
    """Watches one demand after the other; says once a demand that the air stands away from it.

    It stands when it is more than `FAR_K` off and came nearer in `WINDOW_S` by less than a tenth of what the ramp
    makes of that time, or of 1 K/min where the ramp is faster or there is none.
    """

    def __init__(self) -> None:
        self._since_s = math.inf
        self._set_point_c, self._ramp_k_per_min = math.nan, math.inf
        self._running = False

    def demand(self, time_s: float, set_point_c: float, ramp_k_per_min: float | None) -> None:
        """Take a new set point."""
        self._set_point_c = set_point_c
        self._ramp_k_per_min = ramp_k_per_min or math.inf
        self._since_s = time_s

    def run(self, time_s: float, running: bool) -> None:
        """Take that conditioning was started or stopped."""
        self._running, self._since_s = running, time_s

    def due(self, time_s: float) -> bool:
        """Return whether there is anything to judge yet."""
        return self._running and time_s - self._since_s >= WINDOW_S and math.isfinite(self._set_point_c)

    def look(self, air_c: float, before_c: float) -> Stall | None:
        """Judge the air now and `WINDOW_S` before; None if it comes nearer or is there."""
        off_k = abs(air_c - self._set_point_c)
        nearer_k = abs(before_c - self._set_point_c) - off_k
        wanted_k = min(self._ramp_k_per_min, _SLOWEST_K_PER_MIN) * WINDOW_S / 60.0
        if off_k <= FAR_K or nearer_k >= _SHARE * wanted_k:
            return None
        self._since_s = math.inf
        return Stall(air_c, self._set_point_c, max(nearer_k, 0.0), WINDOW_S)
