"""A whole study on made runs: what is fitted, what chooses, what judges, and which folders may take part."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.export import NETWORK_FILE, export_study
from bench.analysis.thermal import _study
from bench.analysis.thermal._anchor import anchor_runs
from bench.analysis.thermal._batch_study import study_batch
from bench.analysis.thermal._features import prepare
from bench.analysis.thermal._stream import FEATURES
from bench.analysis.thermal._study import load_runs, run_study, study_folders
from bench.analysis.thermal._types import ThermalRun
from drivers.base.errors import ConfigurationError, RecordError

NAMES = ("poly3", "multilinear")
N = 3600
NOISE_DPH = 0.02


def made(name: str, low_c: float, *, room_c: float = 25.0, level_dph: float = 3.0) -> ThermalRun:
    """An hour with one fall and one rise of temperature; the bias goes with it and with its rate."""
    time_s = np.arange(1.0, N + 1.0)
    inside = np.interp(time_s, [1000.0, 1800.0, 2400.0, 3200.0], [room_c, low_c, low_c, room_c])
    case = np.interp(time_s, [940.0, 1740.0, 2340.0, 3140.0], [room_c, low_c, low_c, room_c])
    bias = level_dph + 0.05 * (inside - 25.0) + 20.0 * np.gradient(inside)
    bias += np.random.default_rng(len(name) + ord(name[-1])).normal(0.0, NOISE_DPH, N)
    return ThermalRun(name, "u", time_s, inside, case, bias, None, (200.0, 900.0), f"sum of {name}",
                      true_bias_dph=level_dph + 0.05 * (inside - 25.0) + 20.0 * np.gradient(inside))  # fmt: skip


A, B, C, D = (made(name, low) for name, low in (("a", -20.0), ("b", -15.0), ("c", -10.0), ("d", -40.0)))


def left_of(run: ThermalRun, drift: np.ndarray) -> np.ndarray:
    """What a prediction that is held for ten seconds leaves of the bias from the reference on, 100 s means."""
    assert run.bias_dph is not None
    left = (run.bias_dph - np.repeat(drift, 10))[run.time_s >= 200.0]
    return np.asarray(left[: len(left) // 100 * 100].reshape(-1, 100).mean(axis=1))


def test_of_two_runs_the_validation_run_chooses_and_judges_where_no_other_does() -> None:
    study = run_study([A], [B], (), NAMES)
    assert study.chosen == "multilinear" and set(study.models) == set(study.scores) == set(NAMES)
    assert [run.run_id for run in study.tests] == ["b"] and study.judged_on_chosen
    assert [score.left_out for score in study.selection] == [0, 0]
    assert study.selection[0].score < 0.1 < study.selection[1].score
    made_of = study.compensation
    assert made_of.width is None and made_of.model is study.models["multilinear"]
    assert [run.run_id for run in made_of.training_runs] == ["a"]
    assert [run.run_id for run in made_of.validation_runs] == ["b"]
    assert made_of.scores == study.selection
    (row,) = study.scores["multilinear"]
    after = np.std(left_of(B, study.models["multilinear"].predict(prepare(B)).bias_dph), ddof=1)
    before = np.std(left_of(B, np.zeros(N // 10)), ddof=1)
    assert (row.run_id, row.stability_dph) == ("b", pytest.approx(after))
    assert row.improvement_pct == pytest.approx(100.0 * (1.0 - after / before))
    assert study.shown() == {
        "unit": "u", "fitted on": 1, "chosen on": 1, "judged on": 1, "chosen": "multilinear",
        "1 sigma of 100 s, deg/h": [row.stability_dph], "less by, %": [row.improvement_pct],
    }  # fmt: skip


def test_three_runs_are_left_out_in_turn_and_the_model_taken_learns_from_all_of_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = []

    def choose(models, scores, train, validation, **options):  # type: ignore[no-untyped-def]
        asked.append(([run.run_id for run in train], [run.run_id for run in validation]))
        return inner(models, scores, train, validation, **options)

    inner = _study.choose
    monkeypatch.setattr(_study, "choose", choose)
    study = run_study([A, B], [C], [D, replace(C, run_id="again", checksum="")], NAMES)
    assert asked == [(["a", "b"], ["c"])]
    assert study.chosen == "multilinear" and not study.judged_on_chosen
    assert study.selection[0].left_out == 3
    assert study.compensation.model is study.models[study.chosen]
    assert [run.run_id for run in study.compensation.training_runs] == ["a", "b", "c"]
    assert study.compensation.width is not None and study.compensation.width.runs == 3
    assert [row.run_id for row in study.scores["poly3"]] == ["d", "again"]
    # the model was not fitted on the two training runs alone: then c's own warmth were out of its range
    features = [prepare(run) for run in (A, B, C)]
    for name in FEATURES:
        rows = np.concatenate([getattr(run, name)[run.weight > 0] for run in features])
        assert study.compensation.limits.inputs[name] == (rows.min(), rows.max())
    # of the deeper run the rows beyond -20 degC are judged apart: each step of ten seconds as a whole
    deep, part = prepare(D), study.scores["multilinear"][0].apart
    inputs = study.compensation.limits.inputs
    beyond = np.zeros(N // 10, dtype=bool)
    for name in FEATURES:
        beyond |= (getattr(deep, name) < inputs[name][0]) | (getattr(deep, name) > inputs[name][1])
    used = np.repeat(beyond, 10)[D.time_s >= 200.0]
    assert part is not None and (part.outside, part.count) == (int(used.sum()), N - 199)
    assert 500 < part.outside < 2500


def test_all_runs_are_brought_to_one_reference_before_they_are_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Runs from rooms of 25, 33 and 21 degC: what is chosen by and what is learnt have one zero."""
    taken = []

    def choose(models, scores, train, validation, **options):  # type: ignore[no-untyped-def]
        taken.extend([*train, *validation])

    monkeypatch.setattr(_study, "choose", choose)
    warm, cool = made("w", -20.0, room_c=33.0), made("k", -15.0, room_c=21.0)
    study = run_study([A, warm], [cool], (), NAMES)
    expected = anchor_runs([prepare(run) for run in (A, warm, cool)])
    assert [run.run_id for run in taken] == ["a", "w", "k"]
    for own, other in zip(taken, expected, strict=True):
        assert own.bias_dph == pytest.approx(other.bias_dph)
    # nothing was chosen by leaving runs out: what the limits are of are the training runs, brought together
    bias = np.concatenate([run.bias_dph[run.weight > 0] for run in anchor_runs([prepare(A), prepare(warm)])])
    margin = 0.25 * np.ptp(bias)
    assert study.compensation.limits.bias_dph == pytest.approx((bias.min() - margin, bias.max() + margin))
    assert study.compensation.reference_temp_c == pytest.approx(29.0)
    assert study.compensation.limits.trained_from_s == 201.0


