"""ASCII-2 and SimServ against strings that real chambers and their protocol text show."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base.errors import ProtocolError
from drivers.weiss._transcript import decode_transcript
from drivers.weiss.ascii2 import (
    Values,
    decode_values,
    encode_configuration_query,
    encode_gradient,
    encode_read,
    encode_set,
    encode_values,
)
from drivers.weiss.configuration import decode_configuration
from drivers.weiss.simserv import ChamberStatus, SimServReply, decode_simserv_reply, encode_request

OUTPUTS = """DO00  unused
DO01  Start
DO02  Custom Out1
DO06  Cond.protect
DO07  Clarificat.
DO16  No GreenMode
DO18  60068-2-30
"""

SETTINGS = """Description:
CV01  value min:  -72.0   value max:  182.0   Temperature
CV02  value min:    0.0   value max:   98.0   Humidity
SV01  value min:   25.0   value max:  100.0   Option
SV02  value min:    0.0   value max:   30.0   Option
SV03  value min:    2.0   value max:   30.0   Option
"""

MEASURED = """Description:
CV01  nominal value Temperature
CV01  actual value  Temperature
MV01 actual value T.sensor 1
MV02 actual value T.sensor 2
MV03 actual value T.sensor 3
MV04 actual value T.sensor 4
"""

# What two generations of firmware print for the same chamber (public dumps, unchanged lines left out).
OLDER = f"""ASCII-2 PROTOCOL CONFIGURATION
Configuration type: DYNAMIC

Example of an ASCII E-String:
$01E CV01 CV02 SV01 SV02 SV03 DO00 DO01 DO02 DO03 DO04 DO05 DO06 DO07 DO08 DO09
DO10 DO11 DO12 DO13 DO14 DO15 DO16 DO17 DO18 DO19 DO20 DO21 DO22 DO23 DO24 DO25
<CR>

{SETTINGS}{OUTPUTS}--------------------------------------------------------------------------------

Example of  an ASCII I-String:
$01I<CR>
CV01 CV01 CV02 CV02 SV01 SV02 SV03 MV01 MV02 MV03 MV04 DO00 DO01 DO02 DO03 DO04
DO05 DO06 DO07 DO08 DO09 DO10 DO11 DO12 DO13 DO14 DO15 DO16 DO17 DO18 DO19 DO20
DO21 DO22 DO23 DO24 DO25 DO26 DO27 DO28 DO29 DO30 DO31 <CR>

{MEASURED}{OUTPUTS}--------------------------------------------------------------------------------

Configured Messages:
none
"""

NEWER = f"""$01?
ASCII-2 PROTOCOL CONFIGURATION
Configuration type: DYNAMIC

Check Extern mode: enabled
Show target setpoint: disabled
Example of an ASCII E-String:
$01E CV01 CV02 SV01 SV02 SV03 DO00DO01DO02DO03DO04DO05DO06DO07DO08DO09DO10DO11DO
12DO13DO14DO15DO16DO17DO18DO19DO20DO21DO22DO23DO24DO25<CR>

{SETTINGS}{OUTPUTS}--------------------------------------------------------------------------------

Example of  an ASCII I-String:
$01I<CR>
CV01 CV01 CV02 CV02 SV01 SV02 SV03 MV01 MV02 MV03 MV04 DO00DO01DO02DO03DO04DO05D
O06DO07DO08DO09DO10DO11DO12DO13DO14DO15DO16DO17DO18DO19DO20DO21DO22DO23DO24DO25D
O26DO27DO28DO29DO30DO31<CR>

{MEASURED}{OUTPUTS}--------------------------------------------------------------------------------

Configured Messages:
none
"""

# A standard VC3 7060: the list of outputs is abridged by the chamber itself, and no <CR> ends the I-string.
STANDARD = """STANDARD ASCII 2 PROTOCOL FOR E-STRING AND CHAMBERS WITH 2 CONTROLLED VALUES
EXAMPLE OF AN ASCII E-STRING
$01E CV01 CV02 SV01 MV01 MV02 MV03 MV04 DO00 DO01 DO02 DO17 DO18 DO30 DO31 <CR>

 DESCRIPTION:
CV01  value min:  -77.0   Value max:  182.0   Temperature
CV02  value min:    0.0   Value max:  100.0   Humidity
SV01  value min:   50.0   Value max:  100.0   Fan speed
MV01  0000.0 unused
DO00  unused
DO01  Start
DO02  Humidity
EXAMPLE OF A ASCII E-STRING
$01E 0050.0 0080.0 0090.0 0000.0 0000.0 0000.0 0000.0 01010101010101010101010101010101<CR>

