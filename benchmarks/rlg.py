"""Ring laser over temperature: what each equation does on runs it has not seen, how often nonsense enters.

`python -m benchmarks.rlg [recording of a real chamber cycle]` prints the tables; about five minutes.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

from bench.analysis.common.statistics import attained
from bench.analysis.common.stepwise import stepwise
from bench.analysis.rlg import RampRun, load_chamber_cycle, study_chamber_cycle
from bench.analysis.rlg._rows import ramp_run
from bench.analysis.rlg._study import run_rlg_study
from benchmarks._rlg_runs import ramp_profile, rlg_run
from simulators.plant import rlg

UNITS = range(6)
PROFILES: dict[str, dict[str, Any]] = {
    "train": {},
    "repeat": {},
    "reverse": {"downwards": True},
    "faster": {"ramp_k_per_min": 1.0},
    "partial": {"low_c": -20.0, "high_c": 50.0},
}
_SOAK_S = 3600
_REPEATS = 300
_ROWS = 378


def emulated(unit_seed: int, kind: str, run_seed: int) -> RampRun:
    """Return one run of a unit, from the first ramp on."""
    data = rlg_run(ramp_profile(**PROFILES[kind]), unit_seed=unit_seed, run_seed=run_seed)
    cut = slice(_SOAK_S, None)
    return ramp_run(
        kind,
        f"RLG-{unit_seed}",
        data.time_s[cut],
        data.case_c[cut],
        data.block_c[cut],
        data.bias_dph[cut],
        true_bias_dph=data.true_bias_dph[cut],
        kind=kind,
    )


def improvement() -> None:
    """Print improvement and share of the oracle's, by unit and equation or form."""
    for unit in UNITS:
        runs = [emulated(unit, kind, 100 * unit + n) for n, kind in enumerate(PROFILES, start=1)]
        study = run_rlg_study(runs[:1], runs[1:])
        for way in study.everything:
            each = ", ".join(f"{row.kind} {row.improvement_pct:.1f} ({attained([row])[1]:.1f})"
                             for row in way.judged if row.oracle_pct is not None)  # fmt: skip
            share = attained(way.judged)[1] or 0.0
            print(
                f"unit {unit}, {way.name}{', taken' if way.name == study.chosen.name else ''}: mean "
                f"{way.mean_improvement_pct:.1f} %, {share:.1f} % of the true drift's; {each}"
            )
        for variant in study.variants:
            result = variant.result
            print(
                f"unit {unit}, {variant.name}: R2 {result.final.r2:.4f}, terms {', '.join(result.selected)}"
            )


def unsettled(spread: float = 0.2) -> None:
    """Print the same for units whose coefficients settle anew by `spread` (1 sigma) at every power-on."""
    usual, rlg.RUN_SPREAD = rlg.RUN_SPREAD, spread
    try:
        print(f"coefficients {100 * spread:.0f} % apart between power-ons in place of {100 * usual:.0f} %:")
        improvement()
    finally:
        rlg.RUN_SPREAD = usual


def false_entries() -> None:
    """Print how often unrelated AR(1) = 0.98 terms are kept beside a true one, in percent."""
    for rho in (0.0, 0.5, 0.8, 0.95):
        shares = []
        for prewhiten in (False, True):
            rng = np.random.default_rng(0)
            kept = 0
            for _ in range(_REPEATS):
                x = np.column_stack([_ar1(rng, 0.98) for _ in range(4)])
                y = x[:, 0] + _ar1(rng, rho) * np.sqrt(1.0 - rho**2)
                kept += sum(name != "x1" for name in stepwise(x, y, prewhiten=prewhiten).selected)
            shares.append(100.0 * kept / (3 * _REPEATS))
        print(f"residual AR(1) {rho}: nonsense kept {shares[0]:.1f} %, with the correction {shares[1]:.1f} %")


def _ar1(rng: np.random.Generator, rho: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.asarray(lfilter([1.0], [1.0, -rho], rng.standard_normal(_ROWS + 400))[400:])


def chamber_cycle(path: Path) -> None:
    """Print what each axis of the real chamber cycle gains on its held-out leg."""
    study = study_chamber_cycle(*load_chamber_cycle(path))
    for axis in study.axes:
        print(
            f"axis {axis.axis}: {axis.static_pct:.1f} % by temperature, {axis.dynamic_pct:.1f} % with its past; "
            f"{axis.verdict}"
        )
    print("; ".join(study.remarks))


if __name__ == "__main__":
    improvement()
    unsettled()
    false_entries()
    if len(sys.argv) > 1:
        chamber_cycle(Path(sys.argv[1]))
