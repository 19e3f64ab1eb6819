"""A model common to a batch: closed forms of the prior and of a unit's corrections; made units of known gains."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from bench.analysis.export import export_compensation
from bench.analysis.thermal import Compensation, FeatureRun, ThermalRun, _batch, _batch_study, prepare
from bench.analysis.thermal._batch import INFLATIONS, Moments, Prior, fit_batch, fit_prior, leave_units_out
from bench.analysis.thermal._batch_study import run_batch
from bench.analysis.thermal._evaluate import evaluate
from bench.analysis.thermal._regression import anchored_errors
from bench.present.cli._app import app
from bench.present.report import batch_page, batch_sentence, render_page
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

N = 3600
GAINS = {"A": 0.6, "B": 0.9, "C": 1.2, "D": 1.5}


def drift(inside: Array, gain: float) -> Array:
    """A static part that units share, and a part with the rate that they do not."""
    return 0.05 * (inside - 25.0) + gain * 20.0 * np.gradient(inside)


def made(unit: str, number: int, gain: float, *, room_c: float = 25.0, kind: str = "bias") -> ThermalRun:
    """An hour with a fall and a rise of temperature; run `number` of a unit falls less than the one before."""
    time_s, low_c = np.arange(1.0, N + 1.0), -30.0 + 6.0 * number
    shape, when = [room_c, low_c, low_c, room_c], np.array([1000.0, 1800.0, 2400.0, 3200.0])
    inside, case = np.interp(time_s, when, shape), np.interp(time_s, when - 60.0, shape)
    rng = np.random.default_rng((number, *unit.encode()))
    values = 3.0 + drift(inside, gain) + rng.normal(0.0, 0.02, N)
    return ThermalRun(
        f"{unit}{number}", unit, time_s, inside, case,
        values if kind == "bias" else None, 100.0 * values if kind == "sf" else None, (200.0, 900.0),
        f"sum {unit}{number}{kind}",
    )  # fmt: skip


def batch(runs_each: int = 2) -> list[ThermalRun]:
    return [made(unit, number, gain) for unit, gain in GAINS.items() for number in range(runs_each)]


def units_of(runs: list[ThermalRun]) -> dict[str, list[FeatureRun]]:
    return {unit: [prepare(run) for run in runs if run.unit_id == unit] for unit in GAINS}


def rows(rng: np.random.Generator, count: int, coefficients: Array, noise: float) -> tuple[Array, Array]:
    terms = rng.normal(size=(count, 3)) * [1.0, 2.0, 4.0]
    terms -= terms.mean(axis=0)
    values = terms @ coefficients + noise * rng.normal(size=count)
    return terms, values - values.mean()


def moments(terms: Array, values: Array) -> Moments:
    return Moments(terms.T @ terms, terms.T @ values, float(values @ values), float(len(values)))


def test_a_prior_finds_mean_spread_and_noise_of_made_units() -> None:
    """The terms have sizes of their own, so that the components are the terms."""
    rng = np.random.default_rng(3)
    mean, sigma = np.array([2.0, -1.0, 0.5]), np.array([0.8, 0.0, 0.3])
    units = [moments(*rows(rng, 60, mean + sigma * rng.normal(size=3), 0.4)) for _ in range(200)]
    prior = fit_prior(units)
    assert prior.coefficients(None) == pytest.approx(mean, abs=0.1)
    covariance = prior.rotation @ np.diag(prior.variance) @ prior.rotation.T
    assert np.diag(covariance) == pytest.approx(sigma**2, abs=0.1)
    assert prior.noise == pytest.approx(0.16, rel=0.05)


def test_a_spread_that_rows_hardly_show_is_not_taken_for_less() -> None:
    """Eight rows of much noise a unit: their expectations alone vary by half of what units do."""
    rng = np.random.default_rng(8)
    units = [
        moments(*rows(rng, 8, np.array([1.0, 1.0, 1.0]) + 0.6 * rng.normal(size=3), 1.5)) for _ in range(500)
    ]
    prior = fit_prior(units)
    sizes = np.diag(prior.rotation @ np.diag(prior.variance) @ prior.rotation.T)
    assert sizes == pytest.approx([0.36, 0.36, 0.36], abs=0.12)
    assert prior.noise == pytest.approx(2.25 * 7 / 8, rel=0.1)


def test_rows_within_the_window_of_the_means_count_for_one() -> None:
    fit = fit_batch(units_of(batch()), "multilinear")
    run = prepare(made("A", 0, 0.6))
    found = fit.moments([run, run], "bias_dph")
    assert found is not None and found.rows == pytest.approx(2 * np.count_nonzero(run.weight) / 10.0)
    assert found.square == pytest.approx(
        2 * 0.1 * np.var(run.bias_dph[run.weight > 0]) * np.count_nonzero(run.weight)
    )
    assert fit.moments([run], "sf_error_ppm") is None


def test_a_unit_left_out_is_predicted_by_the_others_and_by_another_run_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fits, owns = [], []
    fit, model = _batch.fit_batch, _batch.BatchFit.model

    def fitted(units, *rest):  # type: ignore[no-untyped-def]
        fits.append(sorted(units))
        return fit(units, *rest)

    def modelled(self, own):  # type: ignore[no-untyped-def]
        owns.append(tuple(run.run_id for run in own))
        return model(self, own)

    units = units_of(batch(3))
    whole = fit_batch(units, "poly3")
    monkeypatch.setattr(_batch, "fit_batch", fitted)
    monkeypatch.setattr(_batch.BatchFit, "model", modelled)
    out = leave_units_out(units, "poly3", whole)
    assert fits == [sorted(set(GAINS) - {unit}) for unit in GAINS]
    each = len(INFLATIONS)
    assert owns[: 1 + 3 * each] == [(), *[("A1",)] * each, *[("A2",)] * each, *[("A0",)] * each]
    assert [run.run_id for run, _ in out.with_one["bias_dph"][1.0]][:3] == ["A0", "A1", "A2"]


def test_a_units_corrections_are_the_best_linear_prediction_of_all_its_rows() -> None:
    """Against the form with the covariance of the rows: delta = V Z' (Z V Z' + noise I)^-1 (y - Z mean)."""
    rng = np.random.default_rng(4)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0] * [1.0, 2.0, 0.5]
    prior = Prior(rotation, np.array([1.0, -2.0, 0.3]), np.array([0.5, 0.0, 0.1]), 0.2, 5.0)
    terms, values = rows(rng, 40, np.array([0.3, 1.0, -2.0]), 0.5)
    turned, spread = terms @ rotation, np.diag(prior.variance)
    of_rows = turned @ spread @ turned.T + 0.2 * 5.0 * np.eye(40)
    delta = spread @ turned.T @ np.linalg.solve(of_rows, values - turned @ prior.mean)
    assert prior.coefficients(moments(terms, values)) == pytest.approx(rotation @ (prior.mean + delta))
    own = np.linalg.inv(turned.T @ turned / 1.0 + np.diag([1 / 0.5, 1e12, 1 / 0.1]))
    decided = (1.0 - own[0, 0] / 0.5) + (1.0 - own[2, 2] / 0.1)
    assert prior.determined(moments(terms, values)) == pytest.approx(decided)
    none = replace(prior, inflation=np.inf)
    assert none.coefficients(moments(terms, values)) == pytest.approx(rotation @ prior.mean)
    assert none.determined(moments(terms, values)) == prior.determined(None) == 0.0


def left(run: ThermalRun, study_model: object) -> float:
    features = prepare(run)
    return float(
        np.sqrt(np.mean(anchored_errors([study_model.predict(features)], [features], "bias_dph") ** 2))
    )  # type: ignore[attr-defined]


def test_one_run_gives_a_new_unit_its_gain_and_none_gives_it_the_batchs_mean() -> None:
    study = run_batch(batch(), [made("E", 3, 0.75), made("B", 3, 0.9)], ["multilinear"])
    test = made("E", 3, 0.75)
    assert left(test, study.common.model) > 5.0 * left(test, study.fit.model([prepare(made("E", 0, 0.75))]))
    # what the mean of the batch's gains leaves of a unit whose own is 0.75
    mean = np.mean(list(GAINS.values()))
    expected = replace(test, bias_dph=drift(test.gyro_temp_c, 0.75) - drift(test.gyro_temp_c, float(mean)))
    raw = prepare(expected)
    assert left(test, study.common.model) == pytest.approx(
        np.sqrt(np.mean(raw.bias_dph[raw.weight > 0] ** 2)), rel=0.1
    )
    scores = study.scores["multilinear"]["bias_dph"]
    assert scores.with_one < 0.3 * scores.without
    for run, score, own in zip(
        study.tests, study.judged, (study.common, study.compensations["B"]), strict=True
    ):
        assert score.stability_dph == evaluate(own.model.predict(prepare(run)), run).stability_dph
    assert left(made("B", 3, 0.9), study.compensations["B"].model) < 0.5 * left(
        made("B", 3, 0.9), study.common.model
    )
    assert 0.9 < study.determined["A"]["bias_dph"] < 5.0


def test_every_unit_gets_a_file_like_any_other(tmp_path: Path) -> None:
    study = run_batch(batch(), (), ["multilinear"])
    assert set(study.compensations) == set(GAINS) and study.common.unit_id == ""
    path = export_compensation(study.compensations["C"], tmp_path)
    again = Compensation.load(path)
    assert again.unit_id == "C" and set(again.runs) == {run.run_id for run in batch()}
    with pytest.raises(ConfigurationError, match="another unit"):
        again.stream("A")
    test = made("C", 3, 1.2)
    stream, whole = again.stream("C"), again.drift(test)[0]
    rows = zip(test.time_s, test.gyro_temp_c, test.case_temp_c, strict=True)
    streamed = [stream.push(t, gyro, case, 0.0) for t, gyro, case in rows]
    assert [sample.bias_dph for sample in streamed] == pytest.approx(whole, abs=1e-9)
    assert all(math.isfinite(sample.bias_half_dph) for sample in streamed)
    assert "gyrocomp_step" in (tmp_path / "compensation.h").read_text()
    # a unit of another room counts from the batch's reference all the same
    assert study.common.stream("whoever") is not None


def test_the_interval_of_a_unit_with_runs_is_narrower_and_holds_a_further_unit() -> None:
    study = run_batch(batch(), (), ["multilinear"])
    features = prepare(made("E", 3, 0.75))
    wide, narrow = study.common.half_widths(features), study.compensations["A"].half_widths(features)
    assert wide is not None and narrow is not None and wide[:, 0].mean() > 2.0 * narrow[:, 0].mean()
    error = anchored_errors([study.common.model.predict(features)], [features], "bias_dph")
    assert np.mean(np.abs(error) < wide[features.weight > 0, 0]) > 0.9


def test_the_drift_is_zero_at_the_batchs_reference_whatever_room_a_unit_ran_in() -> None:
    warm = [made("W", number, 1.0, room_c=33.0) for number in range(2)]
    fit = fit_batch(units_of(batch()), "multilinear")
    nearer = made("W", 5, 1.0, room_c=26.0)
    for own, zero in (([], made("A", 0, 0.6)), (warm, warm[0]), ([*warm, nearer], nearer)):
        model = fit.model([prepare(run) for run in own])
        at = prepare(zero)
        window = (at.time_s >= 200.0) & (at.time_s < 900.0)
        assert model.predict(at).bias_dph[window].mean() == pytest.approx(0.0, abs=1e-9)


def test_units_that_do_not_differ_need_no_correction() -> None:
    """All have one gain: own runs bring nothing, and the variance between units is far below the drift's."""
    units = {unit: [prepare(made(unit, number, 1.0)) for number in range(2)] for unit in GAINS}
    fit = fit_batch(units, "multilinear")
    prior, left_units = fit.priors["bias_dph"], leave_units_out(units, "multilinear", fit)
    assert prior.variance.sum() < 1e-3 * (prior.mean**2).sum()
    none = left_units.score("bias_dph")
    assert left_units.score("bias_dph", np.inf) == pytest.approx(none)
    assert left_units.score("bias_dph", left_units.inflation("bias_dph")) == pytest.approx(none, rel=0.1)
    assert left_units.score("bias_dph", left_units.inflation("bias_dph")) == min(
        left_units.score("bias_dph", value) for value in INFLATIONS
    )


