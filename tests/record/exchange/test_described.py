"""Bytes as a unit sent them, read by a description: against frames packed by hand and a real capture."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.look import LookOptions, look
from bench.record.exchange import fitting_description, read_table
from drivers.base.errors import ConfigurationError

CAPTURE = Path(__file__).parents[3] / ".." / "shared" / "data" / "serial_openimu" / "z1.raw"
UNIT = """schema = 1
name = "unit"
title = "a unit of a test"
[link]
nominal_rate_hz = 50
[frame]
endian = "big"
sync = "A55A"
length = 14
[frame.checksum]
kind = "sum8"
ranges = [[2, 13]]
at = 13
[[field]]
name = "rate_x"
axis = "x"
at = 2
type = "i16"
unit = "deg/h"
role = "rate"
[[field]]
name = "force_y"
axis = "y"
at = 4
type = "i16"
unit = "mg"
role = "accel"
[[field]]
name = "inner"
at = 6
type = "u16"
unit = "K"
role = "temp"
[[field]]
name = "count"
at = 8
type = "u8"
[[field]]
name = "flags"
at = 9
type = "u8"
[counter]
field = "count"
[[status]]
field = "flags"
bit = 2
name = "laser_off"
severity = "error"
"""


def frame(rate: int, force: int, kelvin: int, count: int, flags: int = 0) -> bytes:
    body = struct.pack(">hhHBB3x", rate, force, kelvin, count, flags)
    return b"\xa5\x5a" + body + bytes([sum(body) & 0xFF])


def described(tmp_path: Path, data: bytes, text: str = UNIT) -> tuple[Path, str]:
    (tmp_path / "unit.toml").write_text(text)
    (tmp_path / "log.bin").write_bytes(data)
    return tmp_path / "log.bin", str(tmp_path / "unit.toml")


def test_columns_are_in_the_benchs_units_and_lost_frames_leave_a_gap(tmp_path):
    numbers = [254, 255, 0, 3, 4]  # two are lost after the third
    rows = [frame(3600 * (k + 1) // 2, 100 - k, 300 + k, n) for k, n in enumerate(numbers)]
    file, unit = described(tmp_path, b"noise" + b"".join(rows) + b"\xa5")
    table = read_table(file, frames=unit)
    assert (50.0 * table.columns["frame_time"]).tolist() == pytest.approx([0, 1, 2, 5, 6])
    assert table.columns["rate_x"].tolist() == pytest.approx([0.5, 1.0, 1.5, 2.0, 2.5])
    assert table.columns["force_y"].tolist() == pytest.approx([(100 - k) * 9.80665e-3 for k in range(5)])
    assert table.columns["inner"].tolist() == pytest.approx([26.85 + k for k in range(5)], abs=1e-4)
    assert table.units == {"frame_time": "s", "rate_x": "deg/s", "force_y": "m/s^2", "inner": "degC"}
    assert table.time == "frame_time"
    assert (10.0 * read_table(file, frames=unit, rate_hz=10.0).columns["frame_time"])[-1] == pytest.approx(6)
    assert list(read_table(file, ["inner"], frames=unit).columns) == ["inner"]
    with pytest.raises(ConfigurationError, match="no such column"):
        read_table(file, ["outer"], frames=unit)


def test_a_rate_that_its_frame_calls_bad_is_missing_and_a_damaged_frame_is_counted(tmp_path):
    rows = [frame(1, 1, 300, 0), frame(2, 1, 300, 1, flags=4), frame(3, 1, 300, 2, flags=0xFB)]
    bad = bytearray(frame(4, 1, 300, 3))
    bad[5] ^= 1
    file, unit = described(tmp_path, b"".join(rows) + bad)
    table = read_table(file, frames=unit)
    rates = table.columns["rate_x"]
    assert np.isnan(rates).tolist() == [False, True, False] and rates[2] == pytest.approx(3 / 3600)
    assert np.isfinite(table.columns["force_y"]).all()
    said = " ".join(table.remarks)
    assert "3 frames" in said and "1 checksum" in said and "bytes in no frame: 14" in said
    assert "1 frames say that their rates do not count" in said


def test_increments_are_increments_and_a_clock_of_the_unit_gives_the_times(tmp_path):
    text = UNIT.replace('unit = "deg/h"\nrole = "rate"', 'unit = "arcsec"\nrole = "delta_angle"')
    text = text.replace('field = "count"\n[[status]]', 'field = "count"\nticks_per_s = 100\n[[status]]')
    rows = [frame(1800, 0, 300, count) for count in (250, 252, 254, 0, 4)]
    file, unit = described(tmp_path, b"".join(rows), text)
    table = read_table(file, frames=unit)
    assert table.columns["frame_time"].tolist() == pytest.approx([0.0, 0.02, 0.04, 0.06, 0.10])
    assert table.columns["rate_x"].tolist() == pytest.approx([0.5] * 5)
    assert table.units["rate_x"] == "deg/sample" and table.units["frame_time"] == "s"


def test_a_file_without_such_frames_is_refused_with_what_it_begins_with(tmp_path):
    file, unit = described(tmp_path, b"\1\2\3\4" * 10)
    for path in (file, tmp_path / "nothing.bin"):
        (tmp_path / "nothing.bin").write_bytes(b"")
        with pytest.raises(ConfigurationError) as refused:
            read_table(path, frames=unit)
        assert refused.value.found == ("01 02 03 04" + " 01 02 03 04" * 5 if path == file else "nothing")
    with pytest.raises(ConfigurationError):
        read_table(file, frames="openimu", group="no such message")


def test_a_unit_at_rest_looked_at_from_its_bytes(tmp_path):
    """One rate, one sensor: the mean of what was sent, at the rate that somebody says."""
    rng = np.random.default_rng(3)
    rates = np.rint(360.0 + rng.normal(0.0, 20.0, 4000)).astype(int)
    data = b"".join(frame(int(rate), 0, 300, k % 256) for k, rate in enumerate(rates))
    file, unit = described(tmp_path, data)
    found = look(file, LookOptions(frames=unit))
    assert found.clock.rate_hz == pytest.approx(50.0) and found.axes[0].figures.mean == pytest.approx(
        rates.mean() / 3600
    )
    assert look(file, LookOptions(frames=unit, rate_hz=200.0)).clock.rate_hz == 200.0


def test_lost_frames_are_gaps_of_the_look_and_a_restart_is_none(tmp_path):
    """A counter of four bytes: 50 frames are lost, and the unit is switched on again, which counts from zero."""
    text = UNIT.replace('at = 8\ntype = "u8"', 'at = 8\ntype = "u32"').replace("at = 9", "at = 12")

    def frames(first: int, last: int) -> bytes:
        bodies = (struct.pack(">hhHIB", k % 9, 1, 300, k, 0) for k in range(first, last))
        return b"".join(b"\xa5\x5a" + body + bytes([sum(body) & 0xFF]) for body in bodies)

    file, unit = described(tmp_path, frames(5000, 7000) + frames(7050, 9000), text)
    for rate_hz in (None, 200.0):
        found = look(file, LookOptions(frames=unit, rate_hz=rate_hz))
        assert (found.clock.gaps, found.clock.lost) == (1, 50)
        assert found.clock.longest_s == pytest.approx(51 / (rate_hz or 50.0))
    file, unit = described(tmp_path, frames(5000, 7000) + frames(0, 1000), text)
    found = look(file, LookOptions(frames=unit))
    assert (found.clock.rows, found.clock.lost) == (3000, 0)
    assert any("begins anew 1 times" in remark for remark in found.remarks)


@pytest.mark.skipif(not CAPTURE.exists(), reason="the real capture is not beside this checkout")
def test_a_real_capture_is_recognised_and_read_as_its_bytes_say(tmp_path):
    assert fitting_description(CAPTURE) == "openimu"
    with pytest.raises(ConfigurationError, match="say --frames openimu"):
        look(CAPTURE)
    data = CAPTURE.read_bytes()
    table = read_table(CAPTURE, frames="openimu")
    first = data.index(b"UUz1\x28") + 5  # 40 bytes: time in ms, then accelerations, rates, fields
    time_ms, ax, ay, az, wx, wy, wz = struct.unpack_from("<I3f3f", data, first)
    assert time_ms > 0 and (table.columns["rate_x"][0], table.columns["rate_z"][0]) == pytest.approx((wx, wz))
    assert [table.columns[f"acc_{axis}"][0] for axis in "xyz"] == pytest.approx([ax, ay, az])
    assert len(table.columns["rate_y"]) == data.count(b"UUz1\x28") - 1 and wy  # the last is cut
    assert np.hypot(np.hypot(ax, ay), az) == pytest.approx(9.8, abs=0.2)
