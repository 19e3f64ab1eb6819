"""Watlow chambers: registers against documented bytes, driver and emulator in memory, records decoded again."""

import re

import numpy as np
import pytest

from drivers.base.errors import DeviceRefused, DeviceSilent, LimitExceeded, WrongDevice
from drivers.kit.instruments import ChamberCapabilities, ChamberLimits, ChamberState, Rest
from drivers.kit.modbus import ModbusMaster
from drivers.watlow._driver import F4Chamber, F4Config, F4TChamber, F4TConfig
from drivers.watlow._transcript import decode_f4, decode_f4t
from drivers.watlow.registers import scaled, unscaled
from simulators.emulators.watlow import F4Emulator, F4TEmulator
from simulators.faults import Fault
from tests.memory_link import ChamberPlant, MemoryLink, OpenConnection


def f4(auxiliary=(2,), start_output=1, emulator=None, **options):
    plant = ChamberPlant()
    device = emulator or F4Emulator(plant, start_output=start_output, **options)
    wire = MemoryLink(device)
    config = F4Config(
        driver="watlow_f4",
        port="memory",
        start_channel=start_output,
        auxiliary=dict.fromkeys(auxiliary, ""),
    )
    return F4Chamber(config, OpenConnection(wire)), wire, plant, device


def f4t(framing="tcp"):
    plant = ChamberPlant()
    device = F4TEmulator(plant, framing=framing)
    wire = MemoryLink(device)
    config = F4TConfig(driver="watlow_f4t", port="socket://memory" if framing == "tcp" else "memory")
    return F4TChamber(config, OpenConnection(wire)), wire, plant, device


BOTH = pytest.mark.parametrize("make", [f4, f4t], ids=["f4", "f4t"])


def test_numbers_are_scaled_by_the_controllers_own_decimal_places():
    # 25.0 degC at one place is 00 FA, on the captured frame
    assert scaled(0x00FA, 1) == 25.0
    assert unscaled(25.0, 1) == 0x00FA
    assert scaled(0xFE0C, 1) == -50.0
    assert unscaled(-50.0, 1) == 0xFE0C
    assert scaled(0x00FA, 2) == 2.5


def test_the_f4_is_told_what_the_manual_says():
    chamber, wire, plant, _ = f4()
    chamber.identify()
    sent = len(wire.sent)
    chamber.set_temperature(25.0, 3.0)
    frames = wire.sent[sent:]
    # rate 3.0 per minute, unit minutes, ramp on a change of the set point, then the set point 25.0
    assert frames[:8] == bytes.fromhex("01 06 04 4D 00 1E 98 E5")
    assert frames[8:14] == bytes.fromhex("01 06 04 4E 00 00")
    assert frames[16:24] == bytes.fromhex("01 06 04 4C 00 02 C8 EC")
    assert frames[24:] == bytes.fromhex("01 06 01 2C 00 FA C9 BC")
    assert plant.demands[-1] == (25.0, 3.0, 3.0, False)


def test_the_f4t_is_told_what_the_manuals_say():
    chamber, wire, plant, _ = f4t("rtu")
    chamber.identify()
    sent = len(wire.sent)
    chamber.set_temperature(25.0)
    frames = wire.sent[sent:]
    assert frames[:6] == bytes.fromhex("01 06 0A EA 00 3E")  # ramp action (2794) off (62)
    assert frames[8:] == bytes.fromhex("01 10 0A DE 00 02 04 00 00 41 C8 30 19")
    chamber.set_temperature(-40.0, 2.5)
    assert plant.demands[-1] == (-40.0, 2.5, 2.5, False)


@BOTH
def test_a_day_of_a_chamber(make):
    chamber, _, plant, _ = make()
    identity = chamber.identify()
    assert identity.maker == "Watlow"
    assert chamber.limits() == ChamberLimits(-73.0, 190.0)
    chamber.set_temperature(-45.0, 10.0)
    chamber.start()
    assert plant.demands[-1] == (-45.0, 10.0, 10.0, True)
    assert chamber.state().air_temp_c == -45.0
    chamber.set_temperature(60.0)
    assert plant.demands[-1] == (60.0, 0.0, 0.0, True)
    assert chamber.alarms() == []
    chamber.halt()
    chamber.make_safe()
    assert plant.demands[-1] == (23.0, 0.0, 0.0, False)
    assert chamber.read_rest() == Rest(True, running=False, set_point_c=23.0)


