"""slcan text to CAN frames and back, vectorised over lines; and an adapter's commands. Needs no python-can.

The format is that of the LAWICEL CAN232/CANUSB manual: a frame is `tIIILDD..`, `TIIIIIIIILDD..` (data, 11 and 29
bit identifiers), `rIIIL` or `RIIIIIIIIL` (remote), digits in hexadecimal, perhaps four digits of adapter time,
and ends in CR. BEL (a refusal) ends a line too. Nothing protects a line, so one that breaks the grammar anywhere
is rejected; but no digit looks like the letter that a frame begins with, so a whole frame at the end of such a
line (behind noise, or behind a line whose end was lost) is found.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import ConfigurationError, LimitExceeded
from drivers.kit.instruments import StreamCounts
from drivers.kit.patterns import windows

OPEN = b"O\r"
CLOSE = b"C\r"
BITRATE_COMMANDS = {
    10_000: b"S0\r",
    20_000: b"S1\r",
    50_000: b"S2\r",
    100_000: b"S3\r",
    125_000: b"S4\r",
    250_000: b"S5\r",
    500_000: b"S6\r",
    800_000: b"S7\r",
    1_000_000: b"S8\r",
}
"""Bit rate in bit/s -> command. S7 is 800 kbit/s in the manual and in Linux (python-can 4.6 calls it 750)."""

FRAME_DTYPE = np.dtype(
    [
        ("id", np.uint32),
        ("extended", np.bool_),
        ("remote", np.bool_),
        ("dlc", np.uint8),
        ("length", np.uint8),
        ("data", np.uint8, (8,)),
        ("end_offset", np.int64),
        ("others_before", np.int64),
    ]
)
"""`length`: data bytes present (0 in a remote frame), the rest of `data` is zero. `end_offset`: offset in the
stream just past the line. `others_before`: lines in the stream before this one that are no frame and may have
been."""

MAX_STANDARD_ID = 0x7FF
MAX_EXTENDED_ID = 0x1FFF_FFFF
MAX_LINE = 30
"""Characters of the longest legal line without its end: T, 8 + 1 digits, 8 bytes, time."""

_TIME_DIGITS = 4
_SHORTEST = 5  # Characters of the shortest frame.
_NOT_HEX = 0xFF


def _table(entries: dict[bytes, int], other: int = 0) -> NDArray[np.uint8]:
    """Return a table over all byte values that has for each key's bytes its value."""
    table = np.full(256, other, np.uint8)
    for characters, value in entries.items():
        table[list(characters)] = value
    return table


_HEX = _table({f"{value:x}{value:X}".encode(): value for value in range(16)}, other=_NOT_HEX)
_ENDS_LINE = _table({b"\r\x07": 1}).astype(np.bool_)
_ID_DIGITS = _table({b"tr": 3, b"TR": 8}).astype(np.int64)
_MAX_ID = np.array([0, 0, 0, MAX_STANDARD_ID, 0, 0, 0, 0, MAX_EXTENDED_ID], np.uint32)
_IS_REMOTE = _table({b"rR": 1}).astype(np.bool_)
_TELLS, _CONFIRMS = (_table({letters: 1}).astype(np.bool_) for letters in (b"VN", b"zZ"))
_DATA_MASK = np.array([(1 << 8 * n) - 1 for n in range(9)], "<u8")
_PADDING = bytes(MAX_LINE + 2)

_FRAME, _ANSWER = 0, 1
_REASONS = {2: "long", 3: "unknown", 4: "text", 5: "length", 6: "identifier", 7: "dlc"}
_LONG, _UNKNOWN, _TEXT, _LENGTH, _IDENTIFIER, _DLC = _REASONS


