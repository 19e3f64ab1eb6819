"""`look` at the ways in which other software writes logs; each layout is that of a program in wide use."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from bench.analysis.look import Look, LookOptions, look
from bench.present.look_words import noise_words
from drivers.base.errors import ConfigurationError

RATE, ROWS = 100.0, 1500
TIME = np.arange(ROWS) / RATE
_RNG = np.random.default_rng(5)
GYROS = np.radians(0.1) * _RNG.standard_normal((ROWS, 3))  # rad/s
FORCE = np.array([0.2, -0.3, 9.79]) + 0.02 * _RNG.standard_normal((ROWS, 3))
RAD, MPS2 = {"rad/s"}, {"m/s^2"}


def lines(header: str, row: Callable[[int], str]) -> str:
    return header + "".join(row(k) + "\n" for k in range(ROWS))


def of(values: np.ndarray, separator: str = ",") -> str:
    return separator.join(f"{value:.7f}" for value in values)


def clock(k: int) -> str:
    return f"12:{k // 6000:02d}:{k // 100 % 60:02d}"


LAYOUTS: dict[str, tuple[str, str]] = {
    # a visual-inertial data set: units decide, the header is a comment
    "euroc": ("data.csv", lines(
        "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
        "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n",
        lambda k: f"{1403636579758555392 + k * 10_000_000},{of(GYROS[k])},{of(FORCE[k])}")),
    # a phone's logger with other accelerations beside the sensor's, times of day with ms behind a colon
    "androsensor": ("Sensor_record.csv", lines(
        "ACCELEROMETER X (m/s²);ACCELEROMETER Y (m/s²);ACCELEROMETER Z (m/s²);GRAVITY X (m/s²);GRAVITY Y (m/s²);"
        "GRAVITY Z (m/s²);LINEAR ACCELERATION X (m/s²);LINEAR ACCELERATION Y (m/s²);LINEAR ACCELERATION Z (m/s²);"
        "GYROSCOPE X (rad/s);GYROSCOPE Y (rad/s);GYROSCOPE Z (rad/s);SOUND LEVEL (dB);Time since start in ms ;"
        "YYYY-MO-DD HH-MI-SS_SSS\n",
        lambda k: f"{of(FORCE[k], ';')};0;0;9.8;0.01;0.02;0.03;{of(GYROS[k], ';')};50.1;{10 * k};"
        f"2015-05-14 {clock(k)}:{10 * (k % 100):03d}")),
    # a line of labels a sample, with a state in it that changes
    "labelled": ("serial.log", lines("", lambda k:
        f"2025-10-04 {clock(k)}.{10 * (k % 100):03d},GYRO(rad/s): X={GYROS[k][0]:.7f},Y={GYROS[k][1]:.7f},"
        f"Z={GYROS[k][2]:.7f},ACCEL(m/s^2): X={FORCE[k][0]:.5f},Y={FORCE[k][1]:.5f},Z={FORCE[k][2]:.5f},"
        f"GPS: {'3D_FIX' if k % 7 else 'NO_FIX'},SAT={k % 9}")),
    "json lines": ("log.jsonl", lines("", lambda k:
        f'{{"t_s": {TIME[k]:.2f}, "gyro_x_rads": {GYROS[k][0]:.7f}, "gyro_y_rads": {GYROS[k][1]:.7f}, '
        f'"gyro_z_rads": {GYROS[k][2]:.7f}, "ax_mps2": {FORCE[k][0]:.5f}, "ay_mps2": {FORCE[k][1]:.5f}, '
        f'"az_mps2": {FORCE[k][2]:.5f}}}')),
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts_that_say_everything(tmp_path: Path, layout: str) -> None:
    name, text = LAYOUTS[layout]
    (tmp_path / name).write_text(text)
    found = look(tmp_path / name)
    assert found.questions == () and found.clock.rate_hz == pytest.approx(RATE, rel=1e-3)
    check(found)


def check(found: Look) -> None:
    """Six axes in the right units, with the means of the first 1500 rows."""
    axes = {(axis.channel.kind, axis.channel.axis): axis for axis in found.axes}
    assert len(found.axes) == 6 and found.clock.rows == ROWS
    for k, axis in enumerate("xyz"):
        assert axes["gyro", axis].figures.mean == pytest.approx(np.degrees(GYROS[:, k].mean()), abs=2e-4)
        assert axes["accelerometer", axis].figures.mean == pytest.approx(FORCE[:, k].mean(), abs=1e-4)


def test_a_file_of_three_axes_is_what_its_name_says(tmp_path: Path) -> None:
    log = tmp_path / "Gyroscope.csv"
    log.write_text(lines("time,seconds_elapsed,z,y,x\n", lambda k:
        f"{1788594189329554432 + k * 10_000_000},{TIME[k]:.7f},{of(GYROS[k][::-1])}"))  # fmt: skip
    found = look(log)
    assert [axis.channel.axis for axis in found.axes] == ["z", "y", "x"]
    assert {axis.channel.kind for axis in found.axes} == {"gyro"}
    assert found.clock.rate_hz == pytest.approx(RATE, rel=1e-3) and "unit of z, y, x" in found.questions[0]


def test_lines_of_several_kinds(tmp_path: Path) -> None:
    log = tmp_path / "flight.log"
    names = "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
    header = (
        f"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 1, 9, IMU, QffffFf, {names}\n"
        "FMT, 2, 9, BARO, Qff, TimeUS,Alt,Press\n"
    )
    log.write_text(lines(header, lambda k: f"IMU, {10_000 * k}, {of(GYROS[k], ', ')}, {of(FORCE[k], ', ')}\n"
                         f"BARO, {10_000 * k}, {584.1 + k % 7}, 95000"))  # fmt: skip
    found = look(log, LookOptions(units=["Gyr*=rad/s"]))
    check(found)
    assert found.questions == () and "kinds of lines, those of IMU read" in found.remarks[0]
    other = look(log, LookOptions(group="BARO", columns=["gyro=Alt"]))
    assert [axis.channel.name for axis in other.axes] == ["Alt"]


def test_a_checksum_behind_the_last_number(tmp_path: Path) -> None:
    log = tmp_path / "vn.txt"
    log.write_text(lines("", lambda k: f"$VNYMR,+006.4,+000.0,{of(FORCE[k])},{of(GYROS[k])}*{k % 256:02X}"))
    found = look(log, LookOptions(columns=["gyro=c7,c8,c9", "accelerometer=c4,c5,c6"], units=["c[789]=rad/s"],
                                  rate_hz=RATE))  # fmt: skip
    check(found)


def test_names_within_brackets_of_a_comment(tmp_path: Path) -> None:
    names = [f"Raw{kind}{axis}" for kind in ("Gyro", "Accel") for axis in "XYZ"]
    header = ",".join(["%int(ChipTimeUS)", *(f"%float({name})" for name in names)])
    log = tmp_path / "yei.txt"
    log.write_text(
        lines(f' # Data format: "{header}"\n', lambda k: f"{10_000 * k},{of(GYROS[k])},{of(FORCE[k])}")
    )
    check(look(log, LookOptions(units=["RawGyro*=rad/s"])))


def test_labels_of_a_matrix_in_the_same_file_and_text_called_mat(tmp_path: Path) -> None:
    words = np.array(["TimeMS", "GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ"], dtype=object)
    matrix = np.column_stack([1000.0 * TIME, GYROS, FORCE])
    longer = np.arange(2.0 * ROWS).reshape(-1, 1)
    scipy.io.savemat(tmp_path / "log.mat", {"IMU": matrix, "IMU_label": words, "BARO": longer})
    found = look(tmp_path / "log.mat", LookOptions(units=["IMU.Gyr*=rad/s"]))
    check(found)
    assert any("another length: BARO" in remark for remark in found.remarks)
    np.savetxt(tmp_path / "xsens_gyro.mat", np.column_stack([TIME, GYROS]))
    assert {axis.channel.kind for axis in look(tmp_path / "xsens_gyro.mat").axes} == {"gyro"}


def test_rows_read_in_bursts_have_one_pace(tmp_path: Path) -> None:
    arrival = np.arange(ROWS) // 8 * 0.08 + 8e-4 * (np.arange(ROWS) % 8)
    np.savetxt(tmp_path / "bursts.csv", np.column_stack([arrival, GYROS]), "%.7f", ",",
               header="time [s],gx [rad/s],gy [rad/s],gz [rad/s]", comments="")  # fmt: skip
    found = look(tmp_path / "bursts.csv")
    assert (
        found.clock.bursts and found.clock.lost == 0 and found.clock.rate_hz == pytest.approx(RATE, rel=0.01)
    )


def test_whole_seconds_as_times(tmp_path: Path) -> None:
    gyros = np.tile(GYROS, (20, 1))
    np.savetxt(tmp_path / "s.csv", np.column_stack([np.arange(len(gyros)) // 100, gyros]), "%.7f", ",",
               header="time [s],gx [rad/s],gy [rad/s],gz [rad/s]", comments="")  # fmt: skip
    assert look(tmp_path / "s.csv").clock.rate_hz == pytest.approx(RATE, rel=0.01)


def test_two_sensors_with_times_of_their_own(tmp_path: Path) -> None:
    table = np.column_stack([TIME, FORCE, 0.5 * TIME, GYROS])
    np.savetxt(tmp_path / "phone.csv", table, "%.7f", ",", comments="",
               header="Acc Timestamp,AccX,AccY,AccZ,Gyro Timestamp,GyroX,GyroY,GyroZ")  # fmt: skip
    questions = look(tmp_path / "phone.csv").questions
    assert any("Acc Timestamp and Gyro Timestamp are times of different pace" in one for one in questions)


def test_turned_by_hand_all_the_time_is_no_rest(tmp_path: Path) -> None:
    swing = GYROS + np.sin(2 * np.pi * 0.7 * TIME)[:, None]
    np.savetxt(tmp_path / "hand.csv", np.column_stack([TIME, swing]), "%.7f", ",",
               header="time [s],gx [rad/s],gy [rad/s],gz [rad/s]", comments="")  # fmt: skip
    found = look(tmp_path / "hand.csv")
    assert not found.motion.rests_s and any("nothing in it rests" in remark for remark in found.remarks)


def test_without_gravity_and_without_a_rate(tmp_path: Path) -> None:
    names = ",".join(f"Linear Acceleration {axis} (m/s^2)" for axis in "xyz")
    np.savetxt(tmp_path / "lin.csv", FORCE - [0.2, -0.3, 9.79], "%.7f", ",", header=names, comments="")
    found = look(tmp_path / "lin.csv")
    assert any("not gravity's 9.81" in remark for remark in found.remarks)
    assert "sqrt(sample)" in noise_words(found.axes[0])  # no unit with hours without a clock


@pytest.mark.parametrize(
    "names",
    [
        ("t", "lat", "lon", "h", "vel1", "vel2", "vel3"),
        ("time", "Roll (deg)", "Pitch (deg)", "Yaw (deg)"),
        ("time", "q_w", "q_x", "q_y", "q_z"),
        ("Packet number", "Element 11", "Element 12", "Element 13"),
        ("t", "DCMnb_m1", "DCMnb_m2", "DCMnb_m3", "ang_std1"),
    ],
)
def test_a_log_of_positions_and_attitudes_has_no_gyro(tmp_path, names):
    """Outputs of a navigation filter are none of what this looks at, whatever their values."""
    values = np.column_stack([TIME, *(GYROS[:, k % 3] for k in range(len(names) - 1))])
    path = tmp_path / "log.csv"
    np.savetxt(path, values, "%.7f", ",", header=",".join(names), comments="")
    with pytest.raises(ConfigurationError, match="no gyro and no accelerometer"):
        look(path)


def test_a_direction_of_length_one_is_no_accelerometer(tmp_path):
    vectors = FORCE + np.column_stack([np.sin(TIME), np.cos(TIME), TIME])
    vectors /= np.linalg.norm(vectors, axis=1)[:, None]
    path = tmp_path / "log.txt"
    np.savetxt(path, np.column_stack([TIME, vectors]), "%.9f")
    assert {axis.channel.kind for axis in look(path).axes} == {"gyro"}
    np.savetxt(path, np.column_stack([TIME, FORCE / 9.80665]), "%.9f")
    assert {(axis.channel.kind, axis.channel.unit) for axis in look(path).axes} == {("accelerometer", "g")}


def test_one_letter_alone_is_no_gyro(tmp_path):
    path = tmp_path / "log.csv"
    values = np.column_stack([TIME, GYROS, FORCE])
    np.savetxt(path, values, "%.7f", ",", header="t,p,q,r,ax,ay,az", comments="")
    assert [axis.channel.name for axis in look(path).axes][:3] == ["p", "q", "r"]
    np.savetxt(path, values[:, [0, 2, 4, 5, 6]], "%.7f", ",", header="t,q,ax,ay,az", comments="")
    assert [axis.channel.name for axis in look(path).axes] == ["ax", "ay", "az"]


def test_rates_as_large_as_gravity_are_those_of_gyros_where_the_log_is_called_so(tmp_path):
    """Turned by hand at some 10 deg/s: the norm is that of gravity now and then, and not all the time."""
    size = np.abs(np.sin(0.4 * TIME)) * 20.0
    rates = size[:, None] * np.array([0.1, 0.2, 0.97]) + GYROS
    for name, kinds in (("mpu_gyroscope.txt", {"gyro"}), ("log.txt", {"gyro"}), ("mpu_compass.txt", set())):
        path = tmp_path / name
        np.savetxt(path, np.column_stack([TIME, rates]), "%.7f")
        if kinds:
            assert {axis.channel.kind for axis in look(path).axes} == kinds
        else:
            with pytest.raises(ConfigurationError, match="no gyro and no accelerometer"):
                look(path)


@pytest.mark.parametrize(
    ("header", "gyro", "time"),
    [
        ("DateTime [s],Rate [deg/h],Az [deg],El [deg]", "Rate [deg/h]", "DateTime [s]"),
        ("ms,rate_lsb,az_deg,el_deg", "rate_lsb", "ms"),
        ("Zeit_s,Drehrate_gps,Winkel,Elevation", "Drehrate_gps", "Zeit_s"),
    ],
)
def test_a_gyro_beside_the_azimuth_of_its_table(tmp_path: Path, header: str, gyro: str, time: str) -> None:
    """Names of an optical gyro's laboratory: an azimuth is no accelerometer, a time's name is its unit."""
    step = 10 if time == "ms" else 0.01
    rows = (f"{k * step:g},{GYROS[k][0]:.7f},{0.01 * k:.4f},90\n" for k in range(ROWS))
    (tmp_path / "log.csv").write_text(header + "\n" + "".join(rows))
    found = look(tmp_path / "log.csv")
    assert [axis.channel.name for axis in found.axes] == [gyro.partition(" [")[0]]
    assert found.clock.rate_hz == pytest.approx(RATE)
    assert found.columns.time is not None and found.columns.time.name == time.partition(" [")[0]
    assert not any("Az" in text or "az_deg" in text for text in found.questions)


def test_columns_that_say_something_else_are_not_taken_for_gyros(tmp_path):
    """A phone's positions: their accuracies have the norm of gravity in mg, by chance."""
    rng = np.random.default_rng(8)
    names = (
        "time,seconds_elapsed,bearingAccuracy,speedAccuracy,verticalAccuracy,horizontalAccuracy,speed,bearing"
    )
    values = np.column_stack([TIME, 1000.0 + 0 * TIME, *rng.uniform(0.0, 9.0, (6, ROWS))])
    path = tmp_path / "phone.csv"
    np.savetxt(path, values, "%.6f", ",", header=names, comments="")
    with pytest.raises(ConfigurationError, match="no gyro and no accelerometer"):
        look(path)


