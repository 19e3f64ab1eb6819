"""Fixed-length binary frames in a byte stream: vectorised CRC, and frames of one kind cut out.

A frame is a sync word, a payload and a checksum. Nothing here knows a device: a codec brings the sync word, the
length and a check, and gets back the frames that passed and where they ended.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.kit.patterns import Check, Pattern
from drivers.kit.splitting import Kind, StreamSplitter

_BLOCK = 512  # Messages a CRC pass: the table indices of 28 x 512 bytes stay in the second-level cache.
_MANY = 2048  # So many messages are faster by words, though each word is a pass of its own.
_WORDS = 16384  # Messages a pass by words.


@dataclass(frozen=True)
class Crc:
    """A cyclic redundancy check in the terms of the Rocksoft model (Williams, 1993).

    `width` in bits (8 to 32, a multiple of 8); `poly` in normal notation (most significant bit first) also when
    `reflected`, which means that bytes go in least significant bit first and the register comes out mirrored.
    """

    width: int
    poly: int
    init: int
    reflected: bool = False
    xor_out: int = 0

    def of(self, data: bytes) -> int:
        """Return the CRC of `data`, bit by bit: the definition, for tests, tables and short messages."""
        return self._shift(data, self.init) ^ self.xor_out

    def _shift(self, data: bytes, register: int) -> int:
        top, mask = 1 << (self.width - 1), (1 << self.width) - 1
        for byte in data:
            register ^= (_mirror(byte, 8) if self.reflected else byte) << (self.width - 8)
            for _ in range(8):
                register = ((register << 1) ^ (self.poly if register & top else 0)) & mask
        return _mirror(register, self.width) if self.reflected else register


def _mirror(value: int, width: int) -> int:
    return int(f"{value:0{width}b}"[::-1], 2)


class PositionalCrc:
    """The CRC of many equally long messages at once.

    A CRC is linear over GF(2), so that of an n-byte message is a constant XOR one table entry a byte:
    crc = c ^ T[0][b0] ^ ... ^ T[n-1][b(n-1)]. The table look-ups are independent of each other, unlike those of
    the serial algorithm, and vectorise over messages. Bytes known beforehand (`prefix`) go into the constant.
    Many messages go the serial way instead, two bytes a step over all of them: half the look-ups.
    """

    def __init__(self, crc: Crc, prefix: bytes, length: int, padding: int = 0) -> None:
        """Prepare for messages of `prefix`, `length` bytes, and `padding` zeros that are not sent."""
        self.length = length
        self._constant = np.uint32(crc.of(prefix + bytes(length + padding)))
        self._table = _byte_table(crc.width, crc.poly, crc.reflected)
        self._row = (np.arange(length - 1, -1, -1) + padding)[:, None] * 256
        self._crc = crc
        self._padding = padding

    def __call__(self, messages: NDArray[np.uint8]) -> NDArray[np.uint32]:
        """Return the CRCs, shape (n,), of `messages`, shape (n, length), prefix left out."""
        count = len(messages)
        if count >= _MANY and self.length > 1:
            return self._by_words(messages)
        result = np.empty(count, np.uint32)
        table = self._table.upto(self.length + self._padding)
        index = np.empty(self.length * min(count, _BLOCK), np.intp)
        terms = np.empty(index.size, np.uint32)
        for at in range(0, count, _BLOCK):
            block = messages[at : at + _BLOCK].T
            here, there = (a[: block.size].reshape(block.shape) for a in (index, terms))
            np.add(block, self._row, out=here)
            table.take(here, out=there, mode="clip")  # "raise" would copy `out` once more.
            np.bitwise_xor.reduce(there, axis=0, out=result[at : at + _BLOCK])
        result ^= self._constant
        return result

    def _by_words(self, messages: NDArray[np.uint8]) -> NDArray[np.uint32]:
        """As `__call__`. From a register of zero, zeros before a message change nothing: an odd one gets one."""
        crc = self._crc
        if messages.strides[1] != 1:
            messages = np.ascontiguousarray(messages)
        front = (self.length + self._padding) % 2
        whole = (self.length - front) // 2
        tail = (self.length - front) % 2
        table = _word_table(crc.width, crc.poly, crc.reflected)
        count, lone, steps = len(messages), front + whole, (self.length + self._padding + 1) // 2
        result = np.empty(count, np.uint32)
        words = np.zeros((steps, min(count, _WORDS)), np.uint16)
        index, term = np.empty(words.shape[1], np.intp), np.empty(words.shape[1], table.dtype)
        # The half of the register that the next two bytes of a message meet, among its uint16.
        halves = table.itemsize // 2
        near = 0 if crc.reflected == (sys.byteorder == "little") else halves - 1
        shift = np.right_shift if crc.reflected else np.left_shift
        for at in range(0, count, _WORDS):
            part = messages[at : at + _WORDS]
            word, here, there = (array[..., : len(part)] for array in (words, index, term))
            pairs = part[:, front : front + 2 * whole].view("<u2" if crc.reflected else ">u2")
            np.copyto(word[front:lone], pairs.T)
            if front:
                np.left_shift(part[:, 0], 8 if crc.reflected else 0, out=word[0], dtype=np.uint16)
            if tail:
                np.left_shift(part[:, -1], 0 if crc.reflected else 8, out=word[lone], dtype=np.uint16)
            register = table.take(word[0], mode="clip")
            met = register.view(np.uint16)[near::halves]
            for each in word[1:]:
                np.bitwise_xor(met, each, out=here, dtype=np.uint16)
                if halves == 1:
                    table.take(here, out=register, mode="clip")
                else:
                    table.take(here, out=there, mode="clip")
                    shift(register, 16, out=register)
                    register ^= there
            result[at : at + len(part)] = register
        if not crc.reflected:
            result >>= np.uint32(8 * table.itemsize - crc.width)
        result ^= self._constant
        return result


def crc_of_each(crc: Crc, messages: Sequence[bytes]) -> NDArray[np.uint32]:
    """Return the CRCs of one or more messages of any lengths, (n,)."""
    sizes = np.array([len(message) for message in messages])
    # A zero in front adds nothing, and so no message is empty.
    flat = np.frombuffer(b"\0" + b"\0".join(messages), np.uint8)
    ends = np.cumsum(sizes + 1)
    behind = np.repeat(ends, sizes + 1) - np.arange(1, len(flat) + 1)
    table = _byte_table(crc.width, crc.poly, crc.reflected)
    terms = table.upto(int(sizes.max()) + 1)[behind * 256 + flat]
    result: NDArray[np.uint32] = np.bitwise_xor.reduceat(terms, ends - sizes - 1)
    return result ^ table.of_zeros(crc, sizes)


class _ByteTable:
    """What each byte adds to a message's CRC, by how many bytes follow it: one table for all lengths."""

    def __init__(self, crc: Crc) -> None:
        self._crc = crc
        self._last = np.array([crc.of(bytes([byte])) for byte in range(256)], np.uint32)
        self._rows = self._last[None]
        self._zeros: dict[int, NDArray[np.uint32]] = {}

    def upto(self, length: int) -> NDArray[np.uint32]:
        """Return at least the entries of messages of `length` bytes, 256 for each number of bytes that follow."""
        if len(self._rows) < length:
            self._rows = self._grown(self._rows, length)
        return self._rows.ravel()

    def of_zeros(self, crc: Crc, sizes: NDArray[np.int64]) -> NDArray[np.uint32]:
        """Return the CRCs of so many zeros each, from `crc`'s own register on."""
        known = self._zeros.get(crc.init)
        if known is None:
            known = np.array([[crc.of(b"") ^ crc.xor_out]], np.uint32)
        if len(known) <= sizes.max():
            known = self._grown(known, int(sizes.max()) + 1)
        self._zeros[crc.init] = known
        found: NDArray[np.uint32] = known[sizes, 0] ^ np.uint32(crc.xor_out)
        return found

    def _grown(self, known: NDArray[np.uint32], length: int) -> NDArray[np.uint32]:
        """Return rows of which each follows from the one before by a byte of zeros."""
        rows = np.empty((1 << (length - 1).bit_length(), known.shape[1]), np.uint32)
        rows[: len(known)] = known
        for at in range(len(known), len(rows)):
            rows[at] = self._next(rows[at - 1])
        return rows

    def _next(self, register: NDArray[np.uint32]) -> NDArray[np.uint32]:
        """Return what a register is after a byte of zeros."""
        if self._crc.reflected:
            after: NDArray[np.uint32] = register >> 8 ^ self._last[register & 0xFF]
        else:
            mask = np.uint32((1 << self._crc.width) - 1)
            after = register << 8 & mask ^ self._last[register >> (self._crc.width - 8)]
        return after


