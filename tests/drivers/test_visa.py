"""VISA resources: PyVISA-sim as the instrument, PyVISA-py on a socket of its own against the emulated lab."""

import sys
from pathlib import Path

import pytest
import pyvisa

from bench.control.discovery import identify_port
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import load_bench_file
from drivers.base.clock import WallClock
from drivers.base.errors import ConfigurationError, DeviceSilent, LinkLost
from drivers.keysight_e36300 import E36300, E36300Config
from drivers.kit import link as link_module
from drivers.kit.config import OutputConfig
from drivers.kit.kinds import Connection
from drivers.kit.link import Link
from drivers.kit.places import is_visa
from tests.benches import FOG_BENCH

pytestmark = pytest.mark.concurrent

USB = "USB0::0x2A8D::0x1002::MY61000001::INSTR"
SIMULATED = f"""
spec: "1.1"
devices:
  supply:
    delimiter: ""  # PyVISA-sim would answer the parts of a line in messages of their own, unlike IEEE 488.2
    eom:
      USB INSTR:
        q: "\\n"
        r: "\\n"
    error: ERROR
    dialogues:
      - {{q: "*IDN?", r: "Keysight Technologies,E36312A,MY61000001,2.1.0-1.0.4-1.12"}}
      - {{q: "SYST:ERR?", r: '+0,"No error"'}}
      - {{q: "OUTP ON,(@1)", r: null_response}}
      - {{q: "MEAS:VOLT? (@1);:MEAS:CURR? (@1)", r: "+5.00012E+00;+2.51000E-01"}}
resources:
  {USB}:
    device: supply
"""


@pytest.fixture
def simulated(tmp_path, monkeypatch):
    (tmp_path / "instruments.yaml").write_text(SIMULATED)
    monkeypatch.setenv("PYVISA_LIBRARY", f"{tmp_path / 'instruments.yaml'}@sim")


def supply(place, **connection):
    output = OutputConfig(number=1, voltage_v=5.0, current_limit_a=2.0)
    config = E36300Config(name="supply", driver="keysight_e36300", port=place, outputs=(output,))
    return E36300.open(config, Connection("supply", WallClock(), None))


def test_what_a_visa_resource_is():
    assert all(
        map(is_visa, (USB, "GPIB0::5::INSTR", "TCPIP0::10.0.0.5::inst0::INSTR", "tcpip::x::5025::SOCKET"))
    )
    others = ("/dev/ttyUSB0", "COM3", "socket://10.0.0.5:5025", "socket://[::1]:5025", "ASRL1::INSTR")
    assert not any(map(is_visa, others))


def test_a_supply_at_a_visa_resource_is_asked_and_read(simulated):
    device = supply(USB)
    try:
        identity = device.identify()
        assert (identity.model, identity.serial_number) == ("E36312A", "MY61000001")
        device.request_readings()
        assert device.read() == {"output_1_voltage_v": 5.00012, "output_1_current_a": 0.251}
        assert device.link.spoken == "" and device.link.bytes_received > 80
    finally:
        device.link.close()


def test_ports_identify_asks_instruments_only_at_a_visa_resource(simulated):
    asked = []
    found = identify_port(USB, WallClock(), asked.append)
    assert (
        found.driver == "keysight_e36300" and found.text == "Keysight Technologies E36312A MY61000001 (VISA)"
    )
    assert not [text for text in asked if "acutrol" in text or "espec" in text]


def test_a_resource_that_is_not_there_says_so(simulated):
    with pytest.raises(ConfigurationError, match="cannot be opened") as refused:
        supply("USB0::0x2A8D::0x1002::ANOTHER::INSTR")
    assert "VISA" in str(refused.value)


def test_without_pyvisa_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvisa", None)
    with pytest.raises(ConfigurationError, match=r"pip install 'gyrobench\[visa\]'"):
        Link(USB, WallClock(), name="supply")


class Instrument:
    """A resource whose answers a test gives: bytes, or the error that VISA raises."""

    session = 1

    def __init__(self, *answers):
        self.answers, self.written, self.cleared, self.timeout = list(answers), [], 0, 0

    def write_raw(self, message):
        self.written.append(message)

    def read_raw(self):
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def clear(self):
        self.cleared += 1

    def close(self):
        self.closed = True


