"""Run against rehearsals: the table by phase; the suggested procedure run and taken into the diagnosis."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import Model, Suggestion, diagnose, log_gaps, model_text, suggest
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._designs import usual_designs
from bench.analysis.gap._recordings import load_channels
from bench.control.procedure import find_procedure
from bench.lab.emulated import load_plant
from bench.present.cli._console import Terminal
from bench.present.cli.gap import _diagnose as command
from bench.present.cli.gap._diagnose import make_run
from bench.present.cli.gap._rehearse import rehearse
from bench.present.report import log_gaps_page, render_page
from bench.record.benchfile import load_bench_file
from drivers.base.errors import ConfigurationError
from tests.analysis.gap.conftest import made_run, stimulus
from tests.analysis.gap.test_gap_commands import recordings

PLANT = """
clock_error_ppm = { fog_1 = 150.0 }
[[fault]]
port = "fog_1"
kind = "delay"
at_s = [120.0, 180.0]
duration_s = 0.4
"""
BENCH = Path(__file__).parents[3] / "examples" / "demo.toml"


def _logs(amplitude_dph: float) -> list[GapRun]:
    """A run with an extra bias in its shock, and rehearsals without, with 90 % of it, and the same again."""
    rng = np.random.default_rng(6)
    s = stimulus(4000)
    # as much above zero as below: nothing of it is in the mean, which is taken out
    extra = np.where(
        np.arange(4000) < 1000, 0.0, amplitude_dph * np.where(np.arange(4000) % 400 < 200, 1, -1)
    )
    return [
        made_run(name, s, rng, part * extra)
        for name, part in (("run", 1.0), ("nominal", 0.0), ("closed", 0.9), ("again", 0.9))
    ]


def test_the_table_has_the_size_of_what_was_put_in() -> None:
    run, *rehearsals = _logs(0.5)
    gaps = log_gaps([run], *([each] for each in rehearsals))
    by_phase = {each.part: each for each in gaps.rate}
    # white noise of 0.24 deg/h in 1 s: 100 s means of a difference of two have 0.24 sqrt(2) / 10
    assert by_phase["all"].rms_floor == pytest.approx(0.24 * 2**0.5 / 10.0, rel=0.4)
    assert by_phase["shock"].rms_nominal == pytest.approx(0.5, rel=0.03)
    assert by_phase["shock"].rms_closed == pytest.approx(0.05, abs=0.025)
    assert by_phase["all"].share == pytest.approx(0.99, abs=0.01)
    assert len(gaps.curves[0].time_s) == 40
    page = render_page(log_gaps_page("run", "unit 1", ("a.toml", "b.toml"), gaps, "2026-01-01T00:00:00Z"))
    assert "of the reducible gap is gone" in page


def test_rehearsals_of_another_course_are_refused() -> None:
    run, nominal, closed, again = _logs(0.5)
    other = GapRun(**{**vars(nominal), "phase": np.full(4000, "room")})
    with pytest.raises(ConfigurationError, match="other phases"):
        log_gaps([run], [other], [closed], [again])


def test_every_suggestion_is_a_procedure_that_its_settings_suit() -> None:
    for plan in usual_designs(39.1):
        parameters = find_procedure(plan.procedure).parse(dict(plan.settings))
        assert dict(plan.settings).items() <= parameters.model_dump().items()
        assert plan.hours > len(next(iter(plan.stimuli.values()))) / 3600.0 / 2.0


def test_a_suggestion_is_run_on_the_emulated_bench_with_its_fast_clock_and_late_frames(
    tmp_path: Path, nominal: Model
) -> None:
    plant = tmp_path / "plant.toml"
    plant.write_text(PLANT, encoding="utf-8")
    suggestion = Suggestion(
        "constant-rotation", "", 0.1, 5.0, "", {"rate_dps": 20.0, "turns": 10.0, "rest_s": 100.0}
    )
    folder = make_run(
        Terminal(as_json=True),
        suggestion.procedure,
        suggestion.settings,
        load_bench_file(BENCH),
        tmp_path / "runs",
        plant=load_plant(plant, 4),
        yes=True,
    )
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["parameters"]["turns"] == 10.0
    assert manifest["emulated"]["seed"] == 4
    series, _ = load_channels(folder)
    found = diagnose(series, nominal).channels
    stamps = next(each for each in found if each.signal == "time_stamps")
    (cause,) = stamps.causes
    assert cause.name == "sample_clock_skew"
    assert cause.term.values[0] == pytest.approx(150.0, abs=2.0)
    # two stalls of 0.4 s at 10 frames a second: 3 or 4 frames of each come late
    assert 3 <= stamps.stochastic["late_frames"] * 10.0 * manifest["duration_s"] <= 12
    closed = tmp_path / "closed.toml"
    fitted = Model(**{**vars(nominal), "fitted_on": {folder.name: "sum"}})
    closed.write_text(model_text(fitted), encoding="utf-8")
    with pytest.raises(ConfigurationError, match="cannot judge it"):
        rehearse(folder, closed, closed, tmp_path, as_json=True)


def test_the_suggested_run_is_taken_into_the_diagnosis(
    tmp_path: Path, nominal: Model, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    first = recordings(tmp_path / "first", 0.5, "ab", 8)
    second = recordings(tmp_path / "second", 0.5, "c", 9)
    asked: list[str] = []

    def run(console: Terminal, procedure: str, *_: object, **__: object) -> Path:
        asked.append(procedure)
        return second

    monkeypatch.setattr(command, "make_run", run)
    model = tmp_path / "nominal.toml"
    model.write_text(model_text(nominal), encoding="utf-8")
    command.diagnose(
        [first],
        model,
        as_json=True,
        run=True,
        bench=BENCH,
        emulated=True,
        seed=1,
        runs_folder=tmp_path,
        yes=True,
    )
    facts = json.loads(capsys.readouterr().out)
    assert len(asked) == 1
    assert set(facts["runs"]) == {"a", "b", "c"}


def test_expected_odds_do_not_promise_what_a_formulas_tolerance_forbids(nominal: Model) -> None:
    rng = np.random.default_rng(12)
    s = stimulus(4000)
    runs = [made_run(name, s, rng, 5.0 * ((s.t_in_c - 25.0) / 50.0) ** 3) for name in "ab"]
    found = diagnose(runs, nominal)
    for each in suggest(found):
        # of 11 bands with 14,000 samples, slow effects fill tens of coefficients: thousands, not millions
        assert each.log_odds < 1e5
