"""Generic framing: CRCs against the published check values, the splitter against a byte-by-byte scan."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.kit.framing import Crc, FrameSplitter, PositionalCrc, crc_of_each
from drivers.kit.patterns import find_sync

# Catalogue of parametrised CRC algorithms (Greg Cook, reveng.sourceforge.io): CRC of b"123456789".
PUBLISHED = {
    "CRC-8/SMBUS": (Crc(8, 0x07, 0), 0xF4),
    "CRC-16/KERMIT": (Crc(16, 0x1021, 0, reflected=True), 0x2189),
    "CRC-16/MODBUS": (Crc(16, 0x8005, 0xFFFF, reflected=True), 0x4B37),
    "CRC-16/XMODEM": (Crc(16, 0x1021, 0), 0x31C3),
    "CRC-32/MPEG-2": (Crc(32, 0x04C11DB7, 0xFFFFFFFF), 0x0376E6E7),
    "CRC-32/ISO-HDLC": (Crc(32, 0x04C11DB7, 0xFFFFFFFF, True, 0xFFFFFFFF), 0xCBF43926),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_crc_gives_the_published_check_value(name: str) -> None:
    crc, check = PUBLISHED[name]
    assert crc.of(b"123456789") == check


@pytest.mark.parametrize("name", PUBLISHED)
@pytest.mark.parametrize("known", [0, 4, 8])
def test_positional_tables_give_the_published_check_value(name: str, known: int) -> None:
    crc, check = PUBLISHED[name]
    message = np.frombuffer(b"123456789", np.uint8)[None, known:]
    many = np.repeat(message, 1300, axis=0)  # More than two blocks, the last one not full.
    assert set(PositionalCrc(crc, b"123456789"[:known], 9 - known)(many).tolist()) == {check}


def test_positional_tables_agree_with_the_definition_on_random_messages() -> None:
    rng = np.random.default_rng(7)
    messages = rng.integers(0, 256, (200, 13), dtype=np.uint8)
    for crc, _ in PUBLISHED.values():
        got = PositionalCrc(crc, b"\xa5\x5a", 13)(messages)
        assert got.tolist() == [crc.of(b"\xa5\x5a" + row.tobytes()) for row in messages]


@pytest.mark.parametrize("length", [1, 2, 5, 12])
@pytest.mark.parametrize("padding", [0, 1, 2, 3])
def test_many_messages_by_words_agree_with_the_definition(length: int, padding: int) -> None:
    rng = np.random.default_rng(length)
    odd = (Crc(24, 0x864CFB, 0xB704CE), Crc(24, 0x5D6DCB, 0xFEDCBA, True, 5), Crc(8, 0x9B, 0x12, True, 0x33))
    # One pass and a part of one; every 400th is held against the definition.
    messages = rng.integers(0, 256, (17000, length + 3), dtype=np.uint8)[:, 1 : 1 + length]
    for crc in (*(crc for crc, _ in PUBLISHED.values()), *odd):
        got = PositionalCrc(crc, b"\xa5", length, padding)(messages)
        expected = [crc.of(b"\xa5" + row.tobytes() + bytes(padding)) for row in messages[::400]]
        assert got[::400].tolist() == expected


@given(st.lists(st.binary(max_size=70), min_size=1, max_size=9))
@settings(max_examples=50, deadline=None)
def test_messages_of_many_lengths_agree_with_the_definition(messages: list[bytes]) -> None:
    for crc in (*(crc for crc, _ in PUBLISHED.values()), Crc(24, 0x5D6DCB, 0xFEDCBA, True, 5)):
        assert crc_of_each(crc, messages).tolist() == [crc.of(message) for message in messages]


@given(st.lists(st.sampled_from([0xFE, 0x81, 0xFF, 0]), max_size=80).map(bytes))
@settings(max_examples=100, deadline=None)
def test_find_sync_finds_what_a_plain_search_finds(data: bytes) -> None:
    sync = b"\xfe\x81\xff"
    expected = [at for at in range(len(data)) if data.startswith(sync, at)]
    assert find_sync(np.frombuffer(data, np.uint8), sync).tolist() == expected


def test_sync_word_that_can_begin_inside_itself_is_refused() -> None:
    with pytest.raises(ValueError, match="fefe"):
        FrameSplitter(b"\xfe\xfe", 6, lambda rows: np.ones(len(rows), bool))


SYNC, LENGTH = b"\xfe\x81", 6


def additive(rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Sum of all bytes zero modulo 8: weak on purpose, so that chance frames and overlaps occur."""
    sound: NDArray[np.bool_] = rows.sum(axis=1) % 8 == 0
    return sound


def scan(data: bytes) -> tuple[list[tuple[int, bytes]], int, int, int]:
    """The splitter's rule, byte by byte: frames, rejects, bytes outside frames, offset where it stands."""
    frames: list[tuple[int, bytes]] = []
    inside: set[int] = set()
    rejects = at = 0
    while at < len(data):
        if data[at : at + len(SYNC)] != SYNC[: len(data) - at]:
            at += 1
        elif at + LENGTH > len(data):
            break
        elif sum(data[at : at + LENGTH]) % 8 == 0:
            frames.append((at + LENGTH, data[at : at + LENGTH]))
            inside.update(range(at, at + LENGTH))
            at += LENGTH - 1  # Its last byte may begin the next.
        else:
            rejects += 1
            at += 1
    return frames, rejects, len(set(range(at)) - inside), at


# Sound frames (one ends in FE, one lacks that as its first byte, one has a sync word inside), and others.
PIECES = (
    "FE8100000001",
    "FE81000003FE",
    "8100000001",
    "FE8102FE8100",
    "FE81000000FE83",
    "FE810102FE81",
    "FE",
)
pieces = st.one_of(
    st.just(SYNC), st.binary(max_size=3), st.sampled_from([bytes.fromhex(text) for text in PIECES])
)


@given(
    data=st.lists(pieces, max_size=40).map(b"".join),
    cuts=st.lists(st.integers(1, 17), min_size=1, max_size=8),
)
@settings(max_examples=400, deadline=None)
def test_splitter_does_what_a_byte_by_byte_scan_does_in_any_chunks(data: bytes, cuts: list[int]) -> None:
    splitter = FrameSplitter(SYNC, LENGTH, additive)
    got: list[tuple[int, bytes]] = []
    at = turn = 0
    while at < len(data):
        chunk = data[at : at + cuts[turn % len(cuts)]]
        rows, ends = splitter.feed(chunk)
        assert rows.shape == (len(ends), LENGTH)
        got += [(end, row.tobytes()) for end, row in zip(ends.tolist(), rows, strict=True)]
        at, turn = at + len(chunk), turn + 1
    frames, rejects, skipped, _ = scan(data)
    assert got == frames
    assert splitter.counts.frames == len(frames)
    assert splitter.counts.rejected.get("checksum", 0) == rejects
    assert splitter.counts.bytes_skipped == skipped
    assert splitter._splitter.pending < LENGTH
