"""Files of a run byte by byte: growing files, indices, journals, arrivals, jumps of a counter, seals."""

import math
import os
import stat
from array import array
from types import SimpleNamespace

import numpy as np
import pytest

from bench.record.events.campaign import Started
from bench.record.events.run import Answer, Invalid, Note, Outcome, Requested, UnitsOff, UnitsOn
from bench.record.recording import (
    EventLog,
    Journal,
    Manifest,
    PortJournal,
    Run,
    _events,
    _remote,
    read_manifest,
    read_table,
    seal,
    table_writer,
    verify,
    write_manifest,
)
from bench.record.recording._decode import decode_instrument, decode_stream, units_off_s
from bench.record.recording._events import AppendFile, Line, read_events
from bench.record.recording._frames import Framed
from bench.record.recording._journal import _Direction
from bench.record.recording._manifest import OperatorEntry, checksum, own_files, seal_state
from bench.record.recording._operators import operators_of
from bench.record.recording._raw import (
    _check_order,
    first_arrivals,
    raw_path,
    read_blocks,
    read_exchanges,
    read_marks,
)
from bench.record.recording._read import _overlapping
from bench.record.recording._tables import ROW_GROUP, names_at, second_rows, seconds, unit_of
from bench.record.recording._timing import (
    StreamTimer,
    StreamTiming,
    Unwrapper,
    _resolve_jumps,
    _rough_period_s,
    _stays_moved_s,
)
from bench.record.recording._verify import _compare_tables, _grown
from drivers.base.errors import ProtocolError, RecordError

START = "2026-11-21T00:00:00.000+00:00"
PIECE = 1 << 16


def manifest(**changes):
    return Manifest(**{"run_id": "r1", "procedure": "p", "started_utc": START} | changes)


def grown(path, *parts):
    file = AppendFile(path)
    for part in parts:
        file.pending += part
        file.write()
    return file


@pytest.mark.parametrize("at", [0, 1, PIECE - 1, PIECE, PIECE + 9, 2 * PIECE, 2 * PIECE + 4999])
def test_a_byte_that_was_changed_is_found_in_its_piece_of_64_kib(tmp_path, at):
    content = np.random.default_rng(1).bytes(2 * PIECE + 5000)
    file = grown(
        tmp_path / "f.bin", content[:7], content[7:PIECE], content[PIECE : PIECE + 10], content[PIECE + 10 :]
    )
    assert (file.size, file.unsynced, len(file.pending)) == (len(content), True, 0)
    assert file.as_written_to() is None and file.whole_to() is None
    with (tmp_path / "f.bin").open("r+b") as other:
        other.seek(at)
        other.write(bytes([content[at] ^ 1]))
    assert file.as_written_to() == at // PIECE * PIECE and file.whole_to() is None
    file.sync()
    assert not file.unsynced
    file.close()
    assert file.closed
    file.close()


def test_a_file_that_was_cut_or_grew_is_told_once_and_goes_on_where_it_is_told(tmp_path):
    path = tmp_path / "f.bin"
    file = grown(path, b"0123456789")
    os.truncate(path, 6)
    assert file.whole_to() == 6 and file.whole_to() is None
    assert file.as_written_to() is None  # that was told
    os.truncate(path, 4)
    assert file.whole_to() == 4
    file.pending += b"ab"
    file.write()
    assert path.read_bytes() == b"0123" + bytes(6) + b"ab" and file.size == 12
    file.restart(3)
    assert (path.read_bytes(), file.size) == (b"012", 3) and file.whole_to() is None
    file.pending += b"xyz"
    file.write()
    assert path.read_bytes() == b"012xyz" and file.as_written_to() is None
    with path.open("ab") as other:
        other.write(b"!")
    assert file.whole_to() == 6


