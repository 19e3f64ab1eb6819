"""The models on a campaign of simulated cold shocks, judged on profiles and noise they were not fitted to.

Figures are of this plant and count from the start of the reference window. The design notes' own plant gave
poly3 52.6, multilinear 66.2, stepwise 74.3, lag ridge 76.1, grey-box 78.3 and oracle 78.9 %; what must agree is
the distance of each model to the oracle.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bench.analysis.thermal import Scores, ThermalModel, prepare
from bench.analysis.thermal._anchor import anchor_runs
from bench.analysis.thermal._evaluate import evaluate
from bench.analysis.thermal._grey_box import GreyBoxModel
from bench.analysis.thermal._linear_models import (
    CubicModel,
    LaggedRidgeModel,
    MultilinearModel,
    StepwiseModel,
)

DISTANCE_TO_ORACLE_PCT = {
    "poly3": 26.3,
    "multilinear": 12.7,
    "stepwise": 4.6,
    "lag_ridge": 2.8,
    "grey_box": 0.6,
}
"""Of the notes' plant; measured here 27.6, 12.8, 6.1, 2.8, 0.6."""

Table = dict[str, dict[str, Scores]]


def fit_all(campaign: Any, models: list[ThermalModel], *, anchored: bool = True) -> Table:
    train = [prepare(run) for run in campaign.train]
    train = anchor_runs(train) if anchored else train
    validation = [prepare(run) for run in campaign.validation]
    for model in models:
        model.fit(train, validation)
    return {
        model.name: {run.run_id: evaluate(model.predict(prepare(run)), run) for run in campaign.tests}
        for model in models
    }


@pytest.fixture(scope="module")
def table(campaign: Any) -> Table:
    linear: list[ThermalModel] = [CubicModel(), MultilinearModel(), StepwiseModel(), LaggedRidgeModel()]
    return fit_all(campaign, [*linear, GreyBoxModel()])


def improvements(scores: dict[str, Scores], name: str = "improvement_pct") -> np.ndarray:
    return np.array([getattr(score, name) for score in scores.values() if getattr(score, name) is not None])


def test_check_14_each_model_stays_its_distance_below_the_oracle(table: Table) -> None:
    oracle = improvements(table["poly3"], "oracle_pct").mean()
    assert oracle == pytest.approx(82.0, abs=1.5)
    distance = {name: oracle - improvements(scores).mean() for name, scores in table.items()}
    assert distance == pytest.approx(DISTANCE_TO_ORACLE_PCT, abs=2.0)


def test_check_14_the_oracle_is_never_exceeded_by_more_than_one_percent(table: Table) -> None:
    for scores in table.values():
        assert (improvements(scores) - improvements(scores, "oracle_pct")).max() < 1.0


def test_order_of_the_models_on_the_true_drift(table: Table) -> None:
    errors = {name: improvements(scores, "true_rmse_dph").mean() for name, scores in table.items()}
    order = ["poly3", "multilinear", "stepwise", "lag_ridge", "grey_box"]
    assert sorted(errors, key=lambda name: -errors[name]) == order
    assert errors["grey_box"] < 0.010 < 0.050 < errors["poly3"]


def test_grey_box_holds_on_every_profile(table: Table) -> None:
    """Deeper, faster, slower, in a cool room or twice: never more than 3 % of improvement below the oracle."""
    scores = table["grey_box"]
    assert (improvements(scores, "oracle_pct") - improvements(scores)).max() < 3.0


def test_noise_floor_without_a_model_agrees_with_the_oracle(table: Table) -> None:
    scores = table["poly3"]
    floor, oracle = improvements(scores, "noise_floor_dph"), improvements(scores, "oracle_stability_dph")
    # 6 N for N = 0.004 deg/sqrt(h); the oracle also has the flicker in it.
    assert floor == pytest.approx(np.full(7, 0.024), rel=0.06)
    # About 120 blocks a run: 6.5 % of statistical error in the oracle, flicker adds to it.
    assert oracle == pytest.approx(floor, rel=0.15)


def test_check_15_anchoring_brings_the_scale_factor_of_all_profiles_below_one_and_a_half_ppm(
    campaign: Any, table: Table
) -> None:
    anchored = improvements(table["grey_box"], "sf_true_rms_ppm")
    apart = improvements(fit_all(campaign, [GreyBoxModel()], anchored=False)["grey_box"], "sf_true_rms_ppm")
    assert len(anchored) == 5
    assert anchored.max() < 1.5
    assert apart.min() > 2.5 and apart.max() > 6.0


def test_scale_factor_measurement_itself_is_within_a_ppm_of_the_truth(campaign: Any) -> None:
    """Three runs at +20, -20, 0 deg/s: 0.32 ppm rms in 100 s means, on 390 ppm peak to peak."""
    for run in campaign.tests:
        if run.sf_error_ppm is None:
            continue
        used = run.time_s >= run.reference[0]
        error = (run.sf_error_ppm - run.true_sf_error_ppm)[used]
        means = error[: len(error) // 100 * 100].reshape(-1, 100).mean(axis=1)
        assert np.std(means) == pytest.approx(0.32, abs=0.15)


def test_check_13_multilinear_on_one_bias_run(campaign: Any) -> None:
    runs = {run.run_id: run for run in campaign.train}
    model = MultilinearModel()
    model.fit([prepare(runs["train_2"])], [])
    nominal = next(run for run in campaign.tests if run.run_id == "nominal")
    scores = evaluate(model.predict(prepare(nominal)), nominal)
    assert scores.improvement_pct is not None and scores.oracle_pct is not None
    # The notes: 72.4 of 81.1.
    assert scores.oracle_pct == pytest.approx(81.1, abs=1.5)
    assert scores.improvement_pct == pytest.approx(72.4, abs=2.5)
