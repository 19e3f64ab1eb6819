"""slcan text: against python-can's own reader, a real recording, and damage of every kind."""

from __future__ import annotations

import itertools
from pathlib import Path
from queue import SimpleQueue

import can
import numpy as np
import pytest
from can.interfaces.slcan import slcanBus
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base.errors import LimitExceeded
from drivers.kit.slcan_codec import FRAME_DTYPE, SlcanParser, encode_frame, encode_frames

DATA = Path(__file__).parents[2] / ".." / "shared" / "data"
CANDUMP = DATA / "can_canmod_gps" / "00000005-60FEB5A8.log"


@st.composite
def frames(draw: st.DrawFn) -> tuple[int, bool, bool, int, bytes]:
    extended, remote = draw(st.booleans()), draw(st.booleans())
    identifier = draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF))
    dlc = draw(st.integers(0, 8))
    data = b"" if remote else draw(st.binary(min_size=dlc, max_size=dlc))
    return identifier, extended, remote, dlc, data


def line(frame: tuple[int, bool, bool, int, bytes], case: str = "X") -> bytes:
    """slcan line from Python's own number formatting, independent of the code under test."""
    identifier, extended, remote, dlc, data = frame
    command = {(0, 0): "t", (1, 0): "T", (0, 1): "r", (1, 1): "R"}[extended, remote]
    digits = f"{identifier:0{8 if extended else 3}{case}}{dlc}{data.hex()}"
    return (command + (digits.upper() if case == "X" else digits.lower()) + "\r").encode()


def as_tuples(parsed: np.ndarray) -> list[tuple[int, bool, bool, int, bytes]]:
    return [
        (
            int(f["id"]),
            bool(f["extended"]),
            bool(f["remote"]),
            int(f["dlc"]),
            f["data"][: f["length"]].tobytes(),
        )
        for f in parsed
    ]


def feed_in_chunks(data: bytes, cuts: list[int]) -> tuple[SlcanParser, np.ndarray]:
    parser = SlcanParser()
    edges = sorted({0, len(data), *(cut % (len(data) + 1) for cut in cuts)})
    parts = [parser.feed(data[a:b]) for a, b in itertools.pairwise(edges)]
    return parser, np.concatenate(parts) if parts else np.empty(0, FRAME_DTYPE)


def test_digits_alone_in_a_line_are_no_frame_though_one_has_begun_behind_them() -> None:
    parser = SlcanParser()
    assert as_tuples(parser.feed(b"12\rt1230")) == []
    assert as_tuples(parser.feed(b"\r")) == [(0x123, False, False, 0, b"")]
    assert parser.counts.rejected == {"unknown": 1} and parser.counts.bytes_skipped == 3


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(frames(), st.sampled_from("xX"), st.sampled_from(["", "ABCD", "0000"])), max_size=30)
)
def test_equal_to_python_can_on_clean_lines(items: list) -> None:
    oracle = object.__new__(slcanBus)
    oracle._queue = SimpleQueue()
    expected, stream, ends = [], b"", []
    for frame, case, time in items:
        text = line(frame, case)[:-1] + time.encode() + b"\r"
        stream += text
        ends.append(len(stream))
        oracle._queue.put(text.decode())
        message, _ = oracle._recv_internal(0)
        expected.append(
            (
                message.arbitration_id,
                message.is_extended_id,
                message.is_remote_frame,
                message.dlc,
                bytes(message.data),
            )
        )
    parser = SlcanParser()
    parsed = parser.feed(stream)
    assert as_tuples(parsed) == expected
    assert parsed["end_offset"].tolist() == ends
    assert parser.counts.rejected == {}
    assert parser.counts.frames == len(items)


@settings(deadline=None, max_examples=60)
@given(st.lists(frames(), max_size=30))
def test_encoders_write_the_lines(items: list) -> None:
    table = np.zeros(len(items), FRAME_DTYPE)
    for row, (identifier, extended, remote, dlc, data) in zip(table, items, strict=True):
        row["id"], row["extended"], row["remote"], row["dlc"] = identifier, extended, remote, dlc
        row["data"][: len(data)] = list(data)
    expected = b"".join(map(line, items))
    assert encode_frames(table) == expected
    singles = (encode_frame(i, d, extended=e, remote=r, dlc=n) for i, e, r, n, d in items)
    assert b"".join(singles) == expected


PIECES = st.one_of(
    frames().map(line),
    st.sampled_from([b"\r", b"\x07", b"z\r", b"Z\r", b"F00\r", b"V1013\r", b"NA123\r", b"t12", b"T1234567"]),
    st.binary(max_size=40),
    st.binary(min_size=1, max_size=90).map(lambda junk: junk.replace(b"\r", b"0").replace(b"\x07", b"0")),
)


