"""A table of several axes: bench file, driver bytes, emulator, telemetry and station together."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.control.history import History
from bench.control.limits import LimitWatch
from bench.control.table_station import TableStation
from bench.record.benchfile import Band, ForbiddenState, LimitsSection, bench_file_from, bench_file_text
from drivers.acutrol import Acutrol3000
from drivers.acutrol._driver import AcutrolTable
from drivers.base.errors import ConfigurationError, DeviceRefused, LimitExceeded
from simulators.emulators.acutrol import AcutrolAxis, AcutrolEmulator
from simulators.plant.table import TableAxis, TableParameters
from tests.memory_link import MemoryLink, OpenConnection

FILE = {
    "bench": {"name": "two axes", "latitude_deg": 45.0},
    "table": {
        "driver": "acutrol3000",
        "port": "socket://192.168.53.1:9878",
        "axes": [
            {"name": "outer", "number": 1, "direction": "east", "max_rate_dps": 15.0},
            {"name": "inner", "number": 2, "direction": "up"},
        ],
    },
    "chamber": {"driver": "weiss", "port": "/dev/ttyUSB1"},
    "gyro": [{"name": "imu", "driver": "kvh1750", "unit": "1", "axis": "x", "port": "/dev/ttyUSB2"}],
}


class Record:
    def __init__(self):
        self.commands = []

    def event(self, event):
        self.commands.append(event)


class TwoAxes:
    """A session's worth of table: the driver on the emulator on the plant, polled once a second."""

    def __init__(self, axes=None, **limited):
        plants = {1: TableAxis(TableParameters()), 2: TableAxis(TableParameters())}
        self.plants = plants
        self.wire = MemoryLink(self._answer)
        self.emulator = AcutrolEmulator(
            {1: AcutrolAxis(plants[1], **limited), 2: AcutrolAxis(plants[2])}
            if axes is None
            else axes(plants)
        )
        self.file = bench_file_from(FILE)
        self.driver = AcutrolTable(self.file.table, OpenConnection(self.wire))
        self.record = Record()
        self.station = TableStation(self.driver, self, self.file.table.all_axes)

    def _answer(self, data, now_s):
        return [(reply.at_s, reply.data) for reply in self.emulator.receive(data, now_s)]

    def event(self, event):
        self.record.commands.append(event)

    @property
    def now_s(self):
        return self.wire.clock.now()

    def poll(self):
        self.driver.request_state()
        self.station.take(self.wire.clock.now(), self.driver.read_state())
        self.station.watch()

    def wait_until(self, condition, *, timeout_s, what):
        end = self.wire.clock.now() + timeout_s
        while self.wire.clock.now() < end:
            self.wire.clock.sleep(1.0)
            self.poll()
            if condition():
                return True
        return False


@pytest.fixture
def two():
    table = TwoAxes()
    table.driver.servo_on()
    table.station.confine(10.0)
    return table


def test_state_poll_is_one_line_for_all_axes(two):
    two.wire.sent = b""
    two.poll()
    two.poll()
    poll = b":read:pos? 1;rate? 1;pos? 2;rate? 2"
    assert sorted(two.wire.sent.splitlines()) == [poll, poll + b";pos? 1"]


def test_every_axis_goes_where_it_is_told_and_only_that_one(two):
    two.station.point(90.0, "outer")
    two.station.point(-30.0, "inner")
    now = two.wire.clock.now()
    assert two.plants[1].total_angle_deg(now) == pytest.approx(90.0, abs=1e-3)
    assert two.plants[2].total_angle_deg(now) == pytest.approx(-30.0, abs=1e-3)
    two.station.home()
    now = two.wire.clock.now()
    assert [two.plants[n].total_angle_deg(now) for n in (1, 2)] == pytest.approx([0.0, 0.0], abs=1e-3)


@pytest.mark.parametrize(
    ("angle", "sense", "travel"),
    [
        (90.0, "positive", 90.0),
        (90.0, "negative", -270.0),
        (0.0, "positive", 360.0),
        (0.0, "negative", -360.0),
    ],
)
def test_a_turn_goes_the_way_round_that_was_asked(two, angle, sense, travel):
    two.station.point(angle, "outer", sense=sense)
    assert two.plants[1].total_angle_deg(two.wire.clock.now()) == pytest.approx(travel, abs=1e-3)


def test_turns_keep_the_rate_limit_of_their_axis(two):
    two.station.point(170.0, "outer")
    times = np.arange(0.0, two.wire.clock.now(), 0.01)
    turned = np.diff(two.plants[1].total_angles_deg(times)) / 0.01
    assert turned.max() == pytest.approx(10.0, rel=1e-3)


