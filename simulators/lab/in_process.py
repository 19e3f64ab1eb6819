"""A lab in the process of the bench that drives it: the same ports and the same bytes, its time moved by calls.

It ends with that process. Other software, and whoever kills the bench, takes a lab that has a process of its own.
"""

from __future__ import annotations

from typing import Any

from drivers.base.errors import BenchError, ConfigurationError, LinkLost
from drivers.base.lab_time import Greeting, MakeRoom, Reply, Request, lab_failed, offer, withdraw
from simulators.config import LabConfig
from simulators.lab._build import build_lab
from simulators.lab._control_channel import perform
from simulators.lab._lock_step import LockStep


class InProcessLab:
    """The lab that a line describes (`LabConfig.to_line`), until `close`. One bench at a time is in it.

    `ports`: where the devices are, by name. `clock_url`: its clock, which this process alone can reach.
    """

    def __init__(self, line: bytes) -> None:
        config = LabConfig.from_line(line)
        self._lab, self._acts = build_lab(config)
        self.ports = {port.name: port.url for port in self._lab.ports}
        self._moved = LockStep(self._lab, config.cpu, config.emulated)
        self._occupied = False
        self.clock_url = offer(self._enter)

    @property
    def greeting(self) -> Greeting:
        """What the lab says of itself now."""
        return self._moved.greeting

    def step(self, request: Request, make_room: MakeRoom) -> Reply:
        """Move the lab (`drivers.base.lab_time.LabTime`)."""
        try:
            return self._moved.step(request, make_room)
        except LinkLost:  # of the bench's ports, which `make_room` reads
            raise
        except BenchError as error:
            raise lab_failed(str(error)) from error

    def leave(self) -> None:
        """Shut the ports: the bench that had them is gone."""
        self._moved.leave()
        self._occupied = False

    def perform(self, line: bytes) -> dict[str, Any]:
        """Do what a line of the control channel asks for and return the answer."""
        return perform(self._acts, line)

    def close(self) -> None:
        """Remove clock and ports."""
        withdraw(self.clock_url)
        for port in self._lab.ports:
            port.close()

    def _enter(self) -> InProcessLab:
        if self._occupied:
            raise ConfigurationError(
                "another bench of this process is in the emulated lab",
                where=self.clock_url,
                expected="one bench at a time",
                remedy="close its clock first, or take a lab for each",
            )
        self._occupied = True
        return self
