"""Modbus master over a link: pymodbus frames and messages, our port and our clock.

pymodbus' own client opens the port itself and waits on asyncio or the host's clock; only its framers and its
message classes, which know neither, are used. One request is answered before the next one is sent.
"""

from __future__ import annotations

import contextlib
import logging
import struct
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Literal

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerBase, FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

from drivers.base.errors import DeviceRefused, DeviceSilent, ProtocolError
from drivers.kit.link import Link
from drivers.kit.retry import command_with_retry, misfit, pass_over, query_with_retry

Framing = Literal["rtu", "tcp"]

TIMEOUT_S = 1.5
"""Three tries outlast a line that is silent for 3 s, as those of the other chambers do."""
GAP_S = 0.03
"""Quiet between RTU frames. The standard asks for 3.5 characters; ESPEC's own library waits 30 ms for
Watlow."""

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, BUSY = 1, 2, 3, 6
EXCEPTIONS = {
    1: "illegal function",
    2: "illegal data address: the controller has no such register",
    3: "illegal data value",
    4: "device failure",
    5: "acknowledged, still working",
    6: "device busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target does not answer",
}
"""Modbus Application Protocol V1.1b3, section 7."""

# pymodbus reports bytes it cannot decode to its log; whoever asked is told by an error instead
logging.getLogger("pymodbus.logging").addHandler(logging.NullHandler())


class Frames:
    """Builds and takes apart frames, for a master (`server=False`) or a device; no I/O."""

    def __init__(self, framing: Framing, *, server: bool) -> None:
        self._server = server
        self._decoder = DecodePDU(server)
        self._framer: FramerBase = (FramerRTU if framing == "rtu" else FramerSocket)(self._decoder)
        self.framing = framing

    def build(self, message: ModbusPDU) -> bytes:
        """Return the frame of a message; its `dev_id` and `transaction_id` go with it."""
        return self._framer.buildFrame(message)

    def split(self, buffer: bytes) -> tuple[ModbusPDU, int] | None:
        """Return the first message in `buffer` and the bytes it takes; None while incomplete.

        An RTU frame takes the rest of the buffer with it: what follows a reply there is noise (some Watlow F4
        add two zero bytes). Raises ProtocolError for a frame whose check fails or that is no message. To a
        device, a request that cannot be read, as of 126 registers, comes as the exception it must answer.
        """
        used, device, transaction, body = self._framer.decode(buffer)
        foreign = self.framing == "tcp" and buffer[2:4] not in (b"", b"\0", b"\0\0")
        if not used and not foreign:
            return None
        message = None if foreign else self._message(body)
        if message is None and self._server and body:
            message = ExceptionResponse(body[0], ILLEGAL_VALUE)
        if message is None:
            raise ProtocolError(
                "not a Modbus message",
                found=buffer[:40].hex(" "),
                expected="a frame whose CRC is right"
                if self.framing == "rtu"
                else "a frame with an MBAP header",
                remedy="check baud rate, wiring and termination, and that one master only talks on this line",
            )
        message.dev_id, message.transaction_id = device, transaction
        return message, used

    def _message(self, body: bytes) -> ModbusPDU | None:
        if not body:
            return None
        try:
            return self._decoder.decode(body)
        except (ModbusException, struct.error, IndexError, ValueError):
            return None


