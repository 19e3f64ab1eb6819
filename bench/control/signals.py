"""What Ctrl-C, SIGTERM and a terminal that closes do: ask a run to stop, and wait while its record is closed."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from drivers.base.clock import Clock

_STOPPING = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
"""What asks a run to stop, of that what the system has: Windows knows the last, and no SIGHUP."""

_Handler = Callable[[int, FrameType | None], None]


def name_of(number: int) -> str:
    """Return a signal as people call it."""
    return "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name


@contextmanager
def asking(clock: Clock) -> Iterator[None]:
    """While a run goes on, Ctrl-C, SIGTERM and a terminal that closes ask the clock to stop; the bench is made
    safe, then we leave. Under nohup a closed terminal stays ignored.
    """

    def ask(number: int, frame: FrameType | None) -> None:
        clock.interrupt.request(f"stopped by {name_of(number)}")

    with _handled(ask):
        yield


@contextmanager
def raising() -> Iterator[None]:
    """Between runs Ctrl-C, SIGTERM and a terminal that closes raise KeyboardInterrupt with their name."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt(name_of(number))

    with _handled(stop):
        yield


@contextmanager
def held(doing: str) -> Iterator[None]:
    """Hold the signals that stop a process until the end, and say what goes on; the last one comes then."""
    came: list[int] = []

    def wait(number: int, frame: FrameType | None) -> None:
        came.append(number)
        with suppress(OSError, ValueError):  # nobody reads it
            sys.stderr.write(f"{name_of(number)}: {doing}, one moment\n")
            sys.stderr.flush()

    try:
        with _handled(wait):
            yield
    finally:
        if came:
            os.kill(os.getpid(), came[-1])


@contextmanager
def _handled(handler: _Handler) -> Iterator[None]:
    try:
        before = {
            number: signal.signal(number, handler)
            for number in (signal.Signals[name] for name in _STOPPING if hasattr(signal, name))
            if number.name != "SIGHUP" or signal.getsignal(number) is signal.SIG_DFL
        }
    except ValueError:  # not the main thread: whoever embeds the bench there owns the signals
        before = {}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)
