"""What hangs on a supply's output: the units that it feeds draw power, from a voltage on that they work at."""

from __future__ import annotations

from collections.abc import Callable, Sequence

_WORKS_V = 4.5
"""Below this an emulated unit is off."""
_TURN_ON = 0.1
"""Share of its power that a unit's input draws while it does not work."""


class Load:
    """The units on one output.

    `units`: name and power in W of each; `switch(unit, on, time_s)` gives them power or takes it.
    """

    def __init__(
        self, units: Sequence[tuple[str, float]], switch: Callable[[str, bool, float], None]
    ) -> None:
        self._units = list(units)
        self._switch = switch
        self._on = False

    def supply(self, now_s: float, voltage_v: float, limit_a: float, on: bool) -> None:
        """Put a voltage with a current limit on the units, or nothing."""
        works = on and voltage_v >= _WORKS_V and self._power_w / voltage_v <= limit_a
        if works is not self._on:
            self._on = works
            for name, _ in self._units:
                self._switch(name, works, now_s)

    def drawn(self, voltage_v: float, limit_a: float, on: bool) -> tuple[float, float]:
        """Return voltage in V and current in A at the output: at its limit if the units want more."""
        if not on or voltage_v <= 0.0:
            return 0.0, 0.0
        wanted_a = self._power_w / max(voltage_v, _WORKS_V)
        if voltage_v >= _WORKS_V and wanted_a <= limit_a:
            return voltage_v, wanted_a
        if wanted_a > limit_a:
            return voltage_v * limit_a / wanted_a, limit_a
        return voltage_v, _TURN_ON * wanted_a

    @property
    def _power_w(self) -> float:
        return sum(power_w for _, power_w in self._units)
