"""A step of the bias at a temperature."""

from __future__ import annotations

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._effect import DPH, Curve, Effect, Input, Parameter, Shape, SlowRates
from simulators.effects._stimulus import REFERENCE_C, Stimulus


def _mode_hop(s: Stimulus, shape: Shape) -> Array:
    warm_k = s.lagged(s.warm_k, shape["lag_s"])
    return np.asarray(0.5 * np.tanh((warm_k + REFERENCE_C - shape["at_c"]) / shape["width_k"]))


def _grid(low_c: float, high_c: float) -> tuple[Shape, ...]:
    return tuple(
        {"at_c": at, "lag_s": lag, "width_k": width}
        for lag in (0.0, 300.0)
        for at in np.arange(low_c, high_c, _APART_K).tolist()
        for width in (0.8, 2.5)
    )


def _over_the_records(rates: SlowRates) -> tuple[Shape, ...]:
    """Return thresholds over all temperatures that the records show; none where they show no two."""
    spans = [(float(s.t_in_c.min()), float(s.t_in_c.max())) for s, _ in rates.records]
    low, high = min(span[0] for span in spans), max(span[1] for span in spans)
    return _grid(low + 0.5 * _APART_K, high) if high - low > _APART_K else ()


_APART_K = 5.0
MODE_HOP = Effect(
    "mode_hop",
    (Parameter("bias_step_dph", -100.0, 100.0, DPH),),
    _mode_hop,
    Input.T_IN,
    "T_in crossing a threshold",
    "step of laser mode or of a control loop at a temperature",
    "Bias steps where the temperature crosses a threshold.",
    _grid(-35.0, 20.0),
    curve=Curve(Input.T_IN),
    propose=_over_the_records,
)