@cache
def _byte_table(width: int, poly: int, reflected: bool) -> _ByteTable:
    return _ByteTable(Crc(width, poly, 0, reflected))


@cache
def _word_table(width: int, poly: int, reflected: bool) -> NDArray[Any]:
    """Return what each two bytes make of a register of zero, uint16 or uint32 (65536,).

    The register is at the upper end of its word, or at the lower if `reflected`, and so is the earlier byte.
    """
    size = 16 if width <= 16 else 32
    step = Crc(size, poly << (size - width), 0, reflected)
    one = np.array([step.of(bytes([byte])) for byte in range(256)], f"u{size // 8}")
    early, late = np.arange(65536) >> 8, np.arange(65536) & 0xFF
    table: NDArray[Any] = one[early]
    if reflected:
        table = ((table >> 8) ^ one[(table & 0xFF) ^ late]).reshape(256, 256).T.ravel()
    else:
        table = (table << 8) ^ one[(table >> (size - 8)) ^ late]
    return table


class FrameSplitter:
    """Cuts a byte stream into checked frames of one fixed length, incrementally: a `StreamSplitter` of one kind.

    A sound frame may share its last byte with the sync word of the next: a lost last byte is made good by an
    equal first byte that follows. Fewer than `length` bytes are kept between calls.
    """

    def __init__(self, sync: bytes, length: int, check: Check) -> None:
        """Raise ValueError for a sync word that can begin inside itself."""
        if sync.count(sync[0]) != 1 or len(sync) < 2:
            raise ValueError(f"sync word {sync.hex()}: the first byte must not come again")
        pattern = Pattern([(at, byte, 0xFF) for at, byte in enumerate(sync)], len(sync))
        self._splitter = StreamSplitter([Kind((pattern,), lambda _: check, length, length)])
        self._length = length
        self.counts = self._splitter.counts

    def feed(self, data: bytes) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """Return the sound frames completed by `data`, uint8 (n, length), and the offsets of their ends, (n,)."""
        pieces = self._splitter.feed(data)
        if len(pieces) == 1:
            return pieces[0].rows, pieces[0].ends
        rows = [np.empty((0, self._length), np.uint8), *(piece.rows for piece in pieces)]
        return np.concatenate(rows), np.concatenate(
            [np.empty(0, np.int64), *(piece.ends for piece in pieces)]
        )
