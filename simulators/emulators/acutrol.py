"""An ACUTROL3000 rate table controller in bytes: ACL over a framed reply channel, axes on a plant."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import lru_cache

from drivers.acutrol.codec import MAX_TEXT_BYTES, encode_reply
from drivers.acutrol.grammar import (
    MESSAGE_TOO_LONG,
    NOT_IMPLEMENTED,
    PARAMETER_OUT_OF_RANGE,
    UNDEFINED_HEADER,
    WRONG_PARAMETER_COUNT,
    Command,
    Refusal,
    parse_message,
)
from drivers.base.errors import ConfigurationError
from drivers.kit.config import TableConfig
from simulators.emulators._acutrol_arguments import Refused, one_of
from simulators.emulators._acutrol_axis import FAULT_NAMES, LIMITED_MODES, MODES, AcutrolAxis, fault_bits
from simulators.faults import DeviceFault, Fault
from simulators.interfaces import Installation, Reply
from simulators.plant.table import TableAxis

__all__ = ["IDENTITY", "AcutrolAxis", "AcutrolEmulator", "emulator"]

IDENTITY = "Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a"
"""The manual's own example of an answer to *IDN? (TM-8004-C 3.4)."""

_QUEUE_LENGTH = 32
_READS = {"POSITION": "P", "RATE": "R", "ACCELERATION": "A", "SHORTVECTOR": "PR", "VECTOR": "PRA"}
_VARIABLES = {"082": "POSITION", "083": "RATE", "176": "ACCELERATION"}
"""System variables behind the digit of their axis (4.2.15)."""


@lru_cache(maxsize=64)
def _parsed(line: bytes) -> tuple[Command | Refusal, ...]:
    """Parse a line; a bench polls with the same one every second."""
    return tuple(parse_message(line.decode("latin-1")))


