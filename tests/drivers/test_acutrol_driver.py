"""The table driver against scripted bytes and against the emulator, both in memory."""

import math
import struct

import numpy as np
import pytest

from drivers.acutrol import decode_transcript
from drivers.acutrol._driver import AcutrolTable
from drivers.base.errors import DeviceRefused, DeviceSilent, ProtocolError, WrongDevice
from drivers.kit.config import TableConfig
from drivers.kit.instruments import Rest, TableLimits, TableState
from simulators.emulators.acutrol import AcutrolAxis, AcutrolEmulator
from tests.memory_link import MemoryLink, OpenConnection
from tests.memory_link import scripted as answers


class Plant:
    """A table that goes where it is told at once."""

    max_rate_dps = 1000.0
    max_acceleration_dps2 = 4200.0

    def __init__(self):
        self.on = False
        self.angle = self.rate = 0.0
        self.profile_complete = True

    def servo(self, now_s, on):
        self.on = on
        self.rate = 0.0

    def demand_rate(self, now_s, rate_dps, acceleration_limit_dps2=math.inf):
        assert self.on
        self.rate = rate_dps

    def demand_angle(self, now_s, angle_deg, rate_limit_dps, acceleration_limit_dps2=math.inf):
        assert self.on
        self.rate_limit = rate_limit_dps
        self.angle = angle_deg % 360.0

    def angle_deg(self, now_s):
        return self.angle

    def rate_dps(self, now_s):
        return self.rate

    def acceleration_dps2(self, now_s):
        return 0.0

    def settled(self, now_s):
        return self.profile_complete


def frame(text, error=0, order="<"):
    return struct.pack(order + "II", error, len(text)) + text.encode()


TABLE = TableConfig(driver="acutrol3000", port="memory")


def table_on(wire):
    return AcutrolTable(TABLE, OpenConnection(wire))


def scripted(*replies, delay_s=0.01):
    """Return a table that answers the n-th write with the n-th entry, whatever was asked."""
    wire = answers(*replies, delay_s=delay_s)
    return table_on(wire), wire


@pytest.fixture
def bench():
    plant = Plant()
    emulator = AcutrolEmulator(plant)
    wire = MemoryLink(emulator)
    return table_on(wire), wire, plant, emulator


def test_identify_the_manuals_example():
    table, wire = scripted(frame("Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a\r\n"))
    identity = table.identify()
    assert wire.sent == b"*IDN?\r\n"
    assert (identity.maker, identity.model, identity.serial_number, identity.firmware) == (
        "Acutronic R&D USA",
        "Acutrol3000",
        "0",
        "A8800-001-01.000-a",
    )


@pytest.mark.parametrize(
    "answer", [b"'*IDN?' is an unknown command.\r", b"?\r\n", frame("A,B"), frame("A,B,C,D")]
)
def test_another_device_is_named_with_what_was_seen(answer):
    table, _ = scripted(answer)
    with pytest.raises(WrongDevice) as caught:
        table.identify()
    assert caught.value.found.strip()


def test_nothing_on_the_port_is_silence():
    with pytest.raises(DeviceSilent):
        scripted()[0].identify()


@pytest.mark.parametrize("order", ["<", ">"])
def test_state_is_one_joined_query(order):
    table, wire = scripted(frame("135.223;-0.0041781\r\n", order=order))
    assert table.state() == TableState(135.223, -0.0041781)
    assert wire.sent == b":read:pos? 1;rate? 1\r\n"


def test_refusal_carries_the_devices_text_and_its_error_queue():
    table, wire = scripted(frame("", 215), frame("215: XML Path Not Found"))
    with pytest.raises(DeviceRefused) as caught:
        table._command(":interlock:open", "1")
    assert wire.sent == b":interlock:open 1\r\n:Status:MSG? QERROR\r\n"
    assert "XML Path Not Found" in str(caught.value) and "215" in str(caught.value)


@pytest.mark.parametrize("text", ["", "1.0", "1.0;2.0;3.0", "OK"])
def test_state_that_is_no_state(text):
    with pytest.raises(ProtocolError, match="2 numbers"):
        scripted(frame(text))[0].state()


def test_a_late_reply_is_dropped_before_the_next_question():
    table, wire = scripted(frame("1.0;2.0"), frame("3.0;4.0"), delay_s=3.0)
    with pytest.raises(DeviceSilent):
        table.state()
    wire.clock.sleep(5.0)
    with pytest.raises(DeviceSilent):
        table.state()
    wire.clock.sleep(5.0)
    wire.answer = lambda data, now_s: [(now_s, frame("5.0;6.0"))]
    assert table.state() == TableState(5.0, 6.0)


def test_make_safe_passes_over_older_replies():
    table, wire = scripted()
    wire.pending = [(0.01, frame("12.0;0.5")), (0.02, frame("Undefined Header", 101)), (0.03, frame("OK"))]
    table.make_safe()
    assert wire.sent == b"\r:mode:off 1\r\n"


def test_halt_sends_off_mode_at_once_and_make_safe_does_not_repeat_it():
    table, wire = scripted()
    table.halt()
    assert wire.sent == b"\r:mode:off 1\r\n" and wire.clock.now() == 0.0
    wire.pending = [(0.01, frame("Undefined Header", 101)), (0.02, frame("OK"))]
    table.make_safe()
    table.halt()
    assert wire.sent == 2 * b"\r:mode:off 1\r\n"


def test_make_safe_opens_the_interlock_if_off_mode_is_not_confirmed():
    table, wire = scripted(b"", frame("no", 7), frame("OK"))
    table.make_safe()
    assert wire.sent == b"\r:mode:off 1\r\n:interlock:open 1\r\n"
    with pytest.raises(DeviceSilent):
        scripted()[0].make_safe()


