"""Rows of a device that samples evenly, by stamps that a host gave them late: which row is which sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array

_LATE = 1.4
"""Part of the usual step from which on rows may be missing before a row."""
_ABOUT = 9
"""Rows on either side by which it is told."""


def row_places(time_s: Array) -> tuple[NDArray[np.int64], float]:
    """Return the sample's number of each row, (n,), and the period in s, of stamps (n,) that grow; n > 1.

    A stamp that is late by itself is no gap: the rows after a gap are late, too. The stamps' scatter may be half
    of the period.
    """
    steps_s = np.diff(time_s)
    usual_s = float(np.median(steps_s))
    number = np.arange(len(time_s))
    late = time_s - usual_s * number
    lost = np.zeros(len(time_s), np.int64)
    candidates = np.flatnonzero(steps_s > _LATE * usual_s) + 1
    for group in np.split(candidates, np.flatnonzero(np.diff(candidates) > _ABOUT) + 1):
        if not len(group):
            continue
        before = float(np.median(late[max(group[0] - _ABOUT, 0) : group[0]]))
        after = float(np.median(late[group[-1] : group[-1] + _ABOUT]))
        left = max(round((after - before) / usual_s), 0)
        for row in group[np.argsort(-steps_s[group - 1])]:
            own = min(left, max(round(float(steps_s[row - 1]) / usual_s) - 1, 1))
            lost[row], left = own, left - own
    place = number + np.cumsum(lost)
    return place, float((time_s[-1] - time_s[0]) / place[-1])
