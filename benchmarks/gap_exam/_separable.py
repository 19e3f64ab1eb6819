"""Whether the runs of a case can tell a stated effect of the catalogue from the true one at all."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from bench.analysis.gap import read_model, read_recordings
from benchmarks.gap_exam._files import gap_of, held_out_ids, read_arrays, run_keys
from benchmarks.gap_exam._whitening import NoiseLevels, Part, remaining
from simulators.effects import Effect, Variant, catalogue

_TOLD = 3.0
"""Deflection left beside the best fit of another effect from which the two can be told apart."""


def indistinct(
    folder: Path, name: str, true: Sequence[str], stated: Iterable[str], noise: NoiseLevels
) -> bool:
    """Return whether each effect stated explains what the true ones do to within the noise, in some shape of
    its grid.
    """
    case = folder / "cases" / name
    judges = held_out_ids(case)
    runs = [run for run in read_recordings([case / "runs.toml"]).shown if run.run_id not in judges]
    keys, model = run_keys(case), read_model(folder / "nominal.toml")
    truth = read_arrays(folder / "sealed" / f"{name}.npz")
    gaps = [gap_of(truth, true, keys[run.run_id]) for run in runs]

    def left(variant: Variant) -> float:
        parts = []
        for run, gap in zip(runs, gaps, strict=True):
            own = variant.columns(run.stimulus)
            every = max(1, round(len(gap) / own.shape[1]))
            signal = gap[: own.shape[1] * every].reshape(-1, every).mean(axis=1)
            n = len(signal)
            nominal = np.concatenate((model.columns(run.stimulus), own))[:, :n]
            parts.append(Part(signal[None], nominal, np.isfinite(run.output_dph)[:n], run.stimulus.period_s))
        return float(np.sqrt(max(float(remaining(parts, noise)[0, 0]), 0.0)))

    effects = catalogue()
    for effect in (effects.get(each) for each in stated):
        if not isinstance(effect, Effect):
            return False
        if min(left(Variant(effect, dict(shape))) for shape in effect.shapes or ({},)) > _TOLD:
            return False
    return True