def test_telemetry_has_the_resolution_that_is_declared():
    chamber, _, plant, _ = f4()
    chamber.identify()
    plant.air = -45.678
    assert chamber.state() == ChamberState(-45.7, 23.0, {2: 20.1})
    assert chamber.capabilities() == ChamberCapabilities(0.1, (0.1, 3276.7), (2, 3))
    chamber, _, plant, _ = f4t()
    plant.air = -45.678
    assert chamber.state().air_temp_c == pytest.approx(-45.678, abs=4e-6)  # float32
    assert chamber.capabilities().auxiliary == ()


@BOTH
@pytest.mark.parametrize(("set_point", "ramp"), [(float("nan"), None), (20.0, 0.0), (20.0, -1.0)])
def test_demands_that_make_no_sense_never_reach_the_line(make, set_point, ramp):
    chamber, wire, _, _ = make()
    with pytest.raises(LimitExceeded):
        chamber.set_temperature(set_point, ramp)
    assert wire.sent == b""


@BOTH
def test_a_set_point_out_of_range_is_refused_in_the_controllers_words(make):
    chamber, _, plant, _ = make()
    with pytest.raises(DeviceRefused, match="illegal data value") as refusal:
        chamber.set_temperature(500.0)
    assert plant.set_point == 23.0
    assert re.search(r"refuses to write its set point \(register (300|2782)\)", str(refusal.value))


@BOTH
def test_every_register_that_is_used_has_a_name(make, monkeypatch):
    used = set()

    def send(master, message, sends=ModbusMaster._send):
        used.add(message.address)
        sends(master, message)

    monkeypatch.setattr(ModbusMaster, "_send", send)
    chamber, _, _, _ = make()
    chamber.identify()
    chamber.limits()
    chamber.set_temperature(20.0, 1.0)
    chamber.start()
    chamber.state()
    chamber.alarms()
    chamber.halt()
    chamber.make_safe()
    assert len(used) > 10 and used <= set(chamber._modbus._words)


@BOTH
def test_faults_of_the_device(make):
    chamber, _, plant, device = make()
    chamber.identify()
    chamber.set_temperature(0.0)
    chamber.start()
    device.faults["refuse"](Fault("chamber", "refuse", at_s=(1.0,)), 1.0)
    with pytest.raises(DeviceRefused, match="device busy"):
        chamber.set_temperature(1.0)
    device.faults["alarm"](Fault("chamber", "alarm", at_s=(2.0,)), 2.0)
    assert chamber.alarms() == ["alarm 1: high"]
    assert plant.demands[-1][3] is False


def test_another_output_can_start_the_chamber():
    chamber, wire, plant, _ = f4(start_output=3)
    chamber.start()
    assert bytes.fromhex("01 06 07 E4 00 01") in wire.sent  # register 2020
    assert plant.demands[-1][3] is True


def test_what_is_no_f4_is_named_so():
    for emulator in (F4TEmulator(ChamberPlant(), framing="rtu"),):
        chamber, *_ = f4(emulator=emulator)
        with pytest.raises(WrongDevice, match="not a Watlow F4 "):
            chamber.identify()
    chamber, *_ = f4()
    chamber._modbus._device = 2
    with pytest.raises(DeviceSilent, match="Modbus address"):
        chamber.identify()


def test_a_fahrenheit_controller_is_refused_before_anything_moves():
    class Fahrenheit(F4Emulator):
        def read(self, register, now_s):
            return 0 if register == 901 else super().read(register, now_s)

    chamber, *_ = f4(emulator=Fahrenheit(ChamberPlant()))
    with pytest.raises(WrongDevice, match="degrees Celsius"):
        chamber.identify()


@pytest.mark.parametrize(("framing", "register"), [("tcp", 6730), ("rtu", 14080)])
def test_the_unit_of_an_f4t_is_that_of_the_modbus_channel_it_is_spoken_to_by(framing, register):
    # as delivered: 30, Fahrenheit; TestEquity's F4T manual, page 14: each channel has its own unit
    chamber, wire, plant, device = f4t(framing)
    device._words |= {6730: 30, 14080: 30, register: 15}
    chamber.identify()
    device._words |= {6730: 15, 14080: 15, register: 30}
    sent = len(wire.sent)
    with pytest.raises(WrongDevice, match="degrees Celsius") as refusal:
        chamber.identify()
    assert f"register {register} = 30 (degrees Fahrenheit)" in str(refusal.value)
    assert "Display Units" in str(refusal.value)
    functions = wire.sent[sent + 1 :: 8] if framing == "rtu" else wire.sent[sent + 7 :: 12]
    assert set(functions) == {3} and plant.demands == []


def raw(frame, device):
    body = bytes.fromhex(frame)
    return [reply.data.hex(" ") for reply in device.receive(body + crc(body), 1.0)]


def crc(body):
    value = 0xFFFF
    for byte in body:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value.to_bytes(2, "little")