def test_spin_with_an_acceleration_takes_its_time(two):
    began = two.wire.clock.now()
    two.station.spin(5.0, "outer", acceleration_dps2=0.5)
    assert two.plants[1].rate_dps(began + 5.0) == pytest.approx(2.5, rel=0.05)
    two.station.stop("outer")
    assert two.plants[1].rate_dps(two.wire.clock.now()) == pytest.approx(0.0, abs=2e-3)
    assert two.plants[2].total_angle_deg(two.wire.clock.now()) == 0.0


def test_an_axis_has_its_own_rate_limit(two):
    with pytest.raises(LimitExceeded, match="outer axis"):
        two.station.spin(16.0, "outer")
    two.station.check(16.0, "inner")


def test_an_axis_that_ignores_a_whole_turn_is_not_taken_for_settled():
    class Stuck(TableAxis):
        def demand_turn(self, *_):
            pass

    two = TwoAxes(lambda plants: {1: AcutrolAxis(Stuck(TableParameters())), 2: AcutrolAxis(plants[2])})
    two.driver.servo_on()
    with pytest.raises(DeviceRefused, match=r"by \+360.0 deg"):
        two.station.point(0.0, "outer", sense="positive", timeout_s=20.0)


def test_limited_axis_turns_between_its_stops():
    two = TwoAxes(min_angle_deg=-170.0, max_angle_deg=170.0)
    two.driver.servo_on()
    for angle in (160.0, -160.0):
        two.station.point(angle, "outer")
        assert two.plants[1].total_angle_deg(two.wire.clock.now()) == pytest.approx(angle, abs=1e-3)


def test_make_safe_stops_every_axis(two):
    two.station.spin(5.0, "outer")
    two.station.spin(5.0, "inner")
    two.driver.halt()
    two.driver.make_safe()
    later = two.wire.clock.now() + 5.0
    assert [two.plants[n].rate_dps(later) for n in (1, 2)] == pytest.approx([0.0, 0.0], abs=1e-6)


def test_alarms_say_which_axis(two):
    two.emulator.trip("rate trip", two.wire.clock.now(), axis=1)
    assert "outer: rate trip" in two.driver.alarms()
    assert not any(text.startswith("inner") for text in two.driver.alarms())


def test_recorded_bytes_give_the_telemetry_of_all_axes(two):
    two.station.point(45.0, "outer")
    columns, counts = Acutrol3000.decode_transcript(two.wire.exchanges, two.file.table)
    assert list(columns) == ["time_ns", "angle_deg", "rate_dps", "outer_angle_deg", "outer_rate_dps"]
    assert columns["outer_angle_deg"][-1] == pytest.approx(45.0, abs=1e-3)
    assert columns["angle_deg"] == pytest.approx(0.0)
    assert counts["damaged"] == 0
    assert columns["outer_angle_deg"].tolist() == two.station.history.since(0.0)["outer_angle_deg"].tolist()


def test_no_such_axis(two):
    with pytest.raises(DeviceRefused, match="middle"):
        two.driver.point(0.0, "middle")


def test_bench_file_with_axes_is_written_and_read_back():
    import tomllib

    file = bench_file_from(FILE)
    again = bench_file_from(tomllib.loads(bench_file_text(file)))
    assert again.model_dump() == file.model_dump()


def test_bench_file_of_one_axis_is_kept_as_it_was():
    one = {**FILE, "table": {"driver": "acutrol3000", "port": "/dev/ttyUSB0", "axis": 2}}
    dumped = bench_file_from(one).model_dump(mode="json")
    assert dumped["table"] == {"driver": "acutrol3000", "port": "/dev/ttyUSB0", "baudrate": 9600, "axis": 2}
    assert [axis.number for axis in bench_file_from(one).table.all_axes] == [2]


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"number": 1}, r"table\.axes\[1\]\.number"),
        ({"name": "outer"}, r"table\.axes\[1\]\.name"),
        ({"direction": "west"}, r"table\.axes\[1\]\.direction"),
        ({"direction": "left"}, r"table\.axes\[1\]\.direction"),
        ({"min_angle_deg": -90.0}, r"table\.axes\[1\]"),
        ({"min_angle_deg": 90.0, "max_angle_deg": -90.0}, r"table\.axes\[1\]\.min_angle_deg"),
    ],
)
def test_bench_file_names_a_wrong_axis(changes, text):
    outer, inner = FILE["table"]["axes"]
    with pytest.raises(ConfigurationError, match=text):
        bench_file_from({**FILE, "table": {**FILE["table"], "axes": [outer, {**inner, **changes}]}})


