"""Driver of a Thermotron chamber with an 8200, 8800 or 3800 controller, in run manual mode."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, TypeVar

from drivers.base.errors import DeviceRefused, ProtocolError
from drivers.kit.chamber import PolledChamber
from drivers.kit.config import ChamberConfig, Mistake, key
from drivers.kit.instruments import (
    ChamberCapabilities,
    ChamberLimits,
    ChamberState,
    Identity,
    Rest,
    require_ramp,
)
from drivers.kit.kinds import Connection
from drivers.kit.retry import command_with_retry, misfit, pass_over, query_with_retry
from drivers.thermotron.codec import (
    AIR,
    ALARM_BITS,
    CELSIUS,
    CONTROLLERS,
    CR,
    IDENTITY,
    MANUAL,
    PRODUCT_CONTROL,
    RESOLUTION_C,
    RUNNING_CODE,
    SET_POINT,
    TEMPERATURE_TYPES,
    Name,
    Readings,
    decode_code,
    decode_identity,
    decode_line,
    decode_number,
    decode_text,
    encode_line,
    ramp_text,
    set_point_text,
    stop_words,
)

REPLY_TIMEOUT_S = 2.0
PAUSE_S = 1.0
"""What a controller gets that does not answer commands: as pymeasure waits."""

_T = TypeVar("_T")
_InForce = Callable[[], bool]


class ThermotronConfig(ChamberConfig):
    """`[chamber]` of a Thermotron; `auxiliary` are process variables 2 to 8, monitor channels 13 to 28."""

    address: int | None = key(
        default=None, ge=1, le=127, description="the controller's address on RS-485, 1 to 127; left out: none"
    )
    controller: Name = key(default="8200", description="the controller: '8200', '8800' or '3800'")
    acknowledges: bool = key(
        default=True,
        description="whether the controller answers commands with a code, as an 8800 after CMST1: true or false",
    )
    step_k_per_min: float = key(
        default=100.0,
        gt=0.1,
        le=1000,
        allow_inf_nan=False,
        description="the ramp told with a set point without one, K/min: faster than the chamber is",
    )

    @classmethod
    def mistakes(cls, given: Mapping[str, Any]) -> Iterator[Mistake]:
        """Yield an address that would end a line."""
        if given.get("address") in (10, 13):
            yield Mistake("address", str(given["address"]), "another: bytes 10 and 13 end a line")


class ThermotronChamber(PolledChamber):
    """One chamber (`drivers.kit.instruments.Chamber`) at a serial port or TCP port 8888; channel 1 is its air.

    A set point is told again once the chamber runs: what a stopped controller makes of one is not public. Nor is
    the ramp that means none: `step_k_per_min` is told then.
    """

    _known_by = (
        "IDEN? with the controller's number; of an 8800 degrees Celsius, no product temperature control"
    )
    _answer_end, _answer_s = CR, REPLY_TIMEOUT_S
    _check = (
        "check which device the bench file names for this port, its controller and address; of an 8800 its "
        "temperature scale (Celsius), product temperature control (off), and `acknowledges`"
    )

    def __init__(self, config: ThermotronConfig, connection: Connection) -> None:
        super().__init__(connection.link(config.port, config.baudrate), connection.safe_set_point_c)
        self.model, self.address = config.controller, config.address
        self.auxiliary = tuple(config.auxiliary)
        self._has = CONTROLLERS[config.controller]
        self.tells_alarms = self._has.tells_stop
        self._product = f"a Thermotron {config.controller} in degrees Celsius"
        self._acknowledges, self._step = config.acknowledges, config.step_k_per_min
        self._asks_door = config.door_message is not None and self._has.tells_all
        self._readings = Readings()
        self._demand: tuple[float, float] | None = None
        self._meant_to_run = False

    def _introduction(self) -> Identity:
        """Ask its name and, of an 8800, what its numbers mean."""
        name = self._query(IDENTITY, decode_identity)
        if self.model not in name:
            raise self._odd(repr(name), self._known_by)
        version = "" if self.model == "8200" else self._query("VRSN?", decode_text)
        if self._has.tells_all:
            self._check_settings()
        return Identity("Thermotron", self.model, firmware=version, details={"IDEN?": name})

    def _check_settings(self) -> None:
        if (scale := self._query("TMPS?", decode_code)) != CELSIUS:
            words = " (degrees Fahrenheit)" if scale == 1 else ""
            raise self._odd(f"TMPS? = {scale}{words}", "0 (degrees Celsius)")
        if self._query("OPTN?", decode_code) & PRODUCT_CONTROL:
            raise self._odd("product temperature control is on", "OPTN? without 1")
        if (answers := self._query("CMST?", decode_code)) != self._acknowledges:
            raise self._odd(
                f"CMST? = {answers}", f"{int(self._acknowledges)}, as `acknowledges` of the bench file"
            )
        for channel in self.auxiliary:
            if (kind := self._query(f"DTYP{channel}?", decode_code)) not in TEMPERATURE_TYPES:
                raise self._odd(f"DTYP{channel}? = {kind}", f"a temperature in channel {channel}")

    def capabilities(self) -> ChamberCapabilities:
        """Tenths of a degree; a 3800 has no command for a ramp."""
        ramps = (0.1, self._step) if self._has.ramps else None
        return ChamberCapabilities(RESOLUTION_C, ramps, self._has.channels)

    def limits(self) -> ChamberLimits:
        """Read the limits at which an 8800 raises an alarm; the others tell none."""
        if not self._has.tells_all:
            return ChamberLimits(-math.inf, math.inf)
        return ChamberLimits(self._query("PALL1?", decode_number), self._query("PALH1?", decode_number))

    def set_temperature(self, set_point_c: float, ramp_k_per_min: float | None = None) -> None:
        """Demand a set point; of a chamber that stands it counts from its start on."""
        require_ramp(self.capabilities(), set_point_c, ramp_k_per_min, self._where)
        self._demand = (set_point_c, self._step if ramp_k_per_min is None else ramp_k_per_min)
        self._tell_demand(self._is_running())

    def request_state(self) -> None:
        """Ask for the air without waiting; `read_state` must follow before anything else."""
        self._ask_state(encode_line(AIR, self.address))

    def read_state(self) -> ChamberState:
        """Take the answer to `request_state`, and ask sensors and set point."""
        air_c = self._collected(self.request_state, lambda: self._decoded(decode_number, self._line()))
        self._readings.take(AIR, air_c)
        for number in self.auxiliary:
            self._readings.take(f"PVAR{number}?", self._query(f"PVAR{number}?", decode_number))
        row = self._readings.take(SET_POINT, self._query(SET_POINT, decode_number))
        assert row is not None, "the air was taken first"
        auxiliary_c = {number: row[f"aux_{number}_temp_c"] for number in self.auxiliary}
        return ChamberState(row["air_temp_c"], row["set_point_c"], auxiliary_c)

    def alarms(self) -> list[str]:
        """Return the alarms of the air; why it stopped, if it should run; and of an open door if it is asked."""
        found = []
        if self._has.tells_all:
            bits = self._query("ALRM1?", decode_code)
            found += [words for bit, words in ALARM_BITS.items() if bits >> bit & 1]
        if self._has.tells_stop and self._meant_to_run:
            code = self._query("SCOD?", decode_code)
            found += [stop_words(code)] if code != RUNNING_CODE else []
        if self._asks_door and not self._query("DOOR?", decode_code):
            found.append("door open")
        return found

    def in_step(self) -> bool:
        """Ask for the name: all other answers are numbers."""

        def is_name(timeout_s: float) -> bool:
            try:
                return bool(decode_identity(self._line(timeout_s)))
            except ProtocolError:
                return False

        self._settle_input()
        self.link.write(encode_line(IDENTITY, self.address))
        return pass_over(self.link, REPLY_TIMEOUT_S, is_name)

    def read_rest(self) -> Rest:
        """Read whether it stands and, of an 8800, which set point is left: the others show it once they run."""
        if self._has.tells_all:
            return super().read_rest()
        running = self._is_running()
        return Rest(not running, running=running)

    def _send_stop(self) -> None:
        self._meant_to_run = False
        self.link.write(CR)
        for text in self._safe_commands():
            self.link.write(encode_line(text, self.address))

    def _safe_commands(self) -> list[str]:
        ramp = [ramp_text(self._step)] if self._has.ramps else []
        return ["STOP", *ramp, set_point_text(self.safe_set_point_c)]

    def _way_to_rest(self) -> Iterable[Callable[[], None]]:
        self._demand = (self.safe_set_point_c, self._step)
        return (self._pass_over_codes, self._confirm_stop, lambda: self._tell_demand(running=False))

    def _pass_over_codes(self) -> None:
        """Take the codes that answer what was sent: they look alike, what they stand for is read back."""
        self.in_step()

    def _confirm_stop(self) -> None:
        if self._is_running():
            self._command("STOP", lambda: not self._is_running())

    def _switch(self, on: bool) -> None:
        self._meant_to_run = on
        if on:  # a program that runs is no manual mode: RUNM is refused then
            self._command("RUNM", lambda: bool(self._status() & MANUAL))
        else:
            self._command("STOP", lambda: not self._is_running())
        if on and self._demand is not None:
            self._tell_demand(running=True)

    def _tell_demand(self, running: bool) -> None:
        """Ramp first, set point last: no way to it ever begins at an old ramp."""
        assert self._demand is not None
        set_point_c, k_per_min = self._demand
        if self._has.ramps:
            self._command(
                ramp_text(k_per_min), (lambda: self._holds("MRMP1?", k_per_min)) if running else None
            )
        shows = running or self._has.tells_all
        in_force = (lambda: self._holds(self._demanded, set_point_c)) if shows else None
        loading = running and self._has.loads_on_run
        self._command(set_point_text(set_point_c), None if loading else in_force)
        if loading:
            self._command("RUNM", in_force)

    def _holds(self, query: str, value: float) -> bool:
        found = self._query(query, decode_number)
        return math.isclose(found, value, rel_tol=0.0, abs_tol=1.01 * RESOLUTION_C)

    @property
    def _demanded(self) -> str:
        """What tells the set point demanded: SETP1? of an 8800 tells where its ramp is."""
        return "FVAL1?" if self._has.tells_all else SET_POINT

    def _demanded_c(self) -> float:
        return self._query(self._demanded, decode_number)

    def _is_running(self) -> bool:
        return bool(self._status() & self._has.running)

    def _status(self) -> int:
        return self._query(self._has.status, decode_code)

    def _command(self, text: str, in_force: _InForce | None) -> None:
        """Carry out a command; it is refused unless what was told is in force: no answer has a check value."""
        command_with_retry(self.link, lambda: self._tell(text, in_force), in_force, doubt_refusal=True)

    def _tell(self, text: str, in_force: _InForce | None) -> None:
        self._settle_input()
        self.link.write(encode_line(text, self.address))
        if not self._acknowledges:
            self.link.clock.sleep(PAUSE_S)
            self.link.discard()
            if in_force is not None and not in_force():
                raise self._odd(f"{text} is not in force", "a command that is carried out")
            return
        reply = self._line()
        if reply == "0" or (text.startswith("SETP") and _same(reply, text)):
            return
        raise DeviceRefused(
            f"the chamber refused {text!r}",
            where=self._where,
            found=f"code {self._decoded(decode_code, reply)}",
            expected="0",
            remedy="look the code up in the controller's manual (IERR), and check the demand against its limits",
        )

    def _query(self, text: str, read: Callable[[str], _T]) -> _T:
        """Ask and return what `read` makes of the answer."""

        def question() -> _T:
            self._settle_input()
            self.link.write(encode_line(text, self.address))
            return self._decoded(read, self._line())

        return query_with_retry(self.link, question)

    def _decoded(self, read: Callable[[str], _T], reply: str) -> _T:
        try:
            return read(reply)
        except ProtocolError as error:
            raise self._odd(error.found, error.expected) from error

    def _line(self, timeout_s: float = REPLY_TIMEOUT_S) -> str:
        return self._decoded(
            lambda line: decode_line(line.encode("latin-1"), self.address),
            self.link.read_until(CR, timeout_s).decode("latin-1"),
        )

    def _odd(self, found: str, expected: str) -> ProtocolError:
        return misfit("chamber", self._where, found, expected)


def _same(reply: str, text: str) -> bool:
    """Whether an answer repeats the set point, as the manual of the 8200 prints it."""
    try:
        return math.isclose(decode_number(reply), float(text.partition(",")[2]), abs_tol=RESOLUTION_C / 2)
    except ProtocolError:
        return False
