"""Learned forms: columns without a mechanism's formula, for what a diagnosis cannot name but must close.

A form is a family of columns over one input or two; its shape says where the nodes, lags or orders are, so that a
model file holds all of it and a plant can run it like an effect of the catalogue.
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
_LATE, _SECOND = "late_s", "and_"
_BOUND = 1e9
_SOURCE = "fitted to runs, judged on a profile left out"
_MEANING = "A form learned from the runs; it names no cause."


@dataclass(frozen=True)
class Places:
    """Where the columns of a form are: nodes, lags or orders `at`, those of a second input `second`, a lag."""

    at: tuple[float, ...]
    second: tuple[float, ...] = ()
    late_s: float = 0.0

    @classmethod
    def of(cls, shape: Shape) -> Places:
        """Return the places that a shape names."""
        second = tuple(float(value) for key, value in shape.items() if key.startswith(_SECOND))
        at = (float(value) for key, value in shape.items() if not key.startswith(_SECOND) and key != _LATE)
        return cls(tuple(at), second, float(shape.get(_LATE, 0.0)))


Columns = Callable[[Stimulus, Places], Array | tuple[Array, ...]]
_Values = Callable[[Stimulus], Array]


@dataclass(frozen=True)
class LearnedForm:
    """A family of columns, one for each node, lag in s, order, ...; of two inputs one for each pair of nodes.

    The first node of a `curve` has no column. `smooth`: neighbouring columns have values that are alike.
    """

    name: str
    follows: str
    inputs: Input
    columns: Columns
    unit: Unit = DPH
    curve: bool = False
    smooth: bool = False

    def effect(self, shape: Shape) -> Effect:
        """Return the form at one shape as an effect."""
        places = Places.of(shape)
        count = (len(places.at) - self.curve) * max(len(places.second), 1)
        return Effect(
            _PREFIX + self.name,
            tuple(Parameter(f"value_{number}", -_BOUND, _BOUND, self.unit) for number in range(count)),
            lambda s, _: self.columns(s, places),
            self.inputs | (Input.HISTORY if places.late_s else Input.NONE),
            self.follows + (f", {places.late_s:.0f} s late" if places.late_s else ""),
            _SOURCE,
            _MEANING,
            (shape,),
            self.unit,
        )


def learned_shape(at: Sequence[float], second: Sequence[float] = (), late_s: float = 0.0) -> Shape:
    """Return the shape of a form with its nodes, lags or orders, those of a second input, and a lag."""
    late = {_LATE: late_s} if late_s else {}
    first = {f"at_{number}": float(value) for number, value in enumerate(at)}
    return late | first | {f"{_SECOND}{number}": float(value) for number, value in enumerate(second)}


def learned_effect(name: str, shape: Shape) -> Effect | None:
    """Return the effect of a model file's learned term, None for a name that no form has."""
    form = FORMS.get(name.removeprefix(_PREFIX))
    return form.effect(shape) if form and name.startswith(_PREFIX) and shape else None


def _hats(values: Array, nodes: Sequence[float]) -> Array:
    """Return linear splines over all nodes, (nodes, n); of a number (nodes,)."""
    many = np.atleast_1d(values)
    along = np.interp(many, nodes, np.arange(len(nodes)))
    lower = np.minimum(along.astype(np.int64), len(nodes) - 2)
    hats = np.zeros((len(nodes), len(many)))
    every = np.arange(len(many))
    hats[lower, every] = 1.0 - (along - lower)
    hats[lower + 1, every] = along - lower
    return hats if np.ndim(values) else hats[:, 0]


def _curve(values: _Values, always_late_s: float = 0.0) -> Columns:
    def columns(s: Stimulus, places: Places) -> Array:
        return np.asarray(_hats(s.lagged(values(s), places.late_s or always_late_s), places.at)[1:])

    return columns


def _surface(first: _Values, second: _Values) -> Columns:
    def columns(s: Stimulus, places: Places) -> Array:
        one = _hats(s.lagged(first(s), places.late_s), places.at)
        other = _hats(s.lagged(second(s), places.late_s), places.second)
        return np.asarray((one[:, None] * other[None]).reshape(-1, *one.shape[1:]))

    return columns


def _memory(values: _Values) -> Columns:
    def columns(s: Stimulus, places: Places) -> tuple[Array, ...]:
        now = values(s)
        return tuple(now - s.lagged(now, lag_s) for lag_s in places.at)

    return columns


