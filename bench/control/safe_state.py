"""The way to the safe state, for a run that ends and for the watchdog: command, confirm, read back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeVar

from bench.record.events.safe import Cause, LastSeen, NotSafe, SafeState, read_back_words
from drivers.base.clock import Clock
from drivers.base.errors import BenchError, DeviceRefused, DeviceSilent, LinkLost, ProtocolError
from drivers.kit.instruments import Instrument, Rest

REST_TIMEOUT_S = 60.0
"""A large table takes tens of seconds from its highest rate to zero."""

_AGAIN_S = 0.2
_TRIES = 3
_LATER_S = 2.0
_OTHERS = 16
"""Ports that may go away one after the other while one device is being stopped."""
_COMMAND_AGAIN_S = 5.0
RETURN_S = 20.0
"""How long the port of a device that went away is looked for."""
_LOOK_S = 0.5

_T = TypeVar("_T")


@dataclass(frozen=True)
class Reading:
    """What the way to the safe state found at one device: at rest when there is no `code` against it.

    `rest` is what it read back last, if anything; `error` what it or its port answered instead.
    """

    rest: Rest | None = None
    code: NotSafe | None = None
    error: BenchError | None = None

    @classmethod
    def of(cls, error: BenchError) -> Reading:
        """Return what an error says of a device."""
        if isinstance(error, _NotAtRest):
            return cls(error.rest, "not_at_rest", error)
        if isinstance(error, LinkLost):
            return cls(None, "port_gone", error)
        if isinstance(error, DeviceSilent):
            return cls(None, "silent", error)
        return cls(None, "garbled" if isinstance(error, ProtocolError) else "refused", error)

    def fact(self, device: str, cause: Cause, why: str, seen: LastSeen | None = None) -> SafeState:
        """Return it as an event."""
        rest = self.rest or Rest(False)
        return SafeState(
            device,
            "not_confirmed" if self.code else "confirmed",
            cause,
            why,
            code=self.code,
            error=str(self.error) if self.error is not None else None,
            rates_dps=dict(rest.rates_dps) or None,
            running=rest.running,
            set_point_c=rest.set_point_c,
            outputs=dict(rest.outputs) or None,
            last_seen=seen if self.code else None,
        )


class _NotAtRest(DeviceRefused):
    """A device that took the command and does not come to rest; `rest` is what it said last, if anything."""

    def __init__(self, rest: Rest | None, found: str) -> None:
        super().__init__("it took the command and is not at rest", found=found, expected="a device at rest")
        self.rest = rest


def bring_to_rest(
    devices: Mapping[str, Instrument],
    clock: Clock,
    *,
    away: Callable[[str, NotSafe], None] = lambda name, code: None,
    timeout_s: float = REST_TIMEOUT_S,
) -> dict[str, Reading]:
    """Stop every device, wait for its word, read back that it is at rest; return what each one came to.

    The stop commands of all leave first, before any answer is awaited or anything written down. A device that
    does not answer, or a port that goes away meanwhile, does not keep the others from it. A device that is
    silent or refuses is commanded again when the others rest, for `timeout_s` in all. A port that is away is
    looked for then, for 20 s, and its device commanded when it is back.
    `away(name, code)` gets whose port is gone or who does not obey, as soon as all others have been commanded and
    with every further try: somebody may stand beside it. The result is in the order in which they were read back,
    those that are not at rest last.
    """
    return _Way(devices, clock, away, timeout_s).go()


class _Way:
    """The way to rest of some devices: who has not confirmed, whose port is gone, what each one read back."""

    def __init__(
        self,
        devices: Mapping[str, Instrument],
        clock: Clock,
        away: Callable[[str, NotSafe], None],
        timeout_s: float,
    ) -> None:
        self._devices, self._clock, self._away, self._timeout_s = devices, clock, away, timeout_s
        self._unconfirmed = list(devices)
        self._gone: list[str] = []
        self._rests: dict[str, Reading] = {}
        self._problems: dict[str, Reading] = {}
        self._deadline_s = 0.0

    def go(self) -> dict[str, Reading]:
        """Go all of it."""
        self._command_all()
        self._deadline_s = self._clock.now() + self._timeout_s
        for name in self._devices:
            if name not in self._problems:
                self._read_back(name)
        self._command_again()
        self._await_ports()
        return {
            name: found for name, found in self._rests.items() if name not in self._problems
        } | self._problems

    def _command_all(self) -> None:
        """Stop all at once, then await its word: one refusal or a lost answer is no reason to leave it."""
        for device in self._devices.values():
            with suppress(BenchError):  # `make_safe` tries again, and says why if it cannot
                device.halt()
        for attempt in range(_TRIES):
            if attempt and self._unconfirmed:
                _pause(self._clock, _AGAIN_S)
            for name in list(self._unconfirmed):
                self._command(name)
        for name in self._gone:
            self._away(name, "port_gone")
        for name in self._unconfirmed:
            self._away(name, "not_confirming")

    def _command(self, name: str) -> bool:
        """Command one device to rest; return whether it confirmed that."""
        try:
            _in_spite_of_others(self._devices[name], self._devices[name].make_safe)
        except BenchError as error:
            self._fail(name, error)
            return False
        self._unconfirmed = [other for other in self._unconfirmed if other != name]
        self._problems.pop(name, None)
        return True

    def _fail(self, name: str, error: BenchError) -> None:
        self._problems[name] = Reading.of(error)
        if isinstance(error, LinkLost):
            self._unconfirmed = [other for other in self._unconfirmed if other != name]
            if name not in self._gone:
                self._gone.append(name)

    def _read_back(self, name: str) -> None:
        try:
            self._rests[name] = Reading(_await_rest(self._devices[name], self._clock, self._deadline_s))
        except BenchError as error:
            self._fail(name, error)
        else:
            self._problems.pop(name, None)

    def _command_again(self) -> None:
        """The others rest: command whoever was silent or refused until it confirms, or time is over."""
        while self._unconfirmed and self._clock.now() < self._deadline_s:
            before_s = self._clock.now()
            _pause(self._clock, _LATER_S)
            for name in list(self._unconfirmed):
                if self._command(name):
                    self._read_back(name)
                elif name in self._unconfirmed:
                    self._away(name, "not_confirming")
            if self._clock.now() <= before_s:  # it stands still: the lab behind a virtual clock is gone
                break

    def _await_ports(self) -> None:
        """Look for ports that went away; command the device whose port is back."""
        until_s = self._clock.now() + RETURN_S
        while self._gone:
            for name in list(self._gone):
                self._look_for(name)
            now_s = self._clock.now()
            if not self._gone or now_s >= until_s:
                break
            _pause(self._clock, _LOOK_S)
            if self._clock.now() <= now_s:  # it stands still: the lab behind a virtual clock is gone
                break

    def _look_for(self, name: str) -> None:
        try:
            self._devices[name].link.reopen()
        except BenchError:  # not yet
            self._away(name, "port_gone")
            return
        self._gone.remove(name)
        if self._command(name) or name not in self._gone:  # one that refuses may be at rest all the same
            self._deadline_s = max(self._deadline_s, self._clock.now() + self._timeout_s)
            self._read_back(name)


def _in_spite_of_others(device: Instrument, work: Callable[[], _T]) -> _T:
    """Do `work` of a device; again, if it met the loss of another port: whoever waits gets any."""
    for _ in range(_OTHERS):
        try:
            return work()
        except LinkLost:
            if _is_gone(device):
                raise
    return work()


def _is_gone(device: Instrument) -> bool:
    """Whether not even a stop command can be written to the device."""
    try:
        device.halt()
    except LinkLost:
        return True
    except BenchError:
        return False
    return False


def _pause(clock: Clock, duration_s: float) -> None:
    """Wait, whatever port goes away meanwhile."""
    end_s = clock.now() + duration_s
    for _ in range(_OTHERS):
        with suppress(LinkLost):
            clock.sleep(end_s - clock.now())
            return


def _await_rest(device: Instrument, clock: Clock, deadline_s: float) -> Rest:
    """Read back until the device rests; replies to what was cut off when all began pass by in the pauses.

    One that still does not is commanded again: the stop that left first may have been refused or lost.
    """
    again_s = clock.now() + _COMMAND_AGAIN_S
    rest: Rest | None = None
    while True:
        _pause(clock, _AGAIN_S)
        try:
            rest = _in_spite_of_others(device, device.read_rest)
            if rest.reached:
                return rest
            found = read_back_words(rest.rates_dps, rest.running, rest.set_point_c, rest.outputs)
        except (ProtocolError, DeviceSilent) as error:
            rest, found = None, error.found
        if clock.now() >= again_s:
            again_s = clock.now() + _COMMAND_AGAIN_S
            with suppress(BenchError):
                device.halt()
                device.make_safe()
        if clock.now() >= deadline_s:
            raise _NotAtRest(rest, found)
