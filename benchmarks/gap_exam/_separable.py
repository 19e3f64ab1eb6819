"""Whether the runs of a case can tell a stated effect of the catalogue from the true one at all."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from bench.analysis.gap import read_model, read_recordings
from benchmarks.gap_exam._files import gap_of, held_out_ids, read_arrays, run_keys, sealed_step_s
from benchmarks.gap_exam._whitening import NoiseLevels, Part, remaining, resampled
from simulators.effects import Effect, Variant, catalogue

_TOLD = 9.0
"""Difference in chi-square, twice that of log likelihood, from which one effect is told from another."""
_TWICE = 2.0
"""Where the catalogue's own formula of the true effect leaves more than noise, it says that much less: an effect
that leaves no more than twice as much is not told from it."""


def indistinct(
    folder: Path, name: str, true: Mapping[str, Iterable[str]], stated: Iterable[str], noise: NoiseLevels
) -> bool:
    """Return whether each effect stated explains what the true ones do as well as their own names do.

    `true` has the names in the catalogue of each effect that acts. Of a name the shapes of its grid are tried.
    """
    case = folder / "cases" / name
    judges = held_out_ids(case)
    runs = [run for run in read_recordings([case / "runs.toml"]).shown if run.run_id not in judges]
    keys, model = run_keys(case), read_model(folder / "nominal.toml")
    truth = read_arrays(folder / "sealed" / f"{name}.npz")
    gaps = [gap_of(truth, tuple(true), keys[run.run_id]) for run in runs]

    def with_variant(variant: Variant | None) -> float:
        parts = []
        for run, gap in zip(runs, gaps, strict=True):
            nominal = model.columns(run.stimulus)
            if variant is not None:
                nominal = np.concatenate((nominal, variant.columns(run.stimulus)))
            period_s = run.stimulus.period_s
            apart_s = sealed_step_s(gap, nominal.shape[1] * period_s)
            signal = resampled(gap[None], apart_s, period_s)
            n = min(signal.shape[1], nominal.shape[1])
            seen = np.isfinite(run.output_dph)[:n]
            parts.append(Part(signal[:, :n], nominal[:, :n], seen, period_s))
        return float(remaining(parts, noise)[0, 0])

    def left(names: Iterable[str]) -> list[float]:
        """Return the chi-square that each name leaves; without a column nothing is taken away."""
        result = []
        for effect in (effects.get(name) for name in names):
            tried: list[Variant | None] = [None]
            if isinstance(effect, Effect):
                tried = [Variant(effect, dict(shape)) for shape in effect.shapes or ({},)]
            result.append(min(with_variant(variant) for variant in tried))
        return result

    effects = catalogue()
    best = min((chi2 for names in true.values() for chi2 in left(names)), default=0.0)
    return all(chi2 < max(best + _TOLD, _TWICE * best) for chi2 in left(stated))
