"""Which learned forms suit some runs: where their nodes, lags and orders are, and how alike neighbours are.

Values at neighbouring nodes are alike: a Gaussian process over the nodes with one of three lengths is their prior
(Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, ch. 2). Values of lags and orders are not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bench.analysis.gap._data import GapRun
from bench.analysis.gap._generic import INPUTS
from drivers.base.arrays import Array
from simulators.effects import DPH, FORMS, Input, LearnedForm, Variant, learned_shape

_LENGTHS = (0.04, 0.12, 0.4)
"""Lengths over which values at nodes are alike, in spans of the nodes."""
_NEGLIGIBLE = 1e-4
"""Part of a prior's largest variance from which a direction of it counts."""
_NODE_APART_K, _MOST_NODES = 1.5, 64
_COARSE = 17
_TURNING_DPS = 1.0
_LAGS_S = (60.0, 200.0, 600.0, 2000.0, 6000.0)
_SETTLING_S = (100.0, 300.0, 1000.0, 3000.0, 10000.0)
_LATE_S = (0.0, 60.0, 400.0)
_RESPONSE_S = tuple(float(delay) for delay in np.arange(0.0, 122.0, 2.0))
_FAST = Input.RATE | Input.TABLE_RATE | Input.ANGLE | Input.ATTITUDE | Input.TURN


@dataclass(frozen=True, eq=False)
class Candidate:
    """A learned form at one shape; the priors of its values, (k, m) each: values = `basis` @ prior @ N(0, 1)."""

    form: LearnedForm
    variant: Variant
    nodes: tuple[Array, ...] = ()

    @property
    def slow(self) -> bool:
        """Whether its columns have nothing at periods under 20 s: they follow temperatures and time alone."""
        return self.form.unit == DPH and not self.variant.effect.inputs & _FAST

    @cached_property
    def basis(self) -> Array | None:
        """What all priors span, (values, k), orthonormal; None where every value is by itself."""
        if not self._roots:
            return None
        left, sizes, _ = np.linalg.svd(np.concatenate(self._roots, axis=1), full_matrices=False)
        return np.asarray(left[:, sizes**2 > _NEGLIGIBLE * sizes[0] ** 2])

    @cached_property
    def priors(self) -> tuple[Array, ...]:
        """Roots of the priors' covariances in the basis; none where every value is by itself."""
        return () if self.basis is None else tuple(self.basis.T @ root for root in self._roots)

    @cached_property
    def _roots(self) -> tuple[Array, ...]:
        """Roots of the covariances of the values, one for each length."""
        if not self.form.smooth:
            return ()
        roots = []
        for length in _LENGTHS:
            covariance: Array = np.ones((1, 1))
            for own in self.nodes:
                apart = (own[:, None] - own) / (length * np.ptp(own))
                covariance = np.asarray(np.kron(covariance, np.exp(-0.5 * apart**2)))
            if self.form.curve:  # its value at the first node is zero, as that of every run's bias is free
                first = covariance[:1]
                covariance = (covariance - first - first.T + covariance[0, 0])[1:, 1:]
            sizes, directions = np.linalg.eigh(covariance)
            kept = sizes > _NEGLIGIBLE * sizes[-1]
            roots.append(np.asarray(directions[:, kept] * np.sqrt(sizes[kept])))
        return tuple(roots)


def span_of(runs: Sequence[GapRun], over: Input) -> tuple[float, float]:
    """Return the lowest and the highest value of an input in some runs."""
    values = [INPUTS[over].values(run.stimulus) for run in runs]
    return min(float(value.min()) for value in values), max(float(value.max()) for value in values)


def candidates_for(runs: Sequence[GapRun]) -> list[Candidate]:
    """Return the learned forms over what changes in these runs, with nodes, lags and orders that suit them."""
    return [*_thermal(runs), *_turned(runs)]


