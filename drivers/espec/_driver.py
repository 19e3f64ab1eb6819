"""Driver of an ESPEC chamber with a P-300 or SCP-220 controller."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import Literal, TypeVar

from drivers.base.errors import DeviceRefused, DeviceSilent, ProtocolError
from drivers.espec.codec import (
    END,
    RESOLUTION_C,
    decode_alarms,
    decode_temperatures,
    encode_line,
    ramp_text,
    refusal_words,
    set_temperature_text,
)
from drivers.kit.chamber import PolledChamber
from drivers.kit.config import ChamberConfig, key
from drivers.kit.instruments import ChamberCapabilities, ChamberLimits, ChamberState, Identity, require_ramp
from drivers.kit.kinds import Connection
from drivers.kit.retry import command_with_retry, misfit, pass_over, query_with_retry

REPLY_TIMEOUT_S = 3.0
"""What the maker's own library allows."""

_RESTING = ("OFF", "STANDBY")
_PROGRAM = "RUN PRGM"

_T = TypeVar("_T")


class EspecConfig(ChamberConfig):
    """`[chamber]` of an ESPEC; without `address` it is on RS-232 or TCP."""

    simserv: Literal[True] = key(default=True, exclude=True, description="none: an ESPEC has no SimServ")
    start_channel: Literal[1] = key(
        default=1, exclude=True, description="none: an ESPEC is started by its mode"
    )


