"""The bench file: every mistake is named with its key, what was found and what was expected."""

import hashlib
import json
import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.record.benchfile import bench_file_from, load_bench_file
from drivers.base.errors import ConfigurationError
from drivers.kit.registry import DRIVERS, load_kind, registered

EXAMPLE = Path(__file__).parents[2] / "examples" / "lab.toml"
SMALLEST = """
[bench]
name = "b"
latitude_deg = 40
[table]
driver = "acutrol3000"
port = "/dev/ttyS0"
[chamber]
driver = "weiss"
port = "/dev/ttyS1"
[[gyro]]
name = "fog_1"
driver = "kvh1750"
unit = "1"
axis = "x"
port = "/dev/ttyS2"
"""


def written(tmp_path, text):
    path = tmp_path / "bench.toml"
    path.write_text(text, encoding="utf-8")
    return path


def refusal(tmp_path, text):
    with pytest.raises(ConfigurationError) as caught:
        load_bench_file(written(tmp_path, text))
    return str(caught.value)


def changed(old, new):
    assert old in SMALLEST
    return SMALLEST.replace(old, new)


def test_the_example_reads_as_it_is_written():
    bench = load_bench_file(EXAMPLE)
    assert bench.bench.latitude_deg == 39.98
    assert bench.bench.clock is None
    assert bench.chamber.auxiliary == {1: "fog_1 case", 2: "ellipse_1 case"}
    assert [(gyro.name, gyro.axis, gyro.on_can) for gyro in bench.gyro] == [
        ("fog_1", "x", False),
        ("ellipse_1", "z", True),
    ]
    assert bench.gyro_named("ellipse_1").channel == "can0"
    assert bench.sha256 == hashlib.sha256(EXAMPLE.read_bytes()).hexdigest()


def test_what_is_left_out_has_the_documented_default(tmp_path):
    bench = load_bench_file(written(tmp_path, SMALLEST))
    assert bench.limits.max_rate_dps == 20.0
    assert bench.recording.flush_interval_s == 1.0
    assert bench.table.baudrate == 9600
    assert bench.gyro[0].baudrate == 921_600
    assert bench.gyro[0].case_sensor is None


def test_a_bench_file_does_not_change_once_read():
    bench = load_bench_file(EXAMPLE)
    with pytest.raises(ValueError, match="frozen"):
        bench.limits.max_rate_dps = 1000.0