def _activity(s: Stimulus, lags_s: Places) -> tuple[Array, ...]:
    now = abs(s.warming_k_per_min)
    return tuple(s.lagged(now, lag_s) for lag_s in lags_s.at)


def _loops(s: Stimulus, half_widths_k: Places) -> tuple[Array, ...]:
    return tuple(s.slack(s.warm_k, half) for half in half_widths_k.at)


def _heat(s: Stimulus, lags_s: Places) -> tuple[Array, ...]:
    power = (s.table_rate_dps / 100.0) ** 2
    return tuple(s.lagged(power, lag_s) for lag_s in lags_s.at)


def _bias_waves(s: Stimulus, orders: Places) -> Array:
    waves = [s.harmonic(order)[half] for order, half in _halves(orders.at)]
    return np.stack(waves)


def _rate_waves(s: Stimulus, orders: Places) -> Array:
    """Mean over each sample of rate times cos and sin of multiples of the angle, exact, ppm of rate."""
    rows = []
    for order, half in _halves(orders.at):
        angle = np.radians(order * s.angle_deg)
        swing = np.diff(-np.cos(angle) if half else np.sin(angle))
        rows.append(1e-6 * math.degrees(1.0) / order / s.period_s * 3600.0 * swing)
    return np.stack(rows) * np.sin(np.radians(s.elevation_deg))


def _halves(orders: Sequence[float]) -> list[tuple[int, int]]:
    """Return order and 0 for cosine or 1 for sine: an order that comes again means its sine."""
    return [(round(order), int(order in orders[:place])) for place, order in enumerate(orders)]


def _pulls(s: Stimulus) -> tuple[Array, ...]:
    """Return what gravity and a level field do along the axis: level cos and sin, up, up squared, (n,) each."""
    elevation = np.radians(s.elevation_deg)
    level = s.harmonic(1) * np.cos(elevation)
    return level[0], level[1], np.sin(elevation), np.sin(elevation) ** 2


def _directions(s: Stimulus, kinds: Places) -> Array:
    pulls = _pulls(s)
    return np.stack([pulls[round(kind)] for kind in kinds.at])


def _warm_directions(s: Stimulus, kinds: Places) -> Array:
    return np.asarray(_directions(s, kinds) * s.warm_k)


def _after_directions(s: Stimulus, lags_s: Places) -> Array:
    """What each of the kinds of pull, the second input, does more than before, by lags."""
    pulls = _pulls(s)
    now = [pulls[round(kind)] for kind in lags_s.second]
    return np.stack([pull - s.lagged(pull, lag_s) for lag_s in lags_s.at for pull in now])


def _rate_curve(s: Stimulus, nodes_dps: Places) -> Array:
    return np.asarray(_hats(s.input_rate_dph / 3600.0, nodes_dps.at)[1:])


def _after_power_on(s: Stimulus, times_s: Places) -> tuple[Array, ...]:
    return tuple(np.exp(-s.time_s / time_s) for time_s in times_s.at)


def _rate_changes(s: Stimulus, delays: Places) -> Array:
    """Change of the table's rate along the axis so many samples before."""
    change = np.diff(s.axis_rate_dps, prepend=s.axis_rate_dps[:1])
    rows = []
    for delay in delays.at:
        late = np.zeros_like(change)
        late[round(delay) :] = change[: len(change) - round(delay)]
        rows.append(late)
    return np.stack(rows)


def _impulse_response(s: Stimulus, delays_s: Places) -> Array:
    """Changes of the table's rate along the axis, weighted by a hat about each of even delays, (m, n), deg/s.

    The hat of half width h about delay d of the change of a rate is the second difference of its angle a,
    (a(t - d + h) - 2 a(t - d) + a(t - d - h)) / h; the mean of it over each sample.
    """
    width_s = delays_s.at[1] - delays_s.at[0]
    edges_s = np.arange(len(s) + 1) * s.period_s
    turned = np.concatenate(([0.0], np.cumsum(s.axis_rate_dps * s.period_s)))

    def angle(late_s: float) -> Array:
        """Return the angle of so long ago at every edge; before the run and after it the rate was even."""
        at = edges_s - late_s
        before, after = np.minimum(at, 0.0), np.maximum(at - edges_s[-1], 0.0)
        return np.asarray(
            np.interp(at, edges_s, turned) + before * s.axis_rate_dps[0] + after * s.axis_rate_dps[-1]
        )

    late = [angle(delays_s.at[0] + k * width_s) for k in range(-1, len(delays_s.at) + 1)]
    rows = np.diff(np.stack(late), 2, axis=0) / width_s
    return np.asarray(0.5 * (rows[:, 1:] + rows[:, :-1]))


