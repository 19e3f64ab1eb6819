"""Files from a stranger: nothing leads out of the runs folder, hangs, or takes more memory than it is worth."""

import csv
import json
import os
import re
import tracemalloc
import zipfile
from contextlib import suppress
from io import BytesIO
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import bench.present.cli
from bench.analysis.common.state_file import read_state, write_state
from bench.control.live import read_lines
from bench.control.recover import recover
from bench.control.run_record import _new_folder, decode_run
from bench.present.cli._app import app
from bench.present.panel._tails import EventTail
from bench.record.benchfile import load_bench_file
from bench.record.catalogue._catalogue import read_row
from bench.record.exchange import export_run, read_mapping
from bench.record.recording import Run, read_events, read_manifest, read_table, verify
from bench.record.recording._read import read_truth
from drivers.base.errors import ConfigurationError, RecordError
from drivers.base.files import parse_json, parse_toml, read_bounded
from drivers.can_dbc import load_layout
from drivers.frames import load_family
from drivers.kit.link import Link

TOML_READERS = [load_bench_file, load_family, load_layout, read_mapping]
MANIFEST = {"run_id": "r", "procedure": "p", "started_utc": "2026-01-01T00:00:00Z", "outcome": "aborted"}


def read(reader, path):
    return reader(str(path) if reader in (load_family, load_layout) else path)


@pytest.mark.parametrize("reader", TOML_READERS)
def test_a_settings_file_that_is_huge_a_pipe_or_nested_without_end_is_refused(reader, tmp_path):
    huge, pipe, deep, number = (tmp_path / f"{name}.toml" for name in ("huge", "pipe", "deep", "number"))
    with huge.open("wb") as file:
        file.truncate(1 << 40)  # sparse: read whole, it would take a terabyte
    os.mkfifo(pipe)
    deep.write_text("a = " + "[" * 100_000)
    number.write_text("a = " + "9" * 100_000)
    for path in (huge, pipe, deep, number):
        with pytest.raises(ConfigurationError, match=path.name):
            read(reader, path)


def test_a_device_is_no_file(tmp_path):
    (tmp_path / "bench.toml").symlink_to("/dev/zero")
    with pytest.raises(ConfigurationError, match="regular"):
        load_bench_file(tmp_path / "bench.toml")


@given(st.integers(0, 3000))
def test_as_many_bytes_as_allowed_are_read_and_not_one_more(tmp_path_factory, count):
    path = tmp_path_factory.mktemp("bounded") / "file"
    path.write_bytes(b"x" * count)
    assert len(read_bounded(path, count)) == count
    if count:
        with pytest.raises(OSError, match="more than"):
            read_bounded(path, count - 1)


def test_nesting_is_a_value_error_not_the_end_of_the_stack():
    for text in ("[" * 200_000, '{"a":' * 200_000):
        with pytest.raises(ValueError, match=r"nested|Expecting"):
            parse_json(text)
    with pytest.raises(ValueError, match="nested"):
        parse_toml(b"a = " + b"[" * 100 + b"]" * 100)
    with pytest.raises(ValueError, match="nested"):
        parse_toml(b"[" + b".".join([b"a"] * 100) + b"]")
    assert parse_toml(b"a = [[1]]") == {"a": [[1]]}


@pytest.mark.parametrize("part", ["a", "a-1", '"a"', "'#=,'", '"\\""', "'a' . \"'\""])
@pytest.mark.parametrize("around", ["%s = 1", "[%s]", "[[%s]]", "b = {%s = 1}", '"""\n"""'])
def test_a_key_of_thousands_of_parts_takes_no_memory(part, around):
    """tomllib keeps every beginning of a key: 3000 parts take some 40 MiB, 500,000 (1 MiB) a terabyte."""
    key = ".".join([part] * 3000)
    text = around % key if "%" in around else f"c = {around} # \"'\n{key} = 1"
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="nested"):
            parse_toml(text.encode())
        assert tracemalloc.get_traced_memory()[1] < 4 << 20
    finally:
        tracemalloc.stop()


