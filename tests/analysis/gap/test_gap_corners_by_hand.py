"""Corners of the diagnosis: what a run lacks, a user's simulation, an exam's seals, a platform's verdicts."""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.fft import dct, idct

from bench.analysis.gap import (
    Model,
    Noise,
    Term,
    _channel_data,
    _diagnose,
    _disturbed,
    _examination,
    _fmu,
    _log_rows,
    _position,
    _run_folder,
    diagnose,
)
from bench.analysis.gap._aliases import in_rows
from bench.analysis.gap._bridge import bridge
from bench.analysis.gap._cells import BANDS, band_slices
from bench.analysis.gap._channel_data import _air, _angle, _rate
from bench.analysis.gap._channel_run import RunSource
from bench.analysis.gap._channels import ChannelFinding, ChannelSignal, _verdict
from bench.analysis.gap._close import _shares_by_phase
from bench.analysis.gap._data import Group, check_runs
from bench.analysis.gap._examination import _Case, _judged, _seal
from bench.analysis.gap._fit import Floor, Solution, beside_nominal
from bench.analysis.gap._import import read_imported_run, read_mapped_runs
from bench.analysis.gap._lines import strongest_line
from bench.analysis.gap._model_file import ChannelTerm, DisturbanceTerm, model_text, parse_model
from bench.analysis.gap._position import PositionRun, PositionSignal, _term
from bench.analysis.gap._run_folder import _between_polls, load_gap_runs
from bench.analysis.gap._series import write_missing
from bench.analysis.gap._simulation import read_simulation
from bench.record.events.run import AngleDemand
from drivers.base.errors import BenchError, ConfigurationError
from simulators.effects import ChannelEffect, catalogue
from simulators.effects._disturbance import Finding
from tests.analysis.gap.conftest import effect, made_run, stimulus

WHITE = Noise(0.004)
HEAD = "format = 1\n[noise]\narw_deg_per_sqrt_h = 0.01\n"


def test_a_run_says_what_it_lacks_for_a_channel():
    bare = RunSource(SimpleNamespace(tables=()), "")
    assert _air(bare) == "the run has no chamber"
    assert _angle(bare) == _rate(bare) == "the run has no table"


def test_a_table_that_is_at_an_angle_for_too_few_samples_shows_none(monkeypatch):
    demand = AngleDemand("outer", 10.0, 5.0)
    monkeypatch.setattr(RunSource, "table_demands", lambda source: iter([(0.0, 1000.0, demand)]))
    count = 2 * _channel_data._SHORT + 4
    rows = {
        "time_ns": (1e9 * np.arange(count)).astype(np.int64),
        "angle_deg": np.full(count, 10.0),
        "rate_dps": np.zeros(count),
    }
    run = SimpleNamespace(tables=("turntable",), turntable=lambda columns, start, end: rows)
    assert _angle(RunSource(run, "")) == "no angle was demanded of the table and held for half a minute"


def test_a_channel_is_told_with_its_scatter_and_unknown_where_nothing_explains_it():
    jitter = ChannelFinding(
        signal="time_stamps",
        unit="ms",
        verdict="no gap",
        causes=(),
        terms=(),
        stochastic={"arrival_jitter": 0.12345},
    )
    said = jitter.scatter("arrival_jitter")
    one = catalogue()["arrival_jitter"]
    assert said == f"arrival_jitter: {one.meaning} {one.parameter.name} = 0.123"
    clear, vague = SimpleNamespace(clear=True), SimpleNamespace(clear=False)

    def verdict(*places, rms=2.0, accuracy=1.0, causes=("x",), explained=0.99):
        return _verdict(
            SimpleNamespace(places=places, rms=rms, accuracy=accuracy, digit=0.0), causes, explained
        )

    assert verdict(vague) == verdict() == "no gap"
    assert verdict(vague, clear, rms=1.0) == "within the model's accuracy"
    assert verdict(clear, causes=()) == "unknown"
    assert verdict(clear) == "explained" and verdict(clear, explained=0.1) == "explained in part"


