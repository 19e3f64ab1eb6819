"""Candidate variables of the regression, by name, made of the two temperatures and their rates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from bench.analysis.rlg._rows import RampRun
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

_VARIABLES: Mapping[str, Callable[[RampRun], Array]] = {
    "T1": lambda r: r.case_c,
    "T2": lambda r: r.block_c,
    "dT1": lambda r: r.case_rate,
    "dT2": lambda r: r.block_rate,
    "T1*dT1": lambda r: r.case_c * r.case_rate,
    "T2*dT2": lambda r: r.block_c * r.block_rate,
    "dT1^2": lambda r: r.case_rate**2,
    "dT2^2": lambda r: r.block_rate**2,
    "T1^2": lambda r: r.case_c**2,
    "T2^2": lambda r: r.block_c**2,
    "T1-T2": lambda r: r.case_c - r.block_c,
    "T1*T2": lambda r: r.case_c * r.block_c,
    "(T1-T2)^2": lambda r: (r.case_c - r.block_c) ** 2,
    "dT1-dT2": lambda r: r.case_rate - r.block_rate,
    "T1^3": lambda r: r.case_c**3,
    "T2^3": lambda r: r.block_c**3,
    "sign(dT1)": lambda r: np.tanh(r.case_rate / 0.1),
}
"""Temperatures in degC, rates in degC/min; `sign(dT1)` is tanh(dT1 / 0.1), a hysteresis of direction."""
CANDIDATES = tuple(_VARIABLES)[:11]
"""The paper's variables x1 to x11 in its order; it names x1 to x8 and the gradient, the two squares are ours."""
FIVE_TERMS = ("T1", "dT1", "T1*dT1", "dT1^2", "T1-T2")
"""Variables x1, x3, x5, x7, x11 of the paper's final equation."""


def candidate_matrix(runs: Sequence[RampRun], names: Sequence[str]) -> Array:
    """Return the variables of all rows of all runs, shape (n, len(names)).

    ConfigurationError names a variable that there is not.
    """
    unknown = [name for name in names if name not in _VARIABLES]
    if unknown or not names or len(set(names)) < len(names):
        raise ConfigurationError(
            "a candidate list that cannot be used",
            where="stepwise regression",
            found=", ".join(unknown or names) or "no variable",
            expected="different names out of " + ", ".join(_VARIABLES),
            remedy="leave --variables out for the usual eleven",
        )
    return np.concatenate([np.column_stack([_VARIABLES[name](run) for name in names]) for run in runs])
