"""Which of several forms is as good as the best, by what each leaves on runs left out of its fit."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import TypeVar

import numpy as np

from drivers.base.arrays import Array

Name = TypeVar("Name", bound=Hashable)


def within_one_standard_error(errors: Mapping[Name, Array]) -> list[Name]:
    """Return who is no worse than the best by one standard error of the difference, in the order given.

    `errors`: of each form, what it leaves on every run left out, (runs,), two runs at least.
    """
    best = min(errors.values(), key=lambda error: float(error.mean()))
    tied = []
    for name, error in errors.items():
        apart = error - best
        if apart.mean() <= apart.std(ddof=1) / np.sqrt(len(apart)):
            tied.append(name)
    return tied
