"""A byte link to one device: pyserial opens and configures it, blocks of bytes move over it.

pyserial's own `read` costs 6 to 9 us a call whatever the size; reading goes by `select` and one `os.read` of
whatever is there. Every wait has a deadline on the bench's clock.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import threading
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

import serial

from drivers.base.clock import Clock
from drivers.base.errors import BenchError, ConfigurationError, DeviceSilent, LinkLost, ProtocolError
from drivers.base.system import SELECTS_FILES, is_pseudo_terminal
from drivers.kit.places import check_place, is_serial, is_visa
from drivers.kit.sockets import SocketPort
from drivers.kit.visa import VisaPort

_BLOCK = 65536
_FULL_S = 5.0
_RESOLUTION_S = 1e-6
"""Deadlines are met to this: a clock may count whole ns."""
_QUIET_S = 0.1
_NOISY_S = 2.0
_NOT_OPENED: tuple[type[Exception], ...] = (serial.SerialException, OSError, ValueError)
with contextlib.suppress(ImportError):  # no POSIX: recorded runs are read there all the same
    import termios

    _NOT_OPENED = (*_NOT_OPENED, termios.error)
"""What pyserial raises; the last, on POSIX no OSError, when a port goes away while it is being set."""
REOPEN_S = 0.3
"""How long `reopen` waits for a port; one that takes longer goes on being opened meanwhile."""


def _nobody(error: BenchError) -> None:
    """Nobody wants to know of repeats."""


def _nothing() -> None:
    """The device has no such question."""


class Tap(Protocol):
    """Somebody who wants every byte of a link: the recorder."""

    def received(self, data: bytes, arrival_s: float) -> None:
        """Take bytes as they came; `arrival_s` is the bench time of the last one."""

    def sent(self, data: bytes, time_s: float) -> None:
        """Take bytes as they were written at bench time `time_s`."""


class Opening:
    """A port or bus being opened, in a thread where that may take its time (5 s for a host that is switched off).

    `errors`: what `opener` raises when it is not there.
    """

    def __init__(
        self, opener: Callable[[], Any], errors: tuple[type[Exception], ...], *, in_background: bool = False
    ) -> None:
        self._opener, self._errors = opener, errors
        self._port: Any = None
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._open, name="opens a port", daemon=True)
        if in_background:
            self._thread.start()
        else:
            self._open()

    def over(self, timeout_s: float) -> bool:
        """Wait; return whether it has ended, well or not."""
        if self._thread.ident is not None:
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def result(self) -> Any:
        """Return the open port, or raise why there is none."""
        if self._error is not None:
            raise self._error
        return self._port

    def _open(self) -> None:
        try:
            self._port = self._opener()
        except self._errors as error:
            self._error = error


class Link:
    """One open port.

    `url` is a device path, `socket://host:port` or a VISA resource; `settings` are pyserial's (baudrate,
    bytesize, parity, stopbits). While `streaming` is set received bytes go to the tap only; otherwise they queue
    in the input buffer for the `read_*` calls too.
    """

    retries = 2
    """How often an exchange that failed is tried again (`drivers.kit.retry`)."""
    retrying = False
    """Whether one is being read back: what is asked meanwhile is asked once."""
    on_retry: Callable[[BenchError], None] = staticmethod(_nobody)
    """Told why an exchange is tried again."""
    fence: Callable[[], object] = staticmethod(_nothing)
    """Asks what has an answer unlike any other, and passes over what comes before it (`drivers.kit.retry`)."""
    spoken = ""
    """How the bench has set a serial port, e.g. "9600 Bd, 8N1"; empty where there is nothing to set."""
    _discarded_s = -math.inf

    def __init__(self, url: str, clock: Clock, *, name: str, tap: Tap | None = None, **settings: Any) -> None:
        check_place(url, name)
        self.url = url
        self.name = name
        self.clock = clock
        self.tap = tap
        self.streaming = False
        self.bytes_received = 0
        self.bytes_sent = 0
        self._buffer = bytearray()
        if is_serial(url):  # two programs that read one serial port get half the bytes each
            settings["exclusive"] = True
            usual = {"baudrate": 9600, "bytesize": 8, "parity": "N", "stopbits": 1}
            self.spoken = "{baudrate} Bd, {bytesize}{parity}{stopbits}".format(**usual | settings)
            # a pseudo-terminal has no line: Linux sets no parity there, and fails the second time
            if is_pseudo_terminal(url):
                settings.pop("parity", None)
        self._settings = settings
        self._opening: Opening | None = None
        self._take_port(self._open())
        clock.attach(self)

    def reopen(self) -> None:
        """Open the port anew after it was lost; what was unread is gone, bytes are counted from zero again.

        ConfigurationError while it is not there, or does not open within 0.3 s: a host that is switched off keeps
        one waiting much longer, and goes on being tried meanwhile.
        """
        self._let_go()
        if self._opening is None:
            self._opening = self._open(in_background=not is_serial(self.url))
        if not self._opening.over(REOPEN_S):
            raise self._not_opened("it does not answer yet")
        opening, self._opening = self._opening, None
        self._take_port(opening)
        self._buffer.clear()
        self.bytes_received = self.bytes_sent = 0
        self.clock.attach(self)

    def _let_go(self) -> None:
        """Leave the clock and close the port; one that is gone may complain."""
        self.clock.detach(self)
        with contextlib.suppress(*_NOT_OPENED):
            self._port.close()

    def _open(self, *, in_background: bool = False) -> Opening:
        def opener() -> Any:
            if is_visa(self.url):
                return VisaPort(self.url)
            # pyserial's `socket://` sleeps 0.3 s when it is closed
            if SELECTS_FILES and is_serial(self.url):
                return serial.serial_for_url(self.url, timeout=0, **self._settings)
            return SocketPort(self.url, **self._settings)

        return Opening(opener, _NOT_OPENED, in_background=in_background)

    def _take_port(self, opening: Opening) -> None:
        try:
            self._port = opening.result()
            self._fd: int = self._port.fileno()
        except _NOT_OPENED as error:
            raise self._not_opened(str(error)) from error
        if SELECTS_FILES:
            os.set_blocking(self._fd, False)
            self._read, self._write = partial(os.read, self._fd), partial(os.write, self._fd)
        else:
            self._read, self._write = self._port.read, self._port.write

    def _not_opened(self, found: str) -> ConfigurationError:
        return ConfigurationError(
            "the port cannot be opened",
            where=self.where,
            found=found,
            expected="a serial device, socket://host:port or VISA resource that exists and is not in use",
            remedy="check cable, power and the port in the bench file; `gyrobench ports` lists what is there",
        )

    @property
    def where(self) -> str:
        """The port in words: its name on the bench and where it is."""
        return f"{self.name} ({self.url})"

    @property
    def set_alike(self) -> str:
        """What to do about settings, to end a remedy."""
        if not self.spoken:
            return ""
        return (
            f"; the bench speaks {self.spoken}: set the device so, or baudrate and address in the bench file "
            f"as the device has them (`gyrobench ports --thorough --port {self.url}` finds them)"
        )

    def fileno(self) -> int:
        """Return the descriptor to select on."""
        return self._fd

    def receive(self) -> bytes:
        """Read what has arrived (one system call, empty if nothing); raises LinkLost when the port is gone."""
        try:
            data = self._read(_BLOCK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._lost(error) from error
        if not data and self._ended():
            raise self._lost("end of stream")
        self.bytes_received += len(data)
        return data

    def deliver(self, data: bytes, arrival_s: float) -> None:
        """Hand received bytes to the tap and, unless streaming or discarded already, to the input buffer."""
        if not data:
            return
        if self.tap is not None:
            self.tap.received(data, arrival_s)
        if not self.streaming and arrival_s >= self._discarded_s:
            self._buffer += data

    def write(self, data: bytes) -> None:
        """Write all of `data`; raises LinkLost when the port is gone or stays full for 5 s."""
        now = self.clock.now()
        view = memoryview(data)
        while view:
            try:
                view = view[self._write(view) :]
            except BlockingIOError:
                if not select.select([], [self._fd], [], _FULL_S)[1]:
                    raise self._lost(f"it has been full for {_FULL_S:g} s") from None
            except OSError as error:
                raise self._lost(error) from error
        self.bytes_sent += len(data)
        if self.tap is not None:
            self.tap.sent(data, now)

    def discard(self) -> bytes:
        """Drop and return unread input (a late reply to an earlier question)."""
        self._discarded_s = self.clock.now()  # what came before it may be delivered after it
        stale = bytes(self._buffer)
        self._buffer.clear()
        return stale

    def drain(self) -> bytes:
        """Drop and return what arrives until nothing has for 0.1 s, at most 2 s of it."""
        dropped, now_s = self.discard(), self.clock.now()
        quiet_s, end_s = now_s + _QUIET_S, now_s + _NOISY_S
        while (now_s := self.clock.now()) < min(quiet_s, end_s) - _RESOLUTION_S:
            if more := self.read_some(min(quiet_s, end_s) - now_s):
                dropped += more
                quiet_s = self.clock.now() + _QUIET_S
        return dropped + self.discard()

    def read_until(self, terminator: bytes, timeout_s: float, *, limit: int = _BLOCK) -> bytes:
        """Return input up to and including `terminator`; DeviceSilent after `timeout_s` of bench time."""
        deadline = self.clock.now() + timeout_s
        start = 0
        while True:
            at = self._buffer.find(terminator, start)
            if at >= 0:
                return self._take(at + len(terminator))
            if len(self._buffer) > limit:
                raise ProtocolError(
                    f"no {terminator!r} in {limit} bytes",
                    where=self.where,
                    found=repr(bytes(self._buffer[:60])),
                    expected=f"a reply that ends in {terminator!r}",
                    remedy=f"check that the bench file names the right device for this port{self.set_alike}",
                )
            start = max(0, len(self._buffer) - len(terminator) + 1)
            self._wait(deadline, timeout_s)

    def read_exactly(self, count: int, timeout_s: float) -> bytes:
        """Return exactly `count` bytes of input; DeviceSilent after `timeout_s` of bench time."""
        deadline = self.clock.now() + timeout_s
        while len(self._buffer) < count:
            self._wait(deadline, timeout_s)
        return self._take(count)

    def read_some(self, timeout_s: float) -> bytes:
        """Return whatever input there is, waiting up to `timeout_s` for the first byte; empty if none.

        Waits 1 us at least: what a caller's rounding leaves of a deadline may be less than a clock counts, and a
        loop until that deadline would never end.
        """
        if not self._buffer:
            self.clock.wait_for(self, self.clock.now() + max(timeout_s, _RESOLUTION_S))
        return self._take(len(self._buffer))

    def close(self) -> None:
        """Close the port; never raises for a port that is already gone."""
        self._let_go()

    def _take(self, count: int) -> bytes:
        data = bytes(self._buffer[:count])
        del self._buffer[:count]
        return data

    def _wait(self, deadline_s: float, timeout_s: float) -> None:
        if not self.clock.wait_for(self, deadline_s) and self.clock.now() >= deadline_s - _RESOLUTION_S:
            raise DeviceSilent(
                f"no complete reply within {timeout_s:g} s",
                where=self.where,
                found=f"{len(self._buffer)} bytes: {bytes(self._buffer[:60])!r}"
                if self._buffer
                else "nothing",
                expected="an answer from the device the bench file names",
                remedy=f"check power, cable and address{self.set_alike}",
            )

    def _ended(self) -> bool:
        """Whether an empty read means that nothing will come any more.

        A socket says so with it; an idle terminal reads empty too (pyserial sets VMIN 0), until it hangs up.
        """
        if not (SELECTS_FILES and os.isatty(self._fd)):
            return True
        poll = select.poll()
        poll.register(self._fd, select.POLLIN)
        return any(event & (select.POLLHUP | select.POLLERR | select.POLLNVAL) for _, event in poll.poll(0))

    def _lost(self, cause: object) -> BenchError:
        return LinkLost(
            "the port is gone",
            where=self.where,
            found=str(cause),
            expected="an open port",
            remedy="check cable, adapter and the device's power",
        )
