"""`gyrobench look` against logs whose content is known: simulated with numpy, and recorded by others."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from bench.analysis.gap import read_model, read_recordings
from bench.analysis.look import LookOptions, half_differences, look, write_files
from bench.present.cli._app import app
from bench.record.exchange import read_mapping
from drivers.base.errors import ConfigurationError

SHARED = Path("../shared/data")
RATE = 100.0


def recording(name: str) -> Path:
    path = SHARED / name
    if not path.exists():
        pytest.skip(f"the recording {name} in ../shared/data is not here")
    return path


def written(
    path: Path, columns: dict[str, np.ndarray], separator: str = ",", head: str | None = None
) -> Path:
    names = separator.join(columns) if head is None else head
    np.savetxt(path, np.column_stack(list(columns.values())), "%.9g", separator, header=names, comments="")
    return path


def noise(count: int, arw: float, seed: int, rate: float = RATE) -> np.ndarray:
    """White rate noise in deg/s of an angle random walk in deg/sqrt(h): sigma = N sqrt(rate) * 60 deg/h."""
    return arw / 60.0 * np.sqrt(rate) * np.random.default_rng(seed).standard_normal(count)


def columns(count: int = 60_000, **extra: np.ndarray) -> dict[str, np.ndarray]:
    time = np.arange(count) / RATE
    gyros = {f"gyro_{axis} [deg/s]": noise(count, 0.2, seed) for seed, axis in enumerate("xyz")}
    return {"time [s]": time} | gyros | extra


@pytest.mark.parametrize(
    ("separator", "name"),
    [(",", "log.csv"), (";", "log.csv"), ("\t", "log.tsv"), (" ", "log.txt"), ("  ", "log.txt")],
)
def test_separator_header_units_and_rate_are_found(tmp_path, separator, name):
    log = written(
        tmp_path / name, columns(4000), separator, None if separator.strip() or separator == "\t" else ""
    )
    found = look(log, LookOptions() if separator.strip() or separator == "\t" else LookOptions(
        columns=["time=c1", "gyro=c2,c3,c4"], units=["c[234]=deg/s", "c1=s"]))  # fmt: skip
    assert found.clock.rate_hz == pytest.approx(RATE) and found.questions == ()
    assert [axis.channel.axis for axis in found.axes] == ["x", "y", "z"]
    assert {axis.channel.base_unit for axis in found.axes} == {"deg/s"}


def test_decimal_commas_comments_and_a_units_row(tmp_path):
    rows = ["% a remark", "Time;Gyro X;Acc X", "ms;dps;mg"]
    rows += [f"{10 * k};{k % 7 / 8:.3f};{1000 + k % 5:.1f}".replace(".", ",") for k in range(500)]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(rows))
    found = look(log)
    assert found.clock.rate_hz == pytest.approx(100.0)
    assert found.axes[0].figures.mean == pytest.approx(np.mean([k % 7 / 8 for k in range(500)]), abs=1e-4)
    assert found.axes[1].figures.mean == pytest.approx(1.002 * 9.80665, rel=1e-6)


def test_npy_npz_parquet_and_mat_say_the_same(tmp_path):
    from scipy.io import savemat

    data = columns(5000)
    plain = {name.split()[0]: values for name, values in data.items()}
    np.save(tmp_path / "a.npy", np.column_stack(list(data.values())))
    np.savez(tmp_path / "b.npz", **plain)
    pd.DataFrame(data).to_parquet(tmp_path / "c.parquet")
    savemat(tmp_path / "d.mat", {"imu": plain})
    options = LookOptions(columns=["time=c1", "gyro=c2,c3,c4"], units=["c[234]=deg/s", "c1=s"])
    by_name = LookOptions(units=["*gyro*=deg/s", "*time=s"])
    found = [look(tmp_path / "a.npy", options), *(look(tmp_path / n, by_name) for n in ("b.npz", "d.mat"))]
    for one in found:
        assert one.clock.rate_hz == pytest.approx(RATE)
        assert [axis.figures.mean for axis in one.axes] == pytest.approx(
            [v.mean() for v in list(data.values())[1:]]
        )


def test_mean_drift_and_white_noise_come_out_with_their_uncertainty(tmp_path):
    data = columns(120_000)
    hours = data["time [s]"] / 3600.0
    data["gyro_x [deg/s]"] += 0.01 + 0.006 * (hours - hours.mean())
    axis, steady, _ = look(written(tmp_path / "log.csv", data)).axes
    sigma = 0.2 / 60.0 * np.sqrt(RATE)
    assert axis.figures.sigma == pytest.approx(sigma, rel=0.02)
    assert abs(axis.figures.mean - 0.01) < 4.0 * axis.figures.mean_sigma
    assert steady.figures.mean_sigma == pytest.approx(sigma / np.sqrt(120_000), rel=0.6)
    assert axis.figures.mean_sigma > steady.figures.mean_sigma
    assert abs(axis.figures.drift_per_h - 0.006) < 4.0 * axis.figures.drift_sigma
    assert axis.allan is not None and axis.allan.fits
    assert axis.allan.coefficients[0, 1] == pytest.approx(0.2, rel=0.02)
    assert axis.spectrum is not None and axis.spectrum.lines == ()
    assert axis.spectrum.white == pytest.approx(sigma * np.sqrt(2.0 / RATE), rel=0.03)


def test_a_fit_that_does_not_describe_the_curve_is_noticed(tmp_path):
    data = columns(120_000)
    slow = np.repeat(np.random.default_rng(5).standard_normal(1200), 100)  # held for 1 s: no power law
    data["gyro_x [deg/s]"] += 0.2 * slow
    bad, good, _ = look(written(tmp_path / "log.csv", data), LookOptions(still=True)).axes
    assert bad.allan is not None and not bad.allan.fits and bad.allan.worst_ratio > 1.2
    assert good.allan is not None and good.allan.fits


def test_lines_are_found_at_the_full_rate_by_frequency_and_amplitude(tmp_path):
    data = columns(60_000)
    time = data["time [s]"]
    data["gyro_y [deg/s]"] += 0.01 * np.sin(2 * np.pi * 9.185 * time) + 0.02 * np.sin(2 * np.pi * 44.4 * time)
    found = look(written(tmp_path / "log.csv", data))
    assert [len(axis.spectrum.lines) for axis in found.axes if axis.spectrum] == [0, 2, 0]
    lines = found.axes[1].spectrum.lines  # type: ignore[union-attr]
    assert [line.frequency_hz for line in lines] == pytest.approx([9.185, 44.4], abs=0.01)
    assert [line.amplitude for line in lines] == pytest.approx([0.01, 0.02], rel=0.1)
    assert not any(line.broad for line in lines)


def test_steps_outliers_limits_and_the_grid(tmp_path):
    data = columns(60_000)
    gyro = data["gyro_x [deg/s]"]
    gyro[40_000:] += 0.02
    gyro[[1234, 50_000]] += [1.0, -2.0]
    data["gyro_y [deg/s]"] = np.rint(data["gyro_y [deg/s]"] / 0.005) * 0.005
    turn = 300.0 * np.clip(np.sin(2 * np.pi * 0.05 * data["time [s]"][:4000]), 0, 1)
    data["gyro_z [deg/s]"][10_000:14_000] = np.clip(data["gyro_z [deg/s]"][10_000:14_000] + turn, -250, 250)
    found = look(written(tmp_path / "log.csv", data))
    x, y, z = (axis.figures for axis in found.axes)
    assert [time_s for time_s, _ in x.steps] == pytest.approx([400.0], abs=3.0)
    assert x.steps[0][1] == pytest.approx(0.02, rel=0.2)
    assert (x.outliers, x.first_outlier_s) == (2, pytest.approx(12.34))
    assert x.largest_outlier == pytest.approx(-2.0, abs=0.2)
    assert y.quantum == pytest.approx(0.005) and np.isnan(z.quantum)
    assert z.limits == (250.0,) and x.limits == y.limits == ()
    assert {turn.axis for turn in found.motion.turns} == {"z"}


def test_rest_and_a_turn_of_known_angle(tmp_path):
    data = columns(20_000)
    data["gyro_z [deg/s]"][5000:9500] += 20.0
    found = look(written(tmp_path / "log.csv", data))
    (turn,) = found.motion.turns
    assert (turn.axis, turn.start_s, turn.stop_s) == (
        "z",
        pytest.approx(50.0, abs=1),
        pytest.approx(95.0, abs=1),
    )
    assert turn.angle == pytest.approx(900.0, rel=1e-3)
    assert abs(found.axes[2].figures.mean) < 0.001


def test_gaps_padding_stuck_and_copied_columns_are_said(tmp_path):
    data = columns(9000)
    data["gyro_copy_z [deg/s]"] = data["gyro_x [deg/s]"]
    data["gyro_y [deg/s]"][2000:2400] = 0.5
    kept = np.delete(np.arange(9000), np.r_[4000:4005, 6000:6100])
    rows = np.column_stack(list(data.values()))[kept]
    rows = np.vstack([rows, np.column_stack([rows[-1, 0] + np.arange(1, 51) / RATE, np.zeros((50, 4))])])
    log = tmp_path / "log.csv"
    np.savetxt(log, rows, "%.9g", ",", header=",".join(data), comments="")
    found = look(log)
    assert (found.clock.gaps, found.clock.lost, found.clock.rows) == (2, 105, len(kept))
    assert found.clock.longest_s == pytest.approx(1.01)
    said = " / ".join(found.remarks)
    assert "gyro_copy_z is a copy of gyro_x" in said
    assert "gyro_y is stuck at 0.5 for 400 rows from row 2001 on" in said
    assert "50 after the last one" in said


def test_what_cannot_be_known_is_asked(tmp_path):
    data = {f"g{axis}": np.rint(100 * noise(3000, 1.0, seed)) for seed, axis in enumerate("xyz")}
    log = written(tmp_path / "log.csv", data)
    found = look(log)
    assert not found.clock.known and len(found.questions) == 2
    with pytest.raises(ConfigurationError, match="unit and the sample rate"):
        write_files(found, tmp_path / "out", latitude_deg=48.0)
    told = look(log, LookOptions(rate_hz=50.0, units=["g*=0.01 deg/s"]))
    assert told.questions == ()
    assert told.axes[0].figures.sigma == pytest.approx(0.01 * data["gx"].std())
    with pytest.raises(ConfigurationError, match="unit is not known"):
        look(log, LookOptions(units=["gx=furlong"]))


def test_temperature_is_judged_on_a_leg_left_out(tmp_path):
    count = 40_000
    temperature = 20.0 + 30.0 * np.abs(np.linspace(-2, 2, count) % 2 - 1.0)
    data = columns(count, **{"temperature [degC]": temperature})
    data["gyro_x [deg/s]"] += 2e-3 * temperature
    data["gyro_y [deg/s]"] += 0.05 * np.linspace(0, 1, count)  # a drift is no temperature
    x, y, _ = (
        axis.temperature for axis in look(written(tmp_path / "log.csv", data), LookOptions(still=True)).axes
    )
    assert x is not None and x.legs >= 3 and x.explained is not None and x.explained > 0.95
    assert x.slope == pytest.approx(2e-3, rel=0.03)
    assert y is not None and y.explained is not None and y.explained < 0.2


def test_the_command_writes_what_the_diagnosis_reads(tmp_path):
    log = written(tmp_path / "log.csv", columns(60_000))
    out, page = tmp_path / "out", tmp_path / "look.html"
    words = ["look", str(log), "--json", "--write", str(out), "--latitude", "48", "--report", str(page)]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    facts = json.loads(result.output)
    assert facts["kind"] == "look" and facts["clock"]["rate_hz"] == pytest.approx(RATE)
    assert [axis["channel"]["axis"] for axis in facts["axes"]] == ["x", "y", "z"]
    (run,) = read_recordings([out / "log_x.toml"]).runs
    assert run.stimulus.latitude_deg == 48.0 and len(run.output_dph) == 599
    assert read_model(out / "log_x_nominal.toml").noise.arw_deg_per_sqrt_h == pytest.approx(0.2, rel=0.05)
    text = page.read_text(encoding="utf-8")
    assert "Nyquist frequency, 50 Hz" in text and "<svg" in text


def test_earth_rate_in_a_parked_ring_laser():
    """Axis z up at 34.246 deg north, x west of it: 15.041 deg/h times sine and minus cosine of the latitude."""
    options = LookOptions(
        columns=["gyro=gf*", "accelerometer=af*"],
        units=["gf*=0.1 arcsec/sample", "af*=125 ug*s/sample"],
        rate_hz=100.0,
    )
    found = look(recording("rlg_psins_vehicle_static/lasergyro.imu"), options)
    assert found.clock.rows == 184_718  # the three numeric lines of the header left out
    x, _, z = (axis.figures for axis in found.axes[:3])
    latitude = np.radians(34.246048)
    assert 3600 * x.mean == pytest.approx(-15.041 * np.cos(latitude), abs=0.3)
    assert 3600 * z.mean == pytest.approx(15.041 * np.sin(latitude), abs=0.3)
    assert z.quantum == pytest.approx(0.1 / 3600 * 100.0)
    assert not found.motion.turns
    assert found.axes[5].figures.mean == pytest.approx(9.79, abs=0.05)


def test_full_turns_of_a_ferraris_session():
    """Its section list has three turns by 360 deg: x, y and z in this order, made by hand."""
    path = recording("ferraris_imucal/example_ferraris_session.csv")
    found = look(path, LookOptions(rate_hz=102.4, units=["gyr*=deg/s"]))
    sections = json.loads(path.with_name("example_ferraris_session_list.json").read_text())
    for axis in "xyz":
        start, stop = (sections[f"{axis}_rot"][key] / 102.4 for key in ("start", "end"))
        (turn,) = [turn for turn in found.motion.turns if turn.start_s < stop and turn.stop_s > start]
        assert turn.axis == axis and abs(turn.angle) == pytest.approx(360.0, abs=15.0)
    assert found.axes[0].figures.quantum == pytest.approx(2000.0 / 2**15, rel=1e-3)


def test_a_chamber_cycle_says_which_axis_follows_temperature():
    """y is a clean function of temperature, x depends on the past, z is hardly reproducible."""
    path = recording("mems_chamber_cycle/imu_raw_data_first_legs.csv")
    found = look(path, LookOptions(units=["imu.gyro*=rad/s"], still=True))
    x, y, z = (axis.temperature for axis in found.axes[:3])
    assert y is not None and y.explained is not None and y.explained > 0.9 and y.legs == 2
    assert x is not None and x.explained is not None and x.explained < 0.5
    assert z is not None and z.explained is not None and z.explained < 0.2
    assert any("timestamp" in question for question in found.questions)
    in_ns = look(path, LookOptions(units=["imu.gyro*=rad/s", "timestamp=ns"], still=True))
    assert any("not those of the recording" in question for question in in_ns.questions)


def test_counts_that_stay_at_the_end_of_their_range():
    found = look(recording("multiposition_mpu6050/example_data_calibration.csv"))
    assert found.clock.rate_hz == 100.0 and found.clock.source == "the header"
    assert found.axes[0].channel.name == "gx" and found.axes[0].figures.limits == (-32768.0,)
    assert found.motion.rests_s[0][1] == pytest.approx(36.5, abs=2.0)  # the header's initialisation time


@pytest.mark.parametrize(
    ("name", "values", "rate_hz"),
    [("timestamp", 1.7e12 + np.arange(3000), 1000.0), ("timestamp", 1.7e18 + 1e7 * np.arange(3000), 100.0),
     ("time", 1.7e9 + np.arange(3000), 1.0), ("time", np.arange(3000.0), None),
     ("t_ms", np.arange(3000.0), 1000.0)],
)  # fmt: skip
def test_a_time_without_a_unit_is_known_since_1970_or_asked(tmp_path, name, values, rate_hz):
    """A step of 1 may be 1 s or 1 ms: neither is stated as a fact; counted from 1970, only one is in our time."""
    rows = np.column_stack([values, noise(3000, 1.0, 1)])
    np.savetxt(tmp_path / "log.csv", rows, "%.0f,%.9g", header=f"{name},gyro_x", comments="")
    found = look(tmp_path / "log.csv", LookOptions(units=["gyro_x=deg/s"]))
    if rate_hz is None:
        assert not found.clock.known
        assert any("s: 1 Hz, ms: 1000 Hz" in question for question in found.questions)
    else:
        assert found.clock.rate_hz == pytest.approx(rate_hz) and found.questions == ()


def test_a_units_word_that_fits_no_gyro_is_asked_and_a_tables_rate_is_no_gyro(tmp_path):
    count = 3000
    data = {"t [s]": np.arange(count) / RATE, "gyro_x [mg]": noise(count, 1.0, 1)}
    data |= {"yaw_rate [deg/s]": noise(count, 1.0, 2), "table_rate [deg/s]": np.full(count, 5.0)}
    data |= {"rate_demand [deg/s]": np.full(count, 5.0)}
    found = look(written(tmp_path / "log.csv", data))
    assert [(axis.channel.name, axis.channel.axis) for axis in found.axes] == [
        ("gyro_x", "x"),
        ("yaw_rate", "z"),
    ]
    assert found.columns.ignored == ("table_rate", "rate_demand")
    assert (
        "gyro_x: what the log has for a unit, mg, is none for gyros" in found.remarks
        and len(found.questions) == 1
    )


def test_a_clock_that_jumps_by_years_is_refused_with_its_row(tmp_path):
    data = columns(3000)
    data["time [s]"][2000:] += 1.7e9
    pd.DataFrame(data).to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(ConfigurationError, match="row 2000: the times are none of a recording"):
        look(tmp_path / "log.csv")


def test_a_pair_up_and_down_gives_bias_and_the_earths_rate(tmp_path):
    """z up, then down at 48 deg north: bias +- 15.041 deg/h sin 48 deg; the accelerometers say which axis."""
    earth, logs = 15.041 * np.sin(np.radians(48.0)) / 3600.0, []
    for name, sign, seed in (("up", 1.0, 10), ("down", -1.0, 20)):
        data = {"t [s]": np.arange(60_000) / RATE}
        for number, axis in enumerate("xyz"):
            up = sign * (axis == "z")
            data[f"gyro_{axis} [deg/s]"] = 0.01 + up * earth + noise(60_000, 0.02, seed + number)
            data[f"acc_{axis} [m/s^2]"] = 0.1 + up * 9.8 + noise(60_000, 0.1, seed + 5 + number)
        pd.DataFrame(data).to_csv(tmp_path / f"{name}.csv", index=False)
        logs.append(str(tmp_path / f"{name}.csv"))
    for first, second, sign in ((logs[0], logs[1], 1.0), (logs[1], logs[0], -1.0)):
        result = CliRunner().invoke(app, ["look", first, "--turned", second, "--latitude", "48", "--json"])
        assert result.exit_code == 0, result.output
        pair = {row["name"]: row for row in json.loads(result.output)["half_differences"]}
        z, heavy = pair["gyro_z"], pair["acc_z"]
        assert z["earth_rate"] == pytest.approx(sign * earth, rel=1e-4) and z["sigma"] < earth / 20.0
        assert z["half_difference"] == pytest.approx(sign * earth, abs=4.0 * z["sigma"])
        assert z["bias"] == pytest.approx(0.01, abs=4.0 * z["sigma"])
        assert heavy["half_difference"] == pytest.approx(sign * 9.8, abs=1e-3)
        assert heavy["bias"] == pytest.approx(0.1, abs=1e-3) and pair["gyro_x"]["earth_rate"] is None


def test_a_recorded_pair_up_and_down():
    """Its readme says that x points up and down: what the accelerometer changes by is gravity."""
    first, second = (recording(f"mems_adi_updown/x_adi_{name}.txt") for name in ("up", "down"))
    options = LookOptions(
        columns=["time=c1", "gyro=c2,c3,c4", "accelerometer=c5,c6,c7"], units=["c[234]=deg/s"]
    )
    pair = {axis.name: axis for axis in half_differences(look(first, options), look(second, options), 32.0)}
    assert abs(pair["c5"].half_difference) == pytest.approx(9.81, abs=0.06)
    assert abs(pair["c6"].half_difference) < 0.5 > abs(pair["c7"].half_difference)
    assert pair["c2"].earth_rate is not None and pair["c3"].earth_rate is None


def test_a_chambers_log_is_not_taken_for_gyros(tmp_path):
    """Columns whose units or names are those of other things are not looked at as gyros for want of any."""
    data = {
        "Time (sec)": np.arange(600.0),
        "Heater 1 (%)": np.arange(600.0) % 7,
        "Temperature 1 (degC)": noise(600, 1.0, 1),
    }
    with pytest.raises(ConfigurationError, match="no gyro and no accelerometer"):
        look(written(tmp_path / "log.csv", data))
    del data["Temperature 1 (degC)"]
    with pytest.raises(ConfigurationError, match="no gyro and no accelerometer"):
        look(written(tmp_path / "log.csv", data))


def test_a_gap_is_neither_rest_nor_shaking(tmp_path):
    data = columns(6000)
    data["time [s]"][3000:] += 1000.0
    pd.DataFrame(data).to_csv(tmp_path / "log.csv", index=False)
    found = look(tmp_path / "log.csv")
    assert found.clock.lost == 100_000 and found.motion.shaken_s <= 1.0


def test_names_of_a_flight_computer(tmp_path):
    """GPS time of week is a time, "gs" a unit; what a filter estimated is no sensor."""
    data = {"GPS TOW": 137649.0 + np.arange(3000) / 100.0, "raw_acceleration_x_gs": noise(3000, 1.0, 1)}
    data |= {f"{name}_angular_rate_z_deg_per_s": noise(3000, 1.0, 2) for name in ("raw", "est")}
    pd.DataFrame(data).to_csv(tmp_path / "log.csv", index=False)
    found = look(tmp_path / "log.csv")
    assert found.clock.rate_hz == pytest.approx(100.0) and found.questions == ()
    assert [axis.channel.name[:3] for axis in found.axes] == ["raw", "raw"]
    assert found.columns.ignored == ("est_angular_rate_z_deg_per_s",)


def test_rows_that_come_late_and_are_made_up_for_are_not_lost(tmp_path):
    """A busy bus holds rows back; the ones after come early. A row that is missing is never made up for."""
    data = columns(9000)
    data["time [s]"][1000:8000:100] += 0.9 / RATE
    data["time [s]"][1001:8001:100] += 0.45 / RATE
    pd.DataFrame(data).drop(index=[5050, 8500]).to_csv(tmp_path / "log.csv", index=False)
    clock = look(tmp_path / "log.csv").clock
    assert (clock.gaps, clock.lost, clock.odd) == (2, 2, 0) and clock.rate_hz == pytest.approx(RATE, rel=1e-3)


def test_the_grid_of_values_is_that_of_the_log_not_of_what_was_filled_in():
    """Rate in steps of 0.25 deg/s, acceleration of 0.125 m/s^2 by the DBC file; rows are missing in places."""
    path = recording("can_canmod_gps/00000005-60FEB5A8.MF4")
    found = look(path, LookOptions(dbc=[path.with_name("canmod-gps.dbc")]))
    quanta = {axis.channel.name: axis.figures.quantum for axis in found.axes}
    assert {quanta[f"AngularRate{axis}"] for axis in "XYZ"} == {0.25}
    assert {quanta[f"Acceleration{axis}"] for axis in "XYZ"} == {0.125}


def test_accelerometers_alone_tell_rests_by_their_attitudes(tmp_path):
    """Three attitudes of 20 s, hand-turned between; the mean is that of one of them and not of all."""
    rng, g = np.random.default_rng(5), 9.80665
    parts = []
    for axis in range(3):
        parts.append(np.outer(np.ones(2000), g * np.eye(3)[axis]))
        angle = np.linspace(0.0, np.pi / 2, 300)[:, None]
        turned = np.cos(angle) * np.eye(3)[axis] + np.sin(angle) * np.eye(3)[(axis + 1) % 3]
        parts.append(g * turned + rng.normal(0.0, 0.8, (300, 3)))
    forces = np.concatenate(parts) + rng.normal(0.0, 0.02, (6900, 3))
    log = written(tmp_path / "log.csv", {f"acc_{axis} [m/s2]": forces[:, k] for k, axis in enumerate("xyz")})
    found = look(log, LookOptions(rate_hz=RATE))
    starts = [start for start, _ in found.motion.rests_s]
    assert starts == pytest.approx([0.0, 23.0, 46.0], abs=1.0) and not found.motion.by_gyros
    assert all(stop - start == pytest.approx(20.0, abs=1.0) for start, stop in found.motion.rests_s)
    means = sorted(abs(axis.figures.mean) for axis in found.axes)
    assert means == pytest.approx([0.0, 0.0, g], abs=0.01)
    said = CliRunner().invoke(app, ["look", str(log), "--rate", "100"]).output
    assert "3 stretches" in said and "accelerometers alone" in said


def test_many_columns_without_names_begin_with_those_that_feel_gravity(tmp_path):
    """Time, three of gravity, three rates, magnetometers, pressure: as a flight computer writes them."""
    rng, count = np.random.default_rng(6), 4000
    rates = rng.normal(0.0, 0.1, (count, 3))
    rates[1500:1700, 1] += 30.0
    forces = np.array([0.1, -0.2, 9.8]) + rng.normal(0.0, 0.01, (count, 3))
    more = np.column_stack([rng.normal(8000.0, 20.0, (count, 3)), rng.normal(97.5, 0.01, count)])
    log = tmp_path / "log.txt"
    np.savetxt(
        log, np.column_stack([np.arange(count) / RATE, forces, rates, more]), "%.6f", "\t", comments=""
    )
    found = look(log)
    kinds = {axis.channel.name: axis.channel.kind for axis in found.axes}
    assert kinds == {f"c{n}": "accelerometer" if n < 5 else "gyro" for n in range(2, 8)}
    assert [turn.axis for turn in found.motion.turns] == ["y"]
    assert any("4 behind them are not looked at" in remark for remark in found.remarks)
    swapped = np.column_stack([np.arange(count) / RATE, rates, forces, more])
    np.savetxt(log, swapped, "%.6f", "\t", comments="")
    kinds = {axis.channel.name: axis.channel.kind for axis in look(log).axes}
    assert kinds == {f"c{n}": "gyro" if n < 5 else "accelerometer" for n in range(2, 8)}


def test_without_a_known_rate_a_line_has_cycles_a_sample(tmp_path):
    rng = np.random.default_rng(7)
    tone = np.sin(0.2 * np.arange(20_000)) + rng.normal(0.0, 0.1, 20_000)
    log = written(tmp_path / "log.csv", {"gyro_x [deg/s]": tone, "gyro_y [deg/s]": rng.normal(0, 1, 20_000)})
    said = CliRunner().invoke(app, ["look", str(log), "--still"]).output
    assert f"lines at {0.2 / (2 * np.pi):.3g}" in said and "cycles a sample" in said and " Hz and" not in said


def test_a_mapping_of_an_imu_names_all_its_axes(tmp_path):
    data = {f"gyro_{axis} [deg/s]": noise(3000, 0.05, seed) for seed, axis in enumerate("xyz")}
    data |= {f"acc_{axis} [m/s^2]": noise(3000, 0.02, 9 + seed) for seed, axis in enumerate("xyz")}
    data["acc_z [m/s^2]"] += 9.80665
    found = look(written(tmp_path / "log.csv", data), LookOptions(rate_hz=50.0))
    files = write_files(found, tmp_path / "out", latitude_deg=48.0)
    mapping = read_mapping(next(file for file in files if file.name == "log_y.toml"))
    assert mapping.axis == "y" and set(mapping.columns.gyros) == set(mapping.columns.accelerometers) == set(
        "xyz"
    )
    assert mapping.columns.accelerometers["z"].name.startswith("acc_z")


def test_a_temperature_in_ms_is_a_french_time(tmp_path):
    time_ms = 5.0 * np.arange(4000.0)
    rates = np.random.default_rng(2).normal(0.0, 0.01, 4000)
    temps = 23.0 + 1e-4 * np.arange(4000.0)
    head = "Temps [ms];Gyro Z [deg/s];Température [°C]"
    path = written(tmp_path / "fr.csv", {"a": time_ms, "b": rates, "c": temps}, ";", head)
    found = look(path)
    assert found.columns.time is not None and found.columns.time.name == "Temps"
    assert [axis.channel.name for axis in found.axes] == ["Gyro Z"]
