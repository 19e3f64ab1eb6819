"""The chamber driver against scripted bytes and against the emulator, both in memory."""

import pytest

from drivers.base.errors import DeviceRefused, DeviceSilent, LimitExceeded, ProtocolError, WrongDevice
from drivers.kit.instruments import ChamberLimits, ChamberState, Rest
from drivers.weiss import Weiss, WeissConfig
from drivers.weiss._transcript import decode_transcript
from simulators.emulators.weiss import WeissEmulator
from tests.memory_link import ChamberPlant, MemoryLink, OpenConnection
from tests.memory_link import scripted as answers


def chamber_on(wire, auxiliary=(), safe_set_point_c=23.0, **keys):
    config = WeissConfig(driver="weiss", port="memory", auxiliary=dict.fromkeys(auxiliary, ""), **keys)
    return Weiss.open(config, OpenConnection(wire, safe_set_point_c))


def emulated(plant=None, emulator_options=None, **options):
    plant = plant or ChamberPlant()
    emulator = WeissEmulator(plant, auxiliary=(1, 2), **(emulator_options or {}))
    wire = MemoryLink(emulator)
    return chamber_on(wire, auxiliary=(2,), **options), wire, plant, emulator


def scripted(*replies, delay_s=0.02, **options):
    """Return a chamber that answers the n-th write with the n-th entry, whatever was asked."""
    wire = answers(*replies, delay_s=delay_s)
    return chamber_on(wire, **options), wire


def lines(wire):
    return wire.sent.replace(b"\xb6", b"|").split(b"\r")[:-1]


def test_state_is_sensors_and_air_with_the_set_point_every_tenth_time():
    first = (b"1\xb625.0\r\n", b"1\xb6-39.5\r\n", b"1\xb624.4812\r\n")
    later = (b"1\xb6-39.4\r\n", b"1\xb624.5\r\n")
    chamber, wire = scripted(*first, *(9 * later), *first, auxiliary=(3,))
    assert chamber.state() == ChamberState(24.4812, 25.0, {3: -39.5})
    assert lines(wire) == [b"11002|1|1", b"12002|1|3", b"11004|1|1"]
    assert [chamber.state() for _ in range(9)] == 9 * [ChamberState(24.5, 25.0, {3: -39.4})]
    assert lines(wire)[3:] == 9 * [b"12002|1|3", b"11004|1|1"]
    chamber.state()
    assert lines(wire)[21:] == [b"11002|1|1", b"12002|1|3", b"11004|1|1"]


def test_set_point_is_read_again_after_a_command():
    first = (b"1\xb625.0\r\n", b"1\xb624.0\r\n")
    chamber, _ = scripted(*first, b"1\r\n", b"1\r\n", b"1\r\n", b"1\xb6-40.0\r\n", b"1\xb623.9\r\n")
    chamber.state()
    chamber.set_temperature(-40.0, 12.0)
    assert chamber.state() == ChamberState(23.9, -40.0, {})


def test_commands_are_the_public_drivers():
    chamber, wire = scripted(b"1\r\n", b"1\r\n", b"1\r\n", b"1\r\n", b"1\xb61\r\n", b"1\xb63\r\n")
    chamber.set_temperature(50.0, 1.5)
    chamber.start()
    assert lines(wire) == [
        b"11068|1|1|1.5",
        b"11072|1|1|1.5",
        b"11001|1|1|50.0",
        b"14001|1|1|1",
        b"10012|1",
        b"10012|1",
    ]


def test_status_minus_four_is_a_refusal_in_words():
    with pytest.raises(DeviceRefused, match="test system not available"):
        scripted(b"-4\r\n")[0].state()


@pytest.mark.parametrize(
    "reply", [b"1\r\n", b"1\xb6warm\r\n", b"1\xb61.0\xb62.0\r\n", b"0024.5 0025.0 01\r\n"]
)
def test_replies_that_do_not_fit(reply):
    with pytest.raises(ProtocolError):
        scripted(reply)[0].state()


def test_start_on_the_wrong_channel_is_found_by_the_status():
    chamber, _, plant, _ = emulated(emulator_options={"start_channel": 2})
    with pytest.raises(DeviceRefused, match="start_channel"):
        chamber.start()
    chamber, _, plant, _ = emulated(emulator_options={"start_channel": 2}, start_channel=2)
    chamber.start()
    assert plant.demands[-1][3] is True


