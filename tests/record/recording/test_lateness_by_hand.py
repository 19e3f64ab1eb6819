"""Arrivals that are early or late by hand, and files of a run that lack what was written."""

from __future__ import annotations

import math
import os
from types import SimpleNamespace

import numpy as np
import pytest

from bench.record.events.run import UnitsOff, UnitsOn
from bench.record.recording import PortJournal, _decode, _events
from bench.record.recording._decode import read_arrivals, units_off_s
from bench.record.recording._events import AppendFile, Line
from bench.record.recording._journal import _Direction
from bench.record.recording._manifest import FileEntry
from bench.record.recording._raw import first_arrivals, raw_path, read_marks
from bench.record.recording._timing import StreamTimer, _resolve_jumps, _rough_period_s, _stays_moved_s
from bench.record.recording._verify import _compare_raw
from drivers.base.errors import RecordError


def timer_of(arrival_s, counter, *, modulo=1000, rate_hz=100.0, block=10**6):
    timer = StreamTimer(modulo, 1, rate_hz)
    counter, arrival_s = np.asarray(counter), np.asarray(arrival_s)
    ends = 8 * np.arange(1, len(counter) + 1)
    known = np.isfinite(arrival_s)
    marks = np.column_stack((ends[known], np.rint(arrival_s[known] * 1e9).astype(np.int64)))
    for at in range(0, len(counter), block):
        timer.feed(counter[at : at + block], ends[at : at + block], marks)
    return timer


def restarts(timer, late_s, arrival_s):
    return np.flatnonzero(timer._restarted(np.array(late_s), np.array(arrival_s))).tolist()


def test_a_frame_is_of_a_new_count_if_it_is_a_quarter_second_and_a_fiftieth_of_the_silence_early():
    """After ten seconds of silence a clock of two percent may be 0.2 s off: 0.45 s early are too early."""
    for silence_s, early_s, found in (
        (0.01, 0.24, []),
        (0.01, 0.26, [3]),
        (10.0, 0.44, []),
        (10.0, 0.46, [3]),
        (100.0, 2.24, []),
        (100.0, 2.26, [3]),
    ):
        late, arrival = [0.1, 0.0, 0.05, -early_s], [5.0, 5.01, 5.02, 5.02 + silence_s]
        assert restarts(StreamTimer(1000, 1, 100.0), late, arrival) == found, (silence_s, early_s)
        # the same where the silence lies between two batches
        timer = StreamTimer(1000, 1, 100.0)
        assert restarts(timer, late[:3], arrival[:3]) == []
        timer._late_s = late[2]
        assert restarts(timer, late[3:], arrival[3:]) == [at - 3 for at in found]


def test_data_that_catch_up_are_no_new_count_and_each_new_count_begins_its_own_floor():
    timer = StreamTimer(1000, 1, 100.0)
    assert restarts(timer, [0.0, 5.0, 5.0, 0.01, -0.24], [1.0, 6.1, 6.2, 6.3, 6.4]) == []
    # once a count is new it is in time, however early; and then the next is early against it
    timer = StreamTimer(1000, 1, 100.0)
    late, arrival = [0.0, -1.0, -1.0, -0.5, -1.0, -1.6, -1.6], 1.0 + 0.01 * np.arange(7)
    assert restarts(timer, late, arrival) == [1, 5]
    # of eight earlier windows the least late one says how early is possible
    timer = StreamTimer(1000, 1, 100.0)
    for number, floor in enumerate((-3.0, *[0.0] * 7)):
        restarts(timer, [floor], [float(number)])
        timer._late_s = floor
    timer._late_s = 0.0
    assert restarts(timer, [-3.1], [8.0]) == []
    timer._late_s = 0.0
    for number in range(8):
        restarts(timer, [0.0], [9.0 + number])
    assert restarts(timer, [-3.1], [17.0]) == [0]


@pytest.mark.parametrize(("rate_hz", "late_s", "told"), [
    (10.0, 0.15, False), (10.0, 0.25, True), (100.0, 0.045, False), (100.0, 0.06, True), (1000.0, 0.045, False),
])  # fmt: skip
def test_lateness_is_told_beyond_two_samples_and_a_twentieth_of_a_second(rate_hz, late_s, told):
    found = StreamTimer(1000, 1, rate_hz)._warnings(rate_hz, late_s, 0, 1000.0)
    assert [text.split(" later")[0] for text in found] == (
        [f"arrivals are up to {late_s:.3f} s"] if told else []
    )


