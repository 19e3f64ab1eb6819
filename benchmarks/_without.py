"""A unit of the plant without some of its effects: what a test or a benchmark looks at stands alone."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any

from drivers.base.errors import ConfigurationError
from simulators.plant.model import EFFECTS, AxisModel, UnitModel

_NOISE = {
    "angle_random_walk": "arw_deg_per_sqrt_h",
    "bias_instability": "bias_instability_dph",
    "quantisation": "quantum_arcsec",
}


def effect_names(model: UnitModel) -> tuple[str, ...]:
    """Return every name that `without` understands for this unit, sorted."""
    names = {*_NOISE, "turn_on"}
    for axis in model.axis_models:
        names.update(*(getattr(axis, kind) for kind in EFFECTS))
    return tuple(sorted(names))


def without(*names: str) -> Callable[[UnitModel], UnitModel]:
    """Return what leaves the named effects out of a unit; ConfigurationError for a name that it does not have."""

    def change(model: UnitModel) -> UnitModel:
        unknown = sorted(set(names) - set(effect_names(model)))
        if unknown:
            raise ConfigurationError(
                "an effect to leave out is not one of this unit's",
                where="plant",
                found=", ".join(unknown),
                expected="any of " + ", ".join(effect_names(model)),
            )
        return replace(model, axis_models=tuple(_axis_without(axis, names) for axis in model.axis_models))

    return change


def _axis_without(axis: AxisModel, names: Collection[str]) -> AxisModel:
    silent = {coefficient: 0.0 for name, coefficient in _NOISE.items() if name in names}
    changes: dict[str, Any] = {"noise": replace(axis.noise, **silent)}
    for kind in EFFECTS:
        changes[kind] = {name: value for name, value in getattr(axis, kind).items() if name not in names}
    if "turn_on" in names:
        changes |= {"turn_on_bias_dph": 0.0, "turn_on_sf_ppm": 0.0}
    return replace(axis, **changes)
