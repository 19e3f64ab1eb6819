"""Networks on the campaign of emulated cold shocks: trained on seven runs, judged on seven profiles unseen."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from bench.analysis.thermal import ThermalModel, prepare
from bench.analysis.thermal._anchor import anchor_runs
from bench.analysis.thermal._evaluate import evaluate
from bench.analysis.thermal._hybrid import HybridModel
from bench.analysis.thermal._linear_models import LaggedRidgeModel
from bench.analysis.thermal._lstm import LstmModel
from bench.analysis.thermal._lstm_weights import LstmSettings


def improvements(model: ThermalModel, campaign: Any) -> tuple[float, float]:
    """Fit on the campaign; return mean improvement over the bias tests, and the oracle's, in percent."""
    model.fit(
        anchor_runs([prepare(run) for run in campaign.train]), [prepare(run) for run in campaign.validation]
    )
    scores = [
        evaluate(model.predict(prepare(run)), run) for run in campaign.tests if run.bias_dph is not None
    ]
    reached = [s.improvement_pct for s in scores if s.improvement_pct is not None]
    oracle = [s.oracle_pct for s in scores if s.oracle_pct is not None]
    assert len(reached) == len(oracle) == 7
    return float(np.mean(reached)), float(np.mean(oracle))


def test_hybrid_beats_its_linear_part_and_not_the_oracle(campaign: Any) -> None:
    hybrid, oracle = improvements(HybridModel(), campaign)
    linear, _ = improvements(LaggedRidgeModel(), campaign)
    assert linear + 0.5 < hybrid <= oracle + 1.0
    assert hybrid > oracle - 3.0


def test_lstm_alone_learns_the_shock_and_falls_short_elsewhere(campaign: Any) -> None:
    """A fifth of the epochs of a real fit: enough to rank it, far quicker."""
    lstm, oracle = improvements(LstmModel(replace(LstmSettings(), epochs=60)), campaign)
    assert oracle - 25.0 < lstm < oracle - 2.0
