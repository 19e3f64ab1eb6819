"""A run's log and what chamber and table wrote beside it, each with a clock of its own; counters that wrap."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.analysis.gap._import import read_mapped_runs
from bench.analysis.gap._mapped import mapped_logs
from bench.control.run_record import decode_run
from bench.record.exchange import import_log, read_log, read_mapping
from bench.record.exchange._recorders import on_rows
from bench.record.recording import verify
from drivers.base.errors import ConfigurationError

MAPPING = """
format = 1
unit_id = "G7"
latitude_deg = 48.0
[columns]
time = { name = "t", unit = "s" }
output = { name = "rate", unit = "deg/s" }
t_in = { name = "unit", unit = "degC", recorder = "chamber" }
set_point = { name = "set", unit = "degC", recorder = "chamber" }
angle = { name = "pos", unit = "deg", recorder = "table" }
[recorder.chamber]
file = "*_chamber.csv"
time = { name = "time", unit = "min" }
shift_s = 0.0
[recorder.table]
file = "../table/*.txt"
time = { name = "ms", unit = "ms" }
starts_s = -20.0
[[run]]
file = "*_gyro.csv"
"""
T_S = np.arange(1000, 18000) / 50.0 + 0.007
"""50 Hz; the chamber counts minutes on the same clock, the table ms from its own start, 20 s before."""
LAP_DPS = 5.0


def temperature_c(t_s: np.ndarray) -> np.ndarray:
    return 25.0 + 10.0 * np.sin(t_s / 200.0)


def angle_deg(t_s: np.ndarray) -> np.ndarray:
    return 300.0 + LAP_DPS * t_s


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Logs of two runs: gyro/a_gyro.csv and b_gyro.csv, the chamber's beside them, the table's in table/."""
    (tmp_path / "gyro").mkdir()
    (tmp_path / "table").mkdir()
    chamber_s = np.arange(0.0, 400.0, 5.0)
    table_s = np.arange(0.0, 380.0, 0.1)
    for name in ("a", "b"):
        rate = LAP_DPS + 1e-3 * np.cos(T_S)
        pd.DataFrame({"t": T_S, "rate": rate}).to_csv(tmp_path / "gyro" / f"{name}_gyro.csv", index=False)
        chamber = {
            "time": chamber_s / 60.0,
            "unit": temperature_c(chamber_s),
            "set": np.where(chamber_s < 100.0, 25.0, -40.0),
        }
        pd.DataFrame(chamber).to_csv(tmp_path / "gyro" / f"{name}_chamber.csv", index=False)
        turned = np.mod(angle_deg(table_s + T_S[0] - 20.0), 360.0)
        table = pd.DataFrame({"ms": 1000.0 * table_s + 5e6, "pos": turned})
        table.to_csv(tmp_path / "table" / f"{name}.txt", index=False)
    (tmp_path / "gyro" / "map.toml").write_text(MAPPING)
    return tmp_path / "gyro"


def log_of(folder: Path, change: tuple[str, str] = ("", "")):
    (folder / "map.toml").write_text(MAPPING.replace(*change) if change[0] else MAPPING)
    return read_log(folder / "a_gyro.csv", read_mapping(folder / "map.toml"))


def test_what_each_recorder_wrote_is_put_on_the_rows_of_the_log(folder: Path) -> None:
    log = log_of(folder)
    assert log.time_s == pytest.approx(T_S)
    # between rows of 5 s: half the second difference of a sine of 10 degC and 200 rad/s, at most
    assert np.abs(log.columns["t_in"] - temperature_c(T_S)).max() < 10.0 * (2.5 / 200.0) ** 2 / 2 * 1.01
    assert log.columns["angle"] - log.columns["angle"][0] == pytest.approx(LAP_DPS * (T_S - T_S[0]), abs=1e-9)
    assert np.mod(log.columns["angle"][0], 360.0) == pytest.approx(angle_deg(T_S[0]) % 360.0)
    # a command is in force from its row on: no value between the two
    assert set(log.columns["set_point"]) == {25.0, -40.0}
    assert T_S[log.columns["set_point"] == -40.0][0] == pytest.approx(100.007)