def test_a_channel_without_a_cause_is_shown_on_the_runs_held_out_and_not_judged(monkeypatch):
    monkeypatch.setattr("bench.analysis.gap._channels._curves", lambda held_out, *_: [len(held_out)])
    finding = ChannelFinding(signal="table_rate", unit="deg/s", verdict="unknown", causes=(), terms=())
    data = SimpleNamespace(effects=(), nominal=None)
    found = ChannelSignal("table_rate").judged(finding, data, (None, None), ["a", "b"])
    assert found.curves == (2,) and found.held_out == ()


def test_rows_tell_nothing_where_there_are_none_or_they_are_as_slow_as_the_steps():
    run = made_run("a", stimulus(600), np.random.default_rng(1))
    period_s = run.stimulus.period_s
    for rows, row_s in ((None, 0.1), (np.zeros(600), 0.5 * period_s)):
        found = in_rows(0.1, [replace(run, rows_dps=rows, row_s=row_s)])
        assert (found.seen_hz, found.period_s) == (0.1, period_s) and math.isnan(found.frequency_hz)
        assert "may be an alias" in found.sentence
    short = in_rows(
        0.1, [replace(run, rows_dps=np.random.default_rng(1).normal(size=8), row_s=0.1 * period_s)]
    )
    assert math.isnan(short.frequency_hz)


def test_a_run_too_short_for_windows_shows_no_line():
    run = made_run("a", stimulus(100), np.random.default_rng(1))
    rows = np.ones((2, 99))
    rows[:, 60] = 1e3
    assert strongest_line([Group("still", ("0",), ((run, run),))], [rows], WHITE, {}) is None


def test_what_a_simulation_lacks_is_written_run_by_run(tmp_path):
    """Columns to nine digits: the ends of the steps, what is left, and what the terms add."""
    s, rng = stimulus(50), np.random.default_rng(3)
    slope = effect("bias_linear").variants()[0]
    model = Model("m", (Term(slope, (0.7,), (0.1,)),), WHITE)
    told = replace(made_run("run 1/äb", s, rng), simulated=True)
    files = write_missing(model, [made_run("plain", s, rng), told], tmp_path / "closed.toml")
    assert files == [tmp_path / "closed_run-1-äb.csv"]
    lines = files[0].read_text().splitlines()
    assert lines[0] == "time_s,left_dph,missing_dph" and len(lines) == 51
    rows = np.array([[float(each) for each in line.split(",")] for line in lines[1:]])
    assert rows[:, 0] == pytest.approx(s.period_s * np.arange(1.0, 51.0))
    assert rows[:, 1] == pytest.approx(told.output_dph - s.input_rate_dph, abs=1e-6)
    assert rows[:, 2] == pytest.approx(0.7 * slope.columns(s)[0], abs=1e-6)


def test_a_models_simulation_comes_back_from_its_text():
    simulation = '[simulation]\nfmu = "a/b.fmu"\noutput = { name = "o", unit = "deg/s" }\n'
    simulation += 'inputs = { rate = "rate_dps" }\nstart_values = { bias = 1.5, on = true }\n'
    model = parse_model(HEAD + simulation, "folder/m.toml")
    again = parse_model(model_text(model), "folder/m.toml")
    assert again.simulation.settings == model.simulation.settings == {
        "fmu": "a/b.fmu", "output": {"name": "o", "unit": "deg/s"}, "inputs": {"rate": "rate_dps"},
        "start_values": {"bias": 1.5, "on": True},
    }  # fmt: skip
    assert again.simulation.folder == Path("folder") and again.simulation.kind == "fmu"
    moved = again.simulation.moved(Path("folder/deep"))
    assert moved.settings["fmu"] == "../a/b.fmu" and moved.folder == Path("folder/deep")