@pytest.mark.parametrize(("off", "span_s", "told"), [
    (0.0009, 1e6, False), (0.0011, 1e6, True), (-0.0011, 1e6, True), (0.0019, 20.0, False), (0.0021, 20.0, True),
    (0.021, 0.0, True), (0.019, 0.0, False),
])  # fmt: skip
def test_a_clock_is_told_off_by_a_thousandth_if_the_record_is_long_enough_to_know(off, span_s, told):
    """Arrivals of 2 ms scatter at 100 Hz: what is off must show as 0.04 s over the record."""
    found = StreamTimer(1000, 1, 100.0)._warnings(100.0 * (1.0 + off), 0.002, 0, span_s)
    assert bool(found) is told
    if told:
        assert f"{100.0 * (1 + off):.3f} Hz, not the nominal 100 Hz ({off:+.2%})" in found[0]


def test_a_window_keeps_the_least_late_arrival_of_each_second():
    late = np.array([0.3, 0.1, 0.2, 0.1, 0.4, 0.05, 0.5, 0.2])
    at = np.array([0.0, 0.2, 0.4, 0.6, 1.1, 1.3, 2.2, 2.9])
    count = np.rint(100.0 * at).astype(int)
    timer = timer_of(count / 100.0 + late, count % 1000)
    found = {int(c): round(float(a), 6) for c, a in zip(timer._counts[0], timer._arrivals[0], strict=True)}
    windows = {}
    for c, a, own in zip(count, count / 100.0 + late, late, strict=True):
        best = windows.get(math.floor(a))
        if best is None or own < best[2]:
            windows[math.floor(a)] = (int(c), round(float(a), 6), own)
    assert found == {c: a for c, a, _ in windows.values()}
    assert all((part == -1).all() for part in timer._suspects)


@pytest.mark.parametrize("block", [7, 10, 13, 100])
def test_what_was_lost_lies_before_the_frame_whose_counter_stepped_most(block):
    """Of frames that arrived together the sixth stepped by 40, one of the others by 3; a wrap was lost."""
    counter = np.concatenate((np.arange(45), 40 + np.arange(45, 90)))
    counter[30:] += 3
    counter = counter % 100
    arrival = np.full(90, np.nan)
    arrival[[9, 19, 24, 59, 69, 79, 89]] = 0.01 * np.array(
        [9, 19, 24, 59 + 143, 69 + 143, 79 + 143, 89 + 143]
    )
    timer = timer_of(arrival, counter, modulo=100, block=block)
    suspects = np.concatenate(timer._suspects)
    assert suspects[suspects >= 0].tolist() == [45]


def test_a_slope_is_of_windows_that_count_on():
    count = np.array([0, 10, 10, 20, 40])
    arrival = np.array([0.0, 1.0, 1.5, 2.5, 9.0])
    suspect = np.array([-1, -1, -1, -1, 7])
    assert _rough_period_s(count, arrival, suspect, 0.5) == pytest.approx(0.1)
    assert _rough_period_s(count[1:3], arrival[1:3], suspect[1:3], 0.5) == 0.5


def test_of_two_frames_nobody_knows_how_long_one_is():
    marks = np.array([[10, 1], [100, 2]]) * [1, 10**9]
    frame, arrival_s, done = first_arrivals(marks, 0, np.array([10, 20]))
    assert (frame.tolist(), arrival_s.tolist(), done) == ([0], [1.0], 1)
    far = np.array([[5, 1], [19, 2]]) * [1, 10**9]
    assert first_arrivals(far, 0, np.array([4, 20]))[0].tolist() == [0]
    assert first_arrivals(np.array([[19, 10**9]]), 0, np.array([1, 2, 3, 20]))[0].tolist() == []
    assert first_arrivals(np.array([[19, 10**9]]), 0, np.array([3, 20]))[0].tolist() == [0]


def test_an_index_without_its_file_has_no_marks(tmp_path):
    np.array([[0, 5], [1, 9]], "<i8").tofile(tmp_path / "p.idx")
    assert read_marks(tmp_path / "p.bin").tolist() == [[0, 5]]
    (tmp_path / "p.bin").write_bytes(b"x")
    assert read_marks(tmp_path / "p.bin").tolist() == [[0, 5], [1, 9]]


def test_every_span_without_power_ends_where_its_own_units_come_on():
    lines = [(2.0, UnitsOff()), (3.0, UnitsOn()), (5.0, UnitsOff()), (7.0, UnitsOn()), (8.0, UnitsOff())]
    found = units_off_s(Line(time_s, event) for time_s, event in lines)
    assert found == [(2.0, 3.0), (5.0, 7.0), (8.0, math.inf)]


