"""Driver of an ACUTROL3000 table of one or more axes: demands, telemetry, faults, and the way to rest."""

from __future__ import annotations

import contextlib

from drivers.acutrol._exchange import REPLY_TIMEOUT_S, AcutrolExchanges
from drivers.acutrol.codec import (
    DIAGNOSTIC_BITS,
    ERROR_BITS,
    INTERLOCK_BITS,
    SOFTWARE_FAULT_BITS,
    STATE_BITS,
    bits_in_words,
    encode_command,
    encode_state_query,
)
from drivers.base.errors import DeviceRefused, ProtocolError, WrongDevice
from drivers.kit.config import TableConfig
from drivers.kit.instruments import Identity, Rest, TableLimits, TableState
from drivers.kit.kinds import Connection
from drivers.kit.polled import REST_DPS, TROUBLES
from drivers.kit.retry import pass_over

SERVO_TIMEOUT_S = 10.0
"""Drive enable delay (parameter x029) and fail-safe test delays run before the interlock reports Close."""

SERVO_PAUSE_S = 0.25
"""Between interlock commands; public drivers wait 0.2 to 0.5 s."""

_FAULT_STATES = ("software abort", "hardware abort")


class AcutrolTable(AcutrolExchanges):
    """A table behind an ACUTROL3000, over RS-232 or TCP alike (`drivers.kit.instruments.Turntable`)."""

    _product = "an ACUTROL3000"
    _known_by = "four fields: maker, Acutrol3000, serial number, firmware"
    _wrong_if = (ProtocolError,)

    def __init__(self, config: TableConfig, connection: Connection) -> None:
        super().__init__(connection.link(config.port, config.baudrate))
        self._numbers_by_name = {axis.name: axis.number for axis in config.all_axes}
        self.axes = tuple(self._numbers_by_name)
        self._closed_by_us, self._marked = False, True

    def _introduction(self) -> Identity:
        """Ask `*IDN?`: maker, model, serial number, firmware; the model is to be an Acutrol3000."""
        text = self._query(str, "*IDN?")
        fields = [field.strip() for field in text.split(",", 3)]
        if len(fields) != 4 or not fields[1].lower().startswith("acutrol3000"):
            raise self._wrong_device(repr(text))
        maker, model, serial_number, firmware = fields
        return Identity(maker, model, serial_number, firmware, {"*IDN?": text})

    def limits(self, axis: str = "") -> TableLimits:
        """Read the rate-mode limits in force; positions are None where their span is a full turn or more.

        The controller applies position limits to axes configured for limited motion only and has no query for
        that; a limited rotary axis spans less than a turn, a continuous one keeps the default of a whole turn.
        """
        number = self._number(axis)
        rate = self._ask_number(":limit:rate?", "rate", number)
        acceleration = self._ask_number(":limit:acceleration?", "rate", number)
        low, high = self._query(self._position_limits, ":limit:absolute?", number)
        continuous = high - low >= 360.0
        return TableLimits(rate, acceleration, None if continuous else low, None if continuous else high)

    def limit_turns(
        self, max_rate_dps: float, axis: str = "", max_acceleration_dps2: float | None = None
    ) -> None:
        """Set the limits of position mode; those of rate mode, which `limits` reads, stay as they are."""
        number = self._number(axis)
        self._command(":limit:rate", "position", number, float(max_rate_dps))
        if max_acceleration_dps2 is not None:
            self._command(":limit:acceleration", "position", number, float(max_acceleration_dps2))

    def servo_on(self) -> None:
        """Reset and close the interlock and wait until the controller reports Close, else DeviceRefused.

        The mode is set to Off (zero rate) first, so that closing never starts an old demand.
        """
        for number in self._numbers_by_name.values():
            self._command(":mode:off", number)
            self._command(":interlock:reset", number)
            self.link.clock.sleep(SERVO_PAUSE_S)
            self._command(":interlock:close", number)
            deadline = self.link.clock.now() + SERVO_TIMEOUT_S
            while (state := self._interlock(number)) != "close":
                if state == "fault" or self.link.clock.now() >= deadline:
                    raise self._not_closed(state)
                self.link.clock.sleep(SERVO_PAUSE_S)
        self._closed_by_us = True

    def home(self, axis: str = "") -> None:
        """Demand position 0: the encoders are absolute, and `:Mode:Home` is marked as future in the manual."""
        self.point(0.0, axis)

    def point(self, angle_deg: float, axis: str = "") -> None:
        """Demand an angle in position mode; a continuous axis takes the shortest path."""
        self._demand("position", angle_deg, self._number(axis))

    def turn(self, by_deg: float, axis: str = "") -> None:
        """Demand a relative position (`:Demand:DeltaPosition`), in position mode at the present angle first."""
        self._require_finite(by_deg)
        number = self._number(axis)
        before_deg = self._ask_number(":read:position?", number)
        if not self._mode(number).startswith("p"):
            self._demand("position", before_deg, number)
        self._turn_once(
            lambda: self._tell(":demand:deltaposition", number, float(by_deg)),
            before_deg,
            lambda: self._ask_number(":read:position?", number),
            lambda: self._ask_number(":read:rate?", number),
        )

    def spin(self, rate_dps: float, axis: str = "", acceleration_dps2: float | None = None) -> None:
        """Demand a rate in rate mode, within an acceleration limit of that mode if one is given."""
        number = self._number(axis)
        if acceleration_dps2 is not None:
            self._command(":limit:acceleration", "rate", number, float(acceleration_dps2))
        self._demand("rate", rate_dps, number)

    def request_state(self) -> None:
        """Ask for angle and rate without waiting; `read_state` must follow before any other exchange."""
        self._marked = not self._marked
        self._ask_state(encode_state_query(*self._numbers_by_name.values(), marked=self._marked))

    def read_state(self) -> TableState:
        """Take the answer to `request_state`."""
        numbers = self._collected(self.request_state, lambda: self._take(2 * len(self.axes) + self._marked))
        outer = {
            name: TableState(numbers[2 * place], numbers[2 * place + 1])
            for place, name in enumerate(self.axes[:-1])
        }
        last = 2 * len(self.axes) - 2
        return TableState(numbers[last], numbers[last + 1], outer)

    def in_step(self) -> bool:
        """Ask for the identification, the one answer with its model in it."""
        self._settle_input()
        self.link.write(encode_command("*IDN?"))
        return pass_over(
            self.link, REPLY_TIMEOUT_S, lambda left_s: "acutrol" in self._read_reply(left_s).text.lower()
        )

    def alarms(self) -> list[str]:
        """Return interlock fault, aborts, software faults and interlock inputs in words.

        With any of them come axis errors and what the diagnostics of the axis' electronics say: warnings, and
        errors of long ago, are no alarms of their own. An open interlock counts only if this driver closed it:
        somebody else opened it. Of several axes each alarm says which.
        """
        alarms = []
        for name, number in self._numbers_by_name.items():
            prefix = f"{name}: " if len(self.axes) > 1 else ""
            alarms += [prefix + text for text in self._alarms_of(number)]
        return alarms

    def _alarms_of(self, number: int) -> list[str]:
        interlock = self._interlock(number)
        alarms = []
        if interlock == "fault":
            alarms.append("interlock fault")
        elif interlock == "open" and self._closed_by_us:
            alarms.append("interlock opened by someone else: the axis is not servoed")
        state = bits_in_words(self._register(number, "STATE"), STATE_BITS)
        alarms += [words for words in state if words in _FAULT_STATES]
        alarms += bits_in_words(self._register(number, "SWFLT"), SOFTWARE_FAULT_BITS)
        alarms += bits_in_words(self._register(number, "INTLK"), INTERLOCK_BITS)
        for name, words in (("ERR", ERROR_BITS), ("DIAG", DIAGNOSTIC_BITS)) if alarms else ():
            with contextlib.suppress(DeviceRefused):  # they explain a fault, and not every firmware has them
                alarms += bits_in_words(self._register(number, name), words)
        return alarms

    def _send_stop(self) -> None:
        """Demand Off mode (servoed, zero rate) of every axis.

        Starts with a line end, which closes a command that was cut off halfway.
        """
        self.link.write(b"\r")
        self.link.write(encode_command(":mode:off", self._all))

    def make_safe(self) -> None:
        """Stop the axes: Off mode, else an open interlock; raises if neither is confirmed.

        What `halt` has sent is not sent again. Replies to its line end and to earlier questions are passed over
        until the controller says OK.
        """
        self._once_halted()
        try:
            self._await_confirmation(":mode:off")
        except TROUBLES:
            self._closed_by_us = False
            self._insist(":interlock:open", self._all)

    def read_rest(self) -> Rest:
        """Read the rates: at rest when that of every axis is below 0.01 deg/s."""
        state = self.state()
        rates = {**{name: axis.rate_dps for name, axis in state.outer.items()}, self.axes[-1]: state.rate_dps}
        return Rest(all(abs(rate) < REST_DPS for rate in rates.values()), rates)

    def _demand(self, mode: str, value: float, number: int) -> None:
        """Demand before and after a change of mode: an old demand never runs, whichever the device keeps."""
        self._require_finite(value)
        if not self._mode(number).startswith(mode[0]):
            self._command(f":demand:{mode}", number, float(value))
            self._command(f":mode:{mode}", number)
        self._command(f":demand:{mode}", number, float(value))

    def _number(self, axis: str) -> int:
        """Return the controller's number of an axis; "" is the last one, which carries the unit."""
        return self._numbers_by_name[self._require_axis(axis)]

    @property
    def _all(self) -> int | str:
        """What a command calls all axes: the number of an only one, else ALL (TM-8004-C 2)."""
        return self._number("") if len(self.axes) == 1 else "ALL"

    def _mode(self, number: int) -> str:
        return self._ask_word(":mode?", number)

    def _interlock(self, number: int) -> str:
        return self._ask_word(":interlock?", number)

    def _position_limits(self, text: str) -> tuple[float, ...]:
        count = text.replace(";", ",").count(",") + 1
        if count < 5:
            raise self._misfit(text, "rate, acceleration, jerk, low and high position limits")
        return self._numbers(text, count)[3:5]

    def _register(self, number: int, name: str) -> int:
        def word(text: str) -> int:
            if not text.isdecimal():
                raise self._misfit(text, f"status word A{number}{name} as an integer")
            return int(text)

        return self._query(word, ":status:csr?", f"A{number}{name}")

    @property
    def _where(self) -> str:
        numbers = ", ".join(str(number) for number in self._numbers_by_name.values())
        return f"{self.link.where}, axis {numbers}"

    def _not_closed(self, state: str) -> DeviceRefused:
        causes = "; ".join(self.alarms())
        return DeviceRefused(
            "the interlock does not close",
            where=self._where,
            found=f"interlock {state}" + (f" ({causes})" if causes else ""),
            expected="interlock close after reset and close",
            remedy="check emergency stop, doors, power amplifier and the controller's front panel",
        )

    def _wrong_device(self, found: str) -> WrongDevice:
        return super()._wrong_device(f"{found} in answer to *IDN?")