@pytest.mark.parametrize("axis", ["outer", "inner"])
def test_an_axis_that_telemetry_finds_beyond_its_stops_ends_the_run(two, axis):
    plant = two.plants[{"outer": 1, "inner": 2}[axis]]
    two.station.axes[axis] = replace(two.station.axes[axis], min_angle_deg=-60.0, max_angle_deg=60.0)
    plant.demand_angle(two.now_s, 60.4)
    two.wire.clock.sleep(60.0)
    two.poll()
    plant.demand_angle(two.now_s, 60.6)
    two.wire.clock.sleep(60.0)
    with pytest.raises(LimitExceeded, match="beyond its stops") as beyond:
        two.poll()
    assert (beyond.value.where, beyond.value.found) == (f"table, {axis} axis", "60.600 deg")


def test_an_axis_is_pointed_to_its_stops_and_not_beyond(two):
    two.station.axes["outer"] = replace(two.station.axes["outer"], min_angle_deg=-60.0, max_angle_deg=50.0)
    for angle_deg in (-60.0, 50.0, 0.0):
        two.station.point(angle_deg, "outer")
    for angle_deg in (-60.1, 50.1):
        with pytest.raises(LimitExceeded, match="an angle beyond the stops") as refused:
            two.station.point(angle_deg, "outer")
        assert refused.value.found == f"{angle_deg} deg" and refused.value.expected.startswith(
            "-60 .. 50 deg"
        )
    two.station.point(170.0, "inner")


@pytest.mark.parametrize(
    ("band", "refused"), [(Band(above=31.0, below=359.5), False), (Band(above=10.0, below=20.0), True)]
)
def test_home_is_asked_with_the_way_from_here_to_zero(two, band, refused):
    two.station.point(30.0, "inner")
    rule = ForbiddenState(name="aslant", angle_deg=band)
    two.file = two.file.model_copy(update={"limits": LimitsSection(forbid=(rule,))})
    two.limits = watched(two, two.file.limits)
    if refused:
        with pytest.raises(LimitExceeded, match="aslant") as told:
            two.station.home()
        assert told.value.found == "table, inner axis: go home"
    else:
        two.station.home()
    angle_deg = two.plants[2].total_angle_deg(two.now_s)
    assert angle_deg == pytest.approx(30.0 if refused else 0.0, abs=1e-3)


def test_outer_axes_go_to_zero_when_the_table_is_engaged(two):
    two.station.point(40.0, "outer")
    two.station.point(25.0, "inner")
    two.station.engage()
    angles_deg = [two.plants[number].total_angle_deg(two.now_s) for number in (1, 2)]
    assert angles_deg == pytest.approx([0.0, 25.0], abs=1e-3)


def test_a_ramp_is_the_change_by_the_time_between_two_rows(two):
    """6 K within the minute after 30 s are 6 K/min; the limit of 5 allows a fifth more, that is 6."""
    watch, air = watched(two, LimitsSection(max_ramp_k_per_min=5.0)), History(("air_temp_c", "set_point_c"))
    watch._chamber.history = air
    two.poll()
    air.append(30.0, 20.0, 20.0)
    air.append(90.0, 25.9, 20.0)
    watch._clock = SimpleNamespace(now=lambda: 90.0)
    watch.look()
    air.append(90.0, 26.1, 20.0)
    with pytest.raises(LimitExceeded) as fast:
        watch.look()
    assert fast.value.found == "6.1 K/min over 60 s"


def test_a_table_that_stays_half_a_degree_from_home_is_not_home():
    class Stuck(TableAxis):
        def demand_home(self, *_):
            pass

        def demand_angle(self, *_):
            pass

    stuck = Stuck(TableParameters())
    two = TwoAxes(lambda plants: {1: AcutrolAxis(stuck), 2: AcutrolAxis(plants[2])})
    two.driver.servo_on()
    stuck.demand_turn(two.now_s, 0.5, 1.0)
    two.wire.clock.sleep(30.0)
    assert stuck.total_angle_deg(two.now_s) == pytest.approx(0.5, abs=1e-3)
    with pytest.raises(DeviceRefused, match="did not settle within 44 s"):  # a turn at 15 deg/s takes 24 s
        two.station.home(timeout_s=20.0)


def test_an_operator_is_told_where_the_outer_axes_stand(two):
    assert two.station.mounting_text == "With outer at 0 deg: "


def test_a_loggers_sensor_counts_and_an_open_one_says_nothing(two):
    rule = ForbiddenState(name="unit too warm", aux_temp_c=Band(above=80.0))
    watch = watched(two, LimitsSection(forbid=(rule,)))
    two.poll()
    readings = {"aux_101_c": float("nan"), "aux_102_c": 79.0, "volts": 90.0}
    watch._instruments = {"logger": SimpleNamespace(readings=readings)}
    watch.look()
    readings["aux_102_c"] = 81.0
    with pytest.raises(LimitExceeded, match="unit too warm"):
        watch.look()