STANDARD ASCII 2 PROTOCOL FOR I-STRING AND CHAMBERS WITH 2 CONTROLLED VALUES
EXAMPLE OF AN ASCII I-STRING
$01I<CR>
CV01 CV01 CV02 CV02 SV01 SV01 MV01 MV01 MV02 MV02 MV03 MV03 MV04 MV04 DO00 DO01 DO31 DESCRIPTION:
CV01  nominal value Temperature
MV01  unused
MV01  actual value
"""

STANDARD_REPLY = (
    b"0050.0 0024.6 0080.0 0066.7 0090.0 0090.0 0000.0 0023.8 0000.0 0022.2 0000.0 0025.5 0000.0 0024.4 "
    b"01100000000000000000000000000000\r"
)


@pytest.mark.parametrize("text", [OLDER, NEWER, NEWER.replace("\n", "\r\n")])
def test_dynamic_configuration_of_both_firmwares(text):
    configuration = decode_configuration(text)
    assert configuration.set_fields == ("CV01", "CV02", "SV01", "SV02", "SV03")
    assert " ".join(configuration.read_fields) == "CV01 CV01 CV02 CV02 SV01 SV02 SV03 MV01 MV02 MV03 MV04"
    assert configuration.digital_count == 26
    assert configuration.start_bit == 1
    assert configuration.digital_names[7] == "Clarificat."
    temperature = configuration.settings["CV01"]
    assert (temperature.minimum, temperature.maximum, temperature.name) == (-72.0, 182.0, "Temperature")
    assert configuration.settings["SV03"].minimum == 2.0
    assert configuration.actual_index("CV01") == 1
    assert configuration.actual_index("MV02") == 8
    assert configuration.measured_values() == (1, 2, 3, 4)


def test_standard_configuration_and_its_own_example_reply():
    configuration = decode_configuration(STANDARD)
    values = decode_values(STANDARD_REPLY)
    assert configuration.set_fields == ("CV01", "CV02", "SV01", "MV01", "MV02", "MV03", "MV04")
    assert configuration.digital_count == 32
    assert len(values.numbers) == len(configuration.read_fields) == 14
    assert values.numbers[configuration.actual_index("CV01")] == 24.6
    assert values.numbers[configuration.actual_index("MV03")] == 25.5
    assert values.digital[configuration.start_bit] == "1"


@pytest.mark.parametrize(
    "text", ["", "'$01?' is an unknown command.", OLDER.replace("CV01  value", "CV0x  value")]
)
def test_a_text_that_is_no_configuration(text):
    with pytest.raises(ProtocolError):
        decode_configuration(text)


def test_a_sensor_the_chamber_does_not_have():
    with pytest.raises(ProtocolError, match="MV07"):
        decode_configuration(OLDER).actual_index("MV07")


@pytest.mark.parametrize(
    ("reply", "expected"),
    [
        (b"0025.0 0024.5 01000000000000000000000000000000\r", ((25.0, 24.5), "0" + "1" + 30 * "0")),
        (b"-075.0 -038.3 0101000000000000\r\n", ((-75.0, -38.3), "0101000000000000")),
        (b"-075.0 -038.3 0101000000000000Z\r", ((-75.0, -38.3), "0101000000000000")),
    ],
)
def test_value_replies_seen(reply, expected):
    assert decode_values(reply) == Values(*expected)


@pytest.mark.parametrize(
    "reply",
    [b"\r", b"0\r", b"0025.0\r", b"0025.0 xx 0101\r", b"0025.0 00 0101\r", b"1\xb624.4812\r\n", b"\xff\r"],
)
def test_replies_that_hold_no_values(reply):
    with pytest.raises(ProtocolError):
        decode_values(reply)


def test_ascii2_requests_seen():
    assert encode_read(1) == b"$01I\r"
    assert encode_configuration_query(1) == b"$01?\r"
    assert (
        encode_set(1, (50.0, 80.0, 90.0, 0.0, 0.0, 0.0, 0.0), 16 * "01")
        == b"$01E 0050.0 0080.0 0090.0 0000.0 0000.0 0000.0 0000.0 01010101010101010101010101010101\r"
    )
    assert encode_set(12, (-75.0,), "0100") == b"$12E -075.0 0100\r"
    assert encode_gradient(1, 0.0, 2.5) == b"$01U 0000.0 0002.5 0000.0 0000.0\r"


def test_simserv_strings_seen():
    assert encode_request(11004, 1) == b"11004\xb61\xb61\r"
    assert encode_request(11001, 1, 50.0) == b"11001\xb61\xb61\xb650.0\r"
    assert encode_request(14001, 1, 1) == b"14001\xb61\xb61\xb61\r"
    assert encode_request(10012) == b"10012\xb61\r"
    assert decode_simserv_reply(b"1\xb624.4812\r\n") == SimServReply(1, ("24.4812",))
    assert decode_simserv_reply(b"1\r\n") == SimServReply(1)
    assert decode_simserv_reply(b"-4\r\n") == SimServReply(-4)


@pytest.mark.parametrize("reply", [b"\r\n", b"OK\r\n", b"\xb61\r\n", b"'10012' is an unknown command.\r"])
def test_what_is_no_simserv_reply(reply):
    with pytest.raises(ProtocolError):
        decode_simserv_reply(reply)


def test_chamber_status_bits():
    assert ChamberStatus(3) == ChamberStatus.AVAILABLE | ChamberStatus.RUNNING
    assert ChamberStatus.ALARM in ChamberStatus(11)


@given(st.lists(st.integers(-9999, 99999), min_size=1, max_size=20), st.text("01", min_size=1, max_size=32))
def test_values_survive_the_wire_to_a_tenth(tenths, digital):
    numbers = tuple(tenth / 10 for tenth in tenths)
    assert decode_values(encode_values(numbers, digital)) == Values(numbers, digital)


AIR, AUX2, SET_POINT = b"11004\xb61\xb61\r", b"12002\xb61\xb62\r", b"11002\xb61\xb61\r"


def poll(start_ns, air, aux, set_point):
    """Return the exchanges of one SimServ poll, ten ns apart."""
    data = (SET_POINT, f"1¶{set_point}\r\n", AUX2, f"1¶{aux}\r\n", AIR, f"1¶{air}\r\n")
    return [
        (
            start_ns + 10 * index,
            "received" if index % 2 else "sent",
            part if index % 2 == 0 else part.encode("latin-1"),
        )
        for index, part in enumerate(data)
    ]


def test_simserv_transcript_by_hand():
    refused = poll(200, "21.0", "22.0", "23.0")
    refused[3] = (refused[3][0], "received", b"-8\r\n")
    lost = poll(300, "21.0", "22.0", "23.0")
    del lost[3]
    garbled = poll(400, "21.0", "2?.0", "23.0")
    cut = poll(500, "21.0", "22.0", "23.0")
    cut[5] = (cut[5][0], "received", b"1\xb623")
    columns, counts = decode_transcript(
        [
            (1, "sent", b"10012\xb61\r"),
            (2, "received", b"1\xb63\r\n"),
            *poll(100, "24.4812", "-39.9", "25.0"),
            *refused,
            *lost,
            *garbled,
            *cut,
            *poll(600, "-40.0001", "-38.5", "-40.0"),
            (700, "sent", AIR),
        ]
    )
    assert columns["time_ns"].tolist() == [150, 650]
    assert columns["air_temp_c"].tolist() == [24.4812, -40.0001]
    assert columns["aux_2_temp_c"].tolist() == [-39.9, -38.5]
    assert columns["set_point_c"].tolist() == [25.0, -40.0]
    assert columns["time_ns"].dtype == np.int64
    assert counts == {"polls": 7, "damaged": 5}


def test_ascii2_transcript_reads_the_layout_from_the_recording():
    numbers = b"0050.0 0024.6 0080.0 0066.7 0001.0 0002.0 0003.0 0021.1 0021.2 0021.3 0021.4 "
    columns, counts = decode_transcript(
        [
            (1, "sent", b"$01?\r"),
            (2, "received", NEWER[:300].encode()),
            (3, "received", NEWER[300:].encode()),
            (10, "sent", b"$01I\r"),
            (11, "received", numbers + 32 * b"0" + b"\r"),
            (20, "sent", b"$01I\r"),
            (21, "received", b"0050.0 0024.6 " + 32 * b"0" + b"\r"),
        ]
    )
    assert {name: column.tolist() for name, column in columns.items()} == {
        "time_ns": [11],
        "air_temp_c": [24.6],
        "set_point_c": [50.0],
        "aux_1_temp_c": [21.1],
        "aux_2_temp_c": [21.2],
        "aux_3_temp_c": [21.3],
        "aux_4_temp_c": [21.4],
    }
    assert counts == {"polls": 2, "damaged": 1}


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(*[st.integers(-720000, 1820000)] * 3), max_size=5),
    st.lists(st.integers(1, 6), min_size=1, max_size=30),
)
def test_transcript_does_not_depend_on_chunks(polls, sizes):
    exchanges = []
    for index, values in enumerate(polls):
        for _, direction, data in poll(0, *(f"{value / 10000:.4f}" for value in values)):
            at = 0
            while at < len(data):
                size = sizes[(index + at) % len(sizes)]
                exchanges.append((len(exchanges), direction, data[at : at + size]))
                at += size
    columns, counts = decode_transcript(exchanges)
    assert columns["air_temp_c"].tolist() == [air / 10000 for air, _, _ in polls]
    assert columns["set_point_c"].tolist() == [set_point / 10000 for _, _, set_point in polls]
    assert counts == {"polls": len(polls), "damaged": 0}


@settings(deadline=None, max_examples=150)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["sent", "received"]),
            st.sampled_from(
                [
                    AIR,
                    SET_POINT,
                    AUX2,
                    b"$01I\r",
                    b"$01?\r",
                    b"12002\xb61\xb6x\r",
                    b"1\xb61.5\r\n",
                    b"0001.0 01\r",
                ]
            )
            | st.binary(max_size=12)
            | st.just(NEWER.encode()),
        )
    )
)
def test_transcript_never_raises(chunks):
    columns, counts = decode_transcript([(index, *chunk) for index, chunk in enumerate(chunks)])
    assert counts["polls"] - counts["damaged"] == len(columns["time_ns"])
