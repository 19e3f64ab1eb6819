"""Driver of a one-axis Ideal Aerosmith rate table that speaks ATL."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping
from typing import Any

from drivers.base.errors import DeviceRefused, DeviceSilent, ProtocolError
from drivers.ideal_atl._codec import (
    END,
    POSITION,
    PROMPT,
    RATE,
    STATUS,
    decode_number,
    encode,
    is_number,
    split_reply,
)
from drivers.kit.config import Mistake, TableConfig
from drivers.kit.instruments import Identity, Rest, TableLimits, TableState
from drivers.kit.kinds import Connection
from drivers.kit.polled import REST_DPS, TROUBLES, PolledTable
from drivers.kit.retry import command_with_retry, query_with_retry

REPLY_TIMEOUT_S = 2.0
STANDSTILL_TIMEOUT_S = 120.0
_PAUSE_S = 0.2
_QUIET_S = 0.3


class AtlConfig(TableConfig):
    """`[table]` behind ATL, which turns one axis."""

    @classmethod
    def mistakes(cls, given: Mapping[str, Any]) -> Iterator[Mistake]:
        """Yield more axes than ATL turns."""
        axes = given.get("axes")
        if isinstance(axes, (list, tuple)) and len(axes) > 1:
            yield Mistake("axes", f"{len(axes)} axes", "one of [[table.axes]], or none: ATL turns one")


class AtlTable(PolledTable):
    """One axis behind an ATL controller (`drivers.kit.instruments.Turntable`), RS-232, 9600 Bd 8N1.

    What is not public is not used: the bits of `STA`, and `MCO`, which one source takes for 1 = complete and
    another for 0. Motion is judged by position and rate. The controller tells no limits: those of the bench
    file count.

    `JOG` is answered when its motion ends or the next command comes. A `STA` after it brings both answers at once
    on some tables, on others one for the two of them: STA's number is the last either way.
    """

    tells_alarms = False
    _product = "an Ideal Aerosmith table with ATL"
    _known_by = "numbers in answer to PPO, PVE and STA, each before a prompt >"
    _check = "check which device the bench file names for this port, and the baud rate"
    _answer_end = PROMPT

    def __init__(self, config: AtlConfig, connection: Connection) -> None:
        super().__init__(connection.link(config.port, config.baudrate))
        self.axes = (config.all_axes[0].name,)
        self._turn_dps: float | None = None
        self._turn_dps2: float | None = None

    def _introduction(self) -> Identity:
        """Ask position, rate and status, each a number: ATL has no identification."""
        _, _, status = [self._number(query) for query in (POSITION, RATE, STATUS)]
        return Identity("Ideal Aerosmith", "ATL table", details={"STA": f"{status:g}"})

    def limits(self, axis: str = "") -> TableLimits:
        """Return no limits: the controller tells none."""
        self._require_axis(axis)
        return TableLimits(math.inf, math.inf, None, None)

    def limit_turns(
        self, max_rate_dps: float, axis: str = "", max_acceleration_dps2: float | None = None
    ) -> None:
        """Set VEL, and ACL if an acceleration is given, for moves to an angle."""
        self._require_axis(axis)
        self._turn_dps, self._turn_dps2 = max_rate_dps, max_acceleration_dps2

    def servo_on(self) -> None:
        """Stop and close the servo loop."""
        self._command("STO")
        self._command("SRV1")

    def home(self, axis: str = "") -> None:
        """Look for the home position."""
        self._come_to_rest(axis)
        self._set_turn_limits()
        self._command("HOM")

    def point(self, angle_deg: float, axis: str = "") -> None:
        """Turn to an angle the shortest way, by a relative move from where the axis stands."""
        self._require_finite(angle_deg)
        self._come_to_rest(axis)
        self._set_turn_limits()
        before_deg = self._number(POSITION)
        self._move(math.remainder(angle_deg - before_deg, 360.0), before_deg)

    def turn(self, by_deg: float, axis: str = "") -> None:
        """Turn from where the axis stands, in the sense of the sign."""
        self._require_finite(by_deg)
        self._come_to_rest(axis)
        self._set_turn_limits()
        self._move(by_deg, self._number(POSITION))

    def spin(self, rate_dps: float, axis: str = "", acceleration_dps2: float | None = None) -> None:
        """Jog at a rate; 0 stops."""
        self._require_axis(axis)
        self._require_finite(rate_dps)
        if acceleration_dps2 is not None:
            self._command("ACL", acceleration_dps2)
        if rate_dps == 0.0:
            self._command("STO")
            return

        def jog() -> None:
            self._settle_input()
            self.link.write(encode("JOG", rate_dps, signed=True))
            self.link.write(encode("STA"))
            if not is_number(self._reply(f"JOG{rate_dps:+g}")):
                with contextlib.suppress(DeviceSilent):
                    self._reply("STA")

        command_with_retry(self.link, jog)

    def request_state(self) -> None:
        """Ask for the rate without waiting; `read_state` must follow before anything else."""
        self._ask_state(RATE + END)

    def read_state(self) -> TableState:
        """Take the answer to `request_state` and ask the angle."""
        rate_dps = self._collected(self.request_state, lambda: self._decoded(self._reply("PVE")))
        return TableState(self._number(POSITION) % 360.0, rate_dps)

    def alarms(self) -> list[str]:
        """Return nothing: what the bits of STA mean is not public. A fault shows as a table that leaves its
        demand."""
        return []

    def _send_stop(self) -> None:
        """Send a line end, which closes a command that was cut off halfway, and STO."""
        self.link.write(END + encode("STO"))

    def make_safe(self) -> None:
        """Stop; when that is not confirmed, open the servo loop. Answers to older questions are passed over."""
        self._once_halted()
        while self.link.read_some(_QUIET_S):
            pass
        try:
            self._tell("STO")
        except TROUBLES:
            self._tell("SRV0")

    def read_rest(self) -> Rest:
        """Read the rate: at rest below 0.01 deg/s."""
        rate_dps = self._number(RATE)
        return Rest(abs(rate_dps) < REST_DPS, {self.axes[-1]: rate_dps})

    def _set_turn_limits(self) -> None:
        if self._turn_dps is not None:
            self._command("VEL", self._turn_dps)
        if self._turn_dps2 is not None:
            self._command("ACL", self._turn_dps2)

    def _come_to_rest(self, axis: str) -> None:
        """A relative move counts from a standstill only."""
        self._require_axis(axis)
        if abs(self._number(RATE)) < REST_DPS:
            return
        self._command("STO")
        deadline = self.link.clock.now() + STANDSTILL_TIMEOUT_S
        while abs(rate_dps := self._number(RATE)) >= REST_DPS:
            if self.link.clock.now() >= deadline:
                raise DeviceRefused(
                    "the table does not come to rest",
                    where=self._where,
                    found=f"{rate_dps:.3f} deg/s {STANDSTILL_TIMEOUT_S:g} s after STO",
                    expected="a standstill before a move",
                    remedy="check the servo and the table's panel",
                )
            self.link.clock.sleep(_PAUSE_S)

    def _move(self, by_deg: float, before_deg: float) -> None:
        self._turn_once(
            lambda: self._tell("RMO", by_deg),
            before_deg,
            lambda: self._number(POSITION),
            lambda: self._number(RATE),
        )

    def _number(self, query: bytes) -> float:
        return query_with_retry(self.link, lambda: self._ask(query))

    def _ask(self, query: bytes) -> float:
        self._settle_input()
        self.link.write(query + END)
        return self._decoded(self._reply(query.decode("ascii")))

    def _decoded(self, answer: bytes) -> float:
        try:
            return decode_number(answer)
        except ProtocolError as error:
            raise ProtocolError(
                error.what, where=self._where, found=error.found, expected=error.expected, remedy=error.remedy
            ) from error

    def _command(self, mnemonic: str, value: float | None = None) -> None:
        """Tell what does the same when it is told twice; there is no query to read it back."""
        command_with_retry(self.link, lambda: self._tell(mnemonic, value))

    def _tell(self, mnemonic: str, value: float | None = None) -> None:
        self._settle_input()
        self.link.write(encode(mnemonic, value))
        self._reply(mnemonic if value is None else f"{mnemonic}{value:g}")

    def _reply(self, asked: str) -> bytes:
        answer, _ = split_reply(self.link.read_until(PROMPT, REPLY_TIMEOUT_S)) or (b"", 0)
        if b"?" in answer:
            raise DeviceRefused(
                f"the table refused {asked!r}",
                where=self._where,
                found=repr(answer.decode("latin-1")),
                expected="an answer without a question mark",
                remedy="check the demand against the table's limits, the servo and the panel",
            )
        return answer
