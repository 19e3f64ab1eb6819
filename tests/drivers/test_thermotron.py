"""Thermotron chambers: bytes that others print, others' clients, driver and emulator in memory, records."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymeasure.adapters import ProtocolAdapter
from pymeasure.instruments.thermotron import Thermotron3800, thermotron3800

from drivers.base.errors import DeviceRefused, LimitExceeded, ProtocolError, WrongDevice
from drivers.kit.instruments import ChamberCapabilities, ChamberLimits, Rest
from drivers.thermotron._driver import ThermotronChamber, ThermotronConfig
from drivers.thermotron._transcript import decode_transcript
from drivers.thermotron.codec import (
    CHANNELS,
    decode_code,
    decode_identity,
    decode_line,
    decode_number,
    decode_text,
    encode_line,
    set_point_text,
)
from simulators.emulators.thermotron import ThermotronEmulator
from simulators.faults import Fault
from tests.chamber_checks import check_a_day, check_any_record, check_record
from tests.memory_link import ChamberPlant, MemoryLink, OpenConnection
from tests.memory_link import scripted as answers

MANUAL = {  # what a firmware quotes of the 8200's manual, in hexadecimal there too (TC_THERMOTRON_8200.c)
    "SETP1,22.000": "53 45 54 50 31 2C 32 32 2E 30 30 30 0D",
    "SETP1?": "53 45 54 50 31 3F 0D",
    "PVAR1?": "50 56 41 52 31 3F 0D",
    "RUNM": "52 55 4E 4D 0D",
    "STOP": "53 54 4F 50 0D",
}
TWENTY_TWO = bytes.fromhex("32 32 2E 30 30 30 0D")


def chamber_on(wire, controller="8800", **keys):
    config = ThermotronConfig(driver="thermotron_8200", port="memory", controller=controller, **keys)
    return ThermotronChamber(config, OpenConnection(wire))


def emulated(controller="8800", address=None, acknowledges=True, keys=None, **options):
    plant = ChamberPlant()
    said = {"controller": controller, "address": address, "acknowledges": acknowledges}
    device = ThermotronEmulator(plant, **said, **options)
    wire = MemoryLink(device)
    return chamber_on(wire, **said, **(keys or {})), wire, plant, device


def scripted(*replies, controller="8800", **keys):
    wire = answers(*replies, delay_s=0.05)
    return chamber_on(wire, controller, **keys), wire


def said(device, line, now_s=10.0, end=b"\r"):
    (reply,) = device.receive(line.encode() + end, now_s)
    assert reply.data.endswith(end)
    return reply.data.decode().removesuffix(end.decode())


def test_lines_are_those_of_the_manual():
    assert set_point_text(22.0) == "SETP1,22.000"
    assert {text: encode_line(text).hex(" ").upper() for text in MANUAL} == MANUAL
    assert decode_number(decode_line(TWENTY_TWO)) == 22.0
    addressed = bytes([0xFF, ord("#"), 7]) + b"PVAR1?\r"
    assert encode_line("PVAR1?", 7) == addressed
    assert decode_line(bytes([0xFF, ord("#"), 7]) + TWENTY_TWO, 7) == "22.000"


@pytest.mark.parametrize("controller", ["8200", "8800"])
def test_the_emulator_answers_the_manuals_bytes(controller):
    plant = ChamberPlant()
    device = ThermotronEmulator(plant, controller=controller)
    for text in ("SETP1,22.000", "RUNM"):
        device.receive(bytes.fromhex(MANUAL[text]), 1.0)
    assert plant.demands[-1] == (22.0, 100.0, 100.0, True)
    for text in ("PVAR1?", "SETP1?"):
        (reply,) = device.receive(bytes.fromhex(MANUAL[text]), 2.0)
        assert reply.data == TWENTY_TWO
    device.receive(bytes.fromhex(MANUAL["STOP"]), 3.0)
    assert plant.demands[-1][3] is False


def test_a_set_point_may_be_answered_by_itself():
    """As the manual of the 8200 prints it, in place of the code 0."""
    chamber, wire = scripted(b"0\r", b"0\r", TWENTY_TWO, controller="8200")
    chamber.set_temperature(22.0)
    assert wire.sent == b"STAT?\rMRMP1,100.0\rSETP1,22.000\r"


@pytest.mark.parametrize(
    "reply", ["", "22,0", "nan", "1e5", "22.000.0", "8800 Chamber", "\xb2\xb2.000", "--3"]
)
def test_what_is_no_value_is_said(reply):
    with pytest.raises(ProtocolError, match="not a value"):
        decode_number(reply)


@given(st.floats(-200.0, 400.0), st.one_of(st.none(), st.integers(1, 127)))
def test_a_value_comes_back_within_the_last_digit(value, address):
    line = encode_line(f"{value:.3f}", address)
    assert decode_number(decode_line(line, address)) == pytest.approx(value, abs=6e-4)


@given(st.binary(max_size=40))
def test_no_bytes_raise_anything_but_a_protocol_error(data):
    for read in (decode_text, decode_identity, decode_number, decode_code):
        for address in (None, 5):
            try:
                read(decode_line(data, address))
            except ProtocolError as error:
                assert error.expected


class Client(ProtocolAdapter):
    """pymeasure's end of a line to an emulator; it reads no code after a command."""

    def __init__(self, device):
        super().__init__()
        self.device, self.answers = device, []

    def _write(self, command, **_):
        self.answers += [
            reply.data.decode().strip() for reply in self.device.receive(f"{command}\r".encode(), 1.0)
        ]

    def _read(self, **_):
        return self.answers.pop(0)