@pytest.mark.parametrize(
    ("old", "new", "key", "found", "expected"),
    [
        ('port = "/dev/ttyS2"', "port = 7", "gyro[0].port", "7 (a whole number)", "a serial device"),
        ("latitude_deg = 40", "latitude_deg = 95.0", "bench.latitude_deg", "95.0", "at most 90"),
        ("latitude_deg = 40", "latitude_deg = nan", "bench.latitude_deg", "nan", "latitude in degrees"),
        ("latitude_deg = 40", 'latitude_deg = "40"', "bench.latitude_deg", "'40' (text)", "degrees"),
        ("latitude_deg = 40\n", "", "bench.latitude_deg", "nothing", "latitude in degrees"),
        ('name = "b"', 'name = "b"\nclok = "x"', "bench.clok", "an unknown key", "did you mean 'clock'?"),
        ('name = "b"', 'name = "b"\nclock = "http://x"', "bench.clock", "'http://x'", "virtual:///..."),
        ('"acutrol3000"', '"acutrol300"', "table.driver", "'acutrol300'", "did you mean 'acutrol3000'?"),
        ('"kvh1750"', '"kvh1570"', "gyro[0].driver", "'kvh1570'", "did you mean 'kvh1750'?"),
        ("ttyS2", "ttyS1", "gyro[0].port", "'/dev/ttyS1'", "chamber is on this one"),
        ('axis = "x"', 'axis = "y"', "gyro[0].axis", "'y'", "one of the unit's axes, 'x'"),
        ('axis = "x"', 'axis = "x"\ncase_sensor = 3', "gyro[0].case_sensor", "3", "chamber.auxiliary (none)"),
        ('"fog_1"', '"FOG 1"', "gyro[0].name", "'FOG 1'", "lower-case"),
        ('"fog_1"', '"chamber"', "gyro[0].name", "'chamber'", "does not use itself"),
        ('port = "/dev/ttyS2"', "", "gyro[0].port", "nothing", "a serial port, or interface and channel"),
        ('port = "/dev/ttyS2"', 'channel = "can0"', "gyro[0].interface", "nothing", "python-can interface"),
        ('"/dev/ttyS2"', '"/dev/ttyS2"\nchannel = "c"', "gyro[0]", "port and channel", "either port"),
        ('[table]\ndriver = "acutrol3000"\nport = "/dev/ttyS0"\n', "", "table", "nothing", "a [table] section"),
        ("[[gyro]]", "[gyro]", "gyro", "a table", "at least one [[gyro]]"),
        ("[chamber]", "[safe]\nchamber_set_point_c = 90\n[chamber]", "safe.chamber_set_point_c", "90", "-60 to"),
        ("[chamber]", "[limits]\nmin_temp_c = 86\n[chamber]", "limits.min_temp_c", "86", "less than max_temp_c"),
        ("[chamber]", f"[limits]\nmin_temp_c = 1{'0' * 400}\n[chamber]", "limits.min_temp_c", "1000", "degC"),
        ("[chamber]", "[limits]\nmax_rate_dps = 0\n[chamber]", "limits.max_rate_dps", "0", "more than 0"),
        ("[chamber]", "[limit]\nmax_rate_dps = 9\n[chamber]", "limit", "an unknown key", "mean 'limits'?"),
        ("[chamber]", "[chamber]\nauxiliary = {a = 'x'}", "chamber.auxiliary.a", "'a'", "sensor number"),
        ("[chamber]", "[chamber]\nsimserv = 1", "chamber.simserv", "1", "true if"),
    ],
)  # fmt: skip
def test_one_mistake_is_one_paragraph(tmp_path, old, new, key, found, expected):
    text = refusal(tmp_path, changed(old, new))
    assert text.startswith(f"{tmp_path / 'bench.toml'}: {key} cannot be used.")
    assert f"Found: {found}" in text
    assert expected in text.split("Expected: ")[1]
    assert "\n" not in text


@pytest.mark.parametrize(
    ("chamber", "key", "found", "expected"),
    [
        ({"driver": "weiss", "address": 99}, "address", "99", "0 to 31"),
        ({"driver": "watlow_f4", "start_channel": 12}, "start_channel", "12", "1 to 8"),
        ({"driver": "watlow_f4t", "start_channel": 2}, "start_channel", "2", "started by its mode"),
        ({"driver": "espec_p300", "simserv": False}, "simserv", "false", "no SimServ"),
        ({"driver": "cts", "address": 33}, "address", "33", "1 to 32"),
        ({"driver": "cts", "framed": False, "door_channel": 7}, "door_channel", "7", "none without frames"),
        ({"driver": "thermotron_8200", "address": 10}, "address", "10", "bytes 10 and 13 end a line"),
        (
            {"driver": "thermotron_8200", "controller": "9000"},
            "controller",
            "9000",
            "'8200', '8800' or '3800'",
        ),
        ({"driver": "weiss", "port": "socket://10.0.0.1"}, "port", "10.0.0.1", "socket://host:port"),
        ({"driver": "weiss", "port": "socket://10.0.0.1:99999"}, "port", "99999", "1 to 65535"),
        ({"driver": "weiss", "port": "socket://:2049"}, "port", "socket://:2049", "socket://host:port"),
    ],
)
def test_what_a_chamber_does_not_take_is_told(chamber, key, found, expected):
    data = tomllib.loads(SMALLEST)
    data["chamber"] |= chamber
    with pytest.raises(ConfigurationError, match=rf"chamber\.{key} cannot be used") as told:
        bench_file_from(data)
    assert found in str(told.value) and expected in str(told.value)


def test_a_table_of_two_axes_behind_atl_is_told():
    data = tomllib.loads(SMALLEST)
    axes = [{"name": "a", "number": 1, "direction": "east"}, {"name": "b", "number": 2, "direction": "up"}]
    data["table"] |= {"driver": "ideal_atl", "axes": axes}
    with pytest.raises(ConfigurationError, match=r"table\.axes cannot be used.*2 axes"):
        bench_file_from(data)


