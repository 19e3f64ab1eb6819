"""The 34970A family: lines of the User's Guide, driver and emulator in memory, records decoded again."""

import math

import numpy as np
import pytest

from drivers.base.errors import DeviceRefused, WrongDevice
from drivers.keysight_34970a import DaqConfig, DaqLogger, decode_transcript
from simulators.emulators.keysight_34970a import DaqEmulator
from simulators.faults import Fault
from tests.memory_link import ChamberPlant, MemoryLink, OpenConnection, scripted

CONFIG = DaqConfig(
    name="daq",
    driver="keysight_34970a",
    port="memory",
    sensors={103: "fog_1 case", 101: "room"},
    probes={103: "FRTD,85"},
)


def made(config=CONFIG):
    device = DaqEmulator(ChamberPlant())
    wire = MemoryLink(device, "daq")
    return DaqLogger(config, OpenConnection(wire)), wire, device


def said(device, *lines, now_s=10.0):
    replies = [reply for line in lines for reply in device.receive(f"{line}\n".encode(), now_s)]
    return [reply.data.decode().rstrip("\n") for reply in replies]


def test_the_lines_of_the_users_guide():
    device = DaqEmulator(ChamberPlant())
    # User's Guide, chapter 7: a list of thermocouples and of 4-wire RTDs; long and short words are one
    assert said(device, "CONFigure:TEMPerature TCouple,J,(@101,102)", "CONF:TEMP FRTD,85,(@105)") == []
    scans = said(device, "ROUTe:SCAN (@101:102,105)", "ROUT:SCAN:SIZE?", "ROUT:SCAN?")
    assert scans == ["+3", "#214(@101,102,105)"]
    assert said(device, "READ?") == ["+1.01012300E+03,+1.02012300E+03,+1.05012300E+03"]
    assert said(device, "UNIT:TEMP F,(@101)", "UNIT:TEMP? (@101,102)") == ["F,C"]
    assert said(device, "SYST:ERR?") == ['+0,"No error"']
    assert said(device, "ROUT:SCAN (@401)", "MEAS:RES? (@101)", "SYSTEM:ERROR?", "SYST:ERR?") == [
        '-222,"Data out of range"',
        '-113,"Undefined header"',
    ]


def test_a_logger_is_set_up_and_read():
    logger, wire, device = made()
    assert logger.identify().model == "34970A" and wire.sent == b"*IDN?\n"
    said(device, "CONF:TEMP TC,K,(@101)", "UNIT:TEMP F,(@101,103)", now_s=0.0)  # what somebody left
    logger.prepare()
    assert b"CONF:TEMP TC,K,(@101)\n" in wire.sent and b"CONF:TEMP FRTD,85,(@103)\n" in wire.sent
    assert b"ROUT:SCAN (@101,103)\n" in wire.sent
    logger.request_readings()
    begun_s = wire.now_s
    assert logger.read() == {"aux_101_temp_c": 1010.123, "aux_103_temp_c": 1030.123}
    assert wire.now_s - begun_s >= 0.040  # two channels of 20 ms
    device.faults["open_sensor"](Fault("daq", "open_sensor", at_s=(1.0,), count=103), 1.0)
    logger.request_readings()
    row = logger.read()
    assert row["aux_101_temp_c"] == 1010.123 and math.isnan(row["aux_103_temp_c"])
    columns, counts = decode_transcript(wire.exchanges, CONFIG)
    assert counts == {"polls": 2, "damaged": 0}
    np.testing.assert_array_equal(columns["aux_103_temp_c"], [1030.123, np.nan])
    logger.halt()
    logger.make_safe()
    assert logger.read_rest().reached and logger.alarms() == []


def test_a_logger_without_the_module_and_one_that_stays_in_fahrenheit_are_refused():
    logger, _, _ = made(DaqConfig(name="daq", driver="d", port="memory", sensors={121: "case"}))
    with pytest.raises(DeviceRefused, match=r"CONF:TEMP TC,K,\(@121\).*Data out of range"):
        logger.prepare()
    answers = [b'+0,"No error"\n'] * 6 + [b"F,F\n"]
    logger = DaqLogger(CONFIG, OpenConnection(scripted(*answers)))
    with pytest.raises(DeviceRefused, match="F, F"):
        logger.prepare()
    with pytest.raises(WrongDevice, match="34970A"):
        DaqLogger(CONFIG, OpenConnection(scripted(b"HEWLETT-PACKARD,34401A,0,10-5-2\n"))).identify()


@pytest.mark.parametrize(
    ("given", "key"),
    [
        ({"sensors": {"401": "x"}}, "sensors.401"),
        ({"sensors": {"101": "x"}, "probes": {"102": "TC,K"}}, "probes.102"),
        ({"sensors": {"101": "x"}, "probes": {"101": "TC,Q"}}, "probes.101"),
    ],
)
def test_mistakes_in_a_section(given, key):
    assert [mistake.key for mistake in DaqConfig.mistakes(given)] == [key]
