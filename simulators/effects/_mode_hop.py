"""A step of the bias at a temperature."""

from __future__ import annotations

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._effect import DPH, Curve, Effect, Input, Parameter, Shape, SlowRates
from simulators.effects._stimulus import REFERENCE_C, Stimulus


def _mode_hop(s: Stimulus, shape: Shape) -> Array:
    """What hops has its own temperature: late, or nearer to the case; back it hops `loop_k` below."""
    part = shape.get("toward_case", 0.0)
    warm_k = s.lagged(s.warm_k - part * s.gradient_k if part else s.warm_k, shape["lag_s"])
    pushed_k = warm_k + s.slack(warm_k, 0.5 * shape.get("loop_k", 0.0))
    return np.asarray(0.5 * np.tanh((pushed_k + REFERENCE_C - shape["at_c"]) / shape["width_k"]))


def _grid(low_c: float, high_c: float) -> tuple[Shape, ...]:
    sharp = {"lag_s": 0.0, "width_k": 0.1}
    forms = [
        {"lag_s": lag, "width_k": width, "loop_k": 0.0, "toward_case": 0.0}
        for lag in (0.0, 300.0)
        for width in (0.8, 2.5)
    ]
    forms += [sharp | {"loop_k": 3.0, "toward_case": 0.0}, sharp | {"loop_k": 0.0, "toward_case": 1.0}]
    return tuple({"at_c": at} | form for at in np.arange(low_c, high_c, _APART_K).tolist() for form in forms)


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
    also=Input.GRADIENT,
)
