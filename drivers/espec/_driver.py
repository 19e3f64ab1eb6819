"""Driver of an ESPEC chamber with a P-300 or SCP-220 controller."""

from __future__ import annotations

import math

from drivers.errors import DeviceRefused, DeviceSilent, ProtocolError, WrongDevice
from drivers.espec._codec import (
    END,
    MINUTE_S,
    RESOLUTION_C,
    Temperatures,
    decode_alarms,
    decode_temperatures,
    encode_line,
    ramp_text,
    refusal_words,
    set_temperature_text,
)
from drivers.instruments import (
    ChamberCapabilities,
    ChamberLimits,
    ChamberState,
    Identity,
    Rest,
    require_ramp,
)
from drivers.link import Link

REPLY_TIMEOUT_S = 3.0
"""What the maker's own library allows."""

START_TIMEOUT_S = 10.0
START_PAUSE_S = 0.5

_RESTING = ("OFF", "STANDBY")


class EspecChamber:
    """One chamber (`drivers.instruments.Chamber`) at a serial port or TCP port 10001.

    `address`: on RS-485, None on RS-232 and TCP. `rom`: how the ROM version of this controller begins, "" for
    whatever does not begin with P3.

    The controller has no slew rate: a ramp is a remote program of one step, from the present air temperature
    to the set point in whole minutes. A ramp demanded while the chamber stands begins when it is started.
    """

    def __init__(
        self,
        link: Link,
        *,
        model: str,
        rom: str,
        address: int | None = None,
        safe_set_point_c: float = 23.0,
    ) -> None:
        self.link = link
        self.model = model
        self.address = address
        self.safe_set_point_c = safe_set_point_c
        self._rom = rom
        self._demand: tuple[float, float | None] | None = None
        self._state_asked = False
        self._halted = False

    def identify(self) -> Identity:
        """Ask ROM version and type; WrongDevice unless both fit the controller."""
        try:
            rom, kind = self._ask("ROM?"), self._ask("TYPE?")
        except (ProtocolError, DeviceRefused) as error:
            raise self._wrong_device(error.found) from error
        except DeviceSilent as error:
            if not (seen := self.link.discard()):
                raise
            raise self._wrong_device(repr(seen[:60])) from error
        fits = rom.startswith("P3") if self._rom else not rom.startswith("P3")
        if not fits or kind.count(",") not in (2, 3):
            raise self._wrong_device(f"ROM {rom!r}, type {kind!r}")
        details = {"TYPE?": kind, "ROM?": rom}
        return Identity("ESPEC", self.model, firmware=rom, details=details)

    def capabilities(self) -> ChamberCapabilities:
        """Tenths of a degree; ramps by remote programs of whole minutes, at most 99 h 59 min long; no
        sensors."""
        return ChamberCapabilities(RESOLUTION_C, (0.01, 1000.0), (), MINUTE_S)

    def limits(self) -> ChamberLimits:
        """Read the limits at which the chamber raises an alarm."""
        temperatures = self._temperatures()
        return ChamberLimits(temperatures.lower_c, temperatures.upper_c)

    def start(self) -> None:
        """Start conditioning, with the ramp demanded before if there is one; DeviceRefused if it does not
        run."""
        self._begin()
        self._await_running(True)

    def stop(self) -> None:
        """Go to standby; DeviceRefused if the chamber does not within 10 s."""
        self._command("MODE,STANDBY")
        self._await_running(False)

    def set_temperature(self, set_point_c: float, ramp_k_per_min: float | None = None) -> None:
        """Demand a set point, by a remote program if there is a ramp.

        A chamber that runs is not told the set point as well, which it would go to at once; the end of a remote
        program is held (its detailed mode is then RMT RUN END HOLD).
        """
        require_ramp(self.capabilities(), set_point_c, ramp_k_per_min, self._where)
        running = self._is_running()
        self._demand = (set_point_c, ramp_k_per_min)
        if ramp_k_per_min is None or not running:
            self._command(set_temperature_text(set_point_c))
        if running:
            self._begin()

    def state(self) -> ChamberState:
        """Read air and set point."""
        self.request_state()
        return self.read_state()

    def request_state(self) -> None:
        """Send `TEMP?` without waiting; `read_state` must follow before anything else."""
        self._settle_input()
        self.link.write(encode_line("TEMP?", self.address))
        self._state_asked = True

    def read_state(self) -> ChamberState:
        """Take the answer to `request_state`: resolution 0.1 degC."""
        self._state_asked = False
        temperatures = self._decoded(self._reply())
        return ChamberState(temperatures.measured_c, temperatures.set_point_c)

    def alarms(self) -> list[str]:
        """Return active alarms by their code; what it means stands in the manual of the chamber."""
        return [f"alarm {code} (see the alarm list of the chamber's manual)" for code in self._alarm_codes()]

    def halt(self) -> None:
        """Send what stops conditioning and sets the safe set point, and wait for nothing.

        Starts with a line end, which closes a command that was cut off halfway.
        """
        self._state_asked = False
        self.link.discard()
        self.link.write(END)
        for text in self._safe_commands():
            self.link.write(encode_line(text, self.address))
        self._halted = True

    def make_safe(self) -> None:
        """Go to standby with the safe set point; raises what was not confirmed.

        What `halt` has sent is sent again only if its own confirmation does not come: replies to its line end
        and to earlier questions are passed over.
        """
        if not self._halted:
            self.halt()
        self._halted = False
        self._demand = None
        problems = []
        for text in self._safe_commands():
            try:
                if not self._confirmed(text):
                    self._command(text)
            except (DeviceRefused, DeviceSilent, ProtocolError) as error:
                problems.append(error)
        if problems:
            raise problems[0]

    def read_rest(self) -> Rest:
        """Read mode and set point: at rest in standby or off with the safe set point."""
        mode, set_point_c = self._ask("MODE?"), self._temperatures().set_point_c
        safe = math.isclose(set_point_c, self.safe_set_point_c, rel_tol=0.0, abs_tol=RESOLUTION_C)
        return Rest(safe and mode in _RESTING, f"{mode.lower()}, set point {set_point_c:g} degC")

    def _safe_commands(self) -> tuple[str, str]:
        return ("MODE,STANDBY", set_temperature_text(self.safe_set_point_c))

    def _begin(self) -> None:
        if self._demand is None or self._demand[1] is None:
            self._command("MODE,CONSTANT")
        else:
            set_point_c, ramp = self._demand[0], self._demand[1]
            self._command(ramp_text(self._temperatures().measured_c, set_point_c, ramp))

    def _is_running(self) -> bool:
        return self._ask("MODE?") not in _RESTING

    def _await_running(self, on: bool) -> None:
        deadline = self.link.clock.now() + START_TIMEOUT_S
        while self._is_running() is not on:
            if self.link.clock.now() >= deadline:
                raise self._not_switched(on)
            self.link.clock.sleep(START_PAUSE_S)

    def _temperatures(self) -> Temperatures:
        return self._decoded(self._ask("TEMP?"))

    def _decoded(self, reply: str) -> Temperatures:
        try:
            return decode_temperatures(reply)
        except ProtocolError as error:
            raise self._odd(error.found, error.expected) from error

    def _alarm_codes(self) -> list[int]:
        reply = self._ask("ALARM?")
        try:
            return decode_alarms(reply)
        except ProtocolError as error:
            raise self._odd(error.found, error.expected) from error

    def _ask(self, text: str) -> str:
        self._settle_input()
        self.link.write(encode_line(text, self.address))
        return self._reply(text)

    def _command(self, text: str) -> None:
        reply = self._ask(text)
        if not reply.startswith("OK:"):
            raise self._odd(repr(reply), f"OK: in answer to {text!r}")

    def _confirmed(self, text: str) -> bool:
        """Return whether the confirmation of a command comes, other replies passed over."""
        keyword = text.replace(" ", "")
        try:
            while True:
                reply = self.link.read_until(END, REPLY_TIMEOUT_S).decode("latin-1").strip()
                if reply.startswith("OK:") and reply.replace(" ", "")[3:] == keyword:
                    return True
        except DeviceSilent:
            return False

    def _reply(self, asked: str = "TEMP?") -> str:
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

    def _settle_input(self) -> None:
        """Take the answer to a state question nobody read, then drop late answers."""
        if self._state_asked:
            self._state_asked = False
            self.link.read_until(END, REPLY_TIMEOUT_S)
        self.link.discard()

    @property
    def _where(self) -> str:
        return f"{self.link.name} ({self.link.url})"

    def _not_switched(self, on: bool) -> DeviceRefused:
        return DeviceRefused(
            f"the chamber took the command and did not {'start' if on else 'stop'}",
            where=self._where,
            found="; ".join(self.alarms()) or "no alarm",
            expected=f"mode {'CONSTANT or RUN' if on else 'STANDBY'} within {START_TIMEOUT_S:g} s",
            remedy="check door and alarms",
        )

    def _odd(self, found: str, expected: str) -> ProtocolError:
        return ProtocolError(
            "the chamber's answer does not fit the question",
            where=self._where,
            found=found,
            expected=expected,
            remedy="check the line for lost bytes and that nobody else talks to this port",
        )

    def _wrong_device(self, found: str) -> WrongDevice:
        return WrongDevice(
            f"not an ESPEC chamber with a {self.model} controller",
            where=self._where,
            found=found,
            expected="a ROM version that begins with P3 and a type" if self._rom else "an SCP-220's type",
            remedy="check which device the bench file names for this port, and its address on RS-485",
        )
