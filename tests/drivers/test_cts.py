"""CTS chambers: frames that the maker prints, others' clients, driver and emulator in memory, records."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.base.errors import DeviceRefused, DeviceSilent, LimitExceeded, ProtocolError, WrongDevice
from drivers.cts._driver import CtsChamber, CtsConfig
from drivers.cts._transcript import decode_transcript
from drivers.cts.codec import (
    Analog,
    Status,
    decode_analog,
    decode_channels,
    decode_error_text,
    decode_frame,
    decode_gradients,
    decode_status,
    encode_frame,
    gradient_text,
    set_text,
)
from drivers.kit.instruments import ChamberCapabilities, Rest
from simulators.emulators.cts import CtsEmulator
from simulators.faults import Fault
from tests.chamber_checks import check_a_day, check_any_record, check_record
from tests.memory_link import ChamberPlant, MemoryLink, OpenConnection, scripted

PRINTED = {  # on the maker's pages of its interface, address 1
    "O": "02 81 CF CE 03",
    "O01000100000000": "02 81 CF B0 B1 B0 B0 B0 B1 B0 B0 B0 B0 B0 B0 B0 B0 CE 03",
    "A0": "02 81 C1 B0 F0 03",
    "A0 -14.5 -13.8": "02 81 C1 B0 A0 AD B1 B4 AE B5 A0 AD B1 B3 AE B8 FA 03",
    "F": "02 81 C6 C7 03",
    "p001": "02 81 F0 B0 B0 B1 C0 03",
    "p000": "02 81 F0 B0 B0 B0 C1 03",
    "o09 1": "02 81 EF B0 B9 A0 B1 F6 03",
    "o09": "02 81 EF B0 B9 E7 03",
}


def chamber_on(wire, port="/dev/ttyUSB2", **keys):
    return CtsChamber(CtsConfig(driver="cts", port=port, **keys), OpenConnection(wire))


def emulated(framed=True, **keys):
    plant = ChamberPlant()
    device = CtsEmulator(plant, framed=framed, address=keys.get("address") or 1)
    wire = MemoryLink(device)
    port = "/dev/ttyUSB2" if framed else "socket://192.168.1.20:1080"
    return chamber_on(wire, port, **keys), wire, plant, device


def said(device, text, now_s=10.0):
    (reply,) = device.receive(encode_frame(1, text), now_s)
    return decode_frame(reply.data)[1]


@pytest.mark.parametrize(("text", "printed"), PRINTED.items())
def test_frames_are_those_that_the_maker_prints(text, printed):
    assert encode_frame(1, text).hex(" ").upper() == printed
    assert decode_frame(bytes.fromhex(printed)) == (1, text)


def test_the_emulator_answers_with_the_printed_bytes():
    """Of the digital channels: an error pending, the door open; no temperature, which stops with the error."""
    plant = ChamberPlant()
    device = CtsEmulator(plant)
    device.faults["alarm"](Fault("chamber", "alarm", at_s=(0.0,)), 0.0)
    device.open_door(True)
    (reply,) = device.receive(bytes.fromhex(PRINTED["O"]), 1.0)
    assert reply.data == bytes.fromhex(PRINTED["O01000100000000"])
    plant.air, plant.set_point = -14.5, -13.8
    (reply,) = device.receive(bytes.fromhex(PRINTED["A0"]), 2.0)
    assert reply.data == bytes.fromhex(PRINTED["A0 -14.5 -13.8"])
    (reply,) = device.receive(bytes.fromhex(PRINTED["F"]), 3.0)
    assert len(reply.data) == 37  # "the total length of the data record always is 37 characters"
    for question, answer in (("p001", "p001"), ("o09 1", "o09")):
        (reply,) = device.receive(bytes.fromhex(PRINTED[question]), 4.0)
        assert reply.data == bytes.fromhex(PRINTED[answer])


def test_values_are_told_as_the_maker_writes_them():
    assert (set_text(25.0), set_text(-14.5), set_text(-5.0), set_text(180.0)) == (
        *("a0 025.0", "a0 -14.5"),
        *("a0 -05.0", "a0 180.0"),
    )
    assert gradient_text(True, 0.05) == "u1 00.05" and gradient_text(False, 23.45) == "d1 23.45"
    assert gradient_text(False, 99.996) == "d1 100.0" and gradient_text(True, 999.9) == "u1 999.9"


def test_answers_are_taken_apart():
    assert decode_analog("A0 -14.5 -13.8") == Analog(-14.5, -13.8)
    assert decode_analog("A3 101.2 000.0", 3) == Analog(101.2, 0.0)
    assert decode_gradients("U1 002.5 999.9") == (2.5, 999.9)
    assert decode_status("S101000000") == Status(running=True, error=False, paused=False)
    assert decode_status("S010000002 and more") == Status(running=False, error=True, paused=True)
    assert decode_error_text(f"F{'Door open':32}") == "Door open"
    assert decode_channels("O01000100000000")[7] == "0"


@pytest.mark.parametrize(
    ("read", "reply"),
    [
        (decode_analog, "A1 025.0 025.0"),
        (decode_analog, "A0 25.0 25.0"),
        (decode_analog, "A0 025.0"),
        (decode_gradients, "U2 001.0 001.0"),
        (decode_status, "S10100000"),
        (decode_status, "S1x1000000"),
        (decode_error_text, "Fshort"),
        (decode_channels, "O0102"),
    ],
)
def test_what_is_no_answer_is_said(read, reply):
    with pytest.raises(ProtocolError, match="not an answer to"):
        read(reply)


@given(
    st.integers(1, 32), st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=1, max_size=40)
)
def test_a_frame_comes_back_and_any_flipped_bit_is_seen(address, text):
    frame = encode_frame(address, text)
    assert decode_frame(frame) == (address, text)
    assert decode_frame(b"\x9c\x81\x02" + frame) == (address, text)
    for bit in range(8, 8 * (len(frame) - 1)):
        damaged = bytearray(frame)
        damaged[bit // 8] ^= 1 << bit % 8
        with pytest.raises(ProtocolError):
            decode_frame(bytes(damaged))


@given(st.floats(-99.9, 200.0), st.floats(0.01, 999.9))
def test_a_demand_is_understood_within_its_last_digit(temp_c, k_per_min):
    plant = ChamberPlant()
    device = CtsEmulator(plant, lower_c=-100.0, upper_c=200.0)
    assert said(device, set_text(temp_c)) == "a" and said(device, gradient_text(True, k_per_min)) == "u"
    told_c, up, _, _ = plant.demands[-1]
    assert told_c == pytest.approx(temp_c, abs=0.0501)
    assert up == pytest.approx(k_per_min, abs=0.0051 if k_per_min < 99 else 0.0501) or (up, k_per_min > 999.8)


@pytest.mark.parametrize("framed", [True, False])
def test_a_day_of_a_chamber(framed):
    chamber, wire, plant, _ = emulated(framed, auxiliary={2: "fog_1 case"})
    identity = chamber.identify()
    assert (identity.maker, dict(identity.details)) == ("CTS", {"gradients, K/min": "999.9 up, 999.9 down"})
    assert chamber.capabilities() == ChamberCapabilities(0.1, (0.01, 999.9), (1, 2, 3, 4, 5, 6))
    assert chamber.limits().max_temp_c == float("inf")
    stop = encode_frame(1, "s1 0") if framed else b"s1 0"
    check_a_day(chamber, wire, plant, {2: 20.1}, fastest=0.0, stop=stop)
    if framed:
        assert wire.sent.count(encode_frame(1, "s1 0")) == 1  # what halt sent was seen to be in force
    else:
        assert wire.sent.count(b"s1 0") == 1 and b"\x02" not in wire.sent


def test_the_sessions_of_labtoys_are_answered():
    """What ASCII_Proto_ETH sends to TCP port 1080, how long an answer it reads, and where it finds the values."""
    plant = ChamberPlant()
    device = CtsEmulator(plant, framed=False)

    def answer(text, length):
        (reply,) = device.receive(text.encode(), 1.0)
        assert len(reply.data) == length
        return reply.data.decode()

    assert float(answer("A0", 14)[3:8]) == 22.0 and float(answer("A0", 14)[9:14]) == 23.0
    assert answer("a0 -20.5", 1) == "a" and answer("s1 1", 2) == "s1"
    assert plant.demands[-1] == (-20.5, 0.0, 0.0, True)
    assert (float(answer("U1", 14)[3:8]), float(answer("U1", 14)[9:14])) == (999.9, 999.9)
    assert answer("s1 0", 2) == "s1" and plant.demands[-1][3] is False


def test_an_error_is_told_in_the_chambers_words_and_a_pause_and_the_door():
    chamber, _, _, device = emulated(door_channel=7)
    chamber.start()
    device.open_door(True)
    assert chamber.alarms() == ["door open"]
    device.open_door(False)
    device.receive(encode_frame(1, "s3 0"), 0.0)
    assert chamber.alarms() == ["paused at the chamber"]
    device.receive(encode_frame(1, "s3 1"), 0.0)
    device.faults["alarm"](Fault("chamber", "alarm", at_s=(0.0,), text="Min. temperature limit 08-B1"), 0.0)
    assert chamber.alarms() == ["Min. temperature limit 08-B1"]
    with pytest.raises(DeviceRefused, match=r"did not start.*Min\. temperature limit 08-B1"):
        chamber.start()
    assert chamber.read_rest().running is False


def test_demands_that_make_no_sense_never_reach_the_line():
    chamber, wire, _, device = emulated()
    for demand in ((float("inf"), None), (20.0, 0.0), (20.0, -3.0), (20.0, 1000.0)):
        with pytest.raises(LimitExceeded):
            chamber.set_temperature(*demand)
    assert wire.sent == b""
    device.faults["refuse"](Fault("chamber", "refuse", at_s=(0.0,), count=99), 0.0)
    with pytest.raises(DeviceSilent):
        chamber.set_temperature(20.0)


def test_every_frame_has_the_address_and_others_answers_are_not_taken():
    chamber, wire, _, device = emulated(address=7)
    assert chamber.state().air_temp_c == 22.0
    assert wire.sent == encode_frame(7, "A0")
    assert device.receive(encode_frame(1, "A0"), 1.0) == []
    other = scripted(encode_frame(2, "S101000000"))
    with pytest.raises(WrongDevice, match="Found: 2"):
        chamber_on(other).identify()


@pytest.mark.parametrize("reply", [b"S101000000", b"8800 Chamber Controller\r", b"\x82\x81\xcf\xce\x03"])
def test_something_else_on_a_line_of_frames_is_no_cts(reply):
    with pytest.raises(WrongDevice):
        chamber_on(scripted(reply)).identify()


@pytest.mark.parametrize("framed", [True, False])
def test_one_that_was_started_again_after_the_halt_is_stopped_again(framed):
    chamber, wire, _, device = emulated(framed)
    chamber.identify()
    chamber.set_temperature(40.0)
    chamber.start()
    chamber.halt()
    device.receive(encode_frame(1, "s1 1") if framed else b"s1 1", wire.now_s)
    chamber.make_safe()
    assert chamber.read_rest() == Rest(True, running=False, set_point_c=23.0)


def test_an_answer_to_another_question_is_not_taken():
    """A late A1 in place of A0: its number is not the air's."""
    with pytest.raises(ProtocolError, match=r"Found: 'A1 077\.7 023\.0'"):
        chamber_on(scripted(encode_frame(1, "A1 077.7 023.0"))).state()