def test_bytes_that_the_disk_does_not_take_stay_for_the_next_time(tmp_path, monkeypatch):
    file = AppendFile(tmp_path / "f.bin")
    own = os.write
    monkeypatch.setattr(_events.os, "write", lambda fd, data: own(fd, data[:3]))
    file.pending += b"01234567"
    file.write()
    assert (tmp_path / "f.bin").read_bytes() == b"01234567"
    left = [4]

    def full(fd, data):
        content = bytes(data)
        data.release()
        if not left[0]:
            raise OSError(28, "No space left on device")
        size = own(fd, content[: left[0]])
        left[0] -= size
        return size

    monkeypatch.setattr(_events.os, "write", full)
    file.pending += b"abcdefgh"
    with pytest.raises(RecordError, match="cannot be recorded") as refused:
        file.write()
    assert refused.value.found == "No space left on device"
    assert bytes(file.pending) == b"efgh" and file.size == 12
    left[0] = 99
    file.write()
    assert (tmp_path / "f.bin").read_bytes() == b"01234567abcdefgh" and file.as_written_to() is None


def test_lines_of_an_event_log_are_read_with_their_types_and_a_torn_one_is_told(tmp_path):
    assert read_events(tmp_path).rows == ()
    log = EventLog(tmp_path)
    woken = []
    log.written_by(lambda: woken.append(log.file.size))
    log.event(1.5, Note("one"))
    assert woken == [0] and log.file.size == 0
    log.written_by(None)
    log.event(2.5, Outcome("completed", ""))
    log.close()
    with (tmp_path / "events.jsonl").open("ab") as file:
        file.write(b'{"torn')
    found = read_events(tmp_path)
    assert [line.time_s for line in found.lines] == [1.5, 2.5] and found.torn == '{"torn'
    assert found.of(Note) == [(1.5, Note("one"))] and len(found.rows) == 2
    with (tmp_path / "events.jsonl").open("ab") as file:
        file.write(b"\nmore\n")
    with pytest.raises(RecordError, match="event log is damaged") as refused:
        read_events(tmp_path)
    assert refused.value.where.endswith("events.jsonl, line 3") and refused.value.found.startswith(
        "b'{\"torn' ("
    )


def test_an_answer_at_the_very_time_of_its_question_comes_a_nanosecond_after_it(tmp_path):
    port = PortJournal(tmp_path, "p")
    port.sent(b"?", 1.0)
    port.received(b"!!", 1.0)  # virtual time stands still
    port.sent(b"??", 1.0 - 5e-7)  # another thread was half a microsecond earlier
    port.received(b"!", 2.0)
    assert port.pending_bytes == 6
    port.flush(sync=True)
    assert port.pending_bytes == 0
    received, sent = (
        np.fromfile(tmp_path / "raw" / name, "<i8").reshape(-1, 2).tolist()
        for name in ("p.idx", "p.sent.idx")
    )
    assert sent == [[1, 10**9], [3, 10**9 + 2]]
    assert received == [[2, 10**9 + 1], [3, 2 * 10**9]]
    assert [file.path.name for file in port.files] == ["p.bin", "p.idx", "p.sent.bin", "p.sent.idx"]
    exchanged = list(read_exchanges(tmp_path, "p"))
    assert [each[1:] for each in exchanged] == [
        ("sent", b"?"), ("received", b"!!"), ("sent", b"??"), ("received", b"!"),
    ]  # fmt: skip
    late = PortJournal(tmp_path / "late", "p")
    late.sent(b"?", 1.0)
    late.received(b"!", 1.0 - 2e-6)  # two microseconds are no tie
    late.flush(sync=False)
    assert read_marks(raw_path(tmp_path / "late", "p")).tolist() == [[1, 10**9 - 2000]]
    assert port.take_holes() == []
    port.compare()
    assert port.take_holes() == []


