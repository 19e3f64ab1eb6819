"""ESPEC chambers: lines against the maker's own library, driver and emulator in memory, records decoded again."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.base.errors import DeviceRefused, LimitExceeded, ProtocolError, WrongDevice
from drivers.espec._driver import EspecChamber, EspecConfig
from drivers.espec._transcript import decode_transcript
from drivers.espec.codec import Temperatures, decode_alarms, decode_temperatures, ramp_minutes, ramp_text
from drivers.kit.instruments import ChamberLimits, Rest
from simulators.emulators.espec import EspecEmulator
from simulators.faults import Fault
from tests.chamber_checks import check_any_record, check_record
from tests.memory_link import ChamberPlant, MemoryLink, OpenConnection
from tests.memory_link import scripted as answers


def chamber_on(wire, rom="P3", address=None):
    config = EspecConfig(driver="espec_p300", port="memory", address=address)
    return EspecChamber(config, OpenConnection(wire), model="P-300", rom=rom)


def emulated(address=None, rom="P3", **options):
    plant = ChamberPlant()
    device = EspecEmulator(plant, address=address, **options)
    wire = MemoryLink(device)
    return chamber_on(wire, rom, address), wire, plant, device


def scripted(*replies):
    wire = answers(*replies, delay_s=0.05)
    return chamber_on(wire), wire


def test_replies_of_the_makers_documents():
    assert decode_temperatures("26.4,0.0,140.0,-50.0") == Temperatures(26.4, 0.0, 140.0, -50.0)
    assert decode_alarms("0") == []
    assert decode_alarms("2,0,48") == [0, 48]


@pytest.mark.parametrize("reply", ["", "26.4,0.0,140.0", "26.4,nan,140.0,-50.0", "a,b,c,d", "NA:CMD ERR"])
def test_what_is_no_temperature_reply_is_said(reply):
    with pytest.raises(ProtocolError, match="TEMP"):
        decode_temperatures(reply)


def test_a_ramp_is_a_remote_program():
    assert ramp_text(25.0, 85.0, 60.0 / 90.0) == "RUN PRGM, TEMP25.0 TIME1:30 GOTEMP85.0"
    assert ramp_text(25.0, -45.0, 12.0) == "RUN PRGM, TEMP25.0 TIME0:06 GOTEMP-45.0"  # 5.83 min


@given(st.floats(-70, 150), st.floats(-70, 150), st.floats(0.01, 100))
def test_a_ramp_is_never_faster_than_demanded_and_less_than_a_minute_too_long(start, end, rate):
    minutes = ramp_minutes(start, end, rate)
    assert abs(end - start) / minutes <= rate * (1 + 1e-6)
    assert minutes - 1 <= abs(end - start) / rate + 1e-6


def said(device, line, now_s=10.0):
    (reply,) = device.receive(line.encode() + b"\r\n", now_s)
    return reply.data.decode().removesuffix("\r\n")


@pytest.mark.parametrize(
    ("query", "answer"),
    [  # what the reads of ChamberConnectLibrary's P300 take apart; NA: what its error table says
        ("ROM?,DISP", r"P300 .*"),
        ("DATE?", r"\d+\.\d+/\d+"),
        ("TIME?", r"\d+:\d+:\d+"),
        ("SRQ?", r"[01]{8}"),
        ("MASK?", r"[01]{8}"),
        ("TIMER ON?", r"0"),
        ("TIMER USE?", r"0"),
        ("ALARM?", r"0"),
        ("KEYPROTECT?", r"ON|OFF"),
        ("TYPE?", r"T,\w+,\d+\.\d"),
        ("MODE?", r"STANDBY"),
        ("MODE?,DETAIL", r"STANDBY"),
        ("MON?,DETAIL", r"-?\d+\.\d,,STANDBY,0"),
        ("TEMP?", r"(-?\d+\.\d,){3}-?\d+\.\d"),
        ("SET?", r"REF[01369]"),
        ("REF?", r"1,OFF1"),
        ("RELAY?", r"0"),
        ("%?", r"1,\d+\.\d"),
        ("CONSTANT SET?,TEMP", r"23\.0,ON"),
        ("CONSTANT SET?,REF", r"AUTO"),
        ("CONSTANT SET?,RELAY", r"0"),
        ("PRGM USE?,RAM", r"0"),
        ("IPSET?", r"[\d.]+,[\d.]+,[\d.]+"),
        ("HUMI?", r"NA:CONT NOT READY-1"),
        ("CONSTANT SET?,HUMI", r"NA:CONT NOT READY-1"),
        ("CONSTANT SET?,PTC", r"NA:CONT NOT READY-1"),
        ("TEMP PTC?", r"NA:CONT NOT READY-1"),
        ("PRGM MON?", r"NA:CONT NOT READY-2"),
        ("RUN PRGM MON?", r"NA:CONT NOT READY-2"),
        ("PRGM DATA?,RAM:1", r"NA:DATA NOT READY"),
        ("PRGM USE?,RAM:1", r"NA:DATA NOT READY"),
        ("SPEED?", r"NA:CMD ERR"),
    ],
)
def test_the_makers_own_library_is_answered(query, answer):
    assert re.fullmatch(answer, said(EspecEmulator(ChamberPlant()), query))


def test_a_remote_program_is_told_in_detail():
    device = EspecEmulator(ChamberPlant())
    assert said(device, "RUN PRGM, TEMP25.0 TIME1:30 GOTEMP85.0").startswith("OK:")
    assert said(device, "MODE?") == "RUN"
    assert said(device, "MODE?,DETAIL") == "RMT RUN"
    assert said(device, "RUN PRGM?") == "TEMP25.0 GOTEMP85.0 TIME1:30 REF9"
    assert said(device, "RUN PRGM MON?", 10.0 + 1800.0) == "1,85.0,1:00,0"
    assert said(device, "MODE?,DETAIL", 10.0 + 5400.0) == "RMT RUN END HOLD"
    older = EspecEmulator(ChamberPlant(), rom="SCP-220 V2.10")
    assert said(older, "MODE?,DETAIL") == "NA:CONT NOT READY-3"


def test_a_day_of_a_chamber():
    chamber, wire, plant, _ = emulated()
    plant.air = 25.0
    assert chamber.identify().maker == "ESPEC"
    assert chamber.limits() == ChamberLimits(-75.0, 155.0)
    chamber.set_temperature(23.0)
    chamber.start()
    assert plant.demands[-1] == (23.0, 0.0, 0.0, True)
    plant.air = 25.0
    chamber.set_temperature(-45.0, 10.0)
    assert b"RUN PRGM, TEMP25.0 TIME0:07 GOTEMP-45.0\r\n" in wire.sent
    assert plant.demands[-1] == (-45.0, 10.0, 10.0, True)
    assert chamber.state().air_temp_c == -45.0
    chamber.set_temperature(60.0)
    assert plant.demands[-1] == (60.0, 0.0, 0.0, True)
    chamber.halt()
    chamber.make_safe()
    assert plant.demands[-1] == (23.0, 0.0, 0.0, False)
    assert chamber.read_rest() == Rest(True, running=False, set_point_c=23.0)
    assert wire.sent.count(b"MODE,STANDBY") == 1  # what halt sent was confirmed


def test_a_ramp_demanded_at_rest_begins_with_the_start():
    chamber, wire, plant, _ = emulated()
    plant.air = 20.0
    chamber.set_temperature(50.0, 5.0)
    assert b"RUN PRGM" not in wire.sent
    chamber.start()
    assert b"RUN PRGM, TEMP20.0 TIME0:06 GOTEMP50.0\r\n" in wire.sent
    assert plant.demands[-1] == (50.0, 5.0, 5.0, True)


def test_on_rs485_every_line_begins_with_the_address():
    chamber, wire, _, _ = emulated(address=7)
    chamber.state()
    assert wire.sent == b"7,TEMP?\r\n"


def test_refusals_come_with_their_meaning():
    chamber, _, plant, device = emulated()
    with pytest.raises(DeviceRefused, match=r"DATA OUT OF RANGE \(a value is outside its range\)"):
        chamber.set_temperature(200.0)
    assert plant.demands == []
    device.faults["refuse"](Fault("chamber", "refuse", at_s=(0.0,), text="PROTECT ON"), 0.0)
    with pytest.raises(DeviceRefused, match="changes are locked at the chamber's panel"):
        chamber.set_temperature(20.0)
    device.faults["alarm"](Fault("chamber", "alarm", at_s=(0.0,), count=48), 0.0)
    assert chamber.alarms() == ["alarm 48 (see the alarm list of the chamber's manual)"]
    with pytest.raises(DeviceRefused, match="CHB NOT READY"):
        chamber.start()


def test_demands_that_make_no_sense_never_reach_the_line():
    chamber, wire, _, _ = emulated()
    for demand in ((float("inf"), None), (20.0, 0.0), (20.0, -3.0)):
        with pytest.raises(LimitExceeded):
            chamber.set_temperature(*demand)
    assert wire.sent == b""


def test_the_other_controller_is_named():
    with pytest.raises(WrongDevice, match="SCP-220 V2"):
        scripted(b"SCP-220 V2.10\r\n", b"T,S2,160.0\r\n")[0].identify()


def test_make_safe_passes_over_answers_to_older_questions():
    chamber, wire, plant, _ = emulated()
    chamber.set_temperature(60.0)
    chamber.start()
    chamber.request_state()  # its answer is still on its way
    chamber.halt()
    chamber.make_safe()
    assert plant.demands[-1] == (23.0, 0.0, 0.0, False)
    assert wire.sent.endswith(b"MODE,STANDBY\r\nTEMP, S23.0\r\n")


def test_the_record_gives_the_telemetry_that_the_run_saw():
    chamber, wire, plant, _ = emulated()
    check_record(chamber, wire, plant, decode_transcript, [20.0, -12.4, 40.0], (b"-12.4", b"-1\xff.4"))


@given(st.lists(st.tuples(st.sampled_from(["sent", "received"]), st.binary(max_size=30)), max_size=12))
def test_a_record_of_random_bytes_decodes_to_nothing_and_raises_nothing(chunks):
    check_any_record(decode_transcript, chunks)