def test_a_set_point_is_confirmed_by_its_own_letter():
    """What else answers it, as a start's s1, confirms nothing; there is nothing to read it back from."""
    chamber, wire, _, _ = emulated()
    chamber.set_temperature(30.0, 2.0)
    replies = [data for _, way, data in wire.exchanges if way == "received"]
    chamber_on(scripted(*replies)).set_temperature(30.0, 2.0)
    with pytest.raises(ProtocolError, match="an answer that begins with a"):
        chamber_on(scripted(*replies[:-1], *[encode_frame(1, "s1")] * 9)).set_temperature(30.0, 2.0)


def test_a_door_cannot_be_asked_for_where_nothing_ends_its_answer():
    (mistake,) = CtsConfig.mistakes({"port": "socket://10.0.0.1:1080", "door_channel": 7})
    assert (mistake.key, mistake.expected) == ("door_channel", "none without frames")
    assert list(CtsConfig.mistakes({"port": "socket://moxa:4001", "framed": True, "door_channel": 7})) == []


@pytest.mark.parametrize("framed", [True, False])
def test_the_record_gives_the_telemetry_that_the_run_saw(framed):
    chamber, wire, plant, _ = emulated(framed, auxiliary={1: "case", 4: "room"})
    damage = (b"\xb2\xae\xb4", b"\xb2\xae\xb5") if framed else (b"-12.4", b"-1\xff.4")
    columns = check_record(chamber, wire, plant, decode_transcript, [20.0, -12.4, 40.0], damage)
    np.testing.assert_array_equal(columns["aux_4_temp_c"], [40.1] * 3)


_PARTS = [encode_frame(1, "A0"), encode_frame(1, "A1 025.0 025.0"), b"A0", b"A1", b"\x02", b"\x03"]
_BYTES = st.one_of(st.binary(max_size=30), st.sampled_from(_PARTS))


@given(st.lists(st.tuples(st.sampled_from(["sent", "received"]), _BYTES), max_size=12))
def test_a_record_of_random_bytes_decodes_to_nothing_and_raises_nothing(chunks):
    check_any_record(decode_transcript, chunks)


@given(st.lists(_BYTES, max_size=8), st.booleans())
def test_the_emulator_takes_any_bytes(chunks, framed):
    device = CtsEmulator(ChamberPlant(), framed=framed)
    for at, data in enumerate(chunks):
        device.receive(data, float(at))
    (reply,) = device.receive(encode_frame(1, "U1") if framed else b"U1", 60.0)
    assert reply.data
