"""Driver of a chamber with a Watlow F4 or F4T controller."""

from __future__ import annotations

import math
from collections.abc import Sequence

from drivers.errors import DeviceRefused, DeviceSilent, ProtocolError, WrongDevice
from drivers.instruments import (
    ChamberCapabilities,
    ChamberLimits,
    ChamberState,
    Identity,
    Rest,
    require_ramp,
)
from drivers.link import Link
from drivers.modbus import ModbusMaster
from drivers.watlow._controllers import Controller
from drivers.watlow._registers import chamber_state

START_TIMEOUT_S = 10.0
START_PAUSE_S = 0.5


class WatlowChamber:
    """One chamber (`drivers.instruments.Chamber`) at a serial port or a socket.

    `auxiliary`: inputs of the controller, besides input 1, that are read with every state.
    `safe_set_point_c`: what
    `make_safe` leaves behind.
    """

    def __init__(
        self,
        link: Link,
        modbus: ModbusMaster,
        controller: Controller,
        *,
        auxiliary: Sequence[int] = (),
        safe_set_point_c: float = 23.0,
    ) -> None:
        self.link = link
        self.auxiliary = tuple(auxiliary)
        self.safe_set_point_c = safe_set_point_c
        self._modbus = modbus
        self._controller = controller
        self._halted = False

    def identify(self) -> Identity:
        """Read registers that make sense in this model only, else WrongDevice; it has none for a serial
        number."""
        try:
            details = self._controller.introduce()
        except (ProtocolError, DeviceRefused) as error:
            raise self._wrong_device(error.found or str(error)) from error
        except DeviceSilent as error:
            if "bytes" not in error.found:
                raise
            raise self._wrong_device(error.found) from error
        return Identity("Watlow", self._controller.model, details=details)

    def capabilities(self) -> ChamberCapabilities:
        """Return what the controller can do."""
        return self._controller.capabilities()

    def limits(self) -> ChamberLimits:
        """Read the limits of the set point."""
        return self._controller.limits()

    def start(self) -> None:
        """Start conditioning and check that it runs; DeviceRefused if it does not within 10 s."""
        self._switch(True)

    def stop(self) -> None:
        """Stop conditioning and check that it stopped; DeviceRefused if it does not within 10 s."""
        self._switch(False)

    def set_temperature(self, set_point_c: float, ramp_k_per_min: float | None = None) -> None:
        """Demand a set point; a ramp limits both directions, None takes the limit away."""
        require_ramp(self.capabilities(), set_point_c, ramp_k_per_min, self._where)
        self._controller.ramp(ramp_k_per_min)
        self._controller.set_point(set_point_c)

    def state(self) -> ChamberState:
        """Read air, auxiliary inputs and set point."""
        self.request_state()
        return self.read_state()

    def request_state(self) -> None:
        """Send the first question of a state without waiting; `read_state` must follow before anything else."""
        self._modbus.request(*self._controller.questions[0])

    def read_state(self) -> ChamberState:
        """Take the answer to `request_state` and ask the rest."""
        first, *rest = self._controller.questions
        row = self._controller.take(first[0], self._modbus.take())
        for start, count in rest:
            row = self._controller.take(start, self._modbus.read(start, count))
        if row is None:
            raise ProtocolError(
                "the controller's registers hold no temperatures", where=self._where, expected="numbers"
            )
        return chamber_state(row, self.auxiliary)

    def alarms(self) -> list[str]:
        """Return active alarms in words."""
        return self._controller.alarms()

    def halt(self) -> None:
        """Send what stops conditioning and wait for nothing."""
        self._modbus.send_write(*self._controller.stop_write)
        self._halted = True

    def make_safe(self) -> None:
        """Stop conditioning, leave the safe set point and no ramp; raises what was not confirmed.

        The answer to `halt` may be missed, if it was sent into the answer to an earlier question: it is told
        again.
        """
        if not self._halted:
            self.halt()
        self._halted = False
        problems = []
        try:
            self._modbus.settle()
        except (DeviceRefused, DeviceSilent, ProtocolError):
            try:
                self._controller.switch(False)
            except (DeviceRefused, DeviceSilent, ProtocolError) as error:
                problems.append(error)
        try:
            self._controller.set_point(self.safe_set_point_c)
            self._controller.ramp(None)
        except (DeviceRefused, DeviceSilent, ProtocolError) as error:
            problems.append(error)
        if problems:
            raise problems[0]

    def read_rest(self) -> Rest:
        """Read whether conditioning is off and which set point is left: at rest if it is the safe one."""
        running, set_point_c = self._controller.is_running(), self._controller.demanded_c()
        step = self.capabilities().temp_resolution_c
        safe = math.isclose(set_point_c, self.safe_set_point_c, rel_tol=0.0, abs_tol=step)
        return Rest(
            safe and not running, f"{'running' if running else 'stopped'}, set point {set_point_c:g} degC"
        )

    def _switch(self, on: bool) -> None:
        self._controller.switch(on)
        deadline = self.link.clock.now() + START_TIMEOUT_S
        while self._controller.is_running() is not on:
            if self.link.clock.now() >= deadline:
                raise self._not_switched(on)
            self.link.clock.sleep(START_PAUSE_S)

    @property
    def _where(self) -> str:
        return f"{self.link.name} ({self.link.url})"

    def _not_switched(self, on: bool) -> DeviceRefused:
        return DeviceRefused(
            f"the controller took the command and the chamber did not {'start' if on else 'stop'}",
            where=self._where,
            found="; ".join(self.alarms()) or "no alarm",
            expected=f"conditioning {'on' if on else 'off'} within {START_TIMEOUT_S:g} s",
            remedy="check door, alarms, and start_channel: the controller's output that starts this chamber",
        )

    def _wrong_device(self, found: str) -> WrongDevice:
        return WrongDevice(
            f"not a Watlow {self._controller.model} in degrees Celsius",
            where=self._where,
            found=found,
            expected="registers of this model with plausible contents",
            remedy="check which device the bench file names for this port, its Modbus address, and its unit",
        )
