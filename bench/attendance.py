"""Which units still speak: one that falls silent or goes away is named and the run goes on with the others."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from drivers.errors import BenchError, DeviceSilent, LinkLost

if TYPE_CHECKING:
    from bench.stations import GyroStation, StreamStation

SILENT_S = 10.0
"""A unit that has sent nothing for so long is reported, and the run is invalid."""

ALL_SILENT_S = 60.0
"""With no unit left that has sent anything for so long the run ends: there is nothing to record."""


class Attendance:
    """Watches the streams of a run. `report(unit, text)` gets what happens; `invalidate(reason)` what it means.

    A run in which one unit of several is lost goes on to its end: the data of the others are whole, and the run
    is invalid with the unit and the time in its reason. When the last unit of the role that the procedure `tests`
    is lost the run ends at once, whatever else still streams.
    """

    def __init__(
        self, tests: str, report: Callable[[str, str], None], invalidate: Callable[[str], None]
    ) -> None:
        self._tests = tests
        self._report, self._invalidate = report, invalidate
        self._lost: list[str] = []
        self._judge: GyroStation | None = None
        self._excused_s = float("-inf")
        self.units_off = False
        """Whether units are switched off and on: silence is intended meanwhile."""

    def lose(
        self, station: StreamStation, units: Iterable[StreamStation], now_s: float, error: BenchError
    ) -> None:
        """Take note that a unit's port went away; raises once no unit is left that the procedure tests."""
        station.gone = True
        self._report(station.name, f"lost: {error}")
        found = f": {error.found}" if error.found else ""
        self._lost.append(f"{station.name} was lost at {now_s:.1f} s ({error.what}{found})")
        if any(not unit.gone for unit in self._needed(units)):
            self._invalidate(f"{self._lost[-1]} and its record ends there")
            return
        raise LinkLost(
            f"no {self._tests} is left to test",
            found="; ".join(self._lost),
            expected=f"at least one {self._tests} whose port stays open",
            remedy="check cables, adapters and power of the units, then start the run again",
        ) from error

    def excuse_until(self, until_s: float) -> None:
        """Take silence up to `until_s` for intended: units are being mounted."""
        self._excused_s = max(self._excused_s, until_s)

    def check(self, units: Iterable[StreamStation], now_s: float) -> None:
        """Report units that fell silent or speak again; DeviceSilent once none of those that the procedure tests
        has spoken for `ALL_SILENT_S`.
        """
        units = list(units)
        for unit in units:
            if unit.gone:
                continue
            quiet_s = self._quiet_s(unit, now_s)
            if quiet_s >= SILENT_S and not unit.silent:
                unit.silent = True
                self._report(unit.name, f"silent: nothing has come since {unit.heard_s:.1f} s")
                self._invalidate(f"{unit.name} fell silent at {unit.heard_s:.1f} s")
            elif quiet_s < SILENT_S and unit.silent:
                unit.silent = False
                self._report(unit.name, f"speaks again at {unit.heard_s:.1f} s")
        needed = self._needed(units)
        if needed and all(unit.gone or self._quiet_s(unit, now_s) >= ALL_SILENT_S for unit in needed):
            raise DeviceSilent(
                f"no {self._tests} has sent anything any more",
                where=", ".join(unit.name for unit in needed),
                found="; ".join([f"nothing for {ALL_SILENT_S:g} s", *self._lost]),
                expected=f"a stream of frames from one {self._tests} at least",
                remedy="check power and cables of the units, then start the run again",
            )

    def judge(self, gyros: Iterable[GyroStation]) -> GyroStation:
        """Return the gyro that the procedure judges by: the first; in its place the next that still speaks."""
        known = list(gyros)
        here = [unit for unit in known if not unit.gone]
        speaking = [unit for unit in here if not unit.silent] or here or known
        if self._judge is None:
            self._judge = speaking[0]
        elif self._judge not in speaking:
            text = f"is judged by from here on, in place of {self._judge.name}"
            self._judge = speaking[0]
            self._report(self._judge.name, text)
        return self._judge

    def _needed(self, units: Iterable[StreamStation]) -> list[StreamStation]:
        return [unit for unit in units if unit.role == self._tests]

    def _quiet_s(self, unit: StreamStation, now_s: float) -> float:
        return 0.0 if self.units_off else now_s - max(unit.heard_s, self._excused_s)