def _thermal(runs: Sequence[GapRun]) -> Iterator[Candidate]:
    """Yield forms over temperatures and time."""
    spans = {over: span_of(runs, over) for over in INPUTS}
    seen = {over for over, (low, high) in spans.items() if high - low >= INPUTS[over].least_span}
    turning = _turning(runs)

    def nodes(over: Input, most: int, apart: float = 0.0) -> Array:
        low, high = spans[over]
        count = int(np.clip((high - low) / apart, 8, most)) if apart else most
        return np.linspace(low, high, count)

    def curves(name: str, at: Array, lags_s: Sequence[float]) -> Iterator[Candidate]:
        return (_smooth(name, (at,), late_s) for late_s in lags_s)

    t_in, t_out, warming, gradient = Input.T_IN, Input.T_OUT, Input.WARMING, Input.GRADIENT
    yield _apart("time since power-on", _SETTLING_S)
    if turning:
        yield _apart("scale factor since power-on", _SETTLING_S)
    if t_in in seen:
        yield from curves("bias over T_in", nodes(t_in, _MOST_NODES, _NODE_APART_K), _LATE_S)
        yield _apart("memory of T_in", _LAGS_S)
        yield _apart("loops of T_in", (2.0, 5.0, 10.0, 20.0, 35.0))
        yield _apart("memory of temperature changes", _LAGS_S[:4])
        if turning:
            yield from curves("scale factor over T_in", nodes(t_in, _COARSE), (0.0, _LATE_S[-1]))
            yield _apart("scale factor's memory of T_in", _LAGS_S)
    if {t_out, gradient} <= seen:
        yield from curves("bias over T_out", nodes(t_out, _MOST_NODES, _NODE_APART_K), _LATE_S)
        yield _apart("memory of T_out", _LAGS_S)
    if warming in seen:
        yield from curves("bias over dT_in/dt", nodes(warming, _COARSE), _LATE_S)
        if turning:
            yield from curves("scale factor over dT_in/dt", nodes(warming, 9), _LATE_S[:1])
        for name, other in (("bias over T_in and dT_in/dt", t_in), ("bias over T_out and dT_in/dt", t_out)):
            if other in seen and (other is t_in or gradient in seen):
                yield _smooth(name, (nodes(other, _COARSE), nodes(warming, 9)), _LATE_S[1])
    if gradient in seen:
        yield from curves("bias over T_in - T_out", nodes(gradient, _COARSE), _LATE_S)
        if turning:
            yield from curves("scale factor over T_in - T_out", nodes(gradient, 9), _LATE_S[:1])
        if t_in in seen:
            yield _smooth("bias over T_in and T_in - T_out", (nodes(t_in, 13), nodes(gradient, 9)))


def _turned(runs: Sequence[GapRun]) -> Iterator[Candidate]:
    """Yield forms over rate, angle and attitude."""
    if turning := _turning(runs):
        most = max(float(np.abs(run.stimulus.axis_rate_dps).max()) for run in runs)
        side = [most * part for part in (0.005, 0.02, 0.06, 0.15, 0.3, 0.5, 0.7, 0.85, 1.0)]
        rates = np.array([*(-rate for rate in reversed(side)), 0.0, *side])
        # the slower the closer: near numbers are alike, and between two rates that were run the curve goes on
        yield _smooth("bias over rate", (rates,), prior=(np.arange(float(len(rates))),))
        yield _apart("rate over table angle", [order for order in range(1, 37) for _ in "cs"])
        yield _apart("heat of turning", (30.0, 100.0, 300.0, 1000.0))
        yield _smooth("response to changes of rate", (np.array(_RESPONSE_S),))
    angles = [run.stimulus.angle_deg for run in runs]
    turned = turning or max(float(np.ptp(angle)) for angle in angles) > 1.0
    if turned:
        yield _apart("bias over table angle", [order for order in range(1, 13) for _ in "cs"])
    tilted = any(np.ptp(run.stimulus.elevation_deg) > 1.0 for run in runs)
    if tilted or len({round(float(run.stimulus.elevation_deg[0])) for run in runs}) > 1:
        yield _apart("bias over direction", (0.0, 1.0, 2.0, 3.0))
        yield _apart("bias over direction and T_in", (0.0, 1.0, 2.0, 3.0))
    if tilted:
        yield _apart("memory of direction", (30.0, 100.0, 300.0), (0.0, 1.0, 2.0))


def _turning(runs: Sequence[GapRun]) -> bool:
    return any(np.abs(run.stimulus.axis_rate_dps).max() > _TURNING_DPS for run in runs)


def _apart(name: str, at: Sequence[float], second: Sequence[float] = ()) -> Candidate:
    """Return a form whose values have nothing to do with each other."""
    shape = learned_shape(at, second)
    return Candidate(FORMS[name], Variant(FORMS[name].effect(shape), shape))


def _smooth(
    name: str, nodes: tuple[Array, ...], late_s: float = 0.0, *, prior: tuple[Array, ...] = ()
) -> Candidate:
    """Return a form whose values at near nodes are alike; `prior`: where the nodes are for that, else `nodes`."""
    second = nodes[1].tolist() if len(nodes) > 1 else ()
    shape = learned_shape(nodes[0].tolist(), second, late_s)
    return Candidate(FORMS[name], Variant(FORMS[name].effect(shape), shape), prior or nodes)