def linked(monkeypatch, instrument):
    class Manager:
        def open_resource(self, place, open_timeout):
            return instrument

    monkeypatch.setattr(pyvisa, "ResourceManager", Manager)
    return Link(USB, WallClock(), name="supply")


def error(code):
    return pyvisa.errors.VisaIOError(code)


@pytest.mark.parametrize("selects_files", [True, False])
def test_each_line_is_a_message_and_only_questions_are_read(monkeypatch, selects_files):
    monkeypatch.setattr(link_module, "SELECTS_FILES", selects_files)
    instrument = Instrument(b"1\n", b"2", b"3\r\n")
    link = linked(monkeypatch, instrument)
    link.write(b"OUTP 1\nMEAS:VOLT?\nMEAS:CU")
    assert link.read_until(b"\n", 5.0) == b"1\n"
    link.write(b"RR?\n*IDN?\n")
    assert link.read_until(b"\n", 5.0) == b"2\n"  # the end of a message is an end of line
    assert link.read_until(b"\n", 5.0) == b"3\r\n"
    assert instrument.written == [b"OUTP 1\n", b"MEAS:VOLT?\n", b"MEAS:CURR?\n", b"*IDN?\n"]
    assert instrument.timeout == 3000
    link.close()


def test_a_question_without_answer_is_silence_and_the_next_is_answered(monkeypatch):
    silent = error(pyvisa.constants.StatusCode.error_timeout)
    instrument = Instrument(silent, b"5.0\n")
    link = linked(monkeypatch, instrument)
    link.write(b"MEAS:VOLT?\n")
    with pytest.raises(DeviceSilent):
        link.read_until(b"\n", 0.2)
    link.write(b"VOLT?\n")
    assert link.read_until(b"\n", 5.0) == b"5.0\n" and instrument.cleared == 1
    link.close()


def test_an_instrument_that_is_unplugged_is_a_lost_port(monkeypatch):
    instrument = Instrument(error(pyvisa.constants.StatusCode.error_connection_lost))
    link = linked(monkeypatch, instrument)
    link.write(b"MEAS:VOLT?\n")
    with pytest.raises(LinkLost):
        link.read_until(b"\n", 5.0)
    link.close()


BENCH_WITH_SUPPLY = f"""{FOG_BENCH}
[[supply]]
name = "psu"
driver = "keysight_e36300"
port = "{USB}"
[[supply.outputs]]
number = 1
voltage_v = 5.0
current_limit_a = 2.0
"""


def bench_file(tmp_path: Path, text: str):
    (tmp_path / "lab.toml").write_text(text)
    return load_bench_file(tmp_path / "lab.toml")


def test_pyvisa_py_speaks_to_the_emulated_supply(tmp_path, monkeypatch):
    """The bench file's resource is rehearsed on TCP; there PyVISA-py comes by a socket of its own."""
    monkeypatch.setenv("PYVISA_LIBRARY", "@py")
    with EmulatedLab(bench_file(tmp_path, BENCH_WITH_SUPPLY), Plant(), clock="wall") as lab:
        host, port = lab.ports["psu"].removeprefix("socket://").split(":")
        device = supply(f"TCPIP0::{host}::{port}::SOCKET")
        try:
            assert device.identify().model == "E36312A"
            device.prepare()
            device.switch(1, True)
            device.request_readings()
            assert device.read()["output_1_voltage_v"] == pytest.approx(5.0, abs=0.02)
            device.switch(1, False)
        finally:
            device.link.close()


@pytest.mark.parametrize("section", ["table", "chamber", "gyro"])
def test_what_is_no_instrument_has_no_visa_resource(tmp_path, section):
    port = {"table": "/dev/ttyUSB0", "chamber": "/dev/ttyUSB2", "gyro": "/dev/ttyUSB1"}[section]
    with pytest.raises(ConfigurationError, match="VISA serves supplies and loggers only"):
        bench_file(tmp_path, FOG_BENCH.replace(f'"{port}"', f'"{USB}"'))