def test_both_targets_have_their_own_prior() -> None:
    groups = [
        made(unit, number, gain + 0.5, kind="sf") for unit, gain in GAINS.items() for number in range(2)
    ]
    study = run_batch([*batch(), *groups], (), ["poly3", "multilinear"])
    assert list(study.scores) == ["multilinear", "poly3"]
    model = study.fit.model([prepare(made("E", 0, 1.4, kind="sf"))])
    test = prepare(made("E", 3, 1.4, kind="sf"))
    error = anchored_errors([model.predict(test)], [test], "sf_error_ppm")
    assert np.sqrt(np.mean(error**2)) < 0.05 * np.ptp(test.sf_error_ppm)
    assert study.fit.determined([test])["bias_dph"] == 0.0


def test_units_that_need_no_batch_are_told() -> None:
    """Three runs of one target; two of each are not."""
    third = [made("B", 2, GAINS["B"]), made("A", 0, 1.5, kind="sf"), made("A", 1, 1.5, kind="sf")]
    groups = [made(unit, number, 1.5, kind="sf") for unit in "CD" for number in range(2)]
    study = run_batch([*batch(), *third, *groups], (), ["poly3"])
    assert study.known_by_themselves == ("B",)
    assert run_batch(batch(), (), ["poly3"]).known_by_themselves == ()


