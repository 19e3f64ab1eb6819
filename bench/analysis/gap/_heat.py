"""How a unit's inside follows its case, as its runs show it: what a foretold run's temperature rests on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from bench.analysis.gap._data import GapRun
from drivers.base.arrays import Array
from simulators.effects import Stimulus

_OUTER_S = (0.0, 30.0, 100.0, 300.0, 600.0)
_INNER_S = (10.0, 30.0, 60.0, 100.0, 200.0, 400.0, 900.0, 1800.0, 3600.0)
"""Time constants that are tried, s; what lies between follows its neighbour closely enough to foretell."""
_HEATING_S = 1500.0
_LEAST_K = 5.0
"""Change of the case's temperature below which a run does not show how the inside follows."""
_EVERY = 10


@dataclass(frozen=True)
class Heat:
    """The inside follows the case over two lags; it is `offset_k` warmer, after power-on by `rise_k` more."""

    outer_s: float
    inner_s: float
    offset_k: float
    rise_k: float

    def inside_c(self, s: Stimulus) -> Array:
        """Return T_in by T_out and the time since power-on, (n,)."""
        return self.offset_k + _followed(s, self.outer_s, self.inner_s) + self.rise_k * _risen(s)

    def on(self, run: GapRun) -> GapRun:
        """Return a foretold run with this unit's heat."""
        return replace(run, stimulus=replace(run.stimulus, t_in_c=self.inside_c(run.stimulus)))


def heat_of(runs: Sequence[GapRun]) -> Heat | None:
    """Return the lags and offsets that fit the recorded temperatures best; None if no run shows them."""
    shown = [run.stimulus for run in runs if np.ptp(run.stimulus.t_out_c) > _LEAST_K]
    if not shown or all(np.array_equal(s.t_in_c, s.t_out_c) for s in shown):
        return None
    best: tuple[float, Heat] | None = None
    risen = np.concatenate([_risen(s)[::_EVERY] for s in shown])
    columns = np.stack((np.ones(len(risen)), risen), axis=1)
    for outer_s, inner_s in product(_OUTER_S, _INNER_S):
        left = np.concatenate([(s.t_in_c - _followed(s, outer_s, inner_s))[::_EVERY] for s in shown])
        values, *_ = np.linalg.lstsq(columns, left)
        off = float(((left - columns @ values) ** 2).sum())
        if best is None or off < best[0]:
            best = off, Heat(outer_s, inner_s, *values.tolist())
    return None if best is None else best[1]


def _followed(s: Stimulus, outer_s: float, inner_s: float) -> Array:
    outer = s.lagged(s.t_out_c, outer_s) if outer_s else s.t_out_c
    return s.lagged(outer, inner_s)


def _risen(s: Stimulus) -> Array:
    return np.asarray(1.0 - np.exp(-s.time_s / _HEATING_S))
