"""The channels of a log of another bench: its columns, with the demands that stand in them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._channel_source import ChannelSource, Conditioning, TableRows, Trace
from bench.analysis.gap._mapped import MappedLog
from bench.record.events import Event
from bench.record.events.run import AngleDemand, RateDemand
from bench.record.recording import Arrivals, names_at, row_means
from drivers.base.arrays import Array
from simulators.effects import Demand

_FINEST_S = 1.0
"""Step to which a table's rows are gathered where they come faster."""
_RAMP, _EVEN = 4, 1.5
"""Changes of a set point that make a ramp, and how many times larger or further apart one of them may be."""


class LogSource(ChannelSource):
    """A log, of a mapping file or kept by an imported run. Times count from its first row."""

    def __init__(self, made: MappedLog) -> None:
        self._made = made
        self._time_s = made.log.time_s - made.log.time_s[0]

    @property
    def run_id(self) -> str:
        """The log's id."""
        return self._made.run_id

    @property
    def unit_id(self) -> str:
        """The unit that the mapping names."""
        return self._made.mapping.unit_id

    @property
    def checksum(self) -> str:
        """The log's SHA-256."""
        return self._made.checksum

    def phase_at(self, time_s: Array) -> NDArray[np.str_]:
        """Return the names of the mapping's phases."""
        phases = sorted(self._made.entry.phases, key=lambda phase: phase.start_s)
        starts, names = [phase.start_s for phase in phases], [phase.name for phase in phases]
        return names_at(starts or [0.0], names or ["run"], time_s)

    def conditioning(self) -> Conditioning | str:
        """Return the air from the first set point on."""
        air, demands = self._trace("air"), self.air_demands()
        if air is None:
            return "no column air"
        if not demands:
            return "no column set_point that the air could follow"
        told = air.time_s >= demands[0].time_s
        return Conditioning(Trace(air.time_s[told], air.values[told]), demands)

    def air_demands(self) -> tuple[Demand, ...]:
        """Return the set point's steps and ramps."""
        told = self._trace("set_point")
        return () if told is None else demands_of(told)

    def air(self) -> Trace | str:
        """Return the column air, or the mapping's air_temp_c."""
        air = self._trace("air")
        constant_c = self._made.entry.air_temp_c
        if air is None and constant_c is not None:
            return Trace(self._time_s, np.full(len(self._time_s), constant_c))
        return "no column air that the case could follow, and no air_temp_c" if air is None else air

    def case(self) -> Trace | str:
        """Return the column t_out; t_in where that is the one temperature, for it is then the case's, too."""
        case = self._trace("t_out") or self._trace("t_in")
        return "no column t_out" if case is None else case

    def inside(self) -> Trace | str:
        """Return the column t_in, where there is another of the case."""
        inside = self._trace("t_in")
        if inside is None:
            return "no column t_in"
        return inside if self._trace("t_out") else "one temperature only, which stands for the case's"

    def heat_w(self) -> Trace | None:
        """Return the column heater."""
        return self._trace("heater")

    def door(self) -> Trace | None:
        """Return the column door."""
        return self._trace("door")

    def has_table(self) -> bool:
        """Whether a column or the mapping says what the table did."""
        return self._table is not None

    def table(self, start_s: float = 0.0, end_s: float | None = None) -> TableRows:
        """Return the table's angle and rate at rows, at most one a second."""
        if self._table is None:
            return TableRows(*np.zeros((3, 0)))
        own = (self._table.time_s >= start_s) & (self._table.time_s < (math.inf if end_s is None else end_s))
        return TableRows(*(column[own] for column in self._table))

    def table_demands(self) -> Iterator[tuple[float, float, Event]]:
        """Yield (from, until, demand): a demand ends when either of angle and rate is told anew."""
        kinds: dict[str, Callable[[float], Event]] = {
            "rate_demand": lambda value: RateDemand("table", "table", value),
            "angle_demand": lambda value: AngleDemand("table", "table", value),
        }
        told: list[tuple[float, Event]] = []
        for name, demand in kinds.items():
            trace = self._trace(name)
            if trace is not None:
                at = np.flatnonzero(np.diff(trace.values, prepend=np.nan) != 0.0)
                told += [(float(trace.time_s[k]), demand(float(trace.values[k]))) for k in at]
        told.sort(key=lambda row: row[0])
        ends_s = [*(at for at, _ in told[1:]), float(self._time_s[-1])]
        for (start_s, event), end_s in zip(told, ends_s[: len(told)], strict=True):
            yield start_s, end_s, event

    def arrivals(self) -> Arrivals | str:
        """Return why a log has none."""
        return "a log of another bench has no arrival times of bytes"

    def _trace(self, name: str) -> Trace | None:
        """Return a column without its missing values, None where the log has none or no value."""
        values = self._made.log.columns.get(name)
        if values is None:
            return None
        known = np.isfinite(values)
        return Trace(self._time_s[known], values[known]) if known.any() else None

    @cached_property
    def _table(self) -> TableRows | None:
        angle, rate = self._trace("angle"), self._trace("table_rate")
        if angle is None:
            turned = self._made.entry.table_angle_deg(self._time_s)
            angle = None if turned is None else Trace(self._time_s, turned)
        if angle is None and rate is None:
            return None
        step_s = max(float(np.median(np.diff(self._time_s))), _FINEST_S)
        # a row belongs to the step about it
        row = np.floor(self._time_s / step_s + 0.5).astype(np.int64)
        time_s = step_s * np.arange(int(row[-1]) + 1.0)

        def gathered(trace: Trace) -> Array:
            means = row_means(np.interp(self._time_s, *trace), row, len(time_s))
            known = ~np.isnan(means)
            return np.interp(time_s, time_s[known], means[known])

        if angle is None and rate is not None:
            spun = gathered(rate)
            return TableRows(time_s, np.mod(np.cumsum(spun) * step_s, 360.0), spun)
        assert angle is not None
        turned = gathered(angle)
        spun = np.gradient(turned, time_s) if rate is None else gathered(rate)
        return TableRows(time_s, np.mod(turned, 360.0), spun)