@settings(deadline=None, max_examples=150)
@given(st.lists(PIECES, max_size=25), st.lists(st.integers(0, 5000), max_size=25))
def test_chunking_changes_nothing(pieces: list[bytes], cuts: list[int]) -> None:
    stream = b"".join(pieces)
    whole_parser, whole = feed_in_chunks(stream, [])
    for places in (cuts, list(range(len(stream)))):
        parser, parts = feed_in_chunks(stream, places)
        assert parts.tobytes() == whole.tobytes()
        assert parser.counts == whole_parser.counts


@settings(deadline=None, max_examples=150)
@given(st.lists(PIECES, max_size=15), frames())
def test_a_frame_after_any_rubbish_arrives(pieces: list[bytes], frame: tuple) -> None:
    parser = SlcanParser()
    for piece in pieces:
        parser.feed(piece)
    parsed = parser.feed(b"\r" + line(frame))
    assert as_tuples(parsed)[-1] == frame


@settings(deadline=None, max_examples=100)
@given(st.lists(st.tuples(frames(), st.binary(max_size=50)), max_size=20))
def test_every_byte_is_accounted_for(items: list) -> None:
    """Good lines and skipped bytes make the stream; rubbish is made of bytes no frame begins with."""
    stream, skipped, rejected = b"", 0, 0
    for frame, junk in items:
        stream += line(frame)
        body = b"#" + bytes(byte for byte in junk if byte not in b"\r\x07tTrR")
        stream += body + b"\r"
        skipped += len(body) + 1
        rejected += 1
    parser = SlcanParser()
    parsed = parser.feed(stream)
    assert as_tuples(parsed) == [frame for frame, _ in items]
    assert parser.counts.bytes_skipped == skipped
    assert sum(parser.counts.rejected.values()) == rejected
    assert parsed["others_before"].tolist() == list(range(len(items)))


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (b"t12", "length"),  # python-can 4.6.1: IndexError
        (b"t", "length"),
        (b"T0000012", "length"),
        (b"t10080011", "length"),  # python-can 4.6.1: DLC 8 with 2 bytes
        (b"t1009" + b"00" * 9, "dlc"),  # python-can 4.6.1: DLC 12
        (b"t100A" + b"00" * 8, "dlc"),
        (b"t1002AABBC", "length"),
        (b"t1002AABBCCDDEE", "length"),
        (b"r12320000000", "length"),
        (b"t1232AAGG", "text"),  # python-can 4.6.1: ValueError
        (b"t1232AA\xffB", "text"),  # python-can 4.6.1: the buffer is poisoned for good
        (b"t1234AABt1230", "text"),  # as long as its 4 bytes: a damaged digit, not a frame
        (b"#t12", "unknown"),
        (b"t8002AABB", "identifier"),
        (b"T200000000", "identifier"),
        (b"\xff\x80\x00", "unknown"),
        (b"AABB", "unknown"),
        (b"F0", "unknown"),
        (b"zz", "unknown"),
        (b"t1238" + b"00" * 8 + b"0000" + b"0000000000", "long"),
        (b"x" * 100_000, "long"),
    ],
)
@pytest.mark.parametrize("end", [b"\r", b"\x07"])
def test_damaged_line_is_counted_by_reason(bad: bytes, reason: str, end: bytes) -> None:
    parser = SlcanParser()
    parsed = parser.feed(b"t1232AABB\r" + bad + end + b"t1240\r")
    assert [int(identifier) for identifier in parsed["id"]] == [0x123, 0x124]
    assert parser.counts.rejected == {reason: 1}
    assert parser.counts.bytes_skipped == len(bad) + 1


@pytest.mark.parametrize("end", [b"\r", b"\x07"])
@pytest.mark.parametrize(
    "head",
    [
        b"t1232AA",
        b"t",
        b"T1234567",
        b"\xff\x80\x00",
        b"0102030405060708",
        b"zt",
        b"V1013",
        b"x" * 100_000,
    ],
)
def test_a_frame_at_the_end_of_a_damaged_line_is_found(head: bytes, end: bytes) -> None:
    """Noise, a line whose end was lost, a port that was opened in the middle of a line."""
    stream = b"t1000\r" + head + b"t1232AABB" + end + b"t1240\r"
    answer = head == b"V1013"
    for cuts in ([], [len(stream) - 9], list(range(len(stream) - 60, len(stream)))):
        parser, parsed = feed_in_chunks(stream, cuts)
        assert as_tuples(parsed)[1] == (0x123, False, False, 2, b"\xaa\xbb")
        assert parsed["id"].tolist() == [0x100, 0x123, 0x124]
        assert parsed["others_before"].tolist() == [0, 1, 1]
        assert parsed["end_offset"].tolist() == [6, len(stream) - 6, len(stream)]
        assert sum(parser.counts.rejected.values()) == (not answer)
        assert parser.counts.bytes_skipped == (0 if answer else len(head))


