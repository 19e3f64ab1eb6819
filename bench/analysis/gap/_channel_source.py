"""What a recording can give of the channels beside the gyro's rate: a run folder of ours, or somebody's log."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.record.events import Event
from bench.record.recording import Arrivals
from drivers.base.arrays import Array
from simulators.effects import Demand


class Trace(NamedTuple):
    """A recorded signal: times in s and values, (n,) each, without NaN."""

    time_s: Array
    values: Array


class TableRows(NamedTuple):
    """What a table said: times in s, angles in deg in [0, 360), rates in deg/s, (n,) each."""

    time_s: Array
    angle_deg: Array
    rate_dps: Array


@dataclass(frozen=True)
class Conditioning:
    """A chamber while it ran: its air and the demands in force."""

    air: Trace
    demands: tuple[Demand, ...]


class ChannelSource(ABC):
    """One recording; what it does not have is answered by the reason, a clause that a sentence can end with.

    Times are s from the recording's begin.
    """

    @property
    @abstractmethod
    def run_id(self) -> str:
        """The recording's id."""

    @property
    @abstractmethod
    def unit_id(self) -> str:
        """What was under test, empty for nothing."""

    @property
    @abstractmethod
    def checksum(self) -> str:
        """SHA-256 of the run's manifest, or of the log."""

    @abstractmethod
    def phase_at(self, time_s: Array) -> NDArray[np.str_]:
        """Return the names of the phases at times, (n,)."""

    @abstractmethod
    def conditioning(self) -> Conditioning | str:
        """Return the chamber's air while it was to follow demands."""

    @abstractmethod
    def air_demands(self) -> tuple[Demand, ...]:
        """Return what was demanded of the air, empty where nobody knows of a demand."""

    @abstractmethod
    def air(self) -> Trace | str:
        """Return the temperature of the air about the unit, degC."""

    @abstractmethod
    def case(self) -> Trace | str:
        """Return the temperature of the unit's case, degC."""

    @abstractmethod
    def inside(self) -> Trace | str:
        """Return the temperature that the gyro says, degC."""

    @abstractmethod
    def heat_w(self) -> Trace | None:
        """Return the heat put into the case, W, each value until the next; None without a heater."""

    @abstractmethod
    def door(self) -> Trace | None:
        """Return how far a door or lid is open, 0 to 1, each value until the next; None without one."""

    @abstractmethod
    def has_table(self) -> bool:
        """Whether anything is known of a table."""

    @abstractmethod
    def table(self, start_s: float = 0.0, end_s: float | None = None) -> TableRows:
        """Return what the table said between two times, until the end without the latter."""

    @abstractmethod
    def table_demands(self) -> Iterator[tuple[float, float, Event]]:
        """Yield (from, until, demand) of the axis that carries the unit."""

    @abstractmethod
    def arrivals(self) -> Arrivals | str:
        """Return when the bytes of the gyro's stream came."""
