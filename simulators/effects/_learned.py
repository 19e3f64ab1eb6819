"""Learned forms: columns without a mechanism's formula, for what a diagnosis cannot name but must close.

A form is a family of columns over one input; its shape says where the nodes, lags or orders are, so that a model
file holds all of it and a plant can run it like an effect of the catalogue.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._effect import DPH, PPM, Effect, Input, Parameter, Shape, Unit
from simulators.effects._stimulus import Stimulus

_PREFIX = "learned: "
_BOUND = 1e9
_SOURCE = "fitted to runs, judged on a profile left out"
_MEANING = "A form learned from the runs; it names no cause."
Columns = Callable[[Stimulus, Sequence[float]], Array | tuple[Array, ...]]


@dataclass(frozen=True)
class LearnedForm:
    """A family of columns, one for each node, lag in s, order, ...; the first node of a `curve` has none."""

    name: str
    follows: str
    inputs: Input
    columns: Columns
    unit: Unit = DPH
    curve: bool = False

    def effect(self, shape: Shape) -> Effect:
        """Return the form at one shape, {"at_1": ..., ...}, as an effect."""
        at = [float(value) for value in shape.values()]
        count = len(at) - self.curve
        return Effect(
            _PREFIX + self.name,
            tuple(Parameter(f"value_{number}", -_BOUND, _BOUND, self.unit) for number in range(count)),
            lambda s, _: self.columns(s, at),
            self.inputs,
            self.follows,
            _SOURCE,
            _MEANING,
            (shape,),
            self.unit,
        )


def learned_shape(at: Sequence[float]) -> Shape:
    """Return the shape of a form with its nodes, lags or orders."""
    return {f"at_{number}": float(value) for number, value in enumerate(at)}


def learned_effect(name: str, shape: Shape) -> Effect | None:
    """Return the effect of a model file's learned term, None for a name that no form has."""
    form = FORMS.get(name.removeprefix(_PREFIX))
    return form.effect(shape) if form and name.startswith(_PREFIX) and shape else None


def _hats(values: Array, nodes: Sequence[float]) -> Array:
    """Return linear splines over all nodes but the first, (nodes - 1, n); of a number (nodes - 1,)."""
    many = np.atleast_1d(values)
    along = np.interp(many, nodes, np.arange(len(nodes)))
    lower = np.minimum(along.astype(np.int64), len(nodes) - 2)
    hats = np.zeros((len(nodes), len(many)))
    every = np.arange(len(many))
    hats[lower, every] = 1.0 - (along - lower)
    hats[lower + 1, every] = along - lower
    return hats[1:] if np.ndim(values) else hats[1:, 0]


def _curve(values: Callable[[Stimulus], Array], lag_s: float = 0.0) -> Columns:
    return lambda s, nodes: _hats(s.lagged(values(s), lag_s), nodes)


def _memory(values: Callable[[Stimulus], Array]) -> Columns:
    def columns(s: Stimulus, lags_s: Sequence[float]) -> tuple[Array, ...]:
        now = values(s)
        return tuple(now - s.lagged(now, lag_s) for lag_s in lags_s)

    return columns


def _activity(s: Stimulus, lags_s: Sequence[float]) -> tuple[Array, ...]:
    now = abs(s.warming_k_per_min)
    return tuple(s.lagged(now, lag_s) for lag_s in lags_s)


def _loops(s: Stimulus, half_widths_k: Sequence[float]) -> tuple[Array, ...]:
    return tuple(s.slack(s.warm_k, half) for half in half_widths_k)


def _heat(s: Stimulus, lags_s: Sequence[float]) -> tuple[Array, ...]:
    power = (s.table_rate_dps / 100.0) ** 2
    return tuple(s.lagged(power, lag_s) for lag_s in lags_s)


def _bias_waves(s: Stimulus, orders: Sequence[float]) -> Array:
    return np.concatenate([s.harmonic(round(order))[half] for order, half in _halves(orders)]).reshape(
        len(orders), -1
    )


def _rate_waves(s: Stimulus, orders: Sequence[float]) -> Array:
    """Mean over each sample of rate times cos and sin of multiples of the angle, exact, ppm of rate."""
    rows = []
    for order, half in _halves(orders):
        angle = np.radians(order * s.angle_deg)
        swing = np.diff(-np.cos(angle) if half else np.sin(angle))
        rows.append(1e-6 * math.degrees(1.0) / order / s.period_s * 3600.0 * swing)
    return np.stack(rows) * np.sin(np.radians(s.elevation_deg))


