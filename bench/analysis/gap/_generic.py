"""Competitors outside the catalogue: free curves over one input each, to see whether an effect only resembles.

A free curve costs many parameters, so an effect of the catalogue that is really there wins against it; one that
merely imitates the real dependence loses. The winner also says what the missing effect follows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bench.analysis.gap._data import GapRun
from drivers.base.arrays import Array
from simulators.effects import (
    PPM,
    REFERENCE_C,
    Curve,
    Effect,
    Formula,
    Input,
    Parameter,
    Shape,
    Stimulus,
    Unit,
    Variant,
)

_PREFIX = "free curve: "
_BOUND = 1e6
_OF_ANY_GYRO = Unit("deg/h")
"""Its bounds are far beyond every gyro's biases."""
_LAGS_S = (0.0, 150.0, 400.0)
_FINE_LAGS_S = (0.0, 250.0)
_FINE = 18
"""Nodes of a curve over temperature that shows lines and ripples some kelvins wide."""
_NODES = (2, 3, 5, 9)
"""How finely a curve is drawn is not known before: a straight one costs one parameter, a winding one many."""
_PLACES_APART_K = 4.0
_WIDTHS_K = (2.0, 5.0)
_ABOUT = np.linspace(-4.0, 4.0, 17)
"""Where the curve about one temperature is shown, in widths."""
_ANGLE = "table angle"
_TURNING_DPS = 1.0
_STEADY_DPS = 0.01
_SETTLING_S = 300.0
_NO_CURVE = Curve(Input.NONE)


class _Along(NamedTuple):
    """An input that free curves are drawn over: its words, its values, and the least span that shows a curve.

    `shown` turns values (m,) into those that a reader is told, in `unit`.
    """

    words: str
    values: Callable[[Stimulus], Array]
    least_span: float
    unit: str
    shown: Callable[[Array], Array] = lambda values: values


INPUTS = {
    Input.T_IN: _Along("T_in", lambda s: s.warm_k, 10.0, "degC", lambda warm_k: warm_k + REFERENCE_C),
    Input.T_OUT: _Along("T_out", lambda s: s.case_warm_k, 10.0, "degC", lambda warm_k: warm_k + REFERENCE_C),
    Input.WARMING: _Along("dT_in/dt", lambda s: s.warming_k_per_min, 0.5, "K/min"),
    Input.GRADIENT: _Along("T_in - T_out", lambda s: s.gradient_k, 1.0, "K"),
    Input.TIME: _Along(
        "time since power-on",
        # nodes further apart the longer it is on: what settles does so by parts of what is left
        lambda s: np.log1p(np.maximum(s.time_s, 0.0) / _SETTLING_S),
        1.0,
        "s",
        lambda octaves: _SETTLING_S * np.expm1(octaves),
    ),
}


@dataclass(frozen=True)
class FreeCurve(Effect):
    """A curve of any form over one input: linear splines between `nodes`, harmonics of the table's angle, or a
    resonance at one input.

    `nodes` are the inputs at which its parameters hold, empty of others; `orders` are the harmonics of its
    parameters. What has neither is a resonance.
    """

    curve: Curve = _NO_CURVE
    nodes: tuple[float, ...] = ()
    orders: tuple[int, ...] = ()

    @property
    def local(self) -> bool:
        """Whether it is a resonance at one input, whose place can move."""
        return not self.nodes and not self.orders

    def drawn(self, shape: Shape, values: Sequence[float]) -> tuple[Array, Array]:
        """Return inputs and the curve there, (m,) each, for a curve over one input, no harmonics."""
        if self.local:
            even, odd = _resonance(_ABOUT)
            return shape["at"] + shape["width"] * _ABOUT, values[0] * even + values[1] * odd
        return np.array(self.nodes), np.array(values)


def free_curves(runs: Sequence[GapRun]) -> list[Variant]:
    """Return free curves over what changes in these runs: temperatures, on bias and scale factor, and angle."""
    effects: list[Effect] = []
    turning = any(
        np.ptp(run.stimulus.axis_rate_dps) + abs(run.stimulus.axis_rate_dps[0]) > _TURNING_DPS for run in runs
    )
    apart = any(np.ptp(run.stimulus.gradient_k) >= INPUTS[Input.GRADIENT].least_span for run in runs)
    for over, along in INPUTS.items():
        if over is Input.T_OUT and not apart:
            continue
        low = min(float(along.values(run.stimulus).min()) for run in runs)
        high = max(float(along.values(run.stimulus).max()) for run in runs)
        if high - low < along.least_span:
            continue
        # of one name: a set holds one of them, coarse or fine
        for count, lags_s in _grids(over):
            nodes = np.linspace(low, high, count)
            effects += [_spline(Curve(over), nodes, lags_s)]
            if turning:
                effects += [_spline(Curve(over, of_rate=True), nodes, lags_s)]
        if over is Input.T_IN:
            effects.append(_local(Curve(over), low, high))
    if turning:
        effects.append(_harmonics("rate over table angle", Curve(Input.ANGLE, of_rate=True)))
    effects.append(_harmonics("bias over table angle", Curve(Input.ANGLE)))
    return [variant for effect in effects for variant in effect.variants()]