def test_marks_are_written_of_bytes_that_are(tmp_path, monkeypatch):
    direction = _Direction(tmp_path, "p")
    for size, time_s in ((3, 1.0), (4, 2.0), (5, 3.0)):
        direction.add(bytes(size), time_s, -(10**12))
    direction._unwritten_marks = array("q", [3, 1, 7, 2, 12, 3])
    for on_disk, whole in ((2, []), (3, [[3, 1]]), (11, [[3, 1], [7, 2]]), (12, [[3, 1], [7, 2], [12, 3]])):
        direction._write_marks(on_disk)
        assert np.fromfile(tmp_path / "p.idx", "<i8").reshape(-1, 2).tolist() == whole
    assert direction._last_mark.tolist() == [12, 3]


@pytest.mark.parametrize(("cut", "from_s"), [(12, None), (11, 2.0), (7, 2.0), (6, 1.0), (2, 0.0)])
def test_a_hole_is_told_with_the_time_of_the_last_mark_that_is_whole(tmp_path, cut, from_s):
    port = PortJournal(tmp_path, "p")
    for size, time_s in ((3, 1.0), (4, 2.0), (5, 3.0)):
        port.received(bytes(size), time_s)
    port.flush(sync=False)
    os.truncate(tmp_path / "raw" / "p.bin", cut)
    port.received(b"x", 4.0)
    port.flush(sync=False)
    holes = [(hole.file, hole.whole_bytes, hole.written_bytes, hole.from_s) for hole in port.take_holes()]
    assert holes == ([] if from_s is None else [("p.bin", cut, 12, from_s)]) and port.take_holes() == []
    assert len((tmp_path / "raw" / "p.bin").read_bytes()) == 13
    assert read_marks(raw_path(tmp_path, "p"))[-1].tolist() == [13, 4 * 10**9]


def test_a_journal_says_what_it_wrote_and_wakes_its_writer_for_a_megabyte(tmp_path, monkeypatch):
    journal = Journal(tmp_path, 0.5)
    one, two = journal.port("a"), journal.port("b")
    woken = []
    monkeypatch.setattr(journal._writer, "wake", lambda: woken.append(1))
    monkeypatch.setattr(journal, "_write", lambda: None)
    one.received(bytes((1 << 20) - 10), 1.0)
    journal.check()
    assert not woken
    two.sent(bytes(10), 1.0)
    journal.check()
    assert woken == [1]
    journal.close()
    assert journal.written == {
        "raw/a.bin": (1 << 20) - 10, "raw/a.idx": 16, "raw/a.sent.bin": 0, "raw/a.sent.idx": 0,
        "raw/b.bin": 0, "raw/b.idx": 0, "raw/b.sent.bin": 10, "raw/b.sent.idx": 16,
    }  # fmt: skip
    journal.close()
    assert all(file.closed for port in (one, two) for file in port.files)


def test_blocks_begin_where_the_stream_does(tmp_path):
    (tmp_path / "p.bin").write_bytes(bytes(range(100)))
    assert [len(block) for block in read_blocks(tmp_path / "p.bin", 30, 32)] == [32, 32, 6]
    assert b"".join(read_blocks(tmp_path / "p.bin", 30, 32)) == bytes(range(30, 100))
    assert list(read_blocks(tmp_path / "none.bin")) == []


@pytest.mark.parametrize("rows", [1, 2, 3, 65536])
def test_an_index_may_go_back_by_a_tie_and_be_silent_for_a_month(tmp_path, rows):
    month = 30 * 86_400 * 10**9
    good = np.array([[0, 5], [4, 1000], [4, 0], [9, month], [12, 2 * month]], np.int64)
    _check_order(tmp_path / "p.idx", good, rows)
    for row, column, value, pair in (
        (2, 1, -1, 3),
        (3, 0, 3, 4),
        (3, 1, month + 1, 4),
        (4, 1, 2 * month + 1, 5),
    ):
        bad = good.copy()
        bad[row, column] = value
        with pytest.raises(RecordError, match=rf"p\.idx, pair {pair}:"):
            _check_order(tmp_path / "p.idx", bad, rows)
    with pytest.raises(RecordError, match="pair 1"):
        _check_order(tmp_path / "p.idx", np.array([[-1, 0]]), rows)


