"""The emulated Weiss chamber against strings from protocol texts and public drivers."""

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.weiss.configuration import decode_configuration
from simulators.emulators.weiss import WeissEmulator


class Plant:
    def __init__(self):
        self.demands = []
        self.set_point = 23.0

    def demand(self, now_s, **demand):
        self.set_point = demand["set_point_c"]
        self.demands.append((now_s, *demand.values()))

    def air_temp_c(self, now_s):
        return 24.48123

    def set_point_c(self, now_s):
        return self.set_point

    def auxiliary_c(self, number, now_s):
        return -38.25 - number


@pytest.fixture
def plant():
    return Plant()


@pytest.fixture
def chamber(plant):
    return WeissEmulator(plant, auxiliary=(1, 2))


def ask(chamber, request, now_s=1.0):
    """Return the one reply to a request written with ¶ for byte B6."""
    (reply,) = chamber.receive(request.encode("latin-1") + b"\r", now_s)
    return reply.data.decode("latin-1")


@pytest.mark.parametrize(
    ("request_text", "reply"),
    [
        ("11004¶1¶1", "1¶24.4812\r\n"),
        ("12002¶1¶2", "1¶-40.2500\r\n"),
        ("11001¶1¶1¶50.0", "1\r\n"),
        ("14001¶1¶1¶1", "1\r\n"),
        ("10012¶1", "1¶1\r\n"),
        ("11018¶1", "1¶1\r\n"),
        ("11007¶1¶1", "1¶-72.0\r\n"),
        ("11009¶1¶1", "1¶182.0\r\n"),
        ("14010¶1¶1", "1¶Start\r\n"),
        ("17002¶1", "1¶0\r\n"),
        ("99997¶1¶3", "1¶64636625\r\n"),
    ],
)
def test_simserv_pairs(chamber, request_text, reply):
    assert ask(chamber, request_text) == reply


@pytest.mark.parametrize(
    ("request_text", "status"),
    [
        ("12345¶1", "-5"),
        ("99999999999999999999¶1", "-5"),
        ("11004", "-6"),
        ("11004¶1", "-6"),
        ("11001¶1¶1", "-6"),
        ("11001¶1¶1¶warm", "-6"),
        ("11001¶1¶1¶182.1", "-6"),
        ("11001¶1¶1¶nan", "-6"),
        ("11068¶1¶1¶-1", "-6"),
        ("14001¶1¶1¶2", "-6"),
        ("14001¶1¶99¶1", "-6"),
        ("11004¶2¶1", "-4"),
        ("11004¶1¶2", "-8"),
        ("12002¶1¶3", "-8"),
        ("17007¶1¶1", "-8"),
    ],
)
def test_simserv_refusals(chamber, plant, request_text, status):
    assert ask(chamber, request_text) == f"{status}\r\n"
    assert plant.demands == []


def test_basils_weiss_labevent_is_served(chamber):
    """Its get_status sends a chamber and one argument more than the command has."""
    for request, reply in [
        ("99997¶1¶1", "1¶VT3 7060"),
        ("10012¶1¶1", "1¶1"),
        ("14001¶1¶1¶1", "1"),
        ("10012¶1¶1", "1¶3"),
        ("14001¶1¶1¶0", "1"),
        ("11004¶1¶1", "1¶24.4812"),
        ("14010¶1¶1", "1¶Start"),
        ("14003¶1¶2", "1¶0"),
    ]:
        assert ask(chamber, request) == reply + "\r\n"


def test_a_set_point_told_to_a_stopped_chamber_is_kept_from_then_on(chamber, plant):
    plant.demand = lambda now_s, **demand: None  # the air takes it up at its next tick
    assert ask(chamber, "11002¶1¶1") == "1¶23.0000\r\n"
    ask(chamber, "11001¶1¶1¶-20.5")
    assert ask(chamber, "11002¶1¶1") == "1¶-20.5000\r\n"
    assert ask(chamber, "$01I").startswith("-020.5 0024.5")
    ask(chamber, "14001¶1¶1¶1")
    assert ask(chamber, "11002¶1¶1") == "1¶23.0000\r\n"  # running: the one in force, the ramp included


def test_set_point_gradients_and_start_reach_the_plant(chamber, plant):
    ask(chamber, "11068¶1¶1¶1.5", 1.0)
    ask(chamber, "11072¶1¶1¶2.5", 2.0)
    ask(chamber, "11001¶1¶1¶-40.0", 3.0)
    ask(chamber, "14001¶1¶1¶1", 4.0)
    assert plant.demands == [
        (1.0, 23.0, 1.5, 0.0, False),
        (2.0, 23.0, 1.5, 2.5, False),
        (3.0, -40.0, 1.5, 2.5, False),
        (4.0, -40.0, 1.5, 2.5, True),
    ]
    assert ask(chamber, "10012¶1") == "1¶3\r\n"
    assert ask(chamber, "11066¶1¶1") == "1¶1.5\r\n"
    assert ask(chamber, "11070¶1¶1") == "1¶2.5\r\n"
    assert ask(chamber, "14003¶1¶1") == "1¶1\r\n"
    ask(chamber, "14001¶1¶1¶0", 5.0)
    assert ask(chamber, "10012¶1") == "1¶1\r\n"


def test_ascii2_values_with_the_start_bit_second(chamber):
    assert ask(chamber, "$01I") == f"0023.0 0024.5 -039.2 -040.2 {32 * '0'}\r"
    assert ask(chamber, "$01E -075.0 " + 16 * "01") == "\r"  # below the limit
    assert ask(chamber, "$01E 0025.0 0100") == "0\r"
    assert ask(chamber, "$01I") == f"0025.0 0024.5 -039.2 -040.2 01{30 * '0'}\r"
    assert ask(chamber, "10012¶1") == "1¶3\r\n"