class AcutrolEmulator:
    """The controller with its axes: `axes` gives what moves behind each number (see `AcutrolAxis` for limits).

    Every command line gets one framed reply, `latency_s` after it was taken up; lines are taken up one after the
    other. `AcutrolEmulator(plant)` is a controller with a continuous axis 1.
    """

    def __init__(
        self,
        axes: TableAxis | Mapping[int, AcutrolAxis],
        *,
        identity: str = IDENTITY,
        latency_s: float = 0.002,
    ) -> None:
        self._axes = dict(axes) if isinstance(axes, Mapping) else {1: AcutrolAxis(axes)}
        self._identity = identity
        self._latency_s = latency_s
        self._input = bytearray()
        self._free_at_s = 0.0
        self._errors: list[Refusal] = []
        self._refusals: list[Refusal] = []
        self._lockout = "OFF"
        self._fault_unread = False
        self._handlers: Mapping[str, Callable[[Command, float], str | None]] = {
            "CONFIGURE": self._configure,
            "DEMAND": self._demand,
            "INTERLOCK": self._interlock_command,
            "LIMIT": self._limit,
            "MODE": self._mode_command,
            "READ": self._read,
            "STATUS": self._status,
            "UTILITY": self._utility,
        }

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take bytes the bench wrote (any chunking); CR, LF or both end a line, empty lines are not answered."""
        self._input += data
        *lines, unfinished = bytes(self._input).replace(b"\n", b"\r").split(b"\r")
        self._input = bytearray(unfinished[: MAX_TEXT_BYTES + 1])
        replies = []
        for line in lines:
            if line.strip():
                self._free_at_s = max(self._free_at_s, now_s) + self._latency_s
                replies.append(Reply(self._free_at_s, self._answer(line, now_s)))
        return replies

    def trip(self, reason: str, now_s: float, axis: int | None = None) -> None:
        """Open the interlock of an axis (default: the last) by a fault at lab time `now_s`.

        `reason` is one of FAULT_NAMES, e.g. "rate trip", "position tracking error", "master interlock", "+12 V
        fault"; ConfigurationError for any other.
        """
        bits = fault_bits(reason)
        if bits is None:
            raise ConfigurationError(
                "the table has no such fault",
                found=repr(reason),
                expected="one of: " + ", ".join(FAULT_NAMES),
                remedy="use one of these names",
            )
        self._fault_unread = True
        self._axes[next(reversed(self._axes)) if axis is None else axis].trip(*bits, now_s)

    @property
    def faults(self) -> Mapping[str, DeviceFault]:
        """`trip`: the interlock opens by the fault `text`. `refuse`: the next `count` commands get an error.

        `open`: somebody opens the interlock.
        """
        return {"trip": self._trip, "refuse": self._refuse_next, "open": self._open_by_hand}

    @property
    def fault_texts(self) -> Mapping[str, Collection[str]]:
        """What `text` of a fault may be."""
        return {"trip": FAULT_NAMES}

    def _trip(self, fault: Fault, now_s: float) -> None:
        self.trip(fault.text or "position tracking error", now_s)

    def _refuse_next(self, fault: Fault, now_s: float) -> None:
        text = fault.text or PARAMETER_OUT_OF_RANGE.text
        self._refusals = [Refusal(PARAMETER_OUT_OF_RANGE.code, text)] * fault.count

    def _open_by_hand(self, fault: Fault, now_s: float) -> None:
        for axis in self._axes.values():
            axis.open(now_s)

    def _answer(self, line: bytes, now_s: float) -> bytes:
        if len(line) > MAX_TEXT_BYTES:
            return self._refuse(MESSAGE_TOO_LONG)
        texts = []
        for command in _parsed(line):
            if isinstance(command, Refusal):
                return self._refuse(command)
            try:
                text = self._execute(command, now_s)
            except Refused as error:
                return self._refuse(error.refusal)
            if text is not None:
                texts.append(text)
        return encode_reply(0, ";".join(texts) if texts else "OK")

    def _refuse(self, refusal: Refusal) -> bytes:
        self._errors = [*self._errors, refusal][-_QUEUE_LENGTH:]
        return encode_reply(refusal.code, refusal.text)

    def _execute(self, command: Command, now_s: float) -> str | None:
        """Return a query's answer, None for a command that was carried out; Refused for one that was not."""
        if command.path[0].startswith("*"):
            return self._common(command, now_s)
        if self._refusals and not command.query:
            raise Refused(self._refusals.pop())
        handler = self._handlers.get(command.path[0])
        if handler is None:
            raise Refused(NOT_IMPLEMENTED)
        return handler(command, now_s)

    def _common(self, command: Command, now_s: float) -> str | None:
        (name,) = command.path
        if name == "*IDN" and command.query:
            return self._identity
        if name == "*STB" and command.query:
            return str(self._status_byte(now_s, clear=True))
        if name == "*CLS" and not command.query:
            self._errors.clear()
            self._fault_unread = False
            return None
        known = ("*RST", "*TST", "*OPC", "*WAI", "*IST", "*PRE", "*ESE", "*ESR", "*SRE", "*TRG")
        raise Refused(NOT_IMPLEMENTED if name in known else UNDEFINED_HEADER)

    def _configure(self, command: Command, now_s: float) -> str | None:
        if command.path[-1] != "OSCILLATOR":
            raise Refused(NOT_IMPLEMENTED)
        axis = self._one(command.arguments[:1], 1)
        if command.query:
            return axis.oscillator.configuration
        axis.configure_oscillator(command.arguments[1:], now_s)
        return None

    def _demand(self, command: Command, now_s: float) -> str | None:
        name = command.path[-1]
        if command.query:
            return self._one(command.arguments, 1).demanded(name)
        self._one(command.arguments[:1], 1).demand(name, command.arguments[1:], now_s)
        return None

    def _interlock_command(self, command: Command, now_s: float) -> str | None:
        name = command.path[-1]
        if command.query and name == "INTERLOCK":
            return self._one(command.arguments, 1).interlock
        if command.query or name not in ("CLOSE", "OPEN", "RESET"):
            raise Refused(NOT_IMPLEMENTED)
        arguments = command.arguments
        if name == "RESET" and not arguments:
            arguments = ("ALL",)
        for axis in self._several(arguments, 1):
            if name == "CLOSE":
                axis.close(now_s)
            elif name == "OPEN":
                axis.open(now_s)
            else:
                axis.reset()
        return None

    def _limit(self, command: Command, now_s: float) -> str | None:
        name = command.path[-1]
        if not command.query:
            self._set_limit(name, command.arguments)
            return None
        if name not in ("ABSOLUTE", "RATE", "ACCELERATION"):
            raise Refused(NOT_IMPLEMENTED)
        if name == "ABSOLUTE":
            return ",".join(f"{value:.5f}" for value in self._one(command.arguments, 1).limit_values())
        if len(command.arguments) != 2:
            raise Refused(WRONG_PARAMETER_COUNT)
        mode = one_of(LIMITED_MODES, command.arguments[0])
        return f"{self._one(command.arguments[1:], 1).limit(name, mode):.5f}"

    def _set_limit(self, name: str, arguments: tuple[str, ...]) -> None:
        """Take a limit of a mode, e.g. rate `pos,1,120`."""
        if name not in ("RATE", "ACCELERATION"):
            raise Refused(NOT_IMPLEMENTED)
        if len(arguments) != 3:
            raise Refused(WRONG_PARAMETER_COUNT)
        mode, axis, text = arguments
        self._one((axis,), 1).set_limit(name, one_of(LIMITED_MODES, mode), text)

    def _mode_command(self, command: Command, now_s: float) -> str | None:
        name, arguments = command.path[-1], command.arguments
        if command.query:
            return self._one(arguments, 1).mode_at(now_s).capitalize()
        if name == "MODE":
            self._several(arguments[:1], 1)
            if len(arguments) < 2:
                raise Refused(WRONG_PARAMETER_COUNT)
            name, arguments = one_of(MODES, arguments[1]), arguments[:1] + arguments[2:]
        if name not in MODES:
            raise Refused(NOT_IMPLEMENTED)
        if len(arguments) > 1 + (name == "TRACK"):
            raise Refused(WRONG_PARAMETER_COUNT)
        for axis in self._several(arguments[:1], 1):
            axis.change_mode(name, now_s, *arguments[1:])
        return None

    def _read(self, command: Command, now_s: float) -> str | None:
        # The question mark is optional on READ (TM-8004-C 4.10.4, ACT2000 compatibility).
        name, arguments = command.path[-1], command.arguments
        if name == "VARIABLE":
            if len(arguments) != 1:
                raise Refused(WRONG_PARAMETER_COUNT)
            name, arguments = _VARIABLES.get(arguments[0][1:], ""), (arguments[0][:1],)
            if not name:
                raise Refused(PARAMETER_OUT_OF_RANGE)
        if name not in _READS:
            raise Refused(NOT_IMPLEMENTED)
        plant = self._one(arguments, 1).plant
        states = {"P": plant.angle_deg, "R": plant.rate_dps, "A": plant.acceleration_dps2}
        return ";".join(f"{states[state](now_s):.6f}" for state in _READS[name])

    def _status(self, command: Command, now_s: float) -> str | None:
        name = command.path[-1]
        if not command.query:
            raise Refused(NOT_IMPLEMENTED)
        if name == "STB":
            return str(self._status_byte(now_s, clear=False))
        if name == "MSG" and command.arguments[:1] and command.arguments[0].upper() == "QERROR":
            return "{0.code}: {0.text}".format(self._errors.pop(0)) if self._errors else ""
        if name != "CSR":
            raise Refused(NOT_IMPLEMENTED)
        if len(command.arguments) != 1:
            raise Refused(WRONG_PARAMETER_COUNT)
        register = command.arguments[0].upper()
        for number, axis in self._axes.items():
            prefix = f"A{number}"
            if register.startswith(prefix):
                word = axis.register(register.removeprefix(prefix), now_s)
                if word is not None:
                    return str(word)
                break
        raise Refused(PARAMETER_OUT_OF_RANGE)

    def _status_byte(self, now_s: float, *, clear: bool) -> int:
        moving = [axis for axis in self._axes.values() if axis.moving]
        complete = bool(moving) and all(axis.plant.settled(now_s) for axis in moving)
        byte = int(self._fault_unread) | int(complete) << 1 | int(bool(self._errors)) << 7
        if self._fault_unread:
            byte |= 1 << 6
        if clear:
            self._fault_unread = False
            for axis in moving:
                axis.moving = not complete
        return byte

    def _utility(self, command: Command, now_s: float) -> str | None:
        if command.path[-1] != "LOCKOUTMODE":
            raise Refused(NOT_IMPLEMENTED)
        if command.query:
            return self._lockout
        if len(command.arguments) != 1 or command.arguments[0].upper() not in ("ON", "OFF"):
            raise Refused(PARAMETER_OUT_OF_RANGE)
        self._lockout = command.arguments[0].upper()
        return None

    def _one(self, arguments: tuple[str, ...], count: int) -> AcutrolAxis:
        """Return the axis named by the first of `count` arguments."""
        if len(arguments) != count:
            raise Refused(WRONG_PARAMETER_COUNT)
        axis = self._axes.get(int(arguments[0])) if arguments[0].isdecimal() else None
        if axis is None:
            raise Refused(PARAMETER_OUT_OF_RANGE)
        return axis

    def _several(self, arguments: tuple[str, ...], count: int) -> list[AcutrolAxis]:
        """Return the axes named by the first argument, a number or ALL."""
        if len(arguments) == count and arguments[0].upper() == "ALL":
            return list(self._axes.values())
        return [self._one(arguments, count)]


def emulator(config: TableConfig, axes: Mapping[str, TableAxis], installed: Installation) -> AcutrolEmulator:
    """Make the emulator of a bench file's table."""
    return AcutrolEmulator(
        {
            axis.number: AcutrolAxis(axes[axis.name], axis.min_angle_deg, axis.max_angle_deg)
            for axis in config.all_axes
        }
    )
