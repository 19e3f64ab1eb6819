"""The stations: what settles, what is refused, what a gyro's recent mean is made of."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.control.chamber_station import ChamberStation
from bench.control.stream_stations import GyroStation, StreamTap
from bench.control.table_station import TableStation
from bench.record.benchfile import Band, ForbiddenState, LimitsSection
from drivers.base.errors import DeviceRefused, LimitExceeded, RunAborted
from drivers.kit.config import AxisConfig, GyroConfig
from drivers.kit.instruments import (
    ChamberCapabilities,
    ChamberLimits,
    ChamberState,
    FrameBatch,
    StreamCounts,
    TableLimits,
    TableState,
)
from drivers.kit.kinds import GyroKind

LIMITS = LimitsSection()


class Table:
    """A table that reaches its demand after `polls` polls; `off` is how far it stays off."""

    def __init__(self, polls=3, off=0.0, own_limit=1000.0):
        self.polls, self.off, self.own_limit = polls, off, own_limit
        self.told, self.left, self.looked = [], 0, 0
        self.target = {"angle_deg": 0.0, "rate_dps": 0.0}

    def limits(self, axis=""):
        return TableLimits(self.own_limit, 100.0, None, None)

    def limit_turns(self, max_rate_dps, axis="", max_acceleration_dps2=None):
        self.told.append(("limit", max_rate_dps))

    def point(self, angle_deg, axis=""):
        self.told.append(("point", angle_deg))
        self.left, self.target = self.polls, {"angle_deg": angle_deg % 360.0 + self.off, "rate_dps": 0.0}

    def spin(self, rate_dps, axis="", acceleration_dps2=None):
        self.told.append(("spin", rate_dps))
        self.left, self.target = self.polls, {"angle_deg": 1.0, "rate_dps": rate_dps + self.off}

    def request_state(self):
        self.looked += 1

    def read_state(self):
        return TableState(**self.target)

    def alarms(self):
        return ["rate trip"]


class Bench:
    """Polls a table's telemetry into its station's history once a second."""

    def __init__(self, table):
        self.file = SimpleNamespace(limits=LIMITS, chamber=SimpleNamespace(door_message=None), gyro=())
        self.limits = SimpleNamespace(allow=lambda what, **demand: None)
        self.events, self.time_s = [], 0.0
        self.station = TableStation(table, self, (AxisConfig(name="table", number=1, direction="up"),))

    @property
    def now_s(self):
        return self.time_s

    def event(self, event):
        self.events.append(event)

    def poll(self):
        table = self.station.device
        table.left -= 1
        row = table.target if table.left < 0 else {"angle_deg": 123.0, "rate_dps": 7.0}
        self.time_s += 1.0
        self.station.history.append(self.time_s, row["angle_deg"], row["rate_dps"])
        self.station.watch()

    def wait_until(self, condition, *, timeout_s, what):
        end = self.time_s + timeout_s
        while self.time_s < end:
            self.poll()
            if condition():
                return True
        return False


@pytest.mark.parametrize(
    ("demand", "value"), [("point", 90.0), ("point", 359.9999), ("spin", -20.0), ("spin", 0.0)]
)
def test_a_demand_returns_after_three_polls_in_a_row_on_it(demand, value):
    bench = Bench(Table(polls=5))
    getattr(bench.station, demand)(value)
    assert bench.time_s == 5.0 + 3.0
    assert bench.station.device.told == [(demand, value)]
    assert len(bench.events) == 1


@pytest.mark.parametrize(("demand", "value"), [("point", 90.0), ("spin", -20.0)])
@pytest.mark.parametrize(
    ("on_it", "polls"),
    [("+++", 3), ("++-+++", 6), ("+-+-+-+++", 9), ("-+-++-+++", 9), ("+--++--+-+++", 12)],
)
def test_polls_that_pass_the_demand_while_it_swings_do_not_add_up(demand, value, on_it, polls):
    """Three of them, but in a row: a table that overshoots crosses its demand more than once."""
    bench, rows = Bench(Table()), iter(on_it)

    def poll():
        bench.time_s += 1.0
        off = 0.0 if next(rows) == "+" else 0.5
        bench.station.history.append(bench.time_s, value + off, value + off)

    bench.poll = poll
    getattr(bench.station, demand)(value, timeout_s=60.0)
    assert bench.time_s == polls == len(on_it)


def test_an_angle_is_compared_round_the_turn():
    bench = Bench(Table())
    bench.station.device.point = lambda angle, axis="": None
    bench.station.device.target = {"angle_deg": 359.9995, "rate_dps": 0.0}
    bench.station.point(0.0)
    assert bench.time_s == 3.0


@pytest.mark.parametrize(("demand", "value", "within_s"), [("point", 90.0, 38), ("spin", 10.0, 20)])
def test_a_table_that_does_not_settle_is_told_with_its_alarms(demand, value, within_s):
    """A turn to an angle has the time that it takes at 20 deg/s, here of a whole turn, and 20 s more."""
    bench = Bench(Table(off=0.5))
    with pytest.raises(DeviceRefused, match=f"did not settle within {within_s} s") as refused:
        getattr(bench.station, demand)(value, timeout_s=20.0)
    assert "rate trip" in refused.value.found


@pytest.mark.parametrize(("demand", "value", "within_s"), [("point", 90.0, 38), ("spin", 10.0, 20)])
def test_a_demand_that_nobody_waits_for_is_watched_by_the_polls(demand, value, within_s):
    bench = Bench(Table(polls=5))
    getattr(bench.station, demand)(value, settle=False, timeout_s=20.0)
    assert bench.time_s == 0.0 and bench.station.device.told == [(demand, value)]
    for _ in range(60):
        bench.poll()
    bench.station.device.target = {"angle_deg": value + 1.0, "rate_dps": value + 1.0}
    with pytest.raises(RunAborted, match="left its demand"):
        bench.poll()

    never = Bench(Table(off=0.5))
    getattr(never.station, demand)(value, settle=False, timeout_s=20.0)
    with pytest.raises(DeviceRefused, match=f"did not settle within {within_s} s") as refused:
        for _ in range(60):
            never.poll()
    assert never.time_s == within_s + 1.0 and "rate trip" in refused.value.found


def test_a_demand_that_was_replaced_need_not_settle_any_more():
    bench = Bench(Table(off=0.5))
    bench.station.spin(10.0, settle=False, timeout_s=20.0)
    bench.poll()
    bench.station.device.off = 0.0
    bench.station.spin(0.0, settle=False, timeout_s=20.0)
    for _ in range(60):
        bench.poll()


def test_a_settled_table_that_leaves_its_demand_ends_the_run():
    bench = Bench(Table())
    bench.station.spin(10.0)
    bench.station.device.target["rate_dps"] = 10.05  # within ten times the tolerance of 0.012 deg/s
    bench.poll()
    bench.station.device.target["rate_dps"] = 9.0
    with pytest.raises(RunAborted, match="left its demand") as left:
        bench.poll()
    assert "rate trip" in left.value.found and left.value.expected == "10 deg/s"


@pytest.mark.parametrize(("off_deg", "stays"), [(0.0195, True), (0.0205, False)])
def test_a_settled_table_may_be_off_by_ten_times_what_counted_as_settled(off_deg, stays):
    bench = Bench(Table())
    bench.station.point(90.0, tolerance_deg=0.002)
    bench.station.device.target["angle_deg"] = 90.0 + off_deg
    if stays:
        bench.poll()
    else:
        with pytest.raises(RunAborted, match="left its demand"):
            bench.poll()


def test_the_only_axis_of_a_table_is_not_named_where_a_rule_is_asked():
    """Before there are rules nothing is asked."""
    bench, asked = Bench(Table()), []
    bench.limits.allow = lambda what, **demand: asked.append((what, demand))
    bench.station.spin(5.0)
    bench.file.limits = LimitsSection(forbid=(ForbiddenState(name="f", rate_dps=Band(above=30.0)),))
    bench.station.spin(-10.0)
    assert asked == [("spin at -10 deg/s", {"rate_dps": 10.0, "way_deg": (1.0, 361.0)})]
    assert bench.station.mounting_text == ""


def test_one_damaged_reading_of_a_settled_table_is_looked_at_again():
    bench = Bench(Table())
    bench.station.spin(10.0)
    bench.station.history.append(bench.time_s, 1.0, 30.0)  # "10" with one bit flipped
    bench.station.watch()
    assert bench.station.device.looked == 1 and "settled at 10 deg/s" in bench.events[-1].text
    assert bench.station.history.last["rate_dps"] == 10.0


def test_air_that_moves_as_no_air_does_is_asked_again_and_then_believed():
    bench, answers = Bench(Table()), [24.5, 94.5, 24.6, 94.5, 94.6]
    device = SimpleNamespace(
        request_state=lambda: None, read_state=lambda: ChamberState(answers.pop(0), 23.0, {})
    )
    chamber = ChamberStation(device, bench, ())
    seen = []
    for _ in range(3):
        state = chamber.read_state()
        seen.append(state.air_temp_c)
        bench.time_s += 1.0
        chamber.history.append(bench.time_s, state.air_temp_c, state.set_point_c)
    assert seen == [24.5, 24.6, 94.6] and len(bench.events) == 2
    assert "94.5 degC" in bench.events[0].text


@pytest.mark.parametrize(
    ("rate_k_per_min", "silent_s", "looks"),
    [(30.0, 40.0, 0), (-30.0, 600.0, 0), (120.0, 40.0, 1), (-120.0, 40.0, 1)],
)
def test_air_may_have_moved_as_far_as_a_fast_chamber_moves_it_while_none_asked(
    rate_k_per_min, silent_s, looks
):
    """The fastest chambers reach 30 K/min; telemetry may pause while an operator mounts a unit."""
    now_c = 20.0 + rate_k_per_min * silent_s / 60.0
    bench, answers = Bench(Table()), [20.0, now_c, now_c]
    device = SimpleNamespace(
        request_state=lambda: None, read_state=lambda: ChamberState(answers.pop(0), 20.0, {1: 20.0})
    )
    chamber = ChamberStation(device, bench, (1,))
    for _ in range(2):
        state = chamber.read_state()
        chamber.history.append(bench.time_s, state.air_temp_c, state.set_point_c, state.auxiliary_c[1])
        bench.time_s += silent_s
    assert state.air_temp_c == now_c
    assert len(bench.events) == looks and len(answers) == 1 - looks


@pytest.mark.parametrize(("broken", "looks"), [(84.0, 1), (float("nan"), 0)])
def test_a_sensor_that_jumps_is_looked_at_again_and_one_that_is_broken_is_not(broken, looks):
    bench, answers = Bench(Table()), [24.0, broken, 24.1]
    device = SimpleNamespace(
        request_state=lambda: None, read_state=lambda: ChamberState(25.0, 25.0, {1: answers.pop(0)})
    )
    chamber = ChamberStation(device, bench, (1,))
    for _ in range(2):
        state = chamber.read_state()
        bench.time_s += 1.0
        chamber.history.append(bench.time_s, state.air_temp_c, state.set_point_c, state.auxiliary_c[1])
    assert len(bench.events) == looks and len(answers) == 1 - looks
    assert not looks or "sensor 1 84 degC" in bench.events[0].text


def test_a_new_demand_is_not_taken_for_leaving_the_old_one():
    bench = Bench(Table(polls=4))
    bench.station.spin(10.0)
    bench.station.spin(-10.0)
    bench.station.point(45.0)
    bench.station.stop()
    assert [what for what, _ in bench.station.device.told] == ["spin", "spin", "point", "spin"]


@pytest.mark.parametrize(("own", "allowed"), [(1000.0, 20.0), (5.0, 5.0)])
def test_rates_are_limited_by_the_tighter_of_bench_and_table(own, allowed):
    station = Bench(Table(own_limit=own)).station
    station.check(allowed)
    with pytest.raises(LimitExceeded, match="not allowed"):
        station.check(allowed * 1.001)
    with pytest.raises(LimitExceeded):
        station.spin(-allowed * 1.001)
    assert station.device.told == []
    station.confine()
    assert station.device.told == [("limit", allowed)]


class Chamber:
    def __init__(self):
        self.told = []

    def limits(self):
        return ChamberLimits(-72.0, 80.0)

    def capabilities(self):
        return ChamberCapabilities(0.1, (0.1, 1000.0), None)

    def set_temperature(self, set_point_c, ramp_k_per_min):
        self.told.append((set_point_c, ramp_k_per_min))


@pytest.mark.parametrize(
    ("set_point", "ramp"), [(-60.1, None), (80.5, None), (20.0, 25.5), (float("-inf"), None)]
)
def test_a_chamber_demand_beyond_a_limit_is_never_sent(set_point, ramp):
    station = ChamberStation(Chamber(), Bench(Table()), ())
    with pytest.raises(LimitExceeded, match="chamber"):
        station.go_to(set_point, ramp)
    assert station.device.told == []
    station.go_to(-60.0, 25.0)
    station.go_to(80.0)
    assert station.device.told == [(-60.0, 25.0), (80.0, None)]


class PlainChamber(Chamber):
    """A chamber with set points and no ramps, as a simple controller is; its air is where it is told to be."""

    def __init__(self):
        super().__init__()
        self.air_c = 25.0
        self.link = SimpleNamespace()

    def capabilities(self):
        return ChamberCapabilities(0.1, None, None)

    def set_temperature(self, set_point_c, ramp_k_per_min=None):
        assert ramp_k_per_min is None
        self.told.append(set_point_c)
        self.air_c = set_point_c

    def start(self):
        self.told.append("start")

    def stop(self):
        self.told.append("stop")


@pytest.mark.parametrize(("to_c", "k_per_min"), [(-20.0, 12.0), (31.0, 0.7)])
def test_a_chamber_without_ramps_is_led_along_one(to_c, k_per_min):
    bench, device = Bench(Table()), PlainChamber()
    chamber = ChamberStation(device, bench, ())

    def polled(seconds):
        for _ in range(seconds):
            bench.time_s += 1.0
            chamber.history.append(bench.time_s, device.air_c, device.air_c)
            chamber.watch()

    polled(3)
    chamber.go_to(to_c, k_per_min)
    polled(100)  # it stands: the ramp begins when it is started
    assert device.told == [25.0]
    chamber.start()
    begun_s, so_far = bench.time_s, len(device.told)
    duration_s = 60.0 * abs(to_c - 25.0) / k_per_min
    while device.told[-1] != to_c:
        polled(1)
        wanted_c = 25.0 + np.sign(to_c - 25.0) * k_per_min * (bench.time_s - begun_s) / 60.0
        assert abs(device.air_c - wanted_c) <= 0.15 + k_per_min / 60.0
        assert bench.time_s < begun_s + duration_s + 2.0
    assert bench.time_s >= begun_s + duration_s
    steps = np.abs(np.diff(device.told[so_far:]))
    assert steps.max() <= max(0.1, k_per_min / 60.0) + 0.101
    told = len(device.told)
    polled(60)
    assert len(device.told) == told


def test_a_ramp_of_a_chamber_without_ramps_ends_with_a_stop_and_with_another_demand():
    bench, device = Bench(Table()), PlainChamber()
    chamber = ChamberStation(device, bench, ())
    chamber.history.append(0.0, 25.0, 25.0)
    chamber.start()
    chamber.go_to(-20.0, 10.0)
    chamber.go_to(30.0)
    bench.time_s = 60.0
    chamber.watch()
    assert device.told[-1] == 30.0
    chamber.go_to(-20.0, 10.0)
    chamber.stop()
    bench.time_s = 120.0
    chamber.watch()
    assert device.told[-1] == "stop"


class Decoder:
    """Four bytes a sample: rate in mdeg/s, temperature in 0.1 degC, validity, counter."""

    counter_modulo, counter_step, nominal_rate_hz = 256, 1.0, 100.0

    def __init__(self):
        self.counts, self.pending, self.offset = StreamCounts(), b"", 0

    def feed(self, data):
        self.pending += data
        whole = len(self.pending) // 4
        rows = np.frombuffer(self.pending[: 4 * whole], np.uint8).reshape(-1, 4)
        self.pending = self.pending[4 * whole :]
        ends = self.offset + 4 * np.arange(1, whole + 1)
        self.offset += 4 * whole
        temp_c = np.where(rows[:, 1] == 255, np.nan, rows[:, 1] / 10.0)
        columns = {
            "counter": rows[:, 3],
            "rate": rows[:, 0] / 1e3,
            "temp_c": temp_c,
            "valid": rows[:, 2] > 0,
        }
        return FrameBatch(columns, ends)


SECTION = GyroConfig(name="g", driver="any", unit="1", axis="x", port="/dev/null")


def station():
    kind = GyroKind(
        open=lambda *_: None,
        decoder=lambda _: Decoder(),
        rates=lambda _, columns, rate_hz: {"x": columns["rate"], "y": -columns["rate"]},
        config=GyroConfig,
    )
    gyro = GyroStation(kind, SECTION)
    gyro.listen(0.0)
    return gyro


@settings(max_examples=80, deadline=None)
@given(
    samples=st.lists(
        st.tuples(st.integers(0, 255), st.integers(0, 255), st.integers(0, 1)), min_size=1, max_size=40
    ),
    cuts=st.lists(st.integers(0, 160), max_size=6),
)
def test_means_are_those_of_the_valid_samples_however_bytes_arrive(samples, cuts):
    gyro = station()
    data = b"".join(bytes([*sample, 0]) for sample in samples)
    edges = sorted({0, len(data), *(cut for cut in cuts if cut < len(data))})
    for k, (start, stop) in enumerate(pairwise(edges)):
        gyro.take(data[start:stop], k + 1.0)
    valid = [(rate / 1e3, temp / 10.0) for rate, temp, good in samples if good]
    assert int(gyro.update().since(0.0)["samples"].sum()) == len(valid)
    if valid:
        assert gyro.mean_rate_dps(0.0) == pytest.approx(np.mean([rate for rate, _ in valid]), abs=1e-12)
    else:
        assert np.isnan(gyro.mean_rate_dps(0.0))


def test_a_row_a_block_with_its_arrival_time_and_temperature_without_gaps():
    gyro = station()
    gyro.take(bytes([10, 250, 1, 0, 20, 255, 1, 0]), 1.0)
    gyro.take(bytes([99, 100, 0, 0]), 2.0)
    gyro.take(bytes([30, 255, 1, 0]), 3.0)
    rows = gyro.update().since(0.0)
    assert rows["time_s"].tolist() == [1.0, 3.0]
    assert rows["rate_dps"] == pytest.approx([0.015, 0.030])
    assert rows["temp_c"][0] == 25.0 and np.isnan(rows["temp_c"][1])
    assert gyro.mean_rate_dps(2.5) == pytest.approx(0.030)
    assert gyro.mean_rate_dps(0.0, 2.5) == pytest.approx(0.015)


def test_nothing_is_taken_before_the_stream_begins_and_much_is_decoded_at_once():
    kind = GyroKind(lambda *_: None, lambda _: Decoder(), lambda _, c, r: {"x": c["rate"]}, GyroConfig)
    gyro = GyroStation(kind, SECTION)
    gyro.take(b"configuration", 0.5)
    assert len(gyro.update()) == 0
    gyro.listen(0.0)
    for k in range(80):
        gyro.take(bytes([1, 1, 1, 0]) * 1024, float(k))
    assert len(gyro._blocks) < 80 and len(gyro.history) > 0  # memory stays flat without a reader


@given(counters=st.lists(st.integers(0, 2000), min_size=1, max_size=30, unique=True), cut=st.integers(0, 120))
def test_lost_samples_are_those_missing_between_first_and_last(counters, cut):
    kept = [n for n in sorted(counters) if n - min(counters) < 2000]
    gaps = [after - before for before, after in pairwise(kept)]
    kept = kept[: next((i + 1 for i, gap in enumerate(gaps) if gap >= 256), len(kept))]  # less than a wrap
    gyro = station()
    data = b"".join(bytes([1, 1, 1, n % 256]) for n in kept)
    gyro.take(data[:cut], kept[min(max(cut // 4, 1), len(kept)) - 1] / 100.0)
    gyro.update()
    gyro.take(data[cut:], kept[-1] / 100.0)
    gyro.update()
    assert gyro.lost == kept[-1] - kept[0] + 1 - len(kept)
    assert gyro.rejected == {}


def test_a_tap_records_before_it_hands_on():
    order = []
    record = SimpleNamespace(
        received=lambda data, t: order.append(("record", data, t)),
        sent=lambda data, t: order.append(("sent", data, t)),
    )
    tap = StreamTap(record, lambda data, t: order.append(("station", data, t)))
    tap.received(b"x", 1.0)
    tap.sent(b"y", 2.0)
    assert order == [("record", b"x", 1.0), ("station", b"x", 1.0), ("sent", b"y", 2.0)]


@pytest.mark.parametrize("verb", ["point", "spin", "home"])
def test_a_large_table_has_five_minutes_to_settle(verb):
    bench = Bench(Table(polls=10**6))
    bench.station.device.home = lambda axis="": None
    bench.station.device.left = 10**6
    within_s = 300.0 if verb == "spin" else 318.0  # and what a turn of the table takes
    with pytest.raises(DeviceRefused, match=f"within {within_s:g} s"):
        getattr(bench.station, verb)(*([] if verb == "home" else [10.0]))
    assert bench.time_s == within_s


def test_a_table_that_tells_no_alarms_is_not_said_to_have_none():
    table = Table(off=5.0)
    table.tells_alarms = False
    with pytest.raises(DeviceRefused, match="its controller tells no alarms"):
        Bench(table).station.point(10.0, timeout_s=20.0)


def test_seconds_hold_every_valid_sample_of_a_stretch_once():
    """Arrivals at 1.0, 1.9, 2.5 and 4.0 s; what arrives at the end of a stretch is of the next one."""
    gyro = station()
    for at_s, rates in ((1.0, (10, 20)), (1.9, (30,)), (2.5, (40, 50)), (4.0, (60,))):
        gyro.take(b"".join(bytes([rate, 250, 1, 0]) for rate in rates), at_s)
    gyro.take(bytes([99, 250, 0, 0]), 2.6)  # not valid
    samples, sums = gyro.seconds(1.0, 4.0)
    assert samples.tolist() == [3.0, 2.0, 0.0] and sums == pytest.approx([0.06, 0.09, 0.0])
    assert [part.tolist() for part in gyro.seconds(4.0, 5.0)] == [[1.0], [0.06]]
    assert [part.tolist() for part in gyro.seconds(7.0, 9.0)] == [[0.0, 0.0], [0.0, 0.0]]