def test_what_cannot_be_studied_is_refused_before_anything_is_fitted() -> None:
    with pytest.raises(ConfigurationError, match="no validation run") as refused:
        run_study([A, B, C], [], [D], NAMES)
    assert refused.value.remedy == "name one with --validate"
    with pytest.raises(ConfigurationError, match="one fit is of one unit"):
        run_study([], [B], (), NAMES)
    for validation, tests in ((replace(B, unit_id="v"), D), (B, replace(D, unit_id="v"))):
        with pytest.raises(ConfigurationError, match="one fit is of one unit") as refused:
            run_study([A], [validation], [tests], NAMES)
        assert refused.value.found == "u, v"
    for validation, tests in ((replace(A, run_id="x"), D), (B, replace(A, run_id="x"))):
        with pytest.raises(ConfigurationError, match="used for fitting and for judging") as refused:
            run_study([A], [validation], [tests], NAMES)
        assert refused.value.found == "x"


def test_only_a_run_to_judge_on_may_have_been_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []

    def manifest(folder: Path) -> SimpleNamespace:
        outcome = "aborted" if folder.name == "stopped" else "completed"
        return SimpleNamespace(place=folder, manifest=SimpleNamespace(outcome=outcome, reason="by hand"))

    def loaded(folder: Path, gyro: str | None) -> list[ThermalRun]:
        opened.append(f"{folder.name} {gyro}")
        return [replace(D, run_id=f"{folder.name} {number}") for number in (1, 2)]

    monkeypatch.setattr(_study, "Run", SimpleNamespace(open=manifest))
    monkeypatch.setattr(_study, "load_thermal_runs", loaded)
    whole, stopped, other = Path("whole"), Path("stopped"), Path("other")
    assert [run.run_id for run in load_runs([other, whole], "g")] == [
        "other 1",
        "other 2",
        "whole 1",
        "whole 2",
    ]
    assert opened == ["other g", "whole g"]
    for folders in ([stopped], [whole, stopped]):
        with pytest.raises(ConfigurationError, match="not completed cannot be fitted") as refused:
            load_runs(folders)
        assert refused.value.found == "aborted: by hand"
    assert [run.run_id for run in load_runs([stopped], allow_invalid=True)] == ["stopped 1", "stopped 2"]
    taken: list[object] = []
    monkeypatch.setattr(_study, "run_study", lambda *runs, **fan: taken.append(runs))
    opened.clear()
    study_folders([whole], [other], [stopped], "h", NAMES)
    assert opened == ["whole h", "other h", "stopped h"]
    ((train, validation, tests, names),) = taken  # type: ignore[misc]
    assert [run.run_id for run in (*train, *validation, *tests)] == [
        f"{name} {number}" for name in ("whole", "other", "stopped") for number in (1, 2)
    ]
    assert names == NAMES
    for train, validation in (([stopped], [whole]), ([whole], [stopped])):
        with pytest.raises(ConfigurationError, match="not completed cannot be fitted"):
            study_folders(train, validation)