_T_IN, _T_OUT, _WARMING, _GRADIENT = Input.T_IN, Input.T_OUT, Input.WARMING, Input.GRADIENT
_TURNING = Input.ANGLE | Input.TABLE_RATE | Input.ATTITUDE
_LAG_S = 400.0


def _warm(s: Stimulus) -> Array:
    return s.warm_k


def _case_warm(s: Stimulus) -> Array:
    return s.case_warm_k


def _warming(s: Stimulus) -> Array:
    return s.warming_k_per_min


def _gradient(s: Stimulus) -> Array:
    return s.gradient_k


def _over(name: str, follows: str, inputs: Input, values: _Values, unit: Unit = DPH) -> LearnedForm:
    return LearnedForm(name, follows, inputs, _curve(values), unit, curve=True, smooth=True)


def _over_both(name: str, inputs: Input, first: _Values, second: _Values) -> LearnedForm:
    return LearnedForm(f"bias over {name}", name, inputs, _surface(first, second), smooth=True)


FORMS = {
    form.name: form
    for form in (
        _over("bias over T_in", "T_in", _T_IN, _warm),
        LearnedForm(
            "bias over late T_in",
            f"T_in {_LAG_S:.0f} s late",
            _T_IN | Input.HISTORY,
            _curve(_warm, _LAG_S),
            curve=True,
            smooth=True,
        ),
        _over("bias over T_out", "T_out", _T_OUT, _case_warm),
        _over("bias over dT_in/dt", "dT_in/dt", _WARMING, _warming),
        _over("bias over T_in - T_out", "T_in - T_out", _GRADIENT, _gradient),
        _over_both("T_in and dT_in/dt", _T_IN | _WARMING, _warm, _warming),
        _over_both("T_out and dT_in/dt", _T_OUT | _WARMING, _case_warm, _warming),
        _over_both("T_in and T_in - T_out", _T_IN | _GRADIENT, _warm, _gradient),
        LearnedForm("memory of T_in", "T_in before", _T_IN | Input.HISTORY, _memory(_warm)),
        LearnedForm("memory of T_out", "T_out before", _T_OUT | Input.HISTORY, _memory(_case_warm)),
        LearnedForm("loops of T_in", "turns of T_in", _T_IN | Input.HISTORY, _loops),
        LearnedForm("memory of temperature changes", "dT_in/dt before", _WARMING | Input.HISTORY, _activity),
        _over("scale factor over T_in", "rate times T_in", _T_IN, _warm, PPM),
        _over("scale factor over dT_in/dt", "rate times dT_in/dt", _WARMING, _warming, PPM),
        _over("scale factor over T_in - T_out", "rate times T_in - T_out", _GRADIENT, _gradient, PPM),
        LearnedForm(
            "scale factor's memory of T_in",
            "rate times T_in before",
            _T_IN | Input.HISTORY,
            _memory(_warm),
            PPM,
        ),
        LearnedForm("bias over rate", "rate", Input.RATE, _rate_curve, curve=True, smooth=True),
        LearnedForm("bias over table angle", "table angle", Input.ANGLE, _bias_waves),
        LearnedForm("rate over table angle", "table angle, with rate", _TURNING, _rate_waves),
        LearnedForm("bias over direction", "attitude", Input.ANGLE | Input.ATTITUDE, _directions),
        LearnedForm(
            "bias over direction and T_in",
            "attitude times T_in",
            Input.ANGLE | Input.ATTITUDE | _T_IN,
            _warm_directions,
        ),
        LearnedForm(
            "memory of direction",
            "attitude before",
            Input.ANGLE | Input.ATTITUDE | Input.HISTORY,
            _after_directions,
        ),
        LearnedForm("time since power-on", "time since power-on", Input.TIME, _after_power_on),
        LearnedForm(
            "scale factor since power-on",
            "rate times time since power-on",
            Input.TIME,
            _after_power_on,
            PPM,
        ),
        LearnedForm("heat of turning", "square of rate before", Input.TABLE_RATE | Input.HISTORY, _heat),
        # no longer offered by a diagnosis; model files of before name it
        LearnedForm("answer to changes of rate", "change of rate", _TURNING, _rate_changes),
        LearnedForm(
            "response to changes of rate",
            "change of rate before",
            _TURNING | Input.HISTORY,
            _impulse_response,
            smooth=True,
        ),
    )
}
