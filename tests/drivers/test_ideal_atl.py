"""The ATL table: lines against what public programs send, driver and emulator in memory, records decoded
again."""

import math

import numpy as np
import pytest

from drivers.base.errors import DeviceRefused, DeviceSilent, ProtocolError, WrongDevice
from drivers.ideal_atl import decode_transcript
from drivers.ideal_atl._codec import decode_number, encode, split_reply
from drivers.ideal_atl._driver import AtlConfig, AtlTable
from drivers.kit.instruments import Rest
from simulators.emulators.ideal_atl import AtlEmulator
from simulators.faults import Fault
from simulators.plant.table import TableAxis, TableParameters
from tests.memory_link import MemoryLink, OpenConnection
from tests.memory_link import scripted as answers

TABLE = AtlConfig(driver="ideal_atl", port="memory")


def table_on(wire):
    return AtlTable(TABLE, OpenConnection(wire))


def emulated(**options):
    plant = TableAxis(TableParameters())
    device = AtlEmulator(plant, **options)
    wire = MemoryLink(device)
    return table_on(wire), wire, plant, device


def scripted(*replies):
    wire = answers(*replies, delay_s=0.02)
    return table_on(wire), wire


def settle(table, wire, seconds=60.0):
    wire.clock.sleep(seconds)
    return table.state()


def test_lines_are_three_letters_and_a_number():
    assert encode("VEL", 10.0) == b"VEL10.000000\r\n"
    assert encode("JOG", 10.0, signed=True) == b"JOG+10.000000\r\n"
    assert encode("JOG", -0.5, signed=True) == b"JOG-0.500000\r\n"
    assert encode("STO") == b"STO\r\n"


def test_an_answer_ends_with_the_prompt():
    assert split_reply(b"123.4560\r\n>\r\n") == (b"123.4560", 11)
    assert split_reply(b"\r\n123.4560\r\n") is None
    assert split_reply(b"\r\n>\r\n") == (b"", 3)
    assert decode_number(b"-12.5000") == -12.5
    for wrong in (b"", b"12.5 deg", b"?", b"nan", b"1e999"):
        with pytest.raises(ProtocolError):
            decode_number(wrong)


def test_a_day_of_a_table():
    table, wire, plant, _ = emulated()
    assert table.identify().maker == "Ideal Aerosmith"
    table.servo_on()
    table.limit_turns(20.0)
    table.point(90.0)
    assert settle(table, wire).angle_deg == pytest.approx(90.0, abs=1e-3)
    assert b"VEL20.000000\r\n" in wire.sent
    table.spin(-5.0)
    assert settle(table, wire).rate_dps == pytest.approx(-5.0, abs=1e-3)
    table.spin(0.0)
    state = settle(table, wire)
    assert state.rate_dps == pytest.approx(0.0, abs=1e-3)
    before = plant.total_angle_deg(wire.clock.now())
    table.turn(-450.0)
    settle(table, wire)
    assert plant.total_angle_deg(wire.clock.now()) - before == pytest.approx(-450.0, abs=1e-2)
    table.home()
    assert math.remainder(settle(table, wire).angle_deg, 360.0) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(
    ("start", "target", "by"), [(350.0, 10.0, 20.0), (10.0, 350.0, -20.0), (0.0, 179.0, 179.0)]
)
def test_pointing_takes_the_shortest_way(start, target, by):
    table, wire, plant, _ = emulated()
    table.servo_on()
    table.point(start)
    settle(table, wire)
    before = plant.total_angle_deg(wire.clock.now())
    table.point(target)
    settle(table, wire)
    assert plant.total_angle_deg(wire.clock.now()) - before == pytest.approx(by, abs=1e-2)


def test_pointing_from_a_jog_stops_first():
    table, wire, _, _ = emulated()
    table.servo_on()
    table.spin(50.0)
    wire.clock.sleep(10.0)
    table.point(30.0)
    assert settle(table, wire).angle_deg == pytest.approx(30.0, abs=1e-3)


def test_what_jog_owes_is_taken_with_the_status_behind_it():
    table, wire, _, _ = emulated()
    table.servo_on()
    table.spin(5.0)
    assert wire.sent.endswith(b"JOG+5.000000\r\nSTA\r\n")
    assert table.state().angle_deg >= 0.0  # nothing of the JOG is left to be taken for a number