def test_a_disturbance_in_a_model_file_keeps_its_values():
    each = next(own for own in catalogue().values() if type(own).__name__ == "Disturbance")
    values = ", ".join(f"{p.name} = {0.5 * sum(p.bounds(1.0))!r}" for p in each.parameters)
    sigmas = ", ".join(f"{p.name} = 0.25" for p in each.parameters)
    text = f'[[effect]]\nname = "{each.name}"\nparameters = {{ {values} }}\nsigma = {{ {sigmas} }}\n'
    model = parse_model(HEAD + text, "m")
    (term,) = model.disturbances
    assert term.name == each.name and not model.terms and set(term.sigmas) == {0.25}
    assert term.values == tuple(0.5 * sum(p.bounds(1.0)) for p in each.parameters)
    assert parse_model(model_text(model), "m").disturbances == model.disturbances


def test_a_simulation_that_foretells_nothing_is_refused(tmp_path, monkeypatch):
    s = stimulus(20)
    where = str(tmp_path / "m.toml")
    columns = {
        "columns": "{run}.csv",
        "time": {"name": "t", "unit": "s"},
        "output": {"name": "r", "unit": "deg/h"},
    }
    of_columns = read_simulation(columns, where)
    for rows in ("0,1\n", "0,1\n1,2\n1,3\n", "0,1\n2,2\n1,3\n"):
        (tmp_path / "a.csv").write_text("t,r\n" + rows)
        with pytest.raises(ConfigurationError, match="no times that grow"):
            of_columns.foretold_dph(s, "a")
    (tmp_path / "a.csv").write_text("t,r\n900,1\n901,2\n")
    with pytest.raises(ConfigurationError, match="foretells nothing of this run") as refused:
        of_columns.foretold_dph(s, "a")
    assert refused.value.found == "(20,) values, 0 of them numbers"
    (tmp_path / "a.csv").write_text("t,r\n" + "".join(f"{t},{7.0 + 2.0 * t}\n" for t in range(0, 31)))
    edges = s.period_s * np.arange(21.0)
    assert of_columns.foretold_dph(s, "a") == pytest.approx(7.0 + edges[1:] + edges[:-1])
    fmu = {
        "fmu": "x.fmu",
        "output": {"name": "o", "unit": "deg/s"},
        "inputs": {"a": "speed", "b": "rate_dps"},
    }
    with pytest.raises(ConfigurationError, match="not recorded") as refused:
        read_simulation(fmu, where).foretold_dph(s, "a")
    assert refused.value.found == "speed"

    def damaged(file):
        raise EOFError("too short")

    monkeypatch.setattr(_fmu, "from_extra", lambda *_: SimpleNamespace(read_model_description=damaged))
    with pytest.raises(ConfigurationError) as refused:
        read_simulation(fmu | {"inputs": {}}, where).foretold_dph(s, "a")
    assert "EOFError: too short" in str(refused.value)


def test_an_imported_run_is_read_from_its_own_mapping_and_what_was_foretold_is_taken_off(tmp_path):
    with pytest.raises(ConfigurationError, match="this run was not imported"):
        read_imported_run(SimpleNamespace(manifest=SimpleNamespace(imported=None), place="p"))
    rows = "".join(f"{t},{1.0 + 0.001 * t},{0.5 + 0.001 * t},20\n" for t in range(1, 41))
    (tmp_path / "log.csv").write_text("t,rate,sim,temp\n" + rows)
    head = 'format = 1\nunit_id = "u"\nlatitude_deg = 0\n[columns]\ntime = { name = "t", unit = "s" }\n'
    head += 't_in = { name = "temp", unit = "degC" }\n'
    rate = 'output = { name = "rate", unit = "deg/s" }\n'
    foretold = 'foretold = { name = "sim", unit = "deg/s" }\n'
    listed = '[[run]]\nfile = "log.csv"\n'
    (tmp_path / "m.toml").write_text(head + rate + foretold + listed)
    (run,) = read_mapped_runs(tmp_path / "m.toml")
    assert run.simulated and run.output_dph == pytest.approx(1800.0 + run.stimulus.input_rate_dph)
    (tmp_path / "m.toml").write_text(head + rate + listed)
    (plain,) = read_mapped_runs(tmp_path / "m.toml")
    assert not plain.simulated and plain.output_dph[1:] - plain.output_dph[:-1] == pytest.approx(3.6)
    (tmp_path / "m.toml").write_text(head + 'rate_y = { name = "rate", unit = "deg/s" }\n' + listed)
    with pytest.raises(ConfigurationError):
        read_mapped_runs(tmp_path / "m.toml")


