"""The emulated ACUTROL3000 against the manual's own commands and answers."""

import math
import struct
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base.errors import ConfigurationError
from simulators.emulators.acutrol import AcutrolAxis, AcutrolEmulator


class Plant:
    max_rate_dps = 120.0
    max_acceleration_dps2 = 1500.0

    def __init__(self):
        self.calls = []
        self.done = True

    def servo(self, now_s, on):
        self.calls.append(("servo", now_s, on))

    def demand_rate(self, now_s, rate_dps, acceleration_limit_dps2=math.inf):
        self.calls.append(("rate", now_s, rate_dps))

    def demand_angle(self, now_s, angle_deg, rate_limit_dps, acceleration_limit_dps2=math.inf):
        self.rate_limit_dps = rate_limit_dps
        self.calls.append(("angle", now_s, angle_deg))

    def angle_deg(self, now_s):
        return 135.223

    def rate_dps(self, now_s):
        return -44.125

    def settled(self, now_s):
        return self.done

    def acceleration_dps2(self, now_s):
        return 12.5


@pytest.fixture
def plant():
    return Plant()


@pytest.fixture
def table(plant):
    return AcutrolEmulator(plant)


def ask(table, line, now_s=1.0):
    """Return (error code, text) of the one reply to a line, unpacked here without the project's codec."""
    (reply,) = table.receive(line.encode() + b"\r\n", now_s)
    error, length = struct.unpack("<II", reply.data[:8])
    assert length == len(reply.data) - 8
    return error, reply.data[8:].decode()


def test_the_poll_of_a_public_program_is_answered(table):
    """IEAv-EFO/acutrol3000 asks position, rate and acceleration on one line."""
    assert ask(table, ":read:pos? 1;rate? 1;acc? 1") == (0, "135.223000;-44.125000;12.500000")


@pytest.mark.parametrize("line", ["*IDN?", "*idn?"])
def test_identity_is_the_manuals(table, line):
    assert ask(table, line) == (0, "Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a")


@pytest.mark.parametrize(
    "line",
    [":utility:lockout on", ":interlock:open 1", ":interlock:reset 1", ":interlock:close 1", ":mode:off 1"],
)
def test_the_public_drivers_sequences_are_ok(table, line):
    assert ask(table, line) == (0, "OK")


def test_joined_read_and_the_form_without_question_mark(table):
    assert ask(table, ":read:pos? 1;rate? 1") == (0, "135.223000;-44.125000")
    assert ask(table, ":READ:POSition 1") == (0, "135.223000")
    assert ask(table, ":read:rate 1") == (0, "-44.125000")


@pytest.mark.parametrize(
    "line",
    [
        ":Demand:Posn 1,10.5",
        ":Dem;Pos 1,10.5",
        ":D:P,1,10.5",
        ":D:P 2,10.5",
        ":D:P ALL?,10.5",
        ":D:P 1",
        ":D:P 1,ten",
        ":demand:rate 1,120.5",
        ":demand:rate 1,nan",
        ":read:pos? ALL",
        ":mode? ALL",
        ":mode 1,sideways",
        ":R:V? 2",
        ":status:csr? A2STATE",
        "*RST",
        "*TST?",
        "*OPC",
        "hello",
        ":configure:axis? 1",
    ],
)
def test_what_the_device_refuses(table, line):
    error, text = ask(table, line)
    assert error != 0 and text
    assert ask(table, ":Status:MSG? QERROR") == (0, f"{error}: {text}")
    assert ask(table, ":Status:MSG? QERROR") == (0, "")


def test_a_demand_waits_for_the_interlock(table, plant):
    # The manual's own order: demand, reset, mode, close (4.5.6).
    ask(table, ":D:P 1,10.5;:I:R;:M:P 1;:I:C 1", 2.0)
    assert plant.calls == [("servo", 2.0, True), ("angle", 2.0, 10.5)]


def test_modes_and_demands(table, plant):
    ask(table, ":int:close 1", 1.0)
    ask(table, ":mode:rate 1;:demand:rate 1,10", 2.0)
    assert ask(table, ":mode? 1") == (0, "Rate")
    ask(table, ":mode 1,pos", 3.0)
    assert ask(table, ":mode? 1") == (0, "Position")
    ask(table, ":mode:off ALL", 4.0)
    assert plant.calls[-4:] == [
        ("rate", 2.0, 0.0),
        ("rate", 2.0, 10.0),
        ("angle", 3.0, 0.0),
        ("rate", 4.0, 0.0),
    ]


def test_limit_queries(table):
    assert float(ask(table, ":limit:rate? rate,1")[1]) == 120.0
    assert float(ask(table, ":lim:acc? pos,1")[1]) == 1500.0
    assert [float(field) for field in ask(table, ":limit:absolute? 1")[1].split(",")][:2] == [120.0, 1500.0]