def test_pymeasures_3800_works_on_the_emulator(monkeypatch):
    monkeypatch.setattr(thermotron3800, "sleep", lambda duration_s: None)
    plant = ChamberPlant()
    oven = Thermotron3800(Client(ThermotronEmulator(plant, controller="3800", acknowledges=False)))
    assert "3800" in oven.id
    assert oven.mode == Thermotron3800.Thermotron3800Mode.EDIT_MODE_STOP
    oven.initalize_oven()
    oven.setpoint = -20
    assert oven.setpoint == 23.0  # "will not update until run() is called"
    oven.run()
    assert (oven.setpoint, oven.temperature) == (-20.0, -20.0)
    assert oven.mode == Thermotron3800.Thermotron3800Mode.MANUAL_MODE
    oven.stop()
    assert plant.demands[-1][3] is False


@pytest.mark.parametrize(
    ("controller", "query", "answer"),
    [  # what public programs take apart: ThermotronChamber, RemoteTempChamber (8800), Thermotron8200Controller
        ("8800", "IDEN?", r"8800 Chamber Controller"),
        ("8800", "ALRM1?", r"0"),
        ("8800", "CCNF1?", r"2"),
        ("8800", "CHST?", r"257"),
        ("8800", "DTYP1?", r"1"),
        ("8800", "MODE?", r"2"),
        ("8800", "STAT?", r"0"),
        ("8800", "SCOD?", r"0"),
        ("8800", "TMPS?", r"0"),
        ("8800", "OPTN?", r"0"),
        ("8800", "CMST?", r"1"),
        ("8800", "DOOR?", r"1"),
        ("8800", "LGHT?", r"0"),
        ("8800", "THTL1?", r"\d+"),
        ("8800", "MRMP1?", r"\d+\.\d+"),
        ("8800", "FVAL1?", r"23\.000"),
        ("8800", "DEVN1?", r"-?\d+\.\d+"),
        ("8800", "PVAR13?", r"130\.123"),
        ("8800", "PALL1?", r"-75\.000"),
        ("8800", "INIT", r"0"),
        ("8800", "SETP1,500", r"3"),
        ("8800", "BANG?", r"2"),
        ("8200", "STAT?", r"0"),
        ("8200", "MRMP1?", r"\d+\.\d+"),
        ("8200", "HOLD", r"4"),
        ("8200", "SCOD?", r"2"),
        ("3800", "IDEN?", r".{23}"),
        ("3800", "MRMP1?", r"2"),
        ("3800", "SCOD?", r"0"),
    ],
)
def test_what_others_ask_is_answered(controller, query, answer):
    device = ThermotronEmulator(ChamberPlant(), controller=controller)
    assert re.fullmatch(answer, said(device, query))
    assert re.fullmatch(
        answer, said(ThermotronEmulator(ChamberPlant(), controller=controller), query, end=b"\n")
    )