def test_first_arrivals_are_of_frames_that_a_mark_ends_with():
    """Frames of 10 bytes; marks within the third, at its end, and 25 bytes behind the sixth."""
    ends = np.array([10, 20, 30, 40, 50, 60])
    marks = np.array([[5, 1], [10, 2], [25, 3], [30, 4], [34, 5], [85, 6], [99, 7]]) * [1, 10**9]
    frame, arrival_s, done = first_arrivals(marks, 0, ends)
    assert frame.tolist() == [0, 1, 2] and arrival_s.tolist() == [2.0, 3.0, 4.0] and done == 5
    more, later_s, done = first_arrivals(marks, 5, np.array([70, 80, 90]))
    assert (more.tolist(), later_s.tolist(), done) == ([1], [6.0], 6)
    far = np.array([[30, 1], [79, 2], [80, 3], [81, 4]]) * [1, 10**9]
    frame, arrival_s, _ = first_arrivals(far, 0, np.array([10, 20, 30, 40, 50, 60, 100]))
    assert frame.tolist() == [2, 5] and arrival_s.tolist() == [1.0, 2.0]  # 19 bytes behind are near
    frame, _, _ = first_arrivals(far[2:], 0, np.array([10, 20, 30, 40, 50, 59, 100]))
    assert frame.tolist() == []  # 21 bytes are more than two frames


def test_units_have_spans_without_power():
    lines = [
        (1.0, Note("x")),
        (2.0, UnitsOn()),
        (3.0, UnitsOff()),
        (4.0, UnitsOn()),
        (5.0, UnitsOff()),
        (6.0, UnitsOff()),
    ]
    found = units_off_s(Line(time_s, event) for time_s, event in lines)
    assert found == [(3.0, 4.0), (5.0, math.inf), (6.0, math.inf)]


def test_a_table_counts_what_was_lost_what_came_twice_and_what_is_not_valid(tmp_path, fake):
    counters = [*range(50), *range(53, 90), 89, 89, *range(90, 200)]
    port = PortJournal(tmp_path, "fog")
    sample = 0
    for number, counter in enumerate(counters):
        sample = counter
        port.received(fake.encode(counter % 128, float(number)), 2.0 + 0.01 * sample)
    port.flush(sync=False)
    report = decode_stream(tmp_path, fake.source())
    assert (report.frames, report.lost, report.duplicates, report.off) == (len(counters), 3, 2, 0)
    assert report.bytes_received == 7 * len(counters) and report.bytes_skipped == 0
    table = read_table(tmp_path / "gyro_fog.parquet")
    assert table["counter"].tolist() == counters and report.invalid == int((~table["valid"]).sum()) >= 2
    assert np.flatnonzero(table["lost_before"]).tolist() == [50] and table["lost_before"][50] == 3
    assert np.diff(table["time_ns"])[[10, 49]] == pytest.approx([1e7, 4e7], rel=1e-3)
    assert report.sample_rate_hz == pytest.approx(100.0, rel=1e-5) and abs(report.clock_error_ppm) < 10.0
    empty = decode_instrument(
        tmp_path, "fog", "table", lambda exchanges: ({"time_ns": np.zeros(0, np.int64)}, {"bad": 3})
    )
    assert empty == {"bad": 3} and not (tmp_path / "table.parquet").exists()


def test_a_counter_is_unwrapped_from_its_first_value_on():
    unwrap = Unwrapper(10)
    count, step = unwrap.feed(np.array([7, 9, 2, 2]))
    assert (count.tolist(), step.tolist()) == ([7, 9, 12, 12], [0, 2, 3, 0])
    count, step = unwrap.feed(np.array([1, 5]))
    assert (count.tolist(), step.tolist()) == ([21, 25], [9, 4])
    assert unwrap.feed(np.zeros(0, np.int64))[0].tolist() == []


