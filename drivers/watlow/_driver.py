"""Driver of a chamber with a Watlow F4 or F4T controller."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial

from drivers.base.errors import DeviceSilent, ProtocolError
from drivers.kit.chamber import TROUBLES, PolledChamber
from drivers.kit.instruments import ChamberCapabilities, ChamberLimits, ChamberState, Identity, require_ramp
from drivers.kit.link import Link
from drivers.kit.modbus import ModbusMaster
from drivers.kit.retry import query_with_retry
from drivers.watlow._controllers import Controller
from drivers.watlow.registers import chamber_state


class WatlowChamber(PolledChamber):
    """One chamber (`drivers.kit.instruments.Chamber`) at a serial port or a socket.

    `auxiliary`: inputs of the controller, besides input 1, that are read with every state.
    """

    _known_by = "registers of this model with plausible contents"
    _check = "check which device the bench file names for this port, its Modbus address, and its unit"
    _switched_by = "check door, alarms, and start_channel: the controller's output that starts this chamber"

    def __init__(
        self,
        link: Link,
        modbus: ModbusMaster,
        controller: Controller,
        *,
        auxiliary: Sequence[int] = (),
        safe_set_point_c: float = 23.0,
    ) -> None:
        super().__init__(link, safe_set_point_c)
        self.auxiliary = tuple(auxiliary)
        self._product = f"a Watlow {controller.model} in degrees Celsius"
        self._modbus = modbus
        self._controller = controller

    def _introduction(self) -> Identity:
        """Read registers that make sense in this model only; it has none for a serial number."""
        return Identity("Watlow", self._controller.model, details=self._controller.introduce())

    def capabilities(self) -> ChamberCapabilities:
        """Return what the controller can do."""
        return self._controller.capabilities()

    def limits(self) -> ChamberLimits:
        """Read the limits of the set point."""
        return self._controller.limits()

    def set_temperature(self, set_point_c: float, ramp_k_per_min: float | None = None) -> None:
        """Demand a set point; a ramp limits both directions, None takes the limit away."""
        require_ramp(self.capabilities(), set_point_c, ramp_k_per_min, self._where)
        self._controller.ramp(ramp_k_per_min)
        self._controller.set_point(set_point_c)

    def request_state(self) -> None:
        """Send the first question of a state without waiting; `read_state` must follow before anything else."""
        self._modbus.request(*self._controller.questions[0])

    def read_state(self) -> ChamberState:
        """Take the answer to `request_state` and ask the rest."""
        row = None
        for start, count in self._controller.questions:
            words = query_with_retry(self.link, partial(self._modbus.collect, start, count))
            row = self._controller.take(start, words)
        if row is None:
            raise ProtocolError(
                "the controller's registers hold no temperatures", where=self._where, expected="numbers"
            )
        return chamber_state(row, self.auxiliary)

    def alarms(self) -> list[str]:
        """Return active alarms in words."""
        return self._controller.alarms()

    def _switch(self, on: bool) -> None:
        self._controller.switch(on)

    def _is_running(self) -> bool:
        return self._controller.is_running()

    def _demanded_c(self) -> float:
        return self._controller.demanded_c()

    def _send_stop(self) -> None:
        self._modbus.send_write(*self._controller.stop_write)

    def _way_to_rest(self) -> Iterable[Callable[[], None]]:
        return (
            self._confirm_stop,
            lambda: self._controller.set_point(self.safe_set_point_c),
            lambda: self._controller.ramp(None),
        )

    def _confirm_stop(self) -> None:
        """Take the answer to the stop; stop again if it is missed, having met that to an earlier question."""
        try:
            self._modbus.settle()
        except TROUBLES:
            self._controller.switch(False)

    def _seen(self, error: DeviceSilent) -> str:
        """Return what came of an answer: the master has taken it from the link."""
        return error.found if "bytes" in error.found else ""