def test_rate_limit_of_position_mode_counts_for_turns_and_not_for_rates(table, plant):
    assert ask(table, ":Limit:Rate pos,1,20") == (0, "OK")
    assert float(ask(table, ":limit:rate? position,1")[1]) == 20.0
    assert float(ask(table, ":limit:rate? rate,1")[1]) == 120.0
    for refused in ("pos,1", "pos,2,20", "pos,1,fast", "pos,1,0", "pos,1,121", "home,1,20"):
        assert ask(table, f":limit:rate {refused}")[0] != 0
    ask(table, ":interlock:close 1")
    ask(table, ":mode:position 1")
    ask(table, ":d:p 1,45.0")
    assert plant.rate_limit_dps == 20.0


def test_limited_axis_refuses_angles_outside(plant):
    table = AcutrolEmulator({1: AcutrolAxis(plant, -45.0, 45.0)})
    assert ask(table, ":d:p 1,45.0")[0] == 0
    assert ask(table, ":d:p 1,45.001")[0] != 0
    assert ask(table, ":d:p? 1") == (0, "45.000000")


def test_status_words_by_appendix_b(table, plant):
    assert int(ask(table, ":Status:CSR? A1STATE")[1]) & 0x10 == 0
    ask(table, ":interlock:close 1;:mode:rate 1")
    assert int(ask(table, ":Status:CSR? A1STATE")[1]) & 0x10
    assert int(ask(table, ":Status:CSR? A1DYN")[1]) == 1 << 9
    ask(table, ":mode:position 1")
    assert int(ask(table, ":Status:CSR? A1DYN")[1]) == 1 << 8
    plant.done = False
    assert int(ask(table, ":Status:CSR? A1DYN")[1]) == 0


def test_trip_close_and_reset(table, plant):
    ask(table, ":interlock:close 1")
    table.trip("position tracking error", 5.0)
    assert plant.calls[-1] == ("servo", 5.0, False)
    assert ask(table, ":interlock? 1", 6.0) == (0, "Fault")
    assert int(ask(table, ":status:csr? A1SWFLT", 6.0)[1]) == 1 << 2
    assert int(ask(table, ":status:csr? A1STATE", 6.0)[1]) & 0xF0 == 1 << 6
    assert ask(table, "*STB?", 6.0) == (0, "65")  # seen on a real table with an interlock fault
    assert ask(table, "*STB?", 6.0) == (0, "0")  # reading clears
    ask(table, ":interlock:close 1", 6.0)
    assert ask(table, ":interlock? 1", 6.0) == (0, "Fault")
    ask(table, ":Interlock:Reset", 6.0)
    assert ask(table, ":interlock? 1", 6.0) == (0, "Open")
    assert ask(table, ":status:csr? A1SWFLT", 6.0) == (0, "0")


def test_unknown_trip_is_a_configuration_error(table):
    with pytest.raises(ConfigurationError, match="rate trip"):
        table.trip("gremlins", 1.0)


def test_all_profiles_complete_in_the_status_byte(table, plant):
    ask(table, ":int:close 1;:mode:rate 1;:demand:rate 1,10")
    plant.done = False
    assert ask(table, "*STB?") == (0, "0")
    plant.done = True
    assert ask(table, "*STB?") == (0, "2")


def test_latency_adds_up_for_joined_lines(table):
    replies = table.receive(b"*IDN?\r*IDN?\n\r\n*IDN?\r", 10.0)
    assert [round(reply.at_s, 6) for reply in replies] == [10.002, 10.004, 10.006]


def test_a_line_longer_than_the_manual_allows(table):
    assert ask(table, ":demand:rate 1," + "0" * 32800)[0] != 0
    assert ask(table, "*IDN?")[0] == 0


LINES = (
    b":interlock:close 1\r\n:mode:rate 1\n:demand:rate 1,12.5\rnonsense\r\n:read:pos? 1;rate? 1\r\n*STB?\r"
)


@settings(deadline=None, max_examples=60)
@given(st.lists(st.integers(0, len(LINES)), max_size=12))
def test_input_may_be_split_anywhere(cuts):
    edges = [0, *sorted(cuts), len(LINES)]
    table = AcutrolEmulator(Plant())
    data = b""
    for start, end in pairwise(edges):
        data += b"".join(reply.data for reply in table.receive(LINES[start:end], 1.0))
    assert data == b"".join(reply.data for reply in AcutrolEmulator(Plant()).receive(LINES, 1.0))


@settings(deadline=None, max_examples=100)
@given(st.binary(max_size=80))
def test_any_bytes_are_survived(data):
    table = AcutrolEmulator(Plant())
    table.receive(data + b"\r", 1.0)
    assert ask(table, "*IDN?", 2.0)[0] == 0