def test_a_refused_command_leaves_its_code_in_the_error_buffer():
    device = ThermotronEmulator(ChamberPlant())
    assert (said(device, "MRMP1,0"), said(device, "IERR?"), said(device, "IERR?")) == ("3", "3", "0")
    assert said(device, "RUNM", end=b"\r\n") == "0"
    assert (said(device, "HOLD"), said(device, "STAT?")) == ("0", "32")
    assert (said(device, "RESM"), said(device, "STAT?")) == ("0", "16")


def test_a_day_of_an_8800():
    chamber, wire, plant, device = emulated(keys={"auxiliary": {5: "fog_1 case"}})
    identity = chamber.identify()
    assert (identity.maker, identity.model, identity.firmware) == ("Thermotron", "8800", "1.00")
    assert chamber.limits() == ChamberLimits(-75.0, 180.0)
    assert chamber.capabilities() == ChamberCapabilities(0.1, (0.1, 100.0), CHANNELS)
    check_a_day(chamber, wire, plant, {5: 50.123}, fastest=100.0, stop=b"\rSTOP\r")
    # what a stopped controller makes of a set point is not public: it is told again once it runs
    assert wire.sent.rindex(b"SETP1,40.000\r") > wire.sent.index(b"RUNM\r")
    assert wire.sent.count(b"STOP\r") == 1  # what halt sent was seen to be in force
    assert said(device, "SCOD?", wire.now_s) == "5" and chamber.alarms() == []


def test_one_that_was_started_again_after_the_halt_is_stopped_again():
    chamber, wire, _, device = emulated()
    chamber.identify()
    chamber.set_temperature(40.0)
    chamber.start()
    chamber.halt()
    device.receive(b"RUNM\r", wire.now_s)
    chamber.make_safe()
    assert chamber.read_rest() == Rest(True, running=False, set_point_c=23.0)


def test_an_8200_tells_no_limits_and_no_alarms():
    chamber, _, plant, _ = emulated("8200")
    assert chamber.identify().model == "8200"
    assert chamber.limits().max_temp_c == float("inf") and chamber.alarms() == [] and not chamber.tells_alarms
    chamber.start()
    chamber.set_temperature(-30.0, 2.0)
    assert plant.demands[-1] == (-30.0, 2.0, 2.0, True)
    chamber.stop()
    assert chamber.read_rest() == Rest(True, running=False)


@pytest.mark.parametrize("acknowledges", [True, False])
def test_a_3800_loads_a_set_point_as_it_runs_and_is_led_along_ramps(acknowledges):
    chamber, wire, plant, _ = emulated("3800", acknowledges=acknowledges)
    chamber.identify()
    assert chamber.capabilities() == ChamberCapabilities(0.1, None, ())
    with pytest.raises(LimitExceeded, match="no ramp"):
        chamber.set_temperature(40.0, 5.0)
    chamber.set_temperature(40.0)
    assert plant.demands == []
    chamber.start()
    assert plant.demands[-1] == (40.0, 0.0, 0.0, True)
    chamber.set_temperature(-10.0)
    assert plant.demands[-1] == (-10.0, 0.0, 0.0, True)
    assert b"MRMP" not in wire.sent
    chamber.halt()
    chamber.make_safe()
    assert plant.demands[-1][3] is False
    assert chamber.read_rest() == Rest(True, running=False)  # it shows its set point once it runs
    chamber.start()
    assert plant.demands[-1] == (23.0, 0.0, 0.0, True)


def test_a_controller_that_does_not_answer_commands_is_read_back():
    chamber, wire, plant, device = emulated(acknowledges=False)
    chamber.identify()
    chamber.start()
    chamber.set_temperature(30.0, 3.0)
    assert plant.demands[-1] == (30.0, 3.0, 3.0, True)
    device.faults["refuse"](Fault("chamber", "refuse", at_s=(0.0,), count=9), 0.0)
    with pytest.raises(ProtocolError, match=r"MRMP1,4.0 is not in force"):
        chamber.set_temperature(20.0, 4.0)
    assert wire.sent.count(b"SETP1,20.000") == 0


@pytest.mark.parametrize(
    ("setting", "found"),
    [
        ({"fahrenheit": True}, r"TMPS\? = 1 \(degrees Fahrenheit\)"),
        ({"product_control": True}, "product temperature control is on"),
    ],
)
def test_what_makes_its_numbers_mean_something_else_is_refused(setting, found):
    chamber, _, plant, _ = emulated(**setting)
    with pytest.raises(WrongDevice, match=found):
        chamber.identify()
    assert plant.demands == []