def _grids(over: Input) -> list[tuple[int, tuple[float, ...]]]:
    """Return numbers of nodes, each with its lags."""
    lags_s = (0.0,) if over is Input.TIME else _LAGS_S
    return [(count, lags_s) for count in _NODES] + [(_FINE, _FINE_LAGS_S)] * (over is Input.T_IN)


def grid_points(effect: Effect) -> int:
    """Return how many variants of an effect compete, those of other effects of its name among them."""
    if isinstance(effect, FreeCurve) and effect.nodes:
        return sum(len(lags_s) for _, lags_s in _grids(effect.curve.over))
    return len(effect.shapes)


def smooth(effect: Effect, runs: Sequence[GapRun]) -> bool:
    """Return whether an effect's columns have nothing in the fast bands: curves over temperatures."""
    if not isinstance(effect, FreeCurve) or effect.orders:
        return False
    return not effect.curve.of_rate or all(np.ptp(run.stimulus.axis_rate_dps) < _STEADY_DPS for run in runs)


def absorbed(effect: Effect, curves: Sequence[Effect]) -> bool:
    """Return whether a free curve in the model is over the very input that an effect is a function of.

    A resonance there has a form of its own, that of no effect. A temperature counts wherever it is measured: what
    follows it lies inside or outside of both sensors, and a curve over the outer one, late, is one over both.
    """
    whole = (each for each in curves if not (isinstance(each, FreeCurve) and each.local))
    return effect.curve is not None and any(
        effect.curve.of_rate == each.curve.of_rate and _place(effect.curve) == _place(each.curve)
        for each in whole
        if each.curve is not None
    )


def _place(curve: Curve) -> Input:
    """Return what a curve is over, the temperatures inside and outside for one."""
    return Input.T_IN if curve.over == Input.T_OUT else curve.over


def _spline(curve: Curve, nodes: Array, lags_s: Sequence[float]) -> FreeCurve:
    along = INPUTS[curve.over]

    def formula(s: Stimulus, shape: Shape) -> Array:
        hats = _hats(s.lagged(along.values(s), shape["lag_s"]), nodes)
        return np.asarray(hats * 1e-6 * s.input_rate_dph if curve.of_rate else hats)

    name = f"{'scale factor' if curve.of_rate else 'bias'} over {along.words}"
    unit = "ppm" if curve.of_rate else "dph"
    names = tuple(f"{unit}_at_{node:.2f}" for node in nodes[1:])
    shapes = tuple({"lag_s": lag} for lag in lags_s)
    return _effect(name, names, formula, along.words, curve, shapes, nodes=tuple(nodes[1:].tolist()))


def _local(curve: Curve, low: float, high: float) -> FreeCurve:
    along = INPUTS[curve.over]

    def formula(s: Stimulus, shape: Shape) -> Array:
        return _resonance((s.lagged(along.values(s), shape["lag_s"]) - shape["at"]) / shape["width"])

    places = np.linspace(low, high, 1 + math.ceil((high - low) / _PLACES_APART_K)).tolist()
    shapes = tuple(
        {"at": at, "width": width, "lag_s": lag_s}
        for at in places
        for width in _WIDTHS_K
        for lag_s in _FINE_LAGS_S
    )
    return _effect(
        f"resonance over {along.words}", ("even_dph", "odd_dph"), formula, along.words, curve, shapes
    )


def _resonance(x: Array) -> Array:
    """Return a resonance's two quadratures over the detuning in half widths (n,): Lorentz's lines, (2, n)."""
    even = 1.0 / (1.0 + x**2)
    return np.stack([even, 2.0 * x * even])


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


def _harmonics(name: str, curve: Curve) -> FreeCurve:
    orders = (1, 2, 3, 4)

    def formula(s: Stimulus, _: Shape) -> Array:
        waves = np.concatenate([s.harmonic(order) for order in orders])
        return np.asarray(waves * 1e-6 * s.input_rate_dph if curve.of_rate else waves)

    names = tuple(f"{part}_{order}" for order in orders for part in ("cos", "sin"))
    return _effect(name, names, formula, _ANGLE, curve, orders=tuple(order for order in orders for _ in "cs"))


def _effect(
    name: str,
    parameters: Sequence[str],
    formula: Formula,
    follows: str,
    curve: Curve,
    shapes: tuple[Shape, ...] = ({},),
    *,
    nodes: tuple[float, ...] = (),
    orders: tuple[int, ...] = (),
) -> FreeCurve:
    unit = PPM if curve.of_rate else _OF_ANY_GYRO
    return FreeCurve(
        _PREFIX + name,
        tuple(Parameter(parameter, -_BOUND, _BOUND, unit) for parameter in parameters),
        formula,
        curve.over | (Input.RATE if curve.of_rate else Input.NONE),
        follows,
        "linear splines",
        f"A curve of {name}, of any form; no effect of the catalogue has it.",
        shapes,
        curve=curve,
        nodes=nodes,
        orders=orders,
    )
