"""Competitors outside the catalogue: free curves over one input each, to see whether an effect only resembles.

A free curve costs many parameters, so an effect of the catalogue that is really there wins against it; one that
merely imitates the real dependence loses. The winner also says what the missing effect follows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from bench.analysis.gap._data import GapRun
from drivers.base.arrays import Array
from simulators.effects import Effect, Parameter, Stimulus, Variant

Shape = Mapping[str, float]
PREFIX = "free curve: "
_BOUND = 1e6
_LAGS_S = (0.0, 150.0, 400.0)
_FINE_LAGS_S = (0.0, 250.0)
_FINE = 18
"""Nodes of a curve over temperature that shows lines and ripples some kelvins wide."""
_NODES = (2, 3, 5, 9)
"""How finely a curve is drawn is not known before: a straight one costs one parameter, a winding one many."""
_LEAST_SPAN = {"T_in": 10.0, "T_out": 10.0, "dT_in/dt": 0.5, "T_in - T_out": 1.0}
_ANGLE = "table angle"
_ANGLES = {
    PREFIX + "rate over table angle": "a turn, proportional to rate",
    PREFIX + "bias over table angle": _ANGLE,
}
"""How effects that such a curve can stand for say what they follow."""
_TURNING_DPS = 1.0
_STEADY_DPS = 0.01
_INPUTS: dict[str, Callable[[Stimulus], Array]] = {
    "T_in": lambda s: s.warm_k,
    "T_out": lambda s: s.case_warm_k,
    "dT_in/dt": lambda s: s.warming_k_per_min,
    "T_in - T_out": lambda s: s.gradient_k,
}


def free_curves(runs: Sequence[GapRun]) -> list[Variant]:
    """Return free curves over what changes in these runs: temperatures, on bias and scale factor, and angle."""
    effects: list[Effect] = []
    turning = any(
        np.ptp(run.stimulus.axis_rate_dps) + abs(run.stimulus.axis_rate_dps[0]) > _TURNING_DPS for run in runs
    )
    apart = any(np.ptp(run.stimulus.gradient_k) >= _LEAST_SPAN["T_in - T_out"] for run in runs)
    for name, of in _INPUTS.items():
        if name == "T_out" and not apart:
            continue
        low = min(float(of(run.stimulus).min()) for run in runs)
        high = max(float(of(run.stimulus).max()) for run in runs)
        if high - low < _LEAST_SPAN[name]:
            continue
        # of one name: a set holds one of them, coarse or fine
        for count, lags_s in _grids(name):
            nodes = np.linspace(low, high, count)
            effects += [_curve(f"bias over {name}", name, nodes, of, lags_s, rate=False)]
            if turning:
                effects += [_curve(f"scale factor over {name}", name, nodes, of, lags_s, rate=True)]
    if turning:
        effects.append(_harmonics("rate over table angle", rate=True))
    effects.append(_harmonics("bias over table angle", rate=False))
    return [variant for effect in effects for variant in effect.variants()]


def _grids(name: str) -> list[tuple[int, tuple[float, ...]]]:
    """Return numbers of nodes, each with its lags."""
    return [(count, _LAGS_S) for count in _NODES] + [(_FINE, _FINE_LAGS_S)] * (name == "T_in")


def grid_points(effect: Effect) -> int:
    """Return how many variants of an effect compete, those of other effects of its name among them."""
    if effect.name.startswith(PREFIX) and effect.follows in _INPUTS:
        return sum(len(lags_s) for _, lags_s in _grids(effect.follows))
    return len(effect.shapes)


def smooth(effect: Effect, runs: Sequence[GapRun]) -> bool:
    """Return whether an effect's columns have nothing in the fast bands: curves over temperatures."""
    if not effect.name.startswith(PREFIX) or effect.follows not in _INPUTS:
        return False
    steady = all(np.ptp(run.stimulus.axis_rate_dps) < _STEADY_DPS for run in runs)
    return effect.name.startswith(PREFIX + "bias") or steady


def absorbed(effect: Effect, curves: Sequence[Effect]) -> bool:
    """Return whether a free curve in the model is over the very input that an effect is a function of."""
    for curve in curves:
        if curve.follows == _ANGLE and effect.follows.endswith(_ANGLES[curve.name]):
            return True
        rate = curve.name.startswith(PREFIX + "scale factor")
        wanted = f"rate times {curve.follows}" if rate else curve.follows
        if effect.follows == wanted or effect.follows.startswith((f"{wanted} crossing", f"{wanted} below")):
            return True
    return False


def _curve(
    name: str,
    follows: str,
    nodes: Array,
    of: Callable[[Stimulus], Array],
    lags_s: Sequence[float],
    *,
    rate: bool,
) -> Effect:
    def columns(s: Stimulus, shape: Shape) -> Array:
        values = s.lagged(of(s), shape["lag_s"])
        hats = _hats(values, nodes)
        return np.asarray(hats * 1e-6 * s.input_rate_dph if rate else hats)

    unit = "ppm" if rate else "dph"
    parameters = tuple(Parameter(f"{unit}_at_{node:.2f}", -_BOUND, _BOUND) for node in nodes[1:])
    return _effect(name, parameters, columns, follows, tuple({"lag_s": lag} for lag in lags_s))


def _hats(values: Array, nodes: Array) -> Array:
    """Return linear splines that are one at one of equidistant nodes but the first, (nodes - 1, n)."""
    along = np.clip((values - nodes[0]) / (nodes[1] - nodes[0]), 0.0, len(nodes) - 1.0)
    left = np.minimum(along.astype(np.int64), len(nodes) - 2)
    part = along - left
    hats = np.zeros((len(nodes), len(values)))
    every = np.arange(len(values))
    hats[left, every] = 1.0 - part
    hats[left + 1, every] = part
    return hats[1:]


def _harmonics(name: str, *, rate: bool) -> Effect:
    orders = (1, 2, 3, 4)

    def columns(s: Stimulus, _: Shape) -> Array:
        waves = np.concatenate([s.harmonic(order) for order in orders])
        return np.asarray(waves * 1e-6 * s.input_rate_dph if rate else waves)

    parameters = tuple(
        Parameter(f"{part}_{order}", -_BOUND, _BOUND) for order in orders for part in ("cos", "sin")
    )
    return _effect(name, parameters, columns, _ANGLE, ({},))


def _effect(
    name: str,
    parameters: tuple[Parameter, ...],
    columns: Callable[[Stimulus, Shape], Array],
    follows: str,
    shapes: tuple[Shape, ...],
) -> Effect:
    meaning = f"A curve of {name}, of any form; no effect of the catalogue has it."
    return Effect(PREFIX + name, parameters, columns, follows, "linear splines", meaning, shapes)
