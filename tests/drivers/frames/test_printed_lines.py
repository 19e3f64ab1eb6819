"""Lines that makers print: our checks hold for them, and no decoder takes them for measurements."""

from __future__ import annotations

import pytest

from drivers.frames import FrameDecoder, MessageReader, load_family, reader_of
from drivers.kit.framing import Crc

_PRINTED = """
#UTILITYMODE,234
#,1,180
#iax,0,XYZ,XYZ,XYZ,212
#ibto,0.01388,-0.02425,0.01724,-0.036230,0.002872,0.015903,0.0083054,0.0102123,-0.00450326,198
#ie,0,0,0,16,0,0,0,0,0,0,0,0,0,0,0,0,0,221
#in,0,STIM300,247
#irng,0,400,400,400,10,10,10,1.7,1.7,1.7,NA,61
#isn,0,N2558184602002,32
#isn,0,N25582405002002,252
#ix,0,84167-4400003-321,K,174
#st,0,921699,2,N,1,0,0,132
#xn,0,125
$dbto,0.00123,0
$isn,28
$sbto,3.4e-03,g,y,128
$sg,x,1,1,2,0,0.5,243
$srf,43638,122
"""
UTILITY_MODE = _PRINTED.split()
"""Sensonor TS1524 rev. 31, section 10: 97 of the 101 lines printed there end in a right CRC-8, these among them.

Wrong in print: `#it,0,374400,...,39`, one `#sbto,...,181`, `$saf,z,4,138`, `$sbto,0.00123,12`.
"""
VNIMU = b"".join(
    [
        b"$VNIMU,-00.0350,+00.4222,-00.6643,-00.015,+00.019,+09.948,",
        b"+00.002066,-00.008442,-00.044656,+20.7,+084.322*66\r\n",
    ]
)


@pytest.mark.parametrize("line", UTILITY_MODE)
def test_the_crc_of_the_stim210_is_that_of_utility_mode(line: str) -> None:
    """Over everything in front of the number, the last comma included."""
    (check,) = load_family("stim210").form("rate").checksums
    assert check.poly is not None
    body, _, printed = line.rpartition(",")
    assert Crc(8, check.poly, check.init).of(f"{body},".encode()) == int(printed)
    assert Crc(8, check.poly, check.init).of(body.encode()) != int(printed)


def test_utility_mode_is_no_datagram() -> None:
    text = "\r".join(UTILITY_MODE).encode() + b"\r"
    reader = MessageReader(load_family("stim300"))
    assert reader.feed(text) == [] and reader.counts.frames == 0


def test_an_error_line_of_a_vectornav_is_skipped() -> None:
    """`$VNERR,12*72`, whose check is right, between two measurements."""
    for name in ("vectornav_ascii", "vectornav_ymr"):
        reader = reader_of(load_family(name))
        assert reader.feed(b"$VNERR,12*72\r\n") == []
    decoder = FrameDecoder(load_family("vectornav_ascii"), rate_hz=40.0, axes="xyz")
    columns = decoder.feed(VNIMU + b"$VNERR,12*72\r\n" + VNIMU).columns
    assert columns["rate_z"].tolist() == [-0.044656, -0.044656] and columns["valid"].all()
