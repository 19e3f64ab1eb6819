"""When faults strike: listed instants, or a Poisson process of each fault's own generator."""

from __future__ import annotations

import math

from simulators.faults import Fault
from simulators.plant.noise import NoiseSource


class Schedule:
    """The instants of one fault in lab time, in order; independent of the bytes and of other faults."""

    def __init__(self, fault: Fault, source: NoiseSource) -> None:
        self._fault = fault
        self._listed = sorted(fault.at_s)
        self._generator = source.generator(0)
        self._next_s = fault.start_s
        self._step()

    @property
    def next_s(self) -> float:
        """The next instant, inf if there is none."""
        return self._next_s

    def take_until(self, time_s: float) -> float | None:
        """Pass every instant up to `time_s` and return the first, None if there was none."""
        if self._next_s > time_s:
            return None
        first = self._next_s
        while self._next_s <= time_s:
            self._step()
        return first

    def _step(self) -> None:
        fault = self._fault
        if fault.rate_per_h:
            self._next_s += float(self._generator.exponential(3600.0 / fault.rate_per_h))
            if self._next_s > fault.end_s:
                self._next_s = math.inf
        else:
            self._next_s = self._listed.pop(0) if self._listed else math.inf
