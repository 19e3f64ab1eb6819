"""The channels of a run folder: tables of the stations, and demands from its events."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._channel_source import ChannelSource, Conditioning, TableRows, Trace
from bench.control.run_record import gyro_source
from bench.record.benchfile import bench_file_from
from bench.record.events import Event
from bench.record.events.run import AirDemand, AngleDemand, ConditioningDemand, HomeDemand, RateDemand
from bench.record.events.safe import SafeState
from bench.record.recording import Arrivals, Run, seconds
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError, RecordError
from simulators.effects import Demand


class RunSource(ChannelSource):
    """A run folder of this project; `gyro` is the name of the unit under test, empty for none."""

    def __init__(self, run: Run, gyro: str) -> None:
        self._run, self._gyro = run, gyro

    @property
    def run_id(self) -> str:
        """The run's id."""
        return self._run.manifest.run_id

    @property
    def unit_id(self) -> str:
        """The unit's id, empty for none."""
        return self._run.manifest.unit(self._gyro) if self._gyro in self._run.manifest.units else ""

    @property
    def checksum(self) -> str:
        """The run's checksum."""
        return self._run.checksum

    def phase_at(self, time_s: Array) -> NDArray[np.str_]:
        """Return the names of the run's phases."""
        return self._run.phase_at(time_s)

    def conditioning(self) -> Conditioning | str:
        """Return the air from when the chamber was switched on until it was switched off."""
        if "chamber" not in self._run.tables:
            return "the run has no chamber"
        demands, running_s = self._told_air
        if not demands or running_s is None:
            return "the chamber was not started in this run"
        table = self._run.chamber(("time_ns", "air_temp_c"), *running_s)
        return Conditioning(Trace(seconds(table), table["air_temp_c"].astype(np.float64)), demands)

    def air_demands(self) -> tuple[Demand, ...]:
        """Return the demands in force while the chamber ran."""
        return self._told_air[0]

    def air(self) -> Trace | str:
        """Return the chamber's air over the whole run."""
        table = self._run.chamber() if "chamber" in self._run.tables else {}
        if "air_temp_c" not in table:
            return "no record of the air that the case could follow"
        return Trace(seconds(table), table["air_temp_c"].astype(np.float64))

    def case(self) -> Trace | str:
        """Return what the sensor on the unit's case read."""
        sensor = self._run.manifest.device(self._gyro).case_sensor if self._gyro else None
        if sensor is None or "chamber" not in self._run.tables:
            return "no sensor on the unit's case (case_sensor in the bench file)"
        try:
            return Trace(*self._run.sensor(sensor))
        except RecordError:
            return f"no record of the sensor on the unit's case (case_sensor {sensor})"

    def inside(self) -> Trace | str:
        """Return what the gyro's own sensor read."""
        table = self._run.gyro(self._gyro, ("time_ns", "temp_c"))
        known = ~np.isnan(table["temp_c"])
        if not known.any():
            return "the gyro says no temperature"
        return Trace(seconds(table)[known], table["temp_c"][known].astype(np.float64))

    def heat_w(self) -> Trace | None:
        """Return None: no device of the bench heats the unit."""
        return None

    def door(self) -> Trace | None:
        """Return None: no device of the bench opens a door."""
        return None

    def has_table(self) -> bool:
        """Whether the run has a table."""
        return "turntable" in self._run.tables

    def table(self, start_s: float = 0.0, end_s: float | None = None) -> TableRows:
        """Return the table's telemetry."""
        table = self._run.turntable(("time_ns", "angle_deg", "rate_dps"), start_s, end_s)
        return TableRows(
            seconds(table), table["angle_deg"].astype(np.float64), table["rate_dps"].astype(np.float64)
        )

    def table_demands(self) -> Iterator[tuple[float, float, Event]]:
        """Yield (from, until, demand); it ends when that axis is told another.

        Making the table safe ends every demand.
        """
        carrier = bench_file_from(self._run.manifest.bench).table.all_axes[-1].name
        told: list[tuple[float, Event]] = [
            (time_s, event)
            for time_s, event in self._run.lines
            if (isinstance(event, AngleDemand | RateDemand | HomeDemand) and event.axis == carrier)
            or (isinstance(event, SafeState) and event.device == "table")
        ]
        ends_s = [*(at for at, _ in told[1:]), self._end_s]
        for (start_s, event), end_s in zip(told, ends_s, strict=True):
            yield start_s, end_s, event

    def arrivals(self) -> Arrivals | str:
        """Return the arrival marks of the stream, decoded again."""
        if self._gyro not in self._run.manifest.stream or not self._run.has_arrivals(self._gyro):
            return "no arrival times of the gyro's stream"
        try:
            source = gyro_source(self._run.manifest, self._gyro)
        except ConfigurationError as error:
            return f"the stream cannot be decoded again: {error}"
        return self._run.arrivals(source)

    @cached_property
    def _told_air(self) -> tuple[tuple[Demand, ...], tuple[float, float] | None]:
        """Return the demands in force while the chamber ran, and from when to when it did."""
        target: tuple[float, float] | None = None
        demands: list[Demand] = []
        start_s: float | None = None
        end_s = self._end_s
        for time_s, event in self._run.lines:
            if isinstance(event, AirDemand):
                ramp = event.ramp_k_per_min
                target = event.set_point_c, np.inf if ramp is None else ramp / 60.0
                if start_s is not None:
                    demands.append(Demand(time_s, *target))
            elif isinstance(event, ConditioningDemand):
                if not event.on and start_s is not None:
                    end_s = min(end_s, time_s)
                    break
                if event.on and start_s is None:
                    start_s = time_s
                    demands += [] if target is None else [Demand(time_s, *target)]
        return tuple(demands), None if start_s is None else (start_s, end_s)

    @property
    def _end_s(self) -> float:
        return max(line.time_s for line in self._run.lines)