def test_input_registers_are_answered_with_their_own_function():
    # minimalmodbus' functioncode=4, ChamberConnectLibrary's read_input
    plant = ChamberPlant()
    plant.air = 25.0
    assert raw("01 04 00 64 00 01", F4Emulator(plant)) == ["01 04 02 00 fa 39 73"]
    assert raw("01 03 00 64 00 01", F4Emulator(plant)) == ["01 03 02 00 fa 38 07"]


@pytest.mark.parametrize("model", [F4Emulator, F4TEmulator])
@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("01 03 00 64 00 7E", "01 83 03"),  # 126 registers: Modbus V1.1b3, 6.3: 1 to 125
        ("01 04 00 64 00 7E", "01 84 03"),
        ("01 03 00 64 00 00", "01 83 03"),
        ("01 03 7F 00 00 7D", "01 83 02"),
        ("01 01 00 00 00 01", "01 81 01"),
        ("01 2B 0E 01 00", "01 AB 01"),
    ],
)
def test_requests_that_cannot_be_met_get_the_exception_of_the_standard(model, request_, answer):
    body = bytes.fromhex(answer)
    framing = {} if model is F4Emulator else {"framing": "rtu"}
    assert raw(request_, model(ChamberPlant(), **framing)) == [(body + crc(body)).hex(" ")]


def test_an_f4_has_what_the_makers_library_asks_for():
    """get_status, const_start and stop of ChamberConnectLibrary's WatlowF4 with cond_event=1."""
    plant = ChamberPlant()
    device = F4Emulator(plant)
    assert raw("01 03 00 C8 00 01", device)[0].startswith("01 03 02 00 01")  # mode: constant
    assert raw("01 06 04 C1 00 01", device) == ["01 06 04 c1 00 01 18 c6"]  # terminate profile
    assert raw("01 06 07 D0 00 01", device)[0].startswith("01 06 07 d0 00 01") and plant.demands[-1][3]
    assert raw("01 06 04 C1 00 01", device) and plant.demands[-1][3]


def test_an_f4t_has_what_the_makers_library_asks_for():
    """get_status, const_start and stop of ChamberConnectLibrary's WatlowF4T."""
    plant = ChamberPlant()
    device = F4TEmulator(plant, framing="rtu")
    status = [raw(f"01 03 {register:04X} 0001", device) for register in (16568, 11490, 11504, 11528)]
    assert all(answer[0].startswith("01 03 02") for answer in status)
    assert raw("01 03 83 B6 00 01", device)[0].startswith("01 03 02 00 3e")  # output 1 of module 1: off
    assert raw("01 06 1A C2 05 B1", device)[0].startswith("01 06 1a c2 05 b1")  # key 1 is pressed
    assert plant.demands[-1][3]
    assert raw("01 03 83 B6 00 01", device)[0].startswith("01 03 02 00 3f")
    assert raw("01 06 40 B6 00 94", device)[0].startswith("01 06 40 b6 00 94")  # terminate
    raw("01 06 1A C2 05 B1", device)
    assert not plant.demands[-1][3]


def test_a_stop_that_is_lost_is_told_again():
    chamber, _, plant, _ = f4()
    chamber.identify()
    chamber.start()
    chamber.request_state()
    chamber.halt()  # the emulator answers both; the first answer is taken for the stop's
    chamber.make_safe()
    assert plant.demands[-1] == (23.0, 0.0, 0.0, False)


@pytest.mark.parametrize(
    ("make", "decode", "others"), [(f4, decode_f4, {"aux_2_temp_c"}), (f4t, decode_f4t, set())]
)
def test_the_record_gives_the_telemetry_that_the_run_saw(make, decode, others):
    chamber, wire, _, _ = make()
    chamber.identify()
    chamber.start()
    seen = []
    for set_point in (0.0, -12.3, 40.0):
        chamber.set_temperature(set_point)
        wire.clock.sleep(1.0)
        seen.append(chamber.state())
    columns, counts = decode(iter(wire.exchanges))
    assert counts == {"polls": 3, "damaged": 0}
    assert set(columns) == {"time_ns", "air_temp_c", "set_point_c"} | others
    np.testing.assert_array_equal(columns["air_temp_c"], [state.air_temp_c for state in seen])
    np.testing.assert_array_equal(columns["set_point_c"], [state.set_point_c for state in seen])
    cut = [
        (at, direction, data[:-1] if direction == "received" and index == len(wire.exchanges) - 1 else data)
        for index, (at, direction, data) in enumerate(wire.exchanges)
    ]
    columns, counts = decode(iter(cut))
    assert counts == {"polls": 3, "damaged": 1} and len(columns["time_ns"]) == 2
