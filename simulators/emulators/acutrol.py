"""An ACUTROL3000 rate table controller in bytes: ACL over a framed reply channel, one axis on a plant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache

from drivers.acutrol import (
    DATA_TYPE_ERROR,
    INTERLOCK_BITS,
    MAX_TEXT_BYTES,
    MESSAGE_TOO_LONG,
    NOT_IMPLEMENTED,
    PARAMETER_OUT_OF_RANGE,
    SOFTWARE_FAULT_BITS,
    UNDEFINED_HEADER,
    WRONG_PARAMETER_COUNT,
    Command,
    Refusal,
    encode_reply,
    parse_message,
)
from drivers.errors import ConfigurationError
from simulators.interfaces import Reply, TablePlant

IDENTITY = "Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a"
"""The manual's own example of an answer to *IDN? (TM-8004-C 3.4)."""

_QUEUE_LENGTH = 32
# Modes this axis has, with the number A<n>STATE shows in bits 0-3. The manual refers to the list in 4.7 for the
# numbers; counting that list from 0 is our reading.
_MODES: Mapping[str, int] = {"POSITION": 0, "RATE": 1, "OFF": 6}
_LIMIT_MODES = ("POSITION", "RATE", "ARATE", "SYNTHESIS", "TRACK")
_AXIS_SERVOED, _NORMAL_UNSERVO, _SOFTWARE_ABORT, _HARDWARE_ABORT = 1 << 4, 1 << 5, 1 << 6, 1 << 7
_POSITION_COMPLETE, _RATE_COMPLETE = 1 << 8, 1 << 9


@lru_cache(maxsize=64)
def _parsed(line: bytes) -> tuple[Command | Refusal, ...]:
    """Parse a line; a bench polls with the same one every second."""
    return tuple(parse_message(line.decode("latin-1")))