def test_dots_that_join_no_keys_are_let_through():
    long = "a." * 200
    text = f"""n = [{"1.5, " * 200}]
one = "{long}\\"{long}"
two = '{long}'
three = \"\"\"{long}"
{long}\\\"\"\"{long}\"\"\"
four = '''{long}
'{long}'''  # {long}
"""
    assert parse_toml(text.encode())["four"] == f"{long}\n'{long}"


@pytest.mark.parametrize(
    "name",
    [
        "../../etc/passwd",
        "/etc/passwd",
        "raw/../../x",
        "raw//x",
        "",
        ".",
        "a\0b",
        "a\nb",
        "..\\x",
        "x" * 5000,
    ],
)
def test_a_manifest_that_names_files_outside_its_folder_is_none(tmp_path, name):
    """`runs verify` opens what the manifest names."""
    entry = {"sha256": "0" * 64, "bytes": 1}
    (tmp_path / "manifest.json").write_text(json.dumps(MANIFEST | {"files": {name: entry}}))
    with pytest.raises(RecordError, match=r"manifest\.json"):
        verify(tmp_path, lambda source, out: None)


def test_an_imported_log_and_a_run_id_stay_in_the_runs_folder(tmp_path):
    for change in (
        {"run_id": "../x"},
        {"run_id": ".."},
        {"imported": {"log": "/etc/passwd", "mapping": "m.toml"}},
    ):
        (tmp_path / "manifest.json").write_text(json.dumps(MANIFEST | change))
        with pytest.raises(RecordError, match=next(iter(change))):
            read_manifest(tmp_path)
    for name in ("../x", "/tmp/x", "..", ".", "a/b", "a\0"):
        with pytest.raises(RecordError, match="id"):
            _new_folder(tmp_path, name)
    assert _new_folder(tmp_path, "x").parent == tmp_path


def test_a_manifest_of_a_million_keys_is_refused_before_it_is_read(tmp_path):
    """Each device of a manifest takes some 40 times its text."""
    devices = {f"a_device_of_the_bench_{k}": {"kind": "x", "role": "gyro"} for k in range(300_000)}
    (tmp_path / "manifest.json").write_text(json.dumps(MANIFEST | {"devices": devices}))
    with pytest.raises(RecordError, match="16 MiB"):
        read_manifest(tmp_path)
    (tmp_path / "manifest.json").write_text(json.dumps(MANIFEST))
    assert read_manifest(tmp_path).run_id == MANIFEST["run_id"]


def test_huge_records_are_refused_before_they_are_read(tmp_path):
    for name, reader in (("manifest.json", read_manifest), ("events.jsonl", read_events)):
        with (tmp_path / name).open("wb") as file:
            file.truncate(1 << 40)
        with pytest.raises((RecordError, OSError), match="MiB"):
            reader(tmp_path)


def test_a_live_history_or_event_log_without_a_line_end_does_not_grow_in_memory(tmp_path):
    (tmp_path / "live").mkdir()
    with (tmp_path / "live" / "history.jsonl").open("wb") as file:
        file.truncate(1 << 40)
    rows, offset = read_lines(tmp_path / "live" / "history.jsonl")
    assert rows == [] and 0 < offset <= 16 << 20
    path = tmp_path / "events.jsonl"
    path.write_bytes(b"")
    tail = EventTail(path)
    tail.update()
    with path.open("wb") as file:
        file.truncate(1 << 40)
    tail.update()
    with path.open("ab") as file:
        file.write(b'\n{"time_s": 1, "kind": "note"}\n')
    assert tail.update() and tail.lines[-1] == {"time_s": 1, "kind": "note"}


def test_a_table_that_unpacks_to_more_than_the_memory_is_refused(tmp_path):
    """2**24 equal rows in less than 128 KiB, ten thousand such columns asked for."""
    path = tmp_path / "gyro_x.parquet"
    times = pa.array(np.zeros(1 << 24, np.int64))
    pq.write_table(pa.table({"time_ns": times}), path, compression="zstd")
    assert path.stat().st_size < 1 << 17
    with pytest.raises(RecordError, match="memory"):
        read_table(path, ["time_ns"] * 100_000)


