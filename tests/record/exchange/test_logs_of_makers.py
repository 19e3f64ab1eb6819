"""Logs that were once read silently wrong: dates in other columns, clocks, counters, groups of an MDF file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from asammdf import MDF, Signal
from hypothesis import given
from hypothesis import strategies as st

from bench.analysis.common.runs import require_unseen
from bench.record.exchange import Mapping, import_log, read_log, read_mapping, read_table
from bench.record.exchange._log import Log
from bench.record.exchange._row_times import turns_back
from bench.record.recording import Run
from drivers.base.errors import ConfigurationError

HEAD = (
    'format = 1\nunit_id = "S"\nlatitude_deg = 48.0\n[columns]\noutput = { name = "rate", unit = "deg/s" }\n'
)
DATED = 'time = { name = "t", unit = "s" }\n'


def log_of(folder: Path, text: str, columns: str = "") -> Log:
    (folder / "log.csv").write_text(text)
    (folder / "map.toml").write_text(HEAD + columns)
    return read_log(folder / "log.csv", read_mapping(folder / "map.toml"))


def stamped(stamps: list[str]) -> str:
    return "t;rate\n" + "".join(f"{stamp};0.0{k % 10}\n" for k, stamp in enumerate(stamps))


@pytest.mark.parametrize("cell", ["25:00:00", "010:00:00.5", "10.0 h", "20/10", "1,234,567"])
def test_dates_and_times_of_day_are_times_only(tmp_path: Path, cell: str) -> None:
    text = "t;rate;angle\n" + "".join(f"{k};0.01;{cell}\n" for k in range(50))
    with pytest.raises(ConfigurationError, match="a column is not one of numbers") as wrong:
        log_of(tmp_path, text, f'{DATED}angle = {{ name = "angle", unit = "deg" }}\n')
    assert "angle" in str(wrong.value)


def test_channels_of_other_groups_of_an_mdf_file_come_as_those_of_another_recorder(tmp_path: Path) -> None:
    """Output at 10 Hz; a thermometer at 0.1 Hz with a number for a lost value; an encoder of 16 bits at 1 Hz."""
    fine, slow, each = np.arange(0.0, 600.0, 0.1), np.arange(0.0, 600.0, 10.0), np.arange(0.0, 600.0)
    case = 20.0 + 0.01 * slow
    case[20] = 9999.0
    with MDF(version="4.10") as mdf:
        mdf.append([Signal(0.01 + 0.0 * fine, fine, name="rate", unit="deg/s")])
        mdf.append([
            Signal(case, slow, name="case", unit="degC"),
            Signal(np.where(slow < 300.0, 20.0, -40.0), slow, name="sp", unit="degC"),
            Signal(np.where((slow >= 200.0) & (slow < 240.0), 0, 1).astype(np.uint8), slow, name="ok"),
        ])  # fmt: skip
        mdf.append([Signal(1000.0 * each % 65_536.0, each, name="count")])
        mdf.append([Signal(each[:300], each[:300], name="turned", unit="rad")])
        mdf.save(tmp_path / "log.mf4")
    columns = (
        't_out = { name = "case", unit = "degC", missing = 9999 }\nset_point = { name = "sp", unit = "degC" }\n'
        'valid = { name = "ok" }\ntable_rate = { name = "count", unit = "0.001 deg total", wraps = 65536 }\n'
        'angle = { name = "turned", unit = "rad" }\n'
    )
    (tmp_path / "map.toml").write_text(HEAD + columns)
    log = read_log(tmp_path / "log.mf4", read_mapping(tmp_path / "map.toml"))
    assert log.columns["t_out"] == pytest.approx(20.0 + 0.01 * np.minimum(log.time_s, 590.0))
    assert sorted(set(log.columns["set_point"].tolist())) == [-40.0, 20.0]
    assert log.columns["set_point"][2999:3001].tolist() == [20.0, -40.0]
    assert np.flatnonzero(np.isnan(log.columns["output"])).tolist() == list(range(2000, 2400))
    rate = log.columns["table_rate"]
    assert rate[np.isfinite(rate)] == pytest.approx(1.0) and np.isfinite(rate).mean() > 0.99
    turned = log.columns["angle"]
    assert turned[:2990] == pytest.approx(np.degrees(log.time_s[:2990])) and np.isnan(turned[3020:]).all()
    assert len(log.other_rows["angle"]) == 300
    run = import_log(tmp_path / "log.mf4", tmp_path / "map.toml", tmp_path / "runs")
    told = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
    assert [(each["time_s"], each["set_point_c"]) for each in told if each["kind"] == "demand_air"] == [
        (0.0, 20.0), (300.0, -40.0)
    ]  # fmt: skip


@given(
    digits=st.integers(3, 6),
    rate_dps=st.floats(1.0, 60.0),
    start=st.floats(0.0, 6.28),
    centred=st.booleans(),
)
def test_an_angle_in_radians_counts_turns_however_it_is_rounded(
    digits: int, rate_dps: float, start: float, centred: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    turned = start + np.radians(rate_dps) * np.arange(0.0, 40.0, 0.1)
    told = np.round((turned + np.pi * centred) % (2.0 * np.pi) - np.pi * centred, digits)
    text = "t;rate;angle\n" + "".join(f"{k / 10};0.01;{angle:.{digits}f}\n" for k, angle in enumerate(told))
    folder = tmp_path_factory.mktemp("angle")
    log = log_of(folder, text, f'{DATED}angle = {{ name = "angle", unit = "rad" }}\n')
    assert np.ptp(log.columns["angle"]) == pytest.approx(np.degrees(np.ptp(turned)), abs=0.12)


@given(st.integers(3, 400), st.floats(0.01, 1e3), st.integers(0, 5), st.data())
def test_a_time_that_wraps_goes_on_over_holes_and_late_rows(
    rows: int, step: float, turns: int, data: st.DataObject
) -> None:
    wraps = step * (rows / (turns + 1.0) + 30.0)
    times = step * np.arange(float(rows))
    late = data.draw(st.integers(0, rows - 2))
    counted = times % wraps
    counted[[late, late + 1]] = counted[[late + 1, late]]
    going = counted - wraps * np.cumsum(turns_back(np.diff(counted, prepend=counted[:1]), wraps))
    if abs(counted[late + 1] - counted[late]) < 5.0 * step:  # the two rows do not stand about a wrap
        assert np.sort(going) == pytest.approx(times)


def test_one_late_row_of_a_counter_of_ms_is_no_month_and_a_half(tmp_path: Path) -> None:
    ms = list(range(0, 100_000, 100))
    ms[500], ms[501] = ms[501], ms[500]
    columns = 'time = { name = "t", unit = "ms", wraps = 4294967296 }\n'
    log = log_of(tmp_path, stamped([str(each) for each in ms]), columns)
    assert log.time_s[-1] - log.time_s[0] == pytest.approx(99.9) and "written late" in log.remarks[0]


def test_stamps_in_a_row_of_digits_are_date_times(tmp_path: Path) -> None:
    stamps = [f"2026100508{k // 60:02d}{k % 60:02d}" for k in range(150)]
    log = log_of(tmp_path, stamped(stamps), DATED)
    assert np.diff(log.time_s) == pytest.approx(1.0) and log.since_1970
    assert log.time_s[0] == 1_791_187_200.0  # date -u -d '2026-10-05 08:00:00' +%s
    # counts that are no dates stay what they are
    other = [str(20261345080000 + k) for k in range(150)]
    assert log_of(tmp_path, stamped(other), DATED).time_s[0] == 20261345080000.0
    february = [str(20260230080000 + k) for k in range(50)]
    assert log_of(tmp_path, stamped(february), DATED).time_s[0] == 20260230080000.0


@pytest.mark.parametrize(
    ("before", "after", "set_s"),
    [("2026-03-29 01:59:{:02d}", "2026-03-29 03:00:{:02d}", 3600), # Europe
     ("2026-03-08 01:59:{:02d}", "2026-03-08 03:00:{:02d}", 3600), # America
     ("2026-10-04 01:59:{:02d}", "2026-10-04 02:30:{:02d}", 1800), # Lord Howe
     ("2026-03-28 01:59:{:02d}", "2026-03-28 03:00:{:02d}", 0), # a Saturday: a pause
     ("2026-03-29 11:59:{:02d}", "2026-03-29 13:00:{:02d}", 0), # noon
     ("2026-03-29T01:59:{:02d}Z", "2026-03-29T03:00:{:02d}Z", 0)],
)  # fmt: skip
def test_a_local_clock_that_is_set_forward_goes_on(
    tmp_path: Path, before: str, after: str, set_s: int
) -> None:
    stamps = [before.format(k) for k in range(60)] + [after.format(k) for k in range(60)]
    log = log_of(tmp_path, stamped(stamps), DATED)
    pause = {3600: 3600, 1800: 1800, 0: 3600}[set_s]
    assert log.time_s[-1] - log.time_s[0] == 119.0 + pause - set_s
    assert log.remarks == ((
        f"the clock was set forward by {set_s} s (daylight time) before row 61, taken as going on",
    ) if set_s else ())  # fmt: skip


@pytest.mark.parametrize(
    ("stamp", "start", "said"),
    [("10/05/2026 08:00:{:02d}", "2026-05-10", "day before month"),
     ("10/05/2026 08:00:{:02d} AM", "2026-10-05", "month before day"),
     ("10/25/2026 08:00:{:02d}", "2026-10-25", ""), ("25/10/2026 08:00:{:02d}", "2026-10-25", ""),
     ("05.10.2026 08:00:{:02d}", "2026-10-05", "")],
)  # fmt: skip
def test_dates_that_do_not_show_their_order_are_said(
    tmp_path: Path, stamp: str, start: str, said: str
) -> None:
    log = log_of(tmp_path, stamped([stamp.format(k) for k in range(50)]), DATED)
    assert np.datetime64(int(log.time_s[0]), "s").astype("datetime64[D]") == np.datetime64(start)
    assert [said in each for each in log.remarks] == ([True] if said else [])


def test_an_output_that_is_not_the_gyro_under_test_is_refused(tmp_path: Path) -> None:
    columns = f"{DATED}[columns.gyros]\n" + "".join(
        f'{axis} = {{ name = "{name}", unit = "deg/s" }}\n'
        for axis, name in zip("xyz", ("a", "rate", "c"), strict=True)
    )
    text = "t,rate,a,c\n" + "".join(f"{k},0.1,0.2,0.3\n" for k in range(50))
    with pytest.raises(ConfigurationError, match="output is rate, and the gyro of the axis of test, x, is a"):
        log_of(tmp_path, text, columns)
    (tmp_path / "map.toml").write_text('axis = "y"\n' + HEAD + columns)
    assert isinstance(read_mapping(tmp_path / "map.toml"), Mapping)


def test_a_log_that_is_imported_twice_is_one_recording(tmp_path: Path) -> None:
    for name in ("a", "b"):
        text = stamped([f"{k}" for k in range(50)])
        (tmp_path / f"{name}.csv").write_text(text if name == "a" else text.replace("0.03", "0.04"))
    (tmp_path / "map.toml").write_text(HEAD + DATED)
    first, again, other = (
        Run.open(import_log(tmp_path / f"{name}.csv", tmp_path / "map.toml", tmp_path / folder))
        for name, folder in (("a", "one"), ("a", "two"), ("b", "one"))
    )

    class OfRun:
        def __init__(self, run: Run) -> None:
            self.run_id, self.unit_id, self.checksum = run.manifest.run_id, "S", run.checksum

    require_unseen([OfRun(first)], [OfRun(other)])
    with pytest.raises(ConfigurationError, match="a run is used for fitting and for judging"):
        require_unseen([OfRun(first)], [OfRun(again)])


def test_quoted_cells_with_decimal_commas(tmp_path: Path) -> None:
    rows = "".join(f'"{k / 100:.2f}";"{k / 1000:.4f}"\n'.replace(".", ",") for k in range(200))
    (tmp_path / "log.csv").write_text('"t";"rate"\n' + rows)
    table = read_table(tmp_path / "log.csv")
    assert table.columns["t"] == pytest.approx(np.arange(200) / 100.0)
    assert table.columns["rate"] == pytest.approx(np.arange(200) / 1000.0, abs=1e-4)


@pytest.mark.parametrize("odd", [b"\x85", b"\x0c", "\u2028".encode()])
def test_only_ends_of_lines_end_lines(tmp_path: Path, odd: bytes) -> None:
    rows = b"".join(b"%.2f,%.5f\n" % (k / 100.0, k / 7.0) for k in range(200))
    (tmp_path / "log.csv").write_bytes(b"# Measured " + odd + b" here\ntime_s,rate\n" + rows)
    assert len(read_table(tmp_path / "log.csv").columns["time_s"]) == 200
