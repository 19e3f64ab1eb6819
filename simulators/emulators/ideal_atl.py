"""An Ideal Aerosmith table in bytes: ATL lines, answers, prompts, and a JOG or SGO that answers late.

The bits of STA are not public; here 1 is a closed servo, 2 a completed motion and 4 a fault. DIR and SAV are
taken and change nothing: what they do is not public either. AMP, FRQ or PER, CYC (0: without end) and SGO make a
sine about where the table stands; ZER gives its angle a new value, HOF its home. `complete` is
what MCO says of a motion that has ended: 1 in one public program, 0 in another. `one_prompt`: JOG and the line
after it have one answer, as actigraph/RateTableSweepGUI takes it, not one each. `echo`: a line comes back before
its answer. `line_end`: what ends the lines of an answer.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from drivers.kit.config import TableConfig
from simulators.faults import DeviceFault, Fault, WireShape
from simulators.interfaces import Installation, Reply
from simulators.plant.table import Swing, TableAxis

_LINE = re.compile(r"([A-Z]{3})([-+]?\d+(?:\.\d*)?)?")
_LIMIT = 128
_BITS = 10
_REFUSAL = "?"


class AtlEmulator:
    """One axis. Every line, an empty one too, gets one answer and a prompt, `latency_s` after it was taken
    up."""

    def __init__(
        self,
        plant: TableAxis,
        *,
        complete: str = "1",
        one_prompt: bool = False,
        echo: bool = False,
        line_end: str = "\r\n",
        baudrate: int = 9600,
        latency_s: float = 0.010,
    ) -> None:
        self._plant = plant
        self._complete, self._one_prompt = complete, one_prompt
        self._echo, self._line_end = echo, line_end
        self._byte_s, self._latency_s = _BITS / baudrate, latency_s
        self._servo = self._tripped = self._jogging = False
        self._rate_dps = plant.max_rate_dps
        self._acceleration_dps2 = plant.max_acceleration_dps2
        self._zero_deg = self._home_deg = 0.0
        self._amplitude_deg, self._frequency_hz, self._cycles = 1.0, 1.0, 0.0
        self._refusals: list[str] = []
        self._input = b""
        self._after_return = False
        self._free_at_s = 0.0

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take bytes the bench wrote (any chunking); CR, LF or both end a line."""
        if self._after_return:
            data = data.removeprefix(b"\n")
        self._after_return = data.endswith(b"\r") or (not data and self._after_return)
        *lines, unfinished = re.split(rb"\r\n|\r|\n", self._input + data)
        self._input = unfinished[-_LIMIT:]
        replies = []
        for line in lines:
            text = line.decode("latin-1").strip().upper()
            # what the JOG or SGO before this line still owes
            answers = [""] if self._jogging and not self._one_prompt else []
            self._jogging = text.startswith(("JOG", "SGO")) and self._servo
            if not self._jogging:
                answers.append(self._answer(text, now_s))
            elif (refused := self._answer(text, now_s)) == _REFUSAL:
                self._jogging = False
                answers.append(refused)
            end = self._line_end
            echo = f"{text}{end}" if self._echo else ""
            for answer in answers:
                frame = f"{echo}{answer}{end}>{end}".encode("ascii")
                echo = ""
                self._free_at_s = max(self._free_at_s, now_s + self._latency_s) + self._byte_s * len(frame)
                replies.append(Reply(self._free_at_s, frame))
        return replies

    @property
    def wire(self) -> WireShape:
        """A reply; there is no check value."""
        return WireShape()

    @property
    def faults(self) -> Mapping[str, DeviceFault]:
        """`trip`: the servo opens and stays open until SRV0 and SRV1. `refuse`: `count` commands are answered
        ?."""
        return {"trip": self._trip, "refuse": self._refuse}

    def _trip(self, fault: Fault, now_s: float) -> None:
        self._tripped, self._servo = True, False
        self._plant.servo(now_s, False)

    def _refuse(self, fault: Fault, now_s: float) -> None:
        self._refusals = [_REFUSAL] * fault.count

    def _answer(self, text: str, now_s: float) -> str:
        if not text:
            return ""
        found = _LINE.fullmatch(text)
        if found is None:
            return _REFUSAL
        name, value = found[1], None if found[2] is None else float(found[2])
        plant = self._plant
        match name:
            case "PPO":
                return f"{(plant.angle_deg(now_s) - self._zero_deg) % 360.0:.4f}"
            case "PVE":
                return f"{plant.rate_dps(now_s):.4f}"
            case "MCO":
                ended = {"1": "0", "0": "1"}
                return self._complete if plant.settled(now_s) else ended[self._complete]
            case "STA":
                return str(int(self._servo) | int(plant.settled(now_s)) << 1 | int(self._tripped) << 2)
        if self._refusals:
            return self._refusals.pop()
        done = self._set(name, value, now_s) or self._carry_out(name, value, now_s)
        return "" if done else _REFUSAL

    def _set(self, name: str, value: float | None, now_s: float) -> bool:
        """Take what the next motions go by; False where `name` is no setting or its value none."""
        plant = self._plant
        match name, value:
            case "ACL", float() if 0.0 < value <= plant.max_acceleration_dps2:
                self._acceleration_dps2 = value
            case "VEL", float() if 0.0 < value <= plant.max_rate_dps:
                self._rate_dps = value
            case "AMP", float() if value > 0.0:
                self._amplitude_deg = value
            case "FRQ", float() if value > 0.0:
                self._frequency_hz = value
            case "PER", float() if value > 0.0:
                self._frequency_hz = 1.0 / value
            case "CYC", float() if value >= 0.0:
                self._cycles = value
            case "HOF", float():
                self._home_deg = value
            case "ZER", float():
                self._zero_deg = plant.angle_deg(now_s) - value
            case ("DIR", (0.0 | 1.0)) | ("SAV", None):
                pass
            case _:
                return False
        return True

    def _carry_out(self, name: str, value: float | None, now_s: float) -> bool:
        plant = self._plant
        match name, value:
            case "SRV", (0.0 | 1.0):
                self._tripped = self._tripped and value == 1.0
                self._servo = value == 1.0 and not self._tripped
                plant.servo(now_s, self._servo)
            case "STO", None:
                plant.demand_rate(now_s, 0.0, self._acceleration_dps2)
            case "JOG", float() if self._servo and abs(value) <= plant.max_rate_dps:
                plant.demand_rate(now_s, value, self._acceleration_dps2)
            case "RMO", float() if self._servo:
                plant.demand_turn(now_s, value, self._rate_dps, self._acceleration_dps2)
            case "MOV", float() if self._servo:
                plant.demand_angle(now_s, value + self._zero_deg, self._rate_dps, self._acceleration_dps2)
            case "HOM", None if self._servo:
                plant.demand_angle(
                    now_s, self._home_deg + self._zero_deg, self._rate_dps, self._acceleration_dps2
                )
            case "SGO", None if self._servo:
                return self._swing(now_s)
            case _:
                return False
        return True

    def _swing(self, now_s: float) -> bool:
        """Start the sine; False if its rate or acceleration is beyond the table's limits."""
        hertz, size = self._frequency_hz, self._amplitude_deg
        w = 2.0 * math.pi * hertz
        if size * w > self._plant.max_rate_dps or size * w * w > self._acceleration_dps2:
            return False
        sine = Swing(size, 0.0, hertz, 0.0)
        still = Swing(0.0, 0.0, hertz, 0.0)
        cycles = self._cycles
        self._plant.demand_rate(now_s, 0.0, self._acceleration_dps2)
        self._plant.demand_swing(now_s, [(cycles / hertz, sine), (0.0, still)] if cycles else [(0.0, sine)])
        return True


def emulator(config: TableConfig, axes: Mapping[str, TableAxis], installed: Installation) -> AtlEmulator:
    """Make the emulator of a bench file's table."""
    return AtlEmulator(axes[config.all_axes[0].name], baudrate=config.baudrate)