@pytest.mark.parametrize(
    "columns", [{"rate_dps": [1.0]}, {"time_ns": ["a"]}, {"time_ns": [1], "rate_dps": [None]}]
)
def test_a_table_of_other_columns_is_no_table(tmp_path, columns):
    path = tmp_path / "gyro_x.parquet"
    pq.write_table(pa.table(columns), path)
    with pytest.raises(RecordError, match="gyro_x"):
        read_table(path)


@given(data=st.data())
def test_a_damaged_table_is_a_record_error(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("damaged") / "turntable.parquet"
    pq.write_table(pa.table({"time_ns": np.arange(50), "rate_dps": np.arange(50.0)}), path)
    content = bytearray(path.read_bytes())
    for at in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=4)):
        content[at] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    with suppress(RecordError):
        read_table(path)


def state_archive(path, name, data, size=None):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("compensation.json", json.dumps({"a": {"array": name}}))
        archive.writestr(name, data)
    if size is not None:  # a directory that lies about the size
        content = path.read_bytes()
        path.write_bytes(content.replace(len(data).to_bytes(4, "little"), size.to_bytes(4, "little")))


def test_a_compensation_file_cannot_unpack_or_claim_more_than_is_in_it(tmp_path):
    path = tmp_path / "x.gyrocomp"
    header = BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (1 << 45,)}
    )
    pickled = BytesIO()
    np.lib.format.write_array(pickled, np.array([print], object), allow_pickle=True)
    for data, size in (
        (header.getvalue(), None),
        (pickled.getvalue(), None),
        (bytes(300 << 20), None),
        (bytes(300 << 20), 4711),
    ):
        state_archive(path, "a.npy", data, size)
        with pytest.raises(RecordError, match="compensation"):
            read_state(path)
    kept = {"a": np.asfortranarray(np.arange(6.0).reshape(2, 3)), "c": np.empty((0, 2))}
    write_state(path, kept)
    restored = read_state(path)
    assert all(
        np.array_equal(restored[key], kept[key]) and restored[key].dtype == kept[key].dtype for key in kept
    )


def test_the_catalogue_lists_a_hostile_folder_as_unreadable(tmp_path):
    (tmp_path / "manifest.json").write_text("[" * 200_000)
    assert read_row(str(tmp_path.parent), tmp_path.name, "here").outcome == "unreadable"
    (tmp_path / "manifest.json").unlink()
    os.mkfifo(tmp_path / "manifest.json")
    assert read_row(str(tmp_path.parent), tmp_path.name, "here").outcome == "unreadable"