def test_ascii2_gradients(chamber, plant):
    assert ask(chamber, "$01U 0001.5 0000.0 0000.0 0000.0") == "0\r"
    assert plant.demands[-1] == (1.0, 23.0, 1.5, 0.0, False)
    for bad in ("0001.5 0001.5 0000.0 0000.0", "0001.5 0000.0", "0001.5 x 0 0", "-001.0 0 0 0"):
        assert ask(chamber, f"$01U {bad}") == "\r"


@pytest.mark.parametrize(
    "bad", ["0025.0", "0100", "", "0025.0 0050.0 0100", "0025.0 0200", "warm 0100", f"0025.0 {33 * '0'}"]
)
def test_ascii2_sets_that_are_refused(chamber, plant, bad):
    assert ask(chamber, f"$01E {bad}") == "\r"
    assert plant.demands == []


@pytest.mark.parametrize("line", ["*IDN?", "$01X", "$01", "$", "$1I", "hello"])
def test_unknown_commands_are_told_in_text(chamber, line):
    assert ask(chamber, line) == f"'{line}' is an unknown command.\r"


def test_another_address_is_not_answered(chamber):
    assert chamber.receive(b"$02I\r", 1.0) == []
    assert ask(WeissEmulator(Plant(), address=7), "$07I").startswith("0023.0 0024.5 ")


def test_configuration_text_describes_the_strings(chamber):
    text = ask(chamber, "$01?")
    assert "CV01  value min:  -72.0   value max:  182.0   Temperature\r\n" in text
    assert "DO01  Start\r\n" in text and "MV02 actual value T.sensor 2\r\n" in text
    assert max(map(len, text.split("\r\n"))) <= 80
    configuration = decode_configuration(text)
    *numbers, digital = ask(chamber, "$01I").split()
    assert len(numbers) == len(configuration.read_fields) == 4
    assert len(digital) == configuration.digital_count == 32
    assert configuration.set_fields == ("CV01",)


def test_a_chamber_that_takes_all_values_with_the_set_point(plant):
    """The lines of ondrejh/VT4002: ten numbers and 16 outputs, or the set point alone, which stops it."""
    chamber = WeissEmulator(plant, auxiliary=range(1, 9), values_with_set=True)
    line = "$01E -020.5 0080.0 0027.5 0000.0 0027.0 -191.3 0000.0 -191.3 0025.5 -191.3 0111000000000000"
    assert ask(chamber, line) == "0\r"
    assert plant.demands[-1][1] == -20.5 and plant.demands[-1][-1] is True
    values = ask(chamber, "$01I").split()
    assert float(values[0]) == -20.5 and values[10][:4] == "0111"
    assert ask(chamber, "$01E 0030.0") == "0\r"
    assert plant.demands[-1][1] == 30.0 and plant.demands[-1][-1] is False
    assert ask(chamber, "$01E 0030.0 0100000000000000") == "\r"  # two numbers are none of its lines
    assert len(decode_configuration(ask(chamber, "$01?")).set_fields) == 10
    assert ask(WeissEmulator(plant), "$01E 0030.0") == "\r"


def test_an_alarm_stops_conditioning_until_reset(chamber, plant):
    ask(chamber, "14001¶1¶1¶1")
    chamber.raise_alarm("Temperature limiter", 5.0)
    assert plant.demands[-1] == (5.0, 23.0, 0.0, 0.0, False)
    assert ask(chamber, "10012¶1", 6.0) == "1¶9\r\n"
    replies = [
        ask(chamber, f"{number}¶1{index}", 6.0)
        for number, index in ((17002, ""), (17005, "¶1"), (17007, "¶1"), (17009, "¶1"))
    ]
    assert replies == ["1¶1\r\n", "1¶1\r\n", "1¶Temperature limiter\r\n", "1¶1\r\n"]
    ask(chamber, "14001¶1¶1¶1", 7.0)
    assert ask(chamber, "10012¶1", 7.0) == "1¶9\r\n"
    assert ask(chamber, "17012¶1", 8.0) == "1\r\n"
    assert ask(chamber, "10012¶1", 8.0) == "1¶3\r\n"


def test_latency_adds_up_and_line_feeds_do_not_count(chamber):
    replies = chamber.receive(b"$01I\r\n\r11004\xb61\xb61\r", 10.0)
    assert [round(reply.at_s, 6) for reply in replies] == [10.02, 10.04]


LINES = "$01I\r11001¶1¶1¶-40.0\r14001¶1¶1¶1\r\n$01E 0025.0 0100\r11004¶1¶1\rnonsense\r$01?\r".encode(
    "latin-1"
)


@settings(deadline=None, max_examples=60)
@given(st.lists(st.integers(0, len(LINES)), max_size=12))
def test_input_may_be_split_anywhere(cuts):
    chamber = WeissEmulator(Plant())
    edges = [0, *sorted(cuts), len(LINES)]
    data = b""
    for start, end in pairwise(edges):
        data += b"".join(reply.data for reply in chamber.receive(LINES[start:end], 1.0))
    assert data == b"".join(reply.data for reply in WeissEmulator(Plant()).receive(LINES, 1.0))


@settings(deadline=None, max_examples=100)
@given(
    st.binary(max_size=60) | st.text("0123456789¶$IEU ", max_size=30).map(lambda text: text.encode("latin-1"))
)
def test_any_bytes_are_survived(data):
    chamber = WeissEmulator(Plant())
    chamber.receive(data + b"\r", 1.0)
    assert ask(chamber, "10012¶1", 2.0).startswith("1¶")
