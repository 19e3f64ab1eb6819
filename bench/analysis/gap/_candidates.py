"""Candidates: the catalogue's variants that a model lacks, and which of them these runs can show at all."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

from bench.analysis.gap._data import GapRun
from bench.analysis.gap._evidence import Candidate
from bench.analysis.gap._generic import FreeCurve, free_curves, grid_points
from bench.analysis.gap._model_file import Model
from bench.analysis.gap._response import proposed_variants
from drivers.base.arrays import Array
from simulators.effects import Effect, Input, Variant, catalogue

_LEAST_DETECTABLE = 5.0
_THE_SAME = 1e-3
"""Part of a column's energy apart from another's below which no record tells the two."""
FREE_CURVE = -4.0
"""Prior log odds of a free curve against an effect of the catalogue."""


def candidate_variants(model: Model, runs: Sequence[GapRun]) -> list[Variant]:
    """Return the catalogue's variants that the model does not have as terms, then free curves over the inputs."""
    others = all(run.stimulus.force_g is None and run.stimulus.cross_rate_dph is None for run in runs)
    effects = [
        effect
        for effect in effects_beside(model).values()
        if not (others and Input.OTHER_AXES in effect.inputs)  # nothing measured what it follows
    ]
    usual = [variant for effect in effects if effect.propose is None for variant in effect.variants()]
    usual = [variant for variant in usual if not _has_slope(variant) or _slope_known(variant, model)]
    return [*usual, *proposed_variants(effects, runs), *free_curves(runs)]


def _has_slope(variant: Variant) -> bool:
    """Return whether a form of a curve over one input has a straight part in it, as an exponential has."""
    return variant.effect.curve is not None and bool(variant.shape.get("growth"))


def _slope_known(variant: Variant, model: Model) -> bool:
    """Return whether a model has a term over a variant's input; else the slope is to be found by itself.

    In one with the bend it holds no further than the runs go: a recording's warmer leg was 72 % closed, and 98 %
    by a straight line and a square.
    """
    return any(term.effect.curve == variant.effect.curve for term in model.terms)


def effects_beside(model: Model) -> dict[str, Effect]:
    """Return the catalogue's effects on the rate that a model does not have, by name."""
    names = {term.name for term in model.terms}
    return {
        name: each for name, each in catalogue().items() if isinstance(each, Effect) and name not in names
    }


def candidates_of(variants: Sequence[Variant]) -> list[Candidate]:
    """Return the variants as candidates; their columns follow the data in the reduced system."""
    result, column = [], 1
    for index, variant in enumerate(variants):
        k = len(variant.effect.parameters)
        own = tuple(range(column, column + k))
        curve = isinstance(variant.effect, FreeCurve)
        odds = FREE_CURVE if curve else 0.0
        points, series = grid_points(variant.effect), None if curve else series_of(variant.effect)
        result.append(Candidate(variant.effect.name, index, own, points, odds, curve, series))
        column += k
    return result


def series_of(effect: Effect) -> Hashable:
    """Return the power series that an effect's formula is a term of: that of one temperature, or of even rates.

    A real dependence has more than one of its terms: they are one mechanism. None for thresholds and memories.
    """
    keys = {key for shape in effect.shapes for key in shape}
    if (
        effect.curve is not None
        and effect.inputs == effect.curve.over
        and keys <= {"lag_s", "growth", "bend"}
    ):
        return effect.curve
    return "even rates" if effect.parity == 1 else None


def _at_once(index: int, system: Array, candidates: Sequence[Candidate], variants: Sequence[Variant]) -> str:
    """Return the effect without memory that does the very same as one with it, "" for none."""
    effect, own = variants[index].effect, candidates[index].columns
    if not effect.inputs & Input.HISTORY or isinstance(effect, FreeCurve) or len(own) > 1:
        return ""
    for other, variant in zip(candidates, variants, strict=True):
        simple = variant.effect
        if simple.inputs | Input.HISTORY != effect.inputs or simple.inputs == effect.inputs:
            continue
        if simple.unit != effect.unit or len(other.columns) > 1 or isinstance(simple, FreeCurve):
            continue
        products = system[np.ix_((own[0], other.columns[0]), (own[0], other.columns[0]))]
        if products[0, 1] ** 2 > (1.0 - _THE_SAME) * products[0, 0] * products[1, 1]:
            return simple.name
    return ""


def possible_candidates(
    system: Array,
    gram: Array,
    candidates: Sequence[Candidate],
    variants: Sequence[Variant],
    q: int,
    coarseness: float,
) -> tuple[list[int], dict[str, str]]:
    """Return candidates that could show in these runs, and for effects without any the reason.

    `coarseness`: the gyro's, see `Noise`.
    """
    possible: list[int] = []
    reasons: dict[str, str] = {}
    for index, candidate in enumerate(candidates):
        effect = variants[index].effect
        at = np.array(candidate.columns)
        apart, whole = np.diag(system)[at], np.diag(gram)[at + q]
        both = [parameter.bounds(coarseness) for parameter in effect.parameters]
        bounds = np.array([max(-low, high) for low, high in both])
        if whole.max() <= 0.0 or (bounds * np.sqrt(np.maximum(apart, 0.0))).max() < _LEAST_DETECTABLE:
            reason = f"{effect.follows} does not change within any run"
        elif (apart / np.maximum(whole, 1e-300)).max() < 1e-6:
            reason = "cannot be told from the nominal model's own terms in these runs"
        elif at_once := _at_once(index, system, candidates, variants):
            reason = (
                f"cannot be told from {at_once} in these runs: what would come late does not change in them"
            )
        else:
            possible.append(index)
            continue
        if not isinstance(effect, FreeCurve):
            reasons[effect.name] = reason
    shown = {candidates[index].effect for index in possible}
    return possible, {name: reason for name, reason in reasons.items() if name not in shown}
