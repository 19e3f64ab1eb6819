"""Hybrids: a model that extrapolates, and one on what it leaves."""

from __future__ import annotations

from bench.analysis.thermal._grey_box import GreyBoxModel
from bench.analysis.thermal._linear_models import LaggedRidgeModel
from bench.analysis.thermal._lstm import LstmModel
from bench.analysis.thermal._lstm_weights import LstmSettings
from bench.analysis.thermal._sum import SumModel

RESIDUAL_SETTINGS = LstmSettings(hidden=16, epochs=120)


class HybridModel(SumModel[LaggedRidgeModel, LstmModel]):
    """The lagged ridge model, and a small LSTM on its residual."""

    name = "hybrid"
    KEYS = ("linear", "network")

    def __init__(self, settings: LstmSettings = RESIDUAL_SETTINGS) -> None:
        super().__init__(LaggedRidgeModel(), LstmModel(settings))


class GreyResidualModel(SumModel[GreyBoxModel, LaggedRidgeModel]):
    """The grey box, and a learned state space on its residual: twelve first-order states, linear in them and in
    their products with temperature, ridge penalty by the runs left out. Deterministic on every processor.
    """

    name = "grey_box_residual"
    KEYS = ("grey_box", "residual")

    def __init__(self, grey_box: GreyBoxModel | None = None) -> None:
        super().__init__(grey_box or GreyBoxModel(), LaggedRidgeModel(with_temperature=True))

    def unfitted(self) -> GreyResidualModel:
        """Return an unfitted model that starts from this one's grey box."""
        return GreyResidualModel(self.first.unfitted())