def test_a_star_is_the_same_in_all_files_and_no_recorders_log_is_a_run(folder: Path) -> None:
    assert [made.run_id for made in mapped_logs(folder / "map.toml")] == ["a_gyro", "b_gyro"]
    (folder / "map.toml").write_text(
        MAPPING.replace('"*_gyro.csv"', '"*.csv"').replace("../table/*", "../table/a")
    )
    # a_chamber.csv is one of all, and begins with a, too
    assert [made.run_id for made in mapped_logs(folder / "map.toml")] == ["a_gyro", "b_gyro"]
    for name in "ab":
        (folder / f"{name}_gyro.csv").rename(folder / f"{name}.csv")
    assert [made.run_id for made in mapped_logs(folder / "map.toml")] == ["a", "b"]


def test_a_clock_that_is_known_to_be_off_is_set_right(folder: Path) -> None:
    log = log_of(folder, ("shift_s = 0.0", "shift_s = -30.0"))
    inside = T_S < 360.0
    assert log.columns["t_in"][inside] == pytest.approx(temperature_c(T_S[inside] + 30.0), abs=1e-3)
    late = log_of(folder, ("starts_s = -20.0", "starts_s = -10.0"))
    assert late.columns["angle"][1000] == pytest.approx(log.columns["angle"][1000] - 10.0 * LAP_DPS)


def test_date_times_of_all_recorders_are_on_one_clock(folder: Path) -> None:
    start = pd.Timestamp("2026-03-01 10:00:00")
    for name, column, unit in (("a_gyro", "t", "s"), ("a_chamber", "time", "min")):
        rows = pd.read_csv(folder / f"{name}.csv")
        rows[column] = start + pd.to_timedelta(rows[column], unit=unit)
        rows.to_csv(folder / f"{name}.csv", index=False)
    assert np.abs(log_of(folder).columns["t_in"] - temperature_c(T_S)).max() < 1e-3


def test_where_a_recorder_says_nothing_the_value_is_missing(folder: Path) -> None:
    """A temperature lies between the rows beside a gap; nobody knows how a table turned in one."""
    for file, cut in (
        (folder / "a_chamber.csv", slice(30, 40)),
        (folder.parent / "table" / "a.txt", slice(1000, 1100)),
    ):
        rows = pd.read_csv(file)
        rows.drop(rows.index[cut]).to_csv(file, index=False)
    log = log_of(folder)
    assert not np.isnan(log.columns["t_in"]).any()
    missing = np.isnan(log.columns["angle"])
    since = T_S - T_S[0] + 20.0
    assert missing.sum() == pytest.approx(10.1 * 50.0, abs=3) and since[missing].min() == pytest.approx(
        99.9, abs=0.05
    )
    # before a recorder's first row nothing is commanded, and beyond its last one nothing is measured
    late, early = (log_of(folder, ("shift_s = 0.0", f"shift_s = {by}")).columns for by in (60.0, -60.0))
    assert np.isnan(late["set_point"][T_S < 59.9]).all() and not np.isnan(late["set_point"][T_S > 60.1]).any()
    assert np.isnan(early["t_in"][T_S > 348.0]).all() and not np.isnan(early["t_in"][T_S < 347.0]).any()
    short = log_of(folder, ("starts_s = -20.0", "starts_s = 20.0"))
    assert np.isnan(short.columns["angle"][T_S - T_S[0] < 19.0]).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('"*_gyro.csv"', '"*_gyro.csv"\nstarts_s.oven = 1.0'), "oven.*no such recorder"),
        (('file = "*_chamber.csv"', 'file = "*_oven.csv"'), "a recorder's log is not there.*gyro/a_oven.csv"),
        (('recorder = "table" }', 'recorder = "oven" }'), r"of recorder oven, and there is no \[recorder.oven\]"),
        ((', recorder = "table" }', " }"), r"no column is of \[recorder.table\]"),
        (('"deg/s" }', '"deg/s", recorder = "table" }'), "output is one of the log itself"),
        (("shift_s = 0.0", "shift_s = -1e6"), "wrote nothing while the log was written"),
        (("shift_s = 0.0", "shift_s = 1e6"), "wrote nothing while the log was written"),
        (('"time", unit = "min"', '"when", unit = "min"'), "a_chamber.csv"),
    ],
)  # fmt: skip
def test_mistakes_are_named(folder: Path, change: tuple[str, str], message: str) -> None:
    with pytest.raises(ConfigurationError, match=f"(?s){message}"):
        log_of(folder, change)


