"""Driver of an ACUTROL3000 table of one or more axes: demands, telemetry, faults, and the way to rest."""

from __future__ import annotations

import math
from collections.abc import Mapping

from drivers.acutrol._codec import (
    DYNAMIC_BITS,
    HEADER_BYTES,
    INTERLOCK_BITS,
    SOFTWARE_FAULT_BITS,
    STATE_BITS,
    Reply,
    bits_in_words,
    decode_header,
    decode_numbers,
    decode_text,
    encode_command,
    encode_state_query,
)
from drivers.errors import BenchError, DeviceRefused, DeviceSilent, ProtocolError, WrongDevice
from drivers.instruments import Identity, Rest, TableLimits, TableState
from drivers.link import Link

REPLY_TIMEOUT_S = 2.0
"""A reply takes about 2 ms over Ethernet, 40 ms and more through a device server at 9600 baud."""

SERVO_TIMEOUT_S = 10.0
"""Drive enable delay (parameter x029) and fail-safe test delays run before the interlock reports Close."""

SERVO_PAUSE_S = 0.25
"""Between interlock commands; public drivers wait 0.2 to 0.5 s."""

_REST_DPS = 0.01
"""Below this an axis stands still; its rate estimate has noise of some 1e-4 deg/s."""

_FAULT_STATES = ("software abort", "hardware abort")


