"""A gyro of one axis on a table of several, against rotations of SciPy and the closed forms of a table of one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from simulators.plant.lab_plant import LabPlant, PlantConfig, UnitConfig
from simulators.plant.table import TableParameters

STILL = TableParameters(ripple_once_ppm=0.0, ripple_twice_ppm=0.0)
LATITUDE = 39.1
EARTH_DPH = 15.041067
TWO = (("outer", "east"), ("inner", "up"))
THREE = (("outer", "up"), ("middle", "east"), ("inner", "north"))
QUIET = UnitConfig("fog", unit_seed=0, mount_azimuth_error_deg=20.0)


def lab(axes, mounting="axis_horizontal"):
    unit = replace(QUIET, mounting=mounting)
    found = LabPlant(PlantConfig(latitude_deg=LATITUDE, axes=axes, table=STILL, units=(unit,)))
    for axis in found.tables.values():
        axis.servo(0.0, True)
    return found


def errors_taken_out(plant, start_s, count, period_s):
    """What the unit measures less what it measures at rest on a table of one axis: the same errors and noise."""
    measured = plant.unit("fog").measure(start_s, count, period_s).angle_increment_rad[:, 0]
    still = lab((("table", "up"),))
    still.advance(plant.now_s)
    bare = still.unit("fog").measure(start_s, count, period_s).angle_increment_rad[:, 0]
    # at 0 deg of the table the unit points 20 deg from north, on the level
    earth = math.radians(EARTH_DPH / 3600.0) * math.cos(math.radians(LATITUDE)) * math.cos(math.radians(20.0))
    scale = 1.0 + 1e-6 * plant.true_drift("fog")["sf_error_ppm"][int(start_s) :].mean()
    return (measured - bare) / scale + earth * period_s


@pytest.mark.parametrize("mounting", ["axis_horizontal", "axis_up"])
def test_with_the_outer_axis_at_zero_it_is_a_table_of_one_axis(mounting):
    one, two = lab((("table", "up"),), mounting), lab(TWO, mounting)
    for plant in (one, two):
        plant.table.demand_rate(5.0, 7.0)
        plant.advance(40.0)
    a = one.unit("fog").measure(0.0, 3500, 0.01).angle_increment_rad
    b = two.unit("fog").measure(0.0, 3500, 0.01).angle_increment_rad
    np.testing.assert_array_equal(a, b)
    # and by the axes' attitudes instead of the closed form
    two.unit("fog")._gimbals._carrier_up = False
    c = two.unit("fog").measure(0.0, 3500, 0.01).angle_increment_rad
    np.testing.assert_allclose(c, b, rtol=0, atol=1e-11)


@pytest.mark.parametrize(("axes", "angles"), [(TWO, (30.0, 110.0)), (THREE, (40.0, -75.0, 200.0))])
def test_at_rest_at_any_angles_it_measures_its_share_of_earth_rate(axes, angles):
    plant = lab(axes)
    for axis, angle in zip(plant.tables.values(), angles, strict=True):
        axis.demand_angle(1.0, angle, 50.0)
    plant.advance(61.0)
    lines = {"east": (1, 0, 0), "north": (0, 1, 0), "up": (0, 0, 1)}
    turned = Rotation.identity()
    for (_, direction), angle in zip(axes, angles, strict=True):
        turned = turned * Rotation.from_rotvec(np.radians(angle) * np.array(lines[direction], float))
    azimuth = math.radians(20.0)  # counter-clockwise from north
    along = turned.apply([-math.sin(azimuth), math.cos(azimuth), 0.0])
    latitude = math.radians(LATITUDE)
    expected = EARTH_DPH * float(along @ [0.0, math.cos(latitude), math.sin(latitude)])
    seen = errors_taken_out(plant, 30.0, 3000, 0.01).sum() / 30.0
    assert math.degrees(seen) * 3600.0 == pytest.approx(expected, abs=5e-5)


def test_a_turn_of_the_outer_axis_is_seen_by_its_share_along_the_unit():
    plant = lab(TWO)
    plant.tables["inner"].demand_angle(1.0, 70.0, 50.0)  # the unit then points to 90 deg from north: west
    plant.tables["outer"].demand_rate(20.0, 3.0)  # about east
    plant.advance(61.0)
    turned = errors_taken_out(plant, 30.0, 2000, 0.01).sum()
    # west is minus east, and Earth rate has no part along it; the scale factor depends on rate by some ppm
    assert math.degrees(turned) == pytest.approx(-3.0 * 20.0, rel=1e-5)