@pytest.mark.parametrize("study", [study_folders, study_batch])
@pytest.mark.parametrize(
    ("wrong", "says"),
    [("polly3", "no thermal model named 'polly3'"), ("lstm:inputs=t_in/t_case", "cannot have: 't_case'")],
)
def test_a_model_that_nobody_has_is_refused_before_a_run_is_read(study, wrong: str, says: str) -> None:
    nowhere = Path("no such folder")
    others = ([nowhere],) if study is study_folders else ()
    with pytest.raises(ConfigurationError, match=says):
        study([nowhere], *others, names=[*NAMES, wrong])
    with pytest.raises(RecordError):
        study([nowhere], *others, names=NAMES)


def test_the_best_network_has_a_compensation_of_its_own_and_its_file(tmp_path: Path) -> None:
    """Alone it is chosen, with intervals from runs left out; behind another model it is not left-one-out."""
    small, smaller = "lstm:hidden=2+epochs=2", "lstm:hidden=1+epochs=1+inputs=t_out"
    alone = run_study([A, B], [C], (), [small])
    assert alone.network is not None and alone.network.width is not None
    assert alone.network.width.coefficients == pytest.approx(alone.compensation.width.coefficients)
    behind = run_study([A, B], [C], (), ["multilinear", smaller, small])
    best = next(score.name for score in behind.selection if score.name in (small, smaller))
    assert behind.network is not None and behind.network.model.name == best
    assert behind.chosen == "multilinear" and behind.network.width is None
    export_study(behind, tmp_path)
    assert best.encode() in (tmp_path / NETWORK_FILE).read_bytes()
    none = run_study([A, B], [C], (), NAMES)
    (tmp_path / "none").mkdir()
    export_study(none, tmp_path / "none")
    assert none.network is None and not (tmp_path / "none" / NETWORK_FILE).exists()