class SlcanParser:
    """Incremental parser: any chunking of the same bytes gives the same frames; never raises on bytes.

    `counts.frames` are CAN frames; `counts.rejected` has lines by reason: `long` (over 30 characters), `unknown`
    (neither a frame nor an adapter's answer), `text` (not hexadecimal), `length` (digits missing or left over),
    `identifier` and `dlc` (out of range); `counts.bytes_skipped` is their bytes, line ends included, less a frame
    at their end. Empty lines and answers of the adapter (`z`, `Z`, `F..`, `V..`, `N..`) are passed over.
    """

    def __init__(self) -> None:
        self.counts = StreamCounts()
        self.bytes_received = 0
        self._tail = b""
        self._line_start = 0
        self._others = 0

    def feed(self, data: bytes) -> NDArray[np.void]:
        """Return the frames whose lines end in `data`, shape (n,) of `FRAME_DTYPE`."""
        text = self._tail + data
        text_offset = self.bytes_received - len(self._tail)
        self.bytes_received += len(data)
        padded = np.frombuffer(text + _PADDING, np.uint8)
        digits = _HEX[padded]
        not_hex = np.flatnonzero(digits[: len(text)] == _NOT_HEX)
        at_end = np.flatnonzero(_ENDS_LINE[padded[not_hex]])
        if not len(at_end):
            self._tail = text[-(MAX_LINE + 1) :]
            return np.empty(0, FRAME_DTYPE)
        ends = not_hex[at_end]
        starts = np.empty_like(ends)
        starts[0], starts[1:] = 0, ends[:-1] + 1
        strangers = _steps(at_end, -1) - 1  # characters before the line's end that are no digit
        lines, verdict = _parse(padded, digits, starts, ends - starts, strangers)
        saved = np.empty(0, np.intp)
        odd = np.flatnonzero(verdict)
        if len(odd):
            last = np.where(strangers[odd] > 0, not_hex[at_end[odd] - 1], starts[odd])
            begins = (last > starts[odd]) & (_ID_DIGITS[padded[last]] > 0)
            begins &= ~_is_one_line(padded, digits, starts[odd], ends[odd])
            odd, last = odd[begins], last[begins]
            found, why = _parse(padded, digits, last, ends[odd] - last, np.ones_like(last))
            whole = why == _FRAME
            saved = odd[whole]
            lines[saved] = found[whole]
            self.counts.bytes_skipped -= int((ends[saved] - last[whole] + 1)[verdict[saved] > _ANSWER].sum())
        # Of a line already too long only the end is kept: offsets count from the stream.
        lines["end_offset"] = ends + (text_offset + 1)
        self._tail = text[ends[-1] + 1 :][-(MAX_LINE + 1) :]
        return self._admit(lines, verdict, saved)

    def _admit(
        self, lines: NDArray[np.void], verdict: NDArray[np.uint8], saved: NDArray[np.intp]
    ) -> NDArray[np.void]:
        """Return the lines that are frames or end in one (`saved`), and count the rest."""
        line_start, self._line_start = self._line_start, int(lines["end_offset"][-1])
        if not verdict.any():
            self.counts.frames += len(lines)
            lines["others_before"] = self._others
            return lines
        is_frame = verdict == _FRAME
        is_frame[saved] = True
        frames: NDArray[np.void] = lines[is_frame]
        self.counts.frames += len(frames)
        size = _steps(lines["end_offset"], line_start)
        bad = verdict > _ANSWER
        # An answer as long as a frame may be one in which damage turned the first letter into V or N.
        so_far = self._others + np.cumsum(bad | ((verdict == _ANSWER) & (size > _SHORTEST)))
        frames["others_before"] = so_far[is_frame]
        self._others = int(so_far[-1])
        self.counts.bytes_skipped += int(size[bad].sum())
        for code, times in enumerate(np.bincount(verdict).tolist()):
            if code > _ANSWER:
                self.counts.reject(_REASONS[code], times)
        return frames


def _steps(numbers: NDArray[np.int64], before: int) -> NDArray[np.int64]:
    """Return how much each is more than the one before it."""
    steps = numbers.copy()
    steps[1:] -= numbers[:-1]
    steps[0] -= before
    return steps


