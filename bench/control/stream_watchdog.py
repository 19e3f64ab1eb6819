"""Watches the streams: a unit that falls silent or goes away is reported and the run goes on with the others.

`Reconnect` opens a port that went away again: the unit's record goes on behind a marked gap.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING

from bench.record.events.run import Alarm, Invalid
from drivers.base.clock import Clock
from drivers.base.errors import BenchError, DeviceSilent, LinkLost
from drivers.kit.instruments import Gyro

if TYPE_CHECKING:
    from bench.control.stream_stations import GyroStation, StreamStation

SILENT_S = 10.0
"""A unit that has sent nothing for so long beyond its own interval is reported, and the run is invalid."""

_WAKES_S = 3.0
"""A unit whose port is back and that has sent nothing for so long is told to stream: it was without power."""


class StreamWatchdog:
    """Watches for silent and lost units; `report` gets what happens, `invalidate` what it means for the run.

    A run in which a unit is lost goes on, with the data of the others whole and with its own once its port is
    back, and is invalid with the unit and the time in its reason. When no unit of the role that the procedure
    `tests` has sent anything for `last_unit_s` the run ends, whatever else still streams: at once with 0, if its
    port is gone; silence is none before `SILENT_S`.
    """

    def __init__(
        self,
        tests: str,
        report: Callable[[Alarm], None],
        invalidate: Callable[[Invalid], None],
        last_unit_s: float = 60.0,
    ) -> None:
        self._tests, self._last_unit_s = tests, last_unit_s
        self._report, self._invalidate = report, invalidate
        self._lost: list[str] = []
        self._reported: set[str] = set()
        """Units that are away, and the run invalid for it."""
        self._were_silent: set[str] = set()
        """Units that fell silent before: the reason has the first time, the events have all."""
        self._judge: GyroStation | None = None
        self._excused_s = float("-inf")
        self.units_off = False
        """Whether units are switched off and on: silence is intended meanwhile."""

    def lose(self, station: StreamStation, now_s: float, error: BenchError) -> None:
        """Take note that a unit's port went away: by intention while silence is excused."""
        station.gone = True
        self._report(Alarm(station.name, f"lost: {error}", "unit_lost"))
        found = f": {error.found}" if error.found else ""
        self._lost.append(f"{station.name} was lost at {now_s:.1f} s ({error.what}{found})")
        if now_s >= self._excused_s and not self.units_off:
            self._reported.add(station.name)
            self._invalidate(Invalid("unit_lost", self._lost[-1], {"device": station.name, "at_s": now_s}))

    def back(self, station: StreamStation, now_s: float) -> None:
        """Take note that its port is open again."""
        station.gone = False
        self._reported.discard(station.name)
        gap_s = now_s - station.heard_s
        text = f"back: its port is open again, {gap_s:.1f} s after the last it sent"
        self._report(Alarm(station.name, text, "unit_back", {"gap_s": gap_s}))

    def excuse_until(self, until_s: float) -> None:
        """Take silence up to `until_s` for intended: units are being mounted."""
        self._excused_s = max(self._excused_s, until_s)

    def check(self, units: Iterable[StreamStation], now_s: float) -> None:
        """Report units that fell silent or speak again; DeviceSilent once none of those that the procedure tests
        has spoken for `last_unit_s`.
        """
        units = list(units)
        for unit in units:
            if unit.name in self._reported:
                continue
            quiet_s = self._quiet_s(unit, now_s)
            if quiet_s >= SILENT_S and not unit.silent:
                unit.silent = True
                text = f"silent: nothing has come since {unit.heard_s:.1f} s"
                self._report(Alarm(unit.name, text, "unit_silent", {"since_s": unit.heard_s}))
                if unit.name not in self._were_silent:
                    self._were_silent.add(unit.name)
                    text = f"{unit.name} fell silent at {unit.heard_s:.1f} s"
                    facts = {"device": unit.name, "at_s": unit.heard_s}
                    self._invalidate(Invalid("unit_silent", text, facts))
            elif quiet_s < SILENT_S and unit.silent:
                unit.silent = False
                text = f"speaks again at {unit.heard_s:.1f} s"
                self._report(Alarm(unit.name, text, "unit_speaks", {"at_s": unit.heard_s}))
        self.require_one(units, now_s)

    def require_one(self, units: Iterable[StreamStation], now_s: float) -> None:
        """Raise LinkLost or DeviceSilent once none that the procedure tests has spoken for `last_unit_s`."""
        needed = [unit for unit in units if unit.role == self._tests]
        if not needed or not all(self._overdue(unit, now_s) for unit in needed):
            return
        if all(unit.gone for unit in needed):
            raise LinkLost(
                f"no {self._tests} is left to test",
                found="; ".join(self._lost),
                expected=f"one {self._tests} whose port is open, or is back within {self._last_unit_s:g} s",
                remedy="check cables, adapters and power of the units, then start the run again",
            )
        raise DeviceSilent(
            f"no {self._tests} has sent anything any more",
            where=", ".join(unit.name for unit in needed),
            found="; ".join([f"nothing for {max(self._last_unit_s, SILENT_S):g} s", *self._lost]),
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
            before, self._judge = self._judge.name, speaking[0]
            text = f"is judged by from here on, in place of {before}"
            self._report(Alarm(self._judge.name, text, "judge_changed", {"before": before}))
        return self._judge

    def _overdue(self, unit: StreamStation, now_s: float) -> bool:
        if self.units_off or now_s < self._excused_s:
            return False
        least_s = self._last_unit_s if unit.gone else max(self._last_unit_s, SILENT_S)
        return max(self._quiet_s(unit, now_s), 0.0) >= least_s

    def _quiet_s(self, unit: StreamStation, now_s: float) -> float:
        """Return for how long a unit has sent nothing although it was due to."""
        return 0.0 if self.units_off else now_s - unit.interval_s - max(unit.heard_s, self._excused_s)


class Reconnect:
    """Opens lost ports of streaming units again. `lose` is called when one goes away, `back` when it is open."""

    def __init__(
        self,
        clock: Clock,
        lose: Callable[[StreamStation, BenchError], None],
        back: Callable[[StreamStation], None],
        note: Callable[[str], None],
    ) -> None:
        self._clock = clock
        self._lose, self._back, self._note = lose, back, note
        self._away: dict[str, tuple[Gyro, StreamStation]] = {}
        self._waking: dict[str, tuple[Gyro, StreamStation, int, float]] = {}

    def watch(self, device: Gyro, station: StreamStation) -> None:
        """Take bytes of a unit that streams whether or not anybody waits for them, and note when it goes away."""
        self._clock.stream(device.link, partial(self._lost, device, station))

    def look(self) -> None:
        """Open what is there again; tell a unit that is back and says nothing to stream, once."""
        for name, (device, station) in list(self._away.items()):
            try:
                device.link.reopen()
            except BenchError:  # not yet
                continue
            del self._away[name]
            self.watch(device, station)
            self._back(station)
            station.update()
            self._waking[name] = (device, station, station.frames, self._clock.now() + _WAKES_S)
        for name, (device, station, frames, until_s) in list(self._waking.items()):
            station.update()
            if station.frames == frames and self._clock.now() < until_s:
                continue
            del self._waking[name]
            if station.frames == frames:
                self._start(device, station)

    def _start(self, device: Gyro, station: StreamStation) -> None:
        try:
            device.start()
        except BenchError as error:
            device.link.streaming = True
            self._note(f"{station.name} does not stream since its port is back: {error}")
        else:
            self._note(f"{station.name} was told to stream again")

    def _lost(self, device: Gyro, station: StreamStation, error: BenchError) -> None:
        self._waking.pop(station.name, None)
        self._away[station.name] = (device, station)
        self._lose(station, error)
