"""A calibration after others of the same unit: what is known before it, both together, and whether they agree.

All of it rests on parameters that stay from run to run. Information adds: with prior P0 and posteriors C1, C2 of
two runs by themselves, C^-1 = C1^-1 + C2^-1 - P0^-1, and C^-1 x = C1^-1 x1 + C2^-1 x2 for a prior mean of zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bench.analysis.calibration._compensation import ImuCompensation
from bench.analysis.calibration._conventions import PARAMETER_NAMES, PARAMETERS, STATES, Task
from bench.analysis.calibration._estimator import Estimate
from bench.analysis.calibration._schedule import Schedule
from bench.analysis.calibration._segments import fold, schedule_segments
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

_CHANGED = 4.0
"""Standard deviations between two runs from which a parameter is called changed: by chance in 1 of 700 pairs."""

_UNSEEN = 1e-9
"""Part of the prior sigma below which a difference is rounding: neither run has seen the parameter."""


def after(task: Task, made: Sequence[Schedule | ImuCompensation]) -> Task:
    """Return the task of a further run after some: runs by schedules, as expected of them, or as calibrated.

    ConfigurationError for a calibration whose covariance is none.
    """
    known = np.zeros((24, 24)) if task.known is None else task.known
    for each in made:
        known = known + (_told(task, each) if isinstance(each, ImuCompensation) else _expected(task, each))
    return replace(task, known=known)


def together(found: Estimate, task: Task, earlier: Sequence[ImuCompensation]) -> Estimate:
    """Return an estimate with what earlier calibrations of the unit say; its course stays the run's own."""
    inverse = np.linalg.inv(found.covariance)
    information, weighted = inverse, inverse @ found.parameters
    scale = np.outer(task.prior_sigma[PARAMETERS], task.prior_sigma[PARAMETERS])
    for each in earlier:
        information = information + _told(task, each) / scale
        weighted = weighted + np.linalg.solve(each.covariance, each.parameters)
    covariance = np.linalg.inv(information)
    return replace(
        found,
        parameters=covariance @ weighted,
        sigma=np.sqrt(np.diag(covariance)),
        covariance=covariance,
    )


def changes(found: Estimate, task: Task, earlier: ImuCompensation) -> tuple[str, ...]:
    """Return the parameters that changed between an earlier calibration and an estimate by itself, in words.

    Each posterior mean is drawn to the prior mean by what its run does not see: the spread of the difference
    counts that, C1 A1 C1 + C2 A2 C2 + (C1 A1 - C2 A2) P0 (C1 A1 - C2 A2)^T with the runs' own information A.
    """
    scale = task.prior_sigma[PARAMETERS]
    prior = np.diag(scale**2)
    own = np.linalg.inv(found.covariance) - np.linalg.inv(prior)
    old = _told(task, earlier) / np.outer(scale, scale)
    seen, seen_before = found.covariance @ own, earlier.covariance @ old
    apart = seen - seen_before
    spread = seen @ found.covariance + seen_before @ earlier.covariance + apart @ prior @ apart.T
    seen_at_all = np.maximum(np.diag(spread), (_UNSEEN * scale) ** 2)
    off = (found.parameters - earlier.parameters) / np.sqrt(seen_at_all)
    runs = ", ".join(earlier.runs) or earlier.scheme
    return tuple(
        f"{PARAMETER_NAMES[at]} changed since {runs} by {abs(off[at]):.1f} standard deviations: "
        "both together are no calibration of it"
        for at in np.argsort(-np.abs(off))
        if abs(off[at]) > _CHANGED
    )


def _told(task: Task, earlier: ImuCompensation) -> Array:
    """Return the information of a calibration's run (24, 24), in units of the prior sigma."""
    scale = task.prior_sigma[PARAMETERS]
    scaled = earlier.covariance / np.outer(scale, scale)
    values = np.linalg.eigvalsh(scaled) if np.isfinite(scaled).all() else np.zeros(1)
    if values.min() <= 0.0 or values.max() > 1.0 + 1e-6:
        raise ConfigurationError(
            "an earlier calibration does not say what it knows",
            where=", ".join(earlier.runs) or earlier.scheme,
            found=f"a covariance with eigenvalues from {values.min():.3g} to {values.max():.3g} of the prior's",
            expected="above 0 and at most 1: a calibration of `gyrobench fit calibration` by a scheme",
        )
    return np.asarray(np.linalg.inv(scaled) - np.eye(24))


def _expected(task: Task, schedule: Schedule) -> Array:
    """Return the information that a run by a schedule gives, its navigation states unknown before and after."""
    whole = np.eye(STATES) + fold(schedule_segments(replace(task, known=None), schedule)).information
    across = whole[:6, PARAMETERS]
    own = whole[PARAMETERS, PARAMETERS] - across.T @ np.linalg.solve(whole[:6, :6], across)
    return np.asarray(own - np.eye(24))