def test_uneven_or_slow_rows_have_no_grid():
    def rows(time_s, usual_s=1.0, period_s=10.0):
        owner = np.arange(len(time_s))
        steps = SimpleNamespace(
            time_s=np.asarray(time_s, float), usual_s=usual_s, period_s=period_s, owner=owner
        )
        return _log_rows.even_rows(steps, np.arange(float(len(time_s))))[0]

    kept = rows([5.0, 6.0, 8.0])
    assert kept[[0, 1, 3]].tolist() == [0.0, 1.0, 2.0] and math.isnan(kept[2])
    assert rows([0.0, 1.0, 2.0], period_s=1.9) is None and rows([0.0, 1.0, 2.0], period_s=2.0) is not None
    off = _log_rows._UNEVEN
    assert rows([0.0, 1.0 + 1.01 * off, 2.0]) is None and rows([0.0, 1.0 + 0.99 * off, 2.0]) is not None
    far = math.floor(_log_rows._MOST_PLACES * 3)
    assert rows([0.0, 1.0, far]) is not None and rows([0.0, 1.0, far + 1.0]) is None


def folder_of(monkeypatch, **facts):
    manifest = SimpleNamespace(
        **{
            "units": {"imu": "u"},
            "procedure": "standard-test",
            "imported": None,
            "devices": {},
            "run_id": "r",
        }
        | facts,
        device=lambda unit: SimpleNamespace(role="gyro" if unit.startswith("fog") else "platform"),
    )
    run = SimpleNamespace(manifest=manifest, place="run folder", events=[], phases=lambda: [], checksum="sum")
    monkeypatch.setattr(_run_folder.Run, "open", lambda folder: run)
    return run


def test_a_run_without_its_gyro_or_its_phases_is_refused(monkeypatch):
    folder_of(monkeypatch, devices={"imu": SimpleNamespace(role="platform")})
    with pytest.raises(ConfigurationError, match="the run has no gyro") as refused:
        load_gap_runs(Path("f"))
    assert (refused.value.where, refused.value.found) == ("run folder", "standard-test of imu (platform)")
    folder_of(monkeypatch)
    with pytest.raises(ConfigurationError) as refused:
        load_gap_runs(Path("f"))
    assert refused.value.found == "standard-test of no device"
    run = folder_of(monkeypatch, units={"imu": "u", "fog a": "v", "fog b": "w"})
    with pytest.raises(ConfigurationError, match="no such gyro") as refused:
        load_gap_runs(Path("f"), "imu")
    assert (refused.value.found, refused.value.expected) == ("imu", "fog a, fog b")
    with pytest.raises(ConfigurationError, match="no phases"):
        load_gap_runs(Path("f"))
    run.phases = lambda: [SimpleNamespace(name="bias", start_s=0.0, end_s=9.0)]
    with pytest.raises(ConfigurationError, match="did not get to its rates"):
        load_gap_runs(Path("f"))
    monkeypatch.setattr(_run_folder, "_stretch", lambda *given, **more: (given[1:], more))
    run.phases = lambda: [
        SimpleNamespace(name=name, start_s=start, end_s=start + 9.0)
        for name, start in (("bias", 0.0), ("scale_factor", 10.0), ("other", 20.0), ("scale_factor", 30.0))
    ]
    assert load_gap_runs(Path("f")) == [(("fog a", 10.0, 39.0, ""), {"upright": True})]
    run.manifest.procedure = "cold-shock"
    assert load_gap_runs(Path("f"), "fog b") == [(("fog b", 0.0, 39.0, ""), {})]
    run.events = [{"kind": "section", "time_s": at} for at in (9.0, 25.0)]
    run.phases = lambda: [
        SimpleNamespace(name=name, start_s=start, end_s=start + 9.0)
        for name, start in (("equilibrium", 2.0), ("reference", 10.0), ("shock", 20.0), ("shock", 30.0))
    ]
    assert load_gap_runs(Path("f")) == [(("fog a", 10.0, 25.0, " 1"), {}), (("fog a", 25.0, 39.0, " 2"), {})]
    run.events = []
    assert load_gap_runs(Path("f")) == [(("fog a", 2.0, 39.0, ""), {})]


