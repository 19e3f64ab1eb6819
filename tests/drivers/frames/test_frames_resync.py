"""Every shipped binary description, damaged and in random chunks, against a byte-by-byte scan of its text."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.frames import FrameDecoder, FrameEncoder, FrameFamily, MessageReader, load_family, shipped
from drivers.frames._form import Form
from drivers.frames._lines import LineDescription
from drivers.kit.framing import Crc
from tests.drivers.frames.test_frames_split import cut, scan

BINARY = [name for name in shipped() if not isinstance(load_family(name).description, LineDescription)]


def number(data: bytes, at: int, size: int, order: str | None) -> int:
    return int.from_bytes(data[at : at + size], "big" if order == "big" else "little")


def sound(form: Form, frame: bytes) -> bool:
    """Every check by its definition."""
    good = frame.endswith(form.terminator)
    for check in form.checksums:
        bits = 32 if check.kind.endswith("32") else 16 if "16" in check.kind else 8
        span = [
            frame[first % len(frame) : end + len(frame) if end <= 0 else end] for first, end in check.ranges
        ]
        body = b"".join(span)
        if check.kind.startswith("crc"):
            assert check.poly is not None
            crc = Crc(bits, check.poly, check.init, check.reflected, check.xorout)
            value = crc.of(body + bytes(-len(body) % check.pad_to))
        else:
            step = 2 if check.kind == "sum16_words" else 1
            words = [number(body, at, step, check.words or form.endian) for at in range(0, len(body), step)]
            value = check.init + sum(words)
            if check.kind == "xor8":
                value = check.init
                for word in words:
                    value ^= word
            value = (-value if check.kind == "neg8" else value) % (1 << bits)
        stored = number(frame, check.at % len(frame), bits // 8, check.endian or form.endian)
        good = good and value == stored
    return good


def candidate_of(forms: list[Form], data: bytes, at: int) -> tuple[str, int, int]:
    """(what, kind, length) of the beginning at `at`: sound, unsound, length, wait or none."""
    open_end = False
    for kind, form in enumerate(forms):
        rule = form.length_field
        for sync in form.syncs:
            places = form.places(sync)
            known = [place for place in places if at + place[0] < len(data)]
            if any(data[at + offset] & mask != value for offset, value, mask in known):
                continue
            span = max(1, *(offset + 1 for offset, _, _ in places), rule.at + rule.bytes if rule else 1)
            if at + span > len(data):
                open_end = True
                continue
            length = form.length
            if length is None:
                assert rule is not None
                stated = number(data, at + rule.at, rule.bytes, rule.endian or form.endian)
                length = stated * rule.times + rule.add
                if not form.shortest <= length <= form.longest:
                    return "length", kind, 0
            if at + length > len(data):
                return "wait", kind, length
            return ("sound" if sound(form, data[at : at + length]) else "unsound"), kind, length
    return ("wait" if open_end else "none"), -1, 0


def damaged(family: FrameFamily, rng: np.random.Generator) -> bytes:
    """A few frames, mostly of one message, with bytes changed, lost or doubled."""
    main = family.forms[int(rng.integers(len(family.forms)))]
    parts = []
    for _ in range(int(rng.integers(2, 5))):
        form = main if rng.random() < 0.7 else family.forms[int(rng.integers(len(family.forms)))]
        count = int(rng.integers(1, 9))
        values = {
            spec.name: rng.normal(0.0, 0.01, count)
            for spec in form.fields
            if spec.axis and spec.type not in ("u8", "u16")
        }
        parts += [FrameEncoder(family, form.name).encode(count, values), rng.bytes(int(rng.integers(0, 4)))]
    data = np.frombuffer(b"".join(parts), np.uint8)
    share = rng.choice([0.0, 0.002, 0.02])
    changed = np.where(rng.random(data.size) < share, rng.integers(0, 256, data.size), data).astype(np.uint8)
    times = 1 - (rng.random(data.size) < share / 2).astype(int) + (rng.random(data.size) < share / 2)
    return np.repeat(changed, times).tobytes()


@pytest.mark.parametrize("name", BINARY)
def test_damaged_streams_are_cut_as_a_byte_by_byte_scan_cuts_them(name: str) -> None:
    family = load_family(name)
    rng = np.random.default_rng(BINARY.index(name))
    for _ in range(8):
        data = damaged(family, rng)
        reader, got = MessageReader(family), []
        for chunk in cut(data, [int(2 ** rng.uniform(0.0, 11.0)) for _ in range(4)]):
            for found in reader.feed(chunk):
                kind = family.forms.index(found.form)
                rows = [row.tobytes() for row in found.rows]
                got += [(end, kind, row) for end, row in zip(found.end_offset.tolist(), rows, strict=True)]
        frames, rejects, skipped = scan(data, lambda data, at: candidate_of(family.forms, data, at))
        assert sorted(got) == frames
        assert reader.counts.rejected == rejects
        assert reader.counts.bytes_skipped == skipped


def test_messages_of_one_length_are_each_read_by_their_own_fields() -> None:
    # Nothing at first, so that the message a bench would read by default is made ready; then another one comes.
    family = load_family("vectornav")
    first, other = (form for form in family.forms if form.shortest == 38)
    assert first.measures and other.measures
    decoder = FrameDecoder(family, rate_hz=100.0, axes="xyz")
    decoder.feed(b"")
    batch = decoder.feed(FrameEncoder(family, other.name).encode(2, {"rate_x": 0.5, "rate_y": [0.25, 0.125]}))
    assert batch.columns["rate_x"].tolist() == [0.5, 0.5]
    assert batch.columns["rate_y"].tolist() == [0.25, 0.125]