def _pairs(digits: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the bytes that hexadecimal digits spell, shape (n, 2 m) to (n, m)."""
    return (digits[:, 0::2] << np.uint8(4)) | digits[:, 1::2]


def _parse(
    text: NDArray[np.uint8],
    digits: NDArray[np.uint8],
    starts: NDArray[np.int64],
    lengths: NDArray[np.int64],
    strangers: NDArray[np.int64],
) -> tuple[NDArray[np.void], NDArray[np.uint8]]:
    """Return a frame for every line, and the verdict on it (what is no frame has arbitrary content)."""
    command = text[starts]
    id_digits = _ID_DIGITS[command]
    remote = _IS_REMOTE[command]
    identifier = _pairs(windows(digits, starts + 1, 8)).view(">u4")[:, 0].astype(np.int64)
    identifier >>= 32 - 4 * id_digits
    payload = windows(digits, starts + 1 + id_digits, 17)
    dlc = payload[:, 0]
    length = np.where(remote, 0, np.minimum(dlc, 8))
    left_over = lengths - (2 + id_digits + 2 * length)
    legal = (id_digits > 0) & (strangers == 1) & (dlc <= 8) & (identifier <= _MAX_ID[id_digits])
    legal &= (left_over == 0) | (left_over == _TIME_DIGITS)
    frames = np.empty(len(starts), FRAME_DTYPE)
    frames["id"] = identifier
    frames["extended"] = id_digits == 8
    frames["remote"] = remote
    frames["dlc"] = dlc
    frames["length"] = length
    data = _pairs(payload[:, 1:]).view("<u8")[:, 0] & _DATA_MASK[length]
    frames["data"] = data[:, None].view(np.uint8)
    verdict = np.zeros(len(starts), np.uint8)
    odd = np.flatnonzero(~legal)
    if len(odd):
        verdict[odd] = _explain(
            command[odd], id_digits[odd], lengths[odd], strangers[odd], identifier[odd], dlc[odd]
        )
    return frames, verdict


def _is_one_line(
    text: NDArray[np.uint8], digits: NDArray[np.uint8], starts: NDArray[np.int64], ends: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Return which lines are as long as their own length digit says: a letter in one is a damaged digit."""
    id_digits = _ID_DIGITS[text[starts]]
    dlc = digits[starts + 1 + id_digits].astype(np.int64)
    left_over = ends - starts - (2 + id_digits + np.where(_IS_REMOTE[text[starts]], 0, 2 * dlc))
    one: NDArray[np.bool_] = (id_digits > 0) & (dlc <= 8) & ((left_over == 0) | (left_over == _TIME_DIGITS))
    return one


def _explain(
    command: NDArray[np.uint8],
    id_digits: NDArray[np.int64],
    lengths: NDArray[np.int64],
    strangers: NDArray[np.int64],
    identifier: NDArray[np.int64],
    dlc: NDArray[np.uint8],
) -> NDArray[np.uint8]:
    """Return why each of these lines is no frame.

    The order matters: identifier and DLC of a line that is too short were read past its end.
    """
    answer = (lengths == 0) | (_TELLS[command] & (lengths <= MAX_LINE))
    answer |= _CONFIRMS[command] & (lengths == 1)
    answer |= (command == ord("F")) & (lengths == 3) & (strangers == 0)
    conditions = [
        answer,
        lengths > MAX_LINE,
        id_digits == 0,
        strangers != 1,
        lengths < 2 + id_digits,
        identifier > _MAX_ID[id_digits],
        dlc > 8,
    ]
    codes = [_ANSWER, _LONG, _UNKNOWN, _TEXT, _LENGTH, _IDENTIFIER, _DLC]
    return np.select(conditions, codes, default=_LENGTH).astype(np.uint8)


_PAIR_TEXT = np.array([int.from_bytes(f"{value:02X}".encode(), "little") for value in range(256)], "<u2")
_COMMAND = np.array([list(b"tr"), list(b"TR")], np.uint8)
_COLUMNS = 27  # command, 8 identifier digits, DLC, 16 data digits, CR
_COLUMN_USED = np.ones((2, 9, _COLUMNS), np.bool_)
"""By extended and data bytes: which columns of the widest line a line has."""
_COLUMN_USED[0, :, 1:6] = False
for _bytes in range(9):
    _COLUMN_USED[:, _bytes, 10 + 2 * _bytes : 26] = False


def encode_frames(frames: NDArray[np.void]) -> bytes:
    """Return the slcan lines of `frames` (`FRAME_DTYPE`), one after the other.

    Raises LimitExceeded for an identifier or DLC that slcan cannot carry.
    """
    if not len(frames):
        return b""
    extended = frames["extended"].astype(np.intp)
    limit = np.where(extended, MAX_EXTENDED_ID, MAX_STANDARD_ID)
    if (frames["id"] > limit).any() or frames["dlc"].max() > 8:
        raise _not_classic("a frame out of range", f"identifiers to {int(frames['id'].max()):#x}")
    remote = frames["remote"].astype(np.intp)
    text = np.empty((len(frames), _COLUMNS), np.uint8)
    text[:, 0] = _COMMAND[extended, remote]
    identifier = frames["id"].astype(">u4").view(np.uint8).reshape(-1, 4)
    text[:, 1:9] = _PAIR_TEXT[identifier].view(np.uint8)
    text[:, 9] = frames["dlc"] + ord("0")
    text[:, 10:26] = _PAIR_TEXT[frames["data"]].view(np.uint8)
    text[:, 26] = ord("\r")
    return text[_COLUMN_USED[extended, np.where(remote, 0, frames["dlc"])]].tobytes()


def encode_frame(
    identifier: int,
    data: bytes = b"",
    *,
    extended: bool = False,
    remote: bool = False,
    dlc: int | None = None,
) -> bytes:
    """Return one frame as an slcan line; `dlc` is the length of `data` unless given (remote frames).

    Raises LimitExceeded for what slcan cannot carry.
    """
    dlc = len(data) if dlc is None else dlc
    limit = MAX_EXTENDED_ID if extended else MAX_STANDARD_ID
    if not 0 <= identifier <= limit or not 0 <= dlc <= 8 or len(data) != (0 if remote else dlc):
        raise _not_classic(
            "a frame out of range", f"identifier {identifier:#x}, DLC {dlc}, {len(data)} bytes"
        )
    if extended:
        return b"%c%08X%d%s\r" % (b"R" if remote else b"T", identifier, dlc, data.hex().upper().encode())
    return b"%c%03X%d%s\r" % (b"r" if remote else b"t", identifier, dlc, data.hex().upper().encode())


def _not_classic(what: str, found: str) -> LimitExceeded:
    return LimitExceeded(
        f"{what} cannot be sent by an slcan adapter",
        found=found,
        expected="identifiers to 0x7FF (standard) or 0x1FFFFFFF (extended), 0 to 8 data bytes",
        remedy="use a CAN interface of python-can that carries this frame",
    )


def bitrate_command(bitrate: int, where: str) -> bytes:
    """Return the command for `bitrate` in bit/s; ConfigurationError for one that slcan does not define."""
    command = BITRATE_COMMANDS.get(bitrate)
    if command is None:
        raise ConfigurationError(
            "this bit rate cannot be set on an slcan adapter",
            where=where,
            found=f"{bitrate} bit/s",
            expected=", ".join(str(rate) for rate in BITRATE_COMMANDS) + " bit/s",
            remedy="set `bitrate` to that of the bus",
        )
    return command