def test_a_level_axis_loses_the_seconds_in_which_a_slew_leaves_the_earths_rate_unknown():
    """Half a second from polls of a slew that begins at 60 deg/s the angle is 15 deg off: 0.26 rad."""
    time_s = np.arange(41.0)
    angle = np.where(time_s < 20.0, 0.0, 60.0 * (time_s - 20.0))
    table = {"time_ns": (1e9 * time_s).astype(np.int64), "angle_deg": np.mod(angle, 360.0)}
    run = SimpleNamespace(turntable=lambda *_: table, manifest=SimpleNamespace(latitude_deg=60.0))
    edges = np.arange(0.5, 40.0)
    noise = np.random.default_rng(3).normal(0.0, 1.0, 39)
    # 7.52 deg/h of Earth's rate along the level, 1.97 deg/h of it over 15 deg: three sigma are 1.8 or 2.4 deg/h
    bad = _between_polls(run, edges, 0.6 * noise, False)
    assert edges[:-1][bad].tolist() == [18.5, 19.5, 20.5]
    assert not _between_polls(run, edges, 0.8 * noise, False).any()


class Plant:
    """A pool that does at once what it is asked."""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def Pool(self, count):
        return self

    def apply(self, do, given):
        return do(*given)


def test_seals_are_announced_before_the_answers_and_checked_after_them(monkeypatch, tmp_path):
    made = {}

    def make(seed, kind):
        sealed = SimpleNamespace(
            text=f"{seed} {kind}", sha256=hashlib.sha256(f"{seed} {kind}".encode()).hexdigest()
        )
        made[seed] = kind
        return sealed, [seed], ["kept", seed], ["clean"]

    def write(folder, given):
        folder.mkdir(parents=True)
        (folder / "runs.toml").write_text(str(given))

    monkeypatch.setattr(_examination, "make_case", make)
    monkeypatch.setattr(_examination, "write_case", write)
    monkeypatch.setattr(_examination, "get_context", lambda kind: Plant())
    monkeypatch.setattr(_examination, "_diagnosed", lambda nominal, given: (given["runs.toml"].decode(), 1.5))
    monkeypatch.setattr(_examination, "close", lambda answer, kept, clean: (answer, kept, clean))
    monkeypatch.setattr(_examination.Marked, "of", lambda *own: own[1:])
    _examination._made.cache_clear()
    folder = tmp_path / "exam"
    found = list(_examination.examine(10, 7, folder))
    kinds = _examination.case_kinds(10, 7)
    assert made == {700_000 + number: kind for number, kind in enumerate(kinds)}
    hashes = [hashlib.sha256(f"{700_000 + n} {kind}".encode()).hexdigest() for n, kind in enumerate(kinds)]
    said = [f"{number:4d} {own[:16]}" for number, own in enumerate(hashes)]
    assert [name for name, _ in found] == [*said[:8], *said[:8], *said[8:], *said[8:]]
    assert [marked is None for _, marked in found] == [True] * 8 + [False] * 8 + [True] * 2 + [False] * 2
    answer, closed, seconds = found[8 + 3][1]
    assert (answer, seconds) == ("[700003]", 1.5) and closed == ("[700003]", ["kept", 700003], ["clean"])
    assert (folder / "sealed" / "case_0003.json").read_text() == f"700003 {kinds[3]}"
    assert parse_model((folder / "nominal.toml").read_text(), "n").name == "nominal"
    case = _Case(3, kinds[3], 7, folder)
    assert case.shown == folder / "cases" / "case_0003"
    case.seal.write_text("another")
    with pytest.raises(BenchError, match="case_0003 was changed after it was sealed"):
        _judged(case, "x")
    with pytest.raises(FileExistsError):
        _seal(case)
    monkeypatch.setattr(_examination, "_seal", lambda case: "0" * 64)
    monkeypatch.setattr(
        _examination, "_judged", lambda case, answer: (SimpleNamespace(sha256="1" * 64), None)
    )
    with pytest.raises(BenchError, match="is not the one that was announced"):
        list(_examination.examine(1, 7, folder))
    _examination._made.cache_clear()


