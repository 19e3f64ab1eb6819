"""Modbus frames against the standard's own examples and captured bytes; the master against scripted replies."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymodbus.framer import FramerRTU
from pymodbus.pdu import ExceptionResponse
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

from drivers.base.errors import DeviceRefused, DeviceSilent, ProtocolError
from drivers.kit.modbus import Frames, ModbusMaster, float_words, to_signed, words_float
from tests.memory_link import scripted as answers


def crc16_modbus(data: bytes) -> bytes:
    """CRC of Modbus over Serial Line V1.02, appendix B, bit by bit; low byte first."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return struct.pack("<H", crc)


def test_the_crc_is_the_standards():
    # check value of CRC-16/MODBUS in the catalogue of parametrised CRC algorithms, and the example 02 07 of the
    # serial line guide, section 6.2.2
    assert crc16_modbus(b"123456789") == bytes.fromhex("37 4B")
    assert crc16_modbus(bytes.fromhex("02 07")) == bytes.fromhex("41 12")
    assert FramerRTU.compute_CRC(b"123456789").to_bytes(2, "big") == bytes.fromhex("37 4B")


@given(st.binary(min_size=1, max_size=40))
def test_the_librarys_crc_is_the_bit_by_bit_one(data):
    assert FramerRTU.compute_CRC(data).to_bytes(2, "big") == crc16_modbus(data)


def request(kind, device=1, **fields):
    message = kind(**fields)
    message.dev_id = device
    return message


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        # captured from a Watlow F4
        (request(ReadHoldingRegistersRequest, address=100, count=1), "01 03 00 64 00 01 C5 D5"),
        # Modbus Application Protocol V1.1b3, sections 6.3, 6.6 and 6.12, in an RTU frame for device 17
        (
            request(ReadHoldingRegistersRequest, 17, address=107, count=3),
            "11 03 00 6B 00 03",
        ),
        (request(WriteSingleRegisterRequest, 17, address=1, registers=[3]), "11 06 00 01 00 03"),
        (
            request(WriteMultipleRegistersRequest, 17, address=1, registers=[10, 258]),
            "11 10 00 01 00 02 04 00 0A 01 02",
        ),
        (request(WriteSingleRegisterRequest, address=300, registers=[250]), "01 06 01 2C 00 FA C9 BC"),
        (request(WriteSingleRegisterRequest, address=1100, registers=[2]), "01 06 04 4C 00 02 C8 EC"),
        (request(WriteSingleRegisterRequest, address=1101, registers=[30]), "01 06 04 4D 00 1E 98 E5"),
        (
            request(WriteMultipleRegistersRequest, address=2782, registers=float_words(25.0)),
            "01 10 0A DE 00 02 04 00 00 41 C8 30 19",
        ),
        (request(ReadHoldingRegistersRequest, address=2820, count=2), "01 03 0B 04 00 02 87 EE"),
    ],
)
def test_rtu_requests_are_the_documents_bytes(message, expected):
    wanted = bytes.fromhex(expected)
    if wanted[0] == 17:
        wanted += crc16_modbus(wanted)
    assert Frames("rtu", server=False).build(message) == wanted


def test_a_tcp_frame_has_the_mbap_header():
    message = request(ReadHoldingRegistersRequest, 1, address=2820, count=2)
    message.transaction_id = 0x1501
    # transaction, protocol 0, length 6, unit 1: Modbus Messaging on TCP/IP V1.0b, section 3.1.3
    assert Frames("tcp", server=False).build(message) == bytes.fromhex("15 01 00 00 00 06 01 03 0B 04 00 02")


def test_replies_are_taken_apart_noise_behind_them_dropped():
    frames = Frames("rtu", server=False)
    message, used = frames.split(bytes.fromhex("01 03 02 00 FA 38 07 00 00"))
    assert isinstance(message, ReadHoldingRegistersResponse)
    assert (message.registers, message.dev_id, used) == ([250], 1, 9)
    message, _ = frames.split(bytes.fromhex("01 83 02 C0 F1"))
    assert isinstance(message, ExceptionResponse)
    assert message.exception_code == 2
    assert frames.split(bytes.fromhex("01 03 02 00 FA 38")) is None


