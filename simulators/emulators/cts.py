"""A CTS temperature chamber in bytes: set point, gradients, start and stop, status, text of error.

Sources: `drivers.cts.codec`; its digital channels are those of the example that CTS prints. Not public, and ours:
what a set point out of range, an unknown command and a start with an error meet (no answer; no answer; an answer,
and no start), the error's number in the status, and that a pause ends a bare command, whole or not.
"""

from __future__ import annotations

from collections.abc import Mapping

from drivers.base.errors import ProtocolError
from drivers.cts import CtsConfig
from drivers.cts.codec import COMMAND, ETX, FASTEST_K_PER_MIN, decode_frame, encode_frame
from simulators.faults import DeviceFault, Fault, WireShape
from simulators.interfaces import Installation, Reply
from simulators.plant.lab_chamber import LabChamber

_LIMIT = 256
_GAP_S = 0.2
_END = bytes([ETX])
_NO_ERROR, _ERROR = "0", "2"


class CtsEmulator:
    """One temperature chamber with auxiliary sensors in analog channels 1 to 6.

    `framed`: it takes and sends frames, with its `address`; else bare commands. Every command that it knows gets
    one answer, `latency_s` after it was taken up.
    """

    def __init__(
        self,
        plant: LabChamber,
        *,
        framed: bool = True,
        address: int = 1,
        lower_c: float = -75.0,
        upper_c: float = 180.0,
        latency_s: float = 0.030,
    ) -> None:
        self._plant = plant
        self._framed, self._address = framed, address
        self._limits = (lower_c, upper_c)
        self._latency_s = latency_s
        self._set_point_c = plant.set_point_c(0.0)
        self._gradients = {"u": FASTEST_K_PER_MIN, "d": FASTEST_K_PER_MIN}
        self._running = self._paused = False
        self._error = ""
        self._door_open = False
        self._refusals = 0
        self._input = b""
        self._heard_s = self._free_at_s = 0.0

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take bytes the bench wrote, any chunking; what is no command, or another address', is passed over."""
        if now_s - self._heard_s > _GAP_S and not self._framed:
            self._input = b""
        self._heard_s = now_s
        self._input = (self._input + data)[-_LIMIT:]
        replies = []
        for command in self._frames() if self._framed else self._bare():
            answer = self._answer(command, now_s)
            if answer:
                self._free_at_s = max(self._free_at_s, now_s) + self._latency_s
                sent = encode_frame(self._address, answer) if self._framed else answer.encode("latin-1")
                replies.append(Reply(self._free_at_s, sent))
        return replies

    @property
    def wire(self) -> WireShape:
        """A frame ends in its check value and ETX."""
        return WireShape(check_bytes=1, tail_bytes=1) if self._framed else WireShape()

    @property
    def faults(self) -> Mapping[str, DeviceFault]:
        """`alarm`: an error of `text` stops it. `refuse`: the next `count` commands are not answered."""
        return {"alarm": self._alarm, "refuse": self._refuse}

    def open_door(self, is_open: bool) -> None:
        """Open or close the door, which a digital channel tells."""
        self._door_open = is_open

    def _alarm(self, fault: Fault, now_s: float) -> None:
        self._error = fault.text or "Temp. limiter 1 test space"
        self._running = False
        self._demand(now_s)

    def _refuse(self, fault: Fault, now_s: float) -> None:
        self._refusals = fault.count

    def _frames(self) -> list[str]:
        *frames, self._input = self._input.split(_END)
        commands = []
        for frame in frames:
            try:
                address, text = decode_frame(frame + _END)
            except ProtocolError:
                continue
            if address == self._address:
                commands.append(text)
        return commands

    def _bare(self) -> list[str]:
        commands = []
        while found := COMMAND.match(self._input.decode("latin-1")):
            commands.append(found[0])
            self._input = self._input[found.end() :]
        return commands

    def _answer(self, text: str, now_s: float) -> str:
        """Return the answer to a command, empty for none."""
        if not COMMAND.fullmatch(text):
            return ""
        if text[0].islower() and self._refusals:
            self._refusals -= 1
            return ""
        match text[:2]:
            case "A0":
                return f"A0 {self._plant.air_temp_c(now_s):05.1f} {self._plant.set_point_c(now_s):05.1f}"
            case "U1":
                return f"U1 {self._gradients['u']:05.1f} {self._gradients['d']:05.1f}"
            case "R1":
                return self._ramp(now_s)
            case "S":
                state = (self._running, bool(self._error), not self._paused, *(False,) * 5)
                return "S" + _bits(state) + (_ERROR if self._error else _NO_ERROR)
            case "F":
                return f"F{self._error:32.32}"
            case "O":
                general = (self._running, bool(self._error), False)
                flags = (self._running, False, True, False, not self._door_open)
                return "O" + _bits((*general, *flags, *(False,) * 6))
        if text[0] == "A" and int(text[1]) in range(1, 7):
            return f"{text} {self._plant.auxiliary_c(int(text[1]), now_s):05.1f} 000.0"
        if text[0] in "po":  # a program, a soft key: neither does anything here
            return text[: 4 if text[0] == "p" else 3]
        return self._command(text, now_s)

    def _ramp(self, now_s: float) -> str:
        moves = self._running and self._plant.set_point_c(now_s) != self._set_point_c
        limited = min(self._gradients.values()) < FASTEST_K_PER_MIN
        up, down = self._gradients.values()
        target = f"{self._set_point_c:0{6 if self._set_point_c < 0 else 7}.2f}"
        return f"R1 {_bits((limited, moves))} {up:07.2f} {down:07.2f} {target}"

    def _command(self, text: str, now_s: float) -> str:
        """Carry out a command and return its answer, empty if it cannot be."""
        try:
            value = float(text[3:] or "nan")
        except ValueError:
            return ""
        match text[:2]:
            case "a0" if self._limits[0] <= value <= self._limits[1]:
                self._set_point_c = value
                answer = "a"
            case "u1" | "d1":
                self._gradients[text[0]] = value
                answer = text[0]
            case "s1":
                self._running = value == 1.0 and not self._error
                answer = "s1"
            case "s2":
                self._error = "" if value == 1.0 else self._error
                answer = "s2"
            case "s3":
                self._paused = value == 0.0
                answer = "s3"
            case _:
                return ""
        self._demand(now_s)
        return answer

    def _demand(self, now_s: float) -> None:
        up, down = (
            0.0 if gradient >= FASTEST_K_PER_MIN else gradient for gradient in self._gradients.values()
        )
        runs = self._running and not self._paused
        self._plant.demand(now_s, set_point_c=self._set_point_c, ramp_up=up, ramp_down=down, running=runs)


def _bits(flags: tuple[bool, ...]) -> str:
    return "".join(str(int(flag)) for flag in flags)


def emulator(config: CtsConfig, plant: LabChamber, installed: Installation) -> CtsEmulator:
    """Make the emulator of a bench file's chamber."""
    return CtsEmulator(plant, framed=config.in_frames, address=config.frame_address)
