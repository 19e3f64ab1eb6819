"""How visible a signal is: the norm of its whitened signature, what the nominal model can imitate taken out."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bench.analysis.gap._cells import mixed_whitened
from bench.analysis.gap._data import GapRun, Group, group_runs
from bench.analysis.gap._fit import solve
from bench.analysis.gap._model_file import Model
from bench.analysis.gap._stack import Stack, stacked
from drivers.base.arrays import Array


def signature_norm(runs: Sequence[GapRun], model: Model) -> float:
    """Return the norm of the runs' outputs taken as a signature: whitened, nominal columns projected out."""
    gram = np.zeros((1 + len(model.sigmas),) * 2)
    for group in group_runs(runs):
        rows = mixed_whitened(group, with_nominal(group, model).full, model.noise)
        gram += np.einsum("rik,rjk->ij", rows, rows, optimize=True)
    solution = solve(gram, model.sigmas, ())
    return math.sqrt(max(float(gram[0, 0] - gram[solution.indices, 0] @ solution.values), 1e-30))


def unexplained(runs: Sequence[GapRun], model: Model) -> Array:
    """Return whitened coefficients (parity runs, n - 1) of one group, what the nominal can be taken out."""
    (group,) = group_runs(runs)
    rows = mixed_whitened(group, with_nominal(group, model).full, model.noise)
    gram = np.einsum("rik,rjk->ij", rows, rows, optimize=True)
    solution = solve(gram, model.sigmas, ())
    return np.asarray(rows[:, 0] - np.einsum("rik,i->rk", rows[:, solution.indices], solution.values))


def with_nominal(group: Group, model: Model) -> Stack:
    """Return coefficients of [output, nominal columns] of every run of a group."""
    runs = [run for each in group.runs for run in each]
    return stacked(
        runs, lambda run: [run.output_dph[None], model.columns(run.stimulus)], [False, False], model.noise
    )
