"""SCPI over a byte stream: lines with LF at their end, answers in order, an error queue.

Source: SCPI-99 (command and program message syntax, SYSTem:ERRor) and IEEE Std 488.2 (`*IDN?`).
"""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TypeVar

from drivers.base.errors import DeviceRefused, ProtocolError
from drivers.kit.instruments import Identity, Meter
from drivers.kit.kinds import Exchange
from drivers.kit.link import Link
from drivers.kit.matching import match_replies
from drivers.kit.polled import PolledInstrument
from drivers.kit.retry import command_with_retry, misfit, pass_over, query_with_retry

END = b"\n"
REPLY_TIMEOUT_S = 3.0
_MOST_ERRORS = 20
"""SCPI's queues hold 10 to 20 errors; one that never gets empty is none."""
_ERROR = re.compile(r"([+-]?\d+),\s*(.*)")

_T = TypeVar("_T")


def numbers(reply: str, count: int) -> list[float]:
    """Return the `count` numbers of a reply, separated by commas; raises ProtocolError."""
    try:
        values = [float(field) for field in reply.split(",")]
    except ValueError:
        values = []
    if len(values) != count:
        raise ProtocolError("not the numbers asked for", found=repr(reply[:80]), expected=f"{count} numbers")
    return values


def flags(reply: str, count: int) -> list[bool]:
    """Return the `count` truth values (0, 1, OFF, ON) of a reply, separated by commas; raises ProtocolError."""
    words = [field.strip().upper().removeprefix("+") for field in reply.split(",")]
    if len(words) != count or not set(words) <= {"0", "1", "OFF", "ON"}:
        raise ProtocolError("no truth values", found=repr(reply[:80]), expected=f"{count} of 0 or 1")
    return [word in ("1", "ON") for word in words]


def channel_list(channels: Iterable[int]) -> str:
    """Return channels as SCPI writes a list of them: (@101,102)."""
    return f"(@{','.join(map(str, channels))})"


def query_exchanges(exchanges: Iterable[Exchange]) -> Iterator[tuple[int, str, str | None]]:
    """Yield (time in ns, what was written up to and with a query, its reply) of a record; None: no reply came.

    Commands, which have no reply, stand before the query that followed them, one a line.
    """

    def query(buffer: bytes) -> tuple[bytes, int] | None:
        length = 0
        for line in buffer.splitlines(keepends=True):
            length += len(line)
            if line.endswith(END) and b"?" in line:
                return buffer[:length].strip(), length
        return None

    def reply(request: bytes, buffer: bytes) -> tuple[bytes, int] | None:
        end = buffer.find(END)
        return None if end < 0 else (buffer[:end].strip(), end + len(END))

    for at_ns, request, answer in match_replies(exchanges, query, reply):
        text = None if answer is None else answer.decode("latin-1")
        yield at_ns, request.decode("latin-1"), text


class ScpiMeter(PolledInstrument, Meter):
    """The part of a meter (`drivers.kit.instruments.Meter`) that speaks SCPI that is the same for every maker.

    `_models`: how the model in the answer to `*IDN?` begins, one of them.
    """

    _answer_end, _answer_s = END, REPLY_TIMEOUT_S
    _models: tuple[str, ...] = ()

    def __init__(self, link: Link) -> None:
        super().__init__(link)
        self._known_by = f"*IDN? with a model {' or '.join(f'{model}...' for model in self._models)}"

    @abstractmethod
    def _poll(self) -> Sequence[str]:
        """Return the lines that ask for a reading, answers in order."""

    @abstractmethod
    def _take_readings(self) -> Mapping[str, float]:
        """Return the readings by column, of the answers to `_poll`."""

    def request_readings(self) -> None:
        """Ask for readings and wait for nothing."""
        self._ask_state(_lines(*self._poll()))

    def read(self) -> Mapping[str, float]:
        """Return the readings by column, asked for by `request_readings`; NaN for a sensor that is open."""
        return self._collected(self.request_readings, self._take_readings)

    def _introduction(self) -> Identity:
        fields = [field.strip() for field in self._query("*IDN?", str).split(",")]
        if len(fields) != 4 or not fields[1].upper().startswith(self._models):
            raise self._odd(", ".join(fields)[:80], self._known_by)
        maker, model, serial_number, firmware = fields
        return Identity(maker, model, serial_number, firmware)

    def in_step(self) -> bool:
        """Ask who it is: maker, model, serial number, firmware."""

        def is_identity(timeout_s: float) -> bool:
            fields = self.link.read_until(END, timeout_s).decode("latin-1").split(",")
            return len(fields) == 4 and fields[1].strip().upper().startswith(self._models)

        self._settle_input()
        self._write("*IDN?")
        return pass_over(self.link, REPLY_TIMEOUT_S, is_identity)

    def _query(self, text: str, read: Callable[[str], _T]) -> _T:
        """Ask and return what `read` makes of the answer."""

        def ask() -> _T:
            self._settle_input()
            self._write(text)
            return self._read(read)

        return query_with_retry(self.link, ask)

    def _tell(self, commands: str, in_force: Callable[[], bool] | None = None) -> None:
        """Send commands, one a line, and read the error queue; DeviceRefused with what stands there."""

        def tell() -> None:
            self._settle_input()
            self._write(commands, "SYST:ERR?")
            if error := self._read(_error):
                others = [error]
                while len(others) < _MOST_ERRORS and (error := self._query("SYST:ERR?", _error)):
                    others.append(error)
                raise DeviceRefused(
                    f"{self._product} refused {commands.replace(chr(10), '; ')!r}",
                    where=self._where,
                    found="; ".join(others),
                    expected="no error in its queue",
                    remedy="check the values of the bench file against the device's ranges",
                )

        command_with_retry(self.link, tell, in_force)

    def _clear_errors(self) -> None:
        """Take what stands in the error queue from before."""
        for _ in range(_MOST_ERRORS):
            if not self._query("SYST:ERR?", _error):
                return

    def _write(self, *lines: str) -> None:
        self.link.write(_lines(*lines))

    def _read(self, read: Callable[[str], _T]) -> _T:
        """Take the next answer and return what `read` makes of it."""
        reply = self.link.read_until(END, REPLY_TIMEOUT_S).decode("latin-1").strip()
        try:
            return read(reply)
        except ProtocolError as error:
            raise self._odd(error.found, error.expected) from error

    def _odd(self, found: str, expected: str) -> ProtocolError:
        return misfit(self.link.name, self._where, found, expected)


def _lines(*lines: str) -> bytes:
    return "".join(f"{line}\n" for line in lines).encode("ascii")


def _error(reply: str) -> str:
    """Return an entry of the error queue, empty for "no error"; raises ProtocolError."""
    parts = _ERROR.fullmatch(reply)
    if parts is None:
        raise ProtocolError("no entry of an error queue", found=repr(reply[:80]), expected='0,"No error"')
    return "" if int(parts[1]) == 0 else reply