def test_corrections_count_from_their_frame_on():
    timing = StreamTiming(2.0, 0.01, 1.0, np.array([[5, 100], [8, -3]]), 100.0, 0.0, 0.0)
    count = np.arange(10)
    assert timing.corrected(count, 0).tolist() == [0, 1, 2, 3, 4, 105, 106, 107, 105, 106]
    assert timing.corrected(count[:3], 6).tolist() == [100, 101, 99]
    assert timing.time_ns(np.array([0, 7])).tolist() == [2 * 10**9, 2_070_000_000]
    plain = StreamTiming(0.0, 1.0, 1.0, np.zeros((0, 2), np.int64), 1.0, 0.0, 0.0)
    assert plain.corrected(count, 3) is count


def test_jumps_of_lateness_are_whole_wraps_or_a_new_count():
    """A count of 0.01 s, a wrap of a hundred: jumps by two wraps, by 0.7 s, by a wrap that nobody suspected."""
    count = 10 * np.arange(60)
    late = np.zeros(60)
    late[10:] += 2.0 + 0.05
    late[20:] += 0.7
    late[30:] += 1.0
    suspect = np.full(60, -1)
    suspect[[10, 20, 40]] = (101, 0, 401)
    extra, restarts = _resolve_jumps(count, 5.0 + 0.01 * count + late, suspect, 0.01, 100)
    assert extra.tolist() == [200 if k == 10 else 70 if k == 20 else 0 for k in range(60)] and restarts == 1
    early = np.where(np.arange(60) >= 40, -0.3, 0.0)
    extra, restarts = _resolve_jumps(count, 5.0 + 0.01 * count + early, suspect, 0.01, 100)
    assert np.flatnonzero(extra).tolist() == [40] and extra[40] == -30 and restarts == 1
    passing = np.where(np.arange(60) == 40, 0.3, 0.0)
    assert _resolve_jumps(count, 5.0 + 0.01 * count + passing, suspect, 0.01, 100)[1] == 0
    assert _rough_period_s(count, 5.0 + 0.01 * count + late, suspect, 1.0) == pytest.approx(0.01)
    assert _rough_period_s(count[:1], np.zeros(1), suspect[:1], 0.5) == 0.5
    assert (
        _rough_period_s(np.array([0, 10, 30]), np.array([0.0, 1.0, 9.0]), np.array([-1, -1, 5]), 0.5) == 0.1
    )


def test_windows_stay_moved_by_what_the_least_late_of_either_side_differ():
    late = np.array([9.0, 1.0, 3.0, 2.0, 7.0, 6.0, 0.0])
    borders = np.array([0, 3, 6])
    assert _stays_moved_s(late, borders, 3) == 2.0 - 1.0
    assert _stays_moved_s(late, borders, 6) == 0.0 - 2.0 and _stays_moved_s(late, borders, 0) == 0.0
    long = np.concatenate(([-5.0], np.zeros(8), np.ones(8), [-7.0]))
    assert _stays_moved_s(long, np.array([9]), 9) == 1.0  # eight windows of either side


def timer_of(arrival_s, counter, *, modulo=1000, rate_hz=100.0):
    timer = StreamTimer(modulo, 1, rate_hz)
    ends = 8 * np.arange(1, len(counter) + 1)
    marks = np.column_stack((ends, np.rint(np.asarray(arrival_s) * 1e9).astype(np.int64)))
    timer.feed(np.asarray(counter), ends, marks)
    return timer