def test_a_truth_file_cannot_unpack_to_more_than_the_bound_or_run_code(tmp_path):
    honest, bomb, pickled = (tmp_path / f"{name}.npz" for name in ("honest", "bomb", "pickled"))
    np.savez_compressed(honest, bias_dph=np.arange(5.0))
    assert read_truth(honest)["bias_dph"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    with (
        zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("bias_dph.npy", "w") as file,
    ):
        for _ in range(300):
            file.write(bytes(1 << 20))
    assert bomb.stat().st_size < 1 << 20
    np.savez(pickled, bias_dph=np.array([{"a": 1}], dtype=object))
    with pytest.raises(RecordError, match="unpacked"):
        read_truth(bomb)
    with pytest.raises(RecordError, match=r"object|array"):
        read_truth(pickled)


MAPPING = """format = 1
maker = "M"
model = "N"
dbc = "bad.dbc"
sample = ["Rates"]
signal = [{ role = "rate", axis = "x", message = "Rates", signal = "X" }]
"""
DBC = """VERSION ""
BU_: Node
BO_ 256 Rates: 8 Node
 SG_ X : 0|16@1- (0.01,0) [0|0] "deg/s" Node
"""


@pytest.mark.parametrize(
    "hostile",
    [
        "BO_ " * 200_000,
        DBC + "VAL_ 256 X " + " ".join(f'{k} "x"' for k in range(200_000)) + ";",
        DBC + "(" * 100_000,
        DBC.replace("(0.01,0)", "(__import__('os').system('touch PWNED'),0)"),
        DBC.replace("0|16", "0|99999999999999"),
        "\x00" * 10_000,
    ],
    ids=["words", "values", "nesting", "code", "width", "zeros"],
)
def test_a_hostile_dbc_is_refused_or_read_as_data(hostile, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.dbc").write_text(hostile)
    (tmp_path / "bad.toml").write_text(MAPPING)
    with suppress(ConfigurationError):
        load_layout(str(tmp_path / "bad.toml"))
    assert sorted(file.name for file in tmp_path.iterdir()) == ["bad.dbc", "bad.toml"]


@pytest.mark.parametrize("name", ["raw/fog_1.bin", "raw/fog_1.idx", "events.jsonl", "gyro_fog_1.parquet"])
@pytest.mark.parametrize("kind", ["pipe", "device"])
@pytest.mark.parametrize("reader", [Run.open, recover, lambda folder: verify(folder, decode_run)])
def test_a_run_folder_with_a_pipe_or_a_device_in_it_is_refused(name, kind, reader, tmp_path):
    (tmp_path / "raw").mkdir()
    (tmp_path / "manifest.json").write_text(json.dumps(MANIFEST))
    if kind == "pipe":
        os.mkfifo(tmp_path / name)
    else:
        (tmp_path / name).symlink_to("/dev/zero")
    with pytest.raises(RecordError, match="files only"):
        reader(tmp_path)


def test_a_raw_file_that_has_grown_to_a_terabyte_is_not_summed(tmp_path):
    (tmp_path / "raw").mkdir()
    entry = {"sha256": "0" * 64, "bytes": 10}
    (tmp_path / "manifest.json").write_text(json.dumps(MANIFEST | {"files": {"raw/fog_1.bin": entry}}))
    with (tmp_path / "raw" / "fog_1.bin").open("wb") as file:
        file.truncate(1 << 40)
    report = verify(tmp_path, lambda source, out: pytest.fail("decoded"))
    assert any("1099511627776 bytes" in problem.text for problem in report.problems)


FRAMES = """schema = 1
name = "x"
title = "x"
[frame]
endian = "big"
sync = "EB 90"
length = 16
checksum = { kind = "crc16", ranges = [[0, 14]], at = 14, poly = "1021" }
%s
[[field]]
name = "rate"
at = 2
type = "f32"
unit = "deg/s"
role = "rate"
axis = "x"
%s
"""


@pytest.mark.parametrize(
    ("of_frame", "more"),
    [
        ("", "".join(f'[[field]]\nname = "f{k}"\nat = 8\ntype = "u8"\n' for k in range(9000))),
        ("", "".join(f'[[variant]]\nname = "v{k}"\nsync = "{k:04x}"\n' for k in range(9000))),
        ("", "sentinel = [" + '"ff",' * 9000 + "]"),
        ("", "transform = { kind = 'polynomial', coefficients = [" + "1.0," * 9000 + "] }"),
        ("match = [{ at = 2147483648, equals = '00' }]", ""),
        ("match = [{ at = 15, equals = '00 00' }]", ""),
        ("match = [" + "{ at = 8, equals = '00' }," * 9000 + "]", ""),
        ("", '[[vector]]\nhex = "EB90"\n' * 9000),
    ],
    ids=["fields", "variants", "sentinels", "polynomial", "far", "behind", "matches", "vectors"],
)
def test_a_frame_description_of_thousands_of_parts_is_refused_in_a_few_words(of_frame, more, tmp_path):
    """Checks go by pairs of fields and of variants: 9000 of them take minutes."""
    (tmp_path / "x.toml").write_text(FRAMES % ("", ""))
    load_family(str(tmp_path / "x.toml"))
    (tmp_path / "x.toml").write_text(FRAMES % (of_frame, more))
    with pytest.raises(ConfigurationError) as caught:
        load_family(str(tmp_path / "x.toml"))
    assert len(str(caught.value)) < 1000


EVIL = "x\x1b]0;title\x07\x1b[2J\x9b31m\u202e[/nope][link=file:///etc/passwd]y[/link]"


@pytest.mark.parametrize("command", ["show", "recover", "verify", "list"])
def test_a_records_text_is_text_to_the_terminal(command, tmp_path):
    """A title, a cleared screen, a link, and a tag that is closed without having been opened."""
    folder = tmp_path / "r"
    (folder / "raw").mkdir(parents=True)
    device = dict.fromkeys(("kind", "role", "maker", "model", "serial_number", "firmware"), EVIL)
    judged = {"name": EVIL, "value": 1.0, "unit": EVIL, "low": None, "high": None, "passed": True}
    told = {
        "reason": EVIL,
        "parameters": {EVIL: EVIL},
        "devices": {EVIL: device},
        "units": {EVIL: EVIL},
        "stream": {EVIL: {"frames": 1, "rejected": {EVIL: 1}, "warnings": [EVIL]}},
        "measurements": [judged],
    }
    (folder / "manifest.json").write_text(json.dumps(MANIFEST | told))
    where = ["--runs", str(tmp_path)] if command == "list" else [str(folder)]
    result = CliRunner().invoke(app, ["runs", command, *where], color=True, env={"FORCE_COLOR": "1"})
    assert result.exception is None or isinstance(result.exception, SystemExit | RecordError), (
        result.exception
    )
    plain = re.sub(r"\x1b\[[0-9;]*m", "", result.output)  # colours of our own
    assert plain and not set(plain) & set("\x1b\x07\x9b\u202e")
    assert "/etc/passwd" not in result.output or "[link=" in result.output


def test_what_we_print_goes_through_the_terminal_that_takes_text_for_text():
    """rich's own Console reads tags in text and lets escape sequences through."""
    made = {
        path.name
        for path in Path(bench.present.cli.__file__).parents[1].rglob("*.py")
        if re.search(r"(?<![\w.])Console\(", path.read_text(encoding="utf-8"))
    }
    assert made == set()


def test_an_exported_cell_is_no_formula(tmp_path):
    (tmp_path / "r").mkdir()
    (tmp_path / "r" / "manifest.json").write_text(json.dumps(MANIFEST))
    event = {"time_s": 1.0, "kind": "=cmd|' /C calc'!A0", "text": "=1+1"}
    (tmp_path / "r" / "events.jsonl").write_text(json.dumps(event) + "\n")
    pq.write_table(pa.table({"time_ns": [1], "rate_dps": [1.0]}), tmp_path / "r" / "turntable.parquet")
    out = export_run(tmp_path / "r", "csv", tmp_path / "out")
    _, row = csv.reader((out / "events.csv").read_text().splitlines())
    assert row == ["1", "'=cmd|' /C calc'!A0", '{"text": "=1+1"}']


@pytest.mark.parametrize("place", ["port", "channel"])
@pytest.mark.parametrize("scheme", ["spy", "SPY", "alt", "hwgrep", "loop", "file"])
def test_a_bench_files_port_writes_no_file(scheme, place, tmp_path):
    """pyserial's `spy://` opens the file it is told, to write; python-can's slcan takes the same addresses."""
    kept = tmp_path / "kept"
    kept.write_text("mine")
    url = f"{scheme}://{tmp_path / 'tty'}?file={kept}"
    example = (Path(__file__).parents[2] / "examples" / "demo.toml").read_text()
    line = next(line for line in example.splitlines() if line.startswith(f"{place} = "))
    (tmp_path / "bench.toml").write_text(example.replace(line, f'{place} = "{url}"', 1))
    with pytest.raises(
        ConfigurationError, match=rf"{place}[\s\S]*socket://host:port|{place}[\s\S]*CAN channel"
    ):
        load_bench_file(tmp_path / "bench.toml")
    with pytest.raises(ConfigurationError, match="socket://"):
        Link(url, clock=None, name="x")
    assert kept.read_text() == "mine"