def test_raw_files_are_held_against_what_was_written_and_against_their_index(tmp_path):
    port = PortJournal(tmp_path, "p")
    for size, time_s in ((3, 1.25), (4, 2.5), (5, 3.75)):
        port.received(bytes(size), time_s)
    port.flush(sync=False)

    def problems(**written):
        manifest = SimpleNamespace(
            written={f"raw/{name}.bin": count for name, count in written.items()},
            files={"raw/p.bin": FileEntry(bytes=12, sha256="0" * 64)},
        )
        return [(each.path, each.text) for each in _compare_raw(tmp_path, manifest)]

    assert problems(p=12, q=3) == []
    assert problems(p=13) == [("raw/p.bin", "has 12 bytes; 13 were written")]
    os.truncate(raw_path(tmp_path, "p"), 9)
    assert problems(p=12) == [("raw/p.bin", "lacks 3 bytes that its index has: nothing from 2.500 s on")]
    os.truncate(raw_path(tmp_path, "p"), 2)
    assert problems(p=12) == [("raw/p.bin", "lacks 10 bytes that its index has: nothing from 0.000 s on")]


def test_a_file_that_was_deleted_or_could_not_be_synced_is_told_and_stays_unsynced(tmp_path, monkeypatch):
    file = AppendFile(tmp_path / "f")
    file.pending += b"abc"
    file.write()
    with (tmp_path / "f").open("ab") as other:
        other.write(bytes(1 << 17))
    assert file.as_written_to() is None  # what was written is as it was

    def fails(descriptor):
        raise OSError(5, "no")

    monkeypatch.setattr(_events, "sync_data", fails)
    with pytest.raises(OSError, match="no"):
        file.sync()
    assert file.unsynced
    monkeypatch.undo()
    file.sync()
    assert not file.unsynced
    (tmp_path / "f").unlink()
    file.pending += b"d"
    with pytest.raises(RecordError, match="cannot be recorded") as refused:
        file.write()
    assert refused.value.found == "the file was deleted while it was being written"
    assert isinstance(refused.value.__cause__, FileNotFoundError) and refused.value.__cause__.errno == 2
    assert not file.pending and file.size == 4


def test_a_hole_in_a_folder_whose_index_is_gone_is_told_without_a_time(tmp_path):
    port = PortJournal(tmp_path, "p")
    port.received(b"0123456789", 4.0)
    port.flush(sync=False)
    (tmp_path / "raw" / "p.idx").unlink()
    os.truncate(tmp_path / "raw" / "p.bin", 10)
    direction = port._received
    direction._add_hole(direction.data, 10, 12)
    assert [(hole.file, hole.from_s) for hole in port.take_holes()] == [("p.bin", 0.0)]


def test_arrivals_of_a_counter_that_steps_by_more_have_the_length_of_a_count(tmp_path, monkeypatch):
    """100 samples a second, five counts a sample: a count is two milliseconds."""
    port = PortJournal(tmp_path, "p")
    for number in range(4):
        port.received(bytes(8), 1.0 + number)
    port.flush(sync=False)
    batch = SimpleNamespace(columns={"counter": np.array([90, 95, 0, 5])}, end_offset=8 * np.arange(1, 5))
    monkeypatch.setattr(_decode, "_batches", lambda path, source, decoder: [batch])
    decoder = SimpleNamespace(counter_modulo=100, nominal_rate_hz=100.0, counter_step=5)
    found = read_arrivals(tmp_path, SimpleNamespace(name="p", decoder=lambda: decoder))
    assert found.count_s == pytest.approx(0.002)
    assert (found.count.tolist(), found.arrival_s.tolist()) == ([90, 95, 100, 105], [1.0, 2.0, 3.0, 4.0])


def test_marks_that_the_disk_did_not_take_are_written_though_nothing_more_comes(tmp_path, monkeypatch):
    direction = _Direction(tmp_path, "p")
    direction.add(b"abc", 1.0, -(10**12))
    write = direction.index.write
    monkeypatch.setattr(direction.index, "write", lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        direction.write()
    assert (tmp_path / "p.bin").read_bytes() == b"abc" and not (tmp_path / "p.idx").read_bytes()
    monkeypatch.setattr(direction.index, "write", write)
    direction.write()
    assert np.fromfile(tmp_path / "p.idx", "<i8").tolist() == [3, 10**9]


def test_windows_from_the_first_on_are_before_a_move():
    assert _stays_moved_s(np.array([-2.0, 3.0, 1.0]), np.array([2]), 2) == 3.0
    assert _stays_moved_s(np.array([-2.0, 3.0, 1.0]), np.array([1]), 1) == 3.0


def test_of_a_short_wrap_a_fiftieth_of_a_second_is_still_a_whole_one():
    """A wrap of 0.1 s: arrivals that stay 0.215 s later lost two wraps; with 0.23 s the counter began anew."""
    count = np.arange(0, 300, 10)
    for moved_s, lost, restarted in ((0.215, 20, 0), (0.23, 23, 1)):
        arrival = 5.0 + 0.01 * count + np.where(count >= 150, moved_s, 0.0)
        suspect = np.where(count == 150, 150, -1)
        extra, restarts = _resolve_jumps(count, arrival, suspect, 0.01, 10)
        assert (np.flatnonzero(extra).tolist(), int(extra.sum()), restarts) == ([15], lost, restarted)