@pytest.mark.parametrize(("late_s", "told"), [(0.045, False), (0.06, True)])
def test_data_that_are_held_up_are_told_beyond_a_twentieth_of_a_second(late_s, told):
    count = np.arange(3000)
    arrival = 0.01 * count + np.where(count >= 1500, late_s, 0.0)
    fit = timer_of(arrival, count % 1000).fit(0.004)
    assert any("later than the counter says" in text for text in fit.warnings) is told
    still = timer_of(0.01 * count, count % 1000).fit(0.004)
    assert still.start_s == pytest.approx(-0.004, abs=1e-9) and still.residual_s == pytest.approx(
        0.0, abs=1e-9
    )
    with pytest.raises(ProtocolError, match="no frame of the stream has an arrival time"):
        StreamTimer(1000, 1, 100.0).fit()


def test_who_acted_is_told_once_for_each_thing_with_the_role_signed_in_as():
    asked = [Requested(action, by="a", utc=START, role="run") for action in ("pause", "pause", "other")]
    events = [
        Started(by="a", role="run"), Answer("q", "yes", by="b"), *asked,
        Requested("resume", by="a", utc=START), Note("x"), Requested("abort", by="b", utc=START),
    ]  # fmt: skip
    found = {(entry.name, entry.role): entry.did for entry in operators_of(events)}
    assert found == {
        ("a", "run"): ("started", "paused"),
        ("b", None): ("answered", "aborted"),
        ("a", None): ("resumed",),
    }
    known = (OperatorEntry(name="b", did=("started",)),)
    assert operators_of(events[1:2], known)[0].did == ("started", "answered")


def test_a_seal_is_of_the_manifests_own_bytes(tmp_path):
    write_manifest(tmp_path, manifest())
    assert seal_state(tmp_path, read_manifest(tmp_path)) == "none"
    (tmp_path / "raw").mkdir()
    (tmp_path / "raw" / "p.bin").write_bytes(b"abc")
    (tmp_path / "watchdog" / "deep").mkdir(parents=True)
    (tmp_path / "watchdog" / "deep" / "w.txt").write_text("w")
    (tmp_path / "notes.jsonl").write_text("{}")
    (tmp_path / "truth_x.npz").write_bytes(b"t")
    sealed = seal(tmp_path, manifest(), outcome="completed", duration_s=3.0)
    assert sorted(sealed.files) == ["raw/p.bin", "truth_x.npz", "watchdog/deep/w.txt"]
    assert [path.name for path in own_files(tmp_path)] == ["p.bin", "truth_x.npz", "w.txt"]
    assert (
        sealed.files["raw/p.bin"] == checksum(tmp_path / "raw" / "p.bin")
        and sealed.files["raw/p.bin"].bytes == 3
    )
    assert seal_state(tmp_path, sealed) == "whole"
    text = (tmp_path / "manifest.json").read_text()
    (tmp_path / "manifest.json").write_text(text.replace("3.0", "4.0"))
    assert seal_state(tmp_path, read_manifest(tmp_path)) == "broken"
    with pytest.raises(RecordError, match="a running run cannot be sealed"):
        seal(tmp_path, manifest())
    assert _grown(tmp_path, sealed.files) == ""
    (tmp_path / "truth_x.npz").write_bytes(b"tt")
    (tmp_path / "raw" / "p.bin").write_bytes(b"abcd")
    assert _grown(tmp_path, sealed.files) == "raw/p.bin"
    for name in ("../r", "a/b", "", "."):
        with pytest.raises(ValueError, match="validation error"):
            manifest(run_id=name)


def test_events_and_manifest_say_the_same_end(tmp_path):
    def problems(events, **ending):
        folder = tmp_path / f"r{len(list(tmp_path.iterdir()))}"
        folder.mkdir()
        log = EventLog(folder)
        for event in events:
            log.event(1.0, event)
        log.close()
        seal(folder, manifest(), **ending)
        return [problem.text for problem in verify(folder, lambda *_: None).problems]

    done = Outcome("completed", "")
    assert problems([done], outcome="completed") == []
    assert problems([Outcome("invalid", "r"), done], outcome="completed") == []
    assert problems([done], outcome="completed", reason="x") == [
        "its outcome or reason is not that of the events"
    ]
    assert problems([], outcome="completed") == ["its outcome or reason is not that of the events"]
    assert problems([], outcome="aborted") == []
    assert problems([ODD, done], outcome="completed") == ["says completed, the events do not"]
    assert problems([ODD, Outcome("invalid", "")], outcome="invalid") == []
    assert problems([Outcome("invalid", "")], outcome="invalid") == ["says invalid, the events do not"]
    assert problems([ODD, Outcome("aborted", "")], outcome="aborted") == []


