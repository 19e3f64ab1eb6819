"""Damaged streams through the whole bench: checksum errors, lost frames, a gyro clock that is 1 % off."""

import numpy as np
import pytest

from bench.lab.emulated import Plant, load_plant
from bench.record.recording import Run, read_exchanges, read_manifest
from drivers.base.errors import ConfigurationError
from simulators.interfaces import StreamBlock

FRAME_BYTES = 36
"""A Format A message of the KVH 1750 (56-0298, table 8)."""


class Damaging:
    """Stands between an emulator and its port and does to the stream what `damage` says."""

    def __init__(self, emulator, damage):
        self._emulator = emulator
        self._damage = damage

    def receive(self, data, now_s):
        return self._emulator.receive(data, now_s)

    def stream(self, until_s):
        block = self._emulator.stream(until_s)
        if block is None or len(block.data) != 100 * FRAME_BYTES:
            return block
        return self._damage(block)


def damaged(bench, fog_file, runs, damage, **parameters):
    swap = {"fog_1": lambda emulator, lab, index: Damaging(emulator, damage)}
    with bench.lab(fog_file, Plant(seed=5, delivery_s=1.0), swap) as lab:
        return bench.drive(lab.file, runs, **parameters)


def test_flipped_bytes_are_rejected_counted_and_leave_marked_gaps(bench, fog_file, tmp_path):
    hit = []

    def flip(block):
        """Flip one bit in one payload byte of frame 50 of every second."""
        data = bytearray(block.data)
        data[50 * FRAME_BYTES + 9] ^= 0x10
        hit.append(1)
        return StreamBlock(bytes(data), block.marks)

    result = damaged(bench, fog_file, tmp_path, flip, hold_s=30.0)
    assert result.outcome == "completed"
    stream = read_manifest(result.folder).stream["fog_1"]
    assert len(hit) >= 30
    assert stream["rejected"] == {"checksum": len(hit)}
    assert stream["lost"] == len(hit)
    lost = Run.open(result.folder).gyro("fog_1", ("lost_before",))["lost_before"]
    assert np.count_nonzero(lost) == len(hit) and lost.max() == 1
    # The gap is where the damage was: 100 frames apart.
    assert set(np.diff(np.flatnonzero(lost)).tolist()) == {99}
    assert any("rejected" in text and "checksum" in text for text in result.warnings), result.warnings
    assert bench.problems(result.folder) == []


def test_lost_frames_are_counted_and_marked_and_times_stay_right(bench, fog_file, tmp_path):
    seconds = []

    def drop(block):
        """In the 10th second drop frames 20..26, in the 12th 90 bytes out of the middle of frames 40..42."""
        seconds.append(1)
        data, n = block.data, len(seconds)
        if n == 10:
            data = data[: 20 * FRAME_BYTES] + data[27 * FRAME_BYTES :]
        elif n == 12:
            data = data[: 40 * FRAME_BYTES + 11] + data[42 * FRAME_BYTES + 29 :]
        missing = len(block.data) - len(data)
        if not missing:
            return block
        marks = block.marks.copy()
        marks[:, 0] = np.maximum(marks[:, 0] - missing, 1)
        return StreamBlock(data, marks[-1:])

    result = damaged(bench, fog_file, tmp_path, drop, hold_s=30.0)
    assert result.outcome == "completed"
    table = Run.open(result.folder).gyro("fog_1", ("time_ns", "lost_before"))
    gaps = table["lost_before"][table["lost_before"] > 0].tolist()
    assert gaps == [7, 3]
    assert read_manifest(result.folder).stream["fog_1"]["lost"] == 10
    assert "fog_1: 10 frames lost (marked in the table)" in result.warnings
    # Every sample keeps its place on the 10 ms grid across the gaps.
    steps = np.diff(table["time_ns"]) / 1e7
    assert np.abs(steps - (1 + table["lost_before"][1:])).max() < 1e-3