@pytest.mark.parametrize("dated", [True, False])
def test_clocks_of_which_nobody_says_what_they_have_in_common(folder: Path, dated: bool) -> None:
    """Numbers that happen to overlap may be of any clocks: 200 s apart they would be a gyro of another table."""
    rows = pd.read_csv(folder / "a_chamber.csv")
    if dated:
        rows["time"] = pd.Timestamp("2026-03-01 10:00:00") + pd.to_timedelta(rows["time"], unit="min")
        rows.to_csv(folder / "a_chamber.csv", index=False)
    for change in (("shift_s = 0.0", ""), *([("", "")] if dated else [])):
        with pytest.raises(ConfigurationError, match="have in common is not known"):
            log_of(folder, change)
    for told in (
        ("shift_s = 0.0", f"starts_s = {-T_S[0]}"),
        ('"*_gyro.csv"', f'"*_gyro.csv"\nstarts_s.chamber = {-T_S[0]}'),
    ):
        assert np.abs(log_of(folder, told).columns["t_in"] - temperature_c(T_S)).max() < 1e-3


def test_what_a_run_says_of_its_recorders_goes_before_what_the_mapping_says(folder: Path) -> None:
    usual = log_of(folder).columns["angle"]
    told = log_of(folder, ('"*_gyro.csv"', '"*_gyro.csv"\nstarts_s = { table = -10.0 }')).columns["angle"]
    assert told[1000] == pytest.approx(usual[1000] - 10.0 * LAP_DPS)


@pytest.mark.parametrize("file", ["a_gyro.csv", "a*gyro.csv", "*.csv"])
def test_the_star_is_how_the_logs_name_begins(folder: Path, file: str) -> None:
    told = log_of(folder, ('"*_gyro.csv"', f'"{file}"'))
    assert told.columns["t_in"] == pytest.approx(temperature_c(T_S), abs=1e-3)


def test_the_star_of_a_name_without_separators(folder: Path) -> None:
    for name, new in (
        ("a_gyro.csv", "a1gyro.csv"),
        ("a_chamber.csv", "a1_chamber.csv"),
        ("../table/a.txt", "../table/a1.txt"),
    ):
        (folder / name).rename(folder / new)
    (folder / "map.toml").write_text(MAPPING.replace("*_gyro.csv", "a*gyro.csv"))
    assert [made.run_id for made in mapped_logs(folder / "map.toml")] == ["a1gyro"]


def test_a_row_beside_a_gap_is_known() -> None:
    times_s, values = np.array([0.0, 1.0, 2.0, 10.0, 11.0]), np.array([0.0, 1.0, 2.0, 10.0, 11.0])
    found = on_rows("angle", np.arange(12.0), times_s, values)
    assert found[[0, 1, 2, 10, 11]].tolist() == [0.0, 1.0, 2.0, 10.0, 11.0] and np.isnan(found[3:10]).all()


def test_a_time_without_a_unit_must_be_a_date_time(folder: Path) -> None:
    with pytest.raises(ConfigurationError, match="unit is not known"):
        log_of(folder, ('name = "t", unit = "s"', 'name = "t"'))


def test_an_imported_run_keeps_all_of_its_logs(folder: Path, tmp_path: Path) -> None:
    made = import_log(folder / "a_gyro.csv", folder / "map.toml", tmp_path / "runs")
    assert {file.name for file in (made / "raw").iterdir()} == {
        "a_gyro.csv", "a_chamber.csv", "a.txt", "mapping.toml",
    }  # fmt: skip
    mapped = read_mapped_runs(folder / "map.toml")[0]
    for file in [*folder.glob("a_*"), folder.parent / "table" / "a.txt"]:
        file.unlink()
    assert verify(made, decode_run).passed
    before = pd.read_parquet(made / "gyro_gyro.parquet")
    (tmp_path / "again").mkdir()
    decode_run(made, tmp_path / "again")
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "again" / "gyro_gyro.parquet"), before)
    assert before["temp_c"].to_numpy() == pytest.approx(temperature_c(T_S), abs=1e-3)
    assert mapped.stimulus.t_in_c == pytest.approx(
        np.interp(mapped.stimulus.time_s - 0.5, T_S - T_S[0], temperature_c(T_S)), abs=2e-3
    )


