"""Driver of a CTS chamber."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, ClassVar, TypeVar

from drivers.base.errors import DeviceSilent, ProtocolError
from drivers.cts._link import REPLY_TIMEOUT_S, CtsLine
from drivers.cts.codec import (
    AIR,
    CHANNELS,
    ERROR_TEXT,
    FASTEST_K_PER_MIN,
    GRADIENTS,
    RESOLUTION_C,
    START,
    STATUS,
    STOP,
    Analog,
    decode_analog,
    decode_channels,
    decode_error_text,
    decode_gradients,
    decode_status,
    gradient_text,
    set_text,
)
from drivers.kit.chamber import PolledChamber
from drivers.kit.config import ChamberConfig, Mistake, Parity, key
from drivers.kit.instruments import ChamberCapabilities, ChamberLimits, ChamberState, Identity, require_ramp
from drivers.kit.kinds import Connection
from drivers.kit.retry import command_with_retry, misfit, pass_over, query_with_retry

_T = TypeVar("_T")
_InForce = Callable[[], bool]


class CtsConfig(ChamberConfig):
    """`[chamber]` of a CTS; `auxiliary` are analog channels 1 to 6; which are temperatures it does not say."""

    parity: ClassVar[Parity] = "O"
    baudrate: int = key(
        default=19_200, ge=50, le=12_000_000, description="the baud rate, 19200 unless it was changed"
    )
    address: int | None = key(
        default=None, ge=1, le=32, description="the address in every frame, 1 to 32; left out: 1"
    )
    framed: bool | None = key(
        default=None,
        description="true for RS-232, also behind a serial device server, false for the chamber's own TCP port "
        "1080; left out: false at socket://, else true",
    )
    door_channel: int | None = key(
        default=None,
        ge=3,
        le=98,
        description="which digital channel of the answer to 'O' is 1 while the door is closed, counted from 0; "
        "left out: not asked",
    )

    @property
    def in_frames(self) -> bool:
        """Whether commands and answers go in frames."""
        return not self.port.startswith("socket://") if self.framed is None else self.framed

    @property
    def frame_address(self) -> int:
        """The address in every frame."""
        return 1 if self.address is None else self.address

    @classmethod
    def mistakes(cls, given: Mapping[str, Any]) -> Iterator[Mistake]:
        """Yield a door that cannot be asked for: without frames nothing says where the answer ends."""
        bare = given.get("framed") is False or (
            given.get("framed") is None and str(given.get("port")).startswith("socket://")
        )
        if bare and given.get("door_channel") is not None:
            yield Mistake("door_channel", str(given["door_channel"]), "none without frames")


class CtsChamber(PolledChamber):
    """One chamber (`drivers.kit.instruments.Chamber`): its air is analog channel 0, gradients of channel 1."""

    _product = "a CTS chamber"
    _known_by = "answers to its status, temperature and gradients"
    _check = (
        "check which device the bench file names for this port, `framed`, the address, and that its serial line "
        "has odd parity"
    )

    def __init__(self, config: CtsConfig, connection: Connection) -> None:
        link = connection.link(config.port, config.baudrate, parity=config.parity)
        super().__init__(link, connection.safe_set_point_c)
        self.auxiliary = tuple(config.auxiliary)
        self._door_channel = config.door_channel
        self._line = CtsLine(link, framed=config.in_frames, address=config.frame_address)

    def _introduction(self) -> Identity:
        """Ask temperature, gradients, then status, since S alone stops an older Thermotron; a CTS has no name."""
        self._air()
        up, down = self._query(GRADIENTS, decode_gradients)
        self._query(STATUS, decode_status)
        return Identity("CTS", "", details={"gradients, K/min": f"{up:g} up, {down:g} down"})

    def capabilities(self) -> ChamberCapabilities:
        """Tenths of a degree; gradients in steps of 0.01 K/min below 100."""
        return ChamberCapabilities(RESOLUTION_C, (0.01, FASTEST_K_PER_MIN), tuple(range(1, 7)))

    def limits(self) -> ChamberLimits:
        """Return none: no public command reads them."""
        return ChamberLimits(-math.inf, math.inf)

    def set_temperature(self, set_point_c: float, ramp_k_per_min: float | None = None) -> None:
        """Demand a set point; a gradient holds both ways and for all set points to come, None is the fastest."""
        require_ramp(self.capabilities(), set_point_c, ramp_k_per_min, self._where)
        self._tell_gradients(FASTEST_K_PER_MIN if ramp_k_per_min is None else ramp_k_per_min)
        self._tell_set_point(set_point_c)

    def request_state(self) -> None:
        """Ask for the air without waiting; `read_state` must follow before anything else."""
        self._settle_input()
        self._line.write(AIR)
        self._state_asked = True

    def read_state(self) -> ChamberState:
        """Take the answer to `request_state`, and ask the auxiliary channels: resolution 0.1 degC."""
        air = self._collected(self.request_state, lambda: self._decoded(decode_analog, self._reply(AIR)))
        auxiliary_c = {number: self._channel(number).actual for number in self.auxiliary}
        return ChamberState(air.actual, air.set_point, auxiliary_c)

    def alarms(self) -> list[str]:
        """Return the error in the chamber's own words, that it pauses, and an open door if it has a channel."""
        status = self._query(STATUS, decode_status)
        found = [self._query(ERROR_TEXT, decode_error_text) or "error without a text"] if status.error else []
        if status.running and status.paused:
            found.append("paused at the chamber")
        if self._door_channel is not None:
            channels = self._query(CHANNELS, decode_channels)
            if channels[self._door_channel : self._door_channel + 1] != "1":
                found.append("door open")
        return found

    def in_step(self) -> bool:
        """Ask for the gradients, which no poll reads."""

        def is_mine(timeout_s: float) -> bool:
            return self._read(timeout_s).startswith(GRADIENTS)

        self._settle_input()
        self._line.write(GRADIENTS)
        return pass_over(self.link, REPLY_TIMEOUT_S, is_mine)

    def _send_stop(self) -> None:
        """Only the stop: where nothing ends a command, whether it may follow another is not public."""
        self._line.write(STOP)

    def _way_to_rest(self) -> Iterable[Callable[[], None]]:
        return (
            self._confirm_stop,
            lambda: self._tell_gradients(FASTEST_K_PER_MIN),
            lambda: self._tell_set_point(self.safe_set_point_c),
        )

    def _confirm_stop(self) -> None:
        """Pass over what answers the stop and what was asked before it; stop again if it still runs."""
        self.in_step()
        if self._is_running():
            self._switch(False)

    def _switch(self, on: bool) -> None:
        self._command(START if on else STOP, lambda: self._is_running() is on)

    def _tell_gradients(self, k_per_min: float) -> None:
        """Both directions, before the set point: no way to it ever begins at an old gradient."""
        for up in (True, False):
            self._command(gradient_text(up, k_per_min), partial(self._has_gradient, up, k_per_min))

    def _has_gradient(self, up: bool, k_per_min: float) -> bool:
        found = self._query(GRADIENTS, decode_gradients)[0 if up else 1]
        return math.isclose(found, k_per_min, rel_tol=0.0, abs_tol=0.051)

    def _tell_set_point(self, temp_c: float) -> None:
        """Tell it again if it is not confirmed: what is read back is where its ramp is, not where it leads."""
        self._command(set_text(temp_c), None)

    def _demanded_c(self) -> float:
        return self._air().set_point

    def _is_running(self) -> bool:
        return self._query(STATUS, decode_status).running

    def _air(self) -> Analog:
        return self._query(AIR, decode_analog)

    def _channel(self, number: int) -> Analog:
        return self._query(f"A{number}", lambda reply: decode_analog(reply, number))

    def _command(self, text: str, in_force: _InForce | None) -> None:
        command_with_retry(self.link, lambda: self._tell(text), in_force)

    def _tell(self, text: str) -> None:
        """Send a command and take its confirmation: its letter, of a start or stop the channel too."""
        self._settle_input()
        self._line.write(text)
        self._reply(text)

    def _query(self, text: str, read: Callable[[str], _T]) -> _T:
        """Ask and return what `read` makes of the answer."""

        def question() -> _T:
            self._settle_input()
            self._line.write(text)
            return self._decoded(read, self._reply(text))

        return query_with_retry(self.link, question)

    def _reply(self, asked: str) -> str:
        """Return the answer to `asked`, which begins as that does."""
        reply = self._read(REPLY_TIMEOUT_S)
        begin = asked[: 2 if asked[0] in "AUs" else 1]
        if not reply.startswith(begin):
            raise self._odd(repr(reply), f"an answer that begins with {begin}")
        return reply

    def _read(self, timeout_s: float) -> str:
        try:
            return self._line.read(timeout_s)
        except ProtocolError as error:
            raise self._odd(error.found, error.expected) from error

    def _settle_input(self) -> None:
        if self._state_asked:
            self._state_asked = False
            with suppress(DeviceSilent, ProtocolError):
                self._line.read()
        self.link.discard()

    def _decoded(self, read: Callable[[str], _T], reply: str) -> _T:
        try:
            return read(reply)
        except ProtocolError as error:
            raise self._odd(error.found, error.expected) from error

    def _odd(self, found: str, expected: str) -> ProtocolError:
        return misfit("chamber", self._where, found, expected)