@pytest.mark.parametrize(
    ("runs", "tests", "names", "said"),
    [
        (batch()[:4], [], None, "too few units with two bias runs.*A: 2, B: 2.*of 3 units"),
        (batch(1), [], None, "too few units.*A: 1"),
        (batch(), [], ["stepwise"], None),
        (batch(), [], ["lstm"], "'lstm' cannot be common to a batch.*grey_box"),
        (batch(), [], ["nobody"], "no thermal model named 'nobody'"),
        (batch(), [batch()[3]], ["poly3"], "used for fitting and for judging.*B1"),
    ],
)
def test_what_makes_no_batch_is_refused(
    runs: list[ThermalRun], tests: list[ThermalRun], names: list[str] | None, said: str | None
) -> None:
    if said is None:
        assert run_batch(runs, tests, names).chosen == "stepwise"
        return
    with pytest.raises(ConfigurationError, match=said):
        run_batch(runs, tests, names)


def test_the_command_writes_a_folder_for_every_unit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = {run.run_id: run for run in [*batch(), made("E", 3, 0.75)]}
    monkeypatch.setattr(
        _batch_study, "load_runs", lambda folders, gyro, **_: [known[folder.name] for folder in folders]
    )
    words = ["fit", "cold-shock", "--batch", *(run.run_id for run in batch()), "--test", "E3", "--json"]
    words += ["--models", "multilinear,poly3", "--out", str(tmp_path / "fit")]
    ended = CliRunner().invoke(app, words)
    assert ended.exit_code == 0, ended.output
    facts = json.loads(ended.stdout.splitlines()[-1])
    assert facts["chosen"] == "multilinear" and set(facts["units"]) == set(GAINS)
    assert (
        facts["scores"]["poly3"]["bias_dph"]["without"]
        > facts["scores"]["multilinear"]["bias_dph"]["without"]
    )
    assert facts["judged"][0]["run_id"] == "E3" and facts["units"]["A"]["runs"] == ["A0", "A1"]
    names = {
        str(path.relative_to(tmp_path / "fit")) for path in (tmp_path / "fit").rglob("*.*") if path.is_file()
    }
    assert names == {"report.html", "compensation.gyrocomp", "compensation.h"} | {
        f"{unit}/compensation.{kind}" for unit in GAINS for kind in ("gyrocomp", "h")
    }
    refused = CliRunner().invoke(app, [*words, "--validate", "E3"])
    assert refused.exit_code != 0


def test_the_page_says_what_was_chosen_and_for_whom() -> None:
    study = run_batch(batch(), [made("E", 3, 0.75)], ["multilinear", "poly3"])
    page = render_page(batch_page(study, created_utc="2026-11-28T00:00:00Z"))
    for text in ("Cold shock of a batch of units", "multilinear", "E3", "common", "numbers decided"):
        assert text in page
    assert "of the unit's own does not help" not in batch_sentence(study, "bias_dph")
