"""Names of the thermal models: for the command line, for comparing them all, for restoring one from a file.

A package of another maker adds models through the entry point group `gyrobench.models`: the entry's name is the
model's `name`, its object a callable without arguments that returns an unfitted `ThermalModel` whose class has a
`from_state` class method.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, cast

from bench.analysis.thermal._grey_box import GreyBoxModel
from bench.analysis.thermal._hybrid import GreyResidualModel, HybridModel
from bench.analysis.thermal._linear_models import (
    CubicModel,
    LaggedRidgeModel,
    MultilinearModel,
    StepwiseModel,
)
from bench.analysis.thermal._lstm import LstmModel
from bench.analysis.thermal._mean import MeanModel
from bench.analysis.thermal._types import ThermalModel
from drivers.base.errors import ConfigurationError
from drivers.base.plugins import entry_points_of

ENTRY_POINT_GROUP = "gyrobench.models"

_BUILT_IN: Mapping[str, Callable[[], Any]] = {
    "poly3": CubicModel,
    "multilinear": MultilinearModel,
    "stepwise": StepwiseModel,
    "lag_ridge": LaggedRidgeModel,
    "lag_ridge_x_temp": partial(LaggedRidgeModel, with_temperature=True),
    "grey_box": GreyBoxModel,
    "grey_box_residual": GreyResidualModel,
    "lstm": LstmModel,
    "hybrid": HybridModel,
}


def model_names() -> tuple[str, ...]:
    """Return the names of all models, our own first, then the installed ones in alphabetical order."""
    others = {entry.name for entry in entry_points_of(ENTRY_POINT_GROUP)} - set(_BUILT_IN)
    return (*_BUILT_IN, *sorted(others))


def new_model(name: str) -> ThermalModel:
    """Return an unfitted model with its default settings; ConfigurationError for a name nobody has."""
    if name == MeanModel.name:
        return MeanModel()
    if name in _BUILT_IN:
        return cast(ThermalModel, _BUILT_IN[name]())
    for entry in entry_points_of(ENTRY_POINT_GROUP).select(name=name):
        return cast(ThermalModel, entry.load()())
    raise ConfigurationError(
        f"there is no thermal model named {name!r}",
        where="model registry",
        expected=f"one of {', '.join(model_names())}",
        remedy="correct the name, or install the package that brings the model",
    )


def restore_model(name: str, state: Mapping[str, Any]) -> ThermalModel:
    """Return the fitted model whose `to_state` gave `state`; ValueError for a mean of no models."""
    if name == MeanModel.name:
        if not state["parts"]:
            raise ValueError("a mean of no models")
        return MeanModel([restore_model(part["name"], part["state"]) for part in state["parts"]])
    kind = cast(Any, type(new_model(name)))
    return cast(ThermalModel, kind.from_state(state))