def test_a_folder_is_of_a_platform_if_it_has_one_and_no_gyro(monkeypatch):
    monkeypatch.setattr(_position, "is_run", lambda folder: folder.name != "none")
    roles = []
    manifest = SimpleNamespace(devices={}, units={"ins": "P-1", "b": "P-2"}, run_id="r")
    monkeypatch.setattr(
        _position.Run, "open", lambda folder: SimpleNamespace(manifest=manifest, checksum="sum")
    )
    for roles, found in ((["platform"], True), (["platform", "gyro"], False), (["gyro"], False), ([], False),
                         (["table", "platform"], True)):  # fmt: skip
        manifest.devices = {str(k): SimpleNamespace(role=role) for k, role in enumerate(roles)}
        assert _position.is_platform_run(Path("r")) is found
        assert _position.is_platform_run(Path("none")) is False
    monkeypatch.setattr(_position, "site_of_run", lambda folder: "site")
    monkeypatch.setattr(_position, "load_log", lambda folder, site: ((folder.name, site), "more"))
    run = _position.load_platform_run(Path("r"))
    assert (run.run_id, run.unit_id, run.log, run.checksum) == ("r", "P-1", ("r", "site"), "sum")
    manifest.units = {}
    assert _position.load_platform_run(Path("r")).unit_id == ""


def test_platforms_are_diagnosed_by_their_position_alone(monkeypatch):
    asked = []
    monkeypatch.setattr(
        _diagnose.PositionSignal,
        "find",
        lambda self, runs, model, held_out: asked.append((runs, held_out)) or "found",
    )
    one, two, three = (PositionRun(name, "P", None, f"sum {name}") for name in "abc")
    model = Model("m", (), WHITE)
    found = diagnose([one, two], model, [three])
    assert asked == [([one, two], [three])] and found.findings == ("found",) and found.unit_id == "P"
    assert found.run_checksums == {"a": "sum a", "b": "sum b"}


def finding_of(monkeypatch, sets, cause, mixed=False):
    monkeypatch.setattr(_position, "_places", lambda *_: ())
    monkeypatch.setattr(_position, "_shrinkage", lambda name, study, log: name)
    model = SimpleNamespace(
        evidence=SimpleNamespace(cause=cause, mixed=mixed), gain=np.arange(9.0).reshape(3, 3),
        sigma=np.ones((3, 3)), tau_s=7200.0,
    )  # fmt: skip
    study = SimpleNamespace(model=model, findings=[SimpleNamespace(what="w", consequence="c")])
    data = SimpleNamespace(term=None, fitted="a", left={"a": None}, others={"b": None}, study=study)
    return PositionSignal().finding(data, sets)


def test_a_platforms_verdict_follows_the_probabilities(monkeypatch):
    heading, steps = _position._HEADING_EFFECT, _position._STEPS
    clear = finding_of(monkeypatch, {"": 0.01, heading: 0.9, steps: 0.09}, "temperature")
    assert (clear.verdict, clear.unknown, clear.null_probability) == ("explained", False, 0.01)
    assert [cause.name for cause in clear.causes] == [heading] and clear.causes[0].probability == 0.9
    assert clear.terms[0].values == (*range(9), 2.0) and clear.terms[0].sigmas[9] == pytest.approx(0.2)
    assert clear.held_out == ("b",) and clear.warnings == ("w: c",)
    part = finding_of(monkeypatch, {"": 0.01, heading: 0.9, steps: 0.09}, "temperature", mixed=True)
    assert (part.verdict, part.unknown) == ("explained in part", True)
    stepped = finding_of(monkeypatch, {"": 0.01, heading: 0.2, steps: 0.79}, "heading")
    assert stepped.verdict == "explained" and stepped.terms == () and stepped.held_out == ()
    assert stepped.causes[0].alternatives == {heading: 0.2}
    doubted = finding_of(monkeypatch, {"": 0.3, heading: 0.49, steps: 0.21}, "temperature")
    assert (doubted.verdict, doubted.causes, doubted.unknown) == ("unknown", (), True)
    none = finding_of(monkeypatch, {"": 0.9, heading: 0.06, steps: 0.04}, "none")
    assert (none.verdict, none.unknown) == ("no gap", False)
    before = ChannelTerm(clear.terms[0].effect, (*[10.0] * 9, 5.0), (1.0,) * 10)
    model = SimpleNamespace(gain=np.arange(9.0).reshape(3, 3), sigma=np.ones((3, 3)), tau_s=7200.0)
    assert _term(model, before).values == (*np.arange(10.0, 19.0), 2.0)