def watched(two, limits):
    """The limits of a bench with the table of two axes, air and set point at 20 degC."""
    air = History(("air_temp_c", "set_point_c"))
    air.append(two.wire.clock.now(), 20.0, 20.0)
    chamber = SimpleNamespace(history=air, auxiliary_c=[], set_point_c=None, look_at_door=lambda: False)
    return LimitWatch(limits, two.wire.clock, two.station, chamber, {})


@pytest.mark.parametrize("axis", ["outer", "inner"])
@pytest.mark.parametrize("rate_dps", [8.0, -8.0])
def test_every_axis_that_turns_too_fast_ends_the_run(two, axis, rate_dps):
    two.station.spin(rate_dps, axis)
    watched(two, LimitsSection(max_rate_dps=7.7)).look()  # within 5 % of it
    with pytest.raises(LimitExceeded, match="turns faster") as fast:
        watched(two, LimitsSection(max_rate_dps=7.5)).look()
    assert f"{rate_dps:.1f}" in fast.value.found


@pytest.mark.parametrize("axis", ["outer", "inner"])
def test_a_rule_on_the_rate_holds_for_every_axis_before_a_demand_and_on_telemetry(two, axis):
    """Spinning in the warm is forbidden: neither may it warm up while any axis spins, nor be found so."""
    rule = ForbiddenState(name="spin in the warm", rate_dps=Band(above=5.0), air_temp_c=Band(above=30.0))
    watch = watched(two, LimitsSection(forbid=(rule,)))
    two.station.spin(-6.0, axis)
    with pytest.raises(LimitExceeded, match="spin in the warm"):
        watch.allow("warm up", set_point_c=40.0)
    watch.look()
    watch._chamber.history.append(two.wire.clock.now(), 31.0, 40.0)
    with pytest.raises(LimitExceeded, match="spin in the warm"):
        watch.look()
    two.station.stop(axis)
    watch.look()
    watch.allow("warm up", set_point_c=40.0)


def test_a_demand_on_one_axis_is_asked_with_the_rates_of_all(two):
    """Spinning at an angle beyond 60 deg is forbidden: the inner axis goes there only if the outer one rests."""
    rule = ForbiddenState(name="spin aslant", rate_dps=Band(above=5.0), angle_deg=Band(above=60.0))
    two.file = two.file.model_copy(update={"limits": LimitsSection(forbid=(rule,))})
    two.limits = watched(two, two.file.limits)
    two.station.confine(4.0)
    two.poll()
    two.station.spin(6.0, "outer")
    with pytest.raises(LimitExceeded, match="spin aslant"):
        two.station.point(80.0, "inner")
    two.station.stop("outer")
    two.station.point(80.0, "inner")
    with pytest.raises(LimitExceeded, match="spin aslant"):
        two.station.spin(-6.0, "outer")


def test_a_demand_is_recorded_with_every_digit(two):
    two.poll()
    two.station.point(89.12345678)
    two.station.point(-3.00000001, "outer", sense="negative")
    two.station.spin(10.0000049)
    two.station.stop()
    rows = [json.loads(json.dumps(event.row(1.0))) for event in two.record.commands]
    assert [(row["kind"], row["device"], row["axis"]) for row in rows] == [
        ("demand_angle", "table", "inner"),
        ("demand_angle", "table", "outer"),
        ("demand_rate", "table", "inner"),
        ("demand_rate", "table", "inner"),
    ]
    assert (rows[0]["angle_deg"], rows[0]["sense"]) == (89.12345678, "shortest")
    assert (rows[1]["angle_deg"], rows[1]["sense"]) == (-3.00000001, "negative")
    assert (rows[2]["rate_dps"], rows[3]["rate_dps"]) == (10.0000049, 0.0)


@pytest.mark.parametrize("door", ["open", "closed"])
def test_what_is_forbidden_is_told_with_the_state_that_was_found(two, door):
    rule = ForbiddenState(name="spin", rate_dps=Band(above=5.0), door=door)
    watch = watched(two, LimitsSection(forbid=(rule,)))
    watch._chamber.look_at_door = lambda: door == "open"
    two.station.spin(6.0, "outer")
    with pytest.raises(LimitExceeded) as refused:
        watch.look()
    assert refused.value.found.startswith("6.000 deg/s at ")
    assert refused.value.found.endswith(f" deg, air 20.0 degC, set point 20.0 degC, door {door}")
