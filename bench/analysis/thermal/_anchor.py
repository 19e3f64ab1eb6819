"""Bring the targets of all runs to one reference state, whatever the room temperature they started from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.analysis.thermal._regression import (
    TARGETS,
    common_step,
    in_reference,
    standardisation,
    target_rows,
)
from bench.analysis.thermal._signals import lag_terms, signals
from bench.analysis.thermal._types import FeatureRun
from drivers.base.arrays import Array

_RIDGE = 1e-6


def anchor_runs(runs: Sequence[FeatureRun], *, reference_temp_c: float | None = None) -> list[FeatureRun]:
    """Return the runs with one constant each taken off their targets, so that all count from one reference state.

    A run's target counts from its own reference window, whose temperature is the room's of that day; a scale
    factor of 6 ppm/degC then disagrees by 12 ppm between rooms of 23 and 25 degC. The constants are fitted
    jointly with a ridge lag model (the penalty is on the model only); kept is the zero of the run whose case is
    nearest to `reference_temp_c` in its reference window, by default the runs' median. For training runs; a
    prediction is counted from its own mean over the reference window instead.
    """
    common_step(runs)
    terms = [lag_terms(signals(run), with_temperature=True) for run in runs]
    _, scale = standardisation(terms, runs)
    temps = np.array([room_c(run) for run in runs])
    wanted = float(np.median(temps)) if reference_temp_c is None else reference_temp_c
    anchored = list(runs)
    for target in TARGETS:
        rows = target_rows(terms, runs, target)
        if rows is None:
            continue
        carriers = np.unique(rows.run)
        constants = _run_constants(rows.terms / scale, rows.target, rows.run, carriers)
        kept = constants[np.argmin(np.abs(temps[carriers] - wanted))]
        for number, constant in zip(carriers, constants, strict=True):
            run = anchored[number]
            moved = {target: getattr(run, target) - (constant - kept)}
            anchored[number] = replace(run, **moved)
    return anchored


def _run_constants(terms: Array, target: Array, run: NDArray[np.intp], carriers: NDArray[np.intp]) -> Array:
    """Solve target = terms @ w + c(run) with a ridge on w only; return c, shape (runs,)."""
    member = run[:, None] == carriers[None, :]
    share = member / member.sum(axis=0)
    mean_terms, mean_target = share.T @ terms, share.T @ target
    inner_terms, inner_target = terms - member @ mean_terms, target - member @ mean_target
    normal = inner_terms.T @ inner_terms + _RIDGE * len(target) * np.eye(terms.shape[1])
    weights = np.linalg.solve(normal, inner_terms.T @ inner_target)
    return np.asarray(mean_target - mean_terms @ weights)


def room_c(run: FeatureRun) -> float:
    """Return the case temperature in the run's reference window, degC."""
    window = in_reference(run)
    return float(run.t_out[window].mean()) if window.any() else float(run.t_out[0])