@pytest.mark.parametrize("error_ppm", [10_000.0, -10_000.0])
def test_a_gyro_clock_one_percent_off_is_measured_and_taken_out(bench, both_file, tmp_path, error_ppm):
    plant = Plant(seed=5, clock_error_ppm={"fog_1": error_ppm, "can_1": error_ppm})
    with bench.lab(both_file, plant) as lab:
        result = bench.drive(lab.file, tmp_path, hold_s=120.0, rate_dps=10.0)
    assert result.outcome == "completed"
    streams = read_manifest(result.folder).stream
    run = Run.open(result.folder)
    for name in ("fog_1", "can_1"):
        # A clock that is fast by e takes 100 * (1 + e) samples a true second.
        assert streams[name]["sample_rate_hz"] == pytest.approx(100.0 * (1.0 + error_ppm * 1e-6), rel=2e-5)
        assert streams[name]["clock_error_ppm"] == pytest.approx(error_ppm, abs=20.0)
        assert streams[name]["lost"] == 0
        assert f"not the nominal 100 Hz ({error_ppm * 1e-4:+.2f}%)" in streams[name]["warnings"][0]
    assert len(result.warnings) == 2
    fog = run.gyro("fog_1", ("time_ns",))
    duration_s = (fog["time_ns"][-1] - fog["time_ns"][0]) / 1e9
    samples = len(fog["time_ns"]) - 1
    assert duration_s == pytest.approx(samples / (100.0 * (1.0 + error_ppm * 1e-6)), abs=0.01)
    # Times right to a sample, two minutes apart: 10 deg/s at 200 deg/s2 behind a critically damped servo of 5 Hz
    # is at half its rate 78 ms after the table took the command; a sample is the mean of the 10 ms before it.
    can = run.gyro("can_1", ("time_ns", "rate_y_dps"))  # its z under test lies east: y is the table's axis
    fast = np.flatnonzero(np.abs(can["rate_y_dps"]) > 5.0)
    said = [(t, data) for t, way, data in read_exchanges(result.folder, "table") if way == "sent"]
    spun = next(t for t, data in said if b":mode:rate" in data)
    stopped = next(t for t, data in said if t > spun and b":demand:rate 1,0.0" in data)
    assert (can["time_ns"][fast[0]] - spun) / 1e9 == pytest.approx(0.088, abs=0.012)
    assert (can["time_ns"][fast[-1]] - stopped) / 1e9 == pytest.approx(0.078, abs=0.012)
    assert (stopped - spun) / 1e9 > 120.0


@pytest.mark.parametrize("batch_ms", [1.0, 16.0, 100.0])
def test_what_an_adapter_hands_over_in_batches_is_timed_by_the_counter(bench, fog_file, tmp_path, batch_ms):
    """Bytes are seen when the adapter's latency timer runs out; samples of 10 ms are right to a tenth of one."""
    runs = {}
    for name, batches in (("plain", {}), ("batched", {"fog_1": batch_ms})):
        plant = Plant(seed=5, clock_error_ppm={"fog_1": 900.0}, adapter_batch_ms=batches)
        with bench.lab(fog_file, plant) as lab:
            result = bench.drive(lab.file, tmp_path / name, hold_s=60.0)
        assert result.outcome == "completed", result.reason
        runs[name] = result, Run.open(result.folder).gyro("fog_1", ("time_ns",))["time_ns"]
    marks = np.fromfile(runs["batched"][0].folder / "raw" / "fog_1.idx", np.int64).reshape(-1, 2)
    period_ns = round(1e6 * batch_ms)
    off_ns = np.abs(marks[:, 1] - period_ns * np.rint(marks[:, 1] / period_ns))
    assert np.mean(off_ns <= 1) > 0.95  # answers before and after the stream are not held
    count = min(len(times) for _, times in runs.values())
    late_s = 1e-9 * (runs["batched"][1][:count] - runs["plain"][1][:count])
    assert np.sqrt(np.mean(late_s**2)) < 1e-3
    said = [
        text for text in runs["batched"][0].warnings if "in batches of 100 ms, about 10 at a time" in text
    ]
    assert len(said) == (batch_ms == 100.0)


def test_a_plant_file_is_told_all_that_is_wrong_with_it(tmp_path):
    (tmp_path / "plant.toml").write_text(
        'sed = 3\nadapter_batch_ms = { fog_1 = 0 }\n[[fault]]\nport = "fog_1"\nkind = "vanish"\nwhen = 3\n'
    )
    with pytest.raises(ConfigurationError) as refused:
        load_plant(tmp_path / "plant.toml")
    said = str(refused.value)
    assert "3 mistakes in the plant file" in said and "pydantic" not in said
    assert "adapter_batch_ms.fog_1: found 0, expected greater than 0" in said
    assert "sed: found an unknown key, expected one of accelerometers, actual" in said
    assert "fault.0.when: found an unknown key, expected one of at_s, count, duration_s" in said
    (tmp_path / "field.toml").write_text("[ground]\nsway_ms = 1e-3\n")
    with pytest.raises(ConfigurationError) as refused:
        load_plant(tmp_path / "field.toml")
    assert "ground.sway_ms cannot be used. Found: an unknown key" in str(refused.value)
    assert "did you mean 'sway_mps'?" in str(refused.value)
    (tmp_path / "bearing.toml").write_text("[bearing.INS-1]\nlines_arcsec = []\nplay_travel = 3\n")
    with pytest.raises(ConfigurationError, match=r"bearing\.INS-1\.play_travel cannot be used") as refused:
        load_plant(tmp_path / "bearing.toml")
    assert "did you mean 'play_travel_deg'?" in str(refused.value)


def test_an_adapter_of_no_unit_is_refused(bench, fog_file):
    with (
        pytest.raises(ConfigurationError, match="fog_9"),
        bench.lab(fog_file, Plant(adapter_batch_ms={"fog_9": 16.0})),
    ):
        pass