@pytest.mark.parametrize("one_prompt", [False, True])
@pytest.mark.parametrize("echo", [False, True])
@pytest.mark.parametrize("line_end", ["\r\n", "\r"])
def test_tables_of_every_kind_are_borne(one_prompt, echo, line_end):
    """One prompt for JOG and STA, or one each; echoes or none; lines that end in CR only."""
    table, wire, _, _ = emulated(one_prompt=one_prompt, echo=echo, line_end=line_end)
    assert table.identify().maker == "Ideal Aerosmith"
    table.servo_on()
    before_s = wire.clock.now()
    table.spin(5.0)
    assert wire.clock.now() - before_s < 0.2 and wire.sent.count(b"JOG") == 1
    for _ in range(3):
        state = settle(table, wire, 10.0)
        assert state.rate_dps == pytest.approx(5.0, abs=1e-3)
    recorded, _ = decode_transcript(iter(wire.exchanges), TABLE)
    assert recorded["rate_dps"] == pytest.approx([5.0] * 3, abs=1e-3)
    table.spin(-5.0)
    table.point(30.0)
    assert settle(table, wire).angle_deg == pytest.approx(30.0, abs=1e-3)
    table.halt()
    table.make_safe()
    assert table.read_rest().reached


def test_a_table_that_answers_the_pair_with_an_empty_line_only_has_jogged():
    table, wire = scripted(b"", b"\r\n>\r\n", b"5.0000\r\n>\r\n", b"1.0000\r\n>\r\n")
    table.spin(5.0)
    assert wire.sent == b"JOG+5.000000\r\nSTA\r\n"
    assert table.state().rate_dps == 5.0


@pytest.mark.parametrize("end", [b"\r\n", b"\r", b"\n"])
def test_the_emulated_table_serves_the_public_program(end):
    """The lines of actigraph/RateTableSweepGUI: one pair of lines for each request, one for JOG and STA."""
    plant = TableAxis(TableParameters())
    device = AtlEmulator(plant, one_prompt=True)
    asked = [b"SRV1", b"ACL20", b"VEL10", b"JOG10", b"STA", b"PPO", b"PVE", b"MCO1", b"STO"]
    answers = [b"".join(reply.data for reply in device.receive(line + end, 1.0)) for line in asked]
    assert answers[3] == b""
    assert [answer.count(b">") for answer in answers] == [1, 1, 1, 0, 1, 1, 1, 1, 1]
    assert float(answers[5].split()[0]) >= 0.0


def asked(device, now_s, *lines):
    """The answers to lines at a time, by what stands before the prompt."""
    replies = [reply.data for line in lines for reply in device.receive(line + b"\r\n", now_s)]
    return [reply.split(b"\r\n")[0].decode() for reply in replies]


def test_a_sine_swings_about_where_the_table_stands_and_ends_after_its_cycles():
    plant = TableAxis(TableParameters(ripple_once_ppm=0.0, ripple_twice_ppm=0.0))
    device = AtlEmulator(plant)
    assert asked(device, 0.0, b"SRV1", b"ACL150", b"RMO30", b"AMP5", b"PER2", b"CYC3") == [""] * 6
    assert asked(device, 10.0, b"SGO") == []  # answered with the next line
    size = 5.0 / (1.0 + (0.5 / 5.0) ** 2)
    assert np.ptp(plant.total_angles_deg(np.linspace(11.0, 13.0, 2001))) == pytest.approx(
        2.0 * size, rel=1e-5
    )
    assert asked(device, 12.0, b"MCO1") == ["", "0"]
    # three cycles of 2 s, then it stands
    assert plant.total_angle_deg(17.0) == pytest.approx(30.0, abs=1e-6)
    assert asked(device, 17.0, b"MCO1", b"PVE") == ["1", "0.0000"]
    assert asked(device, 17.0, b"FRQ10", b"CYC0", b"SGO") == ["", "", "?"]  # 5 deg at 10 Hz: 19,700 deg/s2
    assert asked(device, 17.0, b"FRQ0.5", b"SGO", b"STA") == ["", "", "1"]
    assert abs(plant.rate_dps(100.0)) + abs(plant.rate_dps(100.5)) > 10.0
    assert asked(device, 100.6, b"STO") == [""]
    assert plant.rate_dps(105.0) == pytest.approx(0.0, abs=1e-9)


