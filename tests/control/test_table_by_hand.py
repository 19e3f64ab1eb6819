"""What a table's station tells and sees on one axis and on two."""

import pytest

from bench.control.table_station import TableStation
from bench.record.benchfile import Band, ForbiddenState, LimitsSection
from drivers.base.errors import LimitExceeded, RunAborted
from drivers.kit.config import AxisConfig
from tests.control.test_stations import Bench, Table
from tests.control.test_table_axes import TwoAxes


@pytest.mark.parametrize("leaves", [1, 2])
def test_either_axis_that_leaves_what_it_had_settled_at_ends_the_run(leaves):
    two = TwoAxes()
    two.driver.servo_on()
    two.station.confine(10.0)
    two.station.point(10.0, "outer")
    two.station.point(20.0, "inner")
    two.poll()
    two.plants[leaves].demand_rate(two.now_s, 5.0, 50.0)
    two.wire.clock.sleep(1.0)
    with pytest.raises(RunAborted, match="left its demand") as left:
        two.poll()
    name, demand = {1: ("outer", "10.000 deg"), 2: ("inner", "20.000 deg")}[leaves]
    assert left.value.where == f"table, {name} axis" and left.value.expected == demand


def test_a_reading_that_is_looked_at_again_is_recorded_with_the_demand_of_each_axis():
    two = TwoAxes()
    two.driver.servo_on()
    two.station.confine(10.0)
    two.station.point(10.0, "outer")
    two.station.point(20.0, "inner")
    last = two.station.history.last
    two.station.history.append(two.now_s + 1.0, 99.0, 0.0, last["outer_angle_deg"], 0.0)
    two.station.watch()
    text = two.record.commands[-1].text
    assert "outer 10.000 deg" in text and "inner 20.000 deg" in text and "99" in text


def test_the_only_axis_of_a_table_is_not_named():
    station = Bench(Table()).station
    with pytest.raises(LimitExceeded) as refused:
        station.spin(2000.0)
    assert refused.value.where == "table"


@pytest.mark.parametrize("across", [False, True])
def test_axes_under_test_lie_along_a_rotation_unless_it_is_one_across_them(across):
    station, asked = Bench(Table()).station, []
    station.mountings.require_along = lambda name, rate_dps, angle_deg: asked.append((name, rate_dps))
    station.spin(-5.0, across=across)
    assert asked == ([] if across else [("table", -5.0)])
    assert [turning.across for turning in station.mountings.turnings] == [across]
    station.stop()
    assert len(asked) == (0 if across else 1), "coming to rest is always allowed"


@pytest.mark.parametrize(("axis", "way_deg"), [("a", None), ("b", (0.0, 20.0)), ("", (0.0, 20.0))])
def test_a_rule_on_the_angle_speaks_of_the_axis_that_carries_the_unit(axis, way_deg):
    """The last of the axes does, whatever their names."""
    bench, asked = Bench(Table()), []
    axes = (AxisConfig(name="a", number=1, direction="east"), AxisConfig(name="b", number=2, direction="up"))
    station = TableStation(bench.station.device, bench, axes)
    bench.file.limits = LimitsSection(forbid=(ForbiddenState(name="f", rate_dps=Band(above=30.0)),))
    bench.limits.allow = lambda where, **demand: asked.append((where, demand["way_deg"]))
    station.device.point = lambda angle_deg, axis="": None
    station.history.append(0.0, 0.0, 0.0, 0.0, 0.0)
    station.point(20.0, axis, settle=False)
    assert asked == [(f"table, {axis or 'b'} axis: point to 20 deg", way_deg)]
