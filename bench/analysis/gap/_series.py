"""What a person looks at: the gyro's output less a model, before and after, as slow means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from bench.analysis.gap._bridge import bridge
from bench.analysis.gap._data import GapRun, group_runs
from bench.analysis.gap._model_file import Model
from drivers.base.arrays import Array

_WINDOW_S = 100.0


@dataclass(frozen=True, eq=False)
class Difference:
    """Output less model for one condition of one profile, mean of its repeats, 100 s means, deg/h, (m,) each."""

    profile: str
    condition: str
    time_s: Array
    before_dph: Array
    after_dph: Array


def differences(runs: Sequence[GapRun], before: Model, after: Model, points: int = 400) -> list[Difference]:
    """Return `Difference` for every condition; each run's own bias is taken out."""
    result = []
    for group in group_runs(runs):
        for condition, repeats in zip(group.conditions, group.runs, strict=True):
            s = repeats[0].stimulus
            width = max(1, round(_WINDOW_S / s.period_s)) | 1
            rows = np.zeros((2, len(s)))
            for run in repeats:
                own = run.output_dph - np.stack([model.predict(run.stimulus) for model in (before, after)])
                own = bridge(run.missing, s.period_s, before.noise).over(own)
                rows += (own - own.mean(axis=1, keepdims=True)) / len(repeats)
            smooth = uniform_filter1d(rows, width, axis=1, mode="nearest")
            at = np.linspace(0, len(s) - 1, min(points, len(s))).astype(np.int64)
            result.append(Difference(group.profile, condition, s.time_s[at], smooth[0, at], smooth[1, at]))
    return result