ODD = Invalid("odd", "Odd.", {})


def table(path, **columns):
    with table_writer(path, "t") as writer:
        writer.write({name: np.asarray(values) for name, values in columns.items()})
    return path


def test_tables_differ_by_columns_rows_types_or_bits(tmp_path):
    base = table(tmp_path / "a.parquet", time_ns=np.arange(3), x=[0.0, 1.0, 2.0])
    same = table(tmp_path / "b.parquet", time_ns=np.arange(3), x=[0.0, 1.0, 2.0])
    assert _compare_tables(base, same) == ""
    other = table(tmp_path / "c.parquet", time_ns=np.arange(3), x=[0.0, 1.0, 2.0], y=[1, 2, 3])
    assert _compare_tables(base, other) == "has columns ['time_ns', 'x'], rebuilt ['time_ns', 'x', 'y']"
    short = table(tmp_path / "d.parquet", time_ns=np.arange(2), x=[0.0, 1.0])
    assert _compare_tables(base, short) == "has 3 rows, rebuilt 2"
    single = table(tmp_path / "e.parquet", time_ns=np.arange(3), x=np.array([0, 1, 2], np.float32))
    assert _compare_tables(base, single) == "x is float64, rebuilt float32"
    minus = table(tmp_path / "f.parquet", time_ns=np.arange(3), x=[0.0, 1.0, -2.0])
    assert _compare_tables(base, minus) == "x differs from row 2 on: 2.0, rebuilt -2.0"
    assert _compare_tables(
        base, table(tmp_path / "g.parquet", time_ns=np.arange(3), x=[-0.0, 1.0, 2.0])
    ).startswith("x differs from row 0")
    assert _compare_tables(tmp_path / "none", base) == "missing: the raw bytes give this table"
    assert _compare_tables(base, tmp_path / "none") == "cannot be rebuilt: the raw bytes hold nothing for it"
    count = 150_000
    values = np.arange(float(count))
    late = values.copy()
    late[140_000] += 1.0
    long = [
        table(tmp_path / f"l{k}.parquet", time_ns=np.arange(count), x=own)
        for k, own in enumerate((values, late))
    ]
    assert _compare_tables(*long) == "x differs from row 140000 on: 140000.0, rebuilt 140001.0"


def test_row_groups_that_lie_inside_a_stretch_need_no_times(tmp_path):
    import pyarrow.parquet as pq

    count = 2 * ROW_GROUP + 100
    path = table(tmp_path / "t.parquet", time_ns=10 * np.arange(count), x=np.arange(count))
    with pq.ParquetFile(path) as file:
        assert file.metadata.num_row_groups == 3
        edge = 10 * ROW_GROUP
        for low, high, groups, inside in (
            (0, 10 * count, [0, 1, 2], True), (1, 10 * count, [0, 1, 2], False), (edge, 2 * edge, [1], True),
            (edge, 2 * edge - 10, [1], False), (edge - 10, 2 * edge, [0, 1], False),
            (edge, 2 * edge + 1, [1, 2], False),
            (2 * edge, 10 * count, [2], True), (10 * count, 11 * count, [], True), (-5, 0, [], True),
        ):  # fmt: skip
            assert _overlapping(file, low, high) == (groups, inside), (low, high)
    found = read_table(path, ["x"], 1e-9 * 100.0, 1e-9 * 200.0)
    assert list(found) == ["x"] and found["x"].tolist() == list(range(10, 20))


