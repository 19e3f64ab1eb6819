"""docs/frames.md: its worked example is a description that works."""

from __future__ import annotations

import binascii
import re
import struct
import tomllib
from pathlib import Path

from drivers.frames import FrameDecoder, shipped, vector_mistakes
from drivers.frames._load import family_from

PAGE = Path(__file__).parents[3] / "docs" / "frames.md"


def test_the_worked_example_reads_frames_packed_by_hand() -> None:
    blocks = re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    family = family_from(tomllib.loads(blocks[0]), "docs/frames.md")
    assert list(vector_mistakes(family)) == [] and family.description.vector
    stream = b""
    for number in range(300):
        body = b"\xa5\x5a" + struct.pack(">ihBBxx", -number, 2500 + number, number % 2, number % 256)
        stream += body + struct.pack(">H", binascii.crc_hqx(body, 0xFFFF))
    batch = FrameDecoder(family, rate_hz=200.0, axes="x").feed(stream)
    assert len(batch) == 300
    assert (batch.columns["rate_x"] * 1e4).round().tolist() == [-number for number in range(300)]
    assert batch.columns["valid"].tolist() == [number % 2 == 1 for number in range(300)]


def test_the_page_names_what_is_there() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert {"stim300", "kvh_dsp3000", "vectornav_ascii"} <= set(shipped())
    assert all(f"`{name}`" in page for name in ("kvh_dsp3000", "vectornav_ascii"))
