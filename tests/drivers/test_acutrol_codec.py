"""ACL bytes against the manual's own examples (TM-8004-C) and the reply layout of TM-9374A section 3.4.2."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.acutrol import decode_transcript, encode_state_query
from drivers.acutrol.codec import (
    DIAGNOSTIC_BITS,
    ERROR_BITS,
    INTERLOCK_BITS,
    SOFTWARE_FAULT_BITS,
    STATE_BITS,
    Reply,
    bits_in_words,
    decode_header,
    decode_numbers,
    encode_command,
    encode_reply,
    split_reply,
)
from drivers.acutrol.grammar import Command, Refusal, parse_message
from drivers.base.errors import ProtocolError
from drivers.kit.config import TableConfig

POSITION_3 = Command(("DEMAND", "POSITION"), False, ("3", "10.5"))

TABLE = TableConfig(driver="acutrol3000", port="memory")


@pytest.mark.parametrize(
    "line",
    [":Demand:Position 3,10.5", ":D:P 3,10.5", "Demand:Position 3,10.5", ":DEMAND:position 3,10.5"],
)
def test_forms_the_manual_calls_equal(line: str) -> None:
    assert parse_message(line) == [POSITION_3]


@pytest.mark.parametrize("line", [":Demand:Posn 3,10.5", ":Dem;Pos 3,10.50000", ":D:P,3,10.5"])
def test_forms_the_manual_calls_errors(line: str) -> None:
    assert isinstance(parse_message(line)[-1], Refusal)


def test_semicolon_stays_and_semicolon_colon_returns_to_the_root() -> None:
    parsed = parse_message(":Dem:Pos 2,0.01;:Mode:Pos 2;Rate 1")
    assert parsed == [
        Command(("DEMAND", "POSITION"), False, ("2", "0.01")),
        Command(("MODE", "POSITION"), False, ("2",)),
        Command(("MODE", "RATE"), False, ("1",)),
    ]
    assert isinstance(parse_message(":Demand:Rate 1,5;Close 1")[-1], Refusal)


@pytest.mark.parametrize(
    ("line", "paths"),
    [
        (":I:C 1;C 2", [("INTERLOCK", "CLOSE")] * 2),
        (":I:O 1;O 2;O 3", [("INTERLOCK", "OPEN")] * 3),
        (":INT:RES;CLOS 1", [("INTERLOCK", "RESET"), ("INTERLOCK", "CLOSE")]),
        (":M:O 2;O 3", [("MODE", "OFF")] * 2),
        (":M:P 1;P 2", [("MODE", "POSITION")] * 2),
        (":U:L ON", [("UTILITY", "LOCKOUTMODE")]),
        (":utility:lockout on", [("UTILITY", "LOCKOUTMODE")]),
        (":LIM:ACC P,1,1500.0", [("LIMIT", "ACCELERATION")]),
        (":L:R R,3,100.0;R R,2,10.0", [("LIMIT", "RATE")] * 2),
        (":D:R 1,1.11111;R 3,45.125", [("DEMAND", "RATE")] * 2),
        (":Demand:Delta 1,-45", [("DEMAND", "DELTAPOSITION")]),
    ],
)
def test_commands_of_the_manual(line: str, paths: list[tuple[str, ...]]) -> None:
    parsed = parse_message(line)
    assert all(isinstance(command, Command) for command in parsed)
    assert [command.path for command in parsed if isinstance(command, Command)] == paths


def test_queries_of_the_manual() -> None:
    assert parse_message(":M? 1;:M? 2") == [
        Command(("MODE",), True, ("1",)),
        Command(("MODE",), True, ("2",)),
    ]
    assert parse_message(":read:pos? 1;rate? 1;acc? 1") == [
        Command(("READ", "POSITION"), True, ("1",)),
        Command(("READ", "RATE"), True, ("1",)),
        Command(("READ", "ACCELERATION"), True, ("1",)),
    ]
    assert parse_message(":READ:POSition 2") == [Command(("READ", "POSITION"), False, ("2",))]
    assert parse_message("*IDN?") == [Command(("*IDN",), True)]
    assert parse_message(":Status:MSG? QERROR") == [Command(("STATUS", "MSG"), True, ("QERROR",))]


def test_a_separator_inside_quotes_separates_nothing() -> None:
    assert parse_message(':Co:Ax 1,"Az;i,m"') == [Command(("CONFIGURE", "AXIS"), False, ("1", '"Az;i,m"'))]


def test_ambiguous_cut_is_refused() -> None:
    assert isinstance(parse_message(":C:A 1")[0], Refusal)  # Aim, Analog or Axis


def test_a_cut_that_the_manual_settles_is_what_it_says() -> None:
    # 4.10.3: V is Vector; 4.3.7 and 4.10.6: SVEC
    assert parse_message(":R:V? 1") == [Command(("READ", "VECTOR"), query=True, arguments=("1",))]
    assert parse_message(":DEM:SVEC? 2") == [Command(("DEMAND", "SHORTVECTOR"), query=True, arguments=("2",))]
    assert parse_message(":R:Svector 2") == [Command(("READ", "SHORTVECTOR"), arguments=("2",))]


@given(st.text(max_size=60))
def test_any_line_is_parsed_or_refused(line: str) -> None:
    for command in parse_message(line)[:-1]:
        assert isinstance(command, Command)


def test_command_bytes() -> None:
    assert encode_command(":demand:position", 1, 135.223) == b":demand:position 1,135.223000\r\n"
    assert encode_command("*IDN?") == b"*IDN?\r\n"
    assert encode_state_query(1) == b":read:pos? 1;rate? 1\r\n"
    assert encode_state_query(1, 2, marked=True) == b":read:pos? 1;rate? 1;pos? 2;rate? 2;pos? 1\r\n"


def test_reply_in_either_byte_order_and_with_padding() -> None:
    text = b"10.0001;44.1250\0\r\n"
    for order in "<>":
        frame = struct.pack(order + "II", 0, len(text)) + text
        assert split_reply(frame + b"next") == (Reply(0, "10.0001;44.1250"), len(frame))
        assert decode_header(struct.pack(order + "II", 215, 18)) == (215, 18)
        assert decode_header(struct.pack(order + "II", 215, 0)) == (215, 0)
    assert encode_reply(0, "OK") == bytes.fromhex("00000000 02000000 4f4b")


def test_implausible_length_is_a_protocol_error() -> None:
    with pytest.raises(ProtocolError, match="plausible length"):
        decode_header(b"'*IDN?' ")


@given(st.integers(0, 65535), st.text("0123456789;.-OK", max_size=40), st.sampled_from("<>"), st.data())
def test_split_reply_waits_for_the_whole_frame(
    error: int, text: str, order: str, data: st.DataObject
) -> None:
    frame = struct.pack(order + "II", error, len(text)) + text.encode()
    cut = data.draw(st.integers(0, len(frame) - 1))
    assert split_reply(frame[:cut]) is None
    assert split_reply(frame) == (Reply(error, text), len(frame))


@pytest.mark.parametrize("text", ["", "1;2;3", "one;two", "nan;1", "1;"])
def test_numbers_that_do_not_fit(text: str) -> None:
    with pytest.raises(ProtocolError):
        decode_numbers(text, 2)


def test_status_bits_by_appendix_b() -> None:
    assert bits_in_words(0x0300, STATE_BITS) == ["status latched", "data freeze active"]
    assert bits_in_words(0b110, SOFTWARE_FAULT_BITS) == ["rate trip", "position tracking error"]
    assert bits_in_words(1 << 15, STATE_BITS) == ["bit 15"]


# TM-8004-C, Appendix B, as printed: "" is an empty cell. Words that our text must have, in any case.
MANUAL = {
    "INTLK": (
        INTERLOCK_BITS,
        "0;1;2;3;4;5;power amplifier;1;2;Master Interlock;DMA Sync Error;Software Watchdog;10 kHz Clock Watchdog;"
        "Serial Data Link Fault;Interlock Link;Lock Fault",
    ),
    "SWFAULT": (
        SOFTWARE_FAULT_BITS,
        "Software Abort Initiated;Rate Trip;Position Tracking Error;Frame Time Error;Program Error;"
        "Miscorrelation Error;CRC Error;Fine Transducer;Coarse Transducer;Self-test Failure;;;;;;",
    ),
    "STATIC": (
        STATE_BITS,
        ";;;;Axis Servoed;Normal Unservo;Software Abort;Hardware Abort;Status Latched;Data Freeze Active;;;;;;",
    ),
    "ERR": (
        ERROR_BITS,
        "Floating Point Exception;Segmentation Fault;Servo Not Enabled;DMA Interrupt Not Enabled;Divide by Zero;"
        "Drive Not Enabled;NaN Detected;General Axis Error;;;;;;;;",
    ),
    "DIAG": (
        DIAGNOSTIC_BITS,
        "Temperature Fault;Temperature Warning;+5 V Analog Fault;+5 V Analog Warning;2 Fault;2 Warning;1 Fault;"
        "1 Warning;-12 V Fault;-12 V Warning;+12 V Fault;+12 V Warning;+5 V Digital Fault;+5 V Digital Warning;"
        "Temperature Fault;Temperature Warning",
    ),
}


@pytest.mark.parametrize("register", MANUAL)
def test_every_bit_that_the_manual_names_is_told_in_its_words(register: str) -> None:
    names, printed = MANUAL[register]
    cells = printed.split(";")
    assert len(cells) == 16
    for bit, cell in enumerate(cells):
        (text,) = bits_in_words(1 << bit, names)
        if cell:
            assert cell.lower() in text.lower()
    known = {bit for bit, cell in enumerate(cells) if cell}
    # release notes 119: the tracking error was bit 12 before
    assert set(names) - known == ({12} if register == "SWFAULT" else set())


def frame(text: str, error: int = 0) -> bytes:
    return struct.pack("<II", error, len(text)) + text.encode()


POLL = b":read:pos? 1;rate? 1\r\n"


def test_transcript_by_hand() -> None:
    columns, counts = decode_transcript(
        [
            (1, "sent", b"*IDN?\r\n"),
            (2, "received", frame("Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a")),
            (10, "sent", POLL[:7]),
            (11, "sent", POLL[7:]),
            (20, "received", frame("10.0001;44.1250")[:5]),
            (21, "received", frame("10.0001;44.1250")[5:]),
            (30, "sent", POLL),  # refused
            (31, "received", frame("Parameter Out Of Range", 103)),
            (40, "sent", POLL),  # one byte lost in the header
            (41, "received", frame("1.0;2.0")[1:]),
            (50, "sent", POLL),  # one byte lost in the text
            (51, "received", frame("1.0;2.0")[:-1]),
            (60, "sent", POLL),  # silent
            (70, "sent", POLL + b":mode:off 1\r"),
            (80, "received", frame("359.5;-0.25") + frame("OK")),
            (90, "sent", POLL),
        ],
        TABLE,
    )
    assert columns["time_ns"].tolist() == [21, 80]
    assert columns["angle_deg"].tolist() == [10.0001, 359.5]
    assert columns["rate_dps"].tolist() == [44.125, -0.25]
    assert columns["time_ns"].dtype == np.int64
    assert counts == {"polls": 7, "damaged": 5}


def test_empty_transcript_has_columns() -> None:
    columns, counts = decode_transcript([], TABLE)
    assert {name: len(column) for name, column in columns.items()} == {
        "time_ns": 0,
        "angle_deg": 0,
        "rate_dps": 0,
    }
    assert counts == {"polls": 0, "damaged": 0}


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(st.integers(0, 359999), st.integers(-400000, 400000)), max_size=8),
    st.lists(st.integers(1, 9), min_size=1, max_size=40),
)
def test_transcript_does_not_depend_on_chunks(polls: list[tuple[int, int]], sizes: list[int]) -> None:
    exchanges = []
    for index, (angle, rate) in enumerate(polls):
        for direction, data in (
            ("sent", POLL),
            ("received", frame(f"{angle / 1000:.6f};{rate / 1000:.6f}")),
        ):
            at = 0
            while at < len(data):
                size = sizes[(index + at) % len(sizes)]
                exchanges.append((len(exchanges), direction, data[at : at + size]))
                at += size
    columns, counts = decode_transcript(exchanges, TABLE)
    assert columns["angle_deg"].tolist() == [angle / 1000 for angle, _ in polls]
    assert columns["rate_dps"].tolist() == [rate / 1000 for _, rate in polls]
    assert counts == {"polls": len(polls), "damaged": 0}


@settings(deadline=None, max_examples=100)
@given(st.lists(st.tuples(st.sampled_from(["sent", "received"]), st.binary(max_size=20) | st.just(POLL))))
def test_transcript_never_raises(chunks: list) -> None:
    columns, counts = decode_transcript([(index, *chunk) for index, chunk in enumerate(chunks)], TABLE)
    assert counts["polls"] - counts["damaged"] == len(columns["time_ns"])
