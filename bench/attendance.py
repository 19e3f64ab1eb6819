"""Which units still speak: one that falls silent or goes away is named and the run goes on with the others."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from drivers.errors import BenchError, DeviceSilent

if TYPE_CHECKING:
    from bench.stations import StreamStation

SILENT_S = 10.0
"""A unit that has sent nothing for so long is reported, and the run is invalid."""

ALL_SILENT_S = 60.0
"""With no unit left that has sent anything for so long the run ends: there is nothing to record."""


class Attendance:
    """Watches the streams of a run. `report(unit, text)` gets what happens; `invalidate(reason)` what it means.

    A run in which one unit of several is lost goes on to its end: the data of the others are whole, and the run
    is invalid with the unit and the time in its reason. When the last one is lost it ends at once.
    """

    def __init__(self, report: Callable[[str, str], None], invalidate: Callable[[str], None]) -> None:
        self._report, self._invalidate = report, invalidate

    def lose(self, station: StreamStation, units: Iterable[StreamStation], error: BenchError) -> None:
        """Take note that a unit's port went away; raises `error` if no other unit is left."""
        station.gone = True
        self._report(station.name, f"lost: {error}")
        if all(unit.gone for unit in units):
            raise error
        self._invalidate(f"{station.name} was lost and its record ends there: {error}")

    def check(self, units: Iterable[StreamStation], now_s: float) -> None:
        """Report units that fell silent or speak again; DeviceSilent once none has spoken for `ALL_SILENT_S`."""
        units = list(units)
        for unit in units:
            quiet_s = now_s - unit.heard_s
            if unit.gone:
                continue
            if quiet_s >= SILENT_S and not unit.silent:
                unit.silent = True
                self._report(unit.name, f"silent: nothing has come since {unit.heard_s:.1f} s")
                self._invalidate(f"{unit.name} fell silent at {unit.heard_s:.1f} s")
            elif quiet_s < SILENT_S and unit.silent:
                unit.silent = False
                self._report(unit.name, f"speaks again at {unit.heard_s:.1f} s")
        if units and all(unit.gone or now_s - unit.heard_s >= ALL_SILENT_S for unit in units):
            raise DeviceSilent(
                "no unit has sent anything any more",
                where=", ".join(unit.name for unit in units),
                found=f"nothing for {ALL_SILENT_S:g} s",
                expected="a stream of frames from one unit at least",
                remedy="check power and cables of the units, then start again",
            )