def test_what_is_no_modbus_tcp_is_said_at_once():
    with pytest.raises(ProtocolError, match="MBAP"):
        Frames("tcp", server=True).split(b"*IDN?\r\n")


def test_every_single_bit_error_of_a_reply_is_found():
    whole = bytes.fromhex("01 03 02 00 FA 38 07")
    for bit in range(8 * len(whole)):
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        try:
            found = Frames("rtu", server=False).split(bytes(damaged))
        except ProtocolError:
            continue
        assert found is None  # the length byte says that more is to come


@settings(max_examples=300)
@given(data=st.binary(max_size=80), server=st.booleans(), framing=st.sampled_from(["rtu", "tcp"]))
def test_random_bytes_raise_nothing_but_what_is_said(data, server, framing):
    try:
        found = Frames(framing, server=server).split(data)
    except ProtocolError:
        return
    assert found is None or 0 < found[1] <= len(data)


@given(st.floats(width=32, allow_nan=False))
def test_floats_go_low_word_first(value):
    low, high = float_words(value)
    assert struct.pack(">HH", high, low) == struct.pack(">f", value)
    assert words_float((low, high)) == value


def test_signed_registers():
    assert [to_signed(word) for word in (0, 250, 0x7FFF, 0x8000, 0xFE0C)] == [0, 250, 32767, -32768, -500]


def scripted(*replies, framing="rtu", delay_s=0.02):
    wire = answers(*(bytes.fromhex(reply) for reply in replies), delay_s=delay_s)
    return ModbusMaster(wire, framing, 1), wire


def test_a_register_is_read_and_the_line_kept_quiet_after_it():
    master, wire = scripted("01 03 02 00 FA 38 07", "01 03 02 00 FA 38 07")
    assert master.read(100, 1) == (250,)
    assert master.read(100, 1) == (250,)
    times = [at for at, direction, _ in wire.exchanges if direction == "sent"]
    assert times[1] - times[0] >= 50_000_000  # 20 ms to the reply, 30 ms of quiet


def test_an_exception_is_told_in_words():
    master, _ = scripted("01 83 02 C0 F1")
    with pytest.raises(DeviceRefused, match="no such register") as refusal:
        master.read(9999, 1)
    assert "register 9999" in str(refusal.value) and "exception 2" in str(refusal.value)


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        ("01 03 02 00 FB 38 07", "CRC"),  # one bit wrong
        ("02 03 02 00 FA 7C C7", "device 2"),  # somebody else's answer (CRC computed here)
        ("01 03 04 00 FA 00 FA DB 84", "2 registers"),  # not as many as asked for
    ],
)
def test_an_answer_that_does_not_fit_is_an_error(reply, words):
    body = bytes.fromhex(reply)
    if words != "CRC":
        body = body[:-2] + crc16_modbus(body[:-2])
    master, _ = scripted(body.hex())
    with pytest.raises(ProtocolError, match=words):
        master.read(100, 1)


def test_silence_and_half_a_reply_have_a_deadline():
    master, wire = scripted()
    with pytest.raises(DeviceSilent, match="nothing"):
        master.read(100, 1)
    assert 1.5 <= wire.clock.now() < 1.51
    master, _ = scripted("01 03 02 00")
    with pytest.raises(DeviceSilent, match="4 bytes"):
        master.read(100, 1)


def test_the_late_answer_to_an_earlier_question_is_passed_over_on_tcp():
    reply = "00 00 00 05 01 03 02 00"
    master, wire = scripted(f"00 01 {reply} FA", f"00 01 {reply} FA 00 02 {reply} FB", framing="tcp")
    assert master.read(100, 1) == (250,)
    assert master.read(100, 1) == (251,)
    assert wire.sent[:2] + wire.sent[12:14] == bytes.fromhex("00 01 00 02")
