"""The way to the safe state, for a run that ends and for the watchdog: tell, confirm, read back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import TypeVar

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
_TELL_AGAIN_S = 5.0
RETURN_S = 20.0
"""How long the port of a device that went away is looked for."""
_LOOK_S = 0.5
_GONE, _DEAF = "its port is gone", "it does not confirm its stop"


_T = TypeVar("_T")


def bring_to_rest(
    devices: Mapping[str, Instrument],
    clock: Clock,
    say: Callable[[str, str], None],
    *,
    away: Callable[[str, str], None] = lambda name, what: None,
    timeout_s: float = REST_TIMEOUT_S,
) -> dict[str, str]:
    """Stop every device, wait for its word, read back that it is at rest; return by name what was not confirmed.

    The stop commands of all leave first, before any answer is awaited or anything written down. A device that
    does not answer, or a port that goes away meanwhile, does not keep the others from being told and read back.
    A device that is silent or refuses is told on when the others rest, for `timeout_s` in all. A port that is
    away is looked for then, for 20 s, and its device told when it is back.
    `say(name, text)` gets what each one reads back; `away(name, what)` whose port is gone or who does not obey,
    as soon as all others have been told and with every further try: somebody may stand beside it.
    """
    for device in devices.values():
        with suppress(BenchError):  # `make_safe` tries again, and says why if it cannot
            device.halt()
    problems: dict[str, str] = {}
    gone: list[str] = []
    untold = list(devices)
    for attempt in range(_TRIES):  # a refusal or a lost answer is no reason to leave a device
        if attempt and untold:
            _pause(clock, _AGAIN_S)
        for name in list(untold):
            try:
                _in_spite_of_others(devices[name], devices[name].make_safe)
                untold.remove(name)
                problems.pop(name, None)
            except BenchError as error:
                problems[name] = str(error)
                if isinstance(error, LinkLost):
                    untold.remove(name)
                    gone.append(name)
    for name in gone:
        away(name, _GONE)
    for name in untold:
        away(name, _DEAF)
    deadline_s = clock.now() + timeout_s

    def read_back(name: str) -> None:
        try:
            text = f"at rest: {_await_rest(devices[name], clock, deadline_s).text}"
            problems.pop(name, None)
            say(name, text)
        except BenchError as error:
            problems[name] = str(error)
            if isinstance(error, LinkLost):
                gone.append(name)

    for name in devices:
        if name not in problems:
            read_back(name)
    while untold and clock.now() < deadline_s:  # the others rest: whoever was silent or refused is told on
        before_s = clock.now()
        _pause(clock, _LATER_S)
        for name in list(untold):
            try:
                _in_spite_of_others(devices[name], devices[name].make_safe)
            except BenchError as error:
                problems[name] = str(error)
                if isinstance(error, LinkLost):
                    untold.remove(name)
                    gone.append(name)
                else:
                    away(name, _DEAF)
                continue
            untold.remove(name)
            del problems[name]
            read_back(name)
        if clock.now() <= before_s:  # it stands still: the lab behind a virtual clock is gone
            break
    until_s = clock.now() + RETURN_S
    while gone:
        for name in list(gone):
            try:
                devices[name].link.reopen()
            except BenchError:  # not yet
                away(name, _GONE)
                continue
            gone.remove(name)
            try:
                _in_spite_of_others(devices[name], devices[name].make_safe)
            except BenchError as error:
                problems[name] = str(error)
                if isinstance(error, LinkLost):
                    gone.append(name)
                    continue
            deadline_s = max(deadline_s, clock.now() + timeout_s)
            read_back(name)
        now_s = clock.now()
        if not gone or now_s >= until_s:
            break
        _pause(clock, _LOOK_S)
        if clock.now() <= now_s:  # it stands still: the lab behind a virtual clock is gone
            break
    for name in gone:
        problems[name] = f"its port is gone and has not come back within {RETURN_S:g} s"
    return problems


def _in_spite_of_others(device: Instrument, work: Callable[[], _T]) -> _T:
    """Do `work` of a device; again, if it met the loss of another port: whoever waits is told of any."""
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

    One that still does not is told again: the stop that left first may have been refused or lost.
    """
    again_s = clock.now() + _TELL_AGAIN_S
    while True:
        _pause(clock, _AGAIN_S)
        try:
            rest = _in_spite_of_others(device, device.read_rest)
            if rest.reached:
                return rest
            found = rest.text
        except (ProtocolError, DeviceSilent) as error:
            found = error.found
        if clock.now() >= again_s:
            again_s = clock.now() + _TELL_AGAIN_S
            with suppress(BenchError):
                device.halt()
                device.make_safe()
        if clock.now() >= deadline_s:
            raise DeviceRefused(
                "it took the command and is not at rest", found=found, expected="a device at rest"
            )