@pytest.mark.parametrize("simserv", [True, False])
def test_a_run_on_the_emulated_chamber(simserv):
    chamber, _, plant, _ = emulated(simserv=simserv)
    identity = chamber.identify()
    assert identity.details["read values"] == "CV01 CV01 MV01 MV02"
    assert chamber.limits() == ChamberLimits(-72.0, 182.0)
    chamber.set_temperature(-40.0)
    assert plant.demands[-1] == (-40.0, 0.0, 0.0, False)
    chamber.start()
    assert plant.demands[-1][3] is True
    chamber.set_temperature(60.0, 2.5)
    assert plant.demands[-1] == ((60.0, 2.5, 2.5, True) if simserv else (60.0, 2.5, 0.0, True))
    state = chamber.state()
    assert (state.air_temp_c, state.set_point_c) == (60.0, 60.0)
    assert state.auxiliary_c == {2: 20.1234 if simserv else 20.1}
    chamber.stop()
    assert plant.demands[-1][0] == 60.0 and plant.demands[-1][3] is False
    assert chamber.alarms() == []


def test_identity_of_the_emulated_chamber():
    identity = emulated()[0].identify()
    assert (identity.model, identity.serial_number, identity.details["year"]) == (
        "VT3 7060",
        "64636625",
        "19",
    )


@pytest.mark.parametrize("simserv", [True, False])
@pytest.mark.parametrize("answer", [b"SYNTAX ERROR\r\n", b"?", b"'x' is an unknown command.\r"])
def test_another_device_is_named_with_what_was_seen(simserv, answer):
    chamber, wire = scripted(simserv=simserv)
    wire.answer = lambda data, now_s: [(now_s, answer)]
    with pytest.raises(WrongDevice) as caught:
        chamber.identify()
    assert caught.value.found


def test_nothing_on_the_port_is_silence():
    with pytest.raises(DeviceSilent):
        scripted()[0].identify()


@pytest.mark.parametrize("simserv", [True, False])
def test_a_set_point_outside_the_limits_is_refused(simserv):
    chamber, _, plant, _ = emulated(simserv=simserv)
    with pytest.raises(DeviceRefused):
        chamber.set_temperature(182.5)
    assert plant.set_point == 23.0


@pytest.mark.parametrize(
    ("set_point", "ramp"), [(float("nan"), None), (20.0, 0.0), (20.0, -1.0), (20.0, 1e-5)]
)
def test_demands_that_make_no_sense(set_point, ramp):
    with pytest.raises(LimitExceeded):
        emulated()[0].set_temperature(set_point, ramp)


def test_a_ramp_that_ascii2_would_round_to_no_limit():
    with pytest.raises(LimitExceeded, match=r"ramp of 0\.1 \.\. 9999\.9 K/min"):
        emulated(simserv=False)[0].set_temperature(20.0, 0.04)


def test_ascii2_keeps_what_it_does_not_set():
    """A climate chamber with humidity: only CV01, the start bit and nothing else may change."""
    configuration = (
        b"$01E CV01 CV02 SV01 MV01 MV02 DO00 DO01 DO02 DO03 <CR>\r\nDescription:\r\n"
        b"CV01  value min:  -72.0   value max:  182.0   Temperature\r\n"
        b"DO00  unused\r\nDO01  Start\r\nDO02  Humidity\r\n"
        b"$01I<CR>\r\nCV01 CV01 CV02 CV02 SV01 MV01 MV01 MV02 DO00 DO01 DO02 DO03 <CR>\r\n"
    )
    values = b"0050.0 0024.6 0080.0 0066.7 0090.0 0007.0 0023.8 0022.2 0010" + 28 * b"0" + b"\r"
    running = values.replace(b"0010", b"0110", 1)

    def answer(data, now_s):
        if data == b"$01?\r":
            return [(now_s, configuration)]
        if data == b"$01I\r":
            return [(now_s, running if b"$01E" in wire.sent else values)]
        return [(now_s, b"0\r")]

    wire = MemoryLink(answer)
    chamber_on(wire, simserv=False).start()
    assert b"$01E 0050.0 0080.0 0090.0 0007.0 0000.0 0110\r" in wire.sent


