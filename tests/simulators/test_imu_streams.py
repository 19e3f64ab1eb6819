"""Gravity and rotation in every stream with accelerometers, through its bytes, against rotations of SciPy."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.record.benchfile import load_bench_file
from drivers.kit.registry import EMULATORS, load_kind, registered
from simulators.interfaces import Installation
from simulators.plant import LabPlant, PlantConfig, TableParameters, UnitConfig
from tests.benches import BENCH

LATITUDE, SPIN_DPS, TILT_DEG, AZIMUTH_DEG, RATE_HZ, SECONDS = 39.1, 40.0, 30.0, 20.0, 100.0, 20
GRAVITY_MPS2 = 9.80088  # normal gravity there by the Geodetic Reference System 1980
EARTH_DPS = 15.041067 / 3600.0
STILL = TableParameters(ripple_once_ppm=0.0, ripple_twice_ppm=0.0)
TABLES = {"one axis": (("table", "up"),), "two axes": (("outer", "east"), ("inner", "up"))}
LYING = {  # y is under test: x, y, z of the unit as columns in north, west, up
    "axis_horizontal": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "axis_up": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
}
FRAMES = 'driver = "frames"\nport = "/dev/ttyUSB1"\ndescription = '
CAN = 'driver = "can_dbc"\ninterface = "gyrobench_slcan"\nchannel = "pty"\nlayout = '
KVH = FRAMES + '"kvh"\nframe_format = "a"'
UNITS = {  # section of the bench file, acceptable errors in deg/s and m/s2: two steps of its numbers
    "kvh": (KVH, 1e-5, 1e-4),
    "stim300": (FRAMES + '"stim300"\nframe_format = "rate_acc"', 2e-4, 1e-3),
    "hg4930": (FRAMES + '"hg4930"\nframe_format = "control"', 5e-3, 0.1),
    "hipnuc": (FRAMES + '"hipnuc"\nframe_format = "hi91"', 1e-4, 1e-3),
    "openimu": (FRAMES + '"openimu"\nframe_format = "z1"', 1e-4, 1e-4),
    "aceinna": (FRAMES + '"aceinna_dmu"\nframe_format = "s1"', 0.05, 0.01),
    "vectornav": (FRAMES + '"vectornav"\nframe_format = "imu"', 1e-4, 1e-4),
    "vectornav_ascii": (FRAMES + '"vectornav_ascii"', 2e-4, 2e-3),
    "openimu300": (CAN + '"openimu300"', 0.02, 0.02),
    "hipnuc_j1939": (CAN + '"hipnuc_j1939"', 0.2, 0.02),
    "sbg": (CAN + '"sbg_ellipse_imu"', 0.2, 0.02),
    "xsens": (CAN + '"xsens_mti"', 0.2, 0.02),
}


def felt(table: str, mounting: str, angle_deg: np.ndarray) -> list[np.ndarray]:
    """Rates in deg/s, specific forces in m/s2 along x, y, z, (n, 3); 8 angles of the inner axis a sample."""
    lying = Rotation.from_euler("z", 90.0 + AZIMUTH_DEG, degrees=True) * Rotation.from_matrix(LYING[mounting])
    tilt = Rotation.from_euler("x", TILT_DEG if table == "two axes" else 0.0, degrees=True)
    attitude = tilt * Rotation.from_euler("z", angle_deg[:, None], degrees=True) * lying
    latitude = math.radians(LATITUDE)
    earth = EARTH_DPS * np.array([0.0, math.cos(latitude), math.sin(latitude)])
    rate = attitude.inv().apply(earth) + lying.inv().apply([0.0, 0.0, SPIN_DPS])
    force = attitude.inv().apply([0.0, 0.0, GRAVITY_MPS2])
    return [values.reshape(-1, 8, 3).mean(axis=1) for values in (rate, force)]


@pytest.mark.parametrize("name", UNITS)
@pytest.mark.parametrize(("table", "mounting"), [("one axis", "axis_up"), ("two axes", "axis_horizontal")])
def test_a_stream_shows_gravity_and_the_rotation_of_every_axis(name, table, mounting, tmp_path) -> None:
    section, rate_error, force_error = UNITS[name]
    unit = f'[[gyro]]\nname = "g"\nunit = "1"\naxis = "y"\naxes = "xyz"\nrate_hz = {RATE_HZ}\n'
    (tmp_path / "lab.toml").write_text(BENCH + unit + section)
    config = load_bench_file(tmp_path / "lab.toml").gyro[0]
    fog = UnitConfig("g", "fog_nav", axis="y", mounting=mounting, mount_azimuth_error_deg=AZIMUTH_DEG)
    plant = LabPlant(PlantConfig(latitude_deg=LATITUDE, axes=TABLES[table], table=STILL, units=(fog,)))
    for axis in plant.tables.values():
        axis.servo(0.0, True)
    if table == "two axes":
        plant.tables["outer"].demand_angle(0.0, TILT_DEG)
    plant.table.demand_rate(0.0, SPIN_DPS)
    plant.advance(SECONDS + 1.0)
    make = registered(EMULATORS, "gyro")[config.driver].load()
    emulator = make(replace(config, axes="y"), plant.unit("g"), Installation())
    emulator.receive(b"C\rS6\rO\r", 0.0)
    kind = load_kind("gyro", config.driver)
    columns = kind.decoder(config).feed(emulator.stream(float(SECONDS)).data).columns
    rates, forces = (
        np.stack([by_axis[axis][1000:1800] for axis in "xyz"], axis=1)
        for by_axis in (
            kind.rates(config, columns, RATE_HZ),
            kind.accelerations(config, columns, RATE_HZ),
        )
    )
    eighths_s = (np.arange(8 * 800) + 0.5) / (8 * RATE_HZ)
    turn_deg = plant.table.total_angle_deg(10.0) + SPIN_DPS * eighths_s
    expected_dps, expected_mps2 = felt(table, mounting, turn_deg)
    np.testing.assert_allclose(rates[:, [0, 2]], expected_dps[:, [0, 2]], rtol=0, atol=rate_error)
    np.testing.assert_allclose(rates[:, 1], expected_dps[:, 1], rtol=0, atol=rate_error + 0.01)
    np.testing.assert_allclose(forces, expected_mps2, rtol=0, atol=force_error)