def demands_of(told: Trace) -> tuple[Demand, ...]:
    """Return a set point's course as demands: what it holds, where it steps, where it ramps at a rate.

    Changes of one direction and size that follow each other evenly are a ramp.
    """
    time_s, values = told
    row_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    at = np.flatnonzero(np.diff(values)) + 1
    sizes, apart_s = values[at] - values[at - 1], np.diff(time_s[at])
    demands = [Demand(float(time_s[0]), float(values[0]), math.inf)]
    first = 0
    while first < len(at):
        last = _last_of_ramp(sizes, apart_s, row_s, first)
        begin_s, end_s = float(time_s[at[first]]), float(time_s[at[last]])
        if last - first + 1 < _RAMP:
            last, ramp = first, math.inf
        else:
            ramp = abs(float(values[at[last]] - values[at[first]])) / (end_s - begin_s)
            each_s = (end_s - begin_s) / (last - first)
            # a course with fewer changes than rows is a rounded one: it changes half a digit late
            begin_s -= each_s if each_s < _EVEN * row_s else 0.5 * each_s
        demands.append(Demand(begin_s, float(values[at[last]]), ramp))
        first = last + 1
    return tuple(demands)


def _last_of_ramp(sizes: Array, apart_s: Array, row_s: float, first: int) -> int:
    """Return the last of the changes (n,), `apart_s` (n - 1,), that go on evenly from one on."""
    last = first
    while last + 1 < len(sizes):
        usual, usual_s = abs(sizes[min(first + 1, last + 1)]), apart_s[first]
        if (
            sizes[last + 1] * sizes[first] < 0.0
            or not max(abs(sizes[first]), abs(sizes[last + 1])) <= _EVEN * usual + 1e-9
            or apart_s[last] > _EVEN * usual_s + row_s
        ):
            break
        last += 1
    return last
