"""raw/ to tables: values, gaps and times against what was recorded; any cut of the raw files reads to the cut."""

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench.record.events.run import Note, UnitsOff, UnitsOn
from bench.record.recording import PortJournal, decode_instrument, decode_stream, read_exchanges, units_off_s
from bench.record.recording._events import Line
from drivers.base.errors import RecordError

FIXTURES = [HealthCheck.function_scoped_fixture]


def table(folder, name="gyro_fog"):
    read = pq.read_table(folder / f"{name}.parquet")
    return {column: read[column].to_numpy() for column in read.column_names}


def test_columns_hold_what_was_sent_at_the_time_it_was_sampled(tmp_path, fake):
    fake.record(tmp_path, range(500), 0.01)
    report = decode_stream(tmp_path, fake.source())
    got = table(tmp_path)
    assert list(got) == [
        "time_ns", "counter", "lost_before", "status", "valid", "rate_dps", "rate_y_dps", "temp_c",
    ]  # fmt: skip
    assert got["counter"].tolist() == list(range(500))
    assert np.abs(got["time_ns"] - (1_000_000_000 + 10_000_000 * np.arange(500))).max() <= 1
    assert got["rate_dps"] == pytest.approx(100.0 * np.arange(500), rel=1e-6)
    assert got["rate_y_dps"].tolist() == (-np.arange(500.0)).tolist()
    assert got["rate_dps"].dtype == got["temp_c"].dtype == np.float32
    assert got["valid"].all()
    assert not got["lost_before"].any()
    assert (report.frames, report.lost, report.bytes_skipped) == (500, 0, 0)
    assert report.sample_rate_hz == pytest.approx(100.0, rel=1e-9)


def test_the_files_say_their_units_and_pack_floats_by_byte(tmp_path, fake):
    fake.record(tmp_path, range(50), 0.01)
    decode_stream(tmp_path, fake.source())
    file = pq.ParquetFile(tmp_path / "gyro_fog.parquet")
    units = {field.name: field.metadata[b"unit"].decode() for field in file.schema_arrow}
    assert units["time_ns"] == "ns"
    assert units["rate_dps"] == "deg/s"
    assert units["temp_c"] == "degC"
    assert units["lost_before"] == "1"
    group = file.metadata.row_group(0)
    encodings = {group.column(at).path_in_schema: group.column(at).encodings for at in range(8)}
    assert "BYTE_STREAM_SPLIT" in encodings["rate_dps"]
    assert "DELTA_BINARY_PACKED" in encodings["time_ns"]
    assert group.column(0).compression == "ZSTD"


def test_lost_and_doubled_frames_are_marked_and_counted(tmp_path, fake):
    samples = [*range(100), *range(105, 300), 299, *range(300, 400), *range(900, 1200)]
    fake.record(tmp_path, samples, 0.01)
    report = decode_stream(tmp_path, fake.source())
    got = table(tmp_path)
    assert got["counter"].tolist() == samples
    assert {at: int(got["lost_before"][at]) for at in np.flatnonzero(got["lost_before"])} == {
        100: 5,
        396: 500,
    }
    assert np.flatnonzero(~got["valid"]).tolist() == [295]
    assert (report.lost, report.duplicates, report.frames) == (505, 1, len(samples))


def test_bytes_before_the_stream_are_not_part_of_it(tmp_path, fake):
    port = PortJournal(tmp_path, "fog")
    answer = fake.encode(77, 1.0) + b"CONFIG,0\r\n"
    port.received(answer, 0.5)
    for n in range(300):
        port.received(fake.encode(n % 128, float(n)), 1.0 + n * 0.01)
    port.flush(sync=False)
    report = decode_stream(tmp_path, fake.source(start_offset=len(answer)))
    got = table(tmp_path)
    assert got["counter"][0] == 0
    assert got["time_ns"][0] == pytest.approx(1_000_000_000, abs=2)
    assert (report.frames, report.start_offset, report.bytes_skipped) == (300, len(answer), 0)


def test_the_wire_is_taken_off_at_the_ports_baud_rate(tmp_path, fake):
    fake.record(tmp_path, range(300), 0.01)
    decode_stream(tmp_path, fake.source(baudrate=7000))  # 7 bytes of 10 bits: 10 ms
    assert table(tmp_path)["time_ns"][0] == pytest.approx(990_000_000, abs=2)


def test_nothing_to_decode_gives_a_report_and_no_table(tmp_path, fake):
    port = PortJournal(tmp_path, "fog")
    port.received(b"noise", 0.5)
    port.flush(sync=False)
    report = decode_stream(tmp_path, fake.source())
    assert report.frames == 0
    assert report.warnings
    assert decode_stream(tmp_path, fake.source(name="absent")).bytes_received == 0
    assert not list(tmp_path.glob("*.parquet"))


@settings(max_examples=40, deadline=None, suppress_health_check=FIXTURES)
@given(data_cut=st.integers(0, 2100), index_cut=st.integers(0, 4800))
def test_a_kill_anywhere_leaves_everything_up_to_the_cut_readable(
    tmp_path_factory, fake, data_cut, index_cut
):
    folder = tmp_path_factory.mktemp("run")
    fake.record(folder, range(300), 0.01)
    raw = folder / "raw"
    (raw / "fog.bin").write_bytes((raw / "fog.bin").read_bytes()[:data_cut])
    (raw / "fog.idx").write_bytes((raw / "fog.idx").read_bytes()[:index_cut])
    report = decode_stream(folder, fake.source())
    frames, marks = data_cut // fake.size, min(index_cut // 16, data_cut // fake.size)
    assert report.frames == frames
    if not frames or not marks:
        assert not (folder / "gyro_fog.parquet").exists()
        return
    got = table(folder)
    assert got["counter"].tolist() == list(range(frames))
    assert np.abs(got["time_ns"] - (1_000_000_000 + 10_000_000 * np.arange(frames))).max() <= 300