def test_ascii2_reply_with_another_field_count_than_configured():
    chamber, wire, _, _ = emulated(simserv=False)
    chamber.identify()
    wire.answer = lambda data, now_s: [(now_s, b"0025.0 0024.5 01000000000000000000000000000000\r")]
    with pytest.raises(ProtocolError, match="configuration"):
        chamber.state()


def test_alarms_in_words_cost_one_exchange_while_there_are_none():
    chamber, wire, plant, emulator = emulated()
    chamber.start()
    wire.sent = b""
    assert chamber.alarms() == [] and lines(wire) == [b"10012|1"]
    emulator.raise_alarm("Temperature limiter", wire.clock.now())
    assert chamber.alarms() == ["alarm: Temperature limiter"]
    assert plant.demands[-1][3] is False
    with pytest.raises(DeviceRefused, match="Temperature limiter"):
        chamber.start()


@pytest.mark.parametrize("simserv", [True, False])
def test_make_safe_after_a_command_cut_in_half(simserv):
    chamber, wire, plant, _ = emulated(simserv=simserv, safe_set_point_c=25.0)
    chamber.set_temperature(-55.0, 3.0)
    chamber.start()
    wire.write(b"11001\xb61\xb61\xb6-6")
    chamber.make_safe()
    assert plant.demands[-1] == (25.0, 0.0, 0.0, False)
    wire.clock.sleep(0.2)  # answers to what was cut pass by
    assert chamber.read_rest() == Rest(True, running=False, set_point_c=25.0)
    chamber.start()
    assert chamber.read_rest() == Rest(False, running=True, set_point_c=25.0)
    chamber.stop()
    chamber.set_temperature(24.0)
    assert chamber.read_rest() == Rest(False, running=False, set_point_c=24.0)


SAFE = [b"", b"14001|1|1|0", b"11001|1|1|23.0", b"11068|1|1|0", b"11072|1|1|0"]


def test_make_safe_passes_over_a_late_answer_and_sends_the_rest_after_a_refusal():
    chamber, wire = scripted(b"", b"-5\r\n1\xb624.4812\r\n1\r\n", b"1\r\n", b"-6\r\n", b"1\r\n")
    with pytest.raises(DeviceRefused, match="11068"):
        chamber.make_safe()
    assert lines(wire) == SAFE


def test_halt_sends_stop_and_set_point_at_once_and_make_safe_does_not_repeat_them():
    chamber, wire = scripted(b"", b"-5\r\n1\r\n", b"1\r\n", b"1\r\n", b"1\r\n")
    chamber.halt()
    assert lines(wire) == SAFE[:3] and wire.clock.now() == 0.0
    chamber.make_safe()
    assert lines(wire) == SAFE
    chamber.halt()
    assert lines(wire)[-1] == SAFE[2]


def test_a_controller_that_takes_one_line_at_a_time_is_told_again():
    chamber, wire = scripted(b"", b"1\r\n", b"", b"1\r\n", b"1\r\n", b"1\r\n")
    chamber.make_safe()
    assert lines(wire) == [*SAFE[:3], *SAFE[2:]]


def test_an_unread_state_does_not_shift_later_answers():
    chamber, _, plant, _ = emulated()
    plant.air = -12.5
    chamber.request_state()
    assert chamber.limits() == ChamberLimits(-72.0, 182.0)
    chamber.request_state()
    assert chamber.read_state().air_temp_c == -12.5


@pytest.mark.parametrize("simserv", [True, False])
def test_recorded_bytes_give_the_polled_states_again(simserv):
    chamber, wire, plant, _ = emulated(simserv=simserv)
    chamber.identify()
    states = []
    for step in range(7):
        plant.air = -40.0 + 7.77777 * step
        states.append(chamber.state())
        if step == 3:
            chamber.alarms() if simserv else chamber.limits()
        wire.clock.sleep(1.0)
    columns, counts = decode_transcript(wire.exchanges)
    assert columns["air_temp_c"].tolist() == [state.air_temp_c for state in states]
    assert columns["set_point_c"].tolist() == [state.set_point_c for state in states]
    assert columns["aux_2_temp_c"].tolist() == [state.auxiliary_c[2] for state in states]
    assert counts == {"polls": 7, "damaged": 0}
