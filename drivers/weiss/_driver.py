"""Driver of a Weiss or Vötsch chamber: SimServ for values, ASCII-2 for the chamber's own description."""

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
from drivers.weiss._ascii2 import encode_configuration_query
from drivers.weiss._ascii2_control import Ascii2Control
from drivers.weiss._configuration import Configuration, decode_configuration
from drivers.weiss._simserv import MESSAGE_TYPES, ChamberStatus, Number, encode_request
from drivers.weiss._simserv_control import SimServControl

REPLY_TIMEOUT_S = 2.0
"""Public drivers wait 1 to 2 s for a reply."""

QUIET_S = 0.5
"""The answer to `$dd?` has many lines and no end mark: it is over when nothing came for this long."""

SET_POINT_EVERY = 10
"""States between two readings of the set point; 1 s states give 10 s."""

START_TIMEOUT_S = 10.0
START_PAUSE_S = 0.5


_SET_POINT_RESOLUTION_C = 0.11
"""ASCII-2 rounds to 0.1 degC."""

_SET_POINT = (Number.GET_SET_POINT, 1)
_AIR = (Number.GET_ACTUAL, 1)


class WeissChamber:
    """One chamber at a serial port or TCP port 2049.

    `auxiliary`: numbers of the measured values (MVnn) to read with every state. `start_channel`: SimServ index of
    the digital output that starts conditioning, 1 on most controllers, 2 on some. `simserv=False` is for
    controllers without SimServ: temperatures then have a resolution of 0.1 degC, and alarms are known only as far
    as the chamber names a digital output for them. `safe_set_point_c`: what `make_safe` leaves behind.

    A state is one exchange for each auxiliary sensor and one for the air, which ends it. The set point, which
    only a command, a ramp or somebody at the panel moves, is asked with every `SET_POINT_EVERY`th state and after
    a command, and held between. With ASCII-2 a state is one exchange for everything.
    """

    def __init__(
        self,
        link: Link,
        *,
        address: int = 1,
        auxiliary: Sequence[int] = (),
        simserv: bool = True,
        start_channel: int = 1,
        safe_set_point_c: float = 23.0,
    ) -> None:
        self.link = link
        self.address = address
        self.auxiliary = tuple(auxiliary)
        self.simserv = simserv
        self.start_channel = start_channel
        self.safe_set_point_c = safe_set_point_c
        self._simserv = SimServControl(link)
        self._ascii2 = Ascii2Control(link, address, self.auxiliary, self.configuration)
        self._configuration: Configuration | None = None
        self._state_asked = False
        self._halted = False
        self._questions: list[tuple[Number, int]] = []
        self._polls_to_set_point = 0
        self._set_point_c = math.nan

    def identify(self) -> Identity:
        """Ask for type, year and serial number (SimServ) and the configuration (`$dd?`); else WrongDevice."""
        self._settle_input()
        details: dict[str, str] = {}
        model, year, serial_number = "chamber without SimServ", "", ""
        try:
            if self.simserv:
                model, year, serial_number = (
                    self._simserv.text(Number.CHAMBER_INFO, item) for item in (1, 2, 3)
                )
                details["year"] = year
            self._configuration = None
            configuration = self.configuration()
        except ProtocolError as error:
            raise self._wrong_device(error.found) from error
        except DeviceSilent as error:
            if not (seen := self.link.discard()):
                raise
            raise self._wrong_device(repr(seen[:60])) from error
        details["set values"] = " ".join(configuration.set_fields)
        details["read values"] = " ".join(configuration.read_fields)
        details["digital outputs"] = ", ".join(
            f"DO{index:02d} {name}" for index, name in configuration.digital_names.items()
        )
        return Identity("Weiss Technik", model, serial_number, "", details)

    def configuration(self) -> Configuration:
        """Return what the chamber answers to `$dd?`, asked once; raises ProtocolError if it makes no sense."""
        if self._configuration is None:
            self._settle_input()
            self.link.write(encode_configuration_query(self.address))
            answer = self.link.read_until(b"\r", REPLY_TIMEOUT_S)
            while more := self.link.read_some(QUIET_S):
                answer += more
            self._configuration = decode_configuration(answer.decode("latin-1"))
        return self._configuration

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

    def start(self) -> None:
        """Start conditioning and check that the chamber runs; DeviceRefused if it does not within 10 s."""
        self._switch(True)

    def stop(self) -> None:
        """Stop conditioning and check that the chamber stopped; DeviceRefused if it does not within 10 s."""
        self._switch(False)

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

    def state(self) -> ChamberState:
        """Read air, auxiliary sensors and set point."""
        self.request_state()
        return self.read_state()

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
        self._state_asked = False
        if not self.simserv:
            return self._ascii2.read_state()
        first, *rest = self._questions
        answers = {first: self._simserv.take_value(first[0])}
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

    def halt(self) -> None:
        """Send the commands that stop conditioning and set the safe set point, and wait for nothing.

        Starts with a line end, which closes a command that was cut off halfway. With ASCII-2 that is all: a stop
        there is part of a telegram for which the chamber's values must be read first.
        """
        self._state_asked = False
        self.link.discard()
        self.link.write(b"\r")
        if self.simserv:
            for number, argument, value in self._first_commands():
                self.link.write(encode_request(number, argument, value))
        self._halted = True

    def make_safe(self) -> None:
        """Stop conditioning, leave the safe set point and no ramp; raises what was not confirmed.

        Replies to the line end of `halt` and to earlier questions are passed over. A command of `halt` that is
        not confirmed is sent again on its own, in case the controller takes only one line at a time; a refusal
        does not keep the others from being sent.
        """
        if not self._halted:
            self.halt()
        self._halted = False
        if not self.simserv:
            self.link.read_some(QUIET_S)
            self._ascii2.rest_at(self.safe_set_point_c)
            return
        sent = self._first_commands()
        problems = []
        for command in (*sent, (Number.SET_GRADIENT_UP, 1, 0), (Number.SET_GRADIENT_DOWN, 1, 0)):
            try:
                if command not in sent or not self._simserv.confirms(command[0]):
                    self._simserv.insist(*command)
            except (DeviceRefused, DeviceSilent, ProtocolError) as error:
                problems.append(error)
        if problems:
            raise problems[0]

    def read_rest(self) -> Rest:
        """Read whether conditioning is off and which set point is left: at rest if it is the safe one."""
        self._settle_input()
        running = self._is_running()
        if self.simserv:
            set_point_c = self._simserv.value(*_SET_POINT)
        else:
            self._ascii2.request_values()
            set_point_c = self._ascii2.read_state().set_point_c
        safe = abs(set_point_c - self.safe_set_point_c) < _SET_POINT_RESOLUTION_C
        text = f"{'running' if running else 'stopped'}, set point {set_point_c:g} degC"
        return Rest(safe and not running, text)

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
        deadline = self.link.clock.now() + START_TIMEOUT_S
        while self._is_running() is not on:
            if self.link.clock.now() >= deadline:
                raise self._not_switched(on)
            self.link.clock.sleep(START_PAUSE_S)

    def _is_running(self) -> bool:
        return bool(self._status() & ChamberStatus.RUNNING) if self.simserv else self._ascii2.is_running()

    def _status(self) -> ChamberStatus:
        return ChamberStatus(int(self._simserv.value(Number.CHAMBER_STATUS)))

    def _settle_input(self) -> None:
        """Take the answer to a state question nobody read, then drop late answers."""
        if self._state_asked:
            self._state_asked = False
            self.link.read_until(b"\r", REPLY_TIMEOUT_S)
        self.link.discard()

    @property
    def _where(self) -> str:
        return f"{self.link.name} ({self.link.url})"

    def _not_switched(self, on: bool) -> DeviceRefused:
        return DeviceRefused(
            f"the chamber took the command and did not {'start' if on else 'stop'}",
            where=self._where,
            found="; ".join(self.alarms()) or "no alarm",
            expected=f"conditioning {'on' if on else 'off'} within {START_TIMEOUT_S:g} s",
            remedy="check door, alarms and start_channel (1 on most controllers, 2 on some)",
        )

    def _wrong_device(self, found: str) -> WrongDevice:
        return WrongDevice(
            "not a Weiss or Vötsch chamber",
            where=self._where,
            found=found,
            expected="SimServ replies and an ASCII-2 configuration text"
            if self.simserv
            else "ASCII-2 replies",
            remedy="check which device the bench file names for this port, its address and `simserv`",
        )