@settings(deadline=None, max_examples=150)
@given(st.binary(max_size=40), frames(), st.sampled_from(["", "12EF"]))
def test_a_frame_right_behind_noise_arrives(noise: bytes, frame: tuple, time: str) -> None:
    """Noise that is not itself the beginning of a frame; a line end in it changes nothing."""
    head = b"#" + noise.replace(b"\r", b"\r#").replace(b"\x07", b"\x07#")
    parsed = SlcanParser().feed(head + line(frame)[:-1] + time.encode() + b"\r")
    assert as_tuples(parsed)[-1] == frame


def test_answers_of_the_adapter_are_passed_over() -> None:
    parser = SlcanParser()
    parsed = parser.feed(b"\r\r\x07\rz\rZ\rF00\rV1013\rNA123\rt1230\r\x07")
    assert parsed["id"].tolist() == [0x123]
    assert parser.counts.rejected == {}
    assert parser.counts.bytes_skipped == 0


def test_an_endless_line_takes_no_memory() -> None:
    parser = SlcanParser()
    for _ in range(100):
        parser.feed(b"A" * 10_000)
        assert len(parser._tail) < 100
    parser.feed(b"\r")
    assert parser.counts.rejected == {"long": 1}
    assert parser.counts.bytes_skipped == 1_000_001


@pytest.mark.parametrize(
    ("identifier", "data", "extended", "dlc"),
    [
        (0x800, b"", False, None),
        (0x20000000, b"", True, None),
        (1, bytes(9), False, None),
        (1, b"1", False, 2),
    ],
)
def test_what_slcan_cannot_carry_is_refused(
    identifier: int, data: bytes, extended: bool, dlc: int | None
) -> None:
    with pytest.raises(LimitExceeded):
        encode_frame(identifier, data, extended=extended, dlc=dlc)


def test_out_of_range_table_is_refused() -> None:
    table = np.zeros(2, FRAME_DTYPE)
    table["id"] = 0x7FF, 0x800
    with pytest.raises(LimitExceeded):
        encode_frames(table)


@pytest.mark.skipif(not CANDUMP.exists(), reason="the recording can_canmod_gps is not here")
def test_real_recording_comes_through(tmp_path: Path) -> None:
    """Every frame of a vehicle's CAN logger, written to slcan text here, is parsed back equal."""
    wanted = []
    for entry in CANDUMP.read_text().split("\n"):
        if entry:
            identifier, _, data = entry.split()[2].partition("#")
            wanted.append(
                (int(identifier, 16), len(identifier) == 8, False, len(data) // 2, bytes.fromhex(data))
            )
    assert len(wanted) == 5477
    parser, parsed = feed_in_chunks(b"".join(map(line, wanted)), list(range(0, 130_000, 4095)))
    assert as_tuples(parsed) == wanted
    assert parser.counts.rejected == {}
    log = list(can.CanutilsLogReader(str(CANDUMP)))
    assert parsed["id"].tolist() == [message.arbitration_id for message in log]
    assert encode_frames(parsed) == b"".join(map(line, wanted))


def test_the_longest_legal_line_arrives_in_any_two_pieces() -> None:
    """T, 8 digits, length, 8 bytes and a time stamp: 30 characters, and one of them more is too many."""
    line = b"T1FFFFFFF8" + b"0123456789ABCDEF" + b"EA5F"
    assert len(line) == 30
    for cut in range(len(line) + 2):
        parser = SlcanParser()
        stream = line + b"\r"
        frames = np.concatenate([parser.feed(b"t0010\r" + stream[:cut]), parser.feed(stream[cut:])])
        assert frames["id"].tolist() == [1, 0x1FFFFFFF] and not parser.counts.rejected
        parser, stream = SlcanParser(), line + b"0\r"
        frames = np.concatenate([parser.feed(b"t0010\r" + stream[:cut]), parser.feed(stream[cut:])])
        assert frames["id"].tolist() == [1] and parser.counts.rejected == {"long": 1}, cut
        assert parser.counts.bytes_skipped == len(stream)
