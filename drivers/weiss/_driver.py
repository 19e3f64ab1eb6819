"""Driver of a Weiss or Vötsch chamber: SimServ for values, ASCII-2 for the chamber's own description."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial

from drivers.kit.chamber import PolledChamber
from drivers.kit.config import ChamberConfig, key
from drivers.kit.instruments import ChamberCapabilities, ChamberLimits, ChamberState, Identity, require_ramp
from drivers.kit.kinds import Connection
from drivers.kit.retry import query_with_retry
from drivers.weiss._ascii2_control import Ascii2Control
from drivers.weiss._simserv_control import SimServControl
from drivers.weiss.ascii2 import encode_configuration_query
from drivers.weiss.configuration import Configuration, decode_configuration
from drivers.weiss.simserv import MESSAGE_TYPES, ChamberStatus, Number, encode_request

REPLY_TIMEOUT_S = 2.0
"""Public drivers wait 1 to 2 s for a reply."""

QUIET_S = 0.5
"""The answer to `$dd?` has many lines and no end mark: it is over when nothing came for this long."""

SET_POINT_EVERY = 10
"""States between two readings of the set point; 1 s states give 10 s."""

_SET_POINT = (Number.GET_SET_POINT, 1)
_AIR = (Number.GET_ACTUAL, 1)


class WeissConfig(ChamberConfig):
    """`[chamber]` of a Weiss or Vötsch chamber; `auxiliary` are numbers of its measured values (MVnn).

    `start_channel` is a SimServ index, 1 on most controllers, 2 on some. Without `simserv` temperatures have a
    resolution of 0.1 degC, and alarms are known only as far as the chamber names a digital output for them.
    """

    address: int | None = key(
        default=None, ge=0, le=31, description="the address of a Weiss chamber, 0 to 31; left out: 1"
    )
    simserv: bool = key(default=True, description="true if the chamber's port also answers SimServ")
    start_channel: int = key(
        default=1, ge=1, le=32, description="the number of the digital output that starts the chamber"
    )

    @property
    def bus_address(self) -> int:
        """The address in every message."""
        return 1 if self.address is None else self.address


class WeissChamber(PolledChamber):
    """One chamber at a serial port or TCP port 2049.

    A state is one exchange for each auxiliary sensor and one for the air, which ends it. The set point, which
    only a command, a ramp or somebody at the panel moves, is asked with every `SET_POINT_EVERY`th state and after
    a command, and held between. With ASCII-2 a state is one exchange for everything.
    """

    _product = "a Weiss or Vötsch chamber"
    _known_by = "SimServ replies and an ASCII-2 configuration text"
    _check = "check which device the bench file names for this port, its address and `simserv`"
    _switched_by = "check door, alarms and start_channel (1 on most controllers, 2 on some)"

    def __init__(self, config: WeissConfig, connection: Connection) -> None:
        link = connection.link(config.port, config.baudrate)
        super().__init__(link, connection.safe_set_point_c)
        self.address = config.bus_address
        self.auxiliary = tuple(config.auxiliary)
        self.simserv = config.simserv
        self.start_channel = config.start_channel
        if not self.simserv:
            self._known_by = "ASCII-2 replies"
        self._simserv = SimServControl(link)
        self._ascii2 = Ascii2Control(link, self.address, self.auxiliary, self.configuration)
        self._configuration: Configuration | None = None
        self._questions: list[tuple[Number, int]] = []
        self._polls_to_set_point = 0
        self._set_point_c = math.nan

    def _introduction(self) -> Identity:
        """Ask for type, year and serial number (SimServ) and the configuration (`$dd?`)."""
        details: dict[str, str] = {}
        model, year, serial_number = "chamber without SimServ", "", ""
        if self.simserv:
            model, year, serial_number = (self._simserv.text(Number.CHAMBER_INFO, item) for item in (1, 2, 3))
            details["year"] = year
        self._configuration = None
        configuration = self.configuration()
        details["set values"] = " ".join(configuration.set_fields)
        details["read values"] = " ".join(configuration.read_fields)
        details["digital outputs"] = ", ".join(
            f"DO{index:02d} {name}" for index, name in configuration.digital_names.items()
        )
        return Identity("Weiss Technik", model, serial_number, "", details)

    def configuration(self) -> Configuration:
        """Return what the chamber answers to `$dd?`, asked once; raises ProtocolError if it makes no sense."""
        if self._configuration is None:
            self._configuration = query_with_retry(self.link, self._ask_configuration)
        return self._configuration

    def _ask_configuration(self) -> Configuration:
        self._settle_input()
        self.link.write(encode_configuration_query(self.address))
        answer = self.link.read_until(b"\r", REPLY_TIMEOUT_S)
        while more := self.link.read_some(QUIET_S):
            answer += more
        return decode_configuration(answer.decode("latin-1"))

    def capabilities(self) -> ChamberCapabilities:
        """SimServ has thousandths; ASCII-2 tenths and the measured values that the configuration names."""
        if self.simserv:
            return ChamberCapabilities(0.001, (0.001, math.inf), None)
        return ChamberCapabilities(0.1, (0.1, 9999.9), self.configuration().measured_values())

    def limits(self) -> ChamberLimits:
        """Read the input limits of the temperature set point."""
        self._settle_input()
        if not self.simserv:
            temperature = self.configuration().settings["CV01"]
            return ChamberLimits(temperature.minimum, temperature.maximum)
        return ChamberLimits(
            self._simserv.value(Number.GET_INPUT_MINIMUM, 1), self._simserv.value(Number.GET_INPUT_MAXIMUM, 1)
        )

    def set_temperature(self, set_point_c: float, ramp_k_per_min: float | None = None) -> None:
        """Demand a set point; `ramp_k_per_min` limits both directions, None takes every limit away."""
        require_ramp(self.capabilities(), set_point_c, ramp_k_per_min, self._where)
        ramp = 0.0 if ramp_k_per_min is None else ramp_k_per_min
        self._settle_input()
        if not self.simserv:
            self._ascii2.set_temperature(set_point_c, ramp)
            return
        self._simserv.command(Number.SET_GRADIENT_UP, 1, round(float(ramp), 3))
        self._simserv.command(Number.SET_GRADIENT_DOWN, 1, round(float(ramp), 3))
        self._simserv.command(Number.SET_SET_POINT, 1, round(float(set_point_c), 3))
        self._polls_to_set_point = 0

    def request_state(self) -> None:
        """Send the first question of a state without waiting; `read_state` must follow before anything else."""
        self._settle_input()
        if self.simserv:
            self._questions = self._state_questions()
            self._simserv.request(*self._questions[0])
        else:
            self._ascii2.request_values()
        self._state_asked = True

    def read_state(self) -> ChamberState:
        """Take the answer to `request_state` and ask the rest."""
        if not self.simserv:
            return self._collected(self._ascii2.request_values, self._ascii2.read_state)
        first, *rest = self._questions
        answers = {
            first: self._collected(
                lambda: self._simserv.request(*first), lambda: self._simserv.take_value(first[0])
            )
        }
        answers |= {question: self._simserv.value(*question) for question in rest}
        self._set_point_c = answers.get(_SET_POINT, self._set_point_c)
        auxiliary_c = {number: answers[Number.GET_MEASURED, number] for number in self.auxiliary}
        return ChamberState(answers[_AIR], self._set_point_c, auxiliary_c)

    def _state_questions(self) -> list[tuple[Number, int]]:
        """Return what to ask, the air last: it ends a poll. The set point moves only by a ramp or on demand."""
        questions = [(Number.GET_MEASURED, number) for number in self.auxiliary]
        if self._polls_to_set_point == 0:
            questions.insert(0, _SET_POINT)
        self._polls_to_set_point = (self._polls_to_set_point or SET_POINT_EVERY) - 1
        return [*questions, _AIR]

    def alarms(self) -> list[str]:
        """Return active alarms and warnings in words: one exchange while there are none."""
        self._settle_input()
        if not self.simserv:
            return self._ascii2.alarms()
        status = self._status()
        if not status & (ChamberStatus.ALARM | ChamberStatus.WARNING):
            return []
        found = []
        for index in range(1, int(self._simserv.value(Number.MESSAGE_COUNT)) + 1):
            kind = MESSAGE_TYPES.get(int(self._simserv.value(Number.MESSAGE_TYPE, index)), "message")
            if kind != "info" and int(self._simserv.value(Number.MESSAGE_ACTIVE, index)) == 1:
                found.append(f"{kind}: {self._simserv.text(Number.MESSAGE_TEXT, index)}")
        return found or [f"chamber status {int(status)} without an active message"]

    def _send_stop(self) -> None:
        """With ASCII-2 a line end is all: a stop is part of a telegram for which values must be read first."""
        self.link.write(b"\r")
        if self.simserv:
            for number, argument, value in self._first_commands():
                self.link.write(encode_request(number, argument, value))

    def _way_to_rest(self) -> Iterable[Callable[[], None]]:
        """A command that is not confirmed is sent again on its own, in case only one line is taken at a time."""
        if not self.simserv:
            return (self._rest_by_ascii2,)
        sent = self._first_commands()
        gradients = ((Number.SET_GRADIENT_UP, 1, 0), (Number.SET_GRADIENT_DOWN, 1, 0))
        return (
            *(partial(self._confirm, *command) for command in sent),
            *(partial(self._simserv.insist, *command) for command in gradients),
        )

    def _confirm(self, number: Number, argument: int, value: float) -> None:
        if not self._simserv.confirms(number):
            self._simserv.insist(number, argument, value)

    def _rest_by_ascii2(self) -> None:
        self.link.read_some(QUIET_S)
        self._ascii2.rest_at(self.safe_set_point_c)

    def _demanded_c(self) -> float:
        self._settle_input()
        return self._simserv.value(*_SET_POINT) if self.simserv else self._ascii2.demanded_c()

    def _first_commands(self) -> list[tuple[Number, int, float]]:
        return [
            (Number.SET_DIGITAL_OUT, self.start_channel, 0),
            (Number.SET_SET_POINT, 1, float(self.safe_set_point_c)),
        ]

    def _switch(self, on: bool) -> None:
        self._settle_input()
        if self.simserv:
            self._simserv.command(Number.SET_DIGITAL_OUT, self.start_channel, int(on))
        else:
            self._ascii2.switch(on)

    def _is_running(self) -> bool:
        self._settle_input()
        return bool(self._status() & ChamberStatus.RUNNING) if self.simserv else self._ascii2.is_running()

    def _status(self) -> ChamberStatus:
        return ChamberStatus(int(self._simserv.value(Number.CHAMBER_STATUS)))