def test_units_of_columns_are_their_endings_and_seconds_have_their_end():
    names = ("time_ns", "rate_dps", "x_mps2", "angle_deg", "air_temp_c", "out_v", "in_a", "counter")
    assert [unit_of(name) for name in names] == ["ns", "deg/s", "m/s2", "deg", "degC", "V", "A", "1"]
    rows = {"time_ns": np.array([0, 1, 10**9, 10**9 + 1, 3 * 10**9, -1])}
    assert second_rows(rows, 0).tolist() == [-1, 0, 0, 1, 2, -1] and second_rows(rows, 2).tolist()[4] == 0
    assert seconds(rows)[[2, 4]].tolist() == [1.0, 3.0]
    assert names_at([1.0, 2.0], ["a", "b"], np.array([0.0, 1.0, 1.9, 2.0, 9.0])).tolist() == [
        "a",
        "a",
        "a",
        "b",
        "b",
    ]


def test_a_table_is_named_by_its_device():
    class Tables(Framed):
        tables, place = ("chamber", "gyro_fog", "logger_a_b"), "runs/r"

        def _table(self, name, columns, start_s, end_s):
            return {"time_ns": np.array([1]), "name": np.array([len(name)])}

    for device, name in (
        ("chamber", "chamber"),
        ("fog", "gyro_fog"),
        ("gyro_fog", "gyro_fog"),
        ("a_b", "logger_a_b"),
    ):
        assert Tables().to_arrow(device)["name"].to_pylist() == [len(f"{name}.parquet")]
    with pytest.raises(RecordError, match="no table of 'b'") as refused:
        Tables().to_arrow("b")
    assert refused.value.found == "chamber, fog, a_b"


def test_a_run_with_a_pipe_in_it_is_not_opened_and_copies_are_told_by_what_changes(tmp_path):
    folder = tmp_path / "run"
    (folder / "raw").mkdir(parents=True)
    write_manifest(folder, manifest())
    (folder / "gone").symlink_to(tmp_path / "nowhere")
    assert Run.open(folder).place == folder
    os.mkfifo(folder / "raw" / "pipe")
    assert stat.S_ISFIFO((folder / "raw" / "pipe").stat().st_mode)
    with pytest.raises(RecordError, match="a run folder holds files only"):
        Run.open(folder)
    states = [
        _remote._state(entry)
        for entry in ({"size": 3, "ETag": "x"}, {"size": 3, "ETag": "y"}, {"size": 4, "ETag": "x"})
    ]
    assert len(set(states)) == 3


def test_the_cache_is_where_it_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv("GYROBENCH_CACHE", str(tmp_path / "own"))
    one, two = _remote._cache("s3://a/runs"), _remote._cache("s3://b/runs")
    assert one != two and one.parent == tmp_path / "own" / "runs" and len(one.name) == 20
    monkeypatch.delenv("GYROBENCH_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert _remote._cache("s3://a/runs").parent == tmp_path / "xdg" / "gyrobench" / "runs"


def test_phases_end_where_the_next_begins_and_true_means_lie_between_whole_seconds(tmp_path):
    write_manifest(tmp_path, manifest())
    np.savez(tmp_path / "truth_fog.npz", bias=np.arange(6.0) ** 2)
    run = Run.open(tmp_path)
    assert run.phases() == () and run.true_means("fog", "none", 0, 2) is None
    assert run.true_means("fog", "bias", 1, 4).tolist() == [2.5, 6.5, 12.5]
    assert run.true_means("fog", "bias", 1, 5).tolist() == [2.5, 6.5, 12.5, 20.5]
    assert run.true_means("fog", "bias", 1, 6) is None and run.complete is False
    assert SimpleNamespace(**run.shown()).run == "r1" and run.tables == () and run.gyros == ()