@pytest.mark.parametrize(
    ("name", "per_rad_s"),
    [("gyro_x_mdps", np.degrees(1e3)), ("gyro_x_mdeg_s", np.degrees(1e3)), ("gyro_x_mrad_s", 1e3),
     ("gyro_x_mradps", 1e3), ("gyro_x_radps", 1.0), ("gyro_x_dps", np.degrees(1.0)),
     ("yaw_rate_deg_s", np.degrees(1.0)), ("gyro_x_urad_s", None)],
)  # fmt: skip
def test_prefixes_of_units_in_names_count(tmp_path: Path, name: str, per_rad_s: float | None) -> None:
    rate = 1e-3 + GYROS[:, 0]
    rows = "".join(f"{t:.2f},{w:.6f}\n" for t, w in zip(TIME, rate * (per_rad_s or 1e6), strict=True))
    (tmp_path / "log.csv").write_text(f"time_s,{name}\n{rows}")
    found = look(tmp_path / "log.csv")
    if per_rad_s is None:
        assert any("the unit of" in question for question in found.questions)
        return
    assert found.axes[0].figures.mean == pytest.approx(np.degrees(rate.mean()), rel=1e-3)


def test_what_is_counted_since_power_on_is_no_rate(tmp_path: Path) -> None:
    """An angle in steps of 0.1 arcsec, one row missing: the rate is its change, and not known over the hole."""
    rate_dps = 0.01 + 0.02 * _RNG.standard_normal(ROWS)
    counts = np.rint(np.cumsum(rate_dps) / RATE * 36_000.0)
    rows = [f"{t:.2f},{n:.0f}\n" for t, n in zip(TIME, counts, strict=True)]
    del rows[700]
    (tmp_path / "log.csv").write_text("time_s,gx\n" + "".join(rows))
    (axis,) = look(tmp_path / "log.csv", LookOptions(units=["gx=0.1 arcsec total"])).axes
    assert axis.figures.mean == pytest.approx(rate_dps.mean(), abs=2e-4)
    assert axis.figures.sigma == pytest.approx(rate_dps.std(), rel=0.02)
    assert axis.figures.outliers == 0 and axis.figures.missing == 1  # the first; one row is bridged