@pytest.mark.parametrize("period_s", [1.0, 2.0])
def test_shares_by_phase_are_of_the_energy_that_bands_with_a_gap_have_in_each_phase(period_s):
    """White noise of sigma, so a row over sigma is white; energies by scipy's transform, band by band."""
    s, rng = replace(stimulus(1200), period_s=period_s), np.random.default_rng(4)
    slope = effect("bias_linear").variants()[0]
    course = slope.columns(s)[0]
    extra = 2.0 * course + np.where(np.arange(1200) >= 900, 3.0 * np.sin(np.arange(1200) / 40.0), 0.0)
    run = made_run("a", s, rng, extra)
    run.output_dph[100:130] = np.nan
    term = Term(slope, (2.0,), (0.1,))
    before, after = Model("b", (), WHITE), Model("a", (term,), WHITE)
    ratio = np.linspace(1.0, 1.7, len(BANDS))
    cells = [SimpleNamespace(profile="shock", band=band) for band in (1, 2, 3, 0)]
    on = np.array([True, True, True, False])
    floor = Floor(ratio, np.zeros(len(BANDS)), True)
    found = _shares_by_phase(before, after, [run], floor, cells, on)
    rows = np.stack([run.output_dph - model.predict(s) for model in (before, after)])
    filled = bridge(run.missing, s.period_s, WHITE).over(rows)
    sigma = 0.24 / math.sqrt(period_s)
    energy = np.zeros((2, 1200))
    expected = 0.0
    for band in (1, 2, 3):
        part = band_slices(1200, s.period_s)[band]
        only = np.zeros((2, 1200))
        only[:, 1 + part.start : 1 + part.stop] = dct(filled / sigma, norm="ortho")[:, 1:][:, part]
        energy += idct(only, norm="ortho") ** 2 / ratio[band]
        expected += (part.stop - part.start) / 1200
    assert list(found) == ["shock: room", "shock: shock"]
    for name, share in found.items():
        at = (run.phase == name.split(": ")[1]) & ~run.missing
        first, then = (float((own[at] - expected).sum()) for own in energy)
        assert share == pytest.approx(1.0 - then / first)
    none = _shares_by_phase(
        before, after, [run], Floor(ratio, np.zeros(len(BANDS)), True), cells, np.zeros(4, bool)
    )
    assert all(math.isnan(share) for share in none.values())


def test_disturbances_are_taken_out_one_kind_after_the_other_and_named_if_the_model_has_them_not(monkeypatch):
    one = next(own for own in catalogue().values() if type(own).__name__ == "Disturbance")
    seen = []

    def finds(name, less):
        def find(records):
            seen.append((name, [float(record.output_dph[0]) for record in records]))
            if less is None:
                return None
            outputs = tuple(record.output_dph - less for record in records)
            count = len(one.parameters)
            return Finding((1.0,) * count, (0.1,) * count, f"of {name}", outputs)

        return replace(one, name=name, meaning=name.upper(), find=find)

    kinds = [finds("hum", 1.0), finds("none", None), finds("known", 10.0), finds("steps", 100.0)]
    monkeypatch.setattr(
        _disturbed, "catalogue", lambda: {"shupe": effect("shupe"), **{k.name: k for k in kinds}}
    )
    run = made_run("a", stimulus(20), np.random.default_rng(1))
    run.output_dph[0] = 1000.0
    count = len(one.parameters)
    known = DisturbanceTerm(replace(one, name="known"), (1.0,) * count, (0.1,) * count)
    found = _disturbed.without_disturbances([run], Model("m", (), WHITE, disturbances=(known,)))
    assert seen == [("hum", [1000.0]), ("none", [999.0]), ("known", [999.0]), ("steps", [989.0])]
    assert found.runs[0].output_dph[0] == 889.0 and run.output_dph[0] == 1000.0
    assert [term.name for term in found.terms] == ["hum", "steps"]
    assert found.sentences == {"hum": "HUM of hum", "steps": "STEPS of steps"}
    assert set(found.probabilities) == {"hum", "steps"} and min(found.probabilities.values()) > 0.9