def _halves(orders: Sequence[float]) -> list[tuple[int, int]]:
    """Return order and 0 for cosine or 1 for sine: an order that comes again means its sine."""
    return [(round(order), int(order in orders[:place])) for place, order in enumerate(orders)]


def _directions(s: Stimulus, kinds: Sequence[float]) -> Array:
    elevation = np.radians(s.elevation_deg)
    level = s.harmonic(1) * np.cos(elevation)
    rows = (level[0], level[1], np.sin(elevation), np.sin(elevation) ** 2)
    return np.stack([rows[round(kind)] for kind in kinds])


def _rate_curve(s: Stimulus, nodes_dps: Sequence[float]) -> Array:
    return _hats(s.input_rate_dph / 3600.0, nodes_dps)


def _after_power_on(s: Stimulus, times_s: Sequence[float]) -> tuple[Array, ...]:
    return tuple(np.exp(-s.time_s / time_s) for time_s in times_s)


def _rate_changes(s: Stimulus, delays: Sequence[float]) -> Array:
    """Change of the table's rate along the axis so many samples before."""
    change = np.diff(s.axis_rate_dps, prepend=s.axis_rate_dps[:1])
    rows = []
    for delay in delays:
        late = np.zeros_like(change)
        late[round(delay) :] = change[: len(change) - round(delay)]
        rows.append(late)
    return np.stack(rows)


_T_IN, _T_OUT, _WARMING, _GRADIENT = Input.T_IN, Input.T_OUT, Input.WARMING, Input.GRADIENT
_TURNING = Input.ANGLE | Input.TABLE_RATE | Input.ATTITUDE
_LAG_S = 400.0
FORMS = {
    form.name: form
    for form in (
        LearnedForm("bias over T_in", "T_in", _T_IN, _curve(lambda s: s.warm_k), curve=True),
        LearnedForm(
            "bias over late T_in",
            f"T_in {_LAG_S:.0f} s late",
            _T_IN | Input.HISTORY,
            _curve(lambda s: s.warm_k, _LAG_S),
            curve=True,
        ),
        LearnedForm("bias over T_out", "T_out", _T_OUT, _curve(lambda s: s.case_warm_k), curve=True),
        LearnedForm(
            "bias over dT_in/dt", "dT_in/dt", _WARMING, _curve(lambda s: s.warming_k_per_min), curve=True
        ),
        LearnedForm(
            "bias over T_in - T_out", "T_in - T_out", _GRADIENT, _curve(lambda s: s.gradient_k), curve=True
        ),
        LearnedForm("memory of T_in", "T_in before", _T_IN | Input.HISTORY, _memory(lambda s: s.warm_k)),
        LearnedForm(
            "memory of T_out", "T_out before", _T_OUT | Input.HISTORY, _memory(lambda s: s.case_warm_k)
        ),
        LearnedForm("loops of T_in", "turns of T_in", _T_IN | Input.HISTORY, _loops),
        LearnedForm("memory of temperature changes", "dT_in/dt before", _WARMING | Input.HISTORY, _activity),
        LearnedForm(
            "scale factor over T_in", "rate times T_in", _T_IN, _curve(lambda s: s.warm_k), PPM, curve=True
        ),
        LearnedForm(
            "scale factor's memory of T_in",
            "rate times T_in before",
            _T_IN | Input.HISTORY,
            _memory(lambda s: s.warm_k),
            PPM,
        ),
        LearnedForm("bias over rate", "rate", Input.RATE, _rate_curve, curve=True),
        LearnedForm("bias over table angle", "table angle", Input.ANGLE, _bias_waves),
        LearnedForm("rate over table angle", "table angle, with rate", _TURNING, _rate_waves),
        LearnedForm("bias over direction", "attitude", Input.ANGLE | Input.ATTITUDE, _directions),
        LearnedForm("time since power-on", "time since power-on", Input.TIME, _after_power_on),
        LearnedForm(
            "scale factor since power-on", "rate times time since power-on", Input.TIME, _after_power_on, PPM
        ),
        LearnedForm("heat of turning", "square of rate before", Input.TABLE_RATE | Input.HISTORY, _heat),
        LearnedForm("answer to changes of rate", "change of rate", _TURNING, _rate_changes),
    )
}