def test_turns_are_limited_by_the_controller_itself(bench):
    table, wire, plant, _ = bench
    table.limit_turns(20.0)
    assert wire.sent == b":limit:rate position,1,20.000000\r\n"
    assert table.limits().max_rate_dps == 1000.0
    table.servo_on()
    table.point(-90.0)
    assert plant.rate_limit == 20.0


def test_servo_point_spin_on_the_emulated_table(bench):
    table, _, plant, _ = bench
    table.servo_on()
    assert plant.on
    table.spin(-123.456)
    assert table.state() == TableState(0.0, -123.456)
    table.point(370.25)
    assert table.state().angle_deg == 10.25
    assert table.alarms() == []
    table._command(":interlock:open", "1")
    assert not plant.on and table.alarms() != []


def test_closing_the_interlock_never_runs_an_old_demand(bench):
    table, _, plant, _ = bench
    table.servo_on()
    table.spin(100.0)
    table._command(":interlock:open", "1")
    table.servo_on()
    assert plant.rate == 0.0


def test_limits_of_the_emulated_table(bench):
    assert bench[0].limits() == TableLimits(1000.0, 4200.0, None, None)
    emulator = AcutrolEmulator({1: AcutrolAxis(Plant(), -90.0, 95.5)})
    wire = MemoryLink(emulator)
    assert table_on(wire).limits() == TableLimits(1000.0, 4200.0, -90.0, 95.5)


def test_a_demand_beyond_the_limit_is_refused(bench):
    table, _, plant, _ = bench
    table.servo_on()
    with pytest.raises(DeviceRefused, match="Parameter Out Of Range"):
        table.spin(1000.1)
    assert plant.rate == 0.0
    with pytest.raises(DeviceRefused):
        table.spin(float("nan"))


def test_trip_is_told_in_words_and_cleared_by_servo_on(bench):
    table, _, plant, emulator = bench
    table.servo_on()
    table.spin(50.0)
    emulator.trip("rate trip", 10.0)
    assert not plant.on
    assert table.alarms() == ["interlock fault", "software abort", "rate trip"]
    table.servo_on()
    assert table.alarms() == []
    emulator.trip("master interlock", 20.0)
    assert table.alarms() == ["interlock fault", "hardware abort", "master interlock"]


def test_a_failed_self_test_comes_with_what_the_diagnostics_say(bench):
    table, _, _, emulator = bench
    table.servo_on()
    emulator.trip("+12 V fault", 10.0)
    assert table.alarms() == ["interlock fault", "software abort", "self-test failure", "+12 V fault"]
    table.servo_on()
    assert table.alarms() == []


def test_axis_errors_explain_a_fault_and_are_none_of_their_own():
    words = {"1": "Fault", "A1STATE": 1 << 6, "A1SWFLT": 1 << 2, "A1INTLK": 0, "A1ERR": 1 << 5}

    def answer(data, now_s):
        name = data.decode().split()[-1]  # the axis of :interlock?, or a register
        error = 0 if name in words else 104
        return [(now_s, frame(str(words.get(name, "no such register")), error))]

    table = table_on(MemoryLink(answer))
    assert table.alarms() == [
        "interlock fault",
        "software abort",
        "position tracking error",
        "drive not enabled",
    ]
    words |= {"1": "Close", "A1STATE": 1 << 4, "A1SWFLT": 0}
    assert table.alarms() == []


def test_interlock_opened_by_someone_else_is_an_alarm(bench):
    table, wire, _, emulator = bench
    table.servo_on()
    emulator.receive(b":interlock:open 1\r", wire.clock.now())
    assert "opened by someone else" in table.alarms()[0]


def test_an_interlock_that_does_not_close_is_refused():
    def answer(data, now_s):
        return [
            (now_s, frame("Open" if data.startswith(b":interlock?") else "OK" if b"csr" not in data else "0"))
        ]

    with pytest.raises(DeviceRefused, match="does not close"):
        table_on(MemoryLink(answer)).servo_on()


def test_make_safe_after_a_command_cut_in_half(bench):
    table, wire, plant, _ = bench
    table.servo_on()
    table.spin(300.0)
    wire.write(b":demand:rate 1,40")
    table.make_safe()
    assert plant.on and plant.rate == 0.0
    wire.clock.sleep(0.2)  # answers to what was cut pass by
    assert table.read_rest() == Rest(True, {table.axes[-1]: 0.0})
    plant.rate = -0.5
    assert table.read_rest() == Rest(False, {table.axes[-1]: -0.5})


def test_an_unread_state_does_not_shift_later_answers(bench):
    table, _, plant, _ = bench
    table.servo_on()
    plant.angle = 33.0
    table.request_state()
    assert table.limits().max_rate_dps == 1000.0
    table.request_state()
    plant.angle = 44.0
    assert table.read_state().angle_deg == 33.0


def test_recorded_bytes_give_the_polled_states_again(bench):
    table, wire, _, _ = bench
    table.identify()
    table.servo_on()
    expected = []
    for rate in np.linspace(-400.0, 400.0, 9):
        table.spin(float(rate))
        expected.append(table.state().rate_dps)
        wire.clock.sleep(0.1)
    columns, counts = decode_transcript(wire.exchanges, TABLE)
    assert columns["rate_dps"].tolist() == expected
    assert counts == {"polls": 9, "damaged": 0}
    assert np.all(np.diff(columns["time_ns"]) > 100_000_000)
