"""A step of the bias at a temperature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    if high - low <= _APART_K:
        return ()
    return (*_grid(low + 0.5 * _APART_K, high), *_standing_out(rates.records))


def _standing_out(records: Sequence[tuple[Stimulus, Array]]) -> list[Shape]:
    """Return the sharp hops that take most away of the records' means over blocks, there and back."""
    blocks = [found for each in records if (found := _Blocks.of(*each)) is not None]
    if not blocks:
        return []
    both_c = [each_c for each in blocks for each_c in (each.s.t_in_c, each.s.t_out_c)]
    low_c, high_c = min(float(each.min()) for each in both_c), max(float(each.max()) for each in both_c)
    places_c = np.arange(low_c + _COARSE_K, high_c, _COARSE_K)
    parts = _PARTS if any(np.ptp(each.s.gradient_k) > _COARSE_K for each in blocks) else _PARTS[:1]
    gain = np.stack([[_gained(blocks, places_c, loop_k, part) for loop_k in _LOOPS_K] for part in parts])
    shapes: list[Shape] = []
    while len(shapes) < _PROPOSED and gain.any():
        first, _, at = np.unravel_index(int(gain.argmax()), gain.shape)
        about_c, part = float(places_c[at]), parts[first]
        near_c = np.arange(about_c - _COARSE_K, about_c + _COARSE_K, _FINE_K)
        fine = np.stack([_gained(blocks, near_c, loop_k, part) for loop_k in _FINE_LOOPS_K])
        k, place = np.unravel_index(int(fine.argmax()), fine.shape)
        hop = {"at_c": float(near_c[place]), "loop_k": _FINE_LOOPS_K[k]}
        shapes.append(hop | {"lag_s": 0.0, "width_k": _FINE_K, "toward_case": part})
        gain[..., np.abs(places_c - about_c) < _APART_K] = 0.0
    return shapes


@dataclass(frozen=True)
class _Blocks:
    """A record as means over blocks: the samples of `s` in their middle, and what is `seen` there, (m, 3).

    The output less the run's own level and what is proportional to temperature in it; and these two, orthonormal.
    """

    s: Stimulus
    middle: NDArray[np.int64]
    seen: Array

    @classmethod
    def of(cls, s: Stimulus, output: Array) -> _Blocks | None:
        """Return a record's blocks; None where its temperature hardly changes."""
        count = len(output) // _BLOCK
        if np.ptp(s.warm_k) < _COARSE_K or count < _BLOCK:
            return None
        means = output[: count * _BLOCK].reshape(count, _BLOCK).mean(axis=1)
        seen = np.flatnonzero(np.isfinite(means))
        if len(seen) < _BLOCK:
            return None
        middle = seen * _BLOCK + _BLOCK // 2
        base, _ = np.linalg.qr(np.stack((np.ones(len(seen)), s.warm_k[middle]), axis=1))
        return cls(s, middle, np.column_stack((means[seen] - base @ (base.T @ means[seen]), base)))


def _gained(blocks: Sequence[_Blocks], places_c: Array, loop_k: float, part: float) -> Array:
    """Return the energy of the records that a hop at each place takes away, (places,); its size is one in all.

    Sums of what lies on either side of a place are partial sums over the blocks by temperature.
    """
    across, own = np.zeros(len(places_c)), np.full(len(places_c), 1e-12)
    for each in blocks:
        warm_k = each.s.warm_k - part * each.s.gradient_k if part else each.s.warm_k
        pushed_c = (warm_k + REFERENCE_C + each.s.slack(warm_k, 0.5 * loop_k))[each.middle]
        order = np.argsort(pushed_c)
        sums = np.cumsum(np.concatenate((np.zeros((1, 3)), each.seen[order])), axis=0)
        sides = sums[-1] - 2.0 * sums[np.searchsorted(pushed_c[order], places_c)]
        across += sides[:, 0]
        own += np.maximum(len(order) - np.square(sides[:, 1:]).sum(axis=1), 0.0)
    return np.asarray(np.square(across) / own)


_BLOCK = 4
"""Samples whose mean is compared: in a shock the temperature passes a loop in a minute."""
_COARSE_K, _FINE_K = 1.0, 0.1
_LOOPS_K, _FINE_LOOPS_K = (0.0, 1.0, 3.0), (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.5)
_PARTS = (0.0, 0.3, 0.6, 0.9)
"""Where what hops may be between T_in and the case."""
_PROPOSED = 3
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