def test_codes_of_a_tables_own_log_are_those_of_its_encoder(folder: Path) -> None:
    """An encoder of 14 bits read at 10 Hz, on rows of 50 Hz: an edge is off by 1/sqrt(12) of a code, as read."""
    table, code_deg = folder.parent / "table" / "a.txt", 360.0 / 2**14
    rows = pd.read_csv(table)
    rows["pos"] = np.floor((rows["pos"] + 2.0 * np.sin(rows["ms"] / 700.0)) / code_deg) * code_deg
    rows.to_csv(table, index=False)
    noise = read_mapped_runs(folder / "map.toml")[0].rounding_noise
    assert noise is not None and noise.told
    assert np.median(noise.sigma_deg) == pytest.approx(code_deg / np.sqrt(12.0), rel=0.01)


def test_files_of_one_name_are_refused(folder: Path, tmp_path: Path) -> None:
    (folder.parent / "table" / "a.txt").rename(folder.parent / "table" / "a_gyro.csv")
    (folder / "map.toml").write_text(MAPPING.replace("../table/*.txt", "../table/*_gyro.csv"))
    with pytest.raises(ConfigurationError, match="same name"):
        import_log(folder / "a_gyro.csv", folder / "map.toml", tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


def test_the_checksum_is_of_all_files(folder: Path) -> None:
    first = next(mapped_logs(folder / "map.toml")).checksum
    chamber = folder / "a_chamber.csv"
    chamber.write_text(chamber.read_text().replace("25.0", "25.5", 1))
    assert next(mapped_logs(folder / "map.toml")).checksum != first


def test_counters_that_begin_anew(tmp_path: Path) -> None:
    """Pulses of 2 arcsec on 16 bits, counted up and down; a clock of ms on 20 bits."""
    t_s = np.arange(3000) / 20.0 + 1000.0
    pulses = np.cumsum(np.where(t_s < 1080.0, 700, -900)) + 65000
    log = pd.DataFrame({"ms": np.mod(np.rint(1000.0 * t_s), 2**20), "n": np.mod(pulses, 2**16)})
    log.to_csv(tmp_path / "a.csv", index=False)
    (tmp_path / "map.toml").write_text(
        'format = 1\nunit_id = "G"\nlatitude_deg = 48.0\n[columns]\n'
        'time = { name = "ms", unit = "ms", wraps = 1048576 }\n'
        'output = { name = "n", unit = "2 arcsec total", wraps = 65536 }\n'
    )
    found = read_log(tmp_path / "a.csv", read_mapping(tmp_path / "map.toml"))
    assert found.time_s - found.time_s[0] == pytest.approx(t_s - t_s[0])
    dps = np.where(t_s < 1080.0, 700.0, -900.0) * 2.0 * 20.0 / 3600.0
    assert found.columns["output"][1:] == pytest.approx(dps[1:])


def test_a_clock_of_a_second_goes_on_however_far_apart_its_rows_are(tmp_path: Path) -> None:
    t_s = 0.6 * np.arange(50)
    pd.DataFrame({"ms": np.mod(1000.0 * t_s, 1000.0).round(), "r": np.cos(t_s)}).to_csv(
        tmp_path / "a.csv", index=False
    )
    (tmp_path / "map.toml").write_text(
        'format = 1\nunit_id = "G"\nlatitude_deg = 48.0\n[columns]\n'
        'time = { name = "ms", unit = "ms", wraps = 1000 }\noutput = { name = "r", unit = "deg/s" }\n'
    )
    assert read_log(tmp_path / "a.csv", read_mapping(tmp_path / "map.toml")).time_s == pytest.approx(t_s)