def test_a_channel_without_runs_or_what_its_model_needs_is_refused():
    signal = ChannelSignal("chamber_air")
    assert signal.refused([], Model("m", (), WHITE)) == "not in these runs"
    needed = sorted(
        each.name for each in catalogue().values()
        if isinstance(each, ChannelEffect) and each.channel == "chamber_air" and each.needed
    )  # fmt: skip
    said = signal.refused(["run"], Model("m", (), WHITE))
    assert said == (f"the model has no {', '.join(needed)}: nothing to compare with" if needed else "")
    terms = tuple(
        ChannelTerm(catalogue()[name], tuple(sum(p.bounds(1.0)) / 2 for p in catalogue()[name].parameters),
                    (1.0,) * len(catalogue()[name].parameters))
        for name in needed
    )  # fmt: skip
    assert signal.refused(["run"], Model("m", (), WHITE, channel_terms=terms)) == ""


def test_no_effect_of_a_channel_is_searched_where_nothing_is_clear_or_all_is_tolerated(monkeypatch):
    asked = []

    def search(*given):
        asked.append(given)
        return "fits", "best"

    monkeypatch.setattr("bench.analysis.gap._channels.search_effects", search)
    clear, vague = SimpleNamespace(clear=True), SimpleNamespace(clear=False)

    def ready(rms, *places):
        parts = {"cells": "c", "effects": "e", "terms": "t", "weight": "w"}
        return SimpleNamespace(rms=rms, accuracy=1.0, least=1.0, places=places, nominal="own", **parts)

    signal = ChannelSignal("table_rate")
    assert (
        signal.which(ready(1.0, clear)) == signal.which(ready(9.0, vague)) == (["own"], "own") and not asked
    )
    assert signal.which(ready(1.1, vague, clear)) == ("fits", "best")
    assert asked == [("c", "e", "t", "w", "own", 1.0)]


def test_what_columns_do_beside_the_nominal_ones_is_their_least_squares_with_priors():
    """Rows of numpy: the columns' sum, fitted by the nominal ones with a row for each prior."""
    rng = np.random.default_rng(7)
    rows, sigmas = rng.normal(size=(40, 5)), np.array([0.3, 4.0])
    gram = np.zeros((6, 6))
    gram[1:, 1:] = rows.T @ rows
    fitted = Solution(np.array([1, 2, 4, 5]), np.array([9.0, 9.0, 1.5, -2.0]), np.zeros((4, 4)))
    found = beside_nominal(gram, sigmas, fitted, [4, 5])
    target = np.append(rows[:, 3:] @ [1.5, -2.0], [0.0, 0.0])
    design = np.vstack((rows[:, :2], np.diag(1.0 / sigmas)))
    taken = np.linalg.lstsq(design, target, rcond=None)[0]
    assert found.indices.tolist() == [1, 2, 4, 5]
    assert found.values == pytest.approx([*-taken, 1.5, -2.0])


def test_a_run_of_which_too_much_is_missing_is_told_with_the_most_that_may_be():
    run = made_run("a", stimulus(1000), np.random.default_rng(1))

    def lacking(count):
        return replace(run, output_dph=np.where(np.arange(1000) < count, np.nan, run.output_dph))

    check_runs([lacking(600)])
    with pytest.raises(ConfigurationError, match="too much of the output is missing") as refused:
        check_runs([lacking(700)])
    assert (refused.value.found, refused.value.expected) == ("70 %", "at most 60 %; gaps are bridged")