def test_block_borders_do_not_show(tmp_path, fake, monkeypatch):
    fake.record(tmp_path, [*range(700), *range(1100, 2000)], 0.01, chunk=13)
    decode_stream(tmp_path, fake.source())
    whole = (tmp_path / "gyro_fog.parquet").read_bytes()
    for block in (1, 7, 50, 333):
        monkeypatch.setattr("bench.record.recording._raw.read_blocks.__defaults__", (0, block))
        decode_stream(tmp_path, fake.source())
        got = table(tmp_path)
        assert got["counter"].tolist() == [*range(700), *range(1100, 2000)]
        assert (tmp_path / "gyro_fog.parquet").read_bytes() == whole


def test_row_groups_of_65536_join_seamlessly(tmp_path):
    from bench.record.recording._tables import table_writer

    with table_writer(tmp_path / "t.parquet", "t") as writer:
        for start in range(0, 200_000, 30_000):
            rows = np.arange(start, min(start + 30_000, 200_000))
            writer.write({"time_ns": rows, "rate_dps": rows.astype(np.float32)})
    file = pq.ParquetFile(tmp_path / "t.parquet")
    assert [file.metadata.row_group(at).num_rows for at in range(4)] == [65536, 65536, 65536, 3392]
    assert file.read()["time_ns"].to_numpy().tolist() == list(range(200_000))


def test_a_table_that_fails_half_way_is_not_left_behind(tmp_path):
    from bench.record.recording._tables import table_writer

    with pytest.raises(KeyError), table_writer(tmp_path / "t.parquet", "t") as writer:
        writer.write({"time_ns": np.arange(70_000)})
        raise KeyError("decoder")
    assert list(tmp_path.iterdir()) == []


def test_exchanges_come_in_the_order_of_question_and_answer(tmp_path):
    """Virtual time stands still between an answer and the next question."""
    port = PortJournal(tmp_path, "chamber")
    port.sent(b"Q1", 1.0)
    port.received(b"A1", 1.0)
    port.sent(b"Q2", 1.0)
    port.received(b"A", 1.5)
    port.received(b"2", 1.5)
    port.sent(b"Q3", 1.5)
    port.flush(sync=False)
    got = list(read_exchanges(tmp_path, "chamber"))
    assert [(way, data) for _, way, data in got] == [
        ("sent", b"Q1"), ("received", b"A1"), ("sent", b"Q2"),
        ("received", b"A"), ("received", b"2"), ("sent", b"Q3"),
    ]  # fmt: skip
    assert [time_ns for time_ns, _, _ in got] == [
        10**9, 10**9 + 1, 10**9 + 2, 1_500_000_000, 1_500_000_000, 1_500_000_001,
    ]  # fmt: skip


def test_instrument_tables_come_from_the_transcript(tmp_path):
    port = PortJournal(tmp_path, "chamber")
    for second in range(5):
        port.sent(b"T?", float(second))
        port.received(b"%d" % (20 + second), second + 0.25)
    port.flush(sync=False)

    def transcript(exchanges):
        answers = [(time_ns, float(data)) for time_ns, way, data in exchanges if way == "received"]
        times, temps = zip(*answers, strict=True)
        return {"time_ns": np.array(times), "air_temp_c": np.array(temps)}, {"refused": 2}

    assert decode_instrument(tmp_path, "chamber", "chamber", transcript) == {"refused": 2}
    got = table(tmp_path, "chamber")
    assert got["air_temp_c"].tolist() == [20, 21, 22, 23, 24]
    assert got["time_ns"].tolist() == [250_000_000 + 10**9 * second for second in range(5)]


@pytest.mark.parametrize(
    ("row", "column", "value", "pair"),
    [(100, 0, 3, 101), (100, 1, 3, 101), (0, 1, -(2**62), 1), (299, 1, 2**62, 300), (299, 1, -(2**63), 300)],
)
def test_an_index_that_goes_backwards_or_leaps_is_told(tmp_path, fake, row, column, value, pair):
    fake.record(tmp_path, range(300), 0.01)
    index = tmp_path / "raw" / "fog.idx"
    marks = np.fromfile(index, "<i8").reshape(-1, 2)
    marks[row, column] = value
    marks.tofile(index)
    with pytest.raises(RecordError, match=rf"fog\.idx, pair {pair}"):
        decode_stream(tmp_path, fake.source())


def test_what_is_not_sent_while_switched_off_is_not_lost(tmp_path, fake):
    # on to 10 s, off to 40 s, six frames lost at 45 s, cable out from 50 s to 60 s
    samples = [*range(1000), *range(4000, 4500), *range(4506, 5000), *range(6000, 7000)]
    fake.record(tmp_path, samples, 0.01, start_s=0.0)
    events = [Line(9.0, UnitsOff()), Line(9.5, Note("an answer"))]
    off_s = units_off_s([*events, Line(46.0, UnitsOn())])
    report = decode_stream(tmp_path, fake.source(), off_s=off_s)
    assert (report.off, report.lost) == (3000, 1006)
    assert int(table(tmp_path)["lost_before"].sum()) == 4006
    # a unit that comes back later than it was to: the rest of the gap is lost
    report = decode_stream(tmp_path, fake.source(), off_s=[(9.0, 30.0)])
    assert (report.off, report.lost) == (pytest.approx(2000, abs=2), pytest.approx(2006, abs=2))
    # the procedure ended before the units were on again
    assert decode_stream(tmp_path, fake.source(), off_s=units_off_s(events)).lost == 6
