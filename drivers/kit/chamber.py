"""What chamber drivers do alike: start and stop with a check, telemetry, the way to rest and its read-back."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable

from drivers.base.errors import DeviceRefused
from drivers.kit.instruments import Chamber, ChamberState, Rest
from drivers.kit.link import Link
from drivers.kit.polled import PolledInstrument

START_TIMEOUT_S = 10.0
START_PAUSE_S = 0.5
_STEP_C = 0.1
"""A set point that reads back so near is the one that was told."""


class PolledChamber(PolledInstrument, Chamber):
    """The part of a chamber (`drivers.kit.instruments.Chamber`) that is the same for every controller.

    `safe_set_point_c`: what `make_safe` leaves behind. `_switched_by`, in words: what to check when a chamber
    took a command and did not start or stop.
    """

    _product = "a chamber"
    _switched_by = "check door and alarms"

    def __init__(self, link: Link, safe_set_point_c: float) -> None:
        super().__init__(link)
        self.safe_set_point_c = safe_set_point_c

    @abstractmethod
    def _switch(self, on: bool) -> None:
        """Tell it to start or stop conditioning."""

    @abstractmethod
    def _is_running(self) -> bool:
        """Read whether conditioning is on."""

    @abstractmethod
    def _demanded_c(self) -> float:
        """Read the set point back."""

    @abstractmethod
    def _way_to_rest(self) -> Iterable[Callable[[], None]]:
        """Return what confirms that which `_send_stop` sent, or sends it again, and leaves the safe set point."""

    def start(self) -> None:
        """Start conditioning and check that it runs; DeviceRefused if it does not within 10 s."""
        self._switch(True)
        self._await_running(True)

    def stop(self) -> None:
        """Stop conditioning and check that it stopped; DeviceRefused if it does not within 10 s."""
        self._switch(False)
        self._await_running(False)

    def state(self) -> ChamberState:
        """Read air, set point and auxiliary sensors."""
        self.request_state()
        return self.read_state()

    def make_safe(self) -> None:
        """Stop conditioning, leave the safe set point and no ramp; raises what was not confirmed.

        What `halt` has sent is sent again only if its own confirmation does not come: replies to its line end and
        to earlier questions are passed over. A refusal does not keep the other commands from being sent.
        """
        self._once_halted()
        self._carry_out_all(self._way_to_rest())

    def read_rest(self) -> Rest:
        """Read whether conditioning is off and which set point is left: at rest if it is the safe one."""
        running, set_point_c = self._is_running(), self._demanded_c()
        tolerance_c = 1.1 * max(_STEP_C, self.capabilities().temp_resolution_c)
        safe = math.isclose(set_point_c, self.safe_set_point_c, rel_tol=0.0, abs_tol=tolerance_c)
        return Rest(safe and not running, running=running, set_point_c=set_point_c)

    def _await_running(self, on: bool) -> None:
        deadline = self.link.clock.now() + START_TIMEOUT_S
        while self._is_running() is not on:
            if self.link.clock.now() >= deadline:
                raise self._not_switched(on)
            self.link.clock.sleep(START_PAUSE_S)

    def _not_switched(self, on: bool) -> DeviceRefused:
        return DeviceRefused(
            f"the chamber took the command and did not {'start' if on else 'stop'}",
            where=self._where,
            found="; ".join(self.alarms()) or "no alarm",
            expected=f"conditioning {'on' if on else 'off'} within {START_TIMEOUT_S:g} s",
            remedy=self._switched_by,
        )