def test_what_the_bench_file_says_otherwise_is_refused():
    with pytest.raises(WrongDevice, match=r"CMST\? = 1"):
        chamber_on(MemoryLink(ThermotronEmulator(ChamberPlant())), acknowledges=False).identify()
    with pytest.raises(WrongDevice, match="3800 Chamber Controller"):
        chamber_on(MemoryLink(ThermotronEmulator(ChamberPlant(), controller="3800"))).identify()
    with pytest.raises(WrongDevice, match=r"DTYP2\? = 2"):
        humidity = b"2\r"
        name = b"8800 Chamber Controller\r"
        scripted(name, b"1.0\r", b"0\r", b"0\r", b"1\r", humidity, auxiliary={2: "case"})[0].identify()


def test_why_it_stopped_is_an_alarm_while_it_should_run():
    chamber, _, plant, device = emulated(keys={"door_message": "door"})
    assert chamber.alarms() == []
    device.open_door(True, 0.0)
    assert chamber.alarms() == ["door open"]
    device.open_door(False, 0.0)
    chamber.start()
    device.faults["alarm"](Fault("chamber", "alarm", at_s=(0.0,), count=10), 0.0)
    assert chamber.alarms() == ["stopped, code 10: Therm-Alarm trip"]
    chamber.make_safe()
    assert chamber.alarms() == []
    device.faults["alarm"](Fault("chamber", "alarm", at_s=(0.0,)), 0.0)
    assert chamber.alarms() == ["high process alarm"]
    with pytest.raises(DeviceRefused, match=r"refused 'RUNM'.*Found: code 4"):
        chamber.start()
    assert plant.demands[-1][3] is False


def test_a_program_that_runs_is_not_taken_for_manual_mode():
    name, program = b"8200 Chamber Controller\r", b"1\r"
    chamber, wire = scripted(b"4\r", name, program, controller="8200")
    wire.retries = 2
    with pytest.raises(DeviceRefused, match=r"refused 'RUNM'.*Found: code 4"):
        chamber.start()
    assert wire.sent == b"RUNM\rIDEN?\rSTAT?\r"


def test_demands_that_make_no_sense_never_reach_the_line():
    chamber, wire, _, _ = emulated()
    for demand in ((float("inf"), None), (20.0, 0.0), (20.0, -3.0), (20.0, 101.0)):
        with pytest.raises(LimitExceeded):
            chamber.set_temperature(*demand)
    assert wire.sent == b""
    with pytest.raises(DeviceRefused, match=r"refused 'SETP1,500.000'.*Found: code 3"):
        chamber.set_temperature(500.0)


def test_on_rs485_every_line_begins_with_the_address():
    chamber, wire, _, device = emulated(address=7)
    chamber.identify()
    assert chamber.state().air_temp_c == 21.988
    assert all(line.startswith(b"\xff#\x07") for line in wire.sent.split(b"\r") if line)
    assert device.receive(b"PVAR1?\r\xff#\x08PVAR1?\r", 1.0) == []


@pytest.mark.parametrize("address", [None, 7])
def test_the_record_gives_the_telemetry_that_the_run_saw(address):
    chamber, wire, plant, _ = emulated(address=address, keys={"auxiliary": {13: "case"}})
    damage = (b"-12.36", b"-1\xff.36")
    columns = check_record(chamber, wire, plant, decode_transcript, [20.04, -12.36, 40.0], damage)
    np.testing.assert_array_equal(columns["aux_13_temp_c"], [130.123] * 3)


@given(st.lists(st.tuples(st.sampled_from(["sent", "received"]), st.binary(max_size=30)), max_size=12))
def test_a_record_of_random_bytes_decodes_to_nothing_and_raises_nothing(chunks):
    check_any_record(decode_transcript, chunks)


@given(st.lists(st.binary(max_size=12), max_size=8), st.sampled_from(["8200", "8800", "3800"]))
def test_the_emulator_takes_any_bytes(chunks, controller):
    device = ThermotronEmulator(ChamberPlant(), controller=controller)
    for at, data in enumerate(chunks):
        device.receive(data, float(at))
    device.receive(b"\r", 20.0)
    assert "Controller" in said(device, "IDEN?", 30.0)