class ModbusMaster:
    """Reads and writes holding registers (relative numbers, no 40001) of one device.

    DeviceSilent when it does not answer in time, ProtocolError for a damaged reply or somebody else's,
    DeviceRefused with its words for an exception: for good when the exchange has been tried again.
    `words`: what is in a register, for messages.
    """

    def __init__(
        self, link: Link, framing: Framing, device: int, words: Mapping[int, str] = MappingProxyType({})
    ) -> None:
        self._link = link
        self._words = words
        self._frames = Frames(framing, server=False)
        self._device = device
        self._transaction = 0
        self._quiet_until_s = 0.0
        self._asked: ModbusPDU | None = None

    def read(self, start: int, count: int) -> tuple[int, ...]:
        """Return `count` registers from `start`, each 0..65535."""

        def ask() -> tuple[int, ...]:
            self.request(start, count)
            return self.take()

        return query_with_retry(self._link, ask)

    def collect(self, start: int, count: int) -> tuple[int, ...]:
        """Return registers as `read` does, without asking if `request` has asked for them just before; once."""
        if self._asked is None or (self._asked.address, self._asked.count) != (start, count):
            self.request(start, count)
        return self.take()

    def request(self, start: int, count: int) -> None:
        """Ask for registers without waiting; `take` must follow."""
        with contextlib.suppress(DeviceRefused, DeviceSilent, ProtocolError):
            self.settle()
        self._send(ReadHoldingRegistersRequest(address=start, count=count))

    def take(self) -> tuple[int, ...]:
        """Return the registers asked for by `request`."""
        asked, answer = self._asked, self._answer()
        if asked is None or len(answer.registers) != asked.count:
            raise self._odd(f"{len(answer.registers)} registers", "as many as were asked for")
        return tuple(answer.registers)

    def write(self, start: int, words: Sequence[int]) -> None:
        """Write registers from `start`: function 6 for one, 16 for several; read back if it is not confirmed."""

        def tell() -> None:
            with contextlib.suppress(DeviceRefused, DeviceSilent, ProtocolError):
                self.settle()
            if len(words) == 1:
                self._send(WriteSingleRegisterRequest(address=start, registers=list(words)))
            else:
                self._send(WriteMultipleRegistersRequest(address=start, registers=list(words)))
            self._answer()

        command_with_retry(self._link, tell, lambda: self.read(start, len(words)) == tuple(words))

    def in_step(self, start: int, count: int) -> bool:
        """Read registers that are more or fewer than any other read of a run has; return whether their answer was
        the first to come.
        """
        self.request(start, count)
        asked = self._asked

        def fits(timeout_s: float) -> bool:
            self._asked = asked
            return len(self._answer().registers) == count

        return pass_over(self._link, TIMEOUT_S, fits)

    def send_write(self, start: int, word: int) -> None:
        """Write one register and wait for nothing, not even for quiet on the line."""
        self._asked = None
        self._link.discard()
        self._send(WriteSingleRegisterRequest(address=start, registers=[word]))

    def settle(self) -> None:
        """Take the answer to a question nobody read, and drop late ones; raises what is wrong with it."""
        try:
            if self._asked is not None:
                self._answer()
        finally:
            self._link.discard()
            if (left_s := self._quiet_until_s - self._link.clock.now()) > 0.0:
                self._link.clock.sleep(left_s)

    def _send(self, message: ModbusPDU) -> None:
        if self._frames.framing == "tcp":
            self._transaction = self._transaction % 0xFFFF + 1
        message.dev_id, message.transaction_id = self._device, self._transaction
        self._link.write(self._frames.build(message))
        self._asked = message

    def _answer(self) -> ModbusPDU:
        asked, self._asked = self._asked, None
        deadline_s = self._link.clock.now() + TIMEOUT_S
        received = b""
        while True:
            try:
                found = self._frames.split(received)
            except ProtocolError as error:
                self._heard()
                raise self._odd(error.found, error.expected) from error
            if found is not None:
                answer, used = found
                if answer.transaction_id == self._transaction:
                    break
                received = received[used:]  # the late answer to an earlier question
                continue
            left_s = deadline_s - self._link.clock.now()
            more = self._link.read_some(left_s) if left_s > 0.0 else b""
            if not more and self._link.clock.now() >= deadline_s - 1e-6:
                raise self._silent(received)
            received += more
        self._heard()
        if asked is None or answer.dev_id != self._device:
            raise self._odd(f"an answer of device {answer.dev_id}", f"one of device {self._device}")
        if isinstance(answer, ExceptionResponse):
            raise self._refused(asked, answer.exception_code)
        if answer.function_code != asked.function_code:
            raise self._odd(f"function {answer.function_code}", f"function {asked.function_code}")
        if not isinstance(asked, ReadHoldingRegistersRequest) and answer.address != asked.address:
            raise self._odd(f"register {answer.address} written", f"register {asked.address}")
        return answer

    def _heard(self) -> None:
        if self._frames.framing == "rtu":
            self._quiet_until_s = self._link.clock.now() + GAP_S

    @property
    def _where(self) -> str:
        return f"{self._link.where}, Modbus device {self._device}"

    def _silent(self, received: bytes) -> DeviceSilent:
        return DeviceSilent(
            f"no complete reply within {TIMEOUT_S:g} s",
            where=self._where,
            found=f"{len(received)} bytes: {received[:40].hex(' ')}" if received else "nothing",
            expected="an answer from the device the bench file names",
            remedy=f"check power, cable and the Modbus address{self._link.set_alike}",
        )

    def _refused(self, asked: ModbusPDU, code: int) -> DeviceRefused:
        what = "read" if isinstance(asked, ReadHoldingRegistersRequest) else "write"
        words = self._words.get(asked.address)
        where = f"register {asked.address}"
        return DeviceRefused(
            f"the controller refuses to {what} {f'its {words} ({where})' if words else where}",
            where=self._where,
            found=f"exception {code}: {EXCEPTIONS.get(code, 'a code the standard does not know')}",
            expected="a value" if what == "read" else f"it takes {asked.registers}",
            remedy="check the controller's model, its limits, and that its panel allows changes over the line",
        )

    def _odd(self, found: str, expected: str) -> ProtocolError:
        return misfit("controller", self._where, found, expected)


def to_signed(word: int) -> int:
    """Return a register as a signed 16-bit number."""
    return word - 0x10000 if word & 0x8000 else word


def float_words(value: float) -> tuple[int, int]:
    """Return the two registers of a float32, low word first as Watlow orders them."""
    high, low = struct.unpack(">HH", struct.pack(">f", value))
    return low, high


def words_float(words: Sequence[int]) -> float:
    """Return the float32 of two registers, low word first."""
    low, high = words
    return float(struct.unpack(">f", struct.pack(">HH", high, low))[0])
