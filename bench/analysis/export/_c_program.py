"""What a model gives to run in C: its constants and a template of three C fragments.

A fragment source is Jinja2 text with the macros `state()` (members of the state struct), `start()` (statements
run once, before the first step) and `step()` (statements that add to `bias` and `sf`). It sees `k`, the prefix
of its constants, `s`, the prefix of its state members, and its `sizes`. The C has `t_in`, `t_out`, `dt_60`,
`gradient` in scope. A model from another package takes part by having a method `c_programs()` that returns a
sequence of these; the outputs of several add up.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from bench.analysis.thermal._diffusion import NODES, diffusion
from bench.analysis.thermal._signals import change_steps, low_pass_gains
from bench.analysis.thermal._types import ThermalModel
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

TEMPLATES = Path(__file__).parent
Real = Literal["float", "double"]


@dataclass(frozen=True)
class CConstant:
    """An array of constants, row by row; `real` is its C type."""

    name: str
    values: Array
    real: Real = "float"


@dataclass(frozen=True)
class CProgram:
    """One additive part of a model in C; `tag` keeps its names apart from those of other parts."""

    tag: str
    source: str
    constants: tuple[CConstant, ...]
    sizes: Mapping[str, int] = field(default_factory=dict)


def c_programs(model: ThermalModel) -> tuple[CProgram, ...]:
    """Return the parts of a fitted model in C; ConfigurationError for a model that cannot be exported."""
    own = getattr(model, "c_programs", None)
    if own is not None:
        return tuple(own())
    kind = _kind(model.name)
    if kind not in _PROGRAMS:
        raise ConfigurationError(
            f"the model {model.name!r} has no C form",
            where="C export",
            expected=f"one of {', '.join(_PROGRAMS)}, or a model with a method c_programs()",
            remedy="export another model, or add the method to this one",
        )
    return tuple(_PROGRAMS[kind](model.to_state()))


def _kind(name: str) -> str:
    """Return a model's name without a network's settings, which stand after a colon."""
    return name.partition(":")[0]


def _source(name: str) -> str:
    return (TEMPLATES / name).read_text(encoding="utf-8")


def _lstm(state: Mapping[str, Any]) -> Sequence[CProgram]:
    weights, hidden = state["weights"], int(state["settings"]["hidden"])
    constants = [
        CConstant(name, weights[name]) for name in ("w_input", "w_hidden", "bias", "w_output", "b_output")
    ]
    constants += [
        CConstant("input_low", weights["input_low"]),
        CConstant("input_slope", 2.0 / (weights["input_high"] - weights["input_low"])),
        CConstant("target_mid", weights["target_mid"]),
        CConstant("target_scale", weights["target_scale"]),
    ]
    sizes = {"hidden": hidden, "warm_up": int(state["settings"]["warm_up"])}
    head = "{% set inputs = [" + ", ".join(map(repr, state["settings"]["inputs"])) + "] %}\n"
    return [CProgram("lstm", head + _source("lstm.c.j2"), tuple(constants), sizes)]


def _linear_map(state: Mapping[str, Any]) -> tuple[CConstant, ...]:
    """Centre, and coefficients with the scale folded in; a term without a scale has none."""
    coefficients = np.asarray(state["coef"]) / np.asarray(state["scale"])[:, None]
    return (
        CConstant("centre", np.asarray(state["centre"]), "double"),
        CConstant("coef_bias", coefficients[:, 0], "double"),
        CConstant("coef_sf", coefficients[:, 1], "double"),
        CConstant("intercept", np.asarray(state["intercept"]), "double"),
    )


def _terms(*terms: str) -> Callable[[Mapping[str, Any]], Sequence[CProgram]]:
    """A linear model whose terms are expressions in the inputs and `dt_out`."""

    def programs(state: Mapping[str, Any]) -> Sequence[CProgram]:
        delay = change_steps(float(state["step_s"])) if any("dt_out" in term for term in terms) else 0
        sizes = {"count": len(terms), "delay": delay}
        head = "{% set terms = [" + ", ".join(repr(term) for term in terms) + "] %}\n"
        return [CProgram("linear", head + _source("linear.c.j2"), _linear_map(state), sizes)]

    return programs


_SCALED = ("coef_bias", "coef_sf", "intercept", "target_mid", "target_scale")
"""Constants that the outputs of a part are proportional to, all of them together."""


def _mean(state: Mapping[str, Any]) -> Sequence[CProgram]:
    """The parts of a mean, each with its outputs divided by how many there are."""
    parts = []
    for number, part in enumerate(state["parts"]):
        for program in _PROGRAMS[_kind(part["name"])](part["state"]):
            constants = tuple(
                replace(constant, values=np.asarray(constant.values) / len(state["parts"]))
                if constant.name in _SCALED
                else constant
                for constant in program.constants
            )
            parts.append(replace(program, tag=f"{program.tag}{number}", constants=constants))
    return parts


def _lag_ridge(state: Mapping[str, Any]) -> Sequence[CProgram]:
    gains = low_pass_gains(float(state["step_s"]))
    constants = (*_linear_map(state), CConstant("gain", gains, "double"))
    sizes = {"count": len(state["centre"]), "lags": len(gains), "products": int(state["with_temperature"])}
    return [CProgram("lag", _source("lag.c.j2"), constants, sizes)]


def _grey_box(state: Mapping[str, Any]) -> Sequence[CProgram]:
    p, step_s = state["parameters"], float(state["step_s"])
    chain = diffusion(p["k_in"], p["k_out"], p["k_layer"], p["k_relax"], step_s)
    arrays = {
        "advance": chain.step_matrix,
        "drive": chain.input_matrix,
        "rest": chain.rest,
        "rate_state": chain.a * 60.0,
        "rate_input": chain.b * 60.0,
        "radius": (np.arange(NODES) - (NODES - 1) / 2) / NODES,
        "transition": np.array([p["transition_c"], 0.5 / p["width_c"]]),
        "per_minute": np.array([60.0 / step_s]),
    }
    constants = tuple(CConstant(name, np.asarray(values), "double") for name, values in arrays.items())
    return [CProgram("grey", _source("grey_box.c.j2"), (*constants, *_linear_map(state)), {"nodes": NODES})]


_PROGRAMS: Mapping[str, Callable[[Mapping[str, Any]], Sequence[CProgram]]] = {
    "poly3": _terms("t_in", "t_in * t_in", "t_in * t_in * t_in"),
    "multilinear": _terms("t_in", "t_in * t_in", "t_in * t_in * t_in", "dt_60", "gradient"),
    "stepwise": _terms(
        "t_out",
        "t_in",
        "dt_out",
        "dt_60",
        "t_out * dt_out",
        "t_in * dt_60",
        "dt_out * dt_out",
        "dt_60 * dt_60",
        "t_out * t_out",
        "t_in * t_in",
        "t_out - t_in",
    ),
    "lag_ridge": _lag_ridge,
    "lag_ridge_x_temp": _lag_ridge,
    "grey_box": _grey_box,
    "grey_box_residual": lambda state: [*_grey_box(state["grey_box"]), *_lag_ridge(state["residual"])],
    "lstm": _lstm,
    "mean": _mean,
    "hybrid": lambda state: [*_lag_ridge(state["linear"]), *_lstm(state["network"])],
}
