"""Names of the thermal models: for the command line, for comparing them all, for restoring one from a file.

A package of another maker adds models through the entry point group `gyrobench.models`: the entry's name is the
model's `name`, its object a callable without arguments that returns an unfitted `ThermalModel` whose class has a
`from_state` class method.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
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
from bench.analysis.thermal._lstm_weights import LstmSettings
from bench.analysis.thermal._mean import MeanModel
from bench.analysis.thermal._types import ThermalModel
from drivers.base.errors import ConfigurationError
from drivers.base.plugins import entry_points_of

ENTRY_POINT_GROUP = "gyrobench.models"

_SETTINGS = {"hidden": 1, "epochs": 1, "seed": 0}
"""Numbers among the settings of the LSTM that its name may carry, and their least value."""
_CHANNELS = {
    "t_in": "the gyro's own temperature",
    "t_out": "that of its case",
    "dt_60": "rate of change of t_in",
    "gradient": "t_in - t_out",
}
"""What the network may see: what every model has at run time. A rate is not among them: bias runs stand
still, and a scale factor is the slope over the rates of a group."""
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
    """Return an unfitted model; ConfigurationError for a name nobody has, or for settings that it does not take.

    "lstm" takes settings after a colon, "lstm:hidden=32+seed=1+inputs=t_in/t_out"; they are part of its name.
    """
    if name == MeanModel.name:
        return MeanModel()
    if name.startswith("lstm:"):
        return LstmModel(_settings(name), name)
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


def require_models(names: Iterable[str]) -> None:
    """Raise ConfigurationError for a name of no model, or for settings that it does not take."""
    for name in names:
        new_model(name)


def is_network(name: str) -> bool:
    """Return whether a model has to be trained for minutes, on runs other than those that end its training."""
    return name.partition(":")[0] in ("lstm", "hybrid")


def _settings(name: str) -> LstmSettings:
    given: dict[str, Any] = {}
    for text in name.partition(":")[2].split("+"):
        setting, _, value = text.partition("=")
        if setting == "inputs":
            given[setting] = _inputs(name, value)
            continue
        if setting not in _SETTINGS or not value.isdecimal() or int(value) < _SETTINGS[setting]:
            raise ConfigurationError(
                f"a setting that the LSTM does not take: {text!r}",
                where=name,
                expected=", ".join(f"{key} of {least} or more" for key, least in _SETTINGS.items())
                + f", inputs of {'/'.join(_CHANNELS)}",
                remedy="write, for example, lstm:hidden=32+seed=1+inputs=t_in/t_out/dt_60",
            )
        given[setting] = int(value)
    return LstmSettings(**given)


def _inputs(name: str, value: str) -> tuple[str, ...]:
    wanted = tuple(value.split("/"))
    unknown = [channel for channel in wanted if channel not in _CHANNELS]
    if unknown or len(set(wanted)) < len(wanted):
        raise ConfigurationError(
            f"an input that the LSTM cannot have: {unknown[0]!r}" if unknown else "an input is named twice",
            where=name,
            found=value,
            expected="some of " + ", ".join(f"{key} ({what})" for key, what in _CHANNELS.items()),
            remedy="write, for example, lstm:inputs=t_in/t_out/dt_60",
        )
    return wanted


def restore_model(name: str, state: Mapping[str, Any]) -> ThermalModel:
    """Return the fitted model whose `to_state` gave `state`; ValueError for a mean of no models."""
    if name == MeanModel.name:
        if not state["parts"]:
            raise ValueError("a mean of no models")
        return MeanModel([restore_model(part["name"], part["state"]) for part in state["parts"]])
    unfitted = new_model(name)
    restored = cast(Any, type(unfitted)).from_state(state)
    if isinstance(restored, LstmModel):
        restored.name = unfitted.name
    return cast(ThermalModel, restored)
