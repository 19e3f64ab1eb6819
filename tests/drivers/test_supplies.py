"""Power supplies: sessions of pymeasure's classes on the emulators, drivers and emulators in memory, records."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymeasure.adapters import ProtocolAdapter
from pymeasure.instruments.keysight import KeysightE36312A
from pymeasure.instruments.rohdeschwarz.hmp import HMP4040

from drivers import keysight_e36300, rs_hmp
from drivers.base.errors import DeviceRefused, DeviceSilent, ProtocolError, WrongDevice
from drivers.keysight_e36300 import E36300Config, E36300Supply
from drivers.kit.config import OutputConfig
from drivers.kit.scpi import flags, numbers, query_exchanges
from drivers.rs_hmp import HmpConfig, HmpSupply
from simulators.emulators import supplies
from simulators.faults import Fault
from simulators.interfaces import Installation
from simulators.plant.load import Load
from tests.memory_link import MemoryLink, OpenConnection, scripted

KINDS = {
    "e36300": (E36300Config, E36300Supply, supplies.e36300, keysight_e36300.decode_transcript),
    "hmp": (HmpConfig, HmpSupply, supplies.hmp, rs_hmp.decode_transcript),
}


def config_of(kind, *, safe="leave", voltage_v=5.0, current_limit_a=2.0):
    outputs = (
        OutputConfig(
            number=1, voltage_v=voltage_v, current_limit_a=current_limit_a, units=("fog",), safe=safe
        ),
        OutputConfig(number=3, voltage_v=12.0, current_limit_a=0.5, safe="leave"),
    )
    return KINDS[kind][0](name="psu", driver=kind, port="memory", outputs=outputs)


def made(kind, power_w=3.0, **options):
    _, driver, emulator, decode = KINDS[kind]
    switched = []
    load = Load([("fog", power_w)], lambda unit, on, time_s: switched.append((unit, on)))
    config = config_of(kind, **options)
    device = emulator(config, {1: load}, Installation())
    wire = MemoryLink(device, "psu")
    return SimpleNamespace(
        supply=driver(config, OpenConnection(wire)),
        wire=wire,
        device=device,
        switched=switched,
        decode=lambda: decode(wire.exchanges, config),
    )


@pytest.fixture(params=KINDS)
def bench(request):
    return made(request.param)


class Client(ProtocolAdapter):
    """pymeasure's end of a line to an emulator."""

    def __init__(self, device):
        super().__init__()
        self.device, self.answers = device, []

    def _write(self, command, **_):
        replies = self.device.receive(f"{command}\n".encode(), 1.0)
        self.answers += [reply.data.decode().rstrip("\n") for reply in replies]

    def _read(self, **_):
        return self.answers.pop(0)


def test_pymeasures_e36312a_works_on_the_emulator(bench):
    bench = made("e36300")
    client = KeysightE36312A(Client(bench.device))
    assert client.id.startswith("Keysight Technologies,E36312A,")
    client.ch_1.voltage_setpoint, client.ch_1.current_limit = 5.0, 1.0
    assert (client.ch_1.voltage_setpoint, client.ch_1.current_limit) == (5.0, 1.0)
    assert client.ch_1.output_enabled is False and client.ch_1.voltage == 0.0
    client.ch_1.output_enabled = True
    assert client.ch_1.output_enabled is True and bench.switched == [("fog", True)]
    assert (client.ch_1.voltage, client.ch_1.current) == (5.0, pytest.approx(0.6))
    client.ch_2.voltage_setpoint = 24.0
    assert client.ch_2.voltage_setpoint == 24.0 and client.ch_1.voltage_setpoint == 5.0
    assert client.check_errors() == []
    client.write("VOLT 26, (@2)")
    client.write("VOLTAGE:SOMETHING 1")
    assert [error[0] for error in client.check_errors()] == [-222, -113]


def test_pymeasures_hmp4040_works_on_the_emulator():
    bench = made("hmp")
    client = HMP4040(Client(bench.device))
    assert re.match("ROHDE&SCHWARZ,HMP4040,", client.id)
    client.selected_channel = 1
    client.voltage, client.current = 5, 1
    assert (client.voltage, client.current) == (5.0, 1.0)
    client.output_enabled = True
    assert bench.switched == [] and client.measured_voltage == 0.0  # the main switch alone gives no power
    client.set_channel_state(1, True)
    assert bench.switched == [("fog", True)]
    assert (client.measured_voltage, client.measured_current) == (5.0, 0.6)
    client.selected_channel = 2
    assert client.selected_channel == 2 and client.voltage == 0.0 and client.selected_channel_active is False
    assert client.check_errors() == []


def test_a_supply_is_set_up_switched_read_and_left(bench):
    supply = bench.supply
    identity = supply.identify()
    assert identity.model in ("E36312A", "HMP4040") and identity.serial_number
    assert bench.wire.sent == b"*IDN?\n"  # who it is, is only asked
    supply.prepare()
    assert bench.switched == [] and not supply.is_on(1) and not supply.is_on(3)
    supply.switch(1, True)
    assert supply.is_on(1) and not supply.is_on(3) and bench.switched == [("fog", True)]
    supply.request_readings()
    row = supply.read()
    assert row == {
        "output_1_voltage_v": 5.0,
        "output_1_current_a": pytest.approx(0.6),
        "output_3_voltage_v": 0.0,
        "output_3_current_a": 0.0,
    }
    assert supply.alarms() == []
    supply.halt()
    supply.make_safe()
    rest = supply.read_rest()
    assert rest.reached and rest.outputs == {"1": True, "3": False}  # left as it was
    supply.switch(1, False)
    assert bench.switched == [("fog", True), ("fog", False)]
    columns, counts = bench.decode()
    assert list(columns) == ["time_ns", *row] and counts["damaged"] == 0
    assert columns["output_1_voltage_v"][0] == 5.0 and np.all(np.diff(columns["time_ns"]) > 0)