def test_a_sine_keeps_to_rate_and_acceleration():
    plant = TableAxis(TableParameters(max_acceleration_dps2=8000.0))
    device = AtlEmulator(plant)
    asked(device, 0.0, b"SRV1", b"ACL8000", b"FRQ1")
    # 1000 deg/s at 1 Hz are 159.2 deg; 8000 deg/s2 would be 202.6
    assert asked(device, 0.0, b"AMP160", b"SGO") == ["", "?"]
    assert asked(device, 0.0, b"AMP159", b"SGO", b"PPO")[1:2] == [""]
    assert np.ptp(plant.total_angles_deg(np.linspace(60.0, 61.0, 100))) > 300.0  # without CYC it does not end
    # 1000 deg/s2 at 2 Hz are 6.33 deg
    assert asked(device, 0.0, b"ACL1000", b"FRQ2", b"AMP6.4", b"SGO") == ["", "", "", "?"]
    assert asked(device, 0.0, b"AMP6.3", b"SGO", b"STO")[-2:] == ["", ""]


def test_zero_and_home_are_where_they_were_put():
    exact = dict.fromkeys(("encoder_error_arcsec", "encoder_noise_arcsec", "encoder_ripple_arcsec"), 0.0)
    plant = TableAxis(TableParameters(ripple_once_ppm=0.0, ripple_twice_ppm=0.0, **exact))
    device = AtlEmulator(plant)
    asked(device, 0.0, b"SRV1", b"RMO40")
    assert asked(device, 10.0, b"ZER10", b"PPO", b"HOF-20", b"HOM") == ["", "10.0000", "", ""]
    assert asked(device, 20.0, b"PPO", b"MOV25") == ["340.0000", ""]
    assert asked(device, 30.0, b"PPO", b"DIR1", b"SAV") == ["25.0000", "", ""]
    assert plant.total_angle_deg(30.0) == pytest.approx(55.0, abs=1e-3)
    for wrong in (b"AMP0", b"FRQ0", b"PER-1", b"CYC-1", b"DIR2", b"SAV1", b"ZER"):
        assert asked(device, 30.0, wrong) == ["?"], wrong


def test_a_question_mark_is_a_no():
    table, *_ = emulated()
    with pytest.raises(DeviceRefused, match="JOG"):
        table.spin(5.0)  # the servo is open
    table, _, _, device = emulated()
    device.faults["refuse"](Fault("table", "refuse", at_s=(0.0,)), 0.0)
    with pytest.raises(DeviceRefused, match="STO"):
        table.servo_on()


def test_a_trip_lets_the_table_coast_to_rest():
    table, wire, _, device = emulated()
    table.servo_on()
    table.spin(40.0)
    wire.clock.sleep(30.0)
    device.faults["trip"](Fault("table", "trip", at_s=(1.0,)), wire.clock.now())
    assert settle(table, wire).rate_dps == pytest.approx(0.0, abs=1e-3)


def test_made_safe_from_any_state_it_rests():
    table, wire, _, _ = emulated()
    table.servo_on()
    table.spin(40.0)
    wire.clock.sleep(10.0)
    table.request_state()
    table.halt()
    table.make_safe()
    assert not table.read_rest().reached
    wire.clock.sleep(5.0)
    assert table.read_rest() == Rest(True, {table.axes[0]: 0.0})


def test_other_devices_and_silence_are_named():
    table, _ = scripted(b"0050.0 0024.6 01\r\n>", b"x\r\n>")
    with pytest.raises(WrongDevice, match="PPO"):
        table.identify()
    table, _ = scripted()
    with pytest.raises(DeviceSilent):
        table.identify()
    table, _ = scripted(b"'PPO' is an unknown command.\r")
    with pytest.raises(WrongDevice, match="unknown command"):
        table.identify()


def test_the_record_gives_the_telemetry_that_the_run_saw():
    table, wire, _, _ = emulated()
    table.servo_on()
    table.spin(5.0)
    seen = []
    for _ in range(4):
        wire.clock.sleep(1.0)
        seen.append(table.state())
    columns, counts = decode_transcript(iter(wire.exchanges), TABLE)
    assert counts == {"polls": 4, "damaged": 0}
    np.testing.assert_array_equal(columns["angle_deg"], [state.angle_deg for state in seen])
    np.testing.assert_array_equal(columns["rate_dps"], [state.rate_dps for state in seen])
    late = [(at, way, data.replace(b"5.0000\r\n>", b"5.0?00\r\n>")) for at, way, data in wire.exchanges]
    columns, counts = decode_transcript(iter(late), TABLE)
    assert counts["damaged"] > 0 and len(columns["time_ns"]) == 4 - counts["damaged"]
