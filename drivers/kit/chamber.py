"""What chamber drivers do alike: start and stop with a check, telemetry, the way to rest and its read-back."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable

from drivers.base.errors import BenchError, DeviceRefused, DeviceSilent, ProtocolError, WrongDevice
from drivers.kit.instruments import ChamberCapabilities, ChamberState, Identity, Rest
from drivers.kit.link import Link

START_TIMEOUT_S = 10.0
START_PAUSE_S = 0.5
_STEP_C = 0.1
"""A set point that reads back so near is the one that was told."""

TROUBLES = (DeviceRefused, DeviceSilent, ProtocolError)
"""What one command of several may meet without keeping the others from being sent."""


class PolledChamber(ABC):
    """The part of a chamber (`drivers.kit.instruments.Chamber`) that is the same for every controller.

    `safe_set_point_c`: what `make_safe` leaves behind. In words: `_product` is what `identify` looks for,
    `_known_by` what shows it and `_check` what to do if that is missing; `_switched_by`, what to check when a
    chamber took a command and did not start or stop.
    """

    _product = "a chamber"
    _known_by = "its answers"
    _check = "check which device the bench file names for this port"
    _switched_by = "check door and alarms"

    def __init__(self, link: Link, safe_set_point_c: float) -> None:
        self.link = link
        self.safe_set_point_c = safe_set_point_c
        self._state_asked = False
        self._halted = False

    @abstractmethod
    def capabilities(self) -> ChamberCapabilities:
        """Return what this chamber can do."""

    @abstractmethod
    def alarms(self) -> list[str]:
        """Return the alarms in force, in words."""

    @abstractmethod
    def request_state(self) -> None:
        """Send the first question of a state without waiting; `read_state` must follow before anything else."""

    @abstractmethod
    def read_state(self) -> ChamberState:
        """Take the answer to `request_state`, and ask the rest."""

    @abstractmethod
    def _introduction(self) -> Identity:
        """Ask who it is; any of `TROUBLES` if it is something else."""

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
    def _send_stop(self) -> None:
        """Write what stops conditioning, closing a command that was cut off halfway, and wait for nothing."""

    @abstractmethod
    def _way_to_rest(self) -> Iterable[Callable[[], None]]:
        """Return what confirms that which `_send_stop` sent, or sends it again, and leaves the safe set point."""

    def identify(self) -> Identity:
        """Ask who it is; WrongDevice if it is something else, DeviceSilent if nothing answers."""
        self.link.discard()
        try:
            return self._introduction()
        except (ProtocolError, DeviceRefused) as error:
            raise self._wrong_device(error.found or str(error)) from error
        except DeviceSilent as error:
            if not (seen := self._seen(error)):
                raise
            raise self._wrong_device(seen) from error

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

    def halt(self) -> None:
        """Write what stops conditioning and wait for nothing."""
        self._state_asked = False
        self.link.discard()
        self._send_stop()
        self._halted = True

    def make_safe(self) -> None:
        """Stop conditioning, leave the safe set point and no ramp; raises what was not confirmed.

        What `halt` has sent is sent again only if its own confirmation does not come: replies to its line end and
        to earlier questions are passed over. A refusal does not keep the other commands from being sent.
        """
        if not self._halted:
            self.halt()
        self._halted = False
        problems: list[BenchError] = []
        self.link.retrying = True  # whoever makes a bench safe goes from device to device, and comes back
        try:
            for step in self._way_to_rest():
                try:
                    step()
                except TROUBLES as error:
                    problems.append(error)
        finally:
            self.link.retrying = False
        if problems:
            raise problems[0]

    def read_rest(self) -> Rest:
        """Read whether conditioning is off and which set point is left: at rest if it is the safe one."""
        running, set_point_c = self._is_running(), self._demanded_c()
        tolerance_c = 1.1 * max(_STEP_C, self.capabilities().temp_resolution_c)
        safe = math.isclose(set_point_c, self.safe_set_point_c, rel_tol=0.0, abs_tol=tolerance_c)
        return Rest(safe and not running, running=running, set_point_c=set_point_c)

    def _seen(self, error: DeviceSilent) -> str:
        """Return what came of an answer that was not complete, empty if nothing."""
        seen = self.link.discard()
        return repr(seen[:60]) if seen else ""

    def _await_running(self, on: bool) -> None:
        deadline = self.link.clock.now() + START_TIMEOUT_S
        while self._is_running() is not on:
            if self.link.clock.now() >= deadline:
                raise self._not_switched(on)
            self.link.clock.sleep(START_PAUSE_S)

    @property
    def _where(self) -> str:
        return f"{self.link.name} ({self.link.url})"

    def _not_switched(self, on: bool) -> DeviceRefused:
        return DeviceRefused(
            f"the chamber took the command and did not {'start' if on else 'stop'}",
            where=self._where,
            found="; ".join(self.alarms()) or "no alarm",
            expected=f"conditioning {'on' if on else 'off'} within {START_TIMEOUT_S:g} s",
            remedy=self._switched_by,
        )

    def _wrong_device(self, found: str) -> WrongDevice:
        return WrongDevice(
            f"not {self._product}",
            where=self._where,
            found=found,
            expected=self._known_by,
            remedy=self._check,
        )