class EspecChamber(PolledChamber):
    """One chamber (`drivers.kit.instruments.Chamber`) at a serial port or TCP port 10001.

    `rom`: how the ROM version of this controller begins, "" for whatever does not begin with P3.

    The controller has no slew rate: a ramp is a remote program of one step, from the present air temperature
    to the set point in whole minutes. A ramp demanded while the chamber stands begins when it is started.
    """

    _known_by = "the ROM version of that controller, and types of sensors"
    _answer_end, _answer_s = END, REPLY_TIMEOUT_S
    _check = "check which device the bench file names for this port, its address, and P-300 or SCP-220"

    def __init__(self, config: EspecConfig, connection: Connection, *, model: str, rom: str) -> None:
        super().__init__(connection.link(config.port, config.baudrate), connection.safe_set_point_c)
        self.model = model
        self.address = config.address
        self._product = f"an ESPEC chamber with a {model} controller"
        self._rom = rom
        self._demand: tuple[float, float | None] | None = None

    def _introduction(self) -> Identity:
        """Ask ROM version and type, which must fit the controller."""
        rom, kind = self._query("ROM?", str), self._query("TYPE?", str)
        fits = rom.startswith("P3") if self._rom else not rom.startswith("P3")
        if not fits or kind.count(",") not in (2, 3):
            raise self._odd(f"ROM {rom!r}, type {kind!r}", self._known_by)
        details = {"TYPE?": kind, "ROM?": rom}
        return Identity("ESPEC", self.model, firmware=rom, details=details)

    def capabilities(self) -> ChamberCapabilities:
        """Tenths of a degree; ramps by remote programs of whole minutes, at most 99 h 59 min long; no
        sensors."""
        return ChamberCapabilities(RESOLUTION_C, (0.01, 1000.0), ())

    def limits(self) -> ChamberLimits:
        """Read the limits at which the chamber raises an alarm."""
        temperatures = self._query("TEMP?", decode_temperatures)
        return ChamberLimits(temperatures.lower_c, temperatures.upper_c)

    def set_temperature(self, set_point_c: float, ramp_k_per_min: float | None = None) -> None:
        """Demand a set point, by a remote program if there is a ramp.

        A chamber that runs is not told the set point as well, which it would go to at once; the end of a remote
        program is held (its detailed mode is then RMT RUN END HOLD).
        """
        require_ramp(self.capabilities(), set_point_c, ramp_k_per_min, self._where)
        running = self._is_running()
        self._demand = (set_point_c, ramp_k_per_min)
        if ramp_k_per_min is None or not running:
            self._demand_constant(set_point_c)
        if running:
            self._switch(True)

    def request_state(self) -> None:
        """Send `TEMP?` without waiting; `read_state` must follow before anything else."""
        self._ask_state(encode_line("TEMP?", self.address))

    def read_state(self) -> ChamberState:
        """Take the answer to `request_state`: resolution 0.1 degC."""
        temperatures = self._collected(
            self.request_state, lambda: self._decoded(decode_temperatures, self._reply("TEMP?"))
        )
        return ChamberState(temperatures.measured_c, temperatures.set_point_c)

    def alarms(self) -> list[str]:
        """Return active alarms by their code; what it means stands in the manual of the chamber."""
        codes = self._query("ALARM?", decode_alarms)
        return [f"alarm {code} (see the alarm list of the chamber's manual)" for code in codes]

    def in_step(self) -> bool:
        """Ask for the type, whose answer alone begins with a letter and has commas: T,S2,160.0."""

        def is_type(timeout_s: float) -> bool:
            reply = self.link.read_until(END, timeout_s).strip()
            return reply[:1].isalpha() and b"," in reply and b":" not in reply

        self._settle_input()
        self.link.write(encode_line("TYPE?", self.address))
        return pass_over(self.link, REPLY_TIMEOUT_S, is_type)

    def _send_stop(self) -> None:
        self.link.write(END)
        for text in self._safe_commands():
            self.link.write(encode_line(text, self.address))

    def _way_to_rest(self) -> Iterable[Callable[[], None]]:
        self._demand = None
        return [partial(self._confirm, text) for text in self._safe_commands()]

    def _confirm(self, text: str) -> None:
        """Wait for the confirmation of a command that was sent, other replies passed over; else send it again."""
        keyword = text.replace(" ", "")
        with contextlib.suppress(DeviceSilent):
            while True:
                reply = self.link.read_until(END, REPLY_TIMEOUT_S).decode("latin-1").strip()
                if reply.startswith("OK:") and reply.replace(" ", "")[3:] == keyword:
                    return
        self._tell(text)

    def _safe_commands(self) -> tuple[str, str]:
        return ("MODE,STANDBY", set_temperature_text(self.safe_set_point_c))

    def _switch(self, on: bool) -> None:
        """Start with the ramp demanded before, if there is one, or go to standby."""
        if not on or self._demand is None or self._demand[1] is None:
            mode = "CONSTANT" if on else "STANDBY"
            command_with_retry(
                self.link, lambda: self._tell(f"MODE,{mode}"), lambda: self._query("MODE?", str) == mode
            )
            return
        set_point_c, ramp = self._demand[0], self._demand[1]
        program = ramp_text(self._query("TEMP?", decode_temperatures).measured_c, set_point_c, ramp)
        command_with_retry(
            self.link, lambda: self._tell(program)
        )  # another program may have been running before

    def _demand_constant(self, set_point_c: float) -> None:
        def in_force() -> bool:
            return math.isclose(self._demanded_c(), set_point_c, rel_tol=0.0, abs_tol=RESOLUTION_C)

        command_with_retry(self.link, lambda: self._tell(set_temperature_text(set_point_c)), in_force)

    def _is_running(self) -> bool:
        return self._query("MODE?", self._mode) not in _RESTING

    def _demanded_c(self) -> float:
        return self._query("TEMP?", decode_temperatures).set_point_c

    def _mode(self, reply: str) -> str:
        if not reply.isascii() or not reply.replace(" ", "").isalnum():
            raise self._odd(repr(reply), "OFF, STANDBY, CONSTANT or RUN")
        return reply

    def _query(self, text: str, read: Callable[[str], _T]) -> _T:
        """Ask and return what `read` makes of the answer."""
        return query_with_retry(self.link, lambda: self._decoded(read, self._ask(text)))

    def _decoded(self, read: Callable[[str], _T], reply: str) -> _T:
        try:
            return read(reply)
        except ProtocolError as error:
            raise self._odd(error.found, error.expected) from error

    def _tell(self, text: str) -> None:
        """Send a command and take its confirmation, which repeats it; of a program only that it is one."""
        reply = self._ask(text)
        echo, sent = reply.removeprefix("OK:").replace(" ", ""), text.replace(" ", "")
        of_program = text.startswith(_PROGRAM) and echo.startswith(_PROGRAM.replace(" ", ""))
        if not reply.startswith("OK:") or (echo != sent and not of_program):
            raise self._odd(repr(reply), f"OK: in answer to {text!r}")

    def _ask(self, text: str) -> str:
        self._settle_input()
        self.link.write(encode_line(text, self.address))
        return self._reply(text)

    def _reply(self, asked: str) -> str:
        reply = self.link.read_until(END, REPLY_TIMEOUT_S).decode("latin-1").strip()
        if reply.startswith("NA:"):
            raise DeviceRefused(
                f"the chamber refused {asked!r}",
                where=self._where,
                found=refusal_words(reply[3:]),
                expected="OK or a value",
                remedy="check the demand against the chamber's limits and that its panel allows remote control",
            )
        return reply

    def _odd(self, found: str, expected: str) -> ProtocolError:
        return misfit("chamber", self._where, found, expected)