@pytest.mark.parametrize("kind", KINDS)
def test_an_output_that_is_to_be_off_is_switched_off_when_the_bench_is_made_safe(kind):
    bench = made(kind, safe="off")
    bench.supply.prepare()
    for output in (1, 3):
        bench.supply.switch(output, True)
    assert not bench.supply.read_rest().reached
    bench.supply.make_safe()
    rest = bench.supply.read_rest()
    assert rest.reached and rest.outputs == {"1": False, "3": True}
    assert bench.switched[-1] == ("fog", False)


@pytest.mark.parametrize("kind", KINDS)
def test_an_output_that_is_on_with_another_setting_is_refused_and_not_touched(kind):
    bench = made(kind)
    bench.supply.prepare()
    bench.supply.switch(1, True)
    driver = KINDS[kind][1]
    other = driver(config_of(kind, voltage_v=6.0), OpenConnection(bench.wire))
    with pytest.raises(DeviceRefused, match=r"output 1 is on .*5 V, at most 2 A.*6 V, at most 2 A"):
        other.prepare()
    assert bench.device.outputs[1].voltage_v == 5.0 and bench.device.outputs[1].on


@pytest.mark.parametrize("kind", KINDS)
def test_a_unit_that_wants_more_than_the_limit_is_an_alarm(kind):
    bench = made(kind, power_w=12.0)  # 2.4 A at 5 V, the limit is 2 A
    bench.supply.prepare()
    bench.supply.switch(1, True)
    assert bench.switched == []  # it never starts
    (alarm,) = bench.supply.alarms()
    assert "output 1 holds its current limit: 2 A at 4.17 V instead of 5 V" in alarm


@pytest.mark.parametrize("kind", KINDS)
def test_trips_and_hands_at_the_panel_are_alarms(kind):
    bench = made(kind)
    bench.supply.prepare()
    bench.supply.switch(1, True)
    bench.device.faults["alarm"](Fault("psu", "alarm", at_s=(1.0,), count=1), 1.0)
    (alarm,) = bench.supply.alarms()
    assert alarm in ("output 1: overcurrent protection has tripped", "output 1: its fuse has tripped")
    assert bench.switched[-1] == ("fog", False)
    bench.device.outputs[1].tripped = ""
    assert bench.supply.alarms() == ["output 1 is off, and not by the bench"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_refused_setting_says_what_the_supply_said(kind):
    bench = made(kind, voltage_v=60.0)
    with pytest.raises(DeviceRefused, match="Data out of range"):
        bench.supply.prepare()


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_and_late_answers_are_asked_again(kind):
    bench = made(kind)
    bench.supply.prepare()
    answer, count = bench.wire.answer, iter(range(100))

    def damaged(data, now_s):
        replies = answer(data, now_s)
        return [(at_s, b"\x00?;\n") for at_s, _ in replies] if next(count) == 0 else replies

    bench.wire.answer = damaged
    bench.supply.request_readings()
    assert bench.supply.read()["output_1_voltage_v"] == 0.0
    assert bench.supply.is_on(1) is False


@pytest.mark.parametrize("kind", KINDS)
def test_another_device_is_not_taken_for_a_supply(kind):
    driver = KINDS[kind][1]
    others = (b"RIGOL TECHNOLOGIES,DP832,DP8B1,00.01.14\n", b"'*IDN?' is an unknown command.\r\n", b"HAMEG\n")
    for said in others:
        with pytest.raises(WrongDevice, match="model"):
            driver(config_of(kind), OpenConnection(scripted(said))).identify()
    with pytest.raises(DeviceSilent):
        driver(config_of(kind), OpenConnection(scripted())).identify()


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=6))
def test_numbers_are_read_as_they_were_written(values):
    assert numbers(",".join(f"{value:+.8E}" for value in values), len(values)) == pytest.approx(
        values, rel=1e-7
    )
    with pytest.raises(ProtocolError):
        numbers(",".join(map(str, values)), len(values) + 1)


def test_truth_values():
    assert flags("1,0, ON ,off,+1", 5) == [True, False, True, False, True]
    with pytest.raises(ProtocolError):
        flags("2", 1)


@given(st.lists(st.tuples(st.sampled_from(["sent", "received"]), st.binary(max_size=20)), max_size=12))
def test_no_bytes_break_the_decoding_of_a_record(exchanges):
    record = [(number, direction, data) for number, (direction, data) in enumerate(exchanges)]
    for kind, (_, _, _, decode) in KINDS.items():
        columns, _ = decode(record, config_of(kind))
        assert {len(column) for column in columns.values()} == {len(columns["time_ns"])}
    list(query_exchanges(record))
