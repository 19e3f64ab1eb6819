"""What a person looks at: the gyro's output less a model, before and after, as slow means."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter1d

from bench.analysis.gap._bridge import bridge
from bench.analysis.gap._data import GapRun, beside, group_runs
from bench.analysis.gap._model_file import Model
from drivers.base.arrays import Array
from drivers.base.files import replace_file

_WINDOW_S = 100.0


@dataclass(frozen=True, eq=False)
class Difference:
    """Output less model for one condition of one profile, mean of its repeats, 100 s means, deg/h, (m,) each."""

    profile: str
    condition: str
    time_s: Array
    before_dph: Array
    after_dph: Array


def write_missing(closed: Model, runs: Sequence[GapRun], model_file: Path) -> list[Path]:
    """Write what a user's own simulation lacks, a CSV file a run beside the closed model's file, and return them.

    Columns: `time_s`, ends of the steps from the run's begin; `left_dph`, output less what was foretold;
    `missing_dph`, what the closed model's terms add to that. Runs without a simulation give no file.
    """
    files = []
    for run in beside(closed.simulation, runs):
        if not run.simulated:
            continue
        left, missing = (
            part - run.stimulus.input_rate_dph for part in (run.output_dph, closed.predict(run.stimulus))
        )
        time_s = run.stimulus.period_s * np.arange(1, len(run.stimulus) + 1)
        name = re.sub(r"[^\w.-]+", "-", run.run_id)
        files.append(model_file.with_name(f"{model_file.stem}_{name}.csv"))
        text = io.StringIO()
        columns = np.column_stack([time_s, left, missing])
        np.savetxt(text, columns, "%.9g", ",", header="time_s,left_dph,missing_dph", comments="")
        replace_file(files[-1], text.getvalue())
    return files


def differences(runs: Sequence[GapRun], before: Model, after: Model, points: int = 400) -> list[Difference]:
    """Return `Difference` for every condition; each run's own bias is taken out."""
    result = []
    for group in group_runs(beside(before.simulation, runs)):
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