class AcutrolEmulator:
    """The controller with one axis.

    `min_angle_deg` and `max_angle_deg` make a limited-motion axis; None for both is a continuous one. Demands
    wait while the axis is not servoed and run from the moment the interlock closes. Every command line gets one
    framed reply, `latency_s` after it was taken up; lines are taken up one after the other.
    """

    def __init__(
        self,
        plant: TablePlant,
        *,
        axis: int = 1,
        identity: str = IDENTITY,
        latency_s: float = 0.002,
        min_angle_deg: float | None = None,
        max_angle_deg: float | None = None,
    ) -> None:
        self._plant = plant
        self._axis = axis
        self._identity = identity
        self._latency_s = latency_s
        self._angle_limits = (min_angle_deg, max_angle_deg)
        self._input = bytearray()
        self._free_at_s = 0.0
        self._interlock = "Open"
        self._unservo = _NORMAL_UNSERVO
        self._software_faults = 0
        self._interlock_faults = 0
        self._mode = "OFF"
        self._demands = {"POSITION": 0.0, "RATE": 0.0}
        self._turn_limit_dps = plant.max_rate_dps
        self._errors: list[Refusal] = []
        self._lockout = "OFF"
        self._fault_unread = False
        self._handlers: Mapping[str, Callable[[Command, float], str | Refusal | None]] = {
            "DEMAND": self._demand,
            "INTERLOCK": self._interlock_command,
            "LIMIT": self._limit,
            "MODE": self._mode_command,
            "READ": self._read,
            "STATUS": self._status,
            "UTILITY": self._utility,
        }
        self._profile_moving = False

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take bytes the bench wrote (any chunking); CR, LF or both end a line, empty lines are not answered."""
        self._input += data
        *lines, rest = bytes(self._input).replace(b"\n", b"\r").split(b"\r")
        self._input = bytearray(rest[: MAX_TEXT_BYTES + 1])
        replies = []
        for line in lines:
            if line.strip():
                self._free_at_s = max(self._free_at_s, now_s) + self._latency_s
                replies.append(Reply(self._free_at_s, self._answer(line, now_s)))
        return replies

    def trip(self, reason: str, now_s: float) -> None:
        """Open the interlock by a fault at lab time `now_s`.

        `reason` is one of the fault names in drivers.acutrol (SOFTWARE_FAULT_BITS or INTERLOCK_BITS), e.g.
        "rate trip", "position tracking error", "master interlock"; ConfigurationError for any other.
        """
        software = {words: 1 << bit for bit, words in SOFTWARE_FAULT_BITS.items()}
        hardware = {words: 1 << bit for bit, words in INTERLOCK_BITS.items()}
        if reason not in software and reason not in hardware:
            raise ConfigurationError(
                "the table has no such fault",
                found=repr(reason),
                expected="one of: " + ", ".join((*software, *hardware)),
                remedy="use one of these names",
            )
        self._software_faults |= software.get(reason, 0)
        self._interlock_faults |= hardware.get(reason, 0)
        self._unservo = _SOFTWARE_ABORT if reason in software else _HARDWARE_ABORT
        self._interlock = "Fault"
        self._fault_unread = True
        self._profile_moving = False
        self._mode = "OFF"
        self._plant.servo(now_s, False)

    def _answer(self, line: bytes, now_s: float) -> bytes:
        if len(line) > MAX_TEXT_BYTES:
            return self._refuse(MESSAGE_TOO_LONG)
        texts = []
        for command in _parsed(line):
            result = command if isinstance(command, Refusal) else self._execute(command, now_s)
            if isinstance(result, Refusal):
                return self._refuse(result)
            if result is not None:
                texts.append(result)
        return encode_reply(0, ";".join(texts) if texts else "OK")

    def _refuse(self, refusal: Refusal) -> bytes:
        self._errors = [*self._errors, refusal][-_QUEUE_LENGTH:]
        return encode_reply(refusal.code, refusal.text)

    def _execute(self, command: Command, now_s: float) -> str | Refusal | None:
        """Return a query's answer, None for a command that was carried out, or a refusal."""
        if command.path[0].startswith("*"):
            return self._common(command, now_s)
        handler = self._handlers.get(command.path[0])
        return NOT_IMPLEMENTED if handler is None else handler(command, now_s)

    def _common(self, command: Command, now_s: float) -> str | Refusal | None:
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
        return NOT_IMPLEMENTED if name in known else UNDEFINED_HEADER

    def _demand(self, command: Command, now_s: float) -> str | Refusal | None:
        name = command.path[-1]
        if name not in self._demands:
            return NOT_IMPLEMENTED
        if command.query:
            return self._bad_axis(command.arguments, 1) or f"{self._demands[name]:.6f}"
        if refusal := self._bad_axis(command.arguments, 2):
            return refusal
        try:
            value = float(command.arguments[1])
        except ValueError:
            return DATA_TYPE_ERROR
        if not self._within_limits(name, value):
            return PARAMETER_OUT_OF_RANGE
        self._demands[name] = value
        if self._mode == name:
            self._apply(now_s)
        return None

    def _within_limits(self, name: str, value: float) -> bool:
        if name == "RATE":
            return abs(value) <= self._plant.max_rate_dps
        low, high = self._angle_limits
        return (low is None or value >= low) and (high is None or value <= high) and abs(value) < 1e6

    def _interlock_command(self, command: Command, now_s: float) -> str | Refusal | None:
        name = command.path[-1]
        if command.query and name == "INTERLOCK":
            return self._bad_axis(command.arguments, 1) or self._interlock
        if command.query or name not in ("CLOSE", "OPEN", "RESET"):
            return NOT_IMPLEMENTED
        arguments = command.arguments
        if name == "RESET" and not arguments:
            arguments = ("ALL",)
        if refusal := self._bad_axis(arguments, 1, all_allowed=True):
            return refusal
        if name == "CLOSE" and self._interlock == "Open":
            self._interlock = "Close"
            self._plant.servo(now_s, True)
            self._apply(now_s)
        elif name == "OPEN" and self._interlock == "Close":
            self._interlock, self._unservo, self._mode = "Open", _NORMAL_UNSERVO, "OFF"
            self._plant.servo(now_s, False)
        elif name == "RESET" and self._interlock == "Fault":
            self._interlock, self._unservo = "Open", _NORMAL_UNSERVO
            self._software_faults = self._interlock_faults = 0
        return None

    def _limit(self, command: Command, now_s: float) -> str | Refusal | None:
        name, plant = command.path[-1], self._plant
        if not command.query and name == "RATE":
            return self._set_turn_limit(command.arguments)
        if not command.query or name not in ("ABSOLUTE", "RATE", "ACCELERATION"):
            return NOT_IMPLEMENTED
        rate, acceleration = plant.max_rate_dps, plant.max_acceleration_dps2
        if name == "ABSOLUTE":
            low, high = self._angle_limits
            span = (-180.0 if low is None else low, 180.0 if high is None else high)
            fields = (rate, acceleration, 1000.0 * acceleration, *span, 1.1 * rate)
            return self._bad_axis(command.arguments, 1) or ",".join(f"{value:.5f}" for value in fields)
        if len(command.arguments) != 2:
            return WRONG_PARAMETER_COUNT
        mode, axis = command.arguments
        if not any(known.startswith(mode.upper()) for known in _LIMIT_MODES):
            return PARAMETER_OUT_OF_RANGE
        if "POSITION".startswith(mode.upper()):
            rate = self._turn_limit_dps
        return self._bad_axis((axis,), 1) or f"{rate if name == 'RATE' else acceleration:.5f}"

    def _set_turn_limit(self, arguments: tuple[str, ...]) -> Refusal | None:
        """Take the rate limit of position mode, e.g. `pos,1,120`; it counts from the next demand on."""
        if len(arguments) != 3:
            return WRONG_PARAMETER_COUNT
        mode, axis, text = arguments
        if refusal := self._bad_axis((axis,), 1):
            return refusal
        if not mode or not "POSITION".startswith(mode.upper()):
            return NOT_IMPLEMENTED
        try:
            value = float(text)
        except ValueError:
            return DATA_TYPE_ERROR
        if not 0.0 < value <= self._plant.max_rate_dps:
            return PARAMETER_OUT_OF_RANGE
        self._turn_limit_dps = value
        return None

    def _mode_command(self, command: Command, now_s: float) -> str | Refusal | None:
        name, arguments = command.path[-1], command.arguments
        if command.query:
            return self._bad_axis(arguments, 1) or self._mode.capitalize()
        if name == "MODE":
            if refusal := self._bad_axis(arguments, 2, all_allowed=True):
                return refusal
            matches = [mode for mode in _MODES if mode.startswith(arguments[1].upper())]
            if len(matches) != 1:
                return PARAMETER_OUT_OF_RANGE
            name, arguments = matches[0], arguments[:1]
        if name not in _MODES:
            return NOT_IMPLEMENTED
        if refusal := self._bad_axis(arguments, 1, all_allowed=True):
            return refusal
        self._mode = name
        self._apply(now_s)
        return None

    def _apply(self, now_s: float) -> None:
        if self._interlock != "Close":
            return
        if self._mode == "POSITION":
            self._plant.demand_angle(now_s, self._demands["POSITION"], self._turn_limit_dps)
        else:
            self._plant.demand_rate(now_s, self._demands["RATE"] if self._mode == "RATE" else 0.0)
        self._profile_moving = True

    def _read(self, command: Command, now_s: float) -> str | Refusal | None:
        readings = {"POSITION": self._plant.angle_deg, "RATE": self._plant.rate_dps}
        if command.path[-1] not in readings:
            return NOT_IMPLEMENTED
        # The question mark is optional on READ (TM-8004-C 4.10.4, ACT2000 compatibility).
        return self._bad_axis(command.arguments, 1) or f"{readings[command.path[-1]](now_s):.6f}"

    def _status(self, command: Command, now_s: float) -> str | Refusal | None:
        name = command.path[-1]
        if not command.query:
            return NOT_IMPLEMENTED
        if name == "STB":
            return str(self._status_byte(now_s, clear=False))
        if name == "MSG" and command.arguments[:1] and command.arguments[0].upper() == "QERROR":
            return "{0.code}: {0.text}".format(self._errors.pop(0)) if self._errors else ""
        if name != "CSR":
            return NOT_IMPLEMENTED
        if len(command.arguments) != 1:
            return WRONG_PARAMETER_COUNT
        word = self._register(command.arguments[0].upper(), now_s)
        return PARAMETER_OUT_OF_RANGE if word is None else str(word)

    def _register(self, name: str, now_s: float) -> int | None:
        prefix = f"A{self._axis}"
        if name in (f"{prefix}STATE", f"{prefix}STATIC"):
            servoed = _AXIS_SERVOED if self._interlock == "Close" else self._unservo
            return _MODES[self._mode] | servoed
        if name == f"{prefix}DYN":
            done = _POSITION_COMPLETE if self._mode == "POSITION" else _RATE_COMPLETE
            return done if self._plant.settled(now_s) else 0
        if name in (f"{prefix}SWFLT", f"{prefix}SWFAULT"):
            return self._software_faults
        return self._interlock_faults if name == f"{prefix}INTLK" else None

    def _status_byte(self, now_s: float, *, clear: bool) -> int:
        complete = self._profile_moving and self._plant.settled(now_s)
        byte = int(self._fault_unread) | int(complete) << 1 | int(bool(self._errors)) << 7
        if self._fault_unread:
            byte |= 1 << 6
        if clear:
            self._fault_unread = False
            self._profile_moving = self._profile_moving and not complete
        return byte

    def _utility(self, command: Command, now_s: float) -> str | Refusal | None:
        if command.path[-1] != "LOCKOUTMODE":
            return NOT_IMPLEMENTED
        if command.query:
            return self._lockout
        if len(command.arguments) != 1 or command.arguments[0].upper() not in ("ON", "OFF"):
            return PARAMETER_OUT_OF_RANGE
        self._lockout = command.arguments[0].upper()
        return None

    def _bad_axis(
        self, arguments: tuple[str, ...], count: int, *, all_allowed: bool = False
    ) -> Refusal | None:
        """Return why `arguments` (the axis first, `count` in all) are refused, None if they are not."""
        if len(arguments) != count:
            return WRONG_PARAMETER_COUNT
        if arguments[0] == str(self._axis) or (all_allowed and arguments[0].upper() == "ALL"):
            return None
        return PARAMETER_OUT_OF_RANGE
