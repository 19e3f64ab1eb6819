"""Run folders, logs, model files and rehearsals as the diagnosis takes them, against made ones by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.gap import (
    Model,
    Noise,
    Recordings,
    Simulation,
    Term,
    _rehearsal,
    _run_folder,
    _simulation,
    designs_for,
    log_gaps,
    parse_model,
)
from bench.analysis.gap._case_folder import write_case
from bench.analysis.gap._cells import BANDS
from bench.analysis.gap._channel_data import ChannelSeries, _air
from bench.analysis.gap._channel_run import RunSource
from bench.analysis.gap._close import shrinkage
from bench.analysis.gap._data import beside
from bench.analysis.gap._designs import _rotation, usual_designs
from bench.analysis.gap._fit import Floor
from bench.analysis.gap._import import read_mapped_runs
from bench.analysis.gap._log_rows import even_rows
from bench.analysis.gap._model_file import read_model
from bench.analysis.gap._rehearsal import _heading_log_gaps
from bench.analysis.gap._run_folder import _between_polls, load_gap_runs
from bench.analysis.gap._series import differences
from bench.analysis.gap._simulation import _means, take_own
from bench.control.procedure import beyond_limits
from bench.record.benchfile import load_bench_file
from bench.record.events.run import AirDemand, ConditioningDemand
from bench.record.recording._events import Line
from bench.record.recording._tables import SecondMeans
from drivers.base.errors import ConfigurationError
from simulators.effects import ChannelInputs, Variant
from tests.analysis.gap.conftest import effect, made_run, stimulus
from tests.analysis.gap.test_gap_edges import mark
from tests.safety.test_takeover import DEMO

WHITE = Noise(0.004)
EARTH_DPH = 15.041067


class Folder:
    """A run of a gyro on a table that goes by `angle_deg` (a function of time), polled every half second."""

    tables = ("turntable",)
    place, checksum, azimuth_error_deg = Path("runs/r"), "sum", 0.25

    def __init__(self, angle_deg, phases, *, procedure="rates", sections=(), mounting="axis_up", axis="x"):
        devices = {"gyro": SimpleNamespace(role="gyro", axis=axis, case_sensor=None)}
        self.manifest = SimpleNamespace(
            run_id="run", units={"gyro": "U1"}, devices=devices, device=devices.get, unit={"gyro": "U1"}.get,
            imported=None, procedure=procedure, parameters={}, mounting=mounting, latitude_deg=30.0,
        )  # fmt: skip
        self.angle_deg, self.sections = angle_deg, sections
        self._phases = [SimpleNamespace(name=name, start_s=low, end_s=high) for name, low, high in phases]

    @property
    def events(self):
        return [{"kind": "section", "time_s": at_s} for at_s in self.sections]

    def phases(self):
        return self._phases

    def phase_at(self, times_s):
        starts = [each.start_s for each in self._phases]
        names = np.array([each.name for each in self._phases])
        return names[np.maximum(np.searchsorted(starts, times_s, side="right") - 1, 0)]

    def table_angle_deg(self, times_s):
        return self.angle_deg(times_s)

    def second_means(self, gyro, start_s, end_s, *, from_start=False):
        edges = np.arange(start_s, end_s + 1.0)
        noise = np.random.default_rng(1).normal(0.0, 1e-3, end_s - start_s)
        rate = np.diff(self.angle_deg(edges)) + 0.5 * EARTH_DPH / 3600.0 + noise
        return SecondMeans(rate, np.full(len(rate), 21.0), 0.01)

    def gyro(self, name, columns, start_s, end_s):
        time_s = np.arange(math.ceil(10.0 * start_s - 0.5), 10.0 * end_s - 0.5) / 10.0 + 0.05
        kept = np.arange(len(time_s)) % 50 != 7  # one sample of 50 is lost
        table = {
            "time_ns": np.rint(1e9 * time_s[kept]).astype(np.int64),
            "rate_dps": (100.0 + time_s[kept]).astype(np.float32),
            "valid": np.arange(int(kept.sum())) % 100 != 3,
            "lost_before": np.diff(np.flatnonzero(kept), prepend=-1) - 1,
        }
        return {column: table[column] for column in columns}

    def turntable(self, columns, start_s, end_s):
        time_s = np.arange(math.ceil(2.0 * start_s), 2.0 * end_s) / 2.0
        angle = np.mod(self.angle_deg(time_s), 360.0)
        return {"time_ns": np.rint(1e9 * time_s).astype(np.int64), "angle_deg": angle}


def loaded(monkeypatch, folder):
    monkeypatch.setattr(_run_folder, "Run", SimpleNamespace(open=lambda _: folder))
    return load_gap_runs(Path("r"))


def to_and_fro(times_s):
    """10 deg/s up to 900 s, then back."""
    return 10.0 * (900.0 - np.abs(times_s - 900.0))


def test_sections_begin_with_their_reference_and_the_last_ends_with_the_run(monkeypatch):
    phases = [
        ("position", 50.0, 250.5),
        ("reference", 250.5, 600.0),
        ("shock", 600.0, 900.0),
        ("wait", 900.0, 950.2),
        ("reference", 950.2, 1400.0),
        ("shock", 1400.0, 1500.0),
        ("reference", 1500.0, 1600.0),
        ("shock", 1600.0, 1700.7),
    ]
    one, two = loaded(monkeypatch, Folder(to_and_fro, phases, sections=(100.3, 900.0)))
    assert [one.stimulus.time_s[0], one.stimulus.time_s[-1]] == [252.0, 900.0]
    assert [two.stimulus.time_s[0], two.stimulus.time_s[-1]] == [952.0, 1700.0]
    assert (one.condition, two.condition) == ("+10", "-10")
    assert (one.run_id, two.run_id) == ("run 1", "run 2")
    assert dict.fromkeys(one.phase.tolist()) == {"reference": None, "shock": None}
    assert (one.unit_id, one.checksum, one.lost_fraction) == ("U1", "sum", 0.01)
    for run in (one, two):
        # without the 0.25 deg that the table's zero is off, the angle is that of the table
        assert run.stimulus.angle_deg - 0.25 == pytest.approx(
            to_and_fro(np.append(run.stimulus.time_s - 1.0, run.stimulus.time_s[-1:]))
        )
        assert run.stimulus.elevation_deg.tolist() == [90.0] * len(run.stimulus)
        assert run.stimulus.t_in_c.tolist() == run.stimulus.t_out_c.tolist() == [21.0] * len(run.stimulus)
        left = (run.output_dph - run.stimulus.input_rate_dph)[1:-1]
        assert np.abs(left).max() < 3600.0 * 5e-3 and not run.missing[1:-1].any()


def test_a_run_without_sections_begins_when_its_table_has_taken_its_place(monkeypatch):
    still = Folder(
        lambda times_s: np.full(len(times_s), 89.75),
        [("position", 50.0, 120.0), ("equilibrium", 120.0, 500.0), ("shock", 500.0, 900.9)],
        mounting="axis_horizontal",
    )
    (run,) = loaded(monkeypatch, still)
    assert [run.stimulus.time_s[0], run.stimulus.time_s[-1]] == [121.0, 900.0]
    assert run.condition == "90 deg" and run.stimulus.elevation_deg.tolist() == [0.0] * 780
    assert run.stimulus.input_rate_dph == pytest.approx(np.zeros(780), abs=1e-9)  # it points east
    still._phases = still._phases[:1]
    (run,) = loaded(monkeypatch, still)
    assert [run.stimulus.time_s[0], run.stimulus.time_s[-1]] == [51.0, 120.0]
    still._phases = []
    with pytest.raises(ConfigurationError, match="no phases"):
        loaded(monkeypatch, still)


def test_of_a_standard_test_the_rates_are_taken_from_the_first_to_the_last(monkeypatch):
    phases = [
        ("noise", 0.0, 100.0),
        ("scale_factor", 100.0, 700.0),
        ("scale_factor", 700.0, 1100.0),
        ("bias", 1100.0, 1500.0),
    ]
    folder = Folder(to_and_fro, phases, procedure="standard-test", mounting="axis_horizontal")
    (run,) = loaded(monkeypatch, folder)
    assert [run.stimulus.time_s[0], run.stimulus.time_s[-1]] == [101.0, 1100.0]
    assert run.stimulus.elevation_deg.tolist() == [90.0] * 1000 and run.condition == "+10"
    folder._phases = folder._phases[:1]
    with pytest.raises(ConfigurationError, match="did not get to its rates"):
        loaded(monkeypatch, folder)


@pytest.mark.parametrize(
    ("mounting", "axis", "up"),
    [("z_up", "z", True), ("z_up", "x", False), ("axis_up", "x", True), ("axis_horizontal", "z", False),
     (None, "x", True)],
)  # fmt: skip
def test_a_turning_axis_is_up_as_it_was_mounted(monkeypatch, mounting, axis, up):
    folder = Folder(to_and_fro, [("equilibrium", 0.0, 600.0)], mounting=mounting, axis=axis)
    (run,) = loaded(monkeypatch, folder)
    assert run.stimulus.elevation_deg.tolist() == [90.0 if up else 0.0] * 600


def test_dwells_of_a_calibration_lie_one_behind_the_other_at_their_attitudes(monkeypatch):
    """The axis x to the east, level, then up: columns of an attitude are the axes in east, north, up."""
    east, up = np.eye(3), np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    schedule = SimpleNamespace(attitudes=lambda: [east, up], name="two positions")
    monkeypatch.setattr(_run_folder, "load_calibration_run", lambda *_: SimpleNamespace(schedule=schedule))
    phases = [("dwell", 10.2, 60.9), ("turn", 60.9, 90.0), ("dwell", 90.0, 150.0)]
    (run,) = loaded(monkeypatch, Folder(lambda t: np.zeros(len(t)), phases, procedure="system-calibration"))
    s = run.stimulus
    assert s.time_s.tolist() == [*np.arange(17.0, 61.0), *np.arange(96.0, 151.0)]
    assert s.elevation_deg == pytest.approx([0.0] * 44 + [90.0] * 55)
    assert s.angle_deg[:44] == pytest.approx([-90.0] * 44) and len(s.angle_deg) == 100
    assert np.flatnonzero(run.missing).tolist() == [43, 98]
    assert run.output_dph[0] == pytest.approx(0.5 * EARTH_DPH, abs=3600.0 * 5e-3)
    assert (run.lost_fraction, run.condition) == (pytest.approx(0.01), "two positions")
    assert run.phase[[0, -1]].tolist() == ["position 1", "position 2"]


def polled(angle_deg):
    """A table that is polled every second from 0 to 40 s."""
    time_s = np.arange(41.0)
    table = {"time_ns": (1e9 * time_s).astype(np.int64), "angle_deg": np.mod(angle_deg(time_s), 360.0)}
    return SimpleNamespace(turntable=lambda *_: table, manifest=SimpleNamespace(latitude_deg=39.1))


def test_between_two_polls_a_change_of_rate_leaves_the_angle_unknown():
    """Edges half way between polls: a change by 10 deg/s is a quarter of it off, 9000 deg/h in a second."""
    edges = np.arange(0.5, 40.0)
    error = np.random.default_rng(1).normal(0.0, 100.0, 39)
    even = _between_polls(polled(lambda t: 350.0 + 7.0 * t), edges, error, True)
    assert not even.any()  # also where the angle begins anew at 360
    changed = polled(lambda t: np.where(t < 20.0, 0.0, 10.0 * (t - 20.0)))
    bad = _between_polls(changed, edges, error, True)
    # unsure are the edges 19.5 and 20.5, on both sides of the poll that the rate changes at
    assert edges[:-1][bad].tolist() == [18.5, 19.5, 20.5]
    assert not _between_polls(changed, edges, error, False).any()
    assert not _between_polls(changed, edges, 1e3 * error, True).any()
    assert not _between_polls(changed, np.arange(0.0, 41.0), np.append(error, 0.0), True).any()
    # behind the last poll nothing is known, and nothing changed
    assert not _between_polls(changed, np.arange(30.5, 44.0), error[:13], True).any()


class Chamber:
    """A run of a chamber at 20 degC that goes to -40 at 6 K/min from 1000 s on, read every second."""

    tables, checksum = ("chamber",), "sum"
    manifest = SimpleNamespace(run_id="run", units={})

    def __init__(self, *told, end_s=3000.0):
        self.lines = [Line(time_s, event) for time_s, event in (*told, (end_s, None))]

    def chamber(self, columns, start_s, end_s):
        time_s = np.arange(math.ceil(start_s), end_s)
        air = np.clip(20.0 - 0.1 * (time_s - 1000.0), -40.0, 20.0)
        return {"time_ns": (1e9 * time_s).astype(np.int64), "air_temp_c": air}

    def phase_at(self, times_s):
        return np.where(times_s < 1000.0, "soak", "shock")


TOLD = (
    (0.0, AirDemand("chamber", 20.0, 2.0)),
    (50.0, ConditioningDemand("chamber", True)),
    (1000.0, AirDemand("chamber", -40.0)),
)


def test_without_a_ramp_the_air_is_compared_five_minutes_after_it_has_arrived():
    found = _air(RunSource(Chamber(*TOLD), ""))
    time_s = found.inputs.time_s
    assert time_s[[0, -1]].tolist() == [55.0, 2985.0]
    # the mean from 1590 to 1600 s is the first within 1 K
    assert time_s[np.isnan(found.values)].tolist() == np.arange(1005.0, 1595.0 + 300.0, 10.0).tolist()
    assert found.values[time_s < 1000.0].tolist() == [20.0] * 95
    assert found.values[time_s > 1900.0] == pytest.approx(-40.0)
    assert found.inputs.drive.tolist() == np.where(time_s < 1000.0, 20.0, -40.0).tolist()
    assert [(each.time_s, each.target) for each in found.inputs.demands] == [(50.0, 20.0), (1000.0, -40.0)]
    assert [each.ramp_per_s for each in found.inputs.demands] == [pytest.approx(2.0 / 60.0), math.inf]
    assert not found.quiet.any() and found.channel == "chamber_air"
    assert [name for name, _ in found.pieces()] == ["soak", "shock"]


def test_a_chamber_that_is_stopped_is_compared_until_then():
    stopped = (2500.0, ConditioningDemand("chamber", False))
    found = _air(RunSource(Chamber(*TOLD, stopped), ""))
    assert found.inputs.time_s[-1] == 2485.0
    # what is demanded of it afterwards is not in force
    later = _air(RunSource(Chamber(*TOLD, stopped, (2600.0, AirDemand("chamber", 5.0, None))), ""))
    assert later.inputs.demands == found.inputs.demands and later.inputs.time_s[-1] == 2485.0
    assert _air(RunSource(Chamber(*TOLD[:1]), "")) == "the chamber was not started in this run"
    assert _air(RunSource(Chamber(TOLD[1]), "")) == "the chamber was not started in this run"
    assert _air(RunSource(Chamber(*TOLD[:2], end_s=60.0), "")) == "the chamber did not run long enough"
    steady = _air(RunSource(Chamber(*TOLD[:2], end_s=2900.0), ""))
    assert steady.quiet.tolist() == (steady.inputs.time_s > 50.0 + 1800.0).tolist()


def gap_run(name, level, lengths, begin_s):
    """A stretch of two phases, without noise; `level` in the second above the first."""
    n = sum(lengths)
    s = replace(stimulus(n, cold=False), time_s=begin_s + np.arange(1.0, n + 1.0))
    phase = np.repeat(["room", "shock"], lengths)
    output = np.where(phase == "room", 5.0, 5.0 + level)
    return replace(made_run(name, s, np.random.default_rng(1)), output_dph=output, phase=phase)


def test_phases_of_a_run_and_its_rehearsals_are_laid_on_each_other():
    """Two whole 100 s of room, three of shock; closed leaves half, two rehearsals differ by a tenth."""
    lengths = [(250, 330), (290, 310), (250, 399), (280, 330)]
    levels, begins = (2.0, 0.0, 1.0, 0.8), (500.0, 0.0, 10.0, 20.0)
    logs = [[gap_run(f"r{k}", *each)] for k, each in enumerate(zip(levels, lengths, begins, strict=True))]
    found = log_gaps(*logs)
    course = np.array([0.0, 0.0, 1.0, 1.0, 1.0])
    course -= course.mean()
    (curve,) = found.curves
    assert curve.run_id == "r0"
    assert curve.time_s.tolist() == [550.5, 650.5, 800.5, 900.5, 1000.5]
    assert curve.nominal_dph == pytest.approx(2.0 * course)
    assert curve.closed_dph == pytest.approx(1.0 * course)
    assert curve.floor_dph == pytest.approx(0.2 * course)
    whole, room, shock = found.rate
    assert [each.part for each in found.rate] == ["all", "room", "shock"]
    size = math.sqrt(float((course**2).mean()))
    assert (whole.rms_nominal, whole.rms_closed, whole.rms_floor) == pytest.approx(
        (2 * size, size, 0.2 * size)
    )
    assert whole.share == pytest.approx(1.0 - (1.0 - 0.04) / (4.0 - 0.04))
    assert (room.rms_nominal, shock.rms_nominal) == pytest.approx((2 * 0.6, 2 * 0.4))
    other = replace(logs[1][0], phase=np.where(logs[1][0].phase == "room", "hall", "shock"))
    with pytest.raises(ConfigurationError, match="other phases"):
        log_gaps(logs[0], [other], *logs[2:])


def test_of_a_position_the_gap_is_that_of_the_stays_after_the_first(monkeypatch):
    """North is off by 3 arcsec with the nominal model, by 1 closed, two rehearsals by 0.5; east by as much."""
    marks = [
        SimpleNamespace(start=low, stop=low + 10, heading_deg=heading)
        for low, heading in ((0, 0), (10, 90), (20, 180))
    ]
    monkeypatch.setattr(_rehearsal, "stays", lambda log: marks)
    monkeypatch.setattr(
        _rehearsal, "_position", lambda log: np.stack((log.off, log.off)) + log.time_s - log.time_s[0]
    )
    logs = [
        SimpleNamespace(time_s=begin_s + np.arange(30.0), off=np.repeat([9.0, off, 2.0 * off], 10))
        for begin_s, off in ((100.0, 3.0), (0.0, 0.0), (50.0, 2.0), (7.0, 1.5))
    ]
    whole, first, second = _heading_log_gaps(*logs)
    root = math.sqrt(2.0)
    assert [each.part for each in (whole, first, second)] == ["all", "90 deg", "180 deg"]
    assert (first.rms_nominal, first.rms_closed, first.rms_floor) == pytest.approx(
        (3 * root, root, 0.5 * root)
    )
    assert (second.rms_nominal, second.rms_closed, second.rms_floor) == pytest.approx(
        (6 * root, 2 * root, root)
    )
    assert whole.rms_closed == pytest.approx(root * math.sqrt(2.5)) and whole.unit == "arcsec"


def test_the_unit_is_that_of_the_first_run():
    run = made_run("r", stimulus(300), np.random.default_rng(1))
    time_s = np.arange(9.0)
    inputs = ChannelInputs(time_s, time_s, 0.0, 1.0)
    channel = ChannelSeries("chamber_air", "r", inputs, time_s, time_s.astype(str), time_s > 0.0, 0.1)
    assert Recordings((run, channel), (), {}).unit_id == "unit 1"
    assert Recordings((channel, run), (), {}).unit_id == ""
    assert Recordings((run, channel), (), {}).shown == [run]
    other = replace(run, run_id="held out")
    assert Recordings((run,), (other, channel), {}).shown == [other]


def test_a_benchs_designs_hold_the_usual_ones_within_its_limits():
    file = load_bench_file(DEMO)
    usual, own = usual_designs(file.bench.latitude_deg), designs_for(file)
    demands = {each.text: each.test.demands(each.test.parse(dict(each.settings))) for each in usual}
    possible = {text for text, each in demands.items() if not any(beyond_limits(each, file))}
    assert len(possible) == 4 and possible <= {each.text for each in own}
    for each in usual:
        expected_s = each.test.expected_duration_s(each.test.parse(dict(each.settings)))
        assert 60.0 * each.hours == pytest.approx(expected_s / 60.0, rel=1e-9)


@pytest.mark.parametrize(("rate_dps", "hours", "reversals"), [(20.0, 2.0, 0), (6.0, 0.5, 3), (2.0, 2.0, 3)])
def test_a_rotation_turns_as_often_to_each_side_as_it_is_reversed(rate_dps, hours, reversals):
    design = _rotation(39.1, rate_dps, hours, reversals, "z")
    (s,) = design.stimuli.values()
    assert len(s) * s.period_s == pytest.approx(3600.0 * hours, abs=0.5 * (reversals + 1))
    turns = 3600.0 * hours * rate_dps / 360.0
    assert design.settings["turns"] == pytest.approx(turns) and design.settings["reversals"] == reversals
    signs = np.sign(s.table_rate_dps)
    assert np.abs(s.table_rate_dps) == pytest.approx(np.full(len(s), rate_dps))
    assert (np.diff(signs) != 0.0).sum() == reversals
    assert float(signs.sum()) == pytest.approx(0.0 if reversals else len(s), abs=1.0)


def test_rates_in_turn_are_foretold_as_the_procedure_makes_them():
    designs = [d for d in designs_for(load_bench_file(DEMO)) if d.procedure == "rates-over-temperature"]
    assert len(designs) == 6  # the demo's table turns at 20 deg/s at most
    for design in designs:
        (s,) = design.stimuli.values()
        p = design.test.parse(dict(design.settings))
        assert len(s) == pytest.approx(3600.0 * design.hours, abs=2.0)
        changes = np.flatnonzero(np.abs(np.diff(s.table_rate_dps)) > 1.0) + 1
        # after ten minutes and the first rest each rate stays for a minute and the way to it
        assert changes[0] == 600 + 65 and set(np.diff(changes)) == {65}
        turn = [float(s.table_rate_dps[600 + 65 * k]) for k in range(2 * p.rates_per_sign + 2)]
        assert turn == pytest.approx(p.rates_dps())
        at_room_s = 600 + 65 * len(turn) * p.sequences
        assert p.sequences == (1 if p.over_temperature else 2)
        air_moves = np.flatnonzero(np.abs(np.diff(s.t_out_c)) > 1e-9)
        if p.over_temperature:
            assert air_moves[0] == pytest.approx(at_room_s, abs=2)
            low, high = float(s.t_out_c.min()), float(s.t_out_c.max())
            assert (low, high) == pytest.approx((p.low_c, p.high_c), abs=1.5)
            assert s.t_out_c[-1] < high - 10.0
        else:
            assert len(s) == at_room_s and not len(air_moves)


def stamped(places, usual_s=0.2):
    time_s = usual_s * np.asarray(places, np.float64)
    owner = np.floor(time_s).astype(np.int64)
    return SimpleNamespace(time_s=time_s, usual_s=usual_s, period_s=1.0, owner=owner)


def test_rows_are_laid_on_their_grid_unless_most_of_it_is_empty():
    rows = np.arange(10.0)
    even, owner = even_rows(stamped(range(10)), rows)
    assert even.tolist() == rows.tolist() and owner.tolist() == [0] * 5 + [1] * 5
    lost, owner = even_rows(stamped([*range(9), 20]), rows)  # as many places as rows twice over
    assert len(lost) == 21 and np.isnan(lost[9:20]).all() and lost[20] == 9.0
    assert owner.tolist() == [0] * 5 + [1] * 4 + [-1] * 11 + [4]
    assert even_rows(stamped([*range(9), 21]), rows)[0] is None
    assert even_rows(stamped([0, 1, 2, 3, 4, 5, 6, 7, 8, 9.31]), rows)[0] is None
    assert even_rows(stamped([0, 1, 2, 3, 4, 5, 6, 7, 8, 9.29]), rows)[0] is not None
    assert even_rows(stamped(range(10), usual_s=0.6), rows)[0] is None


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", None])
def test_a_model_file_that_is_no_text_or_is_not_there_is_refused(tmp_path, content):
    file = tmp_path / "m.toml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ConfigurationError, match="cannot be read"):
        read_model(file)


@pytest.mark.parametrize("what", ["parameters", "sigma", "shape"])
@pytest.mark.parametrize("change", ["lacks one", "has one more"])
def test_an_effects_parameters_sigmas_and_shape_are_all_there_and_no_others(what, change):
    variant = Variant(effect("shupe"), {"lag_s": 180.0})
    names = [parameter.name for parameter in variant.effect.parameters]
    tables = {
        "parameters": dict.fromkeys(names, 0.1),
        "sigma": dict.fromkeys(names, 0.1),
        "shape": {"lag_s": 180.0},
    }

    def text():
        rows = [
            f"{key} = {{ " + ", ".join(f"{k} = {v}" for k, v in own.items()) + " }"
            for key, own in tables.items()
        ]
        return "\n".join(
            ["format = 1", "[noise]", "arw_deg_per_sqrt_h = 0.01", "[[effect]]", 'name = "shupe"', *rows]
        )

    assert parse_model(text(), "m").terms[0].values == (0.1,) * len(names)
    if change == "has one more":
        tables[what]["strange"] = 1.0
        said = f"strange in {what}"
    else:
        said = f"no {tables[what].popitem()[0]} in {what}"
    if what == "shape" and change == "lacks one":
        assert parse_model(text(), "m").terms[0].variant.shape == dict(
            variant.effect.shapes[0]
        )  # the usual one
    else:
        with pytest.raises(ConfigurationError, match="parameters and shapes") as refused:
            parse_model(text(), "m")
        assert refused.value.found == said


@pytest.mark.parametrize("period_s", [0.5, 1.0, 4.0])
def test_means_of_what_a_simulation_foretells_are_its_integrals(period_s):
    """A parabola, drawn finely: the mean of t^2 from a to b is (a^2 + a b + b^2) / 3."""
    s = replace(stimulus(300, cold=False), period_s=period_s)
    time_s = np.arange(0.0, 200.0 * period_s, 0.01 * period_s)
    found = _means(s, time_s, time_s**2)
    a = period_s * np.arange(300.0)
    b = a + period_s
    assert found[:199] == pytest.approx(((a * a + a * b + b * b) / 3.0)[:199], rel=1e-4, abs=1e-3)
    assert np.isnan(found[201:]).all()
    # what begins or ends within a step and a half of the course is taken as it is at its end
    coarse = period_s * np.arange(1.0, 300.0)
    means = _means(s, coarse, coarse)
    assert means[0] == pytest.approx(period_s) and means[1:299] == pytest.approx(
        coarse[:298] + 0.5 * period_s
    )
    assert np.isfinite(means).all() and np.isnan(_means(s, coarse[1:], coarse[1:])[0])


def test_paths_of_a_simulation_are_those_from_its_model_file():
    moved = Simulation({"columns": "sim_{run}.csv", "time": {"name": "t"}}, Path("/a/b")).moved(
        Path("/a/c/d")
    )
    assert moved.settings == {"columns": "../../b/sim_{run}.csv", "time": {"name": "t"}}
    assert moved.folder == Path("/a/c/d")
    function = Simulation({"function": "mine"}, Path("/a/b"))
    assert function.moved(Path("/a/c")).settings == {"function": "mine"}


def test_what_a_function_foretells_takes_the_place_of_the_input_rate(monkeypatch):
    monkeypatch.setattr(
        _simulation, "_OWN_FUNCTIONS", {"mine": lambda inputs: 1.5 * inputs["rate_dps"] + 1.0}
    )
    simulation = Simulation({"function": "mine"}, Path())
    run = made_run("r", stimulus(300, rate_dps=2.0), np.random.default_rng(1))
    run = replace(run, output_dph=1.5 * run.stimulus.input_rate_dph + 3600.0 + 7.0)
    (found,) = beside(simulation, [run])
    assert found.output_dph - run.stimulus.input_rate_dph == pytest.approx(np.full(300, 7.0))
    assert found.simulated and beside(simulation, [found, "another signal"]) == [found, "another signal"]
    assert beside(None, [run]) == [run]
    in_radians = Simulation({"function": "mine", "output": {"unit": "rad/s"}}, Path())
    (found,) = beside(in_radians, [replace(run, output_dph=run.output_dph * 180.0 / math.pi)])
    assert found.output_dph - run.stimulus.input_rate_dph == pytest.approx(
        np.full(300, 7.0 * 180.0 / math.pi), rel=1e-4
    )
    wrong = Simulation({"columns": "c.csv", "time": "t", "output": {"name": "r", "unit": "deg/s"}}, Path())
    with pytest.raises(ConfigurationError, match="does not say its column"):
        wrong.foretold_dph(run.stimulus, "r")
    with pytest.raises(ConfigurationError, match="does not say its column"):
        replace(wrong, settings={**wrong.settings, "time": {"unit": "s"}}).foretold_dph(run.stimulus, "r")


def test_a_function_is_found_by_the_name_of_its_entry_point(monkeypatch):
    points = [
        SimpleNamespace(name=name, load=lambda size=size: lambda inputs: np.full(300, size))
        for name, size in (("a", 1.0), ("b", 2.0))
    ]
    monkeypatch.setattr(_simulation, "entry_points_of", lambda _: points)
    monkeypatch.setattr(_simulation, "_OWN_FUNCTIONS", {})
    s = stimulus(300)
    for name, size in (("a", 1.0), ("b", 2.0)):
        assert Simulation({"function": name}, Path()).foretold_dph(s, "r") == pytest.approx(
            np.full(300, 3600.0 * size)
        )
    with pytest.raises(ConfigurationError, match="no such simulation") as refused:
        Simulation({"function": "c"}, Path()).foretold_dph(s, "r")
    assert refused.value.found == "c" and "a, b" in refused.value.expected


@pytest.mark.parametrize(
    ("effects", "function"), [(True, True), (True, False), (False, True), (False, False)]
)
def test_a_file_of_ones_own_has_an_effect_or_a_function(monkeypatch, tmp_path, effects, function):
    own = {}
    monkeypatch.setattr(_simulation, "_OWN_FUNCTIONS", own)
    monkeypatch.setattr(_simulation, "add_effects", lambda *_: ["one"] if effects else [])
    file = tmp_path / "mine.py"
    file.write_text("def mine(inputs):\n    return inputs\n" if function else "import math\nMINE = 1\n")
    if effects or function:
        take_own(file)
    else:
        with pytest.raises(ConfigurationError, match="defines no effect"):
            take_own(file)
    assert list(own) == (["mine"] if function else [])


@pytest.mark.parametrize("period_s", [1.0, 2.0])
def test_a_case_is_read_as_it_was_written(tmp_path, period_s):
    rng = np.random.default_rng(1)
    runs = []
    for name, condition in (("a 1", "+2"), ("a 2", "-2")):
        s = stimulus(600, rate_dps=float(condition))
        s = replace(s, time_s=40.0 + period_s * s.time_s, period_s=period_s)
        run = made_run(name, s, rng, condition=condition)
        phase = np.repeat(["room", "shock", "room", "end"], [150, 101, 300, 49])
        runs.append(replace(run, phase=phase))
    found = read_mapped_runs(write_case(tmp_path / "case", runs))
    for run, again in zip(runs, found, strict=True):
        assert (again.run_id, again.unit_id, again.profile, again.condition) == (
            run.run_id,
            "unit 1",
            "shock",
            run.condition,
        )
        assert again.phase.tolist() == run.phase.tolist()
        assert again.output_dph == pytest.approx(run.output_dph) and not again.missing.any()
        for name in ("time_s", "t_in_c", "t_out_c", "angle_deg", "elevation_deg"):
            assert getattr(again.stimulus, name) == pytest.approx(getattr(run.stimulus, name), abs=1e-9)
        assert again.stimulus.latitude_deg == run.stimulus.latitude_deg
        assert again.stimulus.period_s == period_s


def slope(size, s):
    """A bias over temperature as a term, and what it does."""
    variant = Variant(effect("bias_linear"), dict(effect("bias_linear").shapes[0]))
    term = Term(variant, (size,), (0.1,))
    return term, size * variant.columns(s)[0]


@pytest.mark.parametrize(("period_s", "width"), [(1.0, 101), (2.0, 51), (4.0, 25)])
def test_differences_are_means_of_repeats_over_100_s_each_runs_bias_out(period_s, width):
    s, rng = replace(stimulus(4000), period_s=period_s), np.random.default_rng(1)
    term, course = slope(20.0, s)
    runs = [
        replace(
            made_run(name, s, rng), output_dph=s.input_rate_dph + course + bias + rng.normal(0.0, 0.01, 4000)
        )
        for name, bias in (("a", 5.0), ("b", -3.0))
    ]
    before, after = Model("m", (), WHITE), Model("m", (term,), WHITE)
    (found,) = differences(runs, before, after, points=4000)
    assert (found.profile, found.condition, found.time_s.tolist()) == ("shock", "0", s.time_s.tolist())
    mean = np.convolve(course - course.mean(), np.full(width, 1 / width), mode="valid")
    assert found.before_dph[width // 2 : -(width // 2)] == pytest.approx(mean, abs=0.01)
    assert found.after_dph == pytest.approx(np.zeros(4000), abs=0.01)
    assert len(differences(runs, before, after, points=7)[0].time_s) == 7


def test_half_of_an_effect_taken_out_is_three_quarters_of_its_energy():
    """In each phase, profile and in all; the room, where nothing changes, has no share of its own."""
    s, rng = stimulus(4000), np.random.default_rng(1)
    whole, course = slope(10.0, s)
    half, _ = slope(5.0, s)
    runs = [made_run(name, s, rng, course) for name in "ab"]
    floor = Floor(np.ones(len(BANDS)), np.zeros(len(BANDS)), from_repeats=True)
    nothing = Model("m", (), WHITE)
    found = shrinkage(nothing, Model("m", (half,), WHITE), runs, floor)
    assert found.share == pytest.approx(0.75, abs=0.01) and 0.74 < found.low < found.high < 0.76
    assert found.by_profile["shock"] == pytest.approx(0.75, abs=0.01)
    assert found.by_phase["shock: shock"] == pytest.approx(0.75, abs=0.02)
    assert found.rms_after == pytest.approx(0.5 * found.rms_before, rel=0.02)
    assert shrinkage(nothing, Model("m", (whole,), WHITE), runs, floor).by_phase["shock: shock"] > 0.98


def test_noise_that_a_floor_may_hold_is_no_gap():
    """A floor known to a half of it may be twice as high at two standard deviations: 1.7 times is nothing."""
    s, model = stimulus(8000, cold=False), Model("m", (), WHITE)
    for size, clear in ((1.3, False), (1.6, True)):
        noise = np.random.default_rng(2).normal(0.0, size * 0.24, 8000)
        run = replace(made_run("r", s, np.random.default_rng(1)), output_dph=s.input_rate_dph + noise)
        floor = Floor(np.ones(len(BANDS)), np.full(len(BANDS), 0.5), from_repeats=True)
        assert bool(shrinkage(model, model, [run], floor).cells) is clear


@pytest.mark.parametrize(("unknown", "called"), [(0.49, False), (0.51, True), (0.99, True)])
def test_more_probable_than_not_is_called_unknown(unknown, called):
    assert mark(unknown=unknown).called_unknown is called


@pytest.mark.parametrize("start_s", [0, 251])
def test_samples_stand_in_their_place_on_a_grid_of_their_own(start_s):
    rows_dps, row_s, owner = _run_folder._rows(Folder(lambda t: 0.0 * t, []), "gyro", start_s, start_s + 40)
    assert row_s == pytest.approx(0.1, rel=1e-9) and len(rows_dps) == 400
    lost = np.flatnonzero(np.arange(400) % 50 == 7)
    assert set(lost) < set(np.flatnonzero(np.isnan(rows_dps)))
    known = ~np.isnan(rows_dps)
    assert known.sum() == 392 - 4  # lost ones, and those that are invalid
    expected = 100.0 + start_s + 0.1 * np.arange(400) + 0.05
    np.testing.assert_allclose(rows_dps[known], expected[known], atol=1e-4)
    assert (owner[lost] == -1).all()
    at = np.flatnonzero(owner >= 0)
    np.testing.assert_array_equal(owner[at], at // 10)