def test_all_mistakes_are_told_at_once_one_a_line(tmp_path):
    text = changed('name = "fog_1"', "name = 3").replace('"weiss"', '"weis"').replace("= 40", "= true")
    text += '[[gyro]]\nname = "fog_1"\ndriver = "kvh1750"\nunit = "2"\naxis = "q"\nport = "/dev/ttyS2"\n'
    lines = refusal(tmp_path, text).splitlines()
    assert lines[0].endswith("bench.toml: 5 mistakes in the bench file")
    assert [line.split(":")[0].strip() for line in lines[1:]] == [
        "bench.latitude_deg", "gyro[0].name", "chamber.driver", "gyro[1].port", "gyro[1].axis",
    ]  # fmt: skip


def test_two_gyros_of_one_name_are_told(tmp_path):
    second = '[[gyro]]\nname = "fog_1"\ndriver = "kvh1750"\nunit = "2"\naxis = "x"\nport = "/dev/ttyS3"\n'
    assert "a name of its own (gyro[0] has this one)" in refusal(tmp_path, SMALLEST + second)


def test_one_port_by_two_names_is_one_port(tmp_path):
    (tmp_path / "tty").touch()
    (tmp_path / "by-id").symlink_to(tmp_path / "tty")
    text = changed("/dev/ttyS1", str(tmp_path / "tty")).replace("/dev/ttyS2", str(tmp_path / "by-id"))
    assert "gyro[0].port" in refusal(tmp_path, text)


def test_a_bench_file_kept_as_plain_values_reads_back_the_same():
    """The manifest keeps it so; decoding a run starts from there."""
    bench = load_bench_file(EXAMPLE)
    for kept in (bench.model_dump(mode="json"), json.loads(bench.model_dump_json()), bench.model_dump()):
        again = bench_file_from(kept)
        assert again.model_dump() == bench.model_dump()
        assert len(again.sha256) == 64


def test_a_syntax_error_is_told_with_its_line(tmp_path):
    text = refusal(tmp_path, changed("latitude_deg = 40", "latitude_deg = forty"))
    assert "bench.toml: the bench file is not TOML" in text
    assert "line 4" in text


def test_a_file_that_is_not_text_or_not_there_is_told(tmp_path):
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigurationError, match="UTF-8"):
        load_bench_file(tmp_path / "b.toml")
    with pytest.raises(ConfigurationError, match="No such file"):
        load_bench_file(tmp_path / "absent.toml")


_KEYS = st.sampled_from(
    [
        "bench",
        "table",
        "chamber",
        "gyro",
        "limits",
        "safe",
        "recording",
        "name",
        "driver",
        "port",
        "axis",
        "axes",
        "auxiliary",
        "case_sensor",
        "interface",
        "channel",
        "min_temp_c",
        "max_temp_c",
        "chamber_set_point_c",
        "1",
        "other",
    ]
)
_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_KEYS, inner, max_size=4),
    max_leaves=12,
)


@settings(max_examples=200, deadline=None)
@given(data=st.dictionaries(_KEYS, _VALUES, max_size=6))
def test_whatever_is_in_the_file_the_answer_is_a_configuration_error(data):
    with pytest.raises(ConfigurationError):
        bench_file_from(data, "generated")


def test_another_package_adds_a_driver_but_replaces_none_of_ours(monkeypatch, tmp_path):
    ours = registered(DRIVERS, "gyro")["kvh1750"]
    found = EntryPoints(
        [
            ours,
            EntryPoint("gyro.fg333", "drivers.kvh:Kvh1750", "gyrobench.drivers"),
            EntryPoint("gyro.kvh1750", "our_lab.bad:KIND", "gyrobench.drivers"),
        ]
    )
    monkeypatch.setattr("drivers.kit.registry.entry_points_of", lambda group: found.select(group=group))
    assert load_kind("gyro", "fg333") is load_kind("gyro", "kvh1750") is ours.load()
    assert "fg333" not in registered(DRIVERS, "table")
    text = changed("kvh1750", "fg333").replace("acutrol3000", "?").replace("weiss", "?")
    assert "table.driver" in (told := refusal(tmp_path, text)) and "gyro[0]" not in told


def test_an_unknown_kind_is_told():
    with pytest.raises(ConfigurationError, match="did you mean 'weiss'"):
        load_kind("chamber", "weis")


def test_importing_the_bench_package_does_not_load_pydantic():
    code = "import bench, sys; sys.exit('pydantic' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