class AcutrolTable:
    """A table behind an ACUTROL3000, over RS-232 or TCP alike (`drivers.instruments.Turntable`).

    `axes`: name of each axis, outermost first, and its number on the controller.

    Every exchange has a deadline (DeviceSilent), a reply that is not one raises ProtocolError, and an error code
    raises DeviceRefused with the controller's own text and the top of its error queue.
    """

    def __init__(self, link: Link, *, axes: Mapping[str, int] | None = None) -> None:
        self.link = link
        self._numbers_by_name = dict(axes or {"table": 1})
        self.axes = tuple(self._numbers_by_name)
        self._closed_by_us = False
        self._state_asked = False
        self._halted = False

    def identify(self) -> Identity:
        """Ask `*IDN?`: maker, model, serial number, firmware; WrongDevice unless the model is an Acutrol3000."""
        try:
            text = self._ask("*IDN?")
        except ProtocolError as error:
            raise self._wrong_device(error.found) from error
        except DeviceSilent as error:
            if not (seen := self.link.discard()):
                raise
            raise self._wrong_device(repr(seen[:60])) from error
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
        (rate,) = self._numbers(self._ask(":limit:rate?", "rate", number), 1)
        (acceleration,) = self._numbers(self._ask(":limit:acceleration?", "rate", number), 1)
        absolute = self._ask(":limit:absolute?", number)
        count = absolute.replace(";", ",").count(",") + 1
        if count < 5:
            raise self._protocol_error(absolute, "rate, acceleration, jerk, low and high position limits")
        low, high = self._numbers(absolute, count)[3:5]
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

    def servo_off(self) -> None:
        """Open the interlock: the controller shuts the axes down in an orderly fashion."""
        self._closed_by_us = False
        self._command(":interlock:open", self._all)

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
        if not self._mode(number).startswith("p"):
            (angle_deg,) = self._numbers(self._ask(":read:position?", number), 1)
            self._demand("position", angle_deg, number)
        self._command(":demand:deltaposition", number, float(by_deg))

    def spin(self, rate_dps: float, axis: str = "", acceleration_dps2: float | None = None) -> None:
        """Demand a rate in rate mode, within an acceleration limit of that mode if one is given."""
        number = self._number(axis)
        if acceleration_dps2 is not None:
            self._command(":limit:acceleration", "rate", number, float(acceleration_dps2))
        self._demand("rate", rate_dps, number)

    def state(self) -> TableState:
        """Read angle and rate in one exchange."""
        self.request_state()
        return self.read_state()

    def request_state(self) -> None:
        """Ask for angle and rate without waiting; `read_state` must follow before any other exchange."""
        self._settle_input()
        self.link.write(encode_state_query(*self._numbers_by_name.values()))
        self._state_asked = True

    def read_state(self) -> TableState:
        """Take the answer to `request_state`."""
        self._state_asked = False
        text = self._accepted(self._read_reply(REPLY_TIMEOUT_S), "state poll")
        numbers = self._numbers(text, 2 * len(self.axes))
        outer = {
            name: TableState(numbers[2 * at], numbers[2 * at + 1]) for at, name in enumerate(self.axes[:-1])
        }
        return TableState(numbers[-2], numbers[-1], outer)

    def settled(self, axis: str = "") -> bool:
        """Return whether the demanded profile is complete (A<n>DYN, the bit of the mode in force)."""
        number = self._number(axis)
        mode = "position" if self._mode(number).startswith("p") else "rate"
        return f"{mode} profile complete" in bits_in_words(self._register(number, "DYN"), DYNAMIC_BITS)

    def alarms(self) -> list[str]:
        """Return interlock fault, aborts, software faults and interlock inputs in words.

        An open interlock counts only if this driver closed it: somebody else opened it. Of several axes each
        alarm says which.
        """
        found = []
        for name, number in self._numbers_by_name.items():
            prefix = f"{name}: " if len(self.axes) > 1 else ""
            found += [prefix + text for text in self._alarms_of(number)]
        return found

    def _alarms_of(self, number: int) -> list[str]:
        interlock = self._interlock(number)
        found = []
        if interlock == "fault":
            found.append("interlock fault")
        elif interlock == "open" and self._closed_by_us:
            found.append("interlock opened by someone else: the axis is not servoed")
        state = bits_in_words(self._register(number, "STATE"), STATE_BITS)
        found += [words for words in state if words in _FAULT_STATES]
        found += bits_in_words(self._register(number, "SWFLT"), SOFTWARE_FAULT_BITS)
        return found + bits_in_words(self._register(number, "INTLK"), INTERLOCK_BITS)

    def halt(self) -> None:
        """Demand Off mode (servoed, zero rate) of every axis and wait for nothing.

        Starts with a line end, which closes a command that was cut off halfway.
        """
        self._state_asked = False
        self.link.discard()
        self.link.write(b"\r")
        self.link.write(encode_command(":mode:off", self._all))
        self._halted = True

    def make_safe(self) -> None:
        """Stop the axes: Off mode, else an open interlock; raises if neither is confirmed.

        What `halt` has sent is not sent again. Replies to its line end and to earlier questions are passed over
        until the controller says OK.
        """
        if not self._halted:
            self.halt()
        self._halted = False
        try:
            self._await_confirmation(":mode:off")
        except (DeviceRefused, DeviceSilent, ProtocolError):
            self._closed_by_us = False
            self._insist(":interlock:open")

    def read_rest(self) -> Rest:
        """Read the rates: at rest when that of every axis is below 0.01 deg/s."""
        state = self.state()
        rates = {**{name: axis.rate_dps for name, axis in state.outer.items()}, self.axes[-1]: state.rate_dps}
        named = len(rates) > 1
        text = ", ".join(f"{name + ' ' if named else ''}{rate:.4f} deg/s" for name, rate in rates.items())
        return Rest(all(abs(rate) < _REST_DPS for rate in rates.values()), text)

    def _demand(self, mode: str, value: float, number: int) -> None:
        """Demand before and after a change of mode: an old demand never runs, whichever the device keeps."""
        self._require_finite(value)
        if not self._mode(number).startswith(mode[0]):
            self._command(f":demand:{mode}", number, float(value))
            self._command(f":mode:{mode}", number)
        self._command(f":demand:{mode}", number, float(value))

    def _require_finite(self, value: float) -> None:
        if not math.isfinite(value):
            raise DeviceRefused(
                "a demand is not a number", where=self._where, found=str(value), expected="a finite number"
            )

    def _number(self, axis: str) -> int:
        """Return the controller's number of an axis; "" is the last one, which carries the unit."""
        name = axis or self.axes[-1]
        if name not in self._numbers_by_name:
            raise DeviceRefused(
                "the table has no such axis", where=self._where, found=name, expected=" or ".join(self.axes)
            )
        return self._numbers_by_name[name]

    @property
    def _all(self) -> int | str:
        """What a command calls all axes: the number of an only one, else ALL (TM-8004-C 2)."""
        return self._number("") if len(self.axes) == 1 else "ALL"

    def _mode(self, number: int) -> str:
        return self._ask(":mode?", number).lower()

    def _interlock(self, number: int) -> str:
        return self._ask(":interlock?", number).lower()

    def _numbers(self, text: str, count: int) -> tuple[float, ...]:
        try:
            return decode_numbers(text, count)
        except ProtocolError as problem:
            raise self._protocol_error(text, problem.expected) from problem

    def _register(self, number: int, name: str) -> int:
        text = self._ask(":status:csr?", f"A{number}{name}")
        if not text.isdecimal():
            raise self._protocol_error(text, f"status word A{number}{name} as an integer")
        return int(text)

    def _command(self, header: str, *arguments: int | float | str) -> None:
        text = self._ask(header, *arguments)
        if text.upper() not in ("", "OK"):
            raise self._protocol_error(text, f"OK or an empty answer to {header}")

    def _ask(self, header: str, *arguments: int | float | str) -> str:
        reply = self._exchange(header, *arguments)
        return self._accepted(reply, encode_command(header, *arguments).decode("ascii").strip())

    def _exchange(self, header: str, *arguments: int | float | str) -> Reply:
        self._settle_input()
        self.link.write(encode_command(header, *arguments))
        return self._read_reply(REPLY_TIMEOUT_S)

    def _settle_input(self) -> None:
        """Take the answer to a state poll nobody read, then drop late answers."""
        if self._state_asked:
            self._state_asked = False
            self._read_reply(REPLY_TIMEOUT_S)
        self.link.discard()

    def _read_reply(self, timeout_s: float) -> Reply:
        deadline = self.link.clock.now() + timeout_s
        header = self.link.read_exactly(HEADER_BYTES, timeout_s)
        try:
            error, length = decode_header(header)
        except ProtocolError as problem:
            rest = self.link.discard()
            raise self._protocol_error((header + rest[:60]).decode("latin-1"), problem.expected) from problem
        text = self.link.read_exactly(length, max(0.0, deadline - self.link.clock.now()))
        return Reply(error, decode_text(text))

    def _accepted(self, reply: Reply, request: str) -> str:
        if reply.error == 0:
            return reply.text
        queue = self._exchange(":Status:MSG?", "QERROR")
        raise self._refused(request, reply, queue.text if queue.error == 0 else "")

    def _insist(self, header: str) -> None:
        """Send a command and wait until it is confirmed."""
        self.link.write(encode_command(header, self._all))
        self._await_confirmation(header)

    def _await_confirmation(self, header: str) -> None:
        """Pass over replies to older commands until the last one sent is confirmed."""
        deadline = self.link.clock.now() + REPLY_TIMEOUT_S
        problem: BenchError | None = None
        while (left_s := deadline - self.link.clock.now()) > 0.0:
            try:
                reply = self._read_reply(left_s)
            except ProtocolError as error:
                problem = error
                continue
            except DeviceSilent as error:
                raise (problem or error) from error
            if reply.error == 0 and reply.text.upper() in ("", "OK"):
                return
            problem = self._refused(header, reply, "")
        raise problem or self._protocol_error("nothing", f"OK to {header}")

    @property
    def _where(self) -> str:
        numbers = ", ".join(str(number) for number in self._numbers_by_name.values())
        return f"{self.link.name} ({self.link.url}), axis {numbers}"

    def _refused(self, request: str, reply: Reply, queue: str) -> DeviceRefused:
        return DeviceRefused(
            f"the table refused {request!r}",
            where=self._where,
            found=f"error {reply.error}: {reply.text or 'no text'}"
            + (f"; error queue: {queue}" if queue else ""),
            expected="error code 0",
            remedy="check the demand against the limits, the axis number and the interlock",
        )

    def _not_closed(self, state: str) -> DeviceRefused:
        causes = "; ".join(self.alarms())
        return DeviceRefused(
            "the interlock does not close",
            where=self._where,
            found=f"interlock {state}" + (f" ({causes})" if causes else ""),
            expected="interlock close after reset and close",
            remedy="check emergency stop, doors, power amplifier and the controller's front panel",
        )

    def _protocol_error(self, found: str, expected: str) -> ProtocolError:
        return ProtocolError(
            "the table's answer does not fit the question",
            where=self._where,
            found=repr(found),
            expected=expected,
            remedy="check the line for lost bytes and that nobody else talks to this port",
        )

    def _wrong_device(self, found: str) -> WrongDevice:
        return WrongDevice(
            "not an ACUTROL3000",
            where=self._where,
            found=f"{found} in answer to *IDN?",
            expected="four fields: maker, Acutrol3000, serial number, firmware",
            remedy="check which device the bench file names for this port",
        )
